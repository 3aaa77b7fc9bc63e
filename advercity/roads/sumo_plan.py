"""SUMO networks of others as netconvert takes them: traffic on the right, and nothing unsafe."""

from collections.abc import Iterator
from xml.etree.ElementTree import Element

from advercity.errors import InputError
from advercity.foreign.ledger import Ledger
from advercity.foreign.standards import load_standard
from advercity.roads.map_plan import MapPlan
from advercity.roads.sumo_xml import sanitize_network

TRUE_WORDS = ("true", "True", "yes", "on", "1", "x")
"""SUMO's words for true."""
SHAPES = ("shape", "outlineShape")


def plan_network(root: Element, ledger: Ledger) -> MapPlan:
    """Lay out a network of somebody else in the plan.

    SUMO counts the lanes of a network with traffic on the left from the left; mirrored, they are
    counted from the right.

    Args:
        root: The network.
        ledger: Where to record what is left out.

    Raises:
        InputError: Something of it is refused.
    """
    load_standard("sumo_network").audit(root, ledger)
    _record_closed_lanes(root, ledger)
    net = sanitize_network(root, for_netconvert=True)
    _keep_last_programs(net, ledger)
    if root.get("lefthand") not in TRUE_WORDS:
        return MapPlan(net, "right")
    mirror_network(net)
    return MapPlan(net, "left")


def mirror_network(net: Element) -> None:
    """Mirror a network at its x axis, in place.

    Raises:
        InputError: A place is no number.
    """
    try:
        for item in net.iter():
            for name in SHAPES:
                if shape := item.get(name):
                    item.set(name, " ".join(map(_mirror_point, shape.split())))
            if item.tag == "junction" and "y" in item.attrib:
                item.set("y", _negate(item.attrib["y"]))
    except (ValueError, IndexError):
        raise InputError("has a place that is no number") from None


def _mirror_point(point: str) -> str:
    numbers = point.split(",")
    return ",".join((numbers[0], _negate(numbers[1]), *numbers[2:]))


def _negate(number: str) -> str:
    return repr(-float(number))


def _record_closed_lanes(root: Element, ledger: Ledger) -> None:
    """Record lanes of vehicles that are not simulated, and streets without lanes for cars."""
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
    """List the classes that a lane names as allowed, or cars, people and bicycles by default."""
    if "allow" in lane.attrib:
        named = lane.attrib["allow"].split()
        yield from (("passenger", "pedestrian") if "all" in named else named)
        return
    banned = lane.get("disallow", "").split()
    yield from (
        name for name in ("passenger", "pedestrian", "bicycle") if not {name, "all"} & {*banned}
    )


def _keep_last_programs(net: Element, ledger: Ledger) -> None:
    """Keep the program of each light that SUMO begins with, which is the last one."""
    last = {item.get("id"): item for item in net.iter("tlLogic")}
    for item in list(net.iter("tlLogic")):
        if item is not last[item.get("id")]:
            net.remove(item)
            ledger.leave_out("further program of a light", plural="further programs of lights")
        elif item.get("offset") == "begin":
            item.set("offset", "0")
