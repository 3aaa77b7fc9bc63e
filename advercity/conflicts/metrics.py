"""How near actors come to each other: distance, time to collision, post-encroachment time."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from advercity.frames import Trace

UNIT_BOX_CORNERS = np.array([(1, 1), (1, -1), (-1, -1), (-1, 1)]) / 2
"""Of a box of length and width 1: front left, front right, rear right, rear left."""
PREDICTION_HORIZON_S = 6.0
"""How far ahead ways are compared."""
PREDICTION_STEP_S = 0.1

Polygons = NDArray[Any]
"""(n,) of shapely polygons."""


@dataclass(frozen=True)
class MetricAtTick:
    """A figure and the kept tick at which it was met."""

    value: float
    tick: int


@dataclass(frozen=True)
class Encounter:
    """How near two actors come to each other while both are there.

    Attributes:
        first: Id of an actor.
        second: Id of the other.
        distance_m: Least distance between their boxes, 0 if they touch.
        time_to_collision_s: Least time until their boxes would touch if both kept their velocity
            (Hayward, 1972); None if that never was to be.
        time_to_collision_on_way_s: The same if both kept their speed on the ways that they take:
            a bend brings nobody near who is oncoming in the other lane; None beyond
            `HORIZON_S`.
        post_encroachment_s: Least time between one leaving a place and the other coming there
            (Allen, Shin and Cooper, 1978); None if their ways share no place.
    """

    first: int
    second: int
    distance_m: MetricAtTick
    time_to_collision_s: MetricAtTick | None
    time_to_collision_on_way_s: MetricAtTick | None
    post_encroachment_s: MetricAtTick | None


@dataclass(frozen=True)
class BoxOverlap:
    """Two actors in one place."""

    first: int
    second: int
    tick: int
    area_m2: float


@dataclass(frozen=True)
class ActorTrack:
    """One actor's rows of a trace with its box on the ground.

    Attributes:
        actor: Id.
        size: Length and width in metres.
        rows: (n,) of `STATE`, a row per tick, sorted.
    """

    actor: int
    size: NDArray[np.float64]
    rows: NDArray[np.void]

    @staticmethod
    def from_trace(trace: Trace, actor_id: int) -> "ActorTrack":
        """The track of an actor; KeyError if the trace has none."""
        for index, actor in enumerate(trace.actors):
            if actor.id == actor_id:
                rows = trace.states[trace.states["actor"] == index]
                return ActorTrack(actor_id, np.array(actor.size[:2]), rows)
        raise KeyError(actor_id)

    def at_ticks(self, ticks: NDArray[np.int32]) -> "ActorTrack":
        """The same track at some of its ticks (m,)."""
        keep = np.searchsorted(self.rows["tick"], ticks)
        return ActorTrack(self.actor, self.size, self.rows[keep])

    def find_nearest_row(self, point_m: ArrayLike) -> int:
        """Find the row in which the actor's centre is nearest to a point (2,)."""
        return int(np.argmin(np.linalg.norm(self.centres - np.asarray(point_m), axis=1)))

    def find_nearest_tick(self, point_m: ArrayLike) -> float:
        """Find the tick at which the actor's centre is nearest to a point (2,)."""
        return float(self.rows["tick"][self.find_nearest_row(point_m)])

    def extrapolate(self, ticks: NDArray[np.int32], after_s: NDArray[np.float64]) -> "ActorTrack":
        """Where the actor comes to on its way at the speed it has.

        Beyond the last row it goes straight on.

        Args:
            ticks: (m,) some of the track's.
            after_s: (k,) seconds later.

        Returns:
            A track of (m * k,) rows, all times of a tick together.
        """
        rows = np.repeat(self.at_ticks(ticks).rows, len(after_s))
        rows["travelled"] += np.tile(after_s, len(ticks)) * rows["speed"]
        way = self.rows["travelled"]
        beyond = np.maximum(rows["travelled"] - way[-1], 0)
        for name in ("x", "y", "yaw"):
            rows[name] = np.interp(rows["travelled"], way, self.rows[name])
        rows["x"] += beyond * np.cos(rows["yaw"])
        rows["y"] += beyond * np.sin(rows["yaw"])
        return ActorTrack(self.actor, self.size, rows)

    @property
    def centres(self) -> NDArray[np.float64]:
        """(n, 2) world positions."""
        return np.column_stack([self.rows["x"], self.rows["y"]])

    @property
    def axes(self) -> NDArray[np.float64]:
        """(n, 2, 2): the unit vectors forward and to the left."""
        cosine, sine = np.cos(self.rows["yaw"]), np.sin(self.rows["yaw"])
        return np.stack([np.stack([cosine, sine], 1), np.stack([-sine, cosine], 1)], 1)

    @property
    def velocities(self) -> NDArray[np.float64]:
        """(n, 2) m/s, along the body."""
        return self.rows["speed"][:, None] * self.axes[:, 0]

    @property
    def corners(self) -> NDArray[np.float64]:
        """(n, 4, 2) of the boxes on the ground, front left first, clockwise."""
        offsets = np.einsum("kc,ncd->nkd", UNIT_BOX_CORNERS * self.size, self.axes)
        return self.centres[:, None] + offsets

    @property
    def boxes(self) -> Polygons:
        """(n,) boxes on the ground."""
        return np.asarray(shapely.polygons(self.corners))


