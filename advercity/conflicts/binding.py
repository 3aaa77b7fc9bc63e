"""Which conflicts can be staged on which roads, and why others cannot.

Connected vehicles that follow the ego where the original has them lead it.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from advercity_dsl import Conflict, Road, Vehicle
from advercity_dsl.road import Sign, StripKind

from advercity.roads.routes import RoutePath, RoutePlanner, build_ego_path

SIDE_STREET_SINE = np.sin(np.pi / 4)
"""A street at a larger angle than this comes from the side."""
Standing = Literal["primary", "extension", "variant", "invalid"]
MIN_KERB_SPACE_M = 2.0
"""Least width of the strips beside the lanes that a vehicle can be parked on."""


@dataclass(frozen=True)
class Binding:
    """How a conflict stands to a road.

    Primary: its group calls for such a road. Extension: it fits, but no group calls for it.
    Variant: it would fit if the junction had no lights. Invalid: it does not fit.
    """

    standing: Standing
    reason: str = ""


def match_conflict(conflict: Conflict, road: Road, *, called_for: bool) -> Binding:
    """How a conflict stands to a road.

    Args:
        conflict: The conflict.
        road: The road.
        called_for: Whether the conflict's typology calls for the road.
    """
    reason = _find_obstacle(conflict, road)
    if reason:
        return Binding("invalid", reason)
    signals = _find_signalled_junctions(road)
    if conflict.requires.signals == "forbidden" and signals:
        return Binding("variant", "the ego's junction has traffic lights")
    if conflict.requires.signals == "required" and not signals:
        return Binding("invalid", "the ego's junction has no traffic lights")
    return Binding("primary" if called_for else "extension")


def with_ego_manoeuvre(road: Road, conflict: Conflict) -> Road | None:
    """The road with the ego on a way that makes the conflict's manoeuvre; None if it has none.

    Where nobody may lead the ego, connected vehicles that would start behind it; where there may be
    no traffic lights, those of the ego's junctions are gone.
    """
    if conflict.requires.signals == "forbidden":
        road = _without_signals(road)
    if find_usual_manoeuvre(road) == conflict.ego.manoeuvre:
        usual = road.model_copy(update={"ego_routes": {}})
        return usual if conflict.requires.ahead == "any" else with_followers(usual)
    other = road.ego_routes.get(conflict.ego.manoeuvre)
    if other is None:
        return None
    ego = road.ego
    moved = ego.model_copy(update=other.model_dump())
    agents = {name: moved if place is ego else place for name, place in road.agents.items()}
    return road.model_copy(update={"agents": agents, "ego_routes": {}})


def find_usual_manoeuvre(road: Road) -> str:
    """What the ego does at its junction; on other roads it goes straight on."""
    route = road.ego.route
    if road.junction == "non_junction" or len(route) < 2:
        return "straight"
    ways = RoutePlanner(road)
    junction = ways.find_junction(route[0], route[1])
    turn = next(
        ways.turn_angle(item, junction or "")
        for item in ways.movements[junction or ""]
        if item.from_street == route[0] and item.to_street == route[1]
    )
    return "straight" if abs(turn) < 0.6 else ("left" if turn > 0 else "right")


def _find_obstacle(conflict: Conflict, road: Road) -> str:
    needs = conflict.requires
    if road.imported is not None:
        return "its streets are imported and have no names"
    if needs.junction not in ("any", road.junction):
        return (
            f"it is {_describe_junction(road.junction)}, not {_describe_junction(needs.junction)}"
        )
    if needs.median == "forbidden" and _has_strip(road, StripKind.MEDIAN):
        return "a median divides it"
    if needs.kerb_space == "required" and not has_kerb_space(road):
        return "there is no kerb space for what hides the actor"
    if with_ego_manoeuvre(road, conflict) is None:
        if find_usual_manoeuvre(road) == conflict.ego.manoeuvre:
            return "no street leads to the ego's, for those who have to follow it"
        return f"no way of the ego goes {conflict.ego.manoeuvre} there; declare it in 'ego_routes'"
    return ""


def _describe_junction(junction: str) -> str:
    return "an intersection" if junction == "intersection" else "away from junctions"


def _has_strip(road: Road, kind: StripKind) -> bool:
    sections = {road.streets[name].section for name in road.ego.route}
    return any(
        strip.kind is kind
        for name in sections
        for strip in (*road.sections[name].left, *road.sections[name].right)
    )


def has_kerb_space(road: Road) -> bool:
    """Whether a vehicle can be parked beside a lane of the ego's streets."""
    sections = {road.streets[name].section for name in road.ego.route}
    beside = (StripKind.PARKING, StripKind.SHOULDER, StripKind.VERGE, StripKind.SIDEWALK)
    return any(
        sum(strip.width_m for strip in side if strip.kind in beside) >= MIN_KERB_SPACE_M
        for name in sections
        for side in (road.sections[name].left, road.sections[name].right)
    )


