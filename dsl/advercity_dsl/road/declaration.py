"""Connected vehicles and roadside units: where they start or stand.

Background traffic.

Whether the streets and lanes that parts of a road name are there.

Each check raises a `Misfit` that says where the name stands, seen from the road.

The declaration of a road.
"""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from advercity_dsl.base import (
    Declaration,
    Id,
    InvalidCombination,
    Model,
    is_empty,
    is_none,
    suggest_name,
)
from advercity_dsl.road.junctions import Junction, Movement
from advercity_dsl.road.streets import CrossSection, MapFile, MapNetwork, Street, Strip, StripKind
from advercity_dsl.road.surroundings import Surrounding, SurroundingKind
from advercity_dsl.units import (
    Count,
    Degrees,
    Fraction,
    KilometresPerHour,
    Number,
    Point2,
    Point3,
    PositiveMetres,
)


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

    @property
    def is_ego(self) -> bool:
        """Whether it is the vehicle that conflicts are staged for."""
        return self.role == "ego"


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

    @property
    def is_ego(self) -> bool:
        """Always false: the ego is a vehicle."""
        return False


class ClassFractions(Model):
    """How often each class of vehicle is drawn; normalised by their sum."""

    car: Fraction
    """Cars."""
    van: Fraction
    """Vans."""
    truck: Fraction
    """Lorries and buses."""
    bicycle: Fraction
    """Bicycles."""
    motorcycle: Fraction
    """Motorcycles."""


class BackgroundDemand(Model):
    """Background traffic at density 1, in the original's terms.

    Vehicles are asked for per area: a square of `around_agent_m` around each of the five agents
    and a box from spawn to destination, grown by `around_path_m`, for each vehicle.
    """

    vehicles_per_area: Annotated[Number, Field(ge=0, le=100)]
    """For each of eight areas: around five agents, along three paths."""
    walkers: Annotated[Count, Field(ge=0, le=2000)]
    """Pedestrians."""
    crossing_share: Fraction = 0.0
    """Share of them that cross streets."""
    around_agent_m: PositiveMetres
    """Half the side of the square around an agent."""
    around_path_m: PositiveMetres
    """Margin around the box from spawn to destination."""
    classes: ClassFractions
    """What vehicles they are."""
    speed_offset_percent: Annotated[Number, Field(ge=-100, le=100)] = -10
    """Background cars drive `(1 - offset/100)` times the limit, each ±30 %."""


RoadValuePath = tuple[str | int, ...]
"""Path of a value, from the road."""


@dataclass(frozen=True)
class DeclaredStreets:
    """What can be named.

    Attributes:
        sections: By name.
        streets: By name.
        imported: Whether the streets come from a map, and so have no names.
    """

    sections: Mapping[Id, CrossSection]
    streets: Mapping[Id, Street]
    imported: bool

    def get_strips(self, street: Id, *, right: bool) -> tuple[Strip, ...]:
        """Those on a side of a street's axis."""
        section = self.sections[self.streets[street].section]
        return section.right if right else section.left


def check_street(network: DeclaredStreets, name: Id) -> None:
    """A street has a section and two ends."""
    street = network.streets[name]
    _require_name(street.section, network.sections, ("streets", name, "section"))
    if street.begins == street.ends:
        message = f"begins and ends at '{street.ends}'"
        raise InvalidCombination(("streets", name, "ends"), message, "name two places")


def check_junction(network: DeclaredStreets, name: Id, junction: Junction) -> None:
    """A junction names streets that meet there and lanes that they have."""
    where = ("junctions", name)
    meeting = [key for key, item in network.streets.items() if name in (item.begins, item.ends)]
    if not meeting:
        raise InvalidCombination(where, "no street begins or ends here", "take it away")
    if (junction.control == "signals") != (junction.signals is not None):
        message = "'control: signals' and 'signals' go together"
        raise InvalidCombination(where, message, "give both or none")
    for field, street in _iterate_street_references(junction):
        _require_name(street, meeting, (*where, *field))
    for text in junction.arrows:
        street, _, number = text.partition(".")
        _require_name(street, meeting, (*where, "arrows"))
        arrives = network.streets[street].ends == name
        _check_lane(network, street, int(number), (*where, "arrows"), along=arrives)
    for text in junction.movements:
        _check_movement(network, name, Movement.parse(text), meeting)


