"""A road: streets with lanes, junctions, signals, surroundings, and where agents stand.

Positions are in the world frame (x east, y north, z up, metres). Headings are in degrees,
counter-clockwise from east. Traffic drives on the right.
"""

from collections.abc import Collection
from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated, Literal, Self

from pydantic import Field, StringConstraints, model_validator

from advercity_dsl.base import (
    Count,
    Declaration,
    Degrees,
    Digest,
    Id,
    KilometresPerHour,
    Metres,
    Misfit,
    Model,
    Number,
    Point2,
    Point3,
    PositiveMetres,
    Seconds,
    Share,
    Terse,
)
from advercity_dsl.names import nearest


class EgoRoute(Model):
    """Another way of the ego through the same place, for conflicts with another manoeuvre."""

    spawn_m: Point2
    """Where it starts."""
    heading_deg: Degrees
    """Counter-clockwise from east."""
    destination_m: Point2
    """Near which the scenario ends."""
    route: Annotated[tuple[Id, ...], Field(min_length=1)]
    """Streets from spawn to the edge of the site."""


def _is_none(value: object) -> bool:
    return value is None


def _is_empty(value: object) -> bool:
    return not value


class Line(Model):
    """A straight piece of a street's axis."""

    line_m: PositiveMetres
    """Its length."""


class Arc(Model):
    """A piece of a circle."""

    arc_m: PositiveMetres
    """Its length along the curve."""
    radius_m: PositiveMetres
    """Of the circle."""
    turn: Literal["left", "right"]
    """To which side it bends."""


class Polyline(Model):
    """Further points of an axis, absolute, for shapes that no line or arc says."""

    points_m: tuple[Point2, ...]
    """Further points, each [east, north]."""


class StripKind(StrEnum):
    """What a strip of a cross-section is for."""

    LANE = "lane"
    PARKING = "parking"
    SHOULDER = "shoulder"
    EDGE = "edge"
    MEDIAN = "median"
    VERGE = "verge"
    SIDEWALK = "sidewalk"


class Paint(StrEnum):
    """A painted line."""

    SOLID_WHITE = "solid_white"
    BROKEN_WHITE = "broken_white"
    SOLID_YELLOW = "solid_yellow"
    BROKEN_YELLOW = "broken_yellow"
    DOUBLE_YELLOW = "double_yellow"


class Strip(Terse):
    """A band along a street, as wide as it says, and the line painted on its outer border."""

    kind: StripKind
    """What it is for."""
    width_m: Annotated[PositiveMetres, Field(le=60)]
    """Its width."""
    line: Paint | None = None
    """What is painted on its outer border."""
    bay_m: PositiveMetres | None = Field(default=None, exclude_if=_is_none)
    """Width of parking bays, which lines across the strip divide; cars stand across it."""

    @model_validator(mode="after")
    def _has_bays_to_park_in(self) -> Self:
        if self.bay_m is not None and self.kind is not StripKind.PARKING:
            raise ValueError("only a parking strip has bays")
        return self


class CrossSection(Model):
    """Strips on either side of the axis, from the axis outwards.

    Lanes on the right run along the axis, lanes on the left against it. Lane 1 is the innermost.
    """

    left: tuple[Strip, ...] = ()
    """Strips on the left, from the axis outwards."""
    right: tuple[Strip, ...] = ()
    """Strips on the right, from the axis outwards."""
    axis_line: Paint | None = None
    """What is painted on the axis."""


class Height(Model):
    """Height of the axis at a distance along it.

    The grade is constant between two of them and changes over 4 m where they meet.
    """

    at_m: Annotated[Metres, Field(ge=0)]
    """Distance along the axis."""
    z_m: Metres
    """Height there."""


