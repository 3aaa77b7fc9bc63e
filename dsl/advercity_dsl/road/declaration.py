"""The declaration of a road: its agents, its background traffic, and checks of its references."""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from advercity_dsl.base import (
    ByName,
    Declaration,
    Id,
    InvalidCombination,
    Items,
    Model,
    ValuePath,
    is_empty,
    is_none,
    suggest_name,
)
from advercity_dsl.road.arms import JunctionAgents
from advercity_dsl.road.extent import (
    LocatedPoint,
    check_extent,
    check_street_lengths,
    iterate_street_points,
    iterate_surrounding_points,
)
from advercity_dsl.road.junctions import Junction, Movement
from advercity_dsl.road.streets import (
    CrossSection,
    DrivingSide,
    LeftOut,
    MapFile,
    MapNetwork,
    Street,
    Strip,
    StripKind,
)
from advercity_dsl.road.surroundings import Season, Surrounding, SurroundingKind
from advercity_dsl.road.trajectories import TrackId, TrajectoryFile, TrajectorySet
from advercity_dsl.units import (
    Count,
    Degrees,
    Fraction,
    KilometresPerHour,
    Metres,
    Number,
    Point2,
    Point3,
    PositiveMetres,
    Seconds,
)


class EgoRoute(Model):
    """An alternative route of the ego on the same road, for conflicts with another manoeuvre."""

    spawn_m: Point2
    """Start position."""
    heading_deg: Degrees
    """Heading at the start, counter-clockwise from east."""
    destination_m: Point2
    """Position near which the scenario ends."""
    route: Annotated[Items[Id], Field(min_length=1)]
    """Streets from spawn to the edge of the site."""
    junction: Id | None = Field(default=None, exclude_if=is_none)
    """Junction of the manoeuvre; by default the first on the route at which three streets meet."""


class Vehicle(Model):
    """A connected vehicle: its start, destination and speed."""

    kind: Literal["vehicle"] = "vehicle"
    """A connected vehicle."""
    role: Literal["ego", "other"] = "other"
    """Role of the vehicle; each road has one ego."""
    spawn_m: Point2
    """Start position, [east, north]."""
    heading_deg: Degrees
    """Heading at the start, counter-clockwise from east."""
    destination_m: Point2
    """Destination, [east, north]."""
    route: Items[Id] = ()
    """Streets from spawn to the edge of the site; by default the shortest route."""
    junction: Id | None = Field(default=None, exclude_if=is_none)
    """Junction of its manoeuvre; by default the first on the route at which three streets meet."""
    max_speed_km_h: Annotated[KilometresPerHour, Field(gt=0, le=200)]
    """Speed limit of the vehicle, which also obeys the street's."""
    waits_s: Annotated[Seconds, Field(ge=0, le=600)] = Field(
        default=0, exclude_if=lambda time_s: time_s == 0
    )
    """Time for which it waits at its start before it sets out."""
    track: TrackId | None = Field(default=None, exclude_if=is_none)
    """Its track in the road's `trajectories`."""

    @property
    def is_ego(self) -> bool:
        """Whether it is the vehicle with staged conflicts."""
        return self.role == "ego"


class RoadsideUnit(Model):
    """Stationary sensors at the roadside; yaw, pitch and roll apply to the cameras."""

    kind: Literal["roadside_unit"] = "roadside_unit"
    """Stationary sensors at the roadside."""
    position_m: Point3
    """Position of the mast's head, [east, north, up]."""
    yaw_deg: Degrees
    """Yaw of the cameras, counter-clockwise from east."""
    pitch_deg: Degrees = 0
    """Positive looks down."""
    roll_deg: Degrees = 0
    """Positive lowers the right side."""
    lidar_upper_deg: Degrees | None = None
    """Elevation of the highest beam of evenly spaced channels; `null` uses the rig's."""

    @property
    def is_ego(self) -> bool:
        """Always false: the ego is a vehicle."""
        return False


class ClassFractions(Model):
    """Frequency of each class of vehicle, normalised by the sum."""

    car: Fraction
    """Fraction of cars."""
    van: Fraction
    """Fraction of vans."""
    truck: Fraction
    """Fraction of trucks and buses."""
    bicycle: Fraction
    """Fraction of bicycles."""
    motorcycle: Fraction
    """Fraction of motorcycles."""

    @model_validator(mode="after")
    def _check_sum(self) -> Self:
        if not any(value for _, value in self):
            raise InvalidCombination((), "all classes are 0", "give one a fraction above 0")
        return self


