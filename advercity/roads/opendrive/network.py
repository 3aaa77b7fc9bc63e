"""The SUMO network of an OpenDRIVE map, as plain XML that netconvert compiles.

Every street is an edge in each direction. A node where only lanes, limits or names change has no
right of way and no crossing.
"""

import re
from collections.abc import Iterator
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from advercity.geometry.polyline import (
    Points,
    drop_repeated_points,
    offset_polyline,
    polyline_length,
    polyline_stations,
)
from advercity.roads.map_plan import LaneLines
from advercity.roads.opendrive.chains import StreetLane, simplify_together
from advercity.roads.opendrive.document import OpenDriveMap
from advercity.roads.opendrive.paths import LaneEnd
from advercity.roads.opendrive.reference_line import sample_offset_points
from advercity.roads.opendrive.topology import (
    MapTopology,
    build_topology,
    list_end_points,
)
from advercity.roads.opendrive.traffic_lights import find_signalled_junctions
from advercity.roads.plain_network import PlainNetwork
from advercity.roads.sumo_xml import format_metres, format_shape

PLAIN_ID = re.compile(r"[A-Za-z0-9_]{1,40}")
BORDER_TOLERANCE_M = 0.005
"""Borders that SUMO's line and width give as exactly are not written."""
OUTLINE_TOLERANCE_M = 0.02
OUTLINE_KINDS = {"driving": "roadway", "shoulder": "roadway", "sidewalk": "sidewalk"}
"""Kinds of outlines by paving of a lane."""
EDGE_PRIORITY = "1"
TOUCH_M = 0.02
"""Half the thickness of a node where streets touch."""


def build_plain_network(document: OpenDriveMap, extent: BaseGeometry | None) -> PlainNetwork:
    """Build the network of a map; streets entirely outside an extent are left out.

    Raises:
        InputError: A lane is wider than any.
    """
    topology = build_topology(document, extent)
    nodes = _Nodes(document, topology)
    return PlainNetwork(
        nodes=nodes.build(),
        edges=_build_edges(topology, nodes),
        connections=_build_connections(topology, nodes),
        names={
            name: edge.street.name or f"road {edge.street.road}"
            for name, edge in topology.edges.items()
        },
        lanes=dict(_list_lines(topology)),
        outlines=list(_list_outlines(document, topology, extent)),
        crosswalks=list(_list_crosswalks(document)),
    )


class _Nodes:
    """Names and writes the nodes that edges begin and end at."""

    def __init__(self, document: OpenDriveMap, topology: MapTopology) -> None:
        self._document = document
        self._groups = topology.groups
        self._junctions = {topology.groups.find(name): name for name in document.junctions}
        self._corners: dict[object, list[Points]] = {}
        for edge in topology.edges.values():
            for end, at_end in ((edge.begins, False), (edge.ends, True)):
                group = self._groups.find(end)
                corners = self._corners.setdefault(group, [])
                corners += list_end_points(edge, at_end=at_end)
        numbers = {group: number for number, group in enumerate(self._corners)}
        self._names = {group: self._name(group, number) for group, number in numbers.items()}
        self._governed = find_signalled_junctions(document)
        # Where roads touch directly, no traffic crosses any other.
        self._crossed = {
            topology.groups.find(path.junction) for path in topology.paths if path.road
        }

    def get_name(self, end: object) -> str:
        """Return the name of the node at an end of a stretch."""
        return self._names[self._groups.find(end)]

    def list_uncrossed(self) -> Iterator[str]:
        """List the nodes where pedestrians cross nothing."""
        return (name for group, name in self._names.items() if group not in self._crossed)

    def build(self) -> Element:
        """Build the document of nodes."""
        root = Element("nodes")
        for group, corners in self._corners.items():
            middle = np.mean(corners, axis=0)
            place = {axis: format_metres(value) for axis, value in zip("xyz", middle, strict=True)}
            kind = "traffic_light" if self._junctions.get(group) in self._governed else "priority"
            item = SubElement(root, "node", {"id": self._names[group], "type": kind, **place})
            # Without an outline netconvert cuts metres off the lanes to make room for one.
            hull = shapely.MultiPoint(np.array(corners)[:, :2]).convex_hull
            if group not in self._crossed:
                hull = shapely.buffer(hull, TOUCH_M, cap_style="flat", join_style="mitre")
            if isinstance(hull, shapely.Polygon):
                item.set("shape", format_shape(shapely.get_coordinates(hull)[:-1]))
        return root

    def _name(self, group: object, number: int) -> str:
        junction = self._junctions.get(group)
        if junction is None:
            return f"{number}.0"
        return junction if PLAIN_ID.fullmatch(junction) else f"{number}.1"


