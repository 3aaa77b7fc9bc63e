"""Foreign SUMO networks, prepared for netconvert: traffic on the right, without unsafe parts."""

import math
from collections.abc import Iterator
from xml.etree.ElementTree import Element

import numpy as np
from advercity_dsl import MapFile, Road
from advercity_dsl.road import MapPlace
from advercity_dsl.units import Point2

from advercity.errors import InputError
from advercity.foreign.ledger import Ledger
from advercity.foreign.standards import load_standard
from advercity.roads.georeference import choose_origin, locate_origin
from advercity.roads.map_conversion import NETWORK_OPTIONS, Conversion
from advercity.roads.map_plan import MapPlan, build_extent_options
from advercity.roads.sumo_xml import sanitize_network

TRUE_WORDS = ("true", "True", "yes", "on", "1", "x")
"""SUMO's words for true."""
SHAPES = ("shape", "outlineShape")
NO_NUMBER = "has a place that is no number"


def plan_network(root: Element, road: Road, declared: MapFile, ledger: Ledger) -> MapPlan:
    """Lay out a foreign network in the plan.

    SUMO counts lanes from the left if traffic is on the left; mirroring counts from the right.

    Args:
        root: The network.
        road: The road with the map.
        declared: The map as the road declares it.
        ledger: Record of omissions.

    Raises:
        InputError: A part of it is refused.
    """
    load_standard("sumo_network").audit(root, ledger)
    _record_closed_lanes(root, ledger)
    net = sanitize_network(root, for_netconvert=True)
    _keep_last_programs(net, ledger)
    origin_m = _choose_origin(net)
    side = "left" if root.get("lefthand") in TRUE_WORDS else "right"
    place_network(net, origin_m, is_mirrored=side == "left")
    place = _locate(root.find("location"), origin_m, ledger)
    extent = build_extent_options(declared, origin_m, side)
    # A network has all its crossings; netconvert guesses more only if it is asked to.
    options = NETWORK_OPTIONS | extent
    return MapPlan(Conversion({"map.xml": net}, options), side, origin_m, place)


def place_network(net: Element, origin_m: Point2, *, is_mirrored: bool) -> None:
    """Move a network to a local origin, and mirror it at the x axis, in place.

    Raises:
        InputError: A place is no number.
    """
    if origin_m == (0.0, 0.0) and not is_mirrored:
        return
    sign = -1.0 if is_mirrored else 1.0

    def place_x(text: str) -> str:
        return repr(float(text) - origin_m[0])

    def place_y(text: str) -> str:
        return repr(sign * (float(text) - origin_m[1]))

    def place_point(point: str) -> str:
        x, y, *above = point.split(",")
        return ",".join((place_x(x), place_y(y), *above))

    try:
        for item in net.iter():
            for name in SHAPES:
                if shape := item.get(name):
                    item.set(name, " ".join(map(place_point, shape.split())))
            if item.tag == "junction":
                for name, place in (("x", place_x), ("y", place_y)):
                    if name in item.attrib:
                        item.set(name, place(item.attrib[name]))
    except ValueError:
        raise InputError(NO_NUMBER) from None


def _choose_origin(net: Element) -> Point2:
    """Choose the network's coordinates of the plan's origin."""
    shapes = (lane.get("shape", "").split() for lane in net.iter("lane"))
    try:
        starts = [tuple(map(float, shape[0].split(",")[:2])) for shape in shapes if shape]
        if not starts:
            return 0.0, 0.0
        west, south, east, north = (*np.min(starts, axis=0), *np.max(starts, axis=0))
    except ValueError:
        raise InputError(NO_NUMBER) from None
    return choose_origin(float(west), float(south), float(east), float(north))


def _locate(location: Element | None, origin_m: Point2, ledger: Ledger) -> MapPlace | None:
    """Locate the plan's origin: SUMO adds an offset to projected points."""
    if location is None or location.get("projParameter", "!") in ("!", "-", ""):
        return None
    try:
        offset_x, offset_y = map(float, location.get("netOffset", "0,0").split(","))
    except ValueError:
        offset_x = offset_y = math.nan
    place = locate_origin(
        location.attrib["projParameter"], origin_m[0] - offset_x, origin_m[1] - offset_y
    )
    if place is None:
        ledger.leave_out("projection of the map", plural="projections of the map", at=location)
    return place


def _record_closed_lanes(root: Element, ledger: Ledger) -> None:
    """Record lanes of vehicles outside the simulation, and streets without lanes for cars."""
    for edge in root.iter("edge"):
        if edge.get("function", "normal") == "connector":
            ledger.leave_out("connector of traffic zones", plural="connectors of traffic zones")
        if edge.get("function", "normal") != "normal":
            continue
        lanes = list(edge.iter("lane"))
        if not any("passenger" in _list_classes(lane) for lane in lanes):
            ledger.leave_out("street without cars", plural="streets without cars", at=edge)
            continue
        for lane in lanes:
            allowed = set(_list_classes(lane))
            if allowed and not allowed & {"passenger", "pedestrian"}:
                name = f"lane for {' '.join(sorted(allowed))[:60]}"
                ledger.leave_out(f"traffic on a {name}", plural=f"traffic on each {name}", at=lane)


def _list_classes(lane: Element) -> Iterator[str]:
    """List the classes allowed in a lane, or cars, people and bicycles by default."""
    if "allow" in lane.attrib:
        named = lane.attrib["allow"].split()
        yield from (("passenger", "pedestrian") if "all" in named else named)
        return
    banned = lane.get("disallow", "").split()
    yield from (
        name for name in ("passenger", "pedestrian", "bicycle") if not {name, "all"} & {*banned}
    )


def _keep_last_programs(net: Element, ledger: Ledger) -> None:
    """Keep the program with which SUMO begins of each light: the last one."""
    last = {item.get("id"): item for item in net.iter("tlLogic")}
    for item in list(net.iter("tlLogic")):
        if item is not last[item.get("id")]:
            net.remove(item)
            ledger.leave_out("further program of a light", plural="further programs of lights")
        elif item.get("offset") == "begin":
            item.set("offset", "0")
