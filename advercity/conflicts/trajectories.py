"""Paths that staged actors follow, and what they look like from tick to tick.

Leaving one's lane to the left and coming back, over what SUMO records of a vehicle.

How a staged actor times its approach: it comes as if to meet the ego, and stops just short.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from advercity_dsl import StagedActor
from numpy.typing import NDArray

from advercity.conflicts.metrics import UNIT_BOX_CORNERS, ActorTrack, Polygons
from advercity.frames import FRONT_DTYPE
from advercity.roads.lane_graph import SumoLane


@dataclass(frozen=True, eq=False)
class ActorPath:
    """A polyline that the middle of a body follows.

    Attributes:
        points: (n, 2) metres.
    """

    points: NDArray[np.float64]

    @staticmethod
    def from_lanes(lanes: Iterable[SumoLane], start_m: float) -> "ActorPath":
        """The centre lines of lanes that follow each other, from `start_m` on the first on."""
        shapes = np.concatenate([lane.shape[:, :2] for lane in lanes])
        steps = np.linalg.norm(np.diff(shapes, axis=0), axis=1)
        whole = ActorPath(shapes[np.concatenate([[True], steps > 1e-6])])
        return ActorPath(shapely.get_coordinates(whole.cut_segment(start_m, whole.length_m)))

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

    def cut_segment(self, from_m: float, to_m: float) -> shapely.LineString:
        """The part between two stations."""
        inside = (self.stations_m > from_m) & (self.stations_m < to_m)
        ends = self.points_at(np.array([from_m, to_m]))
        return shapely.LineString([ends[0], *self.points[inside], ends[1]])

    def points_at(self, stations: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points (m, 2) at stations (m,)."""
        return np.column_stack(
            [np.interp(stations, self.stations_m, axis) for axis in self.points.T]
        )

    def headings_at(self, stations: NDArray[np.float64]) -> NDArray[np.float64]:
        """Directions (m,) at stations (m,), radians counter-clockwise from east."""
        piece = np.searchsorted(self.stations_m, stations, side="right") - 1
        first = np.clip(piece, 0, len(self.points) - 2)
        steps = self.points[first + 1] - self.points[first]
        return np.arctan2(steps[:, 1], steps[:, 0])

    def boxes_at(self, stations: NDArray[np.float64], size: tuple[float, ...]) -> Polygons:
        """(m,) boxes of a body at stations (m,)."""
        yaw = self.headings_at(stations)
        ahead = np.column_stack([np.cos(yaw), np.sin(yaw)])
        left = np.column_stack([-ahead[:, 1], ahead[:, 0]])
        offsets = UNIT_BOX_CORNERS * np.array(size[:2])
        corners = offsets[:, :1] * ahead[:, None] + offsets[:, 1:] * left[:, None]
        return np.asarray(shapely.polygons(self.points_at(stations)[:, None] + corners))

    def build_front_rows(
        self, stations: NDArray[np.float64], number: int, length_m: float, z_m: float, tick_s: float
    ) -> NDArray[np.void]:
        """`FRONT` rows, from tick 0 on, of a body whose middle is at stations (ticks,)."""
        rows = np.zeros(len(stations), dtype=FRONT_DTYPE)
        yaw = self.headings_at(stations)
        fronts = self.points_at(stations) + length_m / 2 * np.column_stack(
            [np.cos(yaw), np.sin(yaw)]
        )
        speed = np.diff(stations, prepend=stations[0]) / tick_s
        rows["tick"], rows["id"] = np.arange(len(stations)), number
        rows["x"], rows["y"] = fronts.T
        rows["z"], rows["yaw"], rows["speed"] = z_m, yaw, speed
        rows["acceleration"] = np.diff(speed, prepend=speed[0]) / tick_s
        return rows


DRIFT_RETURN_MARGIN_S = 0.15
"""The drifting vehicle is back in its lane this long before both fronts meet."""


def find_nearest_tick(ego: ActorTrack, other: ActorTrack) -> tuple[int, float]:
    """The tick at which the middles of two tracks are nearest, and their distance there."""
    ticks = np.intersect1d(ego.rows["tick"], other.rows["tick"])
    gaps = np.linalg.norm(ego.at_ticks(ticks).centres - other.at_ticks(ticks).centres, axis=1)
    least = int(np.argmin(gaps))
    return int(ticks[least]), float(gaps[least])


