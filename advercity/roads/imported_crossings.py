"""Pedestrian crossings of an imported map: netconvert's guesses, if the map has marks for them."""

from collections.abc import Iterator, Sequence
from copy import copy
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import shapely
from advercity_dsl import Road

from advercity.roads.map_conversion import NETWORK_OPTIONS, WALKED_CLASSES, Conversion
from advercity.roads.network_file import SumoEdge, SumoNetwork, parse_network

MAX_MARK_DISTANCE_M = 20.0
"""Distance from a crossing within which the map marks one; maps draw streets as single lines."""
Marks = Sequence[tuple[float, float]]


def get_guess_options(road: Road, marked: Marks) -> dict[str, str]:
    """Return netconvert's option for guessed crossings.

    If a map has no crossings, junctions of towns get some, junctions in the country none. Marks of
    a map confirm guesses, since netconvert does not take them over.
    """
    return {"crossings.guess": str(road.land_use == "urban" or len(marked) > 0).lower()}


def discard_unmarked(marked: Marks, converted: Element) -> Conversion | None:
    """Build the conversion that removes the unconfirmed crossings of a network."""
    network = parse_network(converted)
    confirmed = _find_confirmed(network, marked)
    root = Element("connections")
    for edge in _list_crossings(network):
        if edge.id not in confirmed:
            _add_crossing(root, edge).set("discard", "true")
    if not len(root):
        return None
    # Of edges for pedestrians alone, only the ones to keep have been converted.
    options = {"keep-edges.by-vclass": WALKED_CLASSES, "connection-files": "crossings.con.xml"}
    documents = {"map.xml": converted, "crossings.con.xml": root}
    return Conversion(documents, NETWORK_OPTIONS | options)


def declare_marked(marked: Marks, converted: Element, plain: Conversion) -> Conversion:
    """Build the conversion of plain XML with the guessed crossings confirmed by marks.

    Args:
        marked: Middles of the crossings of the map.
        converted: The network with guessed crossings.
        plain: The conversion of the network.
    """
    network = parse_network(converted)
    confirmed = _find_confirmed(network, marked)
    connections = copy(plain.documents["connections.xml"])
    for edge in _list_crossings(network):
        if edge.id in confirmed:
            _add_crossing(connections, edge)
    documents = {**plain.documents, "connections.xml": connections}
    return Conversion(documents, {**plain.options, "crossings.guess": "false"})


def count_unbuilt(marked: Marks, converted: Element) -> int:
    """Count the marks on streets of a network near which it has no crossing."""
    if not len(marked):
        return 0
    network = parse_network(converted)
    lanes = [lane.shape[:, :2] for lane in network.lanes if lane.is_driving_lane]
    built = [edge.lanes[0].shape[:, :2] for edge in _list_crossings(network)]
    marks = shapely.points(np.array(marked))
    on_street, without = (
        shapely.distance(marks, shapely.MultiLineString(lines)) for lines in (lanes, built)
    )
    near_m = MAX_MARK_DISTANCE_M
    return int(np.count_nonzero((on_street < near_m) & ~(without < near_m)))


def _find_confirmed(network: SumoNetwork, marked: Marks) -> set[str]:
    guessed = list(_list_crossings(network))
    lines = [shapely.LineString(edge.lanes[0].shape[:, :2]) for edge in guessed]
    _, nearest = shapely.STRtree(lines).query_nearest(
        shapely.points(np.array(marked)), max_distance=MAX_MARK_DISTANCE_M, all_matches=False
    )
    return {guessed[index].id for index in nearest.tolist()}


def _list_crossings(network: SumoNetwork) -> Iterator[SumoEdge]:
    return (edge for edge in network.edges if edge.function == "crossing")


def _add_crossing(root: Element, edge: SumoEdge) -> Element:
    crossed = " ".join(edge.crossed_edges)
    return SubElement(root, "crossing", {"node": edge.junction, "edges": crossed})
