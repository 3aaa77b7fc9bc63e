"""The SUMO network of an OpenDRIVE map, as plain XML for netconvert.

Every street is an edge in each direction. A node where only lanes, limits or names change has no
right of way and no crossing.
"""

import re
from collections.abc import Iterator
from xml.etree.ElementTree import Element

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from advercity.foreign.ledger import Ledger
from advercity.geometry.polyline import Points, left_normals, polyline_length, simplify_together
from advercity.roads.map_plan import LaneLines, LaneLink
from advercity.roads.opendrive.document import OpenDriveMap
from advercity.roads.opendrive.reference_line import sample_offset_points
from advercity.roads.opendrive.topology import (
    MapTopology,
    build_topology,
    list_end_points,
)
from advercity.roads.opendrive.traffic_lights import find_signalled_junctions
from advercity.roads.plain_edges import (
    LaneKey,
    add_edge,
    add_node,
    build_connections,
    build_lane_lines,
    list_lane_lines,
)
from advercity.roads.plain_network import PlainNetwork

PLAIN_ID = re.compile(r"[A-Za-z0-9_]{1,40}")
PATH_TOLERANCE_M = 0.01
"""Largest distance between a border in a junction and its polyline."""
MIN_PATH_M = 0.1
"""Shorter ways through junctions have no lane."""
OUTLINE_TOLERANCE_M = 0.02
OUTLINE_KINDS = {"driving": "roadway", "shoulder": "roadway", "sidewalk": "sidewalk"}
"""Kinds of outlines by paving of a lane."""


def build_plain_network(
    document: OpenDriveMap, extent: BaseGeometry | None, ledger: Ledger
) -> PlainNetwork:
    """Build the network of a map; streets entirely outside an extent are left out.

    Raises:
        InputError: A lane is wider than any.
    """
    topology = build_topology(document, extent, ledger)
    nodes = _Nodes(document, topology)
    return PlainNetwork(
        nodes=nodes.build(),
        edges=_build_edges(topology, nodes),
        connections=build_connections(
            _list_paths(topology), topology.edges, nodes.list_uncrossed()
        ),
        names={
            name: edge.street.name or f"road {edge.street.road}"
            for name, edge in topology.edges.items()
        },
        lanes={
            key: lines
            for name, edge in topology.edges.items()
            for key, lines in list_lane_lines(name, edge.lanes)
        },
        paths=dict(_list_path_lines(topology)),
        outlines=list(_list_outlines(document, topology, extent)),
        crosswalks=list(_list_crosswalks(document)),
    )


class _Nodes:
    """Names and writes the nodes at the ends of edges."""

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
        """List the nodes without pedestrian crossings."""
        return (name for group, name in self._names.items() if group not in self._crossed)

    def build(self) -> Element:
        """Build the document of nodes."""
        root = Element("nodes")
        for group, corners in self._corners.items():
            kind = "traffic_light" if self._junctions.get(group) in self._governed else "priority"
            is_crossed = group in self._crossed
            add_node(root, self._names[group], kind, corners, is_crossed=is_crossed)
        return root

    def _name(self, group: object, number: int) -> str:
        junction = self._junctions.get(group)
        if junction is None:
            return f"{number}.0"
        return junction if PLAIN_ID.fullmatch(junction) else f"{number}.1"


def _build_edges(topology: MapTopology, nodes: _Nodes) -> Element:
    root = Element("edges")
    for name, edge in topology.edges.items():
        ends = nodes.get_name(edge.begins), nodes.get_name(edge.ends)
        add_edge(root, name, ends, edge.lanes)
    return root


def _list_paths(topology: MapTopology) -> Iterator[tuple[LaneKey, LaneKey, Points | None]]:
    """List connections between lanes of edges within the extent, and their middles."""
    paths = [
        (it.origin, it.target, None if it.borders is None else it.borders.mean(axis=0))
        for it in topology.paths
    ]
    links = [(origin, target, None) for origin, target in topology.list_lane_links()]
    for origin, target, centre in (*paths, *links):
        first, second = (topology.lanes.get((end.stretch, lane)) for end, lane in (origin, target))
        if first is not None and second is not None:
            yield first, second, centre


def _list_path_lines(topology: MapTopology) -> Iterator[tuple[LaneLink, LaneLines]]:
    for path in topology.paths:
        origin, target = (
            topology.lanes.get((end.stretch, lane)) for end, lane in (path.origin, path.target)
        )
        if path.borders is not None and origin and target:
            borders = path.borders[:, _find_advancing(path.borders)]
            left, right = borders[:, simplify_together(list(borders), PATH_TOLERANCE_M)]
            if polyline_length((left + right) / 2) > MIN_PATH_M:
                yield (*origin, *target), build_lane_lines(left, right)


def _find_advancing(borders: Points) -> NDArray[np.int64]:
    """Find the points (indices) of borders (2, n, 3) ahead of the points before them.

    Lanes beside a reference line with kinks run back and forth.
    """
    left, right = borders[..., :2]
    ahead, middle = left_normals(right - left), (left + right) / 2
    kept = [0]
    for index in range(1, len(middle)):
        if (middle[index] - middle[kept[-1]]) @ ahead[index] > 0:
            kept.append(index)
    last = len(middle) - 1
    while len(kept) > 1 and (middle[last] - middle[kept[-1]]) @ ahead[last] <= 0:
        kept.pop()
    return np.array(kept if kept[-1] == last else [*kept, last])


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
