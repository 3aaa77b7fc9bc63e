"""OpenDRIVE maps as plans of an import."""

from xml.etree.ElementTree import Element

import shapely
from advercity_dsl import MapFile, Road

from advercity.foreign.ledger import Ledger
from advercity.roads.map_plan import MapPlan, place_extent
from advercity.roads.opendrive.network import build_plain_network
from advercity.roads.opendrive.omissions import record_omissions
from advercity.roads.opendrive.parsing import parse_opendrive
from advercity.roads.opendrive.placing import place_map


def plan_opendrive(root: Element, road: Road, declared: MapFile, ledger: Ledger) -> MapPlan:
    """Lay out a map in the plan.

    Args:
        root: The document.
        road: The road with the map.
        declared: The map as the road declares it.
        ledger: Record of omissions.

    Raises:
        InputError: It has an invalid value.
    """
    record_omissions(root, ledger)
    placed = place_map(parse_opendrive(root))
    box = place_extent(declared, placed.origin_m, placed.driving_side)
    extent = None if box is None else shapely.box(*box)
    plain = build_plain_network(placed.document, extent, ledger)
    return plain.plan(road, placed.driving_side, placed.origin_m, placed.place)
