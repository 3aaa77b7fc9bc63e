"""Place agents by the arms of a junction: origins and destinations of vehicles, and units.

Directions are radians counter-clockwise from east; the direction of an arm leads away from the
junction. Directions, turns and places are in the world, also for left-hand roads, whose planner is
in the plan frame.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import shapely
from advercity_dsl import MapNetwork, Road, RoadsideUnit, Vehicle
from advercity_dsl.base import suggest_name
from advercity_dsl.conflict import Manoeuvre
from advercity_dsl.road import ArmUnit, ArmVehicle, EgoRoute, JunctionAgents, Movement
from numpy.typing import NDArray

from advercity.errors import InputError
from advercity.roads.arms import MisplacedPartError
from advercity.roads.imported_streets import start_with_green
from advercity.roads.plan_frame import mirror_route, mirror_unit, to_plan_frame
from advercity.roads.routes import RoutePath, RoutePlanner

COMPASS_RAD = {"east": 0.0, "north": np.pi / 2, "west": np.pi, "south": -np.pi / 2}
RELATIVE_RAD = {"same": 0.0, "right": np.pi / 2, "opposite": np.pi, "left": -np.pi / 2}
"""Direction of an arm less the direction of the ego's."""
ARM_TOLERANCE_RAD = np.pi / 3
STRAIGHT_TURN_RAD = 0.6
"""A movement with a smaller turn goes straight on."""
MAX_TURN_RAD = 2.8
"""A movement with a larger turn turns around."""
TURNS: tuple[Manoeuvre, ...] = ("straight", "left", "right")
END_MARGIN_M = 5.0
"""Distance of starts and destinations from the ends of a path."""
UNIT_CLEARANCE_M = 1.2
"""Distance of a roadside unit from the paving."""
UNIT_STEP_M, MAX_UNIT_OFFSET_M = 0.5, 20.0


def find_turn(angle_rad: float) -> Manoeuvre | None:
    """Name the manoeuvre of a turn by an angle, positive to the left; None for turning around."""
    if abs(angle_rad) < STRAIGHT_TURN_RAD:
        return "straight"
    return None if abs(angle_rad) > MAX_TURN_RAD else "left" if angle_rad > 0 else "right"


