"""Place the actor of a conflict: its start, its path, and where the path meets the ego's.

One function per kind of approach: across the road, ahead of the ego, in a lane through the
junction, and along the right edge. `opposite_lane` holds the approaches in the opposite lane.
Stations are metres on the ego's path; offsets are metres to the left of its lane's centre.
"""

from dataclasses import replace

import numpy as np
from advercity_dsl.distribution import compute_bounds
from advercity_dsl.road import Movement, StripKind
from advercity_dsl.units import KM_H_PER_M_S
from numpy.typing import NDArray

from advercity.conflicts.case import ActorPlacement, ConflictCase, UnsolvableError
from advercity.conflicts.ego_motion import CROSSING_OFFSET_M, EgoDrive
from advercity.conflicts.opposite_lane import (
    compute_drift_limit_m_s,
    find_overtaking_station,
    find_straightest_station,
    place_opposite,
)
from advercity.conflicts.run_ups import (
    compute_actor_speed_m_s,
    compute_needed_approach_m,
    compute_run_m,
    compute_timely_speed_m_s,
    find_last_free_station,
)
from advercity.roads.routes import RoutePath, RouteSegment


def place_actor(case: ConflictCase) -> ActorPlacement:
    """Place the actor of a conflict.

    Raises:
        UnsolvableError: It cannot approach as declared on this road.
    """
    match case.conflict.actor.comes:
        case "nearside" | "farside":
            return place_across(case)
        case "ahead":
            return place_ahead(case)
        case "opposite_lane" if case.meets_at_m is not None:
            return place_opposite(case, case.meets_at_m)
        case "opposite_lane" if case.conflict.actor.behaviour == "overtakes":
            return place_opposite(case, find_overtaking_station(case))
        case "opposite_lane":
            return place_opposite(case, find_straightest_station(case))
        case "alongside":
            return place_along_edge(case)
        case "oncoming" if case.actor.actor_class == "bicycle":
            return place_along_edge(case)
        case _:
            return place_in_lane(case)


def compute_lane_edge_offset(
    segment: RouteSegment, *, right: bool, to_median: bool = True
) -> float:
    """Compute the offset of the lanes' outer edge; with `to_median`, left lanes end at a median."""
    own = segment.strips_on_side(right=True)
    if right:
        return segment.lateral_offset([b for b in own if b.kind is StripKind.LANE][-1].outer_t)
    if to_median and any(band.kind is StripKind.MEDIAN for band in own):
        return segment.lateral_offset(next(b for b in own if b.kind is StripKind.LANE).inner_t)
    other = [b for b in segment.strips_on_side(right=False) if b.kind is StripKind.LANE]
    return segment.lateral_offset(other[-1].outer_t if other else 0.0)


RIDING_INSET_M = 0.25
"""Distance of a cyclist from the edge of the lanes on a street without a shoulder."""


def compute_riding_offset(segment: RouteSegment) -> float:
    """Compute the offset of a cyclist: the centre of the shoulder, else next to the lanes."""
    bands = segment.strips_on_side(right=True)
    last = max(index for index, band in enumerate(bands) if band.kind is StripKind.LANE)
    adjacent = bands[last + 1] if last + 1 < len(bands) else None
    shoulders = (StripKind.SHOULDER, StripKind.PARKING)
    if adjacent and adjacent.kind in shoulders and adjacent.width_m > 1:
        return segment.lateral_offset(adjacent.centre_t)
    return segment.lateral_offset(bands[last].outer_t) - RIDING_INSET_M