def _build_edges(topology: MapTopology, nodes: _Nodes) -> Element:
    root = Element("edges")
    for name, edge in topology.edges.items():
        driven = [
            polyline_length(_centre(lane)) for lane in edge.lanes if not lane.use.is_closed
        ] or [polyline_length(_centre(edge.lanes[0]))]
        attributes = {
            "id": name,
            "from": nodes.get_name(edge.begins),
            "to": nodes.get_name(edge.ends),
            "priority": EDGE_PRIORITY,
            "speed": format_metres(max(lane.speed_m_s for lane in edge.lanes)),
            "length": format_metres(max(float(np.mean(driven)), 0.1)),
            "numLanes": str(len(edge.lanes)),
            "spreadType": "right",
            "shape": format_shape(edge.lanes[-1].left),
        }
        item = SubElement(root, "edge", attributes)
        for index, lane in enumerate(edge.lanes):
            permission, classes = lane.use.permission
            values = {
                "index": str(index),
                permission: classes,
                "speed": format_metres(lane.speed_m_s),
                "width": format_metres(_find_usual_width(lane)),
                "shape": format_shape(_centre(lane)),
                "type": lane.use.paving,
            }
            SubElement(item, "lane", values)
    return root


def _centre(lane: StreetLane) -> Points:
    return (lane.left + lane.right) / 2


def _find_usual_width(lane: StreetLane) -> float:
    """Find the width that half of the lane is wider than."""
    stations = polyline_stations(_centre(lane))
    widths = np.linalg.norm(lane.left - lane.right, axis=1)
    even = np.linspace(0.0, stations[-1], 101)
    return max(float(np.median(np.interp(even, stations, widths))), 0.1)


def _build_connections(topology: MapTopology, nodes: _Nodes) -> Element:
    root = Element("connections")
    connected: set[str] = set()
    seen: set[tuple[tuple[str, int], tuple[str, int]]] = set()

    def add(origin: LaneEnd, target: LaneEnd, centre: Points | None) -> None:
        ends = [topology.lanes.get((end.stretch, lane)) for end, lane in (origin, target)]
        if ends[0] is None or ends[1] is None or (ends[0], ends[1]) in seen:
            return
        (first, from_lane), (second, to_lane) = ends[0], ends[1]
        if first == second:
            return
        seen.add((ends[0], ends[1]))
        connected.add(first)
        values = {"from": first, "to": second, "fromLane": str(from_lane), "toLane": str(to_lane)}
        if centre is not None and len(centre) > 1:
            values["shape"] = format_shape(centre)
        SubElement(root, "connection", values)

    for path in topology.paths:
        add(path.origin, path.target, drop_repeated_points(path.centre) if path.road else None)
    for origin, target in topology.list_lane_links():
        add(origin, target, None)
    # netconvert invents connections for edges that have none, unless it is told so.
    for name in topology.edges:
        if name not in connected:
            SubElement(root, "connection", {"from": name})
    for name in nodes.list_uncrossed():
        SubElement(root, "crossing", {"node": name, "discard": "true"})
    return root


def _list_lines(topology: MapTopology) -> Iterator[tuple[str, LaneLines]]:
    for name, edge in topology.edges.items():
        for index, lane in enumerate(edge.lanes):
            borders = () if _has_plain_borders(lane) else (lane.left, lane.right)
            yield f"{name}_{index}", LaneLines(_centre(lane), borders)


def _has_plain_borders(lane: StreetLane) -> bool:
    """Whether the lane's middle and its usual width give its borders."""
    centre, half = _centre(lane), _find_usual_width(lane) / 2
    if len(drop_repeated_points(centre[:, :2])) < len(centre):
        return False
    sides = ((lane.left, half), (lane.right, -half))
    gaps = [np.abs(offset_polyline(centre, aside) - line).max() for line, aside in sides]
    return max(gaps) < BORDER_TOLERANCE_M


def _list_outlines(
    document: OpenDriveMap, topology: MapTopology, extent: BaseGeometry | None
) -> Iterator[tuple[str, Points]]:
    for stretch in topology.stretches:
        if not document.is_connecting(stretch.road):
            continue
        for ribbon in stretch.ribbons.values():
            kind = OUTLINE_KINDS.get(ribbon.use.paving)
            kept = simplify_together([ribbon.left, ribbon.right], OUTLINE_TOLERANCE_M)
            ring = np.vstack([ribbon.left[kept], ribbon.right[kept][::-1]])
            if kind and (extent is None or extent.intersects(shapely.Polygon(ring[:, :2]))):
                yield kind, ring


def _list_crosswalks(document: OpenDriveMap) -> Iterator[tuple[float, float]]:
    for road in document.roads.values():
        for walk in road.crosswalks:
            at, aside = np.array([walk.station_m]), np.array([[walk.left_m]])
            x, y, _ = sample_offset_points(road, at, aside)[0, 0]
            yield float(x), float(y)