@dataclass(frozen=True, eq=False)
class JunctionArms:
    """A junction by its arms.

    Attributes:
        planner: Routes of the road, in the plan frame.
        junction: Id of the junction.
        is_left_hand: Whether the plan frame is the mirror image of the world.
    """

    planner: RoutePlanner
    junction: str
    is_left_hand: bool = False

    @staticmethod
    def of_road(road: Road, junction: str) -> "JunctionArms":
        """Find the arms of a junction of a road."""
        return JunctionArms(RoutePlanner(to_plan_frame(road)), junction, road.is_left_hand)

    @cached_property
    def directions(self) -> dict[str, float]:
        """Direction of every arm, by street."""
        names = (
            name
            for item in self.planner.movements[self.junction]
            for name in (item.from_street, item.to_street)
        )
        return {
            name: self._to_world(self.planner.approach_heading(name, self.junction) + np.pi)
            for name in dict.fromkeys(names)
        }

    def describe(self) -> str:
        """List the arms with their directions."""
        return ", ".join(
            f"{name} ({min(COMPASS_RAD, key=lambda word: _gap(COMPASS_RAD[word], direction))})"
            for name, direction in self.directions.items()
        )

    def list_turns(self, arm: str) -> dict[Manoeuvre, Movement]:
        """List the straightest movement of each manoeuvre from an arm."""
        found: dict[Manoeuvre, Movement] = {}
        movements = [
            item for item in self.planner.movements[self.junction] if item.from_street == arm
        ]
        for item in sorted(movements, key=lambda item: abs(self._turn_angle(item))):
            turn = find_turn(self._turn_angle(item))
            if turn is not None:
                found.setdefault(turn, item)
        return found

    def _turn_angle(self, item: Movement) -> float:
        return self._to_world(self.planner.turn_angle(item, self.junction))

    def _to_world(self, angle_rad: float) -> float:
        return -angle_rad if self.is_left_hand else angle_rad

    def find_arm(self, word: str, ego_arm: str | None = None) -> str:
        """Find the arm, with traffic towards the junction, by a word.

        Args:
            word: A compass direction, a direction relative to the ego's arm, or a street.
            ego_arm: Street of the ego's arm.

        Raises:
            InputError: There is none.
        """
        if word in self.directions:
            return word
        if word in COMPASS_RAD:
            wanted = COMPASS_RAD[word]
        elif word in RELATIVE_RAD and ego_arm is not None:
            wanted = self.directions[ego_arm] + RELATIVE_RAD[word]
        else:
            hint = suggest_name(word, {*COMPASS_RAD, *RELATIVE_RAD, *self.directions})
            raise InputError(
                f"'{word}' is no arm of '{self.junction}'; {hint} Arms: {self.describe()}"
            )
        arm = self._find_towards(wanted)
        if arm is None:
            raise InputError(
                f"no traffic comes to '{self.junction}' from an arm '{word}'; its arms are"
                f" {self.describe()}"
            )
        return arm

    def _find_towards(self, wanted_rad: float) -> str | None:
        gaps = {name: _gap(self.directions[name], wanted_rad) for name in self._inbound_arms}
        arm = min(gaps, key=lambda name: gaps[name])
        return arm if gaps[arm] <= ARM_TOLERANCE_RAD else None

    @cached_property
    def _inbound_arms(self) -> tuple[str, ...]:
        return tuple(name for name in self.directions if self.list_turns(name))

    def rank_arms(self) -> list[str]:
        """List the arms with traffic towards the junction, the busiest first.

        Those with an opposite one come first, then those with most manoeuvres, with the turn across
        oncoming traffic, and the most northward.
        """
        crossing_turn = "right" if self.is_left_hand else "left"

        def rank(name: str) -> tuple[bool, int, bool, float]:
            direction, turns = self.directions[name], self.list_turns(name)
            has_opposite = self._find_towards(direction + np.pi) is not None
            return has_opposite, len(turns), crossing_turn in turns, -_gap(direction, np.pi / 2)

        return sorted(self._inbound_arms, key=rank, reverse=True)


def find_junctions(planner: RoutePlanner, wanted: str | Sequence[str]) -> tuple[str, ...]:
    """Find the junctions of three arms or more selected by a word or a list.

    Raises:
        InputError: There is none, or a name is unknown.
    """
    arms = {
        name: {street for item in items for street in (item.from_street, item.to_street)}
        for name, items in planner.movements.items()
    }
    if isinstance(wanted, str) and wanted not in arms:
        found = tuple(
            name
            for name, streets in arms.items()
            if len(streets) > 2 and planner.controls.get(name) == wanted
        )
        if not found:
            kinds = sorted(
                {planner.controls.get(name, "none") for name in arms if len(arms[name]) > 2}
            )
            raise InputError(
                f"no junction '{wanted}', nor one of three arms with this rule of right of way;"
                f" this road has {', '.join(kinds) or 'none'}"
            )
        return found
    names = (wanted,) if isinstance(wanted, str) else tuple(wanted)
    for name in names:
        if name not in arms:
            raise InputError(f"unknown junction '{name}'; {suggest_name(name, arms)}")
    return names


def place_vehicle(
    arms: JunctionArms, arm: str, vehicle: ArmVehicle
) -> tuple[Vehicle, dict[Manoeuvre, EgoRoute]]:
    """Place a vehicle on an arm, and list its routes by manoeuvre; InputError if it has none."""
    routes: dict[Manoeuvre, EgoRoute] = {
        turn: _build_route(arms, movement, vehicle)
        for turn, movement in arms.list_turns(arm).items()
    }
    turn = vehicle.turn or next((turn for turn in TURNS if turn in routes), None)
    if turn is None or turn not in routes:
        ways = ", ".join(routes) or "nowhere"
        raise InputError(f"from '{arm}' traffic goes {ways} at '{arms.junction}'")
    kept = vehicle.model_dump(include={"role", "max_speed_km_h", "waits_s"})
    placed = Vehicle.model_validate({**kept, **routes[turn].model_dump()})
    return placed, routes


