"""A SUMO network as typed edges, lanes, junctions and links, in world coordinates."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from xml.etree.ElementTree import Element

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from advercity.errors import InputError
from advercity.geometry.mesh import extract_polygons
from advercity.geometry.polyline import Points, offset_polyline

DEFAULT_LANE_WIDTH_M = 3.2
"""Where a network does not say; SUMO's own."""
MIN_POINT_SPACING_M = 0.01


@dataclass(frozen=True, eq=False)
class ImportedLane:
    """A lane.

    Attributes:
        id: SUMO's.
        kind: driving, parking, shoulder, sidewalk, or crossing.
        width_m: From border to border.
        centre: (n, 3) in the direction of travel.
        outline: (m, 3) of a walking area, else None.
    """

    id: str
    kind: str
    width_m: float
    centre: Points
    outline: Points | None = None

    def offset_line(self, lateral_m: float) -> Points:
        """(n, 3) line that far left of the centre."""
        return offset_polyline(self.centre, lateral_m)

    @cached_property
    def left_border(self) -> Points:
        """(n, 3) left border."""
        return self.offset_line(self.width_m / 2)

    @cached_property
    def right_border(self) -> Points:
        """(n, 3) right border."""
        return self.offset_line(-self.width_m / 2)

    def area(self, margin_m: float = 0.0) -> BaseGeometry:
        """What it covers, wider by a margin on both sides."""
        half = self.width_m / 2 + margin_m
        ring = np.vstack([self.offset_line(half), self.offset_line(-half)[::-1]])
        return enclosed_area(ring)


@dataclass(frozen=True, eq=False)
class ImportedEdge:
    """Lanes in one direction, from the right; `junction` for edges inside one."""

    id: str
    function: str
    from_junction: str
    to_junction: str
    junction: str
    lanes: tuple[ImportedLane, ...]

    @cached_property
    def driving_lanes(self) -> tuple[ImportedLane, ...]:
        """Its driving lanes, from the right."""
        return tuple(lane for lane in self.lanes if lane.kind == "driving")


@dataclass(frozen=True, eq=False)
class ImportedJunction:
    """Where edges meet; `outline` (n, 3), empty at the edge of the site."""

    id: str
    kind: str
    outline: Points


@dataclass(frozen=True)
class LaneLink:
    """A way from the lane of one edge to that of another; `state` is SUMO's right of way."""

    from_edge: str
    to_edge: str
    traffic_light: str
    state: str


@dataclass(frozen=True, eq=False)
class ImportedNetwork:
    """A network.

    Attributes:
        edges: Edges between junctions by id.
        internal_edges: Edges inside junctions that are driven.
        crossings: Edges on which people cross.
        walking_areas: Walking areas.
        junctions: By id.
        lane_links: Ways from street to street.
    """

    edges: dict[str, ImportedEdge]
    internal_edges: tuple[ImportedEdge, ...]
    crossings: tuple[ImportedEdge, ...]
    walking_areas: tuple[ImportedEdge, ...]
    junctions: dict[str, ImportedJunction]
    lane_links: tuple[LaneLink, ...]

    def find_opposite_edge(self, edge: ImportedEdge) -> ImportedEdge | None:
        """The street that leads the other way between the same junctions, if there is one."""
        return next(
            (
                other
                for other in self._edges_between.get((edge.to_junction, edge.from_junction), ())
                if other.driving_lanes and edge.driving_lanes and _has_common_border(edge, other)
            ),
            None,
        )

    @cached_property
    def _edges_between(self) -> dict[tuple[str, str], list[ImportedEdge]]:
        found: dict[tuple[str, str], list[ImportedEdge]] = {}
        for edge in self.edges.values():
            found.setdefault((edge.from_junction, edge.to_junction), []).append(edge)
        return found


def _has_common_border(edge: ImportedEdge, other: ImportedEdge) -> bool:
    first, second = (
        shapely.LineString(e.driving_lanes[-1].left_border[:, :2]) for e in (edge, other)
    )
    return bool(first.distance(second.interpolate(0.5, normalized=True)) < DEFAULT_LANE_WIDTH_M / 4)


