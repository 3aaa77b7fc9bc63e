"""SUMO networks (`.net.xml`): their edges, lanes, junctions and connections, in file order.

This is the only reader of such files. `docs/decisions/0018-one-network-reader.md` says why it is
not `sumolib`.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
import shapely
from advercity_dsl.road import RoadMark
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from advercity.errors import InputError, RunError
from advercity.geometry.mesh import extract_polygons
from advercity.geometry.polyline import Points, StationedPolyline, offset_polyline
from advercity.roads.streets import approach_name, name_crossing_signal
from advercity.roads.sumo_xml import BORDER_ATTRIBUTES, unpack_network

MAX_LANE_WIDTH_M = 100.0
"""Wider is no lane."""
DEFAULT_LANE_WIDTH_M = 3.2
"""SUMO's own width of a lane without a declared one."""
MIN_POINT_SPACING_M = 0.01
"""Closer points of a centre line in the plan would give its borders random directions."""

STRIPE_MARKS = frozenset(RoadMark)
"""Types of polygons for painted lines; others are paving."""
CLOSED_KINDS = {"parking": "parking", "curb": "sidewalk"}
"""Kinds of lanes closed to cars, by type; the others are shoulders."""


@dataclass(frozen=True, eq=False)
class SumoLane:
    """One lane of the network, those inside junctions included.

    Attributes:
        id: SUMO's id, `<edge>_<index>`.
        edge: Id of its edge.
        index: Position in its edge, counted from the right.
        function: `normal`, `internal`, `crossing` or `walkingarea`.
        length_m: Length for SUMO's positions; it may differ a little from the shape's.
        speed_limit_m_s: Limit of the lane.
        shape: (n, 3) centre line in the direction of travel, metres; outline of a walking area.
        width_m: Distance between its borders.
        type: SUMO's type of lane, if the file has one.
        allowed_classes: Allowed vehicle classes; None if all are.
        disallowed_classes: Forbidden vehicle classes.
        borders: Left and right border, a point (3,) of each beside every point of `shape`, where
            they are not parallel to it; else None.
    """

    id: str
    edge: str
    index: int
    function: str
    length_m: float
    speed_limit_m_s: float
    shape: NDArray[np.float64]
    width_m: float
    type: str
    allowed_classes: frozenset[str] | None
    disallowed_classes: frozenset[str]
    borders: tuple[Points, Points] | None = None

    def permits(self, vehicle_class: str) -> bool:
        """Whether a SUMO vehicle class may use this lane."""
        if self.allowed_classes is not None:
            return vehicle_class in self.allowed_classes
        return not {vehicle_class, "all"} & self.disallowed_classes

    @property
    def is_sidewalk(self) -> bool:
        """Whether it lies between junctions and is for pedestrians but not for cars."""
        permitted = self.permits("pedestrian") and not self.permits("passenger")
        return self.function == "normal" and permitted

    @property
    def is_driving_lane(self) -> bool:
        """Whether it lies between junctions and is open to cars."""
        return self.function == "normal" and self.permits("passenger")

    @property
    def kind(self) -> str:
        """Its kind in annotations: driving, parking, shoulder, sidewalk or crossing."""
        if self.function == "crossing":
            return "crossing"
        if self.function == "walkingarea" or self.allowed_classes == frozenset({"pedestrian"}):
            return "sidewalk"
        if self.permits("passenger"):
            return "driving"
        return CLOSED_KINDS.get(self.type, "shoulder")

    @cached_property
    def line(self) -> StationedPolyline:
        """The centre line, with SUMO's positions from 0 to `length_m` as stations."""
        return StationedPolyline.from_points(self.shape, length_m=self.length_m)

    @cached_property
    def _is_own_point(self) -> NDArray[np.bool_]:
        """Whether points (n,) of the shape do not repeat the one before in the plan."""
        steps = np.linalg.norm(np.diff(self.shape[:, :2], axis=0), axis=1)
        return np.concatenate([[True], steps > MIN_POINT_SPACING_M])

    @cached_property
    def centre(self) -> Points:
        """(n, 3) centre line without repeated points in the plan."""
        return self.shape[self._is_own_point]

    def compute_border(self, *, on_left: bool, outward_m: float = 0.0) -> Points:
        """Compute a border (n, 3), or the line `outward_m` outside it."""
        side = 1.0 if on_left else -1.0
        if self.borders is None:
            return offset_polyline(self.centre, side * (self.width_m / 2 + outward_m))
        border = self.borders[0 if on_left else 1][self._is_own_point]
        moved = offset_polyline(self.centre, side * outward_m) - self.centre
        return border + moved

    @cached_property
    def left_border(self) -> Points:
        """(n, 3) left border."""
        return self.compute_border(on_left=True)

    @cached_property
    def right_border(self) -> Points:
        """(n, 3) right border."""
        return self.compute_border(on_left=False)

    def build_area(self, margin_m: float = 0.0) -> BaseGeometry:
        """Build the area between its borders, wider by a margin on both sides."""
        left = self.compute_border(on_left=True, outward_m=margin_m)
        right = self.compute_border(on_left=False, outward_m=margin_m)
        area = shapely.Polygon(np.vstack([left, right[::-1]])[:, :2])
        if area.is_valid:
            return area
        # In a ring over itself, areas enclosed twice would be lost.
        quads = np.stack([left[:-1], left[1:], right[1:], right[:-1]], axis=1)[:, :, :2]
        return shapely.union_all([build_enclosed_area(quad) for quad in quads])


