"""Paving inside the junctions of an OpenDRIVE map: the lanes of its connecting roads.

netconvert makes junctions of its own from the streets that meet, without the sidewalks and
shoulders that lead through them. Detached, the connecting roads are converted with all their lanes.
"""

from collections.abc import Iterable
from copy import deepcopy
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import shapely
from advercity_dsl.units import Point2

from advercity.roads.network_file import SumoLane

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


def add_outlines(
    net: Element, lanes: Iterable[SumoLane], extent_m: tuple[Point2, Point2] | None
) -> None:
    """Add the outlines of connecting lanes, in the plan, to a network.

    Args:
        net: The network.
        lanes: Lanes of the detached roads.
        extent_m: Corners of the rectangle that outlines reach into; None adds all.
    """
    wanted = None if extent_m is None else shapely.MultiPoint(np.array(extent_m)).envelope
    for lane in lanes:
        if lane.function != "normal" or lane.kind not in OUTLINE_KINDS or len(lane.centre) < 2:
            continue
        ring = shapely.Polygon(np.vstack([lane.left_border, lane.right_border[::-1]])[:, :2])
        if wanted is None or shapely.intersects(wanted, ring):
            plain = shapely.get_coordinates(shapely.simplify(ring, OUTLINE_TOLERANCE_M))
            shape = " ".join(f"{x:.2f},{y:.2f}" for x, y in plain)
            kind = OUTLINE_KINDS[lane.kind]
            SubElement(net, "poly", {"id": f"{kind}_{lane.id}", "type": kind, "shape": shape})
