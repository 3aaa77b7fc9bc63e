"""Polylines: distances along them, points and headings at such distances, parallel lines.

A station is a distance along a line from its start, in metres. Headings are radians
counter-clockwise from east, and all directions are of the (x, y) plane.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

Points = NDArray[np.float64]
"""(n, 2) or (n, 3) points in metres."""


def unit_vectors(heading: ArrayLike) -> Points:
    """Compute unit vectors (..., 2) of headings (...) in radians."""
    heading = np.asarray(heading, dtype=np.float64)
    return np.stack([np.cos(heading), np.sin(heading)], axis=-1)


def left_normals(direction: Points) -> Points:
    """Turn vectors (..., 2) to the left by a right angle."""
    return np.stack([-direction[..., 1], direction[..., 0]], axis=-1)


def polyline_length(points: Points) -> float:
    """Measure the length of a polyline (n, d)."""
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def polyline_stations(points: Points) -> NDArray[np.float64]:
    """Measure the distance (n,) of every point of a polyline (n, d) from its start."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def resample_polyline(points: Points, count: int) -> Points:
    """Spread `count` points (count, d) evenly along a polyline (n, d); the ends stay."""
    line = StationedPolyline.from_points(points)
    return line.points_at(np.linspace(0.0, line.length_m, count))


def offset_points(points: Points, headings: NDArray[np.float64], t: ArrayLike) -> Points:
    """Move points (..., 2) by `t` metres to the left of their headings (...)."""
    normals = left_normals(unit_vectors(headings))
    return points + np.asarray(t, dtype=np.float64)[..., None] * normals


def drop_repeated_points(points: Points) -> Points:
    """Drop points of a polyline (n, d) equal to the one before."""
    keep = np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-6
    return points[np.concatenate([[True], keep])]


@dataclass(frozen=True, eq=False)
class StationedPolyline:
    """A polyline with the station of each of its points.

    Attributes:
        points: (n, 2) or (n, 3) metres, two or more.
        stations_m: (n,) metres from the start, rising. They need not be lengths of chords: SUMO
            counts positions in a length of its own, and samples of an arc keep the arc's length.
    """

    points: Points
    stations_m: NDArray[np.float64]

    @classmethod
    def from_points(cls, points: Points, *, length_m: float | None = None) -> "StationedPolyline":
        """Measure stations along the chords, scaled so that the last is `length_m` if given."""
        stations_m = polyline_stations(points)
        if length_m is not None:
            # A lane of a single point in the plan still has a length for SUMO.
            stations_m = stations_m * (length_m / max(stations_m[-1], 1e-6))
        return cls(points, stations_m)

    @property
    def length_m(self) -> float:
        """Station of the last point."""
        return float(self.stations_m[-1])

    @cached_property
    def line(self) -> shapely.LineString:
        """The polyline as a shapely geometry."""
        return shapely.LineString(self.points)

    def points_at(self, stations_m: ArrayLike) -> Points:
        """Interpolate points (..., d) at stations (...); beyond an end, the end."""
        stations = np.asarray(stations_m, dtype=np.float64)
        columns = [np.interp(stations, self.stations_m, column) for column in self.points.T]
        return np.stack(columns, axis=-1)

    def headings_at(self, stations_m: ArrayLike, *, span_m: float = 0.0) -> NDArray[np.float64]:
        """Compute headings (...) at stations (...).

        They are of the chord of length `span_m` around each station, cut off at the ends of the
        line; with 0, of the segment after the station.
        """
        stations = np.asarray(stations_m, dtype=np.float64)
        if span_m:
            ahead = self.points_at(np.minimum(stations + span_m / 2, self.length_m))
            steps = ahead - self.points_at(np.maximum(stations - span_m / 2, 0.0))
        else:
            segment = np.searchsorted(self.stations_m, stations, side="right") - 1
            first = np.clip(segment, 0, len(self.points) - 2)
            steps = self.points[first + 1] - self.points[first]
        return np.arctan2(steps[..., 1], steps[..., 0])

    def project_point(self, point: ArrayLike) -> tuple[float, float]:
        """Find the station nearest to a point (2,) in the plane, and the distance in metres."""
        starts, steps = self.points[:-1, :2], np.diff(self.points[:, :2], axis=0)
        # Repeated points give segments without length; the bound keeps their fraction finite.
        squared = np.maximum((steps**2).sum(axis=1), 1e-12)
        fraction = np.clip(((np.asarray(point) - starts) * steps).sum(axis=1) / squared, 0, 1)
        distances = np.linalg.norm(starts + fraction[:, None] * steps - point, axis=1)
        nearest = int(np.argmin(distances))
        before, after = self.stations_m[nearest : nearest + 2]
        return float(before + fraction[nearest] * (after - before)), float(distances[nearest])

    def cut(self, start_m: float, end_m: float, *, margin_m: float = 0.0) -> "StationedPolyline":
        """Cut out the part between two stations; its own stations are chords and begin at 0.

        Points within `margin_m` of either end are left out, to avoid slivers.
        """
        is_inside = self.stations_m > start_m + margin_m
        is_inside &= self.stations_m < end_m - margin_m
        inner = self.stations_m[is_inside]
        return StationedPolyline.from_points(self.points_at([start_m, *inner, end_m]))

    def sample_points(self, step_m: float) -> Points:
        """Interpolate points (m, d) every `step_m` from the start; the end is not included."""
        return self.points_at(np.arange(0.0, self.length_m, step_m))


MITRE_LIMIT = 2.0
"""Largest move of an offset point at sharp corners, relative to the offset."""


def offset_polyline(line: Points, lateral_m: float) -> Points:
    """Offset a line (n, 3) to the left by `lateral_m` in the plan, with mitred corners."""
    steps = np.diff(line[:, :2], axis=0)
    normals = left_normals(steps / np.linalg.norm(steps, axis=1, keepdims=True))
    before, after = np.vstack([normals[:1], normals]), np.vstack([normals, normals[-1:]])
    middle = before + after
    squared = np.maximum((middle**2).sum(axis=1, keepdims=True), 4 / MITRE_LIMIT**2)
    return np.column_stack([line[:, :2] + lateral_m * 2 * middle / squared, line[:, 2]])


def simplify_together(lines: Sequence[Points], max_error_m: float) -> NDArray[np.int64]:
    """Choose the points (indices) of lines (n, 3) to keep all of them within an error.

    The lines have their points at the same places along one line (Douglas and Peucker's way).
    """
    if not lines:
        return np.zeros(0, dtype=np.int64)
    stacked = np.stack(lines, axis=1)
    middle = stacked.mean(axis=1)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(middle, axis=0), axis=1))])
    kept = np.zeros(len(along), dtype=bool)
    kept[[0, -1]] = True
    pending = [(0, len(along) - 1)]
    while pending:
        first, last = pending.pop()
        if last - first < 2:
            continue
        share = (along[first + 1 : last] - along[first]) / max(along[last] - along[first], 1e-9)
        straight = stacked[first] + share[:, None, None] * (stacked[last] - stacked[first])
        errors = np.linalg.norm(stacked[first + 1 : last] - straight, axis=2).max(axis=1)
        worst = int(errors.argmax())
        if errors[worst] > max_error_m:
            middle_index = first + 1 + worst
            kept[middle_index] = True
            pending += [(first, middle_index), (middle_index, last)]
    return np.flatnonzero(kept)
