"""Nodes, edges and connections of SUMO's plain XML, from lanes with their borders in space."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import shapely

from advercity.geometry.polyline import (
    Points,
    drop_repeated_points,
    offset_polyline,
    polyline_length,
    polyline_stations,
)
from advercity.roads.lane_uses import LaneUse
from advercity.roads.map_plan import LaneLines
from advercity.roads.sumo_xml import format_metres, format_shape

BORDER_TOLERANCE_M = 0.005
"""Borders given as exactly by SUMO's line and width are not written."""
EDGE_PRIORITY = 1
TOUCH_M = 0.02
"""Half the thickness of a node where streets touch."""
LaneKey = tuple[str, int]
"""Edge and index of a lane."""


@dataclass(frozen=True, eq=False)
class PlainLane:
    """A lane between its borders.

    Attributes:
        use: Who may use it.
        speed_m_s: Its limit.
        left: Left border (n, 3).
        right: Right border (n, 3), with a point opposite each of the left one.
    """

    use: LaneUse
    speed_m_s: float
    left: Points
    right: Points

    @property
    def centre(self) -> Points:
        """Its middle (n, 3)."""
        return (self.left + self.right) / 2


def measure_usual_width(left: Points, right: Points) -> float:
    """Measure the median width of a lane between two borders (n, 3)."""
    stations = polyline_stations((left + right) / 2)
    widths = np.linalg.norm(left - right, axis=1)
    even = np.linspace(0.0, stations[-1], 101)
    return max(float(np.median(np.interp(even, stations, widths))), 0.1)


def build_lane_lines(left: Points, right: Points) -> LaneLines:
    """Build the lines of a lane, without borders if its middle and usual width give them."""
    centre, width_m = (left + right) / 2, measure_usual_width(left, right)
    if len(drop_repeated_points(centre[:, :2])) == len(centre):
        sides = ((left, width_m / 2), (right, -width_m / 2))
        gaps = [np.abs(offset_polyline(centre, aside) - line).max() for line, aside in sides]
        if max(gaps) < BORDER_TOLERANCE_M:
            return LaneLines(centre, width_m, ())
    return LaneLines(centre, width_m, (left, right))


def add_node(
    root: Element, name: str, kind: str, corners: Sequence[Points], *, is_crossed: bool
) -> Element:
    """Add a node around the corners (3,) of lanes; where none is crossed, streets only touch."""
    middle = np.mean(corners, axis=0)
    place = {axis: format_metres(value) for axis, value in zip("xyz", middle, strict=True)}
    item = SubElement(root, "node", {"id": name, "type": kind, **place})
    # Without an outline netconvert cuts metres off the lanes to make room for one.
    hull = shapely.MultiPoint(np.array(corners)[:, :2]).convex_hull
    if not is_crossed:
        hull = shapely.buffer(hull, TOUCH_M, cap_style="flat", join_style="mitre")
    if isinstance(hull, shapely.Polygon):
        item.set("shape", format_shape(shapely.get_coordinates(hull)[:-1]))
    return item


def add_edge(
    root: Element,
    name: str,
    ends: tuple[str, str],
    lanes: Sequence[PlainLane],
    priority: int = EDGE_PRIORITY,
) -> None:
    """Add an edge between two nodes, with its lanes from the right."""
    driven = [polyline_length(lane.centre) for lane in lanes if not lane.use.is_closed]
    length_m = float(np.mean(driven or [polyline_length(lanes[0].centre)]))
    attributes = {
        "id": name,
        "from": ends[0],
        "to": ends[1],
        "priority": str(priority),
        "speed": format_metres(max(lane.speed_m_s for lane in lanes)),
        "length": format_metres(max(length_m, 0.1)),
        "numLanes": str(len(lanes)),
        "spreadType": "right",
        "shape": format_shape(lanes[-1].left),
    }
    item = SubElement(root, "edge", attributes)
    for index, lane in enumerate(lanes):
        permission, classes = lane.use.permission
        values = {
            "index": str(index),
            permission: classes,
            "speed": format_metres(lane.speed_m_s),
            "width": format_metres(measure_usual_width(lane.left, lane.right)),
            "shape": format_shape(lane.centre),
            "type": lane.use.paving,
        }
        SubElement(item, "lane", values)


def list_lane_lines(name: str, lanes: Iterable[PlainLane]) -> Iterator[tuple[str, LaneLines]]:
    """List the lines of an edge's lanes by SUMO's id."""
    for index, lane in enumerate(lanes):
        yield f"{name}_{index}", build_lane_lines(lane.left, lane.right)


def build_connections(
    paths: Iterable[tuple[LaneKey, LaneKey, Points | None]],
    edges: Iterable[str],
    uncrossed: Iterable[str],
) -> Element:
    """Build the document of connections.

    Args:
        paths: The lane each leaves, the lane it enters, and its middle (n, 3) through a junction,
            if any; of equal ones, the first is taken.
        edges: Names of all edges.
        uncrossed: Names of the nodes without paths for pedestrians to cross.
    """
    root = Element("connections")
    connected: set[str] = set()
    seen: set[tuple[LaneKey, LaneKey]] = set()
    for origin, target, centre in paths:
        if origin[0] == target[0] or (origin, target) in seen:
            continue
        seen.add((origin, target))
        connected.add(origin[0])
        values = {"from": origin[0], "to": target[0]}
        values |= {"fromLane": str(origin[1]), "toLane": str(target[1])}
        line = None if centre is None else drop_repeated_points(centre)
        if line is not None and len(line) > 1:
            values["shape"] = format_shape(line)
        SubElement(root, "connection", values)
    # netconvert invents connections for edges without any, unless told otherwise.
    for name in edges:
        if name not in connected:
            SubElement(root, "connection", {"from": name})
    for name in uncrossed:
        SubElement(root, "crossing", {"node": name, "discard": "true"})
    return root
