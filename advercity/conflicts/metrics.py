"""Measure how near actors come: distance, time to collision, post-encroachment time.

All metrics use a trace's outlines on the ground, between actors at about the same height: actors
above and below a bridge never meet.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from advercity.frames import Trace
from advercity.geometry.polyline import StationedPolyline

UNIT_BOX_CORNERS = np.array([(1, 1), (1, -1), (-1, -1), (-1, 1)]) / 2
"""Corners of a box of length and width 1: front left, front right, rear right, rear left."""
PREDICTION_HORIZON_S = 6.0
"""Time ahead over which the paths of two actors are compared."""
PREDICTION_STEP_S = 0.1
LEVEL_GAP_M = 2.5
"""Difference of heights from which one of two actors is above the other; decks are 4 m higher."""
CHORD_M = 2.0
"""Length of the chords from which the heading of a path is computed."""

Polygons = NDArray[Any]
"""Shapely polygons (n,)."""


@dataclass(frozen=True)
class MetricAtTick:
    """A value of a metric and the kept tick at which it was measured."""

    value: float
    tick: int


@dataclass(frozen=True)
class Encounter:
    """How near two actors come to each other while both are present.

    Attributes:
        first: Id of an actor.
        second: Id of the other.
        distance_m: Minimum distance between their outlines, 0 if they touch.
        time_to_collision_s: Minimum time until their outlines would touch if both kept their
            velocity (Hayward, 1972); None if they never would.
        time_to_collision_on_way_s: The same if both kept their speed along their paths, which
            excludes oncoming traffic in the other lane of a bend; None beyond
            `PREDICTION_HORIZON_S`.
        post_encroachment_s: Minimum time between one leaving a place and the other entering it
            (Allen, Shin and Cooper, 1978); None if their paths share no place.
    """

    first: int
    second: int
    distance_m: MetricAtTick
    time_to_collision_s: MetricAtTick | None
    # A key of report.json, which keeps its name.
    time_to_collision_on_way_s: MetricAtTick | None
    post_encroachment_s: MetricAtTick | None


@dataclass(frozen=True)
class BoxOverlap:
    """Two actors whose outlines overlap at a tick."""

    first: int
    second: int
    tick: int
    area_m2: float


@dataclass(frozen=True)
class ActorTrack:
    """One actor's rows of a trace with its outline on the ground.

    Attributes:
        actor: Id.
        size: Length and width in metres.
        rows: (n,) of `STATE_DTYPE`, a row per tick, sorted.
    """

    actor: int
    size: NDArray[np.float64]
    rows: NDArray[np.void]

    @staticmethod
    def from_trace(trace: Trace, actor_id: int) -> "ActorTrack":
        """Select the track of an actor; KeyError if the trace has none."""
        actor, rows = trace.get_track(actor_id)
        return ActorTrack(actor_id, np.array(actor.size[:2]), rows)

    def at_ticks(self, ticks: NDArray[np.int32]) -> "ActorTrack":
        """Select some of the track's ticks (m,)."""
        keep = np.searchsorted(self.rows["tick"], ticks)
        return replace(self, rows=self.rows[keep])

    def find_nearest_row(self, point_m: ArrayLike) -> int:
        """Find the row in which the actor's centre is nearest to a point (2,)."""
        return int(np.argmin(np.linalg.norm(self.centres - np.asarray(point_m), axis=1)))

    def find_passing_tick(self, point_m: ArrayLike) -> float:
        """Interpolate the tick at which the actor's centre passes a point (2,) on its path."""
        driven = StationedPolyline.from_points(self.centres)
        station_m = driven.line.project(shapely.Point(np.asarray(point_m)))
        return float(np.interp(station_m, driven.stations_m, self.rows["tick"]))

    def extrapolate(self, ticks: NDArray[np.int32], after_s: NDArray[np.float64]) -> "ActorTrack":
        """Predict the track from ticks (m,) over times (k,), on its path at each tick's speed.

        Beyond the last row the actor goes straight on. All k rows of a tick are together.
        """
        rows = np.repeat(self.at_ticks(ticks).rows, len(after_s))
        rows["travelled"] += np.tile(after_s, len(ticks)) * rows["speed"]
        stations = self.rows["travelled"]
        beyond = np.maximum(rows["travelled"] - stations[-1], 0)
        for name in ("x", "y", "z", "yaw"):
            rows[name] = np.interp(rows["travelled"], stations, self.rows[name])
        rows["x"] += beyond * np.cos(rows["yaw"])
        rows["y"] += beyond * np.sin(rows["yaw"])
        return replace(self, rows=rows)

    def roll_on(self, path: StationedPolyline, for_s: float, tick_s: float) -> "ActorTrack":
        """Return the track continued at its last speed, parallel to a path."""
        after = np.arange(1, round(for_s / tick_s) + 1)
        rows = np.repeat(self.rows[-1:], len(after))
        moved_m = rows["speed"] * after * tick_s
        here_m, _ = path.project_point(self.centres[-1])
        stations = np.concatenate([[here_m], here_m + moved_m])
        rows["tick"] += after
        moved = np.diff(path.points_at(stations)[:, :2], axis=0).cumsum(axis=0)
        rows["x"], rows["y"] = (self.centres[-1] + moved).T
        yaw = np.unwrap(path.headings_at(stations, span_m=CHORD_M))
        rows["yaw"] += yaw[1:] - yaw[0]
        rows["travelled"] += moved_m
        return replace(self, rows=np.concatenate([self.rows, rows]))

    @property
    def centres(self) -> NDArray[np.float64]:
        """World positions (n, 2)."""
        return np.column_stack([self.rows["x"], self.rows["y"]])

    def is_level_with(self, other: "ActorTrack") -> NDArray[np.bool_]:
        """Return whether (n,) two tracks of equal length are at the same height."""
        return np.abs(self.rows["z"] - other.rows["z"]) < LEVEL_GAP_M

    @property
    def axes(self) -> NDArray[np.float64]:
        """Unit vectors (n, 2, 2) forward and to the left."""
        cosine, sine = np.cos(self.rows["yaw"]), np.sin(self.rows["yaw"])
        return np.stack([np.stack([cosine, sine], 1), np.stack([-sine, cosine], 1)], 1)

    @property
    def velocities(self) -> NDArray[np.float64]:
        """Velocities (n, 2) in m/s."""
        return np.column_stack([self.rows["vx"], self.rows["vy"]])

    @property
    def corners(self) -> NDArray[np.float64]:
        """Corners (n, 4, 2) of the outlines, front left first, clockwise."""
        offsets = np.einsum("kc,ncd->nkd", UNIT_BOX_CORNERS * self.size, self.axes)
        return self.centres[:, None] + offsets

    @property
    def boxes(self) -> Polygons:
        """Outlines (n,) on the ground."""
        return np.asarray(shapely.polygons(self.corners))


