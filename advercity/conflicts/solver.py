"""Solve a conflict at a road: place its participants and draw numbers from distributions."""

from collections.abc import Iterable, Mapping
from typing import Literal

import numpy as np
import shapely
from advercity_dsl import Blueprint, Conflict, StagedActor, StagedConflict
from advercity_dsl.distribution import compute_bounds
from advercity_dsl.units import KM_H_PER_M_S, Point2
from numpy.typing import NDArray

from advercity.conflicts.approaches import (
    compute_lane_edge_offset,
    find_ego_intersection,
    fit_actor_speed,
    place_actor,
)
from advercity.conflicts.case import (
    ActorPlacement,
    ConflictCase,
    ParticipantSampler,
    UnsolvableError,
    sample_parameters,
)
from advercity.conflicts.ego_motion import EgoDrive, NominalMotion
from advercity.conflicts.ego_speed import fit_ego_speed
from advercity.conflicts.opposite_lane import (
    CYCLIST_LIMITS_M_S2,
    compute_cyclist_speed_m_s,
    place_passed_cyclist,
)
from advercity.conflicts.run_ups import compute_actor_speed_m_s
from advercity.conflicts.signal_timing import (
    advance_green,
    find_run_lights,
    ignore_lights,
    shorten_wait,
    time_lights,
)
from advercity.geometry.polyline import StationedPolyline
from advercity.roads.routes import RoutePath

SIGHT_HISTORY_S = 6.0
SIGHT_STEP_S = 0.05


def compute_sight_distance_m(
    ego_path: RoutePath,
    motion: NominalMotion,
    station_m: float,
    actor_path: NDArray[np.float64],
    speed_m_s: float,
    obstructions: Iterable[shapely.Geometry],
) -> float | None:
    """Compute how far before the conflict point the ego is when the actor comes into sight.

    Both move as if to meet there: the ego by its nominal motion, the actor at its speed along its
    path (n, 2). The line of sight runs from centre to centre in the plane, so nothing is seen over
    roofs or through windows. Obstructions are outlines of the conflict's parked cars, without
    those in ordinary parking spaces. None if they never hide the actor.
    """
    times_s = np.arange(0.0, SIGHT_HISTORY_S, SIGHT_STEP_S)
    stations = [motion.station_at(motion.time_at(station_m) - time_s) for time_s in times_s]
    eyes = ego_path.line.points_at(stations)
    walk = StationedPolyline.from_points(actor_path)
    meeting_m = walk.line.project(shapely.Point(ego_path.point_at(station_m)))
    actor = walk.points_at(np.maximum(meeting_m - speed_m_s * times_s, 0.0))
    sight = shapely.linestrings(np.stack([eyes, actor], axis=1))
    hidden = np.flatnonzero(shapely.intersects(sight, shapely.union_all(list(obstructions))))
    return float(station_m - stations[hidden[0]]) if len(hidden) > 0 else None


def build_car_outline(ends: NDArray[np.float64], width_m: float) -> shapely.Geometry:
    """Build the outline of a car from the centres (2, 2) of its rear and its front."""
    return shapely.LineString(ends).buffer(width_m / 2, cap_style="flat")


FIRST_STAGED_VEHICLE, FIRST_STAGED_WALKER = 4001, 8001
NUMBERS_PER_CONFLICT = 10
PARKED_CARS = 2
PARKED_LANE_GAP_M = 0.15
"""Distance of a parked car from the lanes."""
PARKED_SPACING_M = 1.0
ID_NOUNS = {"pedestrian": "walker", "bicycle": "cyclist"}


def build_staged_actor(case: ConflictCase, place: ActorPlacement, speed_m_s: float) -> StagedActor:
    """Build the record of the conflict's actor."""
    body = case.actor
    return StagedActor(
        id=f"conflict_{case.index}_{ID_NOUNS.get(body.actor_class, 'vehicle')}",
        number=_actor_number(case, body.actor_class, 0),
        part="other" if case.conflict.ego.part == "subject" else "subject",
        behaviour=case.conflict.actor.behaviour,
        actor_class=body.actor_class,
        blueprint=body.name,
        route=place.route,
        lane=place.lane,
        path_m=() if place.path is None else tuple(round_point(item) for item in place.path),
        start_m=round(place.start_m, 3),
        speed_m_s=speed_m_s,
        acceleration_m_s2=case.parameters["acceleration_m_s2"],
        braking_m_s2=case.parameters["braking_m_s2"],
    )