class Street(Terse):
    """One axis with one cross-section, from one junction or edge of the site to another."""

    begins: Id
    """Junction, or a name for the edge of the site."""
    ends: Id
    """Junction, or a name for the edge of the site."""
    start_m: Point2
    """Where the axis starts, [east, north]."""
    heading_deg: Degrees
    """Where it leads from there, counter-clockwise from east."""
    path: Annotated[tuple[Line | Arc | Polyline, ...], Field(min_length=1)]
    """Lines and arcs, one after the other."""
    heights: tuple[Height, ...] = ()
    """Heights along the axis; left out, it is level."""
    section: Id
    """Name of one of `sections`."""
    speed_limit_km_h: Annotated[KilometresPerHour, Field(gt=0, le=200)]
    """For all of it."""


LaneText = Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]*\.\d$")]
"""`north_road.1`: the innermost lane of a street, on the side that the junction means."""

MovementText = Annotated[
    str, StringConstraints(pattern=r"^[a-z][a-z0-9_]*\.\d > [a-z][a-z0-9_]*\.\d$")
]
"""`north_road.1 > east_road.1`: from the innermost lane of one street into that of another."""


@dataclass(frozen=True)
class Movement:
    """A way through a junction; lanes count from 1, the innermost."""

    from_street: Id
    from_lane: int
    to_street: Id
    to_lane: int

    @staticmethod
    def read(text: str) -> "Movement":
        """Take a `MovementText` apart."""
        (from_street, from_lane), (to_street, to_lane) = (
            side.split(".") for side in text.split(" > ")
        )
        return Movement(from_street, int(from_lane), to_street, int(to_lane))


class SignalHead(Model):
    """A traffic light: the heads hang at `at_m`, on a mast whose foot is at `pole_m`."""

    street: Id
    """Whose traffic it is for."""
    at_m: Point3
    """Where the heads hang, [east, north, up]."""
    pole_m: Point2
    """Foot of the mast, [east, north]."""


class Signals(Model):
    """A fixed programme, one approach at a time, in the order of `cycle`."""

    cycle: Annotated[tuple[Id, ...], Field(min_length=1)]
    """Streets in the order in which they get green."""
    green_s: Annotated[Seconds, Field(gt=0)]
    """Green of each."""
    yellow_s: Annotated[Seconds, Field(gt=0)] = 3
    """Yellow after it."""
    all_red_s: Annotated[Seconds, Field(ge=0)] = 2
    """All red after that."""
    elapsed_s: Annotated[Seconds, Field(ge=0)] = 0
    """Time of the first approach's green that is over when the scenario starts."""
    heads: tuple[SignalHead, ...] = ()
    """Traffic lights to be seen."""


class Crossing(Model):
    """A zebra crossing over a street, at the end where it meets the junction."""

    street: Id
    """Which it leads across."""
    width_m: PositiveMetres = 3.0
    """Along that street."""


class Sign(Model):
    """A stop or give-way sign for one approach."""

    street: Id
    """Whose traffic it is for."""
    kind: Literal["stop", "yield"]
    """What it says."""
    at_m: Point2
    """Where it stands, [east, north]."""


class Junction(Terse):
    """Where streets meet, and which lane may go into which."""

    control: Literal["signals", "priority", "stop", "yield", "none"] = "none"
    """Who goes first."""
    movements: tuple[MovementText, ...] = ()
    """Ways through it: `north.1 > east.1`."""
    corner_radius_m: PositiveMetres = 5.0
    """Of the roadway's edge between neighbouring streets."""
    turn_radius_m: PositiveMetres | None = Field(default=None, exclude_if=_is_none)
    """Largest radius of a turn between straights; without it, as wide as there is room."""
    median: tuple[Id, Id] | None = None
    """Two streets between which the median runs on through the junction."""
    signals: Signals | None = None
    """Programme of its lights, with `control: signals`."""
    crossings: tuple[Crossing, ...] = ()
    """Zebra crossings."""
    signs: tuple[Sign, ...] = ()
    """Stop and give-way signs."""
    arrows: tuple[LaneText, ...] = Field(default=(), exclude_if=_is_empty)
    """Arriving lanes on which arrows say where they lead."""


