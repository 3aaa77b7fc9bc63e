"""A conflict at a road, with numbers in place of distributions."""

from collections.abc import Iterable, Mapping

import numpy as np
from advercity_dsl import Blueprint, Conflict, Road, StagedActor, StagedConflict

from advercity.compiler.occlusion import outline, seen_from_m
from advercity.compiler.sampling import sampled
from advercity.compiler.solving.actors import bystanders, met, reached_m_s, rounded
from advercity.compiler.solving.case import Case, Placed
from advercity.compiler.solving.cast import Casting
from advercity.compiler.solving.drive import ego_drive
from advercity.compiler.solving.placing import placed

WINDOW_S = 1.5
"""Before and after the time when the ego is expected."""


def solved(
    conflict: Conflict,
    typology: str,
    road: Road,
    blueprints: Mapping[str, Blueprint],
    *,
    seed: int,
    key: str,
    index: int,
) -> StagedConflict:
    """Place everybody who takes part, and find out how fast and when they come.

    Args:
        conflict: What to stage.
        typology: Id of the typology that its crash types belong to.
        road: Where; the ego makes the conflict's manoeuvre on it.
        blueprints: To draw the actor's from.
        seed: Of the suite.
        key: What the draws are for: road, conflict and density, whatever the weather.
        index: Place among the scenario's conflicts, from 1.

    Raises:
        UnsolvableError: It does not fit.
    """
    casting = Casting(blueprints, seed, key)
    case = Case(
        conflict,
        index,
        drive=ego_drive(road),
        casting=casting,
        actor=casting.actor(conflict.actor.classes),
        drawn=sampled(conflict.parameters, seed, key),
    )
    return _staged(case, typology, placed(case))


def _staged(case: Case, typology: str, place: Placed) -> StagedConflict:
    conflict, drive = case.conflict, case.drive
    speed = reached_m_s(case, place)
    others = bystanders(case, place.station_m)
    at_s = drive.pace.time(place.station_m)
    return StagedConflict(
        id=f"conflict_{case.index}",
        conflict=conflict.id,
        typology=typology,
        stages=conflict.stages,
        ego=conflict.ego.part,
        manoeuvre=conflict.ego.manoeuvre,
        violates=conflict.actor.violates,
        actors=(met(case, place, speed), *others),
        point_m=rounded(drive.way.at(place.station_m)),
        station_m=round(place.station_m - drive.start_m, 3),
        window_s=(round(at_s - WINDOW_S, 1), round(at_s + WINDOW_S, 1)),
        parameters=_parameters(case, place, speed, others),
        mode="open_loop",
        outcome=conflict.outcome,
    )


def _parameters(
    case: Case, place: Placed, speed_m_s: float, others: Iterable[StagedActor]
) -> dict[str, float]:
    """What was drawn, and what came of it, by name."""
    found = {
        **case.drawn,
        "actor_speed_km_h": round(speed_m_s * 3.6, 3),
        "approach_m": round(place.room_m, 2),
    }
    seen_m = _seen_from_m(case, place, speed_m_s, others)
    if seen_m is not None:
        found["occlusion_m"] = round(seen_m, 2)
    return dict(sorted(found.items()))


def _seen_from_m(
    case: Case, place: Placed, speed_m_s: float, others: Iterable[StagedActor]
) -> float | None:
    """From where the ego sees an actor behind parked cars, if there are any."""
    blueprints = case.casting.blueprints
    parked = [
        outline(np.array(item.path_m), blueprints[item.blueprint].width_m)
        for item in others
        if item.behaviour == "stands"
    ]
    if not parked or place.path is None:
        return None
    drive = case.drive
    return seen_from_m(drive.way, drive.pace, place.station_m, place.path, speed_m_s, parked)