@dataclass(frozen=True, eq=False)
class SumoEdge:
    """Lanes side by side in one direction, from the right."""

    id: str
    function: str
    """`normal`, `internal`, `crossing` or `walkingarea`."""
    from_junction: str
    to_junction: str
    lanes: tuple[SumoLane, ...]
    crossed_edges: tuple[str, ...] = ()

    @property
    def junction(self) -> str:
        """Id of its junction; empty for edges between junctions."""
        # SUMO names edges inside a junction `:<junction>_<number>`.
        return self.id[1:].rpartition("_")[0] if self.id.startswith(":") else ""

    @cached_property
    def driving_lanes(self) -> tuple[SumoLane, ...]:
        """Lanes open to cars, from the right."""
        return tuple(lane for lane in self.lanes if lane.kind == "driving")

    @property
    def innermost_lane(self) -> SumoLane:
        """The leftmost lane for cars, or of all where there is none for cars."""
        return (self.driving_lanes or self.lanes)[-1]


@dataclass(frozen=True, eq=False)
class SumoJunction:
    """A node of the network; `outline` (n, 3) is empty at the edge of the site."""

    id: str
    type: str
    outline: Points


@dataclass(frozen=True, eq=False)
class PavedOutline:
    """Ring (n, 3) around paving inside a junction, as the map has it; of one lane's kind."""

    kind: str
    ring: Points


@dataclass(frozen=True, eq=False)
class PaintedStripe:
    """Middle (n, 3) of a painted line, as the map has it."""

    mark: RoadMark
    line: Points


@dataclass(frozen=True)
class LaneConnection:
    """A connection from one lane into the next.

    Attributes:
        origin: Id of the lane it leaves.
        target: Id of the lane it enters.
        via: Id of its lane inside the junction, if there is one.
        direction: SUMO's letter: `s` straight, `l` left, `r` right, `t` turns around.
        state: SUMO's letter for the right of way.
        traffic_light: Id of its traffic light; empty without one.
        link_index: Index into the light's state; -1 without a light.
    """

    origin: str
    target: str
    via: str | None
    direction: str
    state: str = "M"
    traffic_light: str = ""
    link_index: int = -1

    @property
    def from_edge(self) -> str:
        """Id of the edge it leaves."""
        return self.origin.rpartition("_")[0]

    @property
    def to_edge(self) -> str:
        """Id of the edge it enters."""
        return self.target.rpartition("_")[0]


