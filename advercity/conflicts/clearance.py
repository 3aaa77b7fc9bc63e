"""Find actors that block a staged conflict, or that overlap another actor."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import shapely
from advercity_dsl import Spec
from numpy.typing import NDArray

from advercity.conflicts.metrics import ActorTrack, Polygons, find_overlaps
from advercity.frames import Trace

HELD_UP_SPEED_M_S = 1.0
"""Speed below which an actor counts as held up."""
HOLD_UP_RANGE_M = 40.0
"""Maximum distance of a relevant blocker from the conflict point."""
BLOCKED_LANE_CHANGE_GAP_M = 4.0
"""Distance within which an actor may keep the ego from a lane change."""
HOLD_UP_MARGIN_M = 1.5
"""Maximum distance of a blocker from the path ahead of a held-up actor."""
GIVEN_WAY_RANGE_M = 12.0
"""Distance within which a vehicle gives way to pedestrians near a crossing."""
MIN_CLEARANCE_M = 0.3
"""Minimum distance of background actors from a staged actor."""
MIN_HEADWAY_S = 0.8
"""Minimum headway behind a staged actor on its own path, which SUMO cannot see."""


@dataclass(frozen=True)
class Blockage:
    """Two actors, by id: one is in the path or in the place of the other."""

    blocker_id: int
    blocked_id: int


def find_blockages(spec: Spec, trace: Trace) -> Iterator[Blockage]:
    """Find actors too near to a staged actor, or in the same place as another."""
    participants = _list_participants(spec)
    colliding = {
        (spec.ego.number, conflict.actors[0].number)
        for conflict in spec.conflicts
        if conflict.resolved_by != "actor"
    }
    for overlap in find_overlaps(trace):
        if (overlap.first, overlap.second) in colliding:
            continue
        # The background actor is the blocker of a pair: only background can be drawn again.
        pair = (overlap.first, overlap.second)
        blocked, blocker = sorted(pair, key=lambda number: (number not in participants, number))
        yield Blockage(blocker, blocked)
    background = _select_background(spec, trace)
    present = {actor.id: actor for actor in trace.actors}
    for staged in (actor for conflict in spec.conflicts for actor in conflict.actors):
        if staged.number in present:
            track = ActorTrack.from_trace(trace, staged.number)
            for other in background:
                on_foot = present[other.actor].actor_class == "pedestrian"
                unseen = not staged.route and not on_foot
                if _is_too_near(track, other, MIN_HEADWAY_S if unseen else 0.0):
                    yield Blockage(other.actor, staged.number)


def find_first_contact(spec: Spec, trace: Trace) -> int | None:
    """Find the first tick at which the ego touches an actor that does not yield to it."""
    ego = ActorTrack.from_trace(trace, spec.ego.number)
    contacts: list[int] = []
    for conflict in spec.conflicts:
        if conflict.resolved_by != "actor":
            actor = ActorTrack.from_trace(trace, conflict.actors[0].number)
            ticks = np.intersect1d(ego.rows["tick"], actor.rows["tick"])
            touching = shapely.intersects(ego.at_ticks(ticks).boxes, actor.at_ticks(ticks).boxes)
            contacts += ticks[touching][:1].tolist()
    return min(contacts, default=None)


def find_blockers(spec: Spec, trace: Trace, number: int) -> Iterator[int]:
    """Find ids of background actors that keep an actor from conflict points, or delay it.

    If nothing is ahead of a waiting actor, it may give way to pedestrians.
    """
    track = ActorTrack.from_trace(trace, number)
    background = _select_background(spec, trace)
    on_foot = {actor.id for actor in trace.actors if actor.actor_class == "pedestrian"}
    walkers = [other for other in background if other.actor in on_foot]
    for conflict in spec.conflicts:
        rows, area = _find_hold_up_area(track, conflict.point_m)
        ticks = track.rows["tick"][rows]
        found = list(_find_inside(background, track.at_ticks(ticks), area))
        waits = rows[track.rows["speed"][rows] < HELD_UP_SPEED_M_S]
        nearby = shapely.union_all(track.boxes[waits]).buffer(GIVEN_WAY_RANGE_M)
        yield from found or _find_inside(walkers, track.at_ticks(ticks), nearby)


def _find_inside(
    others: Iterable[ActorTrack], held_up: ActorTrack, area: shapely.Geometry
) -> Iterator[int]:
    for other in others:
        present = np.intersect1d(other.rows["tick"], held_up.rows["tick"])
        found = other.at_ticks(present)
        is_level = found.is_level_with(held_up.at_ticks(present))
        if (shapely.intersects(found.boxes, area) & is_level).any():
            yield other.actor


def _list_participants(spec: Spec) -> set[int]:
    staged = {actor.number for conflict in spec.conflicts for actor in conflict.actors}
    return staged | {agent.number for agent in spec.agents}


def _select_background(spec: Spec, trace: Trace) -> list[ActorTrack]:
    participants = _list_participants(spec)
    return [
        ActorTrack.from_trace(trace, actor.id)
        for actor in trace.actors
        if actor.id not in participants
    ]


def _find_hold_up_area(
    track: ActorTrack, point: tuple[float, float]
) -> tuple[NDArray[np.intp], shapely.Geometry]:
    """Find rows (n,) at which an actor may be held up, and the area of possible blockers.

    The area is ahead of a waiting actor, or around an actor that missed a lane change.
    """
    gaps = np.linalg.norm(track.centres - point, axis=1)
    last = int(np.flatnonzero(gaps < gaps.min() + HOLD_UP_MARGIN_M)[-1])
    # If the actor is held up farther away, it never comes near the point.
    nearest_m = gaps.min() if gaps.min() > HOLD_UP_RANGE_M else 0.0
    approach = np.flatnonzero(gaps[:last] < nearest_m + HOLD_UP_RANGE_M)
    waits = approach[track.rows["speed"][approach] < HELD_UP_SPEED_M_S]
    if len(waits) > 0:
        # The actor may never reach the point: a line replaces its missing outlines.
        onward = shapely.LineString([track.centres[waits[0]], point])
        driven = track.boxes[waits[0] : last + 1]
        return waits, shapely.union_all([*driven, onward]).buffer(HOLD_UP_MARGIN_M)
    margin = BLOCKED_LANE_CHANGE_GAP_M if gaps.min() > HOLD_UP_MARGIN_M else 0.0
    return approach, shapely.union_all(track.boxes[approach]).buffer(margin)


def _is_too_near(track: ActorTrack, other: ActorTrack, headway_s: float) -> bool:
    """Return whether another actor comes too near; the headway extends its outline."""
    ticks = np.intersect1d(track.rows["tick"], other.rows["tick"])
    if len(ticks) == 0:
        return False
    own_now, other_now = track.at_ticks(ticks), other.at_ticks(ticks)
    # Circles first: outlines of all ticks for all pairs would take most of the time.
    radii = (np.linalg.norm(own_now.size) + np.linalg.norm(other_now.size)) / 2
    gaps = np.linalg.norm(own_now.centres - other_now.centres, axis=1)
    close = gaps <= radii + MIN_CLEARANCE_M + headway_s * other_now.rows["speed"]
    close &= own_now.is_level_with(other_now)
    if not close.any():
        return False
    own_boxes = own_now.at_ticks(ticks[close]).boxes
    other_boxes = _extend_by_headway(other_now.at_ticks(ticks[close]), headway_s)
    return bool((shapely.distance(own_boxes, other_boxes) < MIN_CLEARANCE_M).any())


def _extend_by_headway(track: ActorTrack, headway_s: float) -> Polygons:
    """Extend outlines (n,) by the ground covered within the headway."""
    ahead: NDArray[np.float64] = headway_s * track.rows["speed"]
    moved = track.rows.copy()
    moved["x"] += ahead * np.cos(moved["yaw"])
    moved["y"] += ahead * np.sin(moved["yaw"])
    return shapely.convex_hull(shapely.union(track.boxes, replace(track, rows=moved).boxes))