WAITING_GAP_M = 0.8
"""Distance of a waiting actor from the edge of the lanes."""
RUN_UP_M = {"bicycle": (6.0, 25.0)}
"""Minimum and maximum distance of the start behind the waiting position, by class.
Cyclists in Euro NCAP's tests ride steadily from 17 and 22 m before the impact."""
FIRST_CROSSING_FRACTION, NEXT_CROSSING_FRACTION = 0.55, 0.3
"""Fraction of the ego's drive at which it is crossed between junctions, and steps to the next."""
DRIVEWAY_M = 3.0
"""Maximum distance of a start from the outer edge of the ego's exit street."""
CLEAR_OF_JUNCTIONS_M = 8.0
CLEAR_OF_TURN_M = 25.0
"""Distance after a junction beyond which the ego goes straight on."""
SETTLED_S = 1.0
"""Extra time before a later conflict: an ego that reacted restarts late."""
ASIDE_RATIO = 0.35
"""Metres an actor walks ahead per metre aside as it leaves the ego's lane."""
LANE_HUGGING_FRACTION = 0.15
"""Lateral position of an actor walking ahead, as a fraction of its offset outside the lanes."""


def place_across(case: ConflictCase) -> ActorPlacement:
    """Place an actor that crosses straight from the near side or the far side."""
    nearside = case.conflict.actor.comes == "nearside"
    station = _find_crossed_station(case)
    segment = case.drive.segment_at(station)
    sign = -1.0 if nearside else 1.0
    wait = _compute_waiting_offset_m(case, segment, right=nearside)
    wait = max(wait, case.parameters.get("start_lateral_m", 0.0))
    run_up, longest = RUN_UP_M.get(case.actor.actor_class, (0.0, 0.0))
    if case.index > 1 and station > segment.start_m:  # not on a crossing: sidewalks lead there
        strips = segment.strips_on_side(right=nearside)
        edge = abs(segment.lateral_offset(strips[-1].outer_t))
        longest = min(longest, max(edge + DRIVEWAY_M - wait, 0.0))
    start = wait + min(max(run_up, compute_needed_approach_m(case) - wait), longest)
    # A metre past the waiting position on the other side, clear of the lanes.
    end = _compute_waiting_offset_m(case, segment, right=not nearside) + 1.0
    path = case.drive.path
    ends = [path.point_at(station, sign * start), path.point_at(station, -sign * end)]
    return ActorPlacement(station, start, path=np.array(ends))


def place_ahead(case: ConflictCase) -> ActorPlacement:
    """Place an actor that walks ahead of the ego and leaves its lane to the nearer side."""
    drive, station = case.drive, _find_crossed_station(case)
    segment = drive.segment_at(station)
    right = not any(
        band.kind is StripKind.LANE and band.lane_number > segment.lane
        for band in segment.strips_on_side(right=True)
    )
    out = _compute_waiting_offset_m(case, segment, right=right) * (-1 if right else 1)
    lead = case.speed_m_s * case.parameters["return_time_s"]
    walked = case.speed_m_s * (drive.motion.time_at(station) + 2.0)
    back = min(walked, station - drive.start_m + 20.0)
    aside = station - lead + ASIDE_RATIO * abs(out)
    stations = [station - back, station - lead, aside, station + 15.0]
    offsets = [LANE_HUGGING_FRACTION * out, LANE_HUGGING_FRACTION * out, out, out]
    points = [drive.path.point_at(s, side) for s, side in zip(stations, offsets, strict=True)]
    return ActorPlacement(station, back, path=np.array(points))


def _compute_waiting_offset_m(case: ConflictCase, segment: RouteSegment, *, right: bool) -> float:
    """Compute the distance of a waiting actor from the ego's path; cyclists skip medians."""
    rides = case.actor.actor_class == "bicycle"
    return abs(compute_lane_edge_offset(segment, right=right, to_median=not rides)) + WAITING_GAP_M