class SurroundingKind(StrEnum):
    """What stands beside a road."""

    BUILDINGS = "buildings"
    HOUSES = "houses"
    TREES = "trees"
    HEDGE = "hedge"
    CROPS = "crops"
    FIELD = "field"
    WALL = "wall"
    FENCE = "fence"
    BUS_STOP = "bus_stop"
    TOWER = "tower"
    POLE = "pole"
    LAMP = "lamp"
    PLATEAU = "plateau"
    WOODS = "woods"
    PARKED_CARS = "parked_cars"
    SPEED_SIGN = "speed_sign"
    DRIVEWAY = "driveway"


class Species(StrEnum):
    """A kind of tree."""

    OAK = "oak"
    MAPLE = "maple"
    BIRCH = "birch"
    POPLAR = "poplar"
    SPRUCE = "spruce"


class Beside(Terse):
    """A place along a street, which goes with the street wherever it leads."""

    street: Id
    """Along which."""
    side: Literal["left", "right", "both"]
    """As seen along the street's axis."""
    from_m: Annotated[Metres, Field(ge=0)] = 0
    """Distance along the axis where it begins."""
    to_m: Annotated[Metres | None, Field(gt=0)] = None
    """Distance along the axis where it ends; without it, at the end of the street."""
    offset_m: Metres | tuple[Metres, Metres] = 1
    """Outwards from the edge of all paving: of a line, or of both borders of a band."""

    @model_validator(mode="after")
    def _is_ordered(self) -> Self:
        if self.to_m is not None and self.to_m <= self.from_m:
            raise ValueError("'to_m' is beyond 'from_m'")
        if isinstance(self.offset_m, tuple) and self.offset_m[1] <= self.offset_m[0]:
            raise ValueError("'offset_m' names the nearer border of a band first")
        return self

    @property
    def band_m(self) -> tuple[float, float]:
        """Offsets of the nearer and the further border; the same of a line."""
        if isinstance(self.offset_m, tuple):
            return self.offset_m
        return self.offset_m, self.offset_m


_BESIDE, _AREA, _LINE, _AT = "beside", "area_m", "line_m", "at_m"
_PLACES = {
    SurroundingKind.BUILDINGS: (_BESIDE, _AREA),
    SurroundingKind.HOUSES: (_BESIDE, _AREA),
    SurroundingKind.TREES: (_BESIDE, _AREA, _LINE, _AT),
    SurroundingKind.HEDGE: (_BESIDE, _LINE),
    SurroundingKind.CROPS: (_BESIDE, _AREA),
    SurroundingKind.FIELD: (_BESIDE, _AREA),
    SurroundingKind.WALL: (_BESIDE, _LINE),
    SurroundingKind.FENCE: (_BESIDE, _LINE),
    SurroundingKind.BUS_STOP: (_AT,),
    SurroundingKind.TOWER: (_AT,),
    SurroundingKind.POLE: (_BESIDE, _LINE, _AT),
    SurroundingKind.LAMP: (_BESIDE, _LINE, _AT),
    SurroundingKind.PLATEAU: (_LINE,),
    SurroundingKind.WOODS: (_BESIDE, _AREA),
    SurroundingKind.PARKED_CARS: (_BESIDE,),
    SurroundingKind.SPEED_SIGN: (_BESIDE,),
    SurroundingKind.DRIVEWAY: (_BESIDE,),
}
_BANDS = (
    SurroundingKind.CROPS,
    SurroundingKind.FIELD,
    SurroundingKind.WOODS,
    SurroundingKind.DRIVEWAY,
)


