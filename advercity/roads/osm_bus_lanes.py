"""Bus lanes of OpenStreetMap extracts, as netconvert takes them.

netconvert has a lane for each of `lanes`, which leave cycle lanes out, and gives it the rule at the
same place in `bus:lanes` and the like, which do not.
"""

from collections.abc import Collection, Mapping
from xml.etree.ElementTree import Element

from advercity.foreign.ledger import Ledger
from advercity.roads.osm_map import ONE_WAY, read_tags

BUS_RULES = frozenset(("bus", "psv"))
OTHER_RULES = frozenset(("access", "bicycle", "motor_vehicle", "taxi", "vehicle"))
"""Rules of lanes known to netconvert, whose lanes may be cycle lanes."""


def select_bus_lanes(root: Element, streets: Collection[str], ledger: Ledger) -> None:
    """Keep the rules of bus lanes with a value for each lane; remove others, in place.

    Args:
        root: The extract.
        streets: Ids of the ways for cars.
        ledger: Record of omitted bus lanes.
    """
    for way in root.iter("way"):
        tags = read_tags(way) if way.get("id") in streets else {}
        for tag in list(way.iter("tag")) if tags else ():
            rule, found, direction = tag.get("k", "").partition(":lanes")
            values = tag.get("v", "").split("|")
            if not found or rule not in BUS_RULES | OTHER_RULES:
                continue
            if rule in BUS_RULES and _count_lanes(tags, direction) == len(values):
                continue
            way.remove(tag)
            if rule in BUS_RULES and "designated" in values:
                plural = "bus lanes (open to cars)"
                ledger.leave_out("bus lane (open to cars)", plural=plural, at=way)


def _count_lanes(tags: Mapping[str, str], direction: str) -> int | None:
    """Count the lanes of a direction, "" for a one-way street; None if the street does not say."""
    said = tags.get(f"lanes{direction}", "")
    if direction and not said:
        both = tags.get("lanes", "")
        return int(both) // 2 if both.isdecimal() else None
    is_clear = bool(direction) or tags.get("oneway") in ONE_WAY
    return int(said) if said.isdecimal() and is_clear else None
