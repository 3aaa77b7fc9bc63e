"""Compute how staged actors move along their paths: stopping short, or leaving their lane.

Paths are `StationedPolyline`s of the centre of a body. Times count from the start of the scenario,
warm-up included.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from advercity_dsl import StagedActor
from numpy.typing import NDArray

from advercity.conflicts.metrics import UNIT_BOX_CORNERS, ActorTrack, Polygons
from advercity.frames import FRONT_DTYPE
from advercity.geometry.polyline import (
    StationedPolyline,
    drop_repeated_points,
    left_normals,
    unit_vectors,
)
from advercity.roads.network_file import SumoLane


def build_lane_path(lanes: Iterable[SumoLane], start_m: float) -> StationedPolyline:
    """Join the centre lines of successive lanes, from `start_m` on the first one on."""
    points = drop_repeated_points(np.concatenate([lane.shape[:, :2] for lane in lanes]))
    whole = StationedPolyline.from_points(points)
    return whole.cut(start_m, whole.length_m)


def build_boxes(
    path: StationedPolyline, stations: NDArray[np.float64], size: tuple[float, ...]
) -> Polygons:
    """Build the outlines (m,) on the ground of a body whose centre is at stations (m,)."""
    ahead = unit_vectors(path.headings_at(stations))
    left = left_normals(ahead)
    offsets = UNIT_BOX_CORNERS * np.array(size[:2])
    corners = offsets[:, :1] * ahead[:, None] + offsets[:, 1:] * left[:, None]
    return np.asarray(shapely.polygons(path.points_at(stations)[:, None] + corners))


def build_front_rows(
    path: StationedPolyline,
    stations: NDArray[np.float64],
    *,
    number: int,
    length_m: float,
    z_m: float,
    tick_s: float,
) -> NDArray[np.void]:
    """Build `FRONT_DTYPE` rows, from tick 0 on, of a body whose centre is at stations (ticks,)."""
    rows = np.zeros(len(stations), dtype=FRONT_DTYPE)
    yaw = path.headings_at(stations)
    fronts = path.points_at(stations) + length_m / 2 * unit_vectors(yaw)
    speed = np.diff(stations, prepend=stations[0]) / tick_s
    rows["tick"], rows["id"] = np.arange(len(stations)), number
    rows["x"], rows["y"] = fronts.T
    rows["z"], rows["yaw"], rows["speed"] = z_m, yaw, speed
    rows["acceleration"] = np.diff(speed, prepend=speed[0]) / tick_s
    return rows


DRIFT_RETURN_MARGIN_S = 0.15
"""Time between a drifting vehicle's return to its lane and the meeting of both fronts."""
DRIFT_HOLD_S = 0.5
"""Time for which it keeps the declared overlap before it returns."""


def find_closest_approach(ego: ActorTrack, other: ActorTrack) -> tuple[int, float]:
    """Find the tick at which the centres of two tracks are nearest, and their distance then."""
    ticks = np.intersect1d(ego.rows["tick"], other.rows["tick"])
    gaps = np.linalg.norm(ego.at_ticks(ticks).centres - other.at_ticks(ticks).centres, axis=1)
    nearest = int(np.argmin(gaps))
    return int(ticks[nearest]), float(gaps[nearest])


def compute_lateral_offsets(
    times_s: NDArray[np.float64],
    *,
    shift_m: float,
    out_s: float,
    hold_s: float,
    return_s: float,
    end_s: float,
) -> NDArray[np.float64]:
    """Compute offsets (n,) to the left at times (n,) of an excursion from the lane.

    The actor moves out by `shift_m` within `out_s`, stays there for `hold_s`, and comes back within
    `return_s` to be in its lane at `end_s`. Both moves are quintics, whose lateral speed and
    acceleration begin and end at zero.
    """
    return_start_s = end_s - return_s
    out = _quintic_step((times_s - return_start_s + hold_s + out_s) / out_s)
    back = _quintic_step((times_s - return_start_s) / return_s)
    return shift_m * (out - back)


QUINTIC_PEAK_ACCELERATION = 5.7735
"""Maximum of the second derivative of the quintic from 0 to 1."""


def _quintic_step(fraction: NDArray[np.float64]) -> NDArray[np.float64]:
    u = np.clip(fraction, 0.0, 1.0)
    return u**3 * (10 - 15 * u + 6 * u**2)


