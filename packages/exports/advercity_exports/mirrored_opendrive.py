"""OpenDRIVE as netconvert writes it, mirrored at the x axis for traffic on the left.

Roads get rule LHT: lanes are left of the reference line, with positive ids, in the old direction.
"""

from collections.abc import Iterable, Mapping
from itertools import product
from xml.etree.ElementTree import Element

_POLYNOMIAL = ("a", "b", "c", "d")
_NEGATED: Mapping[str, Iterable[str]] = {
    "geometry": ("y", "hdg"),
    "arc": ("curvature",),
    "spiral": ("curvStart", "curvEnd"),
    "poly3": _POLYNOMIAL,
    "paramPoly3": tuple(f"{name}V" for name in _POLYNOMIAL),
    "laneOffset": _POLYNOMIAL,
    "superelevation": _POLYNOMIAL,
    "lane": ("id",),
    "laneLink": ("from", "to"),
    "validity": ("fromLane", "toLane"),
    "header": ("south", "north"),
    "object": ("t", "hdg", "roll"),
    "cornerLocal": ("v",),
    "cornerRoad": ("t",),
    "signal": ("t", "hOffset", "roll"),
    "signalReference": ("t",),
}
"""Attributes of each element with a new sign: offsets to the left, turns, ids of lanes."""
_RANGES = {"validity": ("fromLane", "toLane"), "header": ("south", "north")}
"""Attributes of the lower and the upper end of a range, which are exchanged too."""


def mirror_opendrive(root: Element) -> None:
    """Mirror a document with traffic on the right at the x axis, in place."""
    for item in root.iter():
        for name in _NEGATED.get(item.tag, ()):
            _negate(item, name)
    for link in (link for lane in root.iter("lane") for link in lane.iter("link")):
        for item in link:
            _negate(item, "id")
    for tag, (low, high) in _RANGES.items():
        for item in root.iter(tag):
            item.attrib |= {low: item.get(high, "0"), high: item.get(low, "0")}
    for road in root.iter("road"):
        road.set("rule", "LHT")
    for section in root.iter("laneSection"):
        _swap_sides(section)


def _swap_sides(section: Element) -> None:
    """Exchange the lanes of both sides; ids fall from the leftmost lane on, as in the schema."""
    sides = {"left": "right", "right": "left"}
    for side in section:
        side.tag = sides.get(side.tag, side.tag)
        side[:] = list(side)[::-1]
    order = ("left", "center", "right")
    section[:] = [side for tag, side in product(order, section) if side.tag == tag]


def _negate(item: Element, name: str) -> None:
    """Change the sign of a number, digit by digit the same."""
    text = item.get(name)
    if text is not None and float(text) != 0:
        item.set(name, text[1:] if text.startswith("-") else f"-{text}")
