"""OpenStreetMap extracts as netconvert takes them.

The document is in metres instead of degrees, has traffic on the right, and what towns have without
saying so: round rings, sidewalks.
"""

from collections.abc import Callable, Set
from xml.etree.ElementTree import Element

from advercity_dsl import MapFile, Road

from advercity.errors import InputError
from advercity.foreign.ledger import Ledger
from advercity.foreign.xml_documents import get_line
from advercity.roads.driving_sides import find_left_hand_region
from advercity.roads.map_plan import MapPlan, Side
from advercity.roads.osm_levels import set_heights
from advercity.roads.osm_map import OsmMap, add_sidewalks, mark_paths, read_tags
from advercity.roads.osm_mirror import mirror_tags
from advercity.roads.osm_roundabouts import round_roundabouts
from advercity.roads.osm_tags import audit_extract, audit_widths


def plan_extract(
    root: Element,
    road: Road,
    declared: MapFile,
    find_streets: Callable[[Element], Set[str]],
    ledger: Ledger,
) -> MapPlan:
    """Complete an extract, in place, and lay it out in the plan.

    Args:
        root: The extract, whose nodes are on the globe.
        road: The road, whose origin locates it.
        declared: The map as the road declares it.
        find_streets: Finds the ids of the ways that cars may use in a document in metres.
        ledger: Where to record what is left out.

    Raises:
        InputError: Some ways say that traffic is on the left, others that it is on the right.
    """
    side = _find_driving_side(root, road, declared, ledger)
    round_roundabouts(root)
    if side == "left":
        mirror_tags(root)
    osm = OsmMap.around(road, root, is_mirrored=side == "left")
    plan = osm.build_plan()
    streets = find_streets(plan)
    audit_extract(root, streets, ledger)
    mark_paths(plan, streets)
    set_heights(plan, streets, ledger)
    if road.land_use == "urban":
        add_sidewalks(osm)
    audit_widths(root, streets, ledger)
    return MapPlan(plan, side, crossings=tuple(osm.list_points("highway", "crossing")))


def _find_driving_side(root: Element, road: Road, declared: MapFile, ledger: Ledger) -> Side:
    """Find the side by the declaration, else by the map, else by the country."""
    if declared.driving_side is not None:
        return declared.driving_side
    said: dict[str, Element] = {}
    for way in root.iter("way"):
        tags = read_tags(way)
        if "highway" in tags and "driving_side" in tags:
            said.setdefault(tags["driving_side"], way)
    if {"left", "right"} <= said.keys():
        left, right = (f"way {said[side].get('id')}" for side in ("left", "right"))
        raise InputError(
            f"{declared.file}: line {get_line(said['right'])}: traffic is on the right on {right},"
            f" but on the left on {left}; a road has one side, which `driving_side` may declare"
        )
    if "left" in said:
        return "left"
    region = find_left_hand_region(road.origin_lat_deg, road.origin_lon_deg)
    if "right" in said or region is None:
        return "right"
    ledger.leave_out(f"driving side that the map lacks (left, as in {region}, is assumed)")
    return "left"