def parse_network(root: Element) -> ImportedNetwork:
    """The network in a plain network's XML; InputError where numbers are none."""
    try:
        edges = [edge for item in root.iter("edge") if (edge := _parse_edge(item)) is not None]
        junctions = [_parse_junction(item) for item in root.iter("junction")]
        links = tuple(_parse_link(item) for item in root.iter("connection"))
    except (KeyError, ValueError, IndexError) as error:
        raise InputError(f"imported.network: not a SUMO network: {error}") from None
    inside: dict[str, list[ImportedEdge]] = {"internal": [], "crossing": [], "walkingarea": []}
    for edge in edges:
        if edge.function in inside:
            inside[edge.function].append(edge)
    streets = {edge.id: edge for edge in edges if edge.function == "normal"}
    return ImportedNetwork(
        edges=streets,
        internal_edges=tuple(inside["internal"]),
        crossings=tuple(inside["crossing"]),
        walking_areas=tuple(inside["walkingarea"]),
        junctions={item.id: item for item in junctions if item.kind != "internal"},
        lane_links=tuple(
            link for link in links if link.from_edge in streets and link.to_edge in streets
        ),
    )


def _parse_edge(item: Element) -> ImportedEdge | None:
    name, function = item.attrib["id"], item.get("function", "normal")
    lanes = tuple(_parse_lanes(item, function))
    if not lanes:
        return None
    # SUMO names edges inside a junction `:<junction>_<number>`.
    junction = name[1:].rpartition("_")[0] if name.startswith(":") else ""
    return ImportedEdge(name, function, item.get("from", ""), item.get("to", ""), junction, lanes)


def _parse_lanes(item: Element, function: str) -> Iterator[ImportedLane]:
    for lane in sorted(item.iter("lane"), key=lambda lane: int(lane.attrib["index"])):
        shape = parse_shape(lane.attrib["shape"])
        width = float(lane.get("width", DEFAULT_LANE_WIDTH_M))
        if function == "walkingarea":
            yield ImportedLane(lane.attrib["id"], "sidewalk", width, shape, outline=shape)
        elif len(centre := _drop_repeated_points(shape)) > 1:
            yield ImportedLane(lane.attrib["id"], _lane_kind(lane, function), width, centre)


def _lane_kind(lane: Element, function: str) -> str:
    if function == "crossing":
        return "crossing"
    allowed = lane.get("allow", "").split()
    forbidden = set(lane.get("disallow", "").split())
    if allowed == ["pedestrian"]:
        return "sidewalk"
    if "passenger" in allowed or not (allowed or {"all", "passenger"} & forbidden):
        return "driving"
    return "parking" if lane.get("type") == "parking" else "shoulder"


def _parse_junction(item: Element) -> ImportedJunction:
    return ImportedJunction(
        item.attrib["id"], item.get("type", ""), parse_shape(item.get("shape", ""))
    )


def _parse_link(item: Element) -> LaneLink:
    return LaneLink(
        item.attrib["from"], item.attrib["to"], item.get("tl", ""), item.get("state", "M")
    )


def parse_shape(shape: str) -> Points:
    """Points (n, 3) of a SUMO shape, z 0 where it has none."""
    numbers = [[float(value) for value in point.split(",")] for point in shape.split()]
    found = np.array([(*point, 0.0)[:3] for point in numbers], dtype=np.float64).reshape(-1, 3)
    if not np.isfinite(found).all():
        raise ValueError(f"'{shape[:60]}' is not finite")
    return found


def enclosed_area(ring: Points) -> BaseGeometry:
    """Area within a ring (n, 2 or 3), however it is wound or crosses itself."""
    valid = shapely.make_valid(shapely.Polygon(ring[:, :2]))
    return shapely.union_all(extract_polygons(valid))


def _drop_repeated_points(line: Points) -> Points:
    steps = np.linalg.norm(np.diff(line[:, :2], axis=0), axis=1)
    return line[np.concatenate([[True], steps > MIN_POINT_SPACING_M])]
