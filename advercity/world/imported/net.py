"""A SUMO network as typed edges, lanes, junctions and links, in world coordinates."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from xml.etree.ElementTree import Element

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from advercity.curves import Points, left_of
from advercity.errors import InputError
from advercity.world.meshing import polygons_of

LANE_WIDTH_M = 3.2
"""Where a network does not say; SUMO's own."""
REPEAT_M = 0.01
MITRE_LIMIT = 2.0


@dataclass(frozen=True, eq=False)
class NetLane:
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

    def beside(self, left_m: float) -> Points:
        """(n, 3) line that far left of the centre."""
        return beside(self.centre, left_m)

    @cached_property
    def left(self) -> Points:
        """(n, 3) left border."""
        return self.beside(self.width_m / 2)

    @cached_property
    def right(self) -> Points:
        """(n, 3) right border."""
        return self.beside(-self.width_m / 2)

    def area(self, margin_m: float = 0.0) -> BaseGeometry:
        """What it covers, wider by a margin on both sides."""
        half = self.width_m / 2 + margin_m
        ring = np.vstack([self.beside(half), self.beside(-half)[::-1]])
        return enclosed(ring)


@dataclass(frozen=True, eq=False)
class NetEdge:
    """Lanes in one direction, from the right; `junction` for edges inside one."""

    id: str
    function: str
    begins: str
    ends: str
    junction: str
    lanes: tuple[NetLane, ...]

    @cached_property
    def driving(self) -> tuple[NetLane, ...]:
        """Its driving lanes, from the right."""
        return tuple(lane for lane in self.lanes if lane.kind == "driving")


@dataclass(frozen=True, eq=False)
class NetJunction:
    """Where edges meet; `outline` (n, 3), empty at the edge of the site."""

    id: str
    kind: str
    outline: Points


@dataclass(frozen=True)
class Link:
    """A way from the lane of one edge to that of another; `state` is SUMO's right of way."""

    from_edge: str
    to_edge: str
    light: str
    state: str


@dataclass(frozen=True, eq=False)
class Net:
    """A network.

    Attributes:
        streets: Edges between junctions by id.
        ways: Edges inside junctions that are driven.
        crossings: Edges on which people cross.
        corners: Walking areas.
        junctions: By id.
        links: Ways from street to street.
    """

    streets: dict[str, NetEdge]
    ways: tuple[NetEdge, ...]
    crossings: tuple[NetEdge, ...]
    corners: tuple[NetEdge, ...]
    junctions: dict[str, NetJunction]
    links: tuple[Link, ...]

    def opposite(self, edge: NetEdge) -> NetEdge | None:
        """The street that leads the other way between the same junctions, if there is one."""
        return next(
            (
                other
                for other in self._between.get((edge.ends, edge.begins), ())
                if other.driving and edge.driving and _share_border(edge, other)
            ),
            None,
        )

    @cached_property
    def _between(self) -> dict[tuple[str, str], list[NetEdge]]:
        found: dict[tuple[str, str], list[NetEdge]] = {}
        for edge in self.streets.values():
            found.setdefault((edge.begins, edge.ends), []).append(edge)
        return found


def _share_border(edge: NetEdge, other: NetEdge) -> bool:
    first, second = (shapely.LineString(e.driving[-1].left[:, :2]) for e in (edge, other))
    return bool(first.distance(second.interpolate(0.5, normalized=True)) < LANE_WIDTH_M / 4)


def read_net(root: Element) -> Net:
    """The network in a plain network's XML; InputError where numbers are none."""
    try:
        edges = [edge for item in root.iter("edge") if (edge := _edge(item)) is not None]
        junctions = [_junction(item) for item in root.iter("junction")]
        links = tuple(_link(item) for item in root.iter("connection"))
    except (KeyError, ValueError, IndexError) as error:
        raise InputError(f"imported.network: not a SUMO network: {error}") from None
    inside: dict[str, list[NetEdge]] = {"internal": [], "crossing": [], "walkingarea": []}
    for edge in edges:
        if edge.function in inside:
            inside[edge.function].append(edge)
    streets = {edge.id: edge for edge in edges if edge.function == "normal"}
    return Net(
        streets=streets,
        ways=tuple(inside["internal"]),
        crossings=tuple(inside["crossing"]),
        corners=tuple(inside["walkingarea"]),
        junctions={item.id: item for item in junctions if item.kind != "internal"},
        links=tuple(
            link for link in links if link.from_edge in streets and link.to_edge in streets
        ),
    )


def _edge(item: Element) -> NetEdge | None:
    name, function = item.attrib["id"], item.get("function", "normal")
    lanes = tuple(_lanes(item, function))
    if not lanes:
        return None
    # SUMO names edges inside a junction `:<junction>_<number>`.
    junction = name[1:].rpartition("_")[0] if name.startswith(":") else ""
    return NetEdge(name, function, item.get("from", ""), item.get("to", ""), junction, lanes)


def _lanes(item: Element, function: str) -> Iterator[NetLane]:
    for lane in sorted(item.iter("lane"), key=lambda lane: int(lane.attrib["index"])):
        shape = points(lane.attrib["shape"])
        width = float(lane.get("width", LANE_WIDTH_M))
        if function == "walkingarea":
            yield NetLane(lane.attrib["id"], "sidewalk", width, shape, outline=shape)
        elif len(centre := _without_repeats(shape)) > 1:
            yield NetLane(lane.attrib["id"], _kind(lane, function), width, centre)


def _kind(lane: Element, function: str) -> str:
    if function == "crossing":
        return "crossing"
    allowed = lane.get("allow", "").split()
    forbidden = set(lane.get("disallow", "").split())
    if allowed == ["pedestrian"]:
        return "sidewalk"
    if "passenger" in allowed or not (allowed or {"all", "passenger"} & forbidden):
        return "driving"
    return "parking" if lane.get("type") == "parking" else "shoulder"


def _junction(item: Element) -> NetJunction:
    return NetJunction(item.attrib["id"], item.get("type", ""), points(item.get("shape", "")))


def _link(item: Element) -> Link:
    return Link(item.attrib["from"], item.attrib["to"], item.get("tl", ""), item.get("state", "M"))


def points(shape: str) -> Points:
    """Points (n, 3) of a SUMO shape, z 0 where it has none."""
    numbers = [[float(value) for value in point.split(",")] for point in shape.split()]
    found = np.array([(*point, 0.0)[:3] for point in numbers], dtype=np.float64).reshape(-1, 3)
    if not np.isfinite(found).all():
        raise ValueError(f"'{shape[:60]}' is not finite")
    return found


def enclosed(ring: Points) -> BaseGeometry:
    """Area within a ring (n, 2 or 3), however it is wound or crosses itself."""
    valid = shapely.make_valid(shapely.Polygon(ring[:, :2]))
    return shapely.union_all(polygons_of(valid))


def _without_repeats(line: Points) -> Points:
    steps = np.linalg.norm(np.diff(line[:, :2], axis=0), axis=1)
    return line[np.concatenate([[True], steps > REPEAT_M])]


def beside(line: Points, left_m: float) -> Points:
    """Line (n, 3) moved to the left, its corners mitred."""
    steps = np.diff(line[:, :2], axis=0)
    normals = left_of(steps / np.linalg.norm(steps, axis=1, keepdims=True))
    before, after = np.vstack([normals[:1], normals]), np.vstack([normals, normals[-1:]])
    middle = before + after
    squared = np.maximum((middle**2).sum(axis=1, keepdims=True), 4 / MITRE_LIMIT**2)
    return np.column_stack([line[:, :2] + left_m * 2 * middle / squared, line[:, 2]])