def _find_signalled_junctions(road: Road) -> tuple[str, ...]:
    """The junctions on the ego's way that have traffic lights."""
    route = road.ego.route
    ways = RoutePlanner(road)
    return tuple(
        junction
        for first, second in pairwise(route)
        if (junction := ways.find_junction(first, second))
        and road.junctions[junction].signals is not None
    )


def _without_signals(road: Road) -> Road:
    """The road with stop signs for those from the sides where the ego's way has traffic lights."""
    ways, ego = RoutePlanner(road), road.ego
    unlit = {
        name: road.junctions[name].model_copy(
            update={
                "control": "stop",
                "signals": None,
                "signs": tuple(_build_stop_signs(ways, name, ego.route[0])),
            }
        )
        for name in _find_signalled_junctions(road)
    }
    return road.model_copy(update={"junctions": {**road.junctions, **unlit}})


def _build_stop_signs(ways: RoutePlanner, junction: str, main: str) -> Iterator[Sign]:
    """On the right of every street that comes into a junction at an angle to the main one."""
    comes = ways.approach_heading(main, junction)
    for street in dict.fromkeys(item.from_street for item in ways.movements[junction]):
        if abs(np.sin(ways.approach_heading(street, junction) - comes)) > SIDE_STREET_SINE:
            layout, along = ways.streets[street], ways.is_towards_junction(street, junction)
            edge = layout.directed_line(
                layout.strips_in_direction(along=along)[-1].outer_t, along=along
            )[:, :2]
            east, north = edge[-1]
            yield Sign(street=street, kind="stop", at_m=(round(east, 2), round(north, 2)))


FOLLOWING_DISTANCE_M = 25.0
"""From the ego's middle to that of who follows it."""
FOLLOWER_LINE_GAP_M = 5.0
"""A follower's middle is at least this far before the end of its street."""
SAME_SIDE_GAP_M = 6.0
"""Nearer than this to the ego's way a vehicle is on its side of the road."""


def with_followers(road: Road) -> Road | None:
    """The road with all connected vehicles that would lead the ego behind it; None without room."""
    ways, ego = RoutePlanner(road), road.ego
    way, start_m, _ = build_ego_path(ways, ego)
    followers = {
        name: _place_behind_ego(place, ego, ways)
        for name, place in road.agents.items()
        if isinstance(place, Vehicle) and place is not ego and _is_leading(place, way, start_m)
    }
    if None in followers.values():
        return None
    return road.model_copy(update={"agents": {**road.agents, **followers}})


def _is_leading(place: Vehicle, way: RoutePath, start_m: float) -> bool:
    """Whether a vehicle starts farther on the ego's way and drives as the ego does."""
    station = way.find_nearest_station(place.spawn_m)
    apart = np.linalg.norm(way.point_at(station) - np.array(place.spawn_m))
    same = np.cos(way.heading_at(station) - np.radians(place.heading_deg)) > 0
    return bool(station > start_m and apart < SAME_SIDE_GAP_M and same)


def _place_behind_ego(place: Vehicle, ego: Vehicle, ways: RoutePlanner) -> Vehicle | None:
    """A vehicle that drives where it meant to, but starts behind the ego."""
    onward = (*ego.route[: ego.route.index(place.route[0])], *place.route)
    way, ego_m, _ = build_ego_path(ways, ego)
    route, station = onward, ego_m - FOLLOWING_DISTANCE_M
    if station < FOLLOWER_LINE_GAP_M:
        longer = _find_preceding_route(onward, ego, ways)
        if longer is None:
            return None
        route, way = longer
        line_m = way.segments[0].end_m
        station = min(
            way.find_nearest_station(ego.spawn_m) - FOLLOWING_DISTANCE_M,
            line_m - FOLLOWER_LINE_GAP_M,
        )
    east, north = way.point_at(station)
    return place.model_copy(
        update={
            "spawn_m": (round(float(east), 2), round(float(north), 2)),
            "heading_deg": round(float(np.degrees(way.heading_at(station))), 2),
            "route": route,
        }
    )


def _find_preceding_route(
    onward: tuple[str, ...], ego: Vehicle, ways: RoutePlanner
) -> tuple[tuple[str, ...], RoutePath] | None:
    """A route that begins on a street before, leads to the ego's lane and turns least."""
    street = ways.streets[onward[0]]
    junction = street.begins if ways.is_along_axis(onward, 0) else street.ends
    found: list[tuple[float, float, tuple[str, ...], RoutePath]] = []
    for item in ways.movements.get(junction, ()):
        if item.to_street == onward[0]:
            route = (item.from_street, *onward)
            way = ways.build_path(route, item.from_lane)
            gap = np.linalg.norm(
                way.point_at(way.find_nearest_station(ego.spawn_m)) - np.array(ego.spawn_m)
            )
            found.append((round(float(gap)), abs(ways.turn_angle(item, junction)), route, way))
    best = min(found, key=lambda one: one[:2], default=None)
    return best and best[2:]
