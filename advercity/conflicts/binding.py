"""Match conflicts to roads: find which can be staged where, and the obstacles to the others.

A road may have to change for a conflict: another route of the ego, no traffic lights at its
junction, or connected vehicles behind the ego instead of ahead of it.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from advercity_dsl import Conflict, Road, Vehicle
from advercity_dsl.conflict import Manoeuvre
from advercity_dsl.road import Sign, StripKind

from advercity.roads.arms import JunctionArm
from advercity.roads.plan_frame import name_in_world, to_plan_frame, to_world_frame
from advercity.roads.routes import RoutePath, RoutePlanner, build_ego_path
from advercity.roads.streets import StripLayout

SIDE_STREET_SINE = np.sin(np.pi / 4)
"""Sine of the angle to the ego's street beyond which a street is a side street."""
Standing = Literal["primary", "extension", "variant", "invalid"]
MIN_KERB_SPACE_M = 2.0
"""Minimum total width of the strips next to the lanes for a vehicle to park."""
STRAIGHT_TURN_RAD = 0.6
"""The ego goes straight on if it turns by less than this at its junction."""


@dataclass(frozen=True)
class Binding:
    """How a conflict matches a road.

    Attributes:
        standing: `primary`: its crash group calls for this road; `extension`: it fits, but no
            group calls for it; `variant`: it would fit without traffic lights at the junction;
            `invalid`: it does not fit.
        reason: Reason for a variant or invalid match.
    """

    standing: Standing
    reason: str = ""


def is_crossing(conflict: Conflict) -> bool:
    """Return whether a conflict's actor crosses the street of an ego that goes straight on.

    Such a conflict can happen anywhere, also after the ego has turned.
    """
    return conflict.ego.manoeuvre == "straight" and conflict.actor.comes in ("nearside", "farside")


def match_conflict(conflict: Conflict, road: Road, *, called_for: bool) -> Binding:
    """Match a conflict to a road; `called_for` is whether the typology calls for the road."""
    turn = name_in_world(conflict.ego.manoeuvre, road)
    road = to_plan_frame(road)
    reason = _find_obstacle(conflict, road, turn)
    if reason:
        return Binding("invalid", reason)
    signals = _has_signals_at_intersection(road)
    if conflict.requires.signals == "forbidden" and signals and road.imported is not None:
        return Binding("invalid", "the ego's junction has traffic lights in the map")
    if conflict.requires.signals == "forbidden" and signals:
        return Binding("variant", "the ego's junction has traffic lights")
    if conflict.requires.signals == "required" and not signals:
        return Binding("invalid", "the ego's junction has no traffic lights")
    return Binding("primary" if called_for else "extension")


def with_ego_manoeuvre(road: Road, conflict: Conflict) -> Road | None:
    """Return the road with the ego on a route for the conflict's manoeuvre; None without one.

    If the conflict needs a free road ahead, connected vehicles ahead of the ego move behind it.
    If it forbids traffic lights, the ego's junctions lose theirs. Conflicts name the manoeuvres
    of right-hand traffic; in left-hand traffic the ego makes their mirror images.
    """
    plan = _with_ego_manoeuvre(to_plan_frame(road), conflict)
    return None if plan is None else to_world_frame(plan, road)


def _with_ego_manoeuvre(road: Road, conflict: Conflict) -> Road | None:
    if conflict.requires.signals == "forbidden" and road.imported is None:
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
    """Find the manoeuvre of the ego's declared route; without a junction it is `straight`."""
    route = road.ego.route
    if road.junction == "non_junction" or len(route) < 2:
        return "straight"
    planner = RoutePlanner(road)
    first, second = route[planner.find_intersection(road.ego) or 0 :][:2]
    junction = planner.find_junction(first, second) or ""
    turn = next(
        planner.turn_angle(item, junction)
        for item in planner.movements[junction]
        if item.from_street == first and item.to_street == second
    )
    return "straight" if abs(turn) < STRAIGHT_TURN_RAD else ("left" if turn > 0 else "right")


def _find_obstacle(conflict: Conflict, road: Road, turn: Manoeuvre) -> str:
    """Find the obstacle to a conflict on a road, traffic lights aside; empty without one.

    The road is in the plan frame, `turn` is the ego's manoeuvre in the world.
    """
    needs = conflict.requires
    if needs.junction not in ("any", road.junction):
        return (
            f"it is {_describe_junction(road.junction)}, not {_describe_junction(needs.junction)}"
        )
    if needs.median == "forbidden" and _has_strip(road, StripKind.MEDIAN):
        return "a median divides it"
    if needs.median == "forbidden" and not all(_list_ego_sides(road)):
        return "the ego's street is one-way"
    if needs.kerb_space == "required" and not has_kerb_space(road):
        return "it has no kerb space for the cars that hide the actor"
    if _with_ego_manoeuvre(road, conflict) is None:
        if find_usual_manoeuvre(road) == conflict.ego.manoeuvre:
            return "no street leads to the ego's, for the vehicles that have to follow it"
        return f"no route of the ego goes {turn} from its arm or in `ego_routes`"
    return ""


def _describe_junction(junction: str) -> str:
    return "an intersection" if junction == "intersection" else "away from junctions"


def _has_strip(road: Road, kind: StripKind) -> bool:
    return any(strip.kind is kind for side in _list_ego_sides(road) for strip in side)


def has_kerb_space(road: Road) -> bool:
    """Return whether a vehicle can be parked next to a lane of the ego's streets."""
    kinds = (StripKind.PARKING, StripKind.SHOULDER, StripKind.VERGE, StripKind.SIDEWALK)
    return any(
        round(sum(strip.width_m for strip in side if strip.kind in kinds), 6) >= MIN_KERB_SPACE_M
        for side in _list_ego_sides(road)
    )