def compute_lateral_offsets(
    times_s: NDArray[np.float64],
    *,
    shift_m: float,
    out_s: float,
    hold_s: float,
    return_s: float,
    end_s: float,
) -> NDArray[np.float64]:
    """Offsets (n,) to the left at times (n,): out, beside the lane for a while, and back by an end.

    Both are quintic, so that lateral speed and acceleration begin and end at zero.
    """
    turns_s = end_s - return_s
    out = _quintic_step((times_s - turns_s + hold_s + out_s) / out_s)
    back = _quintic_step((times_s - turns_s) / return_s)
    return shift_m * (out - back)


def _quintic_step(share: NDArray[np.float64]) -> NDArray[np.float64]:
    u = np.clip(share, 0.0, 1.0)
    return u**3 * (10 - 15 * u + 6 * u**2)


def shift_laterally(
    track: NDArray[np.void], offsets: NDArray[np.float64], tick_s: float
) -> NDArray[np.void]:
    """`FRONT` rows moved to the left by offsets (n,), with the yaw that this takes."""
    rows = track.copy()
    rows["x"] -= offsets * np.sin(track["yaw"])
    rows["y"] += offsets * np.cos(track["yaw"])
    sideways = np.gradient(offsets, tick_s)
    rows["yaw"] += np.where(
        track["speed"] > 1.0, np.arctan2(sideways, np.maximum(track["speed"], 1.0)), 0.0
    )
    return rows


CLEARANCE_M = 0.6
"""Between a stopped actor and where the ego drives."""
STOP_SEARCH_STEP_M = 0.1
EGO_SWEEP_BEFORE_S, EGO_SWEEP_AFTER_S = 6.0, 5.0
"""Part of the ego's way, around its time at the point, that the actor keeps clear of."""
MERGE_HEADWAY_S = 1.5
"""An actor that goes on in the ego's lane lets it go first by this."""
MAX_CROSSING_GAP_M = 8.0
"""Nearer than this to the declared point the ways have to meet."""
MERGE_GAP_M = 1.0
"""Ways that come nearer than this without crossing join."""


@dataclass(frozen=True)
class PathCrossing:
    """Where and when the ego crosses an actor's path.

    Attributes:
        point: (2,) where the ways cross.
        distance_m: Along the actor's path from its start to the point.
        ego_s: When the ego's middle is there.
        stop_m: Along the path, up to where the actor is clear of the ego.
        clear_s: When the ego is out of the actor's way.
    """

    point: NDArray[np.float64]
    distance_m: float
    ego_s: float
    stop_m: float
    clear_s: float


def find_crossing(
    line: shapely.LineString, ego: ActorTrack, point: tuple[float, float]
) -> NDArray[np.float64] | None:
    """Where (2,) the ego's recorded way crosses a line, or else joins it; None if it does not.

    Of several crossings it is the one nearest to `point`; beyond `MUST_PASS_M` there is none.
    """
    parts = shapely.get_parts(shapely.intersection(line, shapely.LineString(ego.centres)))
    places = [shapely.get_coordinates(part)[0] for part in parts if not part.is_empty]
    nearest = _find_nearest_point(places, point)
    if nearest is not None:
        return nearest
    gaps = shapely.distance(line, shapely.points(ego.centres))
    if gaps.min() > MERGE_GAP_M:
        return None
    joins = shapely.Point(ego.centres[np.argmax(gaps <= max(MERGE_GAP_M / 2, gaps.min()))])
    on_line = shapely.get_coordinates(line.interpolate(line.project(joins)))[0]
    return _find_nearest_point([on_line], point)


def _find_nearest_point(
    places: Sequence[NDArray[np.float64]], point: tuple[float, float]
) -> NDArray[np.float64] | None:
    gaps = [float(np.linalg.norm(place - np.array(point))) for place in places]
    return places[int(np.argmin(gaps))] if min(gaps, default=np.inf) <= MAX_CROSSING_GAP_M else None


