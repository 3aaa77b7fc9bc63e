"""Positions of OpenSCENARIO: each element becomes a function of the stage."""

import math
from collections.abc import Callable, Mapping
from xml.etree.ElementTree import Element

import numpy as np

from advercity.recordings.openscenario.document import Scope
from advercity.recordings.openscenario.road_map import (
    LanePlace,
    RoadMap,
    choose_on_route,
    choose_straightest,
)
from advercity.recordings.openscenario.routes import Position, parse_route
from advercity.recordings.openscenario.stage import Pose, Stage

MAX_PLACE_M = 1e7


def parse_position(scope: Scope, parent: Element) -> Position | None:
    """Parse the `<Position>` in an element; None, and a problem, if it is of no known kind."""
    position = parent if parent.tag in ("Position", "TargetPosition") else parent.find("Position")
    kind = next(iter(position), None) if position is not None else None
    if position is None or kind is None:
        scope.refuse(parent, "has no <Position>")
        return None
    if kind.tag not in POSITIONS:
        known = ", ".join(f"<{name}>" for name in POSITIONS)
        scope.refuse(kind, "such a position is not read", f"these are: {known}")
        return None
    return POSITIONS[kind.tag](scope, kind)


def _parse_world(scope: Scope, element: Element) -> Position:
    place = complex(scope.get_number(element, "x"), scope.get_number(element, "y"))
    heading = scope.get_number(element, "h", math.nan)
    pose = Pose(place, heading, math.cos(scope.get_number(element, "p", 0.0)))
    return lambda stage: pose


def _parse_relative_world(scope: Scope, element: Element) -> Position:
    return _parse_shifted(scope, element, lambda delta, pose: delta)


def _parse_relative_object(scope: Scope, element: Element) -> Position:
    return _parse_shifted(scope, element, lambda delta, pose: delta * _turn(pose.heading))


def _parse_shifted(
    scope: Scope, element: Element, turn: Callable[[complex, Pose], complex]
) -> Position:
    name = parse_entity(scope, element)
    delta = complex(scope.get_number(element, "dx"), scope.get_number(element, "dy"))
    orient = _parse_orientation(scope, element)

    def find(stage: Stage) -> Pose:
        pose = stage.find_pose(scope, element, name)
        return Pose(pose.point + turn(delta, pose), orient(pose.heading), pose.level)

    return find


def _parse_lane(scope: Scope, element: Element) -> Position:
    road, lane = scope.get(element, "roadId"), _parse_lane_id(scope, element, "laneId")
    station_m = scope.get_number(element, "s")
    offset_m = scope.get_number(element, "offset", 0.0)
    orient = _parse_orientation(scope, element)

    def find(stage: Stage) -> Pose:
        roads = _get_roads(stage, scope, element)
        if roads.get_road(road) is None:
            stage.fail(scope, element, f"the map has no road '{road[:40]}'")
        place = LanePlace(road, lane, station_m, offset_m, roads.find_direction(road, lane))
        return _place(stage, scope, element, place, orient)

    return find


def _parse_road(scope: Scope, element: Element) -> Position:
    road = scope.get(element, "roadId")
    station_m, left_m = scope.get_number(element, "s"), scope.get_number(element, "t")
    orient = _parse_orientation(scope, element)

    def find(stage: Stage) -> Pose:
        roads = _get_roads(stage, scope, element)
        found = roads.get_road(road)
        if found is None or not 0 <= station_m <= found.length_m + 0.1:
            stage.fail(scope, element, f"the map has no road '{road[:40]}' at {station_m:g} m")
        point, heading = roads.locate_road(road, station_m, left_m)
        return Pose(point, orient(heading))

    return find


def _parse_relative_lane(scope: Scope, element: Element) -> Position:
    name = parse_entity(scope, element)
    lanes = _parse_lane_id(scope, element, "dLane")
    along_lane = element.get("dsLane") is not None
    ahead_m = scope.get_number(element, "dsLane" if along_lane else "ds", 0.0)
    offset_m = scope.get_number(element, "offset", 0.0)
    orient = _parse_orientation(scope, element)

    def find(stage: Stage) -> Pose:
        roads = _get_roads(stage, scope, element)
        place = find_own_lane(stage, scope, element, name)
        lane = count_lanes(place.lane, lanes * (place.along if along_lane else 1))
        # `ds` counts along the road, `dsLane` as the entity faces.
        steps_m = ahead_m * (1 if along_lane else place.along)
        beside = place._replace(lane=lane, offset_m=offset_m)
        moved = _shift(roads, beside, steps_m)
        if moved is None:
            stage.fail(scope, element, "is beyond the end of the road")
        return _place(stage, scope, element, moved, orient)

    return find


def _parse_relative_road(scope: Scope, element: Element) -> Position:
    name = parse_entity(scope, element)
    ahead_m, aside_m = scope.get_number(element, "ds"), scope.get_number(element, "dt")
    orient = _parse_orientation(scope, element)

    def find(stage: Stage) -> Pose:
        roads = _get_roads(stage, scope, element)
        place = find_own_lane(stage, scope, element, name)
        moved = _shift(roads, place, ahead_m * place.along)
        if moved is None:
            stage.fail(scope, element, "is beyond the end of the road")
        turned = 1 if moved.along == place.along else -1
        left_m = roads.find_left(place) * turned + aside_m * turned
        point, heading = roads.locate_road(moved.road, moved.station_m, left_m)
        return Pose(point, orient(heading))

    return find


