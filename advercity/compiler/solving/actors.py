"""Records of those who take part besides the ego: whom it meets, who is passed, who is parked."""

import numpy as np
from advercity_dsl import StagedActor
from advercity_dsl.base import Point2
from numpy.typing import NDArray

from advercity.compiler.solving.case import Case, Placed
from advercity.compiler.solving.edges import outer_edge
from advercity.compiler.solving.overtaking import CYCLIST_M_S2, passed, passed_speed_m_s

FIRST_VEHICLE, FIRST_WALKER = 4001, 8001
NUMBERS_PER_CONFLICT = 10
STEADY_SHARE = 0.88
"""Of the most that it could reach and stop again, so that it keeps its speed for a moment."""
STOPS_BEFORE_M = 2.2
"""Least distance between its front and the point where the ways meet."""
PARKED_CARS = 2
PARKED_BESIDE_M = 0.15
"""Between a parked car and the lanes."""
PARKED_APART_M = 1.0
WORDS = {"pedestrian": "walker", "bicycle": "cyclist"}


def reached_m_s(case: Case, place: Placed) -> float:
    """The actor's drawn speed, or the most from which it can still stop short."""
    if case.conflict.actor.behaviour != "stops_short":
        return case.speed_m_s
    room = place.room_m - case.actor.length_m / 2 - STOPS_BEFORE_M
    gains, loses = case.drawn["acceleration_m_s2"], case.drawn["braking_m_s2"]
    most = np.sqrt(2 * max(room, 0.0) / (1 / gains + 1 / loses))
    return round(float(min(case.speed_m_s, STEADY_SHARE * most)), 3)


def met(case: Case, place: Placed, speed_m_s: float) -> StagedActor:
    """Whom the ego meets."""
    body = case.actor
    return StagedActor(
        id=f"conflict_{case.index}_{WORDS.get(body.actor_class, 'vehicle')}",
        number=_number(case, body.actor_class, 0),
        part="other" if case.conflict.ego.part == "subject" else "subject",
        behaviour=case.conflict.actor.behaviour,
        actor_class=body.actor_class,
        blueprint=body.name,
        route=place.route,
        lane=place.lane,
        path_m=() if place.path is None else tuple(rounded(item) for item in place.path),
        start_m=round(place.start_m, 3),
        speed_m_s=speed_m_s,
        acceleration_m_s2=case.drawn["acceleration_m_s2"],
        braking_m_s2=case.drawn["braking_m_s2"],
    )


def bystanders(case: Case, station_m: float) -> tuple[StagedActor, ...]:
    """Who is passed or parked; nobody in most conflicts.

    Args:
        case: The conflict.
        station_m: Where the actor meets the ego.
    """
    if case.conflict.actor.behaviour == "overtakes":
        return (_passed(case, station_m),)
    if "obstruction_gap_m" in case.drawn:
        return _parked(case, station_m)
    return ()


def rounded(place: NDArray[np.float64]) -> Point2:
    """A point (2,) to the millimetre."""
    return round(float(place[0]), 3), round(float(place[1]), 3)


def _passed(case: Case, station_m: float) -> StagedActor:
    place = passed(case, station_m)
    return StagedActor(
        id=f"conflict_{case.index}_passed",
        number=_number(case, "bicycle", 1),
        part="bystander",
        behaviour="drives",
        actor_class="bicycle",
        blueprint=case.casting.cyclist().name,
        route=place.route,
        start_m=round(place.start_m, 3),
        speed_m_s=round(passed_speed_m_s(case), 3),
        acceleration_m_s2=CYCLIST_M_S2[0],
        braking_m_s2=CYCLIST_M_S2[1],
    )


def _parked(case: Case, station_m: float) -> tuple[StagedActor, ...]:
    """Cars that hide the actor, one behind the other on the right of the ego's lanes."""
    way = case.drive.way
    edge = outer_edge(case.drive.stretch(station_m), right=True) - PARKED_BESIDE_M
    front = station_m - case.actor.width_m / 2 - case.drawn["obstruction_gap_m"]
    found: list[StagedActor] = []
    for number in range(1, PARKED_CARS + 1):
        car = case.casting.parked(number)
        side, rear = edge - car.width_m / 2, front - car.length_m
        found.append(
            StagedActor(
                id=f"conflict_{case.index}_parked_{number}",
                number=_number(case, "car", number),
                part="bystander",
                behaviour="stands",
                actor_class="car",
                blueprint=car.name,
                path_m=(rounded(way.at(rear, side)), rounded(way.at(front, side))),
                speed_m_s=0.0,
                acceleration_m_s2=1.0,
                braking_m_s2=1.0,
            )
        )
        front -= car.length_m + PARKED_APART_M
    return tuple(found)


def _number(case: Case, actor_class: str, offset: int) -> int:
    first = FIRST_WALKER if actor_class == "pedestrian" else FIRST_VEHICLE
    return first + NUMBERS_PER_CONFLICT * (case.index - 1) + offset
