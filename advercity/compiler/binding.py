"""Which conflicts can be staged on which roads, and why others cannot."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from advercity_dsl import Conflict, Road
from advercity_dsl.road import Sign, StripKind

from advercity.compiler.following import with_followers
from advercity.compiler.ways import RoadWays, ego_of

SIDEWAYS = np.sin(np.pi / 4)
"""A street at a larger angle than this comes from the side."""
Standing = Literal["primary", "extension", "variant", "invalid"]
KERB_SPACE_M = 2.0
"""Least width of the strips beside the lanes that a vehicle can be parked on."""


@dataclass(frozen=True)
class Binding:
    """How a conflict stands to a road.

    Primary: its group calls for such a road. Extension: it fits, but no group calls for it.
    Variant: it would fit if the junction had no lights. Invalid: it does not fit.
    """

    standing: Standing
    reason: str = ""


def bound(conflict: Conflict, road: Road, *, called_for: bool) -> Binding:
    """How a conflict stands to a road.

    Args:
        conflict: The conflict.
        road: The road.
        called_for: Whether the conflict's typology calls for the road.
    """
    reason = _obstacle(conflict, road)
    if reason:
        return Binding("invalid", reason)
    signals = _signalled(road)
    if conflict.requires.signals == "forbidden" and signals:
        return Binding("variant", "the ego's junction has traffic lights")
    if conflict.requires.signals == "required" and not signals:
        return Binding("invalid", "the ego's junction has no traffic lights")
    return Binding("primary" if called_for else "extension")


def with_manoeuvre(road: Road, conflict: Conflict) -> Road | None:
    """The road with the ego on a way that makes the conflict's manoeuvre; None if it has none.

    Where nobody may lead the ego, connected vehicles that would start behind it; where there may be
    no traffic lights, those of the ego's junctions are gone.
    """
    if conflict.requires.signals == "forbidden":
        road = _without_signals(road)
    if usual_manoeuvre(road) == conflict.ego.manoeuvre:
        usual = road.model_copy(update={"ego_routes": {}})
        return usual if conflict.requires.ahead == "any" else with_followers(usual)
    other = road.ego_routes.get(conflict.ego.manoeuvre)
    if other is None:
        return None
    ego = ego_of(road)
    moved = ego.model_copy(update=other.model_dump())
    agents = {name: moved if place is ego else place for name, place in road.agents.items()}
    return road.model_copy(update={"agents": agents, "ego_routes": {}})


def usual_manoeuvre(road: Road) -> str:
    """What the ego does at its junction; on other roads it goes straight on."""
    route = ego_of(road).route
    if road.junction == "non_junction" or len(route) < 2:
        return "straight"
    ways = RoadWays(road)
    junction = ways.junction_between(route[0], route[1])
    turn = next(
        ways.turn(item, junction or "")
        for item in ways.movements[junction or ""]
        if item.from_street == route[0] and item.to_street == route[1]
    )
    return "straight" if abs(turn) < 0.6 else ("left" if turn > 0 else "right")


def _obstacle(conflict: Conflict, road: Road) -> str:
    needs = conflict.requires
    if road.imported is not None:
        return "its streets are imported and have no names"
    if needs.junction not in ("any", road.junction):
        return f"it is {_spoken(road.junction)}, not {_spoken(needs.junction)}"
    if needs.median == "forbidden" and _strips(road, StripKind.MEDIAN):
        return "a median divides it"
    if needs.kerb_space == "required" and not has_kerb_space(road):
        return "there is no kerb space for what hides the actor"
    if with_manoeuvre(road, conflict) is None:
        if usual_manoeuvre(road) == conflict.ego.manoeuvre:
            return "no street leads to the ego's, for those who have to follow it"
        return f"no way of the ego goes {conflict.ego.manoeuvre} there; declare it in 'ego_routes'"
    return ""


def _spoken(junction: str) -> str:
    return "an intersection" if junction == "intersection" else "away from junctions"


def _strips(road: Road, kind: StripKind) -> bool:
    sections = {road.streets[name].section for name in ego_of(road).route}
    return any(
        strip.kind is kind
        for name in sections
        for strip in (*road.sections[name].left, *road.sections[name].right)
    )


def has_kerb_space(road: Road) -> bool:
    """Whether a vehicle can be parked beside a lane of the ego's streets."""
    sections = {road.streets[name].section for name in ego_of(road).route}
    beside = (StripKind.PARKING, StripKind.SHOULDER, StripKind.VERGE, StripKind.SIDEWALK)
    return any(
        sum(strip.width_m for strip in side if strip.kind in beside) >= KERB_SPACE_M
        for name in sections
        for side in (road.sections[name].left, road.sections[name].right)
    )


def _signalled(road: Road) -> tuple[str, ...]:
    """The junctions on the ego's way that have traffic lights."""
    route = ego_of(road).route
    ways = RoadWays(road)
    return tuple(
        junction
        for first, second in pairwise(route)
        if (junction := ways.junction_between(first, second))
        and road.junctions[junction].signals is not None
    )


def _without_signals(road: Road) -> Road:
    """The road with stop signs for those from the sides where the ego's way has traffic lights."""
    ways, ego = RoadWays(road), ego_of(road)
    unlit = {
        name: road.junctions[name].model_copy(
            update={
                "control": "stop",
                "signals": None,
                "signs": tuple(_stop_signs(ways, name, ego.route[0])),
            }
        )
        for name in _signalled(road)
    }
    return road.model_copy(update={"junctions": {**road.junctions, **unlit}})


def _stop_signs(ways: RoadWays, junction: str, main: str) -> Iterator[Sign]:
    """On the right of every street that comes into a junction at an angle to the main one."""
    comes = ways.inbound(main, junction)
    for street in dict.fromkeys(item.from_street for item in ways.movements[junction]):
        if abs(np.sin(ways.inbound(street, junction) - comes)) > SIDEWAYS:
            layout, along = ways.streets[street], ways.arrives(street, junction)
            edge = layout.travelled(layout.side(along=along)[-1].outer_t, along=along)[:, :2]
            east, north = edge[-1]
            yield Sign(street=street, kind="stop", at_m=(round(east, 2), round(north, 2)))