def check_route(network: DeclaredStreets, name: Id, vehicle: Vehicle) -> None:
    """A vehicle drives along streets that there are."""
    where = ("agents", name, "route")
    if vehicle.route and network.imported:
        hint = "leave the route out, and the shortest way to the destination is taken"
        raise InvalidCombination(where, "an imported road has no named streets", hint)
    for street in vehicle.route:
        _require_name(street, network.streets, where)


def check_surrounding(network: DeclaredStreets, index: int, item: Surrounding) -> None:
    """What stands beside a street names one; parked cars, one with room for them."""
    if item.beside is None:
        return
    where, street = ("surroundings", index, "beside"), item.beside.street
    if network.imported:
        raise InvalidCombination(
            where, "an imported road has no named streets", "say where in metres"
        )
    _require_name(street, network.streets, (*where, "street"))
    if item.kind is not SurroundingKind.PARKED_CARS:
        return
    for side in ("left", "right") if item.beside.side == "both" else (item.beside.side,):
        strips = network.get_strips(street, right=side == "right")
        if all(strip.kind is not StripKind.PARKING for strip in strips):
            message = f"'{street}' has no parking strip on its {side}"
            raise InvalidCombination(
                where, message, "give its section one, or choose the other side"
            )


def _iterate_street_references(junction: Junction) -> Iterator[tuple[tuple[str, ...], Id]]:
    """Streets that a junction names, each with the field that does."""
    yield from ((("crossings",), item.street) for item in junction.crossings)
    yield from ((("signs",), item.street) for item in junction.signs)
    yield from ((("median",), street) for street in junction.median or ())
    if junction.signals:
        yield from ((("signals", "cycle"), street) for street in junction.signals.cycle)
        yield from ((("signals", "heads"), item.street) for item in junction.signals.heads)


def _check_movement(
    network: DeclaredStreets, name: Id, movement: Movement, meeting: Collection[Id]
) -> None:
    where = ("junctions", name, "movements")
    _require_name(movement.from_street, meeting, where)
    _require_name(movement.to_street, meeting, where)
    arrives = network.streets[movement.from_street].ends == name
    leaves = network.streets[movement.to_street].begins == name
    _check_lane(network, movement.from_street, movement.from_lane, where, along=arrives)
    _check_lane(network, movement.to_street, movement.to_lane, where, along=leaves)


def _check_lane(
    network: DeclaredStreets, street: Id, number: int, value_path: RoadValuePath, *, along: bool
) -> None:
    strips = network.get_strips(street, right=along)
    count = sum(strip.kind is StripKind.LANE for strip in strips)
    if not 1 <= number <= count:
        way = "along" if along else "against"
        message = f"there is no lane '{street}.{number}'"
        raise InvalidCombination(
            value_path, message, f"the street has {count} lanes {way} its axis"
        )


def _require_name(name: Id, known: Collection[Id], value_path: RoadValuePath) -> None:
    if name not in known:
        raise InvalidCombination(
            value_path, f"there is no '{name}' here", suggest_name(name, known)
        )


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
    imported: MapNetwork | MapFile | None = Field(default=None, exclude_if=is_none)
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
        default_factory=dict, exclude_if=is_empty
    )
    """By the ego's manoeuvre at the junction."""
    traffic: BackgroundDemand
    """Who else is there."""

    @property
    def ego(self) -> Vehicle:
        """The vehicle that conflicts are staged for."""
        return next(
            agent for agent in self.agents.values() if isinstance(agent, Vehicle) and agent.is_ego
        )

    @model_validator(mode="after")
    def _check_street_source(self) -> Self:
        if self.imported is None and not self.streets:
            raise ValueError("a road has 'streets', or a map to be 'imported'")
        if self.imported is not None and (self.sections or self.streets or self.junctions):
            raise ValueError("an 'imported' road has its streets from the map; declare none here")
        return self

    @model_validator(mode="after")
    def _check_references(self) -> Self:
        network = DeclaredStreets(self.sections, self.streets, imported=self.imported is not None)
        for name in self.streets:
            check_street(network, name)
        for name, junction in self.junctions.items():
            check_junction(network, name, junction)
        for name, agent in self.agents.items():
            if isinstance(agent, Vehicle):
                check_route(network, name, agent)
        for index, item in enumerate(self.surroundings):
            check_surrounding(network, index, item)
        return self