def compute_path_crossing(
    path: ActorPath,
    size: tuple[float, float, float],
    ego: ActorTrack,
    point: tuple[float, float],
    tick_s: float,
) -> PathCrossing | None:
    """Where the ego's recorded way meets a path, near a declared point; None if it does not."""
    here = find_crossing(path.line, ego, point)
    if here is None:
        return None
    way, place = shapely.LineString(ego.centres), shapely.Point(here)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(ego.centres, axis=0), axis=1))])
    ego_s = float(np.interp(way.project(place), along, ego.rows["tick"])) * tick_s
    distance = path.line.project(place)
    near = (
        np.abs(ego.rows["tick"] * tick_s - ego_s - (EGO_SWEEP_AFTER_S - EGO_SWEEP_BEFORE_S) / 2)
        <= (EGO_SWEEP_BEFORE_S + EGO_SWEEP_AFTER_S) / 2
    )
    swept = shapely.union_all(ego.boxes[near])
    probes = np.arange(0.0, distance, STOP_SEARCH_STEP_M)
    free = shapely.distance(path.boxes_at(probes, size), swept) > CLEARANCE_M
    stop = float(probes[np.argmin(free)]) - STOP_SEARCH_STEP_M if not free.all() else distance
    corridor = path.cut_segment(max(stop, 0.0), path.length_m).buffer(size[1] / 2, cap_style="flat")
    inside = shapely.intersects(ego.boxes, corridor) & near
    last = float(ego.rows["tick"][inside].max(initial=0)) * tick_s
    return PathCrossing(
        point=here,
        distance_m=distance,
        ego_s=ego_s,
        stop_m=max(stop, 0.0),
        clear_s=min(last, ego_s + MERGE_HEADWAY_S + size[0] / 5),
    )


def compute_stop_stations(
    crossing: PathCrossing,
    actor: StagedActor,
    length_m: float,
    *,
    offset_s: float,
    post_encroachment_s: float,
    tick_s: float,
    ticks: int,
) -> tuple[NDArray[np.float64], float]:
    """Stations (ticks,) along the path of one who stops short of the ego and goes on after it.

    Had it not braked, it would be at the point `offset_s` after the ego.

    Args:
        crossing: Where and when.
        actor: Its speed, acceleration and braking.
        length_m: Where the path ends.
        offset_s: As above; negative before the ego.
        post_encroachment_s: Time between the ego leaving the actor's path and the actor
            entering the ego's.
        tick_s: Length of a tick.
        ticks: How many.

    Returns:
        Stations, and when it sets out again.
    """
    speed, gains, loses = actor.speed_m_s, actor.acceleration_m_s2, actor.braking_m_s2
    start_s = crossing.ego_s + offset_s - crossing.distance_m / speed - speed / (2 * gains)
    go_s = crossing.clear_s + post_encroachment_s - np.sqrt(2 * CLEARANCE_M / gains)
    first = int(np.floor(min(start_s, 0.0) / tick_s))
    stations: list[float] = []
    here = pace = 0.0
    for tick in range(first, ticks):
        now = tick * tick_s
        goes = now >= go_s
        halt = length_m if goes else crossing.stop_m
        wanted = min(speed, pace + gains * tick_s) if now >= start_s else 0.0
        room = max(halt - here - wanted * tick_s / 2, 0.0)
        pace = max(min(wanted, np.sqrt(2 * loses * room)), 0.0)
        pace = min(pace, max(halt - here, 0.0) / tick_s)
        here += pace * tick_s
        if tick >= 0:
            stations.append(here)
    return np.array(stations), go_s


def find_passing(
    path: ActorPath, ego: ActorTrack, point: tuple[float, float], tick_s: float
) -> tuple[float, float]:
    """When the ego passes a point, and how far along a path that is whose last leg runs beside."""
    nearest = int(np.argmin(np.linalg.norm(ego.centres - point, axis=1)))
    leg = shapely.LineString(path.points[-2:])
    beside = float(path.stations_m[-2]) + leg.project(shapely.Point(point))
    return float(ego.rows["tick"][nearest]) * tick_s, beside