def measure_encounter(
    trace: Trace, first: int, second: int, *, within_m: float = np.inf
) -> Encounter | None:
    """Measure how two actors meet; None if they never do, or not within a distance.

    Raises:
        KeyError: The trace has no such actor.
    """
    own, other = ActorTrack.from_trace(trace, first), ActorTrack.from_trace(trace, second)
    ticks = np.intersect1d(own.rows["tick"], other.rows["tick"])
    if len(ticks) == 0:
        return None
    own_now, other_now = own.at_ticks(ticks), other.at_ticks(ticks)
    is_level = own_now.is_level_with(other_now)
    distances = np.where(is_level, shapely.distance(own_now.boxes, other_now.boxes), np.inf)
    if not is_level.any() or distances.min() > within_m:
        return None
    collision_s = np.where(is_level, compute_time_to_collision(own_now, other_now), np.inf)
    path_collision_s = compute_path_time_to_collision(own, other, ticks)
    return Encounter(
        first=first,
        second=second,
        distance_m=_find_minimum(distances, ticks),
        time_to_collision_s=_find_finite_minimum(collision_s, ticks),
        time_to_collision_on_way_s=_find_finite_minimum(path_collision_s, ticks),
        post_encroachment_s=_compute_post_encroachment(own, other, trace.tick_s),
    )


def compute_time_to_collision(own: ActorTrack, other: ActorTrack) -> NDArray[np.float64]:
    """Compute the seconds until the outlines of two tracks touch at their current velocities.

    Both have rows (n,) at the same ticks. The result (n,) is 0 while they touch, infinity if they
    never do.

    Two convex shapes touch once their projections on every axis of either touch (separating axis
    theorem). Along an axis the projections approach steadily, so each axis gives an interval of
    time, and the outlines touch in the common one.
    """
    gap = other.centres - own.centres
    closing = other.velocities - own.velocities
    begin, end = np.zeros(len(gap)), np.full(len(gap), np.inf)
    for axes in (own.axes, other.axes):
        for axis in (axes[:, 0], axes[:, 1]):
            extent = _project_half_extent(own, axis) + _project_half_extent(other, axis)
            enters, leaves = _compute_contact_interval(
                np.sum(gap * axis, axis=1), np.sum(closing * axis, axis=1), extent
            )
            begin, end = np.maximum(begin, enters), np.minimum(end, leaves)
    return np.where(begin <= end, begin, np.inf)


def _project_half_extent(track: ActorTrack, axis: NDArray[np.float64]) -> NDArray[np.float64]:
    """Project half the size of a track's outlines on axes (n, 2): half lengths (n,)."""
    return np.abs(np.einsum("nad,nd->na", track.axes, axis)) @ track.size / 2