def _build_route(arms: JunctionArms, movement: Movement, vehicle: ArmVehicle) -> EgoRoute:
    route, index = _extend_route(arms.planner, movement, vehicle)
    path = arms.planner.build_path(route)
    start = _move_off_junctions(path, path.segments[index].end_m - vehicle.start_m)
    end = _move_off_junctions(path, path.segments[index + 1].start_m + vehicle.end_m)
    destination = path.point_at(end[1]).round(2).tolist()
    # From its own street on, a path keeps to one lane until the junction.
    before_m = path.segments[start[0]].end_m - start[1]
    route = route[start[0] :]
    path = arms.planner.build_path(route)
    start_m = path.segments[0].end_m - before_m
    spawn = path.point_at(start_m).round(2).tolist()
    found = EgoRoute(
        spawn_m=(spawn[0], spawn[1]),
        heading_deg=round(float(np.degrees(path.heading_at(start_m))), 2),
        destination_m=(destination[0], destination[1]),
        route=route,
        junction=arms.junction,
    )
    return mirror_route(found) if arms.is_left_hand else found


def _move_off_junctions(path: RoutePath, station_m: float) -> tuple[int, float]:
    """Find the nearest station in a street, away from its ends, and the street's index."""
    places: list[tuple[float, int, float]] = []
    for index, segment in enumerate(path.segments):
        margin_m = min(END_MARGIN_M, (segment.end_m - segment.start_m) / 2)
        nearest = np.clip(station_m, segment.start_m + margin_m, segment.end_m - margin_m)
        places.append((abs(float(nearest) - station_m), index, float(nearest)))
    return min(places)[1:]


def _extend_route(
    planner: RoutePlanner, movement: Movement, vehicle: ArmVehicle
) -> tuple[tuple[str, ...], int]:
    """Extend a movement backwards and onwards, straight on, until start and destination fit.

    Returns:
        The streets, and the index of the one before the junction.
    """
    route: tuple[str, ...] = (movement.from_street, movement.to_street)
    index = 0
    path = planner.build_path(route)
    while path.segments[index].end_m < vehicle.start_m + END_MARGIN_M:
        before = planner.find_straightest(route, backwards=True)
        if before is None:
            break
        route, index = (before, *route), index + 1
        path = planner.build_path(route)
    while path.length_m - path.segments[index].end_m < vehicle.end_m + 2 * END_MARGIN_M:
        after = planner.find_straightest(route, backwards=False)
        if after is None:
            break
        route = (*route, after)
        path = planner.build_path(route)
    return route, index


def place_unit(arms: JunctionArms, arm: str, unit: ArmUnit) -> RoadsideUnit:
    """Place sensors at the nearside of an arm, off all streets, looking at the junction."""
    street = arms.planner.streets[arm]
    at_end = street.ends == arms.junction
    station, outward = (street.stations[-1], -1.0) if at_end else (street.stations[0], 1.0)
    # Seen towards the junction, the nearside is at negative offsets where the axis leads to it.
    edges = [strip.outer_t for strip in street.strips_in_direction(along=at_end)]
    edge_m = abs(edges[-1]) if edges else 0.0
    paving = shapely.union_all(list(_iterate_areas(arms)))
    for extra_m in np.arange(UNIT_CLEARANCE_M, MAX_UNIT_OFFSET_M, UNIT_STEP_M):
        point = street.points_at(station, outward * (edge_m + extra_m))
        if not shapely.dwithin(paving, shapely.Point(point[:2]), UNIT_CLEARANCE_M):
            break
    else:
        raise InputError(f"no room next to '{arm}' at '{arms.junction}'")
    centre = np.mean([_find_end(arms, name) for name in arms.directions], axis=0)
    yaw = np.arctan2(*(centre - point)[1::-1])
    x, y, z = point.round(2).tolist()
    placed = RoadsideUnit(
        position_m=(x, y, round(z + unit.height_m, 2)),
        yaw_deg=round(float(np.degrees(yaw)), 2),
        pitch_deg=unit.pitch_deg,
    )
    return mirror_unit(placed) if arms.is_left_hand else placed


