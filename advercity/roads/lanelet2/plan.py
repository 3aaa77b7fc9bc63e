"""Lanelet2 maps as plans of an import."""

from xml.etree.ElementTree import Element

import shapely
from advercity_dsl import MapFile, Road
from shapely import LineString

from advercity.foreign.ledger import Ledger
from advercity.geometry.mirroring import mirror_points
from advercity.roads.driving_sides import assume_driving_side
from advercity.roads.lanelet2.document import parse_document
from advercity.roads.lanelet2.lanelets import (
    Lanelet,
    has_left_hand_traffic,
    list_crosswalks,
    read_lanelets,
)
from advercity.roads.lanelet2.network import LaneletTopology, build_plain_network, find_approaches
from advercity.roads.lanelet2.omissions import record_omissions, record_rules, record_unused
from advercity.roads.lanelet2.paint import list_stripes
from advercity.roads.lanelet2.placing import PlacedNodes, place_nodes
from advercity.roads.lanelet2.rules import RightOfWay
from advercity.roads.map_plan import MapPlan, Side, place_extent


def plan_lanelet2(root: Element, road: Road, declared: MapFile, ledger: Ledger) -> MapPlan:
    """Lay out a map in the plan.

    Args:
        root: The document.
        road: The road, whose origin locates latitudes and longitudes.
        declared: The map as the road declares it.
        ledger: Record of omissions.

    Raises:
        InputError: The document refers to a missing element, or has an invalid number.
    """
    record_omissions(root, ledger)
    document = parse_document(root)
    placed = place_nodes(document.nodes, road, ledger)
    lanelets = read_lanelets(document, placed.points, ledger)
    crosswalks = list(list_crosswalks(document, placed.points))
    stripes = list(list_stripes(document, placed.points))
    side = _find_driving_side(lanelets, placed, declared, ledger)
    if side == "left":
        lanelets = tuple(item.mirror for item in lanelets)
        crosswalks = [mirror_points(item) for item in crosswalks]
        stripes = [(mark, mirror_points(line)) for mark, line in stripes]
    box = place_extent(declared, placed.origin_m, side)
    if box is not None:
        lanelets = tuple(item for item in lanelets if shapely.box(*box).intersects(item.area))
        stripes = [item for item in stripes if shapely.box(*box).intersects(LineString(item[1]))]
    topology = LaneletTopology.of_lanelets(lanelets)
    record_unused(document, topology, lanelets, ledger)
    approaches = find_approaches(topology, RightOfWay(document))
    record_rules(document, topology, approaches, ledger)
    plain = build_plain_network(topology, lanelets, approaches, crosswalks, stripes)
    return plain.plan(road, side, placed.origin_m, placed.place)


def _find_driving_side(
    lanelets: tuple[Lanelet, ...], placed: PlacedNodes, declared: MapFile, ledger: Ledger
) -> Side:
    """Find the side by the declaration, else by opposite lanelets, else by the country."""
    if declared.driving_side is not None:
        return declared.driving_side
    is_left = has_left_hand_traffic(lanelets)
    if is_left is not None:
        return "left" if is_left else "right"
    place = placed.place
    return assume_driving_side(place and (place.latitude_deg, place.longitude_deg), ledger)