@dataclass(frozen=True)
class SignalProgram:
    """The program of a light: its phases, each a duration in seconds and a state, are repeated."""

    light: str
    offset_s: float
    phases: tuple[tuple[float, str], ...]

    def find_next_green_s(self, link: int, from_s: float) -> float:
        """Compute the first time from `from_s` on at which a link has green; it if none has."""
        period_s = sum(duration_s for duration_s, _ in self.phases)
        begins_s = from_s - (from_s - self.offset_s) % period_s
        for duration_s, state in (*self.phases, *self.phases):
            ends_s = begins_s + duration_s
            if ends_s > from_s and state[link] in "gG":
                return max(begins_s, from_s)
            begins_s = ends_s
        return from_s

    def find_state(self, time_s: float) -> str:
        """Find the state at a time since the program began."""
        left_s = (time_s - self.offset_s) % sum(duration_s for duration_s, _ in self.phases)
        for duration_s, state in self.phases:
            # A phase up to a tick has ended there, at any rounding of the sum of tenths of seconds.
            if left_s < duration_s - 1e-6:
                return state
            left_s = max(left_s - duration_s, 0.0)
        return self.phases[0][1]

    def have_green_together(self, groups: Collection[Collection[int]]) -> bool:
        """Return whether some link of every group has green in one phase."""
        return any(
            all(any(state[link] in "gG" for link in links) for links in groups)
            for _, state in self.phases
        )


@dataclass(frozen=True, eq=False)
class SumoNetwork:
    """All parts of a network, in file order; random draws depend on the order."""

    edges: tuple[SumoEdge, ...]
    junctions: tuple[SumoJunction, ...]
    connections: tuple[LaneConnection, ...]
    programs: tuple[SignalProgram, ...]
    outlines: tuple[PavedOutline, ...] = ()
    stripes: tuple[PaintedStripe, ...] = ()

    @property
    def lanes(self) -> Iterator[SumoLane]:
        """Lanes of all edges."""
        return (lane for edge in self.edges for lane in edge.lanes)

    def list_crossing_signals(self) -> Iterator[tuple[str, SumoEdge, LaneConnection]]:
        """List the crossings with lights: id of the signal, the crossing, a link onto it."""
        crossings = {edge.id: edge for edge in self.edges if edge.function == "crossing"}
        for link in self.connections:
            crossing = crossings.get(link.to_edge)
            if crossing is not None and link.traffic_light:
                yield _name_signal(link.traffic_light, crossing), crossing, link


def read_network(path: Path) -> SumoNetwork:
    """Read a network written by our own netconvert; RunError if it is none."""
    try:
        return parse_network(ElementTree.parse(path).getroot())  # noqa: S314 - our own file
    except (OSError, ElementTree.ParseError, ValueError) as error:
        raise RunError(f"{path}: not a SUMO network: {error}") from error


def parse_packed_network(text: str) -> SumoNetwork:
    """Parse a network packed into a spec; InputError if it is none."""
    root = unpack_network(text)
    try:
        return parse_network(root)
    except ValueError as error:
        raise InputError(f"imported.network: not a SUMO network: {error}") from None


def parse_network(root: Element) -> SumoNetwork:
    """Parse a network; ValueError where an attribute is missing or is no finite number."""
    try:
        return SumoNetwork(
            edges=tuple(_parse_edge(item) for item in root.iter("edge")),
            junctions=tuple(_parse_junction(item) for item in root.iter("junction")),
            connections=tuple(_parse_connection(item) for item in root.iter("connection")),
            programs=tuple(_parse_program(item) for item in root.iter("tlLogic")),
            outlines=tuple(
                PavedOutline(item.attrib["type"], _parse_shape(item.attrib["shape"]))
                for item in root.iter("poly")
                if item.get("type") not in STRIPE_MARKS
            ),
            stripes=tuple(
                PaintedStripe(RoadMark(item.get("type")), _parse_shape(item.attrib["shape"]))
                for item in root.iter("poly")
                if item.get("type") in STRIPE_MARKS
            ),
        )
    except KeyError as error:
        raise ValueError(f"attribute {error} is missing") from None


def read_signal_groups(path: Path) -> dict[str, list[tuple[str, int]]]:
    """Read which movements show the light of each approach, which is a street or imported edge.

    By `<light>/<approach>`, then by `<light>/<street>/crossing`, or the id of an imported crossing,
    for pedestrians: traffic light and indices into its state, sorted.
    """
    network = read_network(path)
    governed = [
        link
        for link in network.connections
        if link.traffic_light and not (link.from_edge[0] == ":" or link.to_edge[0] == ":")
    ]
    groups: dict[str, list[tuple[str, int]]] = {}
    # Lights follow each other in the order of their first link, and so do approaches to a light.
    for light in dict.fromkeys(link.traffic_light for link in governed):
        for link in governed:
            if link.traffic_light == light:
                name = f"{light}/{approach_name(link.from_edge)}"
                groups.setdefault(name, []).append((light, link.link_index))
    for name, _, link in network.list_crossing_signals():
        groups.setdefault(name, []).append((link.traffic_light, link.link_index))
    return {name: sorted({*links}) for name, links in groups.items()}


