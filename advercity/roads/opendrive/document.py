"""Records of an OpenDRIVE document, in its own terms and units; angles in radians."""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

from advercity.roads.opendrive.profiles import Profile

Contact = Literal["start", "end"]
CONTACTS: tuple[Contact, ...] = ("start", "end")


@dataclass(frozen=True)
class PlanGeometry:
    """A piece of a reference line in the plan.

    Attributes:
        begins_m: Station of its start.
        start: Its start (x, y).
        heading: Its direction there.
        length_m: Its length.
        shape: `line`, `arc`, `spiral`, `poly3` or `paramPoly3`.
        values: Curvature of an arc; curvatures of a spiral; polynomials' coefficients, u before v.
        is_normalized: Whether a parametric polynomial runs from 0 to 1.
    """

    begins_m: float
    start: tuple[float, float]
    heading: float
    length_m: float
    shape: str
    values: tuple[float, ...] = ()
    is_normalized: bool = False


@dataclass(frozen=True)
class SpeedLimit:
    """A limit from a distance on; None where the map has none."""

    begins_m: float
    speed_m_s: float | None


@dataclass(frozen=True)
class Lane:
    """A lane of a section; ids count outwards, negative on the right of the reference line."""

    id: int
    type: str
    is_level: bool
    widths: Profile
    borders: Profile
    predecessors: tuple[int, ...]
    successors: tuple[int, ...]
    speeds: tuple[SpeedLimit, ...]
    line: int


@dataclass(frozen=True)
class LaneSection:
    """Lanes side by side from a station on, by id."""

    begins_m: float
    lanes: dict[int, Lane]


@dataclass(frozen=True)
class RoadLink:
    """The neighbour of a road at an end: another road and its end, or a junction."""

    element_type: Literal["road", "junction"]
    id: str
    contact: Contact


@dataclass(frozen=True)
class Signal:
    """A traffic light along a road; `orientation` is the direction of its traffic."""

    station_m: float
    orientation: str


@dataclass(frozen=True)
class Crosswalk:
    """Middle of a crosswalk, by station and distance to the left of the reference line."""

    station_m: float
    left_m: float


@dataclass(frozen=True)
class CrossSection:
    """Heights above the plane of the road across it, as a profile over t, at a station."""

    station_m: float
    heights: Profile


@dataclass(frozen=True)
class Road:
    """A road: its reference line, its sections of lanes, and its links.

    Attributes:
        shape_sign: -1 if the road was mirrored: its cross-sections are taken at -t.
    """

    id: str
    name: str
    length_m: float
    junction: str
    is_left_handed: bool
    predecessor: RoadLink | None
    successor: RoadLink | None
    speeds: tuple[SpeedLimit, ...]
    geometries: tuple[PlanGeometry, ...]
    elevation: Profile
    superelevation: Profile
    cross_sections: tuple[CrossSection, ...]
    lane_offset: Profile
    sections: tuple[LaneSection, ...]
    lights: tuple[Signal, ...]
    crosswalks: tuple[Crosswalk, ...]
    line: int
    shape_sign: float = 1.0

    @property
    def is_loop(self) -> bool:
        """Whether it leads back to itself, or to the junction at its start."""
        ends = [link.id for link in (self.predecessor, self.successor) if link is not None]
        return self.id in ends or (len(ends) > 1 and ends[0] == ends[1])

    def get_link(self, end: Contact) -> RoadLink | None:
        """Return its link at an end."""
        return self.predecessor if end == "start" else self.successor


@dataclass(frozen=True)
class Connection:
    """A way through a junction: over a connecting road, or directly into a linked road."""

    incoming_road: str
    road: str
    contact: Contact
    is_direct: bool
    lane_links: tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class Junction:
    """A junction and its connections."""

    id: str
    connections: tuple[Connection, ...]


@dataclass(frozen=True)
class Header:
    """Where the map is: a PROJ string, and the place of its origin in the projection."""

    projection: str
    offset_m: tuple[float, float, float]
    heading: float


@dataclass(frozen=True)
class OpenDriveMap:
    """All used parts of a document."""

    header: Header
    roads: dict[str, Road]
    junctions: dict[str, Junction]

    def is_connecting(self, road: Road) -> bool:
        """Whether a road lies in a junction and leads through it."""
        return road.junction in self.junctions and road.id not in self._dead_ends

    @cached_property
    def _dead_ends(self) -> set[str]:
        """Roads with an end without a link, and without a connection into it."""
        entered = {
            (item.road, item.contact)
            for junction in self.junctions.values()
            for item in junction.connections
        }
        return {
            road.id
            for road in self.roads.values()
            for contact in CONTACTS
            if road.get_link(contact) is None and (road.id, contact) not in entered
        }