class BackgroundDemand(Model):
    """Background traffic at density 1, with the parameters of the original dataset.

    Vehicles are counted per spawn area: a square of `around_agent_m` around each of the five agents
    and a box from spawn to destination, extended by `around_path_m`, for each connected vehicle.
    """

    vehicles_per_area: Annotated[Number, Field(ge=0, le=100)]
    """Vehicles in each of eight areas: around five agents, along three paths."""
    walkers: Annotated[Count, Field(ge=0, le=2000)]
    """Number of pedestrians."""
    crossing_share: Fraction = 0.0
    """Fraction of pedestrians who cross streets."""
    around_agent_m: Annotated[PositiveMetres, Field(le=10_000)]
    """Half the side of the square around an agent."""
    around_path_m: Annotated[PositiveMetres, Field(le=10_000)]
    """Margin around the box from spawn to destination."""
    classes: ClassFractions
    """Classes of the vehicles."""
    speed_offset_percent: Annotated[Number, Field(ge=-100, le=100)] = -10
    """Background vehicles drive `(1 - offset/100)` times the limit, each ±30 %."""


@dataclass(frozen=True)
class DeclaredStreets:
    """Streets and cross-sections to which other parts of a road refer.

    Attributes:
        sections: Cross-sections by name.
        streets: Streets by name.
        imported: Whether the streets come from a map, which is read later.
        is_left_hand: Whether lanes along an axis are on its left.
    """

    sections: Mapping[Id, CrossSection]
    streets: Mapping[Id, Street]
    imported: bool
    is_left_hand: bool = False

    def get_strips(self, street: Id, *, right: bool) -> Items[Strip]:
        """Return the strips on one side of a street's axis."""
        section = self.sections[self.streets[street].section]
        return section.right if right else section.left

    def count_lanes(self, street: Id, *, along: bool) -> int:
        """Count the lanes for travel along a street's axis, or against it."""
        strips = self.get_strips(street, right=along != self.is_left_hand)
        return sum(strip.kind is StripKind.LANE for strip in strips)


def check_street(network: DeclaredStreets, name: Id) -> None:
    """Check the cross-section of a street and its two different ends."""
    street = network.streets[name]
    _require_name(street.section, network.sections, ("streets", name, "section"))
    if street.begins == street.ends:
        message = f"begins and ends at '{street.ends}'"
        raise InvalidCombination(("streets", name, "ends"), message, "give two different names")


def check_junction(network: DeclaredStreets, name: Id, junction: Junction) -> None:
    """Check the streets and lanes to which a junction refers."""
    value_path = ("junctions", name)
    meeting = [key for key, item in network.streets.items() if name in (item.begins, item.ends)]
    if not meeting:
        raise InvalidCombination(value_path, "no street begins or ends here", "remove it")
    if (junction.control == "signals") != (junction.signals is not None):
        message = "'control: signals' and 'signals' require each other"
        raise InvalidCombination(value_path, message, "give both or neither")
    for field, street in _iterate_street_references(junction):
        _require_name(street, meeting, (*value_path, *field))
    for text in junction.arrows:
        street, _, number = text.partition(".")
        _require_name(street, meeting, (*value_path, "arrows"))
        arrives = network.streets[street].ends == name
        _check_lane(network, street, int(number), (*value_path, "arrows"), along=arrives)
    if junction.movements != "all":
        for text in junction.movements:
            _check_movement(network, name, Movement.parse(text), meeting)
    if junction.signals is not None:
        _check_cycle(network, name, junction, meeting)


def _check_cycle(
    network: DeclaredStreets, name: Id, junction: Junction, meeting: Collection[Id]
) -> None:
    """Check that every street with traffic into a junction has a green phase."""
    if junction.movements == "all":
        entering = [
            street
            for street in meeting
            if network.count_lanes(street, along=network.streets[street].ends == name)
        ]
    else:
        entering = [Movement.parse(text).from_street for text in junction.movements]
    assert junction.signals is not None
    green = {street for phase in junction.signals.phases for street in phase}
    for street in entering:
        if street not in green:
            value_path = ("junctions", name, "signals", "cycle")
            message = f"'{street}' never has green"
            raise InvalidCombination(value_path, message, f"add [{street}], or add it to a phase")


def check_route(network: DeclaredStreets, name: Id, vehicle: Vehicle) -> None:
    """Check the streets of a vehicle's route."""
    for street in vehicle.route if not network.imported else ():
        _require_name(street, network.streets, ("agents", name, "route"))


