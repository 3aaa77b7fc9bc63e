"""Where lanes and roadway end beside a way, as offsets to the left of the lane's centre.

Those who cross the ego's way, or leave it to the side, on a path of their own.

Those who come towards the ego in the lane beside its own.

One who overtakes a cyclist in the ego's lane and comes back just before meeting the ego.

Those who come through the junction that the ego passes: in lanes, or along the right edge.

Where the actor comes from, and where it meets the ego.
"""

import numpy as np
from advercity_dsl.road import Movement, StripKind
from advercity_dsl.units import KM_H_PER_M_S
from numpy.typing import NDArray

from advercity.conflicts.case import ActorPlacement, ConflictCase, UnsolvableError
from advercity.conflicts.ego_motion import CROSSING_OFFSET_M, EgoDrive
from advercity.roads.routes import RoutePath, RouteSegment


def compute_lane_edge_offset(
    stretch: RouteSegment, *, right: bool, to_median: bool = True
) -> float:
    """Offset, in metres, of the outer edge of the lanes on a side.

    Args:
        stretch: The street.
        right: On which side.
        to_median: Whether to the left a median counts as the edge.
    """
    own = stretch.strips_on_side(right=True)
    if right:
        return stretch.lateral_offset([b for b in own if b.kind is StripKind.LANE][-1].outer_t)
    if to_median and any(band.kind is StripKind.MEDIAN for band in own):
        return stretch.lateral_offset(next(b for b in own if b.kind is StripKind.LANE).inner_t)
    other = [b for b in stretch.strips_on_side(right=False) if b.kind is StripKind.LANE]
    return stretch.lateral_offset(other[-1].outer_t) if other else stretch.lateral_offset(0.0)


def compute_riding_offset(stretch: RouteSegment) -> float:
    """Offset, in metres, of where one rides at the right edge.

    In the middle of the shoulder or parking lane, else just beside the lanes.
    """
    bands = stretch.strips_on_side(right=True)
    last = max(index for index, band in enumerate(bands) if band.kind is StripKind.LANE)
    beside = bands[last + 1] if last + 1 < len(bands) else None
    if beside and beside.kind in (StripKind.SHOULDER, StripKind.PARKING) and beside.width_m > 1:
        return stretch.lateral_offset(beside.centre_t)
    return stretch.lateral_offset(bands[last].outer_t) - 0.25


WAITING_GAP_M = 0.8
"""Between the edge of the lanes and one who waits to cross."""
RUN_UP_M = {"pedestrian": 0.0, "bicycle": 6.0}
"""Farther back from there that somebody sets out."""
FIRST_CROSSING_FRACTION, NEXT_CROSSING_FRACTION = 0.55, 0.3
"""Of the ego's way, where it is crossed between junctions, and how much farther on next time."""
CLEAR_OF_JUNCTIONS_M = 8.0
ASIDE_RATIO = 0.35
"""How far one who leaves the ego's way walks on for each metre to the side."""


def place_across(case: ConflictCase) -> ActorPlacement:
    """From the near side or the far side, straight across."""
    nearside = case.conflict.actor.comes == "nearside"
    station = _find_crossed_station(case)
    stretch = case.drive.segment_at(station)
    sign = -1.0 if nearside else 1.0
    wait = max(
        _compute_waiting_offset_m(case, stretch, right=nearside),
        case.parameters.get("start_lateral_m", 0.0),
    )
    start = wait + RUN_UP_M.get(case.actor.actor_class, 0.0)
    beyond = _compute_waiting_offset_m(case, stretch, right=not nearside) + 1.0
    way = case.drive.path
    ends = [way.point_at(station, sign * start), way.point_at(station, -sign * beyond)]
    return ActorPlacement(station, start, path=np.array(ends))


def place_ahead(case: ConflictCase) -> ActorPlacement:
    """On the ego's way before it, then aside to where the lanes end soonest."""
    drive, station = case.drive, _find_crossed_station(case)
    stretch = drive.segment_at(station)
    right = not any(
        band.kind is StripKind.LANE and band.lane_number > stretch.lane
        for band in stretch.strips_on_side(right=True)
    )
    out = _compute_waiting_offset_m(case, stretch, right=right) * (-1 if right else 1)
    lead = case.speed_m_s * case.parameters["return_time_s"]
    walked = case.speed_m_s * (drive.motion.time_at(station) + 2.0)
    back = min(walked, station - drive.start_m + 20.0)
    aside = station - lead + ASIDE_RATIO * abs(out)
    stations = [station - back, station - lead, aside, station + 15.0]
    sides = [0.15 * out, 0.15 * out, out, out]
    points = [drive.path.point_at(s, side) for s, side in zip(stations, sides, strict=True)]
    return ActorPlacement(station, back, path=np.array(points))


