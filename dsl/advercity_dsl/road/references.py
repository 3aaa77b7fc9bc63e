"""Whether the streets and lanes that parts of a road name are there.

Each check raises a `Misfit` that says where the name stands, seen from the road.
"""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass

from advercity_dsl.base import Id, Misfit
from advercity_dsl.names import nearest
from advercity_dsl.road.agents import Vehicle
from advercity_dsl.road.junctions import Junction, Movement
from advercity_dsl.road.sections import CrossSection, Strip, StripKind
from advercity_dsl.road.streets import Street
from advercity_dsl.road.surroundings import Surrounding, SurroundingKind

Where = tuple[str | int, ...]
"""Path of a value, from the road."""


@dataclass(frozen=True)
class Network:
    """What can be named.

    Attributes:
        sections: By name.
        streets: By name.
        imported: Whether the streets come from a map, and so have no names.
    """

    sections: Mapping[Id, CrossSection]
    streets: Mapping[Id, Street]
    imported: bool

    def strips(self, street: Id, *, right: bool) -> tuple[Strip, ...]:
        """Those on a side of a street's axis."""
        section = self.sections[self.streets[street].section]
        return section.right if right else section.left


def check_street(network: Network, name: Id) -> None:
    """A street has a section and two ends."""
    street = network.streets[name]
    _expect(street.section, network.sections, ("streets", name, "section"))
    if street.begins == street.ends:
        message = f"begins and ends at '{street.ends}'"
        raise Misfit(("streets", name, "ends"), message, "name two places")


def check_junction(network: Network, name: Id, junction: Junction) -> None:
    """A junction names streets that meet there and lanes that they have."""
    where = ("junctions", name)
    meeting = [key for key, item in network.streets.items() if name in (item.begins, item.ends)]
    if not meeting:
        raise Misfit(where, "no street begins or ends here", "take it away")
    if (junction.control == "signals") != (junction.signals is not None):
        message = "'control: signals' and 'signals' go together"
        raise Misfit(where, message, "give both or none")
    for field, street in _named(junction):
        _expect(street, meeting, (*where, *field))
    for text in junction.arrows:
        street, _, number = text.partition(".")
        _expect(street, meeting, (*where, "arrows"))
        arrives = network.streets[street].ends == name
        _check_lane(network, street, int(number), (*where, "arrows"), along=arrives)
    for text in junction.movements:
        _check_movement(network, name, Movement.read(text), meeting)


def check_route(network: Network, name: Id, vehicle: Vehicle) -> None:
    """A vehicle drives along streets that there are."""
    where = ("agents", name, "route")
    if vehicle.route and network.imported:
        hint = "leave the route out, and the shortest way to the destination is taken"
        raise Misfit(where, "an imported road has no named streets", hint)
    for street in vehicle.route:
        _expect(street, network.streets, where)


def check_surrounding(network: Network, index: int, item: Surrounding) -> None:
    """What stands beside a street names one; parked cars, one with room for them."""
    if item.beside is None:
        return
    where, street = ("surroundings", index, "beside"), item.beside.street
    if network.imported:
        raise Misfit(where, "an imported road has no named streets", "say where in metres")
    _expect(street, network.streets, (*where, "street"))
    if item.kind is not SurroundingKind.PARKED_CARS:
        return
    for side in ("left", "right") if item.beside.side == "both" else (item.beside.side,):
        strips = network.strips(street, right=side == "right")
        if all(strip.kind is not StripKind.PARKING for strip in strips):
            message = f"'{street}' has no parking strip on its {side}"
            raise Misfit(where, message, "give its section one, or choose the other side")


def _named(junction: Junction) -> Iterator[tuple[tuple[str, ...], Id]]:
    """Streets that a junction names, each with the field that does."""
    yield from ((("crossings",), item.street) for item in junction.crossings)
    yield from ((("signs",), item.street) for item in junction.signs)
    yield from ((("median",), street) for street in junction.median or ())
    if junction.signals:
        yield from ((("signals", "cycle"), street) for street in junction.signals.cycle)
        yield from ((("signals", "heads"), item.street) for item in junction.signals.heads)


def _check_movement(network: Network, name: Id, way: Movement, meeting: Collection[Id]) -> None:
    where = ("junctions", name, "movements")
    _expect(way.from_street, meeting, where)
    _expect(way.to_street, meeting, where)
    arrives = network.streets[way.from_street].ends == name
    leaves = network.streets[way.to_street].begins == name
    _check_lane(network, way.from_street, way.from_lane, where, along=arrives)
    _check_lane(network, way.to_street, way.to_lane, where, along=leaves)


def _check_lane(network: Network, street: Id, number: int, where: Where, *, along: bool) -> None:
    strips = network.strips(street, right=along)
    count = sum(strip.kind is StripKind.LANE for strip in strips)
    if not 1 <= number <= count:
        way = "along" if along else "against"
        message = f"there is no lane '{street}.{number}'"
        raise Misfit(where, message, f"the street has {count} lanes {way} its axis")


def _expect(name: Id, known: Collection[Id], where: Where) -> None:
    if name not in known:
        raise Misfit(where, f"there is no '{name}' here", nearest(name, known))