def _list_ego_sides(road: Road) -> list[tuple[StripLayout, ...]]:
    """List the strips on either side of each of the ego's streets."""
    streets = [RoutePlanner(road).streets[name] for name in road.ego.route]
    return [side for street in streets for side in (street.left_strips, street.right_strips)]


def _has_signals_at_intersection(road: Road) -> bool:
    """Return whether the ego's junction has traffic lights; others on its route do not count."""
    planner, ego = RoutePlanner(road), road.ego
    index = planner.find_intersection(ego)
    if index is None:
        return False
    first, second = ego.route[index : index + 2]
    return planner.find_next_green_s(first, second, 0.0) is not None


def _find_signalled_junctions(road: Road) -> tuple[str, ...]:
    """Find the junctions with traffic lights on the ego's route."""
    planner = RoutePlanner(road)
    return tuple(
        junction
        for first, second in pairwise(road.ego.route)
        if planner.find_next_green_s(first, second, 0.0) is not None
        and (junction := planner.find_junction(first, second))
    )


def _without_signals(road: Road) -> Road:
    """Replace traffic lights on the ego's route by stop signs for the side streets."""
    planner = RoutePlanner(road)
    junctions = dict(road.junctions)
    for name in _find_signalled_junctions(road):
        signs = tuple(_build_stop_signs(planner, name, road.ego.route[0]))
        update = {"control": "stop", "signals": None, "signs": signs}
        junctions[name] = junctions[name].model_copy(update=update)
    return road.model_copy(update={"junctions": junctions})


def _build_stop_signs(planner: RoutePlanner, junction: str, main: str) -> Iterator[Sign]:
    """Build signs on the right of every street that meets the main one at an angle."""
    heading = planner.approach_heading(main, junction)
    for street in dict.fromkeys(item.from_street for item in planner.movements[junction]):
        if abs(np.sin(planner.approach_heading(street, junction) - heading)) > SIDE_STREET_SINE:
            layout = planner.streets[street]
            yield JunctionArm(layout, is_street_end=layout.ends == junction).place_stop_sign()


FOLLOWING_DISTANCE_M = 25.0
"""Distance of a follower's centre from the ego's."""
FOLLOWER_LINE_GAP_M = 5.0
"""Minimum distance of a follower's centre from the end of its street."""
SAME_SIDE_GAP_M = 6.0
"""Maximum distance from the ego's path of a vehicle on the ego's side of the road."""


def with_followers(road: Road) -> Road | None:
    """Move connected vehicles ahead of the ego behind it; None without room."""
    planner, ego = RoutePlanner(road), road.ego
    path, start_m, _ = build_ego_path(planner, ego)
    followers = {
        name: _place_behind_ego(place, ego, planner)
        for name, place in road.agents.items()
        if isinstance(place, Vehicle) and place is not ego and _is_leading(place, path, start_m)
    }
    if None in followers.values():
        return None
    return road.model_copy(update={"agents": {**road.agents, **followers}})


def _is_leading(place: Vehicle, path: RoutePath, start_m: float) -> bool:
    """Return whether a vehicle starts ahead of the ego on its path and in its direction."""
    station = path.find_nearest_station(place.spawn_m)
    gap_m = np.linalg.norm(path.point_at(station) - np.array(place.spawn_m))
    same_way = np.cos(path.heading_at(station) - np.radians(place.heading_deg)) > 0
    return bool(station > start_m and gap_m < SAME_SIDE_GAP_M and same_way)


def _place_behind_ego(place: Vehicle, ego: Vehicle, planner: RoutePlanner) -> Vehicle | None:
    """Move a vehicle behind the ego and keep its destination; None without room."""
    route = (*ego.route[: ego.route.index(place.route[0])], *place.route)
    path, ego_m, _ = build_ego_path(planner, ego)
    station = ego_m - FOLLOWING_DISTANCE_M
    if station < FOLLOWER_LINE_GAP_M:
        longer = _find_preceding_route(route, ego, planner)
        if longer is None:
            return None
        route, path = longer
        station = min(
            path.find_nearest_station(ego.spawn_m) - FOLLOWING_DISTANCE_M,
            path.segments[0].end_m - FOLLOWER_LINE_GAP_M,
        )
    east, north = path.point_at(station)
    return place.model_copy(
        update={
            "spawn_m": (round(float(east), 2), round(float(north), 2)),
            "heading_deg": round(float(np.degrees(path.heading_at(station))), 2),
            "route": route,
        }
    )


def _find_preceding_route(
    onward: tuple[str, ...], ego: Vehicle, planner: RoutePlanner
) -> tuple[tuple[str, ...], RoutePath] | None:
    """Find a route from a preceding street to the ego's lane, with the least turn."""
    street = planner.streets[onward[0]]
    junction = street.begins if planner.is_along_axis(onward, 0) else street.ends
    candidates: list[tuple[float, float, tuple[str, ...], RoutePath]] = []
    for item in planner.movements.get(junction, ()):
        if item.to_street == onward[0]:
            route = (item.from_street, *onward)
            path = planner.build_path(route, item.from_lane)
            nearest = path.point_at(path.find_nearest_station(ego.spawn_m))
            gap_m = round(float(np.linalg.norm(nearest - np.array(ego.spawn_m))))
            turn = abs(planner.turn_angle(item, junction))
            candidates.append((gap_m, turn, route, path))
    best = min(candidates, key=lambda candidate: candidate[:2], default=None)
    return best and best[2:]
