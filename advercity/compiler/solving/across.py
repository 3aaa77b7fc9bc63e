"""Those who cross the ego's way, or leave it to the side, on a path of their own."""

import numpy as np
from advercity_dsl.road import StripKind

from advercity.compiler.solving.case import Case, Placed
from advercity.compiler.solving.drive import CROSSING_BEFORE_M
from advercity.compiler.solving.edges import outer_edge
from advercity.compiler.ways import Stretch

BESIDE_LANE_M = 0.8
"""Between the edge of the lanes and one who waits to cross."""
RUN_UP_M = {"pedestrian": 0.0, "bicycle": 6.0}
"""Farther back from there that somebody sets out."""
FIRST_PLACE, NEXT_PLACE = 0.55, 0.3
"""Of the ego's way, where it is crossed between junctions, and how much farther on next time."""
CLEAR_OF_JUNCTIONS_M = 8.0
STEPS_ASIDE = 0.35
"""How far one who leaves the ego's way walks on for each metre to the side."""


def across(case: Case) -> Placed:
    """From the near side or the far side, straight across."""
    nearside = case.conflict.actor.comes == "nearside"
    station = _crossed_m(case)
    stretch = case.drive.stretch(station)
    sign = -1.0 if nearside else 1.0
    wait = max(_waiting_m(case, stretch, right=nearside), case.drawn.get("start_lateral_m", 0.0))
    start = wait + RUN_UP_M.get(case.actor.actor_class, 0.0)
    beyond = _waiting_m(case, stretch, right=not nearside) + 1.0
    way = case.drive.way
    ends = [way.at(station, sign * start), way.at(station, -sign * beyond)]
    return Placed(station, start, path=np.array(ends))


def ahead(case: Case) -> Placed:
    """On the ego's way before it, then aside to where the lanes end soonest."""
    drive, station = case.drive, _crossed_m(case)
    stretch = drive.stretch(station)
    right = not any(
        band.kind is StripKind.LANE and band.number > stretch.lane
        for band in stretch.bands(right=True)
    )
    out = _waiting_m(case, stretch, right=right) * (-1 if right else 1)
    lead = case.speed_m_s * case.drawn["return_time_s"]
    walked = case.speed_m_s * (drive.pace.time(station) + 2.0)
    back = min(walked, station - drive.start_m + 20.0)
    aside = station - lead + STEPS_ASIDE * abs(out)
    stations = [station - back, station - lead, aside, station + 15.0]
    sides = [0.15 * out, 0.15 * out, out, out]
    points = [drive.way.at(s, side) for s, side in zip(stations, sides, strict=True)]
    return Placed(station, back, path=np.array(points))


def _waiting_m(case: Case, stretch: Stretch, *, right: bool) -> float:
    """Distance from the ego's way to where one waits: beside the lanes, on foot on a median."""
    rides = case.actor.actor_class == "bicycle"
    return abs(outer_edge(stretch, right=right, to_median=not rides)) + BESIDE_LANE_M


def _crossed_m(case: Case) -> float:
    """Station where the ego is crossed: on the exit crossing, or where somebody can park."""
    drive = case.drive
    if drive.road.junction == "intersection":
        after = drive.way.stretches[1]
        if case.conflict.parameters.obstruction_gap_m is None:
            return after.begins_m - CROSSING_BEFORE_M
        return (after.begins_m + min(after.ends_m, drive.end_m)) / 2
    wanted = drive.between(FIRST_PLACE + (case.index - 1) * NEXT_PLACE)
    parts = [
        (max(item.begins_m, drive.start_m) + min(item.ends_m, drive.end_m)) / 2
        for item in drive.way.stretches
    ]
    inside = any(
        item.begins_m + CLEAR_OF_JUNCTIONS_M < wanted < item.ends_m - CLEAR_OF_JUNCTIONS_M
        for item in drive.way.stretches
    )
    return wanted if inside else min(parts, key=lambda part: abs(part - wanted))