def _parse_on_route(scope: Scope, element: Element) -> Position | None:
    holder = element.find("RouteRef")
    at = element.find("InRoutePosition/FromLaneCoordinates")
    if holder is None or at is None:
        scope.refuse(element, "has no <RouteRef> or no <FromLaneCoordinates>")
        return None
    route = parse_route(scope, holder, parse_position)
    lane, covered_m = _parse_lane_id(scope, at, "laneId"), scope.get_number(at, "pathS")
    offset_m = scope.get_number(at, "laneOffset", 0.0)
    orient = _parse_orientation(scope, element)
    if route is None:
        return None

    def find(stage: Stage) -> Pose:
        roads = _get_roads(stage, scope, element)
        path = route.find_roads(stage)
        choose = choose_on_route(path, lambda places: None)
        place = roads.shift(route.find_begin(stage), covered_m, choose)
        if place is None or place.road not in path:
            stage.fail(scope, at, f"the route has no place at {covered_m:g} m")
        place = place._replace(lane=lane, offset_m=offset_m)
        return _place(stage, scope, element, place, orient)._replace(route=path)

    return find


POSITIONS: Mapping[str, Callable[[Scope, Element], Position | None]] = {
    "WorldPosition": _parse_world,
    "RelativeWorldPosition": _parse_relative_world,
    "RelativeObjectPosition": _parse_relative_object,
    "LanePosition": _parse_lane,
    "RelativeLanePosition": _parse_relative_lane,
    "RoadPosition": _parse_road,
    "RelativeRoadPosition": _parse_relative_road,
    "RoutePosition": _parse_on_route,
}
"""Parsers by element."""


def parse_entity(scope: Scope, element: Element, name: str = "entityRef") -> str:
    """Parse a reference to an entity of the scenario."""
    entity = scope.get(element, name)
    if entity and entity not in scope.findings.entities:
        scope.refuse(element, f"there is no entity '{entity[:40]}'")
    return entity


def count_lanes(lane: int, lanes: int) -> int:
    """Count lanes to the left along the road; there is no lane 0 between the sides."""
    found = lane + lanes
    crosses = (lane > 0) != (found > 0) or found == 0
    return found + (1 if lanes > 0 else -1) if lanes and lane and crosses else found


def find_own_lane(stage: Stage, scope: Scope, element: Element, name: str) -> LanePlace:
    """Find the lane of an entity, which must be on one."""
    place = stage.find_lane(stage.find_pose(scope, element, name))
    if place is None:
        stage.fail(scope, element, f"'{name}' is on no lane at {stage.time_s:g} s")
    return place


def _shift(roads: RoadMap, place: LanePlace, ahead_m: float) -> LanePlace | None:
    """Move ahead, or back, as a place faces; it faces the same way afterwards."""
    if ahead_m >= 0:
        return roads.shift(place, ahead_m, choose_straightest(roads, place))
    turned = place._replace(along=-place.along)
    found = roads.shift(turned, -ahead_m, choose_straightest(roads, turned))
    return None if found is None else found._replace(along=-found.along)


def _get_roads(stage: Stage, scope: Scope, element: Element) -> RoadMap:
    roads = stage.open_map()
    if roads is None:
        stage.fail(scope, element, "the scenario names no map", "give one with `map`")
    return roads


def _place(
    stage: Stage,
    scope: Scope,
    element: Element,
    place: LanePlace,
    orient: Callable[[float], float],
) -> Pose:
    roads = _get_roads(stage, scope, element)
    if not roads.has_lane(place):
        message = (
            f"the map has no lane {place.lane} on road '{place.road}' at {place.station_m:g} m"
        )
        stage.fail(scope, element, message)
    point, ahead = roads.locate(place)
    heading = orient(ahead)
    if math.cos(heading - ahead) < 0:
        place = place._replace(along=-place.along)
    is_across = abs(math.sin(heading - ahead)) > math.sin(math.pi / 4)
    return Pose(point, heading, lane=None if is_across else place)


def _parse_lane_id(scope: Scope, element: Element, name: str) -> int:
    number = scope.get_number(element, name)
    if math.isfinite(number) and (number != int(number) or abs(number) > 1000):
        scope.refuse(element, f'{name}="{number:g}" is no lane')
    return int(number) if math.isfinite(number) and abs(number) <= 1000 else 0


def _parse_orientation(scope: Scope, element: Element) -> Callable[[float], float]:
    """Parse an `<Orientation>` as a function of the heading to which it is relative."""
    orientation = element.find("Orientation")
    if orientation is None:
        return lambda heading: heading
    turned = scope.get_number(orientation, "h", 0.0)
    if scope.get(orientation, "type", "absolute") == "relative":
        return lambda heading: heading + turned
    return lambda heading: turned


def has_heading(position: Element) -> bool:
    """Return whether a `<Position>` says where an entity looks."""
    kind = next(iter(position), None)
    return kind is not None and (
        kind.get("h") is not None or kind.find("Orientation[@h]") is not None
    )


def _turn(heading: float) -> complex:
    return complex(np.exp(1j * heading))