def _find_end(arms: JunctionArms, name: str) -> NDArray[np.float64]:
    street = arms.planner.streets[name]
    return street.axis[-1 if street.ends == arms.junction else 0]


def _iterate_areas(arms: JunctionArms) -> Iterator[shapely.Geometry]:
    """Yield the areas of the arms, and of the paths through the junction."""
    for name in arms.directions:
        street = arms.planner.streets[name]
        left, right = (
            street.offset_line(strips[-1].outer_t if strips else 0.0)
            for strips in (street.left_strips, street.right_strips)
        )
        ring = np.vstack([left, right[::-1]])
        yield shapely.make_valid(shapely.Polygon(ring[:, :2]))
    ends = shapely.MultiPoint([_find_end(arms, name)[:2] for name in arms.directions])
    yield shapely.convex_hull(ends)


def _gap(first: float, second: float) -> float:
    return float(abs((first - second + np.pi) % (2 * np.pi) - np.pi))


def place_at_every_arm(road: Road, declared: JunctionAgents, junction: str) -> list[Road]:
    """Place the agents of a road at a junction, with the ego on each possible arm.

    An ego without `arm` may come from all arms with places for the others, the busiest first.

    Raises:
        MisplacedPartError: No arm is possible.
    """
    name, ego = next(pair for pair in declared.agents.items() if _is_ego(pair[1]))
    arms = [ego.arm] if ego.arm else JunctionArms.of_road(road, junction).rank_arms()
    refusal = MisplacedPartError(("at_junction", "junction"), f"no traffic crosses '{junction}'")
    placed: list[Road] = []
    for arm in reversed(arms):
        agents = {**declared.agents, name: ego.model_copy(update={"arm": arm})}
        moved = declared.model_copy(update={"agents": agents})
        try:
            placed.insert(0, place_junction_agents(road, moved, junction))
        except MisplacedPartError as error:
            refusal = error
    if not placed:
        raise refusal
    return placed


def place_junction_agents(road: Road, declared: JunctionAgents, junction: str) -> Road:
    """Place the agents of a road at one of its junctions; MisplacedPartError if one cannot be."""
    arms = JunctionArms.of_road(road, junction)
    agents: dict[str, Vehicle | RoadsideUnit] = {}
    ego_arm, ego_routes = None, dict[Manoeuvre, EgoRoute]()
    # The ego first, since the arms of others may be relative to its.
    for name, item in sorted(declared.agents.items(), key=lambda pair: not _is_ego(pair[1])):
        try:
            arm = arms.find_arm(item.arm, ego_arm) if item.arm else arms.rank_arms()[0]
            if isinstance(item, ArmUnit):
                agents[name] = place_unit(arms, arm, item)
                continue
            agents[name], routes = place_vehicle(arms, arm, item)
        except InputError as error:
            raise MisplacedPartError(("at_junction", "agents", name), str(error)) from None
        if item.role == "ego":
            ego_arm, ego_routes = arm, routes
    changes: dict[str, object] = {
        "at_junction": None,
        "agents": {name: agents[name] for name in declared.agents},
        "ego_routes": ego_routes,
    }
    if isinstance(road.imported, MapNetwork) and ego_arm and ego_routes:
        # The ego would else wait for up to a cycle before anything happens, here or on its way.
        route = next(iter(ego_routes.values())).route
        streets = route[: route.index(ego_arm) + 2]
        imported = road.imported
        for first, second in pairwise(streets):
            imported = start_with_green(imported, first, second)
        changes["imported"] = imported
    return road.model_copy(update=changes)


def _is_ego(item: ArmVehicle | ArmUnit) -> bool:
    return isinstance(item, ArmVehicle) and item.role == "ego"
