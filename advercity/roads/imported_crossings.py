"""Which pedestrian crossings an imported map has, and which of netconvert's guesses it confirms."""

from collections.abc import Sequence
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import shapely

from advercity.roads.network_file import SumoEdge, SumoNetwork
from advercity.roads.osm_map import read_tags

MAX_MARK_DISTANCE_M = 20.0
"""Distance from a crossing within which the map marks one; maps draw streets as single lines."""


def marks_crossings(root: Element) -> bool:
    """Test whether an OpenStreetMap document says where crossings are."""
    return any(read_tags(item).get("highway") == "crossing" for item in root.iter("node"))


def build_discards(network: SumoNetwork, marked: Sequence[tuple[float, float]]) -> Element | None:
    """Build netconvert's list of crossings that no mark is nearest to; None if there are none."""
    confirmed = _find_confirmed(network, marked)
    root = Element("connections")
    for edge in network.edges:
        if edge.function == "crossing" and edge.id not in confirmed:
            _add_crossing(root, edge).set("discard", "true")
    return root if len(root) else None


def build_confirmed(network: SumoNetwork, marked: Sequence[tuple[float, float]]) -> list[Element]:
    """Build netconvert's elements for the crossings that marks are nearest to."""
    root = Element("connections")
    confirmed = _find_confirmed(network, marked)
    for edge in network.edges:
        if edge.id in confirmed:
            _add_crossing(root, edge)
    return list(root)


def _find_confirmed(network: SumoNetwork, marked: Sequence[tuple[float, float]]) -> set[str]:
    guessed = [edge for edge in network.edges if edge.function == "crossing"]
    lines = [shapely.LineString(edge.lanes[0].shape[:, :2]) for edge in guessed]
    _, nearest = shapely.STRtree(lines).query_nearest(
        shapely.points(np.array(marked)), max_distance=MAX_MARK_DISTANCE_M, all_matches=False
    )
    return {guessed[index].id for index in nearest.tolist()}


def _add_crossing(root: Element, edge: SumoEdge) -> Element:
    crossed = " ".join(edge.crossed_edges)
    return SubElement(root, "crossing", {"node": edge.junction, "edges": crossed})