def _compute_contact_interval(
    offset: NDArray[np.float64], speed: NDArray[np.float64], max_distance: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Compute when (n,), (n,) `offset + speed * t` enters and leaves `max_distance` around 0."""
    moves = np.abs(speed) > 1e-9
    pace = np.where(moves, np.abs(speed), 1.0)
    centre = -offset * np.sign(speed) / pace
    within = np.abs(offset) <= max_distance
    enters = np.where(moves, centre - max_distance / pace, np.where(within, -np.inf, np.inf))
    leaves = np.where(moves, centre + max_distance / pace, np.where(within, np.inf, -np.inf))
    return enters, leaves


def _compute_post_encroachment(
    own: ActorTrack, other: ActorTrack, tick_s: float
) -> MetricAtTick | None:
    other_row, own_row = shapely.STRtree(own.boxes).query(other.boxes, predicate="intersects")
    is_level = np.abs(own.rows["z"][own_row] - other.rows["z"][other_row]) < LEVEL_GAP_M
    other_row, own_row = other_row[is_level], own_row[is_level]
    if len(own_row) == 0:
        return None
    own_ticks, other_ticks = own.rows["tick"][own_row], other.rows["tick"][other_row]
    gaps = np.abs(own_ticks - other_ticks)
    least = int(np.argmin(gaps))
    tick = int(max(own_ticks[least], other_ticks[least]))
    return MetricAtTick(float(gaps[least] * tick_s), tick)


def compute_path_time_to_collision(
    own: ActorTrack, other: ActorTrack, ticks: NDArray[np.int32]
) -> NDArray[np.float64]:
    """Compute the seconds until two outlines touch on their paths at the speeds of each tick.

    `own` and `other` are whole tracks, both present at `ticks` (n,). The result (n,) is infinity
    beyond `PREDICTION_HORIZON_S`.
    """
    times = np.full(len(ticks), np.inf)
    near = _can_meet(own.at_ticks(ticks), other.at_ticks(ticks))
    ahead = np.arange(0, PREDICTION_HORIZON_S, PREDICTION_STEP_S)
    own_ahead, other_ahead = (track.extrapolate(ticks[near], ahead) for track in (own, other))
    meets = shapely.intersects(own_ahead.boxes, other_ahead.boxes)
    touch = (meets & own_ahead.is_level_with(other_ahead)).reshape(-1, len(ahead))
    times[near] = np.where(touch.any(axis=1), ahead[touch.argmax(axis=1)], np.inf)
    return times


def _can_meet(own: ActorTrack, other: ActorTrack) -> NDArray[np.bool_]:
    """Return whether (n,) two actors are near enough to meet in time on any paths."""
    gaps = np.linalg.norm(own.centres - other.centres, axis=1)
    radii = np.linalg.norm(own.size) / 2 + np.linalg.norm(other.size) / 2
    return gaps - radii <= PREDICTION_HORIZON_S * (own.rows["speed"] + other.rows["speed"])


def _find_finite_minimum(
    values: NDArray[np.float64], ticks: NDArray[np.int32]
) -> MetricAtTick | None:
    return _find_minimum(values, ticks) if np.isfinite(values).any() else None


def _find_minimum(values: NDArray[np.float64], ticks: NDArray[np.int32]) -> MetricAtTick:
    at = int(np.argmin(values))
    return MetricAtTick(float(values[at]), int(ticks[at]))


def find_overlaps(trace: Trace, *, min_area_m2: float = 0.0) -> Iterator[BoxOverlap]:
    """Find, tick by tick, pairs of actors whose outlines overlap by more than an area.

    A semi-trailer lies over its tractor unit: these two are no pair.
    """
    tracks = [ActorTrack.from_trace(trace, actor.id) for actor in trace.actors]
    if not tracks:
        return
    rows = np.concatenate([track.rows for track in tracks])
    boxes = np.concatenate([track.boxes for track in tracks])
    ids = np.array([actor.id for actor in trace.actors])[rows["actor"]]
    vehicles = np.array([actor.vehicle_id for actor in trace.actors])[rows["actor"]]
    for tick in range(len(trace)):
        now = np.flatnonzero(rows["tick"] == tick)
        for pair in shapely.STRtree(boxes[now]).query(boxes[now], "intersects").T:
            first, second = now[pair]
            # The tree finds each pair twice, and every box in itself.
            is_level = abs(rows["z"][first] - rows["z"][second]) < LEVEL_GAP_M
            if first < second and vehicles[first] != vehicles[second] and is_level:
                area = float(shapely.area(shapely.intersection(boxes[first], boxes[second])))
                if area > min_area_m2:
                    yield BoxOverlap(int(ids[first]), int(ids[second]), tick, area)
