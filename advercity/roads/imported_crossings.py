"""Which pedestrian crossings an imported map has, and which of netconvert's guesses it confirms."""

from collections.abc import Sequence
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import shapely

from advercity.roads.network_file import SumoNetwork
from advercity.roads.osm_map import read_tags

MAX_MARK_DISTANCE_M = 20.0
"""Distance from a crossing within which the map marks one; maps draw streets as single lines."""


def marks_crossings(root: Element) -> bool:
    """Test whether an OpenDRIVE or OpenStreetMap document says where crossings are."""
    return any(item.get("type") == "crosswalk" for item in root.iter("object")) or any(
        read_tags(item).get("highway") == "crossing" for item in root.iter("node")
    )


def take_crosswalks(net: Element) -> list[tuple[float, float]]:
    """Remove the objects of the map from a network; the middles of its crosswalks."""
    objects = list(net.iter("poly"))
    for item in objects:
        net.remove(item)
    walks = [item for item in objects if item.get("type") == "crosswalk"]
    rings = [[point.split(",") for point in item.attrib["shape"].split()] for item in walks]
    middles = [np.array(ring, dtype=np.float64)[:, :2].mean(axis=0) for ring in rings]
    return [(float(x), float(y)) for x, y in middles]


def build_discards(
    net: Element, network: SumoNetwork, marked: Sequence[tuple[float, float]]
) -> Element | None:
    """Build netconvert's list of crossings that no mark is nearest to; None if there are none."""
    guessed = [edge for edge in network.edges if edge.function == "crossing"]
    lines = [shapely.LineString(edge.lanes[0].shape[:, :2]) for edge in guessed]
    _, nearest = shapely.STRtree(lines).query_nearest(
        shapely.points(np.array(marked)), max_distance=MAX_MARK_DISTANCE_M, all_matches=False
    )
    confirmed = set(nearest.tolist())
    away = {edge.id for index, edge in enumerate(guessed) if index not in confirmed}
    root = Element("connections")
    for item in net.iter("edge"):
        if item.get("id") in away:
            junction = item.attrib["id"][1:].rpartition("_")[0]
            crossed = item.attrib["crossingEdges"]
            SubElement(root, "crossing", {"node": junction, "edges": crossed, "discard": "true"})
    return root if away else None
