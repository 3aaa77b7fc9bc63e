"""Places of a road's agents: by arms of a junction; omitted routes are added and checked."""

import tempfile
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import shapely
from advercity_dsl import Road, RoadsideUnit, Vehicle
from advercity_dsl.base import ValuePath, suggest_name
from advercity_dsl.road import StripKind
from advercity_dsl.units import Point2

from advercity.errors import InputError
from advercity.geometry.polyline import StationedPolyline
from advercity.roads.arms import MisplacedPartError
from advercity.roads.junction_arms import find_junctions, place_at_every_arm
from advercity.roads.lane_graph import (
    MAX_DESTINATION_GAP_M,
    MAX_LANE_DISTANCE_M,
    find_shortest_route,
    read_lane_graph,
)
from advercity.roads.mirrored_network import mirror_street
from advercity.roads.plan_frame import to_plan_frame
from advercity.roads.routes import RoutePlanner
from advercity.roads.streets import StreetLayout, StripLayout, approach_name
from advercity.roads.sumo_network import write_sumo_network

MAX_ROADSIDE_DISTANCE_M = 100.0
"""Distance from any lane beyond which a roadside unit observes no traffic."""
MAX_HEADING_GAP_RAD = np.pi / 3
"""Largest angle between a vehicle's heading and its lane's."""
ONCOMING_MARGIN_M = 0.5
"""A vehicle may be nearer to an oncoming lane than to its own by this: narrow streets overlap."""
SUGGESTED_LANES = 3
Problem = tuple[ValuePath, str, str]
"""Path of a value, its error, and the way out."""


def place_agents(road: Road) -> tuple[list[list[Road]], dict[str, str]]:
    """Place the agents of a road by the arms of junctions.

    Where a rule selects the junctions, unsuitable ones are left out.

    Returns:
        For each junction the road with the ego on every possible arm, and the reason for every
        junction left out.

    Raises:
        MisplacedPartError: No junction fits.
    """
    declared = road.at_junction
    if declared is None:
        return [[road]], {}
    planner = RoutePlanner(to_plan_frame(road))
    try:
        names = find_junctions(planner, declared.junction)
    except InputError as error:
        raise MisplacedPartError(("at_junction", "junction"), str(error)) from None
    if names == (declared.junction,):
        return [place_at_every_arm(road, declared, names[0])], {}
    placed: list[list[Road]] = []
    refused: dict[str, MisplacedPartError] = {}
    for name in names:
        try:
            found = place_at_every_arm(road, declared, name)
            update = {"id": f"{road.id}_{name}"}
            placed.append([item.model_copy(update=update) for item in found])
        except MisplacedPartError as error:
            refused[name] = error
    if refused and (not placed or not isinstance(declared.junction, str)):
        raise next(iter(refused.values()))
    return placed, {name: str(error) for name, error in refused.items()}


def complete_routes(road: Road) -> Road:
    """Give connected vehicles without a route the shortest one; others stay as they are.

    Raises:
        MisplacedPartError: A vehicle is on no lane, or no route leads to its destination.
    """
    vehicles = {
        name: agent
        for name, agent in road.agents.items()
        if isinstance(agent, Vehicle) and not agent.route and agent.track is None
    }
    if not vehicles:
        return road
    plan = to_plan_frame(road)
    with tempfile.TemporaryDirectory() as folder:
        graph = read_lane_graph(write_sumo_network(plan, Path(folder)))
    routed = dict(road.agents)
    for name, vehicle in vehicles.items():
        problem = next(_find_start_problems(road, name, vehicle), None)
        if problem is not None:
            raise MisplacedPartError(problem[0], f"{problem[1]}; {problem[2]}")
        place = plan.agents[name]
        assert isinstance(place, Vehicle)
        lane, position_m = graph.find_lane(place.spawn_m, np.radians(place.heading_deg))
        try:
            edges = find_shortest_route(graph, lane, position_m, place.destination_m)
        except InputError as error:
            nearest = _describe_nearest_lanes(road, vehicle.destination_m)
            message = f"{error}; nearest to the destination: {nearest}"
            raise MisplacedPartError(("agents", name, "destination_m"), message) from None
        streets = tuple(approach_name(edge) for edge in edges)
        routed[name] = vehicle.model_copy(update={"route": streets})
    return road.model_copy(update={"agents": routed})