class Surrounding(Model):
    """Things of one kind: beside a street, filling an area, along a line, or one at a point.

    A plateau is ground that stands `height_m` high within `line_m`, its outline; it meets the
    streets that climb to it, and falls off steeply elsewhere. Parked cars stand in the parking
    strip of their street. A speed sign stands at `from_m` and faces those who drive on its side.
    A driveway is a paved band that crosses the sidewalk.
    """

    kind: SurroundingKind
    """What stands there."""
    beside: Beside | None = Field(default=None, exclude_if=_is_empty)
    """Along a street."""
    area_m: tuple[Point2, Point2] | None = Field(default=None, exclude_if=_is_empty)
    """Two opposite corners of a rectangle."""
    line_m: tuple[Point2, ...] = Field(default=(), exclude_if=_is_empty)
    """Along a line, or as its outline; points [east, north]."""
    at_m: tuple[Point2, ...] = Field(default=(), exclude_if=_is_empty)
    """At single points, [east, north]."""
    height_m: PositiveMetres | None = Field(default=None, exclude_if=_is_empty)
    """Of each of them."""
    spacing_m: PositiveMetres | None = Field(default=None, exclude_if=_is_empty)
    """Between trees, lamps, poles, buildings, or places to park."""
    species: tuple[Species, ...] = Field(default=(), exclude_if=_is_empty)
    """Of trees; all of them if none is named."""
    limit_km_h: Annotated[KilometresPerHour, Field(gt=0, lt=1000)] | None = Field(
        default=None, exclude_if=_is_none
    )
    """On a speed sign; without it, the limit of its street."""
    seed: Count = Field(default=0, ge=0, exclude_if=_is_empty)
    """Another number gives other trees and buildings."""

    @model_validator(mode="after")
    def _has_a_place(self) -> Self:
        given = [name for name in (_BESIDE, _AREA, _LINE, _AT) if getattr(self, name)]
        fitting = _PLACES[self.kind]
        if not given or any(name not in fitting for name in given):
            found = f"has {' and '.join(given)}" if given else "has no place"
            ways = " or ".join(f"'{name}'" for name in fitting)
            raise ValueError(f"{self.kind} {found}; give it {ways}")
        if self.kind in _BANDS and self.beside and not isinstance(self.beside.offset_m, tuple):
            raise ValueError(f"{self.kind} beside a street need two offsets, as in [2, 60]")
        if self.kind is SurroundingKind.PLATEAU and (len(self.line_m) < 3 or not self.height_m):
            raise ValueError(
                "a plateau has an outline 'line_m' of three points or more, and 'height_m'"
            )
        if self.species and self.kind is not SurroundingKind.TREES:
            raise ValueError("only trees have 'species'")
        if self.limit_km_h and self.kind is not SurroundingKind.SPEED_SIGN:
            raise ValueError("only a speed sign has a 'limit_km_h'")
        return self


class MapFile(Model):
    """A map that others made, from which the road's network is built when it is compiled.

    OpenDRIVE and SUMO maps keep their coordinates; an OpenStreetMap one lies around the road's
    `origin_lat_deg` and `origin_lon_deg`.
    """

    source: Literal["opendrive", "osm", "sumo"]
    """Format of the map."""
    file: Annotated[str, StringConstraints(min_length=1, max_length=1000)]
    """Its path, relative to the declaration's file."""
    sha256: Digest | None = None
    """Of the file; another map under the same name is refused."""
    extent_m: tuple[Point2, Point2] | None = None
    """Two opposite corners of a rectangle; roads wholly outside are left out."""


class MapNetwork(Model):
    """What the compiler makes of a map; a spec needs no other file."""

    source: Literal["opendrive", "osm", "sumo"]
    """Format of the map."""
    sha256: Digest
    """Of the map's file."""
    network: Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9+/]+={0,2}$")]
    """The SUMO network, as zlib in Base64."""


class Vehicle(Model):
    """A connected vehicle: where it starts, where it goes, how fast."""

    kind: Literal["vehicle"] = "vehicle"
    """A connected vehicle."""
    role: Literal["ego", "other"] = "other"
    """One vehicle of a road is the ego."""
    spawn_m: Point2
    """Where it starts, [east, north]."""
    heading_deg: Degrees
    """Where it looks, counter-clockwise from east."""
    destination_m: Point2
    """Where it goes, [east, north]."""
    route: tuple[Id, ...] = ()
    """Streets from spawn to the edge of the site; none takes the shortest way."""
    max_speed_km_h: Annotated[KilometresPerHour, Field(gt=0, le=200)]
    """Its own limit; it keeps the street's as well."""


