"""Round rings of roundabouts, which OpenStreetMap often has as polygons of a few nodes."""

import math
from collections.abc import Iterator, Sequence
from xml.etree.ElementTree import Element

import numpy as np

from advercity.geometry.polyline import Points
from advercity.roads.osm_map import list_nodes, read_tags

ROUNDABOUTS = ("roundabout", "circular")
MAX_STEP_RAD = math.radians(12)
"""Angle by which a ring turns at most from one node to the next."""


def round_roundabouts(root: Element) -> None:
    """Add nodes to rings, of one way or of several in a row, in place, along a smooth curve."""
    places = {
        item.attrib["id"]: (float(item.attrib["lon"]), float(item.attrib["lat"]))
        for item in root.iter("node")
    }
    for ways in _find_rings(root):
        names = [name for way in ways for name in list_nodes(way)[:-1]]
        if len(names) > 2 and all(name in places for name in names):
            _round_ring(root, ways, np.array([places[name] for name in names]))


def _find_rings(root: Element) -> Iterator[list[Element]]:
    """Yield the ways of each ring, each of which begins where the one before ends."""
    starts = {
        list_nodes(way)[0]: way
        for way in root.iter("way")
        if read_tags(way).get("junction") in ROUNDABOUTS and len(list_nodes(way)) > 1
    }
    while starts:
        first = next(iter(starts))
        ring = [starts.pop(first)]
        while (last := list_nodes(ring[-1])[-1]) in starts:
            ring.append(starts.pop(last))
        if last == first:
            yield ring


def _round_ring(root: Element, ways: Sequence[Element], corners: Points) -> None:
    """Insert nodes after each of a ring's; corners are (n, 2) longitudes and latitudes."""
    scale = np.array([math.cos(math.radians(float(corners[0, 1]))), 1.0])
    curves = iter(_interpolate_ring(corners * scale))
    # netconvert takes nodes only among the nodes, before all ways.
    first_node = [item.tag for item in root].index("node")
    for way in ways:
        *names, last = list_nodes(way)
        for item in list(way.iter("nd")):
            way.remove(item)
        for index, name in enumerate(names):
            way.append(Element("nd", {"ref": name}))
            for number, (longitude, latitude) in enumerate(next(curves) / scale):
                # Ids of the map have fewer digits.
                added = f"{name}{index:03d}{number:03d}"
                place = {"id": added, "lat": f"{latitude:.8f}", "lon": f"{longitude:.8f}"}
                root.insert(first_node, Element("node", place))
                way.append(Element("nd", {"ref": added}))
        way.append(Element("nd", {"ref": last}))


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