def _find_crossed_station(case: ConflictCase) -> float:
    """Find the station of a crossing: at the crossing of the exit street, or between junctions.

    After an earlier conflict at the junction, it is on the exit street, clear of the turn.
    """
    drive = case.drive
    earliest = drive.motion.station_at(case.not_before_s + SETTLED_S) if case.index > 1 else 0.0
    if drive.road.junction == "intersection":
        _, _, after = find_ego_intersection(drive)
        if case.index > 1 and case.conflict.ego.manoeuvre == "straight":
            return max(earliest, after.start_m + CLEAR_OF_TURN_M)
        if case.conflict.parameters.obstruction_gap_m is None:
            return after.start_m - CROSSING_OFFSET_M
        # Cars that hide the actor park along the street, not at the crossing.
        return (after.start_m + min(after.end_m, drive.end_m)) / 2
    fraction = FIRST_CROSSING_FRACTION + (case.index - 1) * NEXT_CROSSING_FRACTION
    wanted = max(drive.start_m + fraction * (drive.end_m - drive.start_m), earliest)
    is_inside = any(
        item.start_m + CLEAR_OF_JUNCTIONS_M < wanted < item.end_m - CLEAR_OF_JUNCTIONS_M
        for item in drive.path.segments
    )
    centres = [
        (max(item.start_m, drive.start_m) + min(item.end_m, drive.end_m)) / 2
        for item in drive.path.segments
    ]
    return wanted if is_inside else min(centres, key=lambda centre: abs(centre - wanted))


STOP_LINE_GAP_M = 1.0
"""Distance of a waiting vehicle from the stop line."""
ALONG_EDGE_M = 26.0
"""Length of the path along the edge before and after the junction."""
ALONGSIDE_EXTRA_GAP_M = 0.3
"""Extra distance to the right of an actor riding alongside the ego."""
BEARINGS = {"from_left": -np.pi / 2, "from_right": np.pi / 2, "alongside": 0.0}
"""Heading towards the junction relative to the ego's, radians; all others are oncoming."""
APPROACH_TOLERANCE_RAD = np.pi / 4
"""Tolerance of `BEARINGS`."""
STRAIGHT_TOLERANCE_RAD = np.pi / 5
"""Movements with a smaller turn go straight on."""


def place_in_lane(case: ConflictCase) -> ActorPlacement:
    """Place a vehicle before the stop line, to go straight on or to turn left."""
    movement = _find_straight_movements(case)[0]
    if case.conflict.actor.comes == "oncoming_turning":
        movement = _find_left_turn(case.drive, movement.from_street)
    route = (movement.from_street, movement.to_street)
    path = case.drive.planner.build_path(route, movement.from_lane)
    station = _find_meeting_station(case.drive, path)
    line_m = path.segments[0].end_m
    start_m = STOP_LINE_GAP_M + case.actor.length_m / 2
    if line_m < start_m + case.actor.length_m / 2:
        raise UnsolvableError(f"'{movement.from_street}' is too short for the actor to start in")
    approach_m = path.find_nearest_station(case.drive.path.point_at(station)) - (line_m - start_m)
    lane = movement.from_lane
    place = ActorPlacement(
        station,
        approach_m,
        route=route,
        lane=lane,
        start_m=start_m,
        approach_street=movement.from_street,
        beyond_line_m=approach_m - start_m,
    )
    # If the junction is too short for the approach, the actor starts farther back.
    room_m = line_m - start_m - find_last_free_station(case, path, line_m)
    wanted_m = max(compute_needed_approach_m(case), compute_run_m(case, station))
    back_m = min(max(wanted_m - approach_m, 0.0), room_m)
    return replace(place, approach_m=approach_m + back_m, start_m=start_m + back_m)


def fit_actor_speed(case: ConflictCase) -> ConflictCase:
    """Redraw the speed of an actor that stops short or drifts, within the limits of the road.

    An actor that stops short can reach the speed and stop again, and brakes within the declared
    time to collision. An actor that drifts keeps to the limit at the meeting.
    """
    behaviour = case.conflict.actor.behaviour
    low_km_h, high_km_h = compute_bounds(case.conflict.parameters.actor_speed_km_h.draw)
    fastest = case.with_actor_speed(high_km_h)
    place = place_actor(fastest)
    if behaviour == "stops_short":
        limit = min(
            compute_actor_speed_m_s(fastest, place),
            2 * case.parameters["braking_m_s2"] * case.conflict.outcome.time_to_collision_below_s,
            compute_timely_speed_m_s(case, place) if place.route else np.inf,
        )
    elif behaviour == "drifts":
        limit = compute_drift_limit_m_s(case, place.station_m)
        limit = max(limit, low_km_h / KM_H_PER_M_S)
    else:
        return case
    share = case.least_speed_share if place.route else 0.0
    highest_km_h = limit * KM_H_PER_M_S
    return case.redraw_actor_speed(share * min(highest_km_h, high_km_h), highest_km_h)


