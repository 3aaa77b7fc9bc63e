"""Omitted tags of OpenStreetMap extracts."""

import re
from collections.abc import Set
from xml.etree.ElementTree import Element

from advercity.foreign.ledger import Ledger
from advercity.foreign.standards import load_standard
from advercity.roads.osm_map import list_nodes, read_tags

SPEED_KEYS = ("maxspeed", "maxspeed:forward", "maxspeed:backward")
KNOWN_ZONES = {
    "urban": "AT AU BE CZ DE DK EE ES FR HU IT LT NO ON PT RO RS RU UZ",
    "rural": "AT BE-VLG BE-WAL CZ DE DK EE FR HU IT LT NO ON PT RO RS RU UZ",
    "motorway": "AT BE CZ DE DK FR GB HU IT PT RO RS RU UK UZ",
    "trunk": "AT CZ HU PT RO RS",
    "living_street": "HU RS RU UZ",
    "nsl_single": "GB UK",
    "nsl_dual": "GB UK",
}
"""Countries whose limits of a zone netconvert knows (SUMO 1.28)."""
NUMBER = re.compile(r"([A-Z]{2}:(zone)?)?\d+(\.\d+)?( ?(mph|km/h))?|none|no|walk")
"""Speed limits known to netconvert; without a unit, km/h."""


def audit_extract(root: Element, streets: Set[str], ledger: Ledger) -> None:
    """Record the omitted parts of an extract.

    Args:
        root: The extract.
        streets: Ids of the ways for cars.
        ledger: Record of omissions.
    """
    standard = load_standard("osm")
    at_streets: set[str] = set()
    for way in root.iter("way"):
        is_street = way.get("id") in streets
        standard.audit_tags(way, "street" if is_street else "way", ledger)
        if is_street:
            at_streets.update(list_nodes(way))
            _audit_speeds(way, ledger)
    for node in root.iter("node"):
        if node.get("id") in at_streets:
            standard.audit_tags(node, "node", ledger)
    for relation in root.iter("relation"):
        standard.audit_tags(relation, "relation", ledger)


def audit_widths(root: Element, streets: Set[str], ledger: Ledger) -> None:
    """Record widths of lanes on streets with sidewalks, which netconvert ignores."""
    for way in root.iter("way"):
        tags = read_tags(way) if way.get("id") in streets else {}
        has_sidewalk = any(
            key.startswith("sidewalk") and value in ("left", "right", "both", "yes")
            for key, value in tags.items()
        )
        if has_sidewalk and any(key.startswith("width:lanes") for key in tags):
            plural = "tags of lane widths beside sidewalks"
            ledger.leave_out("tag of lane widths beside sidewalks", plural=plural, at=way)


def _audit_speeds(way: Element, ledger: Ledger) -> None:
    tags = read_tags(way)
    for key in SPEED_KEYS:
        if key in tags and not _is_speed(tags[key]):
            name = f"speed limit {tags[key][:40]}"
            ledger.leave_out(name, plural=name, at=way)
    if not any(key in tags for key in (*SPEED_KEYS, "maxspeed:type", "zone:maxspeed")):
        ledger.leave_out(
            "street without a speed limit (that of its class is taken)",
            plural="streets without a speed limit (that of their class is taken)",
            at=way,
        )


def _is_speed(value: str) -> bool:
    country, _, zone = value.partition(":")
    return bool(NUMBER.fullmatch(value)) or country in KNOWN_ZONES.get(zone, "").split()