def build_bystanders(case: ConflictCase, station_m: float) -> tuple[StagedActor, ...]:
    """Build the overtaken cyclist or the parked cars; none in most conflicts."""
    if case.conflict.actor.behaviour == "overtakes":
        return (_build_passed_cyclist(case, station_m),)
    if "obstruction_gap_m" in case.parameters:
        return _build_parked_cars(case, station_m)
    return ()


def round_point(point: NDArray[np.float64]) -> Point2:
    """Round a point (2,) to the millimetre."""
    return round(float(point[0]), 3), round(float(point[1]), 3)


def _build_passed_cyclist(case: ConflictCase, station_m: float) -> StagedActor:
    place = place_passed_cyclist(case, station_m)
    return StagedActor(
        id=f"conflict_{case.index}_passed",
        number=_actor_number(case, "bicycle", 1),
        part="bystander",
        behaviour="drives",
        actor_class="bicycle",
        blueprint=case.sampler.draw_cyclist().name,
        route=place.route,
        start_m=round(place.start_m, 3),
        speed_m_s=round(compute_cyclist_speed_m_s(case), 3),
        acceleration_m_s2=CYCLIST_LIMITS_M_S2[0],
        braking_m_s2=CYCLIST_LIMITS_M_S2[1],
    )


def _build_parked_cars(case: ConflictCase, station_m: float) -> tuple[StagedActor, ...]:
    """Build cars that hide the actor, one behind the other on the right of the ego's lanes."""
    path = case.drive.path
    lane_edge = compute_lane_edge_offset(case.drive.segment_at(station_m), right=True)
    edge = lane_edge - PARKED_LANE_GAP_M
    front = station_m - case.actor.width_m / 2 - case.parameters["obstruction_gap_m"]
    cars: list[StagedActor] = []
    for number in range(1, PARKED_CARS + 1):
        car = case.sampler.draw_parked_car(number)
        side, rear = edge - car.width_m / 2, front - car.length_m
        ends = round_point(path.point_at(rear, side)), round_point(path.point_at(front, side))
        cars.append(
            StagedActor(
                id=f"conflict_{case.index}_parked_{number}",
                number=_actor_number(case, "car", number),
                part="bystander",
                behaviour="stands",
                actor_class="car",
                blueprint=car.name,
                path_m=ends,
                speed_m_s=0.0,
                acceleration_m_s2=1.0,
                braking_m_s2=1.0,
            )
        )
        front -= car.length_m + PARKED_SPACING_M
    return tuple(cars)


def _actor_number(case: ConflictCase, actor_class: str, offset: int) -> int:
    first = FIRST_STAGED_WALKER if actor_class == "pedestrian" else FIRST_STAGED_VEHICLE
    return first + NUMBERS_PER_CONFLICT * (case.index - 1) + offset


ARRIVAL_WINDOW_S = 1.5
"""Half width of the window around the ego's predicted arrival."""


def solve_conflict(
    conflict: Conflict,
    typology: str,
    drive: EgoDrive,
    blueprints: Mapping[str, Blueprint],
    *,
    ego: Blueprint,
    seed: int,
    key: str,
    index: int,
    not_before_s: float,
    least_speed_share: float = 0.0,
) -> tuple[StagedConflict, EgoDrive]:
    """Place all participants of a conflict, with their speeds and the expected time.

    `drive` is the ego's, with the conflict's manoeuvre; `ego` is its blueprint, `typology` an id.
    All draws depend on `seed` and `key` (road, conflict and density, so all weathers share them).
    `index` is the number among the scenario's conflicts, from 1. No critical event comes before
    `not_before_s` from the scenario's start. `least_speed_share` is the density's. The returned
    drive has a speed limit around the meeting; in the first conflict its road's lights are timed
    for the ego, or for an actor that runs them.

    Raises:
        UnsolvableError: The conflict does not fit the road.
    """
    sampler = ParticipantSampler(blueprints, seed, key)
    case = ConflictCase(
        conflict,
        index,
        drive=drive,
        sampler=sampler,
        actor=sampler.draw_actor(conflict.actor.classes),
        ego=ego,
        resolved_by=sampler.draw_resolver(conflict.resolved_by),
        parameters=sample_parameters(conflict.parameters, seed, key),
        not_before_s=not_before_s,
        least_speed_share=least_speed_share,
    )
    place = place_actor(case)
    lights = find_run_lights(case, place) if index == 1 else None
    case = case.without("since_red_s") if lights is None else ignore_lights(case)
    case = advance_green(case, place) if index == 1 else case
    case = fit_ego_speed(case, place)
    case = fit_actor_speed(case)
    case = shorten_wait(case, place_actor(case))
    case = advance_green(case, place) if index == 1 else case
    if lights is not None:
        case = time_lights(case, place, lights)
    return _build_staged_conflict(case, typology, place_actor(case)), case.drive