def _name_signal(light: str, crossing: SumoEdge) -> str:
    first = next(iter(crossing.crossed_edges), "")
    street = approach_name(first)
    return f"{light}/{crossing.id}" if street == first else name_crossing_signal(light, street)


def _parse_edge(item: Element) -> SumoEdge:
    name, function = item.attrib["id"], item.get("function", "normal")
    lanes = sorted(
        (_parse_lane(lane, name, function) for lane in item.iter("lane")),
        key=lambda lane: lane.index,
    )
    ends = item.get("from", ""), item.get("to", "")
    return SumoEdge(
        name, function, *ends, tuple(lanes), tuple(item.get("crossingEdges", "").split())
    )


def _parse_lane(item: Element, edge: str, function: str) -> SumoLane:
    allowed = item.get("allow")
    shape = _parse_shape(item.attrib["shape"])
    width_m = float(item.get("width", DEFAULT_LANE_WIDTH_M))
    if not 0 < width_m <= MAX_LANE_WIDTH_M:
        limits = f"between 0 and {MAX_LANE_WIDTH_M:g} m"
        raise ValueError(f"lane {item.attrib['id'][:40]} is {width_m:g} m wide, not {limits}")
    return SumoLane(
        id=item.attrib["id"],
        edge=edge,
        index=int(item.attrib["index"]),
        function=function,
        length_m=float(item.attrib["length"]),
        speed_limit_m_s=float(item.attrib["speed"]),
        shape=shape,
        width_m=width_m,
        type=item.get("type", ""),
        allowed_classes=None if allowed is None else frozenset(allowed.split()),
        disallowed_classes=frozenset(item.get("disallow", "").split()),
        borders=_parse_borders(item, len(shape)),
    )


def _parse_borders(item: Element, count: int) -> tuple[Points, Points] | None:
    left, right = (_parse_shape(item.get(name, "")) for name in BORDER_ATTRIBUTES)
    if not len(left) and not len(right):
        return None
    if not len(left) == len(right) == count:
        raise ValueError(f"lane {item.attrib['id'][:40]} has other points than its borders")
    return left, right


def _parse_junction(item: Element) -> SumoJunction:
    outline = _parse_shape(item.get("shape", ""))
    return SumoJunction(item.attrib["id"], item.get("type", ""), outline)


def _parse_connection(item: Element) -> LaneConnection:
    return LaneConnection(
        origin=f"{item.attrib['from']}_{item.attrib['fromLane']}",
        target=f"{item.attrib['to']}_{item.attrib['toLane']}",
        via=item.get("via"),
        direction=item.attrib["dir"],
        state=item.get("state", "M"),
        traffic_light=item.get("tl", ""),
        link_index=int(item.get("linkIndex", -1)),
    )


def _parse_program(item: Element) -> SignalProgram:
    phases = tuple(
        (float(phase.attrib["duration"]), phase.attrib["state"]) for phase in item.iter("phase")
    )
    return SignalProgram(item.attrib["id"], float(item.get("offset", 0)), phases)


def _parse_shape(shape: str) -> Points:
    """Points (n, 3) of a SUMO shape, z 0 where it has none; ValueError if one is not finite."""
    numbers = [[float(value) for value in point.split(",")] for point in shape.split()]
    found = np.array([(*point, 0.0)[:3] for point in numbers], dtype=np.float64).reshape(-1, 3)
    if not np.isfinite(found).all():
        raise ValueError(f"'{shape[:60]}' is not finite")
    return found


def build_enclosed_area(ring: Points) -> BaseGeometry:
    """Build the area within a ring (n, 2 or 3), however it is wound or crosses itself."""
    valid = shapely.make_valid(shapely.Polygon(ring[:, :2]))
    return shapely.union_all(extract_polygons(valid))
