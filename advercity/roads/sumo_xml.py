"""SUMO networks from unknown authors, checked so that SUMO can read them safely.

SUMO's parser of networks also reads detectors and signal programs, which write files, and a
projection may name grid files to open. So only elements and attributes of a plain network pass,
both into a spec and out of it.
"""

import base64
import binascii
import zlib
from xml.etree.ElementTree import Element, SubElement

from advercity.errors import InputError
from advercity.foreign.xml_documents import MAX_XML_BYTES, parse_xml, to_xml_bytes
from advercity.geometry.polyline import Points

BORDER_ATTRIBUTES = ("leftBorder", "rightBorder")
"""Borders of a lane of varying width; SUMO does not read them."""
_KEPT_ATTRIBUTES = {
    "edge": "id from to function priority shape crossingEdges",
    "lane": "id index allow disallow speed length width shape customShape outlineShape type"
    f" {' '.join(BORDER_ATTRIBUTES)}",
    "tlLogic": "id programID offset",
    "phase": "duration state",
    "junction": "id type x y z incLanes intLanes shape customShape",
    "request": "index response foes cont",
    "connection": "from to fromLane toLane via tl linkIndex dir state",
    "roundabout": "nodes edges",
    "poly": "id type shape",
}
_READ_BY_NETCONVERT = {
    "edge": "spreadType",
    "junction": "radius rightOfWay",
    "connection": "pass contPos allow disallow speed length shape uncontrolled",
    "prohibition": "prohibitor prohibited",
}
"""Sources of netconvert's shapes, limits and rights of way; SUMO itself does not need them."""
_KEPT_CHILDREN = {"edge": ("lane",), "tlLogic": ("phase",), "junction": ("request",)}
_KEPT_ELEMENTS = ("edge", "tlLogic", "junction", "connection", "roundabout", "poly")
_LOCATION = {
    "netOffset": "0.00,0.00",
    "convBoundary": "0.00,0.00,0.00,0.00",
    "origBoundary": "0.00,0.00,0.00,0.00",
    "projParameter": "!",
}


def sanitize_network(root: Element, *, for_netconvert: bool = False) -> Element:
    """Copy edges, junctions, connections, fixed signal programs and outlines of a network.

    Args:
        root: The network.
        for_netconvert: Whether to copy parts read only by netconvert, too.
    """
    more = _READ_BY_NETCONVERT if for_netconvert else {}
    attributes = {
        tag: f"{_KEPT_ATTRIBUTES.get(tag, '')} {more.get(tag, '')}".split()
        for tag in (*_KEPT_ATTRIBUTES, *more)
    }
    net = Element("net", {"version": root.get("version", "1.20"), "walkingareas": "true"})
    SubElement(net, "location", _LOCATION)
    for item in root:
        if item.tag in _KEPT_ELEMENTS or item.tag in more:
            copy = _copy_element(net, item, attributes[item.tag])
            if for_netconvert and item.tag == "edge" and "spreadType" in root.attrib:
                copy.attrib.setdefault("spreadType", root.attrib["spreadType"])
            for child in item:
                if child.tag in _KEPT_CHILDREN.get(item.tag, ()):
                    _copy_element(copy, child, attributes[child.tag])
    return net


def _copy_element(parent: Element, item: Element, attributes: list[str]) -> Element:
    kept = {name: value for name in attributes if (value := item.get(name))}
    # Actuated programs read detectors and parameters with file names; a fixed one is harmless.
    if item.tag == "tlLogic":
        kept["type"] = "static"
    return SubElement(parent, item.tag, kept)


def format_metres(value: float) -> str:
    """Format a length to the millimetre; never as `-0.000`."""
    return f"{round(float(value), 3) + 0.0:.3f}"


def format_shape(points: Points) -> str:
    """Format points (n, d), metres, as a SUMO shape."""
    return " ".join(",".join(format_metres(value) for value in point) for point in points)


def pack_network(net: Element) -> str:
    """Pack a network into text for a spec: zlib in Base64."""
    return base64.b64encode(zlib.compress(to_xml_bytes(net), 9)).decode("ascii")


def unpack_network(text: str) -> Element:
    """Unpack and sanitise a network from `pack_network`; InputError if it is something else."""
    try:
        # The size is bounded while inflating: a small text can hold gigabytes of zeros.
        inflate = zlib.decompressobj()
        raw = inflate.decompress(base64.b64decode(text, validate=True), MAX_XML_BYTES)
        if inflate.unconsumed_tail:
            raise InputError(f"inflates to more than {MAX_XML_BYTES} bytes")
        return sanitize_network(parse_xml(raw))
    except (InputError, binascii.Error, zlib.error) as error:
        raise InputError(f"imported.network: not a packed network: {error}") from None
