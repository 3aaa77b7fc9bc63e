"""Mirror the tags of a town with traffic on the left to traffic on the right.

Left and right of a way are swapped, and lanes, which tags list from the left, are reversed.
"""

import re
from xml.etree.ElementTree import Element

SIDED_KEYS = frozenset(
    (
        *("bicycle", "bus", "busway", "change", "cycleway", "footway", "hov", "lanes", "maxspeed"),
        *("parking", "placement", "psv", "shoulder", "sidewalk", "turn", "vehicle", "verge"),
        "width",
    )
)
"""First parts of keys about a side or single lanes."""
SIDE = re.compile(r"left|right")
LANE_SEPARATOR = "|"


def mirror_tags(root: Element) -> None:
    """Exchange left and right in the tags of all ways, in place."""
    for way in root.iter("way"):
        for tag in way.iter("tag"):
            key, value = tag.get("k", ""), tag.get("v", "")
            parts = key.split(":")
            if parts[0] in SIDED_KEYS:
                tag.set("k", _exchange(key))
                lanes = value.split(LANE_SEPARATOR)
                tag.set("v", LANE_SEPARATOR.join(_exchange(lane) for lane in reversed(lanes)))


def _exchange(text: str) -> str:
    return SIDE.sub(lambda found: "right" if found[0] == "left" else "left", text)