def _build_staged_conflict(
    case: ConflictCase, typology: str, place: ActorPlacement
) -> StagedConflict:
    conflict, drive = case.conflict, case.drive
    if place.station_m <= drive.start_m:
        raise UnsolvableError("the ego starts beyond the place where it would meet the actor")
    speed = compute_actor_speed_m_s(case, place)
    others = build_bystanders(case, place.station_m)
    at_s = drive.motion.time_at(place.station_m)
    return StagedConflict(
        id=f"conflict_{case.index}",
        conflict=conflict.id,
        typology=typology,
        stages=conflict.stages,
        ego=conflict.ego.part,
        manoeuvre=conflict.ego.manoeuvre,
        violates=_find_violation(case, place),
        light=_name_run_light(case, place),
        actors=(build_staged_actor(case, place, speed), *others),
        point_m=round_point(drive.path.point_at(place.station_m)),
        station_m=round(place.station_m - drive.start_m, 3),
        window_s=(round(at_s - ARRIVAL_WINDOW_S, 1), round(at_s + ARRIVAL_WINDOW_S, 1)),
        parameters=_collect_parameters(case, place, speed, others),
        declared=_collect_bounds(case),
        resolved_by=case.resolved_by,
        mode="open_loop",
        outcome=conflict.outcome,
    )


def _name_run_light(case: ConflictCase, place: ActorPlacement) -> str | None:
    if "since_red_s" not in case.parameters:
        return None
    junction, _, _ = find_ego_intersection(case.drive)
    return f"{junction}/{place.approach_street}"


def _find_violation(case: ConflictCase, place: ActorPlacement) -> Literal["signal"] | None:
    """Find the control that the actor violates; none if both parties have green together."""
    violates, intersection = case.conflict.actor.violates, case.drive.intersection
    if intersection is None or place.approach_street is None:
        return violates
    junction, before, _ = intersection
    streets = {before.street.id, place.approach_street}
    return None if case.drive.planner.have_green_together(junction, streets) else violates


def _collect_bounds(case: ConflictCase) -> dict[str, tuple[float, float]]:
    """Collect the lowest and highest declared value of every parameter, sorted by name."""
    declared = {
        name: item
        for name, item in case.conflict.parameters
        if item is not None and name in case.parameters
    }
    return {name: compute_bounds(item.draw) for name, item in sorted(declared.items())}


def _collect_parameters(
    case: ConflictCase, place: ActorPlacement, speed_m_s: float, others: Iterable[StagedActor]
) -> dict[str, float]:
    """Collect the drawn and the derived parameters, sorted by name."""
    parameters = {
        **case.parameters,
        "actor_speed_km_h": round(speed_m_s * KM_H_PER_M_S, 3),
        "approach_m": round(place.approach_m, 2),
    }
    seen_m = _compute_occlusion_m(case, place, speed_m_s, others)
    if seen_m is not None:
        parameters["occlusion_m"] = round(seen_m, 2)
    return dict(sorted(parameters.items()))


def _compute_occlusion_m(
    case: ConflictCase, place: ActorPlacement, speed_m_s: float, others: Iterable[StagedActor]
) -> float | None:
    """Compute the sight distance to an actor behind parked cars; None without any."""
    blueprints = case.sampler.blueprints
    parked = [
        build_car_outline(np.array(item.path_m), blueprints[item.blueprint].width_m)
        for item in others
        if item.behaviour == "stands"
    ]
    if not parked or place.path is None:
        return None
    drive = case.drive
    return compute_sight_distance_m(
        drive.path, drive.motion, place.station_m, place.path, speed_m_s, parked
    )