def measure_encounter(
    trace: Trace, first: int, second: int, *, within_m: float = np.inf
) -> Encounter | None:
    """How two actors meet; None if they are never there together, or never within a distance.

    Raises:
        KeyError: The trace has no such actor.
    """
    one, other = ActorTrack.from_trace(trace, first), ActorTrack.from_trace(trace, second)
    ticks = np.intersect1d(one.rows["tick"], other.rows["tick"])
    if len(ticks) == 0:
        return None
    here, there = one.at_ticks(ticks), other.at_ticks(ticks)
    distances = shapely.distance(here.boxes, there.boxes)
    if distances.min() > within_m:
        return None
    return Encounter(
        first=first,
        second=second,
        distance_m=_find_minimum(distances, ticks),
        time_to_collision_s=_find_finite_minimum(compute_time_to_collision(here, there), ticks),
        time_to_collision_on_way_s=_find_finite_minimum(
            compute_path_time_to_collision(one, other, ticks), ticks
        ),
        post_encroachment_s=_compute_post_encroachment(one, other, trace.tick_s),
    )


def compute_time_to_collision(here: ActorTrack, there: ActorTrack) -> NDArray[np.float64]:
    """Seconds until the boxes of two tracks touch if both keep their velocities.

    Two convex shapes touch once their shadows on every axis of either touch; along an axis the
    shadows approach steadily, so each gives an interval of time and the boxes touch in the common
    one.

    Args:
        here: A track, (n,) ticks.
        there: Another at the same ticks.

    Returns:
        (n,): 0 while they touch, infinity if they never do.
    """
    gap = there.centres - here.centres
    closing = there.velocities - here.velocities
    begin, end = np.zeros(len(gap)), np.full(len(gap), np.inf)
    for axes in (here.axes, there.axes):
        for axis in (axes[:, 0], axes[:, 1]):
            reach = _project_half_extent(here, axis) + _project_half_extent(there, axis)
            enters, leaves = _compute_contact_interval(
                np.sum(gap * axis, axis=1), np.sum(closing * axis, axis=1), reach
            )
            begin, end = np.maximum(begin, enters), np.minimum(end, leaves)
    return np.where(begin <= end, begin, np.inf)


def _project_half_extent(track: ActorTrack, axis: NDArray[np.float64]) -> NDArray[np.float64]:
    """Half length (n,) of a track's boxes along axes (n, 2)."""
    return np.abs(np.einsum("nad,nd->na", track.axes, axis)) @ track.size / 2


