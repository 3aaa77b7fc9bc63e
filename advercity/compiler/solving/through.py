"""Those who come through the junction that the ego passes: in lanes, or along the right edge."""

import numpy as np
from advercity_dsl.road import Movement
from numpy.typing import NDArray

from advercity.compiler.solving.case import Case, Placed
from advercity.compiler.solving.drive import EgoDrive
from advercity.compiler.solving.edges import riding_line
from advercity.compiler.solving.errors import UnsolvableError
from advercity.compiler.ways import Way

BEFORE_LINE_M = 1.0
"""Between a waiting vehicle and the stop line."""
ALONG_EDGE_M = 26.0
"""Ridden along the edge before the junction, and after it."""
BESIDE_EGO_M = 0.3
"""One who rides beside the ego keeps this much more to the right than others."""
BEARINGS = {"from_left": -np.pi / 2, "from_right": np.pi / 2, "alongside": 0.0}
"""Heading towards the junction less that of the ego, radians; all others come from ahead."""
COMES_WITHIN = np.pi / 4
"""Of such a bearing, radians."""
STRAIGHT_WITHIN = np.pi / 5
"""A movement that turns by less, in radians, goes straight on."""


def in_lane(case: Case) -> Placed:
    """Straight through, or to the left where the actor turns, from the stop line."""
    junction = _junction(case.drive)
    movement = _straight(case, junction)[0]
    if case.conflict.actor.comes == "oncoming_turning":
        movement = _to_the_left(case.drive, junction, movement.from_street)
    route = (movement.from_street, movement.to_street)
    way = case.drive.ways.route(route, movement.from_lane)
    station = _meeting_m(case.drive, way)
    line = way.stretches[0].ends_m
    start = BEFORE_LINE_M + case.actor.length_m / 2
    room = way.nearest(case.drive.way.at(station)) - (line - start)
    return Placed(station, room, route=route, lane=movement.from_lane, start_m=start)


def along_edge(case: Case) -> Placed:
    """Straight through along the right edge, beside the ego or towards it."""
    aside = BESIDE_EGO_M if case.conflict.actor.comes == "alongside" else 0.0
    path = _edge_path(case.drive, _straight(case, _junction(case.drive))[-1], aside)
    way = Way(path, ())
    station = _meeting_m(case.drive, way)
    return Placed(station, way.nearest(case.drive.way.at(station)), path=path)


def _junction(drive: EgoDrive) -> str:
    """The one that the ego passes."""
    route = drive.route
    junction = drive.ways.junction_between(route[0], route[1]) if len(route) > 1 else None
    if junction is None:
        raise UnsolvableError("the ego passes no junction there")
    return junction


def _straight(case: Case, junction: str) -> tuple[Movement, ...]:
    """Movements straight on by those who come from where the actor does, innermost lane first."""
    ways, comes = case.drive.ways, case.conflict.actor.comes
    bearing = ways.inbound(case.drive.route[0], junction) + BEARINGS.get(comes, np.pi)
    found = [
        item
        for item in ways.movements[junction]
        if abs(_wrapped(ways.inbound(item.from_street, junction) - bearing)) < COMES_WITHIN
        and abs(ways.turn(item, junction)) < STRAIGHT_WITHIN
    ]
    if not found:
        raise UnsolvableError(f"nobody comes {comes} at '{junction}'")
    return tuple(sorted(found, key=lambda item: item.from_lane))


def _to_the_left(drive: EgoDrive, junction: str, street: str) -> Movement:
    return next(
        item
        for item in drive.ways.movements[junction]
        if item.from_street == street and drive.ways.turn(item, junction) > STRAIGHT_WITHIN
    )


def _edge_path(drive: EgoDrive, movement: Movement, aside_m: float) -> NDArray[np.float64]:
    """Points (4, 2) along the right edge of the roadway, straight through the junction."""
    way = drive.ways.route((movement.from_street, movement.to_street), movement.from_lane)
    before, after = way.stretches
    run = min(ALONG_EDGE_M, before.ends_m - before.begins_m - 3.0)
    far = min(ALONG_EDGE_M, after.ends_m - after.begins_m - 3.0)
    places = [(before.ends_m - run, before), (before.ends_m, before)]
    places += [(after.begins_m, after), (after.begins_m + far, after)]
    return np.array([way.at(station, riding_line(item) - aside_m) for station, item in places])


def _meeting_m(drive: EgoDrive, way: Way) -> float:
    """Station of the ego where a way crosses its own."""
    station = drive.way.crossing(way)
    if station is None:
        raise UnsolvableError("the ways of ego and actor do not meet")
    return station


def _wrapped(angle: float) -> float:
    """An angle in (-pi, pi], radians."""
    return float(np.pi - (np.pi - angle) % (2 * np.pi))