def _compute_waiting_offset_m(case: ConflictCase, stretch: RouteSegment, *, right: bool) -> float:
    """Distance from the ego's way to where one waits: beside the lanes, on foot on a median."""
    rides = case.actor.actor_class == "bicycle"
    return abs(compute_lane_edge_offset(stretch, right=right, to_median=not rides)) + WAITING_GAP_M


def _find_crossed_station(case: ConflictCase) -> float:
    """Station where the ego is crossed: on the exit crossing, or where somebody can park."""
    drive = case.drive
    if drive.road.junction == "intersection":
        after = drive.path.segments[1]
        if case.conflict.parameters.obstruction_gap_m is None:
            return after.start_m - CROSSING_OFFSET_M
        return (after.start_m + min(after.end_m, drive.end_m)) / 2
    wanted = drive.station_at_fraction(
        FIRST_CROSSING_FRACTION + (case.index - 1) * NEXT_CROSSING_FRACTION
    )
    parts = [
        (max(item.start_m, drive.start_m) + min(item.end_m, drive.end_m)) / 2
        for item in drive.path.segments
    ]
    inside = any(
        item.start_m + CLEAR_OF_JUNCTIONS_M < wanted < item.end_m - CLEAR_OF_JUNCTIONS_M
        for item in drive.path.segments
    )
    return wanted if inside else min(parts, key=lambda part: abs(part - wanted))


WAITING_MARGIN_S = 1.5
"""An oncoming actor starts so near that it can wait this long, to be in time."""
EARLIEST_MEETING_S = 8.8
"""The ego meets nobody sooner; what leads to it is not lost in the warm-up."""
MEETING_FRACTIONS = (0.25, 0.62)
"""Shares of the ego's way between which it meets somebody oncoming."""
STREET_END_MARGIN_M = 8.0
"""Nobody starts nearer to either end of a street."""


def place_opposite(case: ConflictCase, station_m: float) -> ActorPlacement:
    """From ahead in the other lane, so far off that both are at a station at once."""
    speed, gains = case.speed_m_s, case.parameters["acceleration_m_s2"]
    run = speed * (case.drive.motion.time_at(station_m) - speed / (2 * gains) - WAITING_MARGIN_S)
    return place_oncoming(case.drive, station_m, run)


def place_oncoming(drive: EgoDrive, station_m: float, run_m: float) -> ActorPlacement:
    """Against the ego in its lane, so far before a place on the ego's way."""
    route = tuple(reversed(drive.route))
    route = (*route, *_find_next_street(drive, route[-1]))
    back = drive.planner.build_path(route)
    meets = back.find_nearest_station(drive.path.point_at(station_m))
    start = max(meets - run_m, STREET_END_MARGIN_M)
    index, stretch = next(
        (number, item)
        for number, item in enumerate(back.segments)
        if start < item.end_m - STREET_END_MARGIN_M
    )
    start = max(start, stretch.start_m + STREET_END_MARGIN_M)
    before_end = stretch.end_m - start
    return ActorPlacement(station_m, meets - start, route=route[index:], start_m=before_end)


def find_straightest_station(drive: EgoDrive) -> float:
    """Station near the middle of the ego's way where the actor comes towards it straight.

    On a bend nobody could tell a drift from its velocity alone.
    """
    places = drive.start_m + np.linspace(*MEETING_FRACTIONS, 41) * (drive.end_m - drive.start_m)
    stations = [at for at in places.tolist() if drive.motion.time_at(at) >= EARLIEST_MEETING_S]
    turns = [
        np.ptp(np.unwrap([drive.path.heading_at(s) for s in np.arange(at - 5.0, at + 32.0, 4.0)]))
        for at in stations
    ]
    return stations[int(np.argmin(np.round(turns, 2)))]