def _compute_contact_interval(
    offset: NDArray[np.float64], speed: NDArray[np.float64], max_distance: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """When (n,), (n,) `offset + speed * t` comes within `reach` of 0, and when it is out again."""
    moves = np.abs(speed) > 1e-9
    pace = np.where(moves, np.abs(speed), 1.0)
    middle = -offset * np.sign(speed) / pace
    within = np.abs(offset) <= max_distance
    enters = np.where(moves, middle - max_distance / pace, np.where(within, -np.inf, np.inf))
    leaves = np.where(moves, middle + max_distance / pace, np.where(within, np.inf, -np.inf))
    return enters, leaves


def _compute_post_encroachment(
    one: ActorTrack, other: ActorTrack, tick_s: float
) -> MetricAtTick | None:
    here, there = shapely.STRtree(one.boxes).query(other.boxes, predicate="intersects")[::-1]
    if len(here) == 0:
        return None
    mine, theirs = one.rows["tick"][here], other.rows["tick"][there]
    gaps = np.abs(mine - theirs)
    least = int(np.argmin(gaps))
    return MetricAtTick(float(gaps[least] * tick_s), int(max(mine[least], theirs[least])))


def compute_path_time_to_collision(
    one: ActorTrack, other: ActorTrack, ticks: NDArray[np.int32]
) -> NDArray[np.float64]:
    """Seconds until two boxes touch on their ways at the speeds that they have.

    Args:
        one: A whole track.
        other: Another.
        ticks: (n,) at which both are there.

    Returns:
        (n,): infinity if they do not within `HORIZON_S`.
    """
    times = np.full(len(ticks), np.inf)
    near = _can_meet(one.at_ticks(ticks), other.at_ticks(ticks))
    ahead = np.arange(0, PREDICTION_HORIZON_S, PREDICTION_STEP_S)
    touch = shapely.intersects(
        one.extrapolate(ticks[near], ahead).boxes, other.extrapolate(ticks[near], ahead).boxes
    ).reshape(-1, len(ahead))
    times[near] = np.where(touch.any(axis=1), ahead[touch.argmax(axis=1)], np.inf)
    return times


def _can_meet(here: ActorTrack, there: ActorTrack) -> NDArray[np.bool_]:
    """Whether (n,) two are near enough to meet within `HORIZON_S` whatever their ways."""
    apart = np.linalg.norm(here.centres - there.centres, axis=1)
    reach = np.linalg.norm(here.size) / 2 + np.linalg.norm(there.size) / 2
    return apart - reach <= PREDICTION_HORIZON_S * (here.rows["speed"] + there.rows["speed"])


def _find_finite_minimum(
    values: NDArray[np.float64], ticks: NDArray[np.int32]
) -> MetricAtTick | None:
    return _find_minimum(values, ticks) if np.isfinite(values).any() else None


def _find_minimum(values: NDArray[np.float64], ticks: NDArray[np.int32]) -> MetricAtTick:
    at = int(np.argmin(values))
    return MetricAtTick(float(values[at]), int(ticks[at]))


def find_overlaps(trace: Trace, *, min_area_m2: float = 0.0) -> Iterator[BoxOverlap]:
    """Wherever the boxes of two actors share more than `least_m2` of the ground, tick by tick."""
    tracks = [ActorTrack.from_trace(trace, actor.id) for actor in trace.actors]
    if not tracks:
        return
    rows = np.concatenate([track.rows for track in tracks])
    boxes = np.concatenate([track.boxes for track in tracks])
    ids = np.array([actor.id for actor in trace.actors])
    for tick in range(len(trace)):
        now = np.flatnonzero(rows["tick"] == tick)
        for first, second in shapely.STRtree(boxes[now]).query(boxes[now], "intersects").T:
            a, b = now[first], now[second]
            if first < second:
                area = float(shapely.area(shapely.intersection(boxes[a], boxes[b])))
                if area > min_area_m2:
                    yield BoxOverlap(
                        int(ids[rows["actor"][a]]), int(ids[rows["actor"][b]]), tick, area
                    )
