"""Round rings of roundabouts, which OpenStreetMap often has as polygons of a few nodes."""

import math
from xml.etree.ElementTree import Element

import numpy as np

from advercity.geometry.polyline import Points
from advercity.roads.osm_map import list_nodes, read_tags

ROUNDABOUTS = ("roundabout", "circular")
MAX_STEP_RAD = math.radians(12)
"""Angle by which a ring turns at most from one node to the next."""


def round_roundabouts(root: Element) -> None:
    """Add nodes to rings of a single way, in place, along a smooth curve through their own."""
    places = {
        item.attrib["id"]: (float(item.attrib["lon"]), float(item.attrib["lat"]))
        for item in root.iter("node")
    }
    for way in list(root.iter("way")):
        ring = list_nodes(way)
        is_ring = len(ring) > 3 and ring[0] == ring[-1] and all(name in places for name in ring)
        if is_ring and read_tags(way).get("junction") in ROUNDABOUTS:
            _round_ring(root, way, np.array([places[name] for name in ring[:-1]]))


def _round_ring(root: Element, way: Element, corners: Points) -> None:
    """Insert nodes after each of a ring's; corners are (n, 2) longitudes and latitudes."""
    scale = np.array([math.cos(math.radians(float(corners[0, 1]))), 1.0])
    curves = _interpolate_ring(corners * scale)
    names = list_nodes(way)[:-1]
    # netconvert takes nodes only among the nodes, before all ways.
    first_node = [item.tag for item in root].index("node")
    for item in list(way.iter("nd")):
        way.remove(item)
    for index, (name, points) in enumerate(zip(names, curves, strict=True)):
        way.append(Element("nd", {"ref": name}))
        for number, (longitude, latitude) in enumerate(points / scale):
            # Ids of the map have fewer digits.
            added = f"{name}{index:03d}{number:03d}"
            place = {"id": added, "lat": f"{latitude:.8f}", "lon": f"{longitude:.8f}"}
            root.insert(first_node, Element("node", place))
            way.append(Element("nd", {"ref": added}))
    way.append(Element("nd", {"ref": names[0]}))


def _interpolate_ring(corners: Points) -> list[Points]:
    """Interpolate a closed ring (n, 2) by cubic curves, as points (m, 2) after each corner."""
    steps = np.roll(corners, -1, axis=0) - corners
    lengths = np.linalg.norm(steps, axis=1, keepdims=True)
    directions = steps / lengths
    # On a circle, chords deviate from its tangent in proportion to their lengths.
    tangents = np.roll(directions, 1, axis=0) * lengths + directions * np.roll(lengths, 1, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    curves: list[Points] = []
    for index, length in enumerate(lengths):
        following = (index + 1) % len(corners)
        first, last = tangents[index], tangents[following]
        turn = math.acos(float(np.clip(first @ last, -1.0, 1.0)))
        count = int(turn / MAX_STEP_RAD)
        at = np.arange(1, count + 1)[:, None] / (count + 1)
        curves.append(
            corners[index] * (1 + 2 * at) * (1 - at) ** 2
            + corners[following] * at**2 * (3 - 2 * at)
            + length * first * at * (1 - at) ** 2
            - length * last * at**2 * (1 - at)
        )
    return curves
