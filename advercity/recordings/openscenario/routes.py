"""Routes: which roads of a map lead over their waypoints."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from xml.etree.ElementTree import Element

from advercity.recordings.openscenario.document import Scope
from advercity.recordings.openscenario.road_map import LanePlace
from advercity.recordings.openscenario.stage import Mover, Pose, Stage

Position = Callable[[Stage], Pose]
"""A place, found when it is needed."""


@dataclass(frozen=True)
class Route:
    """The waypoints of a route."""

    scope: Scope
    element: Element
    places: Sequence[Position]

    def find_roads(self, stage: Stage, mover: Mover | None = None) -> tuple[str, ...]:
        """Find the roads of the route, from where an entity is, if it is somewhere.

        Raises:
            DiagnosticsError: A place is on no lane, or no roads lead to it.
        """
        roads = stage.open_map()
        places = [find(stage) for find in self.places]
        if mover is not None and mover.pose is not None:
            places.insert(0, mover.pose)
        lanes = [self._find_lane(stage, pose) for pose in places]
        if roads is None or not lanes:
            stage.fail(self.scope, self.element, "has no waypoint, or the scenario no map")
        path = [lanes[0].road]
        own = lanes[0]
        for goal in lanes[1:]:
            if goal.road not in path:
                further = roads.find_path(own, goal)
                if further is None:
                    message = f"no roads lead to the waypoint on road '{goal.road}'"
                    stage.fail(self.scope, self.element, message)
                path += further
            own = goal
        return tuple(path)

    def find_begin(self, stage: Stage) -> LanePlace:
        """Find the place of the first waypoint."""
        return self._find_lane(stage, self.places[0](stage))

    def _find_lane(self, stage: Stage, pose: Pose) -> LanePlace:
        lane = stage.find_lane(pose)
        if lane is None:
            stage.fail(self.scope, self.element, "the entity or a waypoint is on no lane")
        return lane


def parse_route(
    scope: Scope,
    parent: Element,
    parse_position: Callable[[Scope, Element], Position | None],
) -> Route | None:
    """Parse the route in an element, or in its catalogue."""
    found = scope.resolve(parent, "Route")
    if found is None:
        return None
    inner, element = found
    # A route of a catalogue over itself would have no end.
    nested = element.find("Waypoint/Position/RoutePosition")
    if nested is not None:
        inner.refuse(nested, "a waypoint is on another route", "give it as a <LanePosition>")
        return None
    places = [parse_position(inner, waypoint) for waypoint in element.iterfind("Waypoint")]
    return Route(inner, element, [place for place in places if place is not None])
