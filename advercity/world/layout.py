"""A road's geometry, from which its network, its lanes and its meshes are all made."""

from dataclasses import dataclass

from advercity_dsl.road import Road

from advercity.streets import StreetLayout, lay_street
from advercity.world.junctions import JunctionLayout, lay_junction


@dataclass(frozen=True)
class Layout:
    """Streets and junctions by id, in the order of the declaration."""

    road: Road
    streets: dict[str, StreetLayout]
    junctions: dict[str, JunctionLayout]


def layout(road: Road) -> Layout:
    """Lay out a declared road; InputError where streets cannot be joined as declared."""
    streets = {name: lay_street(name, item, road) for name, item in road.streets.items()}
    junctions = {name: lay_junction(name, item, streets) for name, item in road.junctions.items()}
    return Layout(road=road, streets=streets, junctions=junctions)
