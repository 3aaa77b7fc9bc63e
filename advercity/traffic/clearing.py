"""Who is in the way of a staged conflict, and who is in anybody's."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import shapely
from advercity_dsl import Spec
from numpy.typing import NDArray

from advercity.traffic.encounters import Polygons, Track, overlaps
from advercity.traffic.trace import Trace

HELD_M_S = 1.0
"""An ego that drives slower than this is held up."""
BEFORE_POINT_M = 40.0
"""It is kept from the point within this distance."""
BESIDE_M = 4.0
"""Whoever is nearer than this may keep an ego in its lane that should have changed it."""
AHEAD_M = 1.5
"""Whoever is nearer than this to where a held ego drives next may be who holds it."""
APART_M = 0.3
"""Between a staged actor and anybody but the ego."""
HEADWAY_S = 0.8
"""Nobody drives up to a staged actor nearer than this: SUMO does not know of all of them."""


@dataclass(frozen=True)
class Block:
    """Somebody in the way of somebody else; both are ids of actors."""

    who: int
    of: int


def in_the_way(spec: Spec, trace: Trace) -> Iterator[Block]:
    """Those too near to a staged actor, or in the same place as somebody else."""
    staged = {actor.number: actor for conflict in spec.conflicts for actor in conflict.actors}
    spared = {agent.number for agent in spec.agents} | set(staged)
    for found in overlaps(trace):
        of, who = sorted((found.first, found.second), key=lambda one: (one not in spared, one))
        yield Block(who, of)
    others = [Track.of(trace, actor.id) for actor in trace.actors if actor.id not in spared]
    on_foot = {actor.id for actor in trace.actors if actor.actor_class == "pedestrian"}
    for number, actor in staged.items():
        if number in {item.id for item in trace.actors}:
            track = Track.of(trace, number)
            for other in others:
                drives = not actor.route and other.actor not in on_foot
                if _is_near(track, other, HEADWAY_S if drives else 0.0):
                    yield Block(other.actor, number)


def holding_up(spec: Spec, trace: Trace) -> Iterator[int]:
    """Ids of those who keep the ego from being where and when it is to meet somebody staged."""
    ego = Track.of(trace, spec.ego.number)
    spared = {agent.number for agent in spec.agents}
    spared |= {actor.number for conflict in spec.conflicts for actor in conflict.actors}
    others = [Track.of(trace, actor.id) for actor in trace.actors if actor.id not in spared]
    for conflict in spec.conflicts:
        at, area = _kept_away(ego, conflict.point_m)
        for other in others:
            ticks = np.intersect1d(other.rows["tick"], ego.rows["tick"][at])
            if shapely.intersects(other.at(ticks).boxes, area).any():
                yield other.actor


def _kept_away(ego: Track, point: tuple[float, float]) -> tuple[NDArray[np.intp], shapely.Geometry]:
    """Rows (n,) at which somebody may keep the ego from a point, and where those then are.

    They are before it while it waits, or beside it where it should have changed lanes.
    """
    apart = np.linalg.norm(ego.middles - point, axis=1)
    meets = int(np.flatnonzero(apart < apart.min() + AHEAD_M)[-1])
    comes = np.flatnonzero(apart[:meets] < BEFORE_POINT_M)
    waits = comes[ego.rows["speed"][comes] < HELD_M_S]
    if len(waits) > 0:
        onward = shapely.LineString([ego.middles[waits[0]], point])
        driven = ego.boxes[waits[0] : meets + 1]
        return waits, shapely.union_all([*driven, onward]).buffer(AHEAD_M)
    reach = BESIDE_M if apart.min() > AHEAD_M else 0.0
    return comes, shapely.union_all(ego.boxes[comes]).buffer(reach)


def _is_near(track: Track, other: Track, headway_s: float) -> bool:
    """Whether another comes too near; a vehicle is as long as it drives within the headway."""
    ticks = np.intersect1d(track.rows["tick"], other.rows["tick"])
    if len(ticks) == 0:
        return False
    here, there = track.at(ticks), other.at(ticks)
    reach = (np.linalg.norm(here.size) + np.linalg.norm(there.size)) / 2 + APART_M
    apart = np.linalg.norm(here.middles - there.middles, axis=1)
    close = apart <= reach + headway_s * there.rows["speed"]
    if not close.any():
        return False
    boxes = _grown(there.at(ticks[close]), headway_s)
    return bool((shapely.distance(here.at(ticks[close]).boxes, boxes) < APART_M).any())


def _grown(track: Track, headway_s: float) -> Polygons:
    """Boxes (n,), each with the ground ahead that is driven over within the headway."""
    ahead: NDArray[np.float64] = headway_s * track.rows["speed"]
    moved = track.rows.copy()
    moved["x"] += ahead * np.cos(moved["yaw"])
    moved["y"] += ahead * np.sin(moved["yaw"])
    return shapely.convex_hull(shapely.union(track.boxes, replace(track, rows=moved).boxes))
