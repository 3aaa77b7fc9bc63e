"""Paths that staged actors follow, and what they look like from tick to tick."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray

from advercity.traffic.bumpers import FRONT
from advercity.traffic.encounters import CORNERS, Polygons
from advercity.traffic.lanes import Lane


@dataclass(frozen=True, eq=False)
class Path:
    """A polyline that the middle of a body follows.

    Attributes:
        points: (n, 2) metres.
    """

    points: NDArray[np.float64]

    @staticmethod
    def along(lanes: Iterable[Lane], start_m: float) -> "Path":
        """The centre lines of lanes that follow each other, from `start_m` on the first on."""
        shapes = np.concatenate([lane.shape[:, :2] for lane in lanes])
        steps = np.linalg.norm(np.diff(shapes, axis=0), axis=1)
        whole = Path(shapes[np.concatenate([[True], steps > 1e-6])])
        return Path(shapely.get_coordinates(whole.between(start_m, whole.length_m)))

    @cached_property
    def line(self) -> shapely.LineString:
        """The same for shapely."""
        return shapely.LineString(self.points)

    @cached_property
    def stations_m(self) -> NDArray[np.float64]:
        """(n,) distance of every point from the first."""
        steps = np.linalg.norm(np.diff(self.points, axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])

    @property
    def length_m(self) -> float:
        """From its first point to the last."""
        return float(self.stations_m[-1])

    def between(self, from_m: float, to_m: float) -> shapely.LineString:
        """The part between two stations."""
        inside = (self.stations_m > from_m) & (self.stations_m < to_m)
        ends = self.at(np.array([from_m, to_m]))
        return shapely.LineString([ends[0], *self.points[inside], ends[1]])

    def at(self, stations: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points (m, 2) at stations (m,)."""
        return np.column_stack(
            [np.interp(stations, self.stations_m, axis) for axis in self.points.T]
        )

    def headings(self, stations: NDArray[np.float64]) -> NDArray[np.float64]:
        """Directions (m,) at stations (m,), radians counter-clockwise from east."""
        piece = np.searchsorted(self.stations_m, stations, side="right") - 1
        first = np.clip(piece, 0, len(self.points) - 2)
        steps = self.points[first + 1] - self.points[first]
        return np.arctan2(steps[:, 1], steps[:, 0])

    def boxes(self, stations: NDArray[np.float64], size: tuple[float, ...]) -> Polygons:
        """(m,) boxes of a body at stations (m,)."""
        yaw = self.headings(stations)
        ahead = np.column_stack([np.cos(yaw), np.sin(yaw)])
        left = np.column_stack([-ahead[:, 1], ahead[:, 0]])
        offsets = CORNERS * np.array(size[:2])
        corners = offsets[:, :1] * ahead[:, None] + offsets[:, 1:] * left[:, None]
        return np.asarray(shapely.polygons(self.at(stations)[:, None] + corners))

    def track(
        self, stations: NDArray[np.float64], number: int, length_m: float, z_m: float, tick_s: float
    ) -> NDArray[np.void]:
        """`FRONT` rows, from tick 0 on, of a body whose middle is at stations (ticks,)."""
        rows = np.zeros(len(stations), dtype=FRONT)
        yaw = self.headings(stations)
        fronts = self.at(stations) + length_m / 2 * np.column_stack([np.cos(yaw), np.sin(yaw)])
        speed = np.diff(stations, prepend=stations[0]) / tick_s
        rows["tick"], rows["id"] = np.arange(len(stations)), number
        rows["x"], rows["y"] = fronts.T
        rows["z"], rows["yaw"], rows["speed"] = z_m, yaw, speed
        rows["acceleration"] = np.diff(speed, prepend=speed[0]) / tick_s
        return rows
