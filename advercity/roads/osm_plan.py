"""OpenStreetMap extracts, prepared for netconvert.

The document is in metres instead of degrees, has traffic on the right, and has the implied parts of
towns: round rings, sidewalks.
"""

from pathlib import Path
from xml.etree.ElementTree import Element

import sumo
from advercity_dsl import MapFile, Road

from advercity.errors import InputError
from advercity.foreign.ledger import Ledger
from advercity.foreign.xml_documents import get_line
from advercity.roads.driving_sides import assume_driving_side
from advercity.roads.imported_crossings import discard_unmarked, get_guess_options
from advercity.roads.map_conversion import CAR_OPTIONS, WALKED_CLASSES, Conversion, convert
from advercity.roads.map_names import get_map_id
from advercity.roads.map_plan import MapPlan, Side, build_extent_options, check_distance
from advercity.roads.osm_bus_lanes import select_bus_lanes
from advercity.roads.osm_levels import set_heights
from advercity.roads.osm_map import REMOVED_TYPE, OsmMap, add_sidewalks, mark_paths, read_tags
from advercity.roads.osm_mirror import mirror_tags
from advercity.roads.osm_roundabouts import round_roundabouts
from advercity.roads.osm_tags import audit_extract, audit_widths

MAX_LATITUDE_DEG, MAX_LONGITUDE_DEG = 90, 180
METRES = {"osm-files": "map.xml", "proj": "!"}
"""Options for a document in metres, which is not projected."""
OSM_OPTIONS = {
    **CAR_OPTIONS,
    **METRES,
    # netconvert makes the sidewalk at the left of a one-way street an edge of its own.
    "keep-edges.by-vclass": WALKED_CLASSES,
    "remove-edges.by-type": REMOVED_TYPE,
    "osm.sidewalks": "true",
    "osm.elevation": "true",
    "osm.lane-access": "true",
    "geometry.remove": "true",
    "junctions.join": "true",
    "tls.discard-simple": "true",
    "tls.join": "true",
    "tls.guess-signals": "true",
}
TYPES = Path(sumo.SUMO_HOME) / "data" / "typemap"
URBAN_TYPES = ",".join(str(TYPES / f"osmNetconvert{name}.typ.xml") for name in ("", "UrbanDe"))
"""Limits of streets in towns without one in the map: 50 km/h, motorways 100. Without these files,
SUMO has 100 km/h for `secondary`."""


def plan_extract(root: Element, road: Road, declared: MapFile, ledger: Ledger) -> MapPlan:
    """Complete an extract, in place, and lay it out in the plan.

    Args:
        root: The extract, whose nodes are on the globe.
        road: The road, whose origin locates it.
        declared: The map as the road declares it.
        ledger: Record of omissions.

    Raises:
        InputError: It is far from the road's origin, or its ways disagree about the driving side.
    """
    _check_places(root, road)
    side = _find_driving_side(root, road, declared, ledger)
    round_roundabouts(root)
    if side == "left":
        mirror_tags(root)
    osm = OsmMap.around(road, root, is_mirrored=side == "left")
    plan = osm.build_plan()
    streets = _find_streets(plan)
    audit_extract(root, streets, ledger)
    select_bus_lanes(plan, streets, ledger)
    mark_paths(plan, streets)
    set_heights(plan, streets, ledger)
    options = dict(OSM_OPTIONS)
    if road.land_use == "urban":
        options["type-files"] = URBAN_TYPES
        add_sidewalks(osm)
    audit_widths(root, streets, ledger)
    crossings = osm.list_points("highway", "crossing")
    extent = build_extent_options(declared, side=side)
    options |= get_guess_options(road, crossings) | extent
    return MapPlan(
        Conversion({"map.xml": plan}, options),
        side,
        crossings=crossings,
        confirm=discard_unmarked,
    )


def _find_streets(plan: Element) -> set[str]:
    """Find the ids of the ways for cars, by netconvert's reading of their tags."""
    options = {**METRES, "keep-edges.by-vclass": "passenger"}
    found = convert(Conversion({"map.xml": plan}, options))
    return {get_map_id(item.attrib["id"]) for item in found.iter("edge")}


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
            f"line {get_line(said['right'])}: traffic is on the right on {right},"
            f" but on the left on {left}; a road has one side, which `driving_side` may declare"
        )
    if "left" in said:
        return "left"
    if "right" in said:
        return "right"
    return assume_driving_side((road.origin_lat_deg, road.origin_lon_deg), ledger)


def _check_places(root: Element, road: Road) -> None:
    """Check the latitudes and longitudes of an extract, and its distance from the road's origin."""
    try:
        nodes = [
            (float(item.attrib["lat"]), float(item.attrib["lon"])) for item in root.iter("node")
        ]
    except (KeyError, ValueError):
        raise InputError("has a node without latitude and longitude") from None
    if not nodes:
        raise InputError("has no nodes")
    for latitude, longitude in nodes:
        if not (abs(latitude) <= MAX_LATITUDE_DEG and abs(longitude) <= MAX_LONGITUDE_DEG):
            raise InputError(
                f"has a node at latitude {latitude:g} and longitude"
                f" {longitude:g}; latitudes are -{MAX_LATITUDE_DEG} to {MAX_LATITUDE_DEG} degrees,"
                f" longitudes -{MAX_LONGITUDE_DEG} to {MAX_LONGITUDE_DEG}"
            )
    check_distance(nodes, road)