def check_surrounding(network: DeclaredStreets, index: int, item: Surrounding) -> None:
    """Check the street of an object along one, and the parking strip of parked cars."""
    if item.beside is None or network.imported:
        return
    value_path, street = ("surroundings", index, "beside"), item.beside.street
    _require_name(street, network.streets, (*value_path, "street"))
    if item.kind is not SurroundingKind.PARKED_CARS:
        return
    for side in ("left", "right") if item.beside.side == "both" else (item.beside.side,):
        strips = network.get_strips(street, right=side == "right")
        if all(strip.kind is not StripKind.PARKING for strip in strips):
            message = f"'{street}' has no parking strip on its {side}"
            raise InvalidCombination(
                value_path, message, "add one to its section, or choose the other side"
            )


def _iterate_street_references(junction: Junction) -> Iterator[tuple[tuple[str, ...], Id]]:
    """Yield the streets to which a junction refers, each with the path of the field."""
    yield from ((("crossings",), item.street) for item in junction.crossings)
    yield from ((("signs",), item.street) for item in junction.signs)
    yield from ((("median",), street) for street in junction.median or ())
    if junction.signals:
        yield from (
            (("signals", "cycle"), street) for phase in junction.signals.phases for street in phase
        )
        yield from ((("signals", "heads"), item.street) for item in junction.signals.heads)


def _check_movement(
    network: DeclaredStreets, name: Id, movement: Movement, meeting: Collection[Id]
) -> None:
    value_path = ("junctions", name, "movements")
    _require_name(movement.from_street, meeting, value_path)
    _require_name(movement.to_street, meeting, value_path)
    arrives = network.streets[movement.from_street].ends == name
    leaves = network.streets[movement.to_street].begins == name
    _check_lane(network, movement.from_street, movement.from_lane, value_path, along=arrives)
    _check_lane(network, movement.to_street, movement.to_lane, value_path, along=leaves)


def _check_lane(
    network: DeclaredStreets, street: Id, number: int, value_path: ValuePath, *, along: bool
) -> None:
    count = network.count_lanes(street, along=along)
    if not 1 <= number <= count:
        side = "along" if along else "against"
        message = f"unknown lane '{street}.{number}'"
        raise InvalidCombination(
            value_path, message, f"the street has {count} lanes {side} its axis"
        )


def _require_name(name: Id, known: Collection[Id], value_path: ValuePath) -> None:
    if name not in known:
        raise InvalidCombination(value_path, f"unknown name '{name}'", suggest_name(name, known))