class RoadsideUnit(Model):
    """Sensors that stand beside the road. Yaw, pitch and roll turn its cameras."""

    kind: Literal["roadside_unit"] = "roadside_unit"
    """Sensors beside the road."""
    position_m: Point3
    """Of its mast's head, [east, north, up]."""
    yaw_deg: Degrees
    """Where its cameras look, counter-clockwise from east."""
    pitch_deg: Degrees = 0
    """Positive looks down."""
    roll_deg: Degrees = 0
    """Positive lowers the right side."""
    lidar_upper_deg: Degrees | None = None
    """Highest beam; `null` takes the rig's."""


class ClassShares(Model):
    """How often each class of vehicle is drawn; normalised by their sum."""

    car: Share
    """Cars."""
    van: Share
    """Vans."""
    truck: Share
    """Lorries and buses."""
    bicycle: Share
    """Bicycles."""
    motorcycle: Share
    """Motorcycles."""


class Demand(Model):
    """Background traffic at density 1, in the original's terms.

    Vehicles are asked for per area: a square of `around_agent_m` around each of the five agents
    and a box from spawn to destination, grown by `around_path_m`, for each vehicle.
    """

    vehicles_per_area: Annotated[Number, Field(ge=0, le=100)]
    """For each of eight areas: around five agents, along three paths."""
    walkers: Annotated[Count, Field(ge=0, le=2000)]
    """Pedestrians."""
    crossing_share: Share = 0.0
    """Share of them that cross streets."""
    around_agent_m: PositiveMetres
    """Half the side of the square around an agent."""
    around_path_m: PositiveMetres
    """Margin around the box from spawn to destination."""
    classes: ClassShares
    """What vehicles they are."""
    speed_offset_percent: Annotated[Number, Field(ge=-100, le=100)] = -10
    """Background cars drive `(1 - offset/100)` times the limit, each ±30 %."""