def find_place_problems(road: Road) -> Iterator[Problem]:
    """Yield errors of starts, headings, routes and destinations, and unknown streets."""
    planner = RoutePlanner(to_plan_frame(road))
    for index, item in enumerate(road.surroundings):
        if item.beside is not None and item.beside.street not in planner.streets:
            value_path = ("surroundings", index, "beside", "street")
            hint = suggest_name(item.beside.street, planner.streets)
            yield value_path, f"unknown street '{item.beside.street}'", hint
    lanes = shapely.MultiLineString([line.points[:, :2] for _, line in _iterate_lanes(road)])
    for name, agent in road.agents.items():
        if isinstance(agent, RoadsideUnit):
            yield from _find_distance_problems(
                lanes, name, "position_m", agent.position_m[:2], MAX_ROADSIDE_DISTANCE_M
            )
            continue
        if agent.track is not None:
            continue
        problems = [
            *_find_distance_problems(lanes, name, "spawn_m", agent.spawn_m, MAX_LANE_DISTANCE_M),
            *_find_distance_problems(
                lanes, name, "destination_m", agent.destination_m, MAX_DESTINATION_GAP_M
            ),
        ]
        # Each check relies on the success of the one before.
        yield from problems or _find_start_problems(road, name, agent)
        yield from _find_route_problems(planner, name, agent)


def _find_distance_problems(
    lanes: shapely.Geometry, name: str, field: str, position: Sequence[float], limit_m: float
) -> Iterator[Problem]:
    distance_m = shapely.distance(lanes, shapely.Point(position))
    if distance_m > limit_m:
        message = (
            f"{position[0]:g}, {position[1]:g} is {distance_m:.0f} m from the nearest lane"
            f" of this map; the limit is {limit_m:g} m"
        )
        yield ("agents", name, field), message, "is it the right map? correct the position"


def _find_start_problems(road: Road, name: str, vehicle: Vehicle) -> Iterator[Problem]:
    heading = np.radians(vehicle.heading_deg)
    own_m, oncoming_m = np.inf, np.inf
    for _, line in _iterate_lanes(road):
        station_m, distance_m = line.project_point(vehicle.spawn_m)
        cosine = np.cos(line.headings_at(station_m) - heading)
        if cosine > np.cos(MAX_HEADING_GAP_RAD):
            own_m = min(own_m, distance_m)
        elif cosine < -np.cos(MAX_HEADING_GAP_RAD):
            oncoming_m = min(oncoming_m, distance_m)
    if own_m < MAX_LANE_DISTANCE_M and own_m < oncoming_m + ONCOMING_MARGIN_M:
        return
    at = f"{vehicle.spawn_m[0]:g}, {vehicle.spawn_m[1]:g}"
    message = f"no driving lane at {at} leads {vehicle.heading_deg:g} degrees from east"
    hint = f"move or turn the vehicle; nearest: {_describe_nearest_lanes(road, vehicle.spawn_m)}"
    yield ("agents", name, "heading_deg"), message, hint


def _find_route_problems(planner: RoutePlanner, name: str, vehicle: Vehicle) -> Iterator[Problem]:
    value_path = ("agents", name, "route")
    for street in vehicle.route:
        if street not in planner.streets:
            hint = suggest_name(street, planner.streets)
            yield value_path, f"unknown street '{street}'", hint
            return
    for first, second in pairwise(vehicle.route):
        if planner.find_junction(first, second) is None:
            onward = {
                item.to_street
                for items in planner.movements.values()
                for item in items
                if item.from_street == first
            }
            hint = f"it leads into {', '.join(sorted(onward))}" if onward else "it ends there"
            yield value_path, f"no movement leads from '{first}' into '{second}'", hint
            return


def _describe_nearest_lanes(road: Road, point: Point2) -> str:
    """Describe the nearest lanes of different streets: name, position and heading."""
    found: list[tuple[float, str, str]] = []
    for name, line in _iterate_lanes(road):
        station_m, distance_m = line.project_point(point)
        east, north = line.points_at(station_m)[:2]
        heading_deg = round(float(np.degrees(line.headings_at(station_m))))
        text = f"{name} at [{east:.1f}, {north:.1f}] heading {heading_deg}"
        found.append((distance_m, name, text))
    return ", ".join(text for _, _, text in sorted(found)[:SUGGESTED_LANES])


def _iterate_lanes(road: Road) -> Iterator[tuple[str, StationedPolyline]]:
    """Yield the driving lanes between junctions: `<street>.<number>` and centre line."""
    for street, strip, line in _iterate_strips(road, StripKind.LANE):
        yield f"{street.id}.{strip.lane_number}", line


def iterate_strip_lines(road: Road, kind: StripKind) -> Iterator[StationedPolyline]:
    """Yield the centre lines of all strips of a kind, in the world."""
    yield from (line for _, _, line in _iterate_strips(road, kind))


def _iterate_strips(
    road: Road, kind: StripKind
) -> Iterator[tuple[StreetLayout, StripLayout, StationedPolyline]]:
    planned = RoutePlanner(to_plan_frame(road)).streets.values()
    for street in map(mirror_street, planned) if road.is_left_hand else planned:
        for along in (True, False):
            for strip in street.strips_in_direction(along=along):
                if strip.kind is kind:
                    line = street.directed_line(strip.centre_t, along=along)
                    yield street, strip, StationedPolyline.from_points(line)