class Road(Declaration):
    """The static environment of a scenario, with its agents and its traffic demand.

    Streets are declared, or imported from a map.
    """

    kind: Literal["road"] = "road"
    land_use: Literal["urban", "rural"]
    """Land use, by which typologies require roads."""
    junction: Literal["intersection", "non_junction"]
    """Whether traffic meets at a junction, by which typologies require roads."""
    alignment: Literal["straight", "curved"]
    """Horizontal alignment, by which typologies require roads."""
    profile: Literal["level", "non_level"]
    """Vertical profile, by which typologies require roads."""
    origin_lat_deg: Annotated[Degrees, Field(ge=-89, le=89)] = 0.0
    """Geodetic latitude (WGS84) of the world frame's origin, for GNSS."""
    origin_lon_deg: Annotated[Degrees, Field(ge=-180, le=180)] = 0.0
    """Longitude (WGS84) of the origin."""
    origin_alt_m: Annotated[Metres, Field(ge=-500, le=9000)] = 0.0
    """Height of the origin above the ellipsoid of WGS84, not above sea level."""
    driving_side: DrivingSide = Field(default="right", exclude_if=lambda side: side == "right")
    """Side on which traffic drives in the declared `streets`; an imported map has its own."""
    origin_convergence_deg: Annotated[Degrees, Field(ge=-180, le=180)] = Field(
        default=0.0, exclude_if=lambda angle_deg: angle_deg == 0.0
    )
    """Bearing of the world's y axis at the origin, clockwise from true north, for GNSS; of a map
    in a projection, its meridian convergence."""
    imported: MapNetwork | MapFile | None = Field(default=None, exclude_if=is_none)
    """Map from which the streets are imported, instead of `streets`."""
    sections: ByName[CrossSection] = Field(default_factory=dict)
    """Cross-sections by name."""
    streets: ByName[Street] = Field(default_factory=dict)
    """Streets by name."""
    junctions: ByName[Junction] = Field(default_factory=dict)
    """Junctions by name."""
    surroundings: Items[Surrounding] = ()
    """Objects in the surroundings."""
    style: Literal["downtown", "residential", "industrial", "rural"] | None = Field(
        default=None, exclude_if=is_none
    )
    """Buildings, trees, lamps and poles along every street, in addition to `surroundings`."""
    season: Season | None = Field(default=None, exclude_if=is_none)
    """Season of plants and fields, with their leaves, colours and crops; summer by default."""
    agents: Annotated[
        dict[Id, Annotated[Vehicle | RoadsideUnit, Field(discriminator="kind")]],
        Field(max_length=100),
    ] = Field(default_factory=dict)
    """Connected vehicles and roadside units by name; one vehicle is the ego."""
    at_junction: JunctionAgents | None = Field(default=None, exclude_if=is_none)
    """Agents placed by the arms of a junction, instead of `agents`."""
    ego_routes: dict[Literal["straight", "left", "right"], EgoRoute] = Field(
        default_factory=dict, exclude_if=is_empty
    )
    """Alternative routes of the ego, by its manoeuvre at the junction."""
    trajectories: TrajectorySet | TrajectoryFile | None = Field(default=None, exclude_if=is_none)
    """Recorded trajectories for all actors, in place of simulated traffic."""
    traffic: BackgroundDemand
    """Demand of background traffic."""

    @property
    def ego(self) -> Vehicle:
        """The vehicle with staged conflicts."""
        return next(
            agent for agent in self.agents.values() if isinstance(agent, Vehicle) and agent.is_ego
        )

    @property
    def is_left_hand(self) -> bool:
        """Whether traffic drives on the left."""
        source = self.imported if isinstance(self.imported, MapNetwork) else self
        return source.driving_side == "left"

    @property
    def left_out(self) -> Items[LeftOut]:
        """Omitted parts of its map and its recording."""
        sources = (self.imported, self.trajectories)
        return tuple(
            part
            for source in sources
            if isinstance(source, MapNetwork | TrajectorySet)
            for part in source.left_out
        )

    @model_validator(mode="after")
    def _check_street_source(self) -> Self:
        if self.imported is None and not self.streets:
            raise ValueError("a road needs 'streets' or an 'imported' map")
        if self.imported is not None and (self.sections or self.streets or self.junctions):
            raise ValueError("an 'imported' road takes its streets from the map; declare none here")
        if self.imported is not None and self.driving_side == "left":
            raise ValueError("'driving_side' comes from the map; for OSM, declare it in 'imported'")
        if self.agents and self.at_junction is not None:
            raise ValueError("'at_junction' places the agents; give 'agents' or 'at_junction'")
        return self

    @model_validator(mode="after")
    def _check_recorded_traffic(self) -> Self:
        recorded = self.trajectories is not None
        for name, agent in self.agents.items():
            if isinstance(agent, Vehicle) and (agent.track is not None) != recorded:
                at = ("agents", name, *(["track"] if agent.track else []))
                message = "'track' of a vehicle and 'trajectories' of its road require each other"
                raise InvalidCombination(at, message, "give both or neither")
        if recorded and self.at_junction is not None:
            message = "places vehicles without a track"
            hint = "give `agents` with a `track` each, or remove `trajectories`"
            raise InvalidCombination(("at_junction",), message, hint)
        for field in ("vehicles_per_area", "walkers") if recorded else ():
            if getattr(self.traffic, field) > 0:
                message = "no traffic is simulated where 'trajectories' are given"
                raise InvalidCombination(("traffic", field), message, "write 0")
        return self

    @model_validator(mode="after")
    def _check_size(self) -> Self:
        check_street_lengths(self.streets.items())
        check_extent(self._iterate_points())
        return self

    def _iterate_points(self) -> Iterator[LocatedPoint]:
        for name, street in self.streets.items():
            yield from iterate_street_points(name, street)
        for index, item in enumerate(self.surroundings):
            yield from iterate_surrounding_points(index, item)
        for name, agent in self.agents.items():
            if isinstance(agent, Vehicle):
                yield ("agents", name, "spawn_m"), agent.spawn_m
                yield ("agents", name, "destination_m"), agent.destination_m
            else:
                yield ("agents", name, "position_m"), agent.position_m[:2]

    @model_validator(mode="after")
    def _check_references(self) -> Self:
        network = DeclaredStreets(
            self.sections,
            self.streets,
            imported=self.imported is not None,
            is_left_hand=self.is_left_hand,
        )
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