class Road(Declaration):
    """A place: the static stage of a scenario.

    Its streets are authored here, or imported from a map.
    """

    kind: Literal["road"] = "road"
    land_use: Literal["urban", "rural"]
    """Town or country; typologies ask for it."""
    junction: Literal["intersection", "non_junction"]
    """Whether it is about a junction; typologies ask for it."""
    alignment: Literal["straight", "curved"]
    """Straight or curved; typologies ask for it."""
    profile: Literal["level", "non_level"]
    """Level or not; typologies ask for it."""
    origin_lat_deg: Annotated[Degrees, Field(ge=-89, le=89)] = 0.0
    """Latitude of the origin, for GNSS."""
    origin_lon_deg: Annotated[Degrees, Field(ge=-180, le=180)] = 0.0
    """Longitude of the origin, for GNSS."""
    imported: MapNetwork | MapFile | None = Field(default=None, exclude_if=_is_none)
    """A map that the streets come from, in place of `streets`."""
    sections: dict[Id, CrossSection] = Field(default_factory=dict)
    """Cross-sections by name."""
    streets: dict[Id, Street] = Field(default_factory=dict)
    """Streets by name."""
    junctions: dict[Id, Junction] = Field(default_factory=dict)
    """Where streets meet, by name."""
    surroundings: tuple[Surrounding, ...] = ()
    """What stands beside the streets."""
    agents: dict[Id, Annotated[Vehicle | RoadsideUnit, Field(discriminator="kind")]]
    """Connected vehicles and roadside units by name; one vehicle is the ego."""
    ego_routes: dict[Literal["straight", "left", "right"], EgoRoute] = Field(
        default_factory=dict, exclude_if=_is_empty
    )
    """By the ego's manoeuvre at the junction."""
    traffic: Demand
    """Who else is there."""

    @model_validator(mode="after")
    def _is_authored_or_imported(self) -> Self:
        if self.imported is None and not self.streets:
            raise ValueError("a road has 'streets', or a map to be 'imported'")
        if self.imported is not None and (self.sections or self.streets or self.junctions):
            raise ValueError("an 'imported' road has its streets from the map; declare none here")
        return self

    @model_validator(mode="after")
    def _names_exist(self) -> Self:
        for name, street in self.streets.items():
            _expect(street.section, self.sections, f"streets.{name}.section")
            if street.begins == street.ends:
                message = f"begins and ends at '{street.ends}'"
                raise Misfit(("streets", name, "ends"), message, "name two places")
        for name, junction in self.junctions.items():
            self._check_junction(f"junctions.{name}", name, junction)
        for name, agent in self.agents.items():
            if isinstance(agent, Vehicle) and agent.route:
                if self.imported is not None:
                    raise Misfit(
                        ("agents", name, "route"),
                        "an imported road has no named streets",
                        "leave the route out, and the shortest way to the destination is taken",
                    )
                for street in agent.route:
                    _expect(street, self.streets, f"agents.{name}.route")
        for index, item in enumerate(self.surroundings):
            if item.beside:
                self._check_beside(f"surroundings.{index}.beside", item, item.beside)
        return self

    def _check_beside(self, where: str, item: Surrounding, beside: Beside) -> None:
        if self.imported is not None:
            message = "an imported road has no named streets"
            raise Misfit(_path(where), message, "say where in metres")
        _expect(beside.street, self.streets, f"{where}.street")
        if item.kind is SurroundingKind.PARKED_CARS:
            section = self.sections[self.streets[beside.street].section]
            for side in ("left", "right") if beside.side == "both" else (beside.side,):
                strips = section.left if side == "left" else section.right
                if all(strip.kind is not StripKind.PARKING for strip in strips):
                    raise ValueError(
                        f"{where}: '{beside.street}' has no parking strip on its {side}"
                    )

    def _check_junction(self, where: str, name: Id, junction: Junction) -> None:
        meeting = [key for key, item in self.streets.items() if name in (item.begins, item.ends)]
        if not meeting:
            raise Misfit(_path(where), "no street begins or ends here", "take it away")
        if (junction.control == "signals") != (junction.signals is not None):
            message = "'control: signals' and 'signals' go together"
            raise Misfit(_path(where), message, "give both or none")
        named = [("crossings", item.street) for item in junction.crossings]
        named += [("signs", item.street) for item in junction.signs]
        named += [("median", item) for item in junction.median or ()]
        if junction.signals:
            named += [("signals.cycle", item) for item in junction.signals.cycle]
            named += [("signals.heads", item.street) for item in junction.signals.heads]
        for key, street in named:
            _expect(street, meeting, f"{where}.{key}")
        for text in junction.arrows:
            street, _, number = text.partition(".")
            _expect(street, meeting, f"{where}.arrows")
            arrives = self.streets[street].ends == name
            self._check_lane(street, int(number), f"{where}.arrows", along=arrives)
        for text in junction.movements:
            way = Movement.read(text)
            _expect(way.from_street, meeting, f"{where}.movements")
            _expect(way.to_street, meeting, f"{where}.movements")
            arrives = self.streets[way.from_street].ends == name
            leaves = self.streets[way.to_street].begins == name
            self._check_lane(way.from_street, way.from_lane, f"{where}.movements", along=arrives)
            self._check_lane(way.to_street, way.to_lane, f"{where}.movements", along=leaves)

    def _check_lane(self, street: Id, number: int, where: str, *, along: bool) -> None:
        section = self.sections[self.streets[street].section]
        strips = section.right if along else section.left
        count = sum(strip.kind is StripKind.LANE for strip in strips)
        if not 1 <= number <= count:
            way = "along" if along else "against"
            message = f"there is no lane '{street}.{number}'"
            hint = f"the street has {count} lanes {way} its axis"
            raise Misfit(_path(where), message, hint)


def _expect(name: Id, known: Collection[Id], where: str) -> None:
    if name not in known:
        raise Misfit(_path(where), f"there is no '{name}' here", nearest(name, known))


def _path(where: str) -> tuple[str | int, ...]:
    return tuple(int(part) if part.isdigit() else part for part in where.split("."))
