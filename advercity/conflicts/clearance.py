"""Who is in the way of a staged conflict, and who is in anybody's."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import shapely
from advercity_dsl import Spec
from numpy.typing import NDArray

from advercity.conflicts.metrics import ActorTrack, Polygons, find_overlaps
from advercity.frames import Trace

HELD_UP_SPEED_M_S = 1.0
"""An ego that drives slower than this is held up."""
HOLD_UP_RANGE_M = 40.0
"""It is kept from the point within this distance."""
BLOCKED_LANE_CHANGE_GAP_M = 4.0
"""Whoever is nearer than this may keep an ego in its lane that should have changed it."""
HOLD_UP_MARGIN_M = 1.5
"""Whoever is nearer than this to where a held ego drives next may be who holds it."""
MIN_CLEARANCE_M = 0.3
"""Between a staged actor and anybody but the ego."""
MIN_HEADWAY_S = 0.8
"""Nobody drives up to a staged actor nearer than this: SUMO does not know of all of them."""


@dataclass(frozen=True)
class Blockage:
    """Somebody in the way of somebody else; both are ids of actors."""

    blocker_id: int
    blocked_id: int


def find_blockages(spec: Spec, trace: Trace) -> Iterator[Blockage]:
    """Those too near to a staged actor, or in the same place as somebody else."""
    staged = {actor.number: actor for conflict in spec.conflicts for actor in conflict.actors}
    spared = {agent.number for agent in spec.agents} | set(staged)
    for found in find_overlaps(trace):
        of, who = sorted((found.first, found.second), key=lambda one: (one not in spared, one))
        yield Blockage(who, of)
    others = [
        ActorTrack.from_trace(trace, actor.id) for actor in trace.actors if actor.id not in spared
    ]
    on_foot = {actor.id for actor in trace.actors if actor.actor_class == "pedestrian"}
    for number, actor in staged.items():
        if number in {item.id for item in trace.actors}:
            track = ActorTrack.from_trace(trace, number)
            for other in others:
                drives = not actor.route and other.actor not in on_foot
                if _is_too_near(track, other, MIN_HEADWAY_S if drives else 0.0):
                    yield Blockage(other.actor, number)


def find_ego_blockers(spec: Spec, trace: Trace) -> Iterator[int]:
    """Ids of those who keep the ego from being where and when it is to meet somebody staged."""
    ego = ActorTrack.from_trace(trace, spec.ego.number)
    spared = {agent.number for agent in spec.agents}
    spared |= {actor.number for conflict in spec.conflicts for actor in conflict.actors}
    others = [
        ActorTrack.from_trace(trace, actor.id) for actor in trace.actors if actor.id not in spared
    ]
    for conflict in spec.conflicts:
        at, area = _find_hold_up_area(ego, conflict.point_m)
        for other in others:
            ticks = np.intersect1d(other.rows["tick"], ego.rows["tick"][at])
            if shapely.intersects(other.at_ticks(ticks).boxes, area).any():
                yield other.actor


def _find_hold_up_area(
    ego: ActorTrack, point: tuple[float, float]
) -> tuple[NDArray[np.intp], shapely.Geometry]:
    """Rows (n,) at which somebody may keep the ego from a point, and where those then are.

    They are before it while it waits, or beside it where it should have changed lanes.
    """
    apart = np.linalg.norm(ego.centres - point, axis=1)
    meets = int(np.flatnonzero(apart < apart.min() + HOLD_UP_MARGIN_M)[-1])
    comes = np.flatnonzero(apart[:meets] < HOLD_UP_RANGE_M)
    waits = comes[ego.rows["speed"][comes] < HELD_UP_SPEED_M_S]
    if len(waits) > 0:
        onward = shapely.LineString([ego.centres[waits[0]], point])
        driven = ego.boxes[waits[0] : meets + 1]
        return waits, shapely.union_all([*driven, onward]).buffer(HOLD_UP_MARGIN_M)
    reach = BLOCKED_LANE_CHANGE_GAP_M if apart.min() > HOLD_UP_MARGIN_M else 0.0
    return comes, shapely.union_all(ego.boxes[comes]).buffer(reach)


def _is_too_near(track: ActorTrack, other: ActorTrack, headway_s: float) -> bool:
    """Whether another comes too near; a vehicle is as long as it drives within the headway."""
    ticks = np.intersect1d(track.rows["tick"], other.rows["tick"])
    if len(ticks) == 0:
        return False
    here, there = track.at_ticks(ticks), other.at_ticks(ticks)
    reach = (np.linalg.norm(here.size) + np.linalg.norm(there.size)) / 2 + MIN_CLEARANCE_M
    apart = np.linalg.norm(here.centres - there.centres, axis=1)
    close = apart <= reach + headway_s * there.rows["speed"]
    if not close.any():
        return False
    boxes = _extend_by_headway(there.at_ticks(ticks[close]), headway_s)
    return bool(
        (shapely.distance(here.at_ticks(ticks[close]).boxes, boxes) < MIN_CLEARANCE_M).any()
    )


def _extend_by_headway(track: ActorTrack, headway_s: float) -> Polygons:
    """Boxes (n,), each with the ground ahead that is driven over within the headway."""
    ahead: NDArray[np.float64] = headway_s * track.rows["speed"]
    moved = track.rows.copy()
    moved["x"] += ahead * np.cos(moved["yaw"])
    moved["y"] += ahead * np.sin(moved["yaw"])
    return shapely.convex_hull(shapely.union(track.boxes, replace(track, rows=moved).boxes))