def _find_next_street(drive: EgoDrive, street: str) -> tuple[str, ...]:
    """The street that the ego's first one is driven to, against the ego; none at the edge."""
    along = drive.planner.is_along_axis(drive.route, 0)
    layout = drive.planner.streets[street]
    junction = layout.begins if along else layout.ends
    options = [
        item for item in drive.planner.movements.get(junction, ()) if item.from_street == street
    ]
    straightest = sorted(options, key=lambda item: abs(drive.planner.turn_angle(item, junction)))
    return tuple(item.to_street for item in straightest[:1])


CYCLIST_WAITING_MARGIN_S = 1.0
"""The cyclist starts so near that it can wait this long, to be in time."""
OVERTAKING_RETURN_MARGIN_S = 0.15
"""The actor is back in its lane this long before it is beside the ego."""
CYCLIST_LIMITS_M_S2 = (1.0, 2.0)
"""With which a cyclist sets out and brakes."""


def find_earliest_overtaking_station(case: ConflictCase) -> float:
    """The first station of the ego where one who overtakes can have done so."""
    sets_out_s = case.speed_m_s / case.parameters["acceleration_m_s2"]
    beside_s = _compute_passing_s(case)
    after_s = (
        WAITING_MARGIN_S
        + sets_out_s
        + case.parameters["drift_time_s"]
        + beside_s
        + _compute_return_s(case)
    )
    return case.drive.motion.station_at(after_s)


def place_passed_cyclist(case: ConflictCase, station_m: float) -> ActorPlacement:
    """The cyclist whom the actor passes as it begins to come back into its lane.

    Args:
        case: The conflict.
        station_m: Where the actor meets the ego.
    """
    pace = cyclist_speed_m_s(case)
    back_s = _compute_return_s(case)
    before = (
        case.speed_m_s * back_s + (case.actor.length_m + case.sampler.draw_cyclist().length_m) / 2
    )
    before += case.parameters["passing_gap_m"]
    rides_s = case.drive.motion.time_at(station_m) - back_s - CYCLIST_WAITING_MARGIN_S
    rode = pace * (rides_s - pace / (2 * CYCLIST_LIMITS_M_S2[0]))
    return place_oncoming(case.drive, station_m, before + rode)


def cyclist_speed_m_s(case: ConflictCase) -> float:
    """Of the cyclist."""
    return case.parameters["passed_speed_km_h"] / KM_H_PER_M_S


def _compute_return_s(case: ConflictCase) -> float:
    """From when it begins to come back to when it is beside the ego."""
    return case.parameters["return_time_s"] + OVERTAKING_RETURN_MARGIN_S


def _compute_passing_s(case: ConflictCase) -> float:
    """How long it drives beside its lane."""
    lengths = case.actor.length_m + case.sampler.draw_cyclist().length_m
    closing = (
        case.parameters["actor_speed_km_h"] - case.parameters["passed_speed_km_h"]
    ) / KM_H_PER_M_S
    if closing <= 0:
        raise UnsolvableError("whom it overtakes is not slower")
    return (lengths + 2 * case.parameters["passing_gap_m"]) / closing


STOP_LINE_GAP_M = 1.0
"""Between a waiting vehicle and the stop line."""
ALONG_EDGE_M = 26.0
"""Ridden along the edge before the junction, and after it."""
ALONGSIDE_EXTRA_GAP_M = 0.3
"""One who rides beside the ego keeps this much more to the right than others."""
BEARINGS = {"from_left": -np.pi / 2, "from_right": np.pi / 2, "alongside": 0.0}
"""Heading towards the junction less that of the ego, radians; all others come from ahead."""
APPROACH_TOLERANCE_RAD = np.pi / 4
"""Of such a bearing, radians."""
STRAIGHT_TOLERANCE_RAD = np.pi / 5
"""A movement that turns by less, in radians, goes straight on."""


def place_in_lane(case: ConflictCase) -> ActorPlacement:
    """Straight through, or to the left where the actor turns, from the stop line."""
    junction = _find_ego_junction(case.drive)
    movement = _find_straight_movements(case, junction)[0]
    if case.conflict.actor.comes == "oncoming_turning":
        movement = _find_left_turn(case.drive, junction, movement.from_street)
    route = (movement.from_street, movement.to_street)
    way = case.drive.planner.build_path(route, movement.from_lane)
    station = _find_meeting_station(case.drive, way)
    line = way.segments[0].end_m
    start = STOP_LINE_GAP_M + case.actor.length_m / 2
    room = way.find_nearest_station(case.drive.path.point_at(station)) - (line - start)
    return ActorPlacement(station, room, route=route, lane=movement.from_lane, start_m=start)


