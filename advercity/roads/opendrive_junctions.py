"""Paving inside the junctions of an OpenDRIVE map: the lanes of its connecting roads.

netconvert makes junctions of its own from the streets that meet, without the sidewalks and
shoulders that lead through them. Detached, the connecting roads are converted with all their lanes.
"""

from copy import deepcopy
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import shapely

from advercity.roads.network_file import SumoNetwork

OUTLINE_TOLERANCE_M = 0.02
OUTLINE_KINDS = {"driving": "roadway", "shoulder": "roadway", "sidewalk": "sidewalk"}
"""Kinds of outlines by kind of lane."""


def detach_connecting_roads(root: Element) -> Element | None:
    """Copy the connecting roads of a map as streets that do not meet; None if it has none."""
    found = deepcopy(root)
    for item in list(found):
        if item.tag == "junction" or (item.tag == "road" and item.get("junction", "-1") == "-1"):
            found.remove(item)
    for road in found.iter("road"):
        road.set("junction", "-1")
        for part in [road, *road.iter("lane")]:
            for child in list(part):
                if child.tag in ("link", "objects", "signals"):
                    part.remove(child)
    return found if found.find("road") is not None else None


def add_outlines(net: Element, connecting_roads: SumoNetwork) -> None:
    """Add the outlines of lanes, in the plan, to a network."""
    for lane in connecting_roads.lanes:
        if lane.function == "normal" and lane.kind in OUTLINE_KINDS and len(lane.centre) > 1:
            ring = shapely.Polygon(np.vstack([lane.left_border, lane.right_border[::-1]])[:, :2])
            plain = shapely.get_coordinates(shapely.simplify(ring, OUTLINE_TOLERANCE_M))
            shape = " ".join(f"{x:.2f},{y:.2f}" for x, y in plain)
            kind = OUTLINE_KINDS[lane.kind]
            SubElement(net, "poly", {"id": f"{kind}_{lane.id}", "type": kind, "shape": shape})