def shift_laterally(
    track: NDArray[np.void], offsets: NDArray[np.float64], length_m: float, tick_s: float
) -> NDArray[np.void]:
    """Move the body's middle in `FRONT_DTYPE` rows to the left by offsets (n,).

    The front leads by half a body in the direction of the middle's motion.
    """
    rows = track.copy()
    # Below 1 m/s the ratio of the speeds does not give the direction of the body.
    moves = track["speed"] > 1.0
    slope = np.where(moves, np.gradient(offsets, tick_s) / np.maximum(track["speed"], 1.0), 0.0)
    left = offsets + length_m / 2 * slope
    rows["x"] -= left * np.sin(track["yaw"])
    rows["y"] += left * np.cos(track["yaw"])
    rows["yaw"] += np.arctan(slope)
    return rows


CLEARANCE_M = 0.6
"""Distance of a stopped actor from the ground that the ego covers."""
STOP_SEARCH_STEP_M = 0.1
EGO_SWEEP_BEFORE_S, EGO_SWEEP_AFTER_S = 6.0, 5.0
"""Times around the ego's crossing for which the actor keeps clear of its path."""
MERGE_HEADWAY_S = 1.5
"""Headway behind the ego of an actor going on in the ego's lane."""
MAX_CROSSING_GAP_M = 8.0
"""Maximum distance of the actual crossing from the declared point."""
COMMANDED_AFTER_S = 1.5
"""Time after the crossing for which an actor that does not brake keeps its speed."""
MERGE_GAP_M = 1.0
"""Maximum distance of paths that join without crossing."""
LEAST_RUN_M = 3.0
"""Minimum length over which paths run together before a crossing that counts as joining."""


@dataclass(frozen=True)
class PathCrossing:
    """Where and when the ego crosses an actor's path.

    Attributes:
        distance_m: Station of the crossing on the actor's path.
        ego_s: Time at which the ego's centre is there.
        stop_m: Last station on the actor's path at which it is clear of the ego.
        enter_m: Station at which it enters the ego's path.
        clear_s: Time at which the ego has left the actor's path.
    """

    distance_m: float
    ego_s: float
    stop_m: float
    enter_m: float
    clear_s: float


def find_crossing(
    line: shapely.LineString, ego: ActorTrack, point: tuple[float, float]
) -> NDArray[np.float64] | None:
    """Find where (2,) the ego's driven path crosses a line, or joins it; None if nowhere.

    Of several crossings it is the one nearest to `point`, within `MAX_CROSSING_GAP_M`. Joining
    paths count from where they join: centimetres decide where they cross, if at all.
    """
    parts = shapely.get_parts(shapely.intersection(line, shapely.LineString(ego.centres)))
    crossings = [shapely.get_coordinates(part)[0] for part in parts if not part.is_empty]
    nearest = _find_nearest_point(crossings, point)
    gaps = np.asarray(shapely.distance(line, shapely.points(ego.centres)))
    if nearest is None and gaps.min() > MERGE_GAP_M:
        return None
    near = gaps <= max(MERGE_GAP_M / 2, gaps.min())
    row = int(np.argmax(near))
    if nearest is not None:
        crosses = ego.find_nearest_row(nearest)
        row = int(np.flatnonzero(~near[:crosses]).max(initial=-1)) + 1
        if np.linalg.norm(ego.centres[row] - nearest) < LEAST_RUN_M:
            return nearest
    joins = shapely.Point(ego.centres[row])
    on_line = shapely.get_coordinates(line.interpolate(line.project(joins)))[0]
    return _find_nearest_point([on_line], point)


def _find_nearest_point(
    candidates: Sequence[NDArray[np.float64]], point: tuple[float, float]
) -> NDArray[np.float64] | None:
    gaps = [float(np.linalg.norm(candidate - np.array(point))) for candidate in candidates]
    if min(gaps, default=np.inf) > MAX_CROSSING_GAP_M:
        return None
    return candidates[int(np.argmin(gaps))]