def place_along_edge(case: ConflictCase) -> ActorPlacement:
    """Place a cyclist on the right edge, straight through the junction with or against the ego."""
    aside_m = ALONGSIDE_EXTRA_GAP_M if case.conflict.actor.comes == "alongside" else 0.0
    movement = _find_straight_movements(case)[-1]
    points = _build_edge_path(case.drive, movement, aside_m)
    path = RoutePath(points, ())
    station = _find_meeting_station(case.drive, path)
    approach_m = path.find_nearest_station(case.drive.path.point_at(station))
    line_m = path.find_nearest_station(points[1])
    return ActorPlacement(
        station,
        approach_m,
        path=points,
        approach_street=movement.from_street,
        beyond_line_m=approach_m - line_m,
    )


def find_ego_intersection(drive: EgoDrive) -> tuple[str, RouteSegment, RouteSegment]:
    """Find the ego's junction, and the streets before and after it."""
    if drive.intersection is None:
        raise UnsolvableError("the ego passes no junction")
    return drive.intersection


def _find_straight_movements(case: ConflictCase) -> tuple[Movement, ...]:
    """Find movements straight on from the actor's direction, innermost lane first."""
    planner, comes = case.drive.planner, case.conflict.actor.comes
    junction, before, _ = find_ego_intersection(case.drive)
    bearing = planner.approach_heading(before.street.id, junction) + BEARINGS.get(comes, np.pi)
    movements = [
        item
        for item in planner.movements[junction]
        if np.cos(planner.approach_heading(item.from_street, junction) - bearing)
        > np.cos(APPROACH_TOLERANCE_RAD)
        and abs(planner.turn_angle(item, junction)) < STRAIGHT_TOLERANCE_RAD
    ]
    if not movements:
        raise UnsolvableError(f"no movement goes straight on '{comes}' at '{junction}'")
    return tuple(sorted(movements, key=lambda item: item.from_lane))


def _find_left_turn(drive: EgoDrive, street: str) -> Movement:
    junction, _, _ = find_ego_intersection(drive)
    for item in drive.planner.movements[junction]:
        turns_left = drive.planner.turn_angle(item, junction) > STRAIGHT_TOLERANCE_RAD
        if item.from_street == street and turns_left:
            return item
    raise UnsolvableError(
        f"no movement turns across oncoming traffic from '{street}' at '{junction}'"
    )


def _build_edge_path(drive: EgoDrive, movement: Movement, aside_m: float) -> NDArray[np.float64]:
    """Build points (4, 2) along the right edge of the roadway, straight through the junction."""
    path = drive.planner.build_path((movement.from_street, movement.to_street), movement.from_lane)
    before, after = path.segments
    run = min(ALONG_EDGE_M, before.end_m - before.start_m - 3.0)
    far = min(ALONG_EDGE_M, after.end_m - after.start_m - 3.0)
    stations = [(before.end_m - run, before), (before.end_m, before)]
    stations += [(after.start_m, after), (after.start_m + far, after)]
    return np.array(
        [path.point_at(at, compute_riding_offset(item) - aside_m) for at, item in stations]
    )


def _find_meeting_station(drive: EgoDrive, path: RoutePath) -> float:
    station = drive.path.find_crossing_station(path)
    if station is None:
        raise UnsolvableError("the paths of ego and actor do not cross")
    return station