def place_along_edge(case: ConflictCase) -> ActorPlacement:
    """Straight through along the right edge, beside the ego or towards it."""
    aside = ALONGSIDE_EXTRA_GAP_M if case.conflict.actor.comes == "alongside" else 0.0
    path = _build_edge_path(
        case.drive, _find_straight_movements(case, _find_ego_junction(case.drive))[-1], aside
    )
    way = RoutePath(path, ())
    station = _find_meeting_station(case.drive, way)
    return ActorPlacement(
        station, way.find_nearest_station(case.drive.path.point_at(station)), path=path
    )


def _find_ego_junction(drive: EgoDrive) -> str:
    """The one that the ego passes."""
    route = drive.route
    junction = drive.planner.find_junction(route[0], route[1]) if len(route) > 1 else None
    if junction is None:
        raise UnsolvableError("the ego passes no junction there")
    return junction


def _find_straight_movements(case: ConflictCase, junction: str) -> tuple[Movement, ...]:
    """Movements straight on by those who come from where the actor does, innermost lane first."""
    ways, comes = case.drive.planner, case.conflict.actor.comes
    bearing = ways.approach_heading(case.drive.route[0], junction) + BEARINGS.get(comes, np.pi)
    found = [
        item
        for item in ways.movements[junction]
        if abs(_wrap_angle(ways.approach_heading(item.from_street, junction) - bearing))
        < APPROACH_TOLERANCE_RAD
        and abs(ways.turn_angle(item, junction)) < STRAIGHT_TOLERANCE_RAD
    ]
    if not found:
        raise UnsolvableError(f"nobody comes {comes} at '{junction}'")
    return tuple(sorted(found, key=lambda item: item.from_lane))


def _find_left_turn(drive: EgoDrive, junction: str, street: str) -> Movement:
    return next(
        item
        for item in drive.planner.movements[junction]
        if item.from_street == street
        and drive.planner.turn_angle(item, junction) > STRAIGHT_TOLERANCE_RAD
    )


def _build_edge_path(drive: EgoDrive, movement: Movement, aside_m: float) -> NDArray[np.float64]:
    """Points (4, 2) along the right edge of the roadway, straight through the junction."""
    way = drive.planner.build_path((movement.from_street, movement.to_street), movement.from_lane)
    before, after = way.segments
    run = min(ALONG_EDGE_M, before.end_m - before.start_m - 3.0)
    far = min(ALONG_EDGE_M, after.end_m - after.start_m - 3.0)
    places = [(before.end_m - run, before), (before.end_m, before)]
    places += [(after.start_m, after), (after.start_m + far, after)]
    return np.array(
        [way.point_at(station, compute_riding_offset(item) - aside_m) for station, item in places]
    )


def _find_meeting_station(drive: EgoDrive, way: RoutePath) -> float:
    """Station of the ego where a way crosses its own."""
    station = drive.path.find_crossing_station(way)
    if station is None:
        raise UnsolvableError("the ways of ego and actor do not meet")
    return station


def _wrap_angle(angle: float) -> float:
    """An angle in (-pi, pi], radians."""
    return float(np.pi - (np.pi - angle) % (2 * np.pi))


def place_actor(case: ConflictCase) -> ActorPlacement:
    """The actor's way.

    Raises:
        UnsolvableError: There is none on this road.
    """
    match case.conflict.actor.comes:
        case "nearside" | "farside":
            return place_across(case)
        case "ahead":
            return place_ahead(case)
        case "opposite_lane" if case.conflict.actor.behaviour == "overtakes":
            return place_opposite(case, find_earliest_overtaking_station(case))
        case "opposite_lane":
            return place_opposite(case, find_straightest_station(case.drive))
        case "alongside":
            return place_along_edge(case)
        case "oncoming" if case.actor.actor_class == "bicycle":
            return place_along_edge(case)
        case _:
            return place_in_lane(case)