def compute_path_crossing(
    path: StationedPolyline,
    size: tuple[float, float, float],
    ego: ActorTrack,
    point: tuple[float, float],
    tick_s: float,
) -> PathCrossing | None:
    """Compute where an actor has to stop for the ego, and until when; None if they do not meet.

    `size` is the actor's length, width and height, `point` the declared conflict point.
    """
    crossing = find_crossing(path.line, ego, point)
    if crossing is None:
        return None
    driven = StationedPolyline.from_points(ego.centres)
    crossing_m = driven.line.project(shapely.Point(crossing))
    ego_s = float(np.interp(crossing_m, driven.stations_m, ego.rows["tick"])) * tick_s
    distance_m = path.line.project(shapely.Point(crossing))
    near = (
        np.abs(ego.rows["tick"] * tick_s - ego_s - (EGO_SWEEP_AFTER_S - EGO_SWEEP_BEFORE_S) / 2)
        <= (EGO_SWEEP_BEFORE_S + EGO_SWEEP_AFTER_S) / 2
    )
    swept = shapely.union_all(ego.boxes[near])
    stop_m = find_stop_station(path, size, swept, distance_m)
    ahead = path.cut(stop_m, path.length_m).line.buffer(size[1] / 2, cap_style="flat")
    inside = shapely.intersects(ego.boxes, ahead) & near
    last_s = float(ego.rows["tick"][inside].max(initial=0)) * tick_s
    return PathCrossing(
        distance_m=distance_m,
        ego_s=ego_s,
        stop_m=stop_m,
        enter_m=find_stop_station(path, size, swept, distance_m, clearance_m=0.0),
        # If the paths join, the ego never leaves the actor's: a headway counts instead, and a
        # fifth of a second per metre of the actor's length.
        clear_s=min(last_s, ego_s + MERGE_HEADWAY_S + size[0] / 5),
    )


def find_stop_station(
    path: StationedPolyline,
    size: tuple[float, ...],
    area: shapely.Geometry,
    crossing_m: float,
    clearance_m: float = CLEARANCE_M,
) -> float:
    """Find the last station before a crossing at which a body on a path is clear of an area.

    Stations refer to its centre; `size` begins with its length and width.
    """
    probes = np.arange(0.0, crossing_m, STOP_SEARCH_STEP_M)
    free = shapely.distance(build_boxes(path, probes, size), area) > clearance_m
    stop_m = crossing_m if free.all() else float(probes[np.argmin(free)]) - STOP_SEARCH_STEP_M
    return max(stop_m, 0.0)


def compute_stop_stations(
    crossing: PathCrossing,
    actor: StagedActor,
    length_m: float,
    *,
    offset_s: float,
    post_encroachment_s: float,
    brakes: bool,
    tick_s: float,
    ticks: int,
) -> tuple[NDArray[np.float64], float]:
    """Compute stations along its path of an actor that stops short of the ego and then goes on.

    Without braking it would be at the crossing `offset_s` after the ego; it enters the ego's path
    `post_encroachment_s` after the ego has left the actor's. If `brakes` is false it keeps its
    speed. `length_m` is the length of its path.

    Returns:
        The stations (ticks,), and the time from which the actor drives freely.
    """
    acceleration, braking = actor.acceleration_m_s2, actor.braking_m_s2
    meets_s = crossing.ego_s + offset_s
    drives_s = crossing.distance_m / actor.speed_m_s
    start_s = meets_s - drives_s - actor.speed_m_s / (2 * acceleration)
    go_s = crossing.clear_s + post_encroachment_s - np.sqrt(2 * CLEARANCE_M / acceleration)
    stop_m = crossing.stop_m
    if not brakes:
        go_s, stop_m = meets_s + COMMANDED_AFTER_S, length_m
    # If the actor has to set out before the scenario begins, it has moved by tick 0.
    first = int(np.floor(min(start_s, 0.0) / tick_s))
    stations: list[float] = []
    station = speed = 0.0
    for tick in range(first, ticks):
        time_s = tick * tick_s
        halt = length_m if time_s >= go_s else stop_m
        since_start = acceleration * max(time_s - start_s, 0.0)
        wanted = min(actor.speed_m_s, since_start, speed + acceleration * tick_s)
        room = max(halt - station - (speed + wanted) * tick_s / 2, 0.0)
        before, speed = speed, min(wanted, np.sqrt(2 * braking * room))
        station = max(min(station + (before + speed) / 2 * tick_s, halt), station)
        if tick >= 0:
            stations.append(station)
    return np.array(stations), go_s


STRAIGHT_ON_M = 60.0
"""Length of the path of an actor that does not evade the ego."""


def go_straight_on(path: StationedPolyline) -> StationedPolyline:
    """Return the first leg of a path, extended."""
    start, turn = path.points[:2]
    ahead = (turn - start) / np.linalg.norm(turn - start)
    return StationedPolyline.from_points(np.array([start, turn + STRAIGHT_ON_M * ahead]))


def find_evasion(
    path: StationedPolyline, ego: ActorTrack, point: tuple[float, float], tick_s: float
) -> tuple[float, float]:
    """Find when the ego passes a point, and the station of the path's last leg next to it."""
    leg = shapely.LineString(path.points[-2:])
    station_m = float(path.stations_m[-2]) + leg.project(shapely.Point(point))
    return ego.find_passing_tick(point) * tick_s, station_m
