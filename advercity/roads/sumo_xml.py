"""Untrusted XML and SUMO networks, checked so that other programs can read them safely.

A document type is refused, and with it every entity and every external file; size and depth are
limited. What is passed on is written anew from the checked tree.

SUMO reads networks with the parser that also reads detectors and signal programs that write files,
and a projection may name grid files to open. So only elements and attributes of a plain network
pass, both into a spec and out of it.
"""

import base64
import binascii
import zlib
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement
from xml.parsers import expat

from advercity.errors import InputError

MAX_XML_BYTES = 64_000_000
MAX_XML_DEPTH = 60


def parse_xml(raw: bytes) -> Element:
    """Parse a document; InputError if it is too large, too deep, unsafe or not XML."""
    if len(raw) > MAX_XML_BYTES:
        raise InputError(f"has {len(raw)} bytes; at most {MAX_XML_BYTES} are read")
    try:
        _check_limits(raw)
        return ElementTree.fromstring(raw)  # noqa: S314  checked just now
    except (expat.ExpatError, ElementTree.ParseError, ValueError, LookupError) as error:
        raise InputError(f"is not XML: {error}") from None


def to_xml_bytes(root: Element) -> bytes:
    """Encode a tree as UTF-8 text without comments."""
    return ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)


def _check_limits(raw: bytes) -> None:
    # expat reports what ElementTree hides, before a tree is built.
    depth = 0

    def refuse(*_: object) -> None:
        raise InputError("has a document type (<!DOCTYPE ...>), which is not needed; remove it")

    def enter(*_: object) -> None:
        nonlocal depth
        depth += 1
        if depth > MAX_XML_DEPTH:
            raise InputError(f"is nested deeper than {MAX_XML_DEPTH} levels")

    def leave(_: object) -> None:
        nonlocal depth
        depth -= 1

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler = enter
    parser.EndElementHandler = leave
    parser.Parse(raw, True)


_KEPT_ATTRIBUTES = {
    "edge": "id from to function priority shape crossingEdges",
    "lane": "id index allow disallow speed length width shape customShape outlineShape type",
    "tlLogic": "id programID offset",
    "phase": "duration state",
    "junction": "id type x y z incLanes intLanes shape customShape",
    "request": "index response foes cont",
    "connection": "from to fromLane toLane via tl linkIndex dir state",
    "roundabout": "nodes edges",
    "poly": "id type shape",
}
_KEPT_CHILDREN = {"edge": ("lane",), "tlLogic": ("phase",), "junction": ("request",)}
_KEPT_ELEMENTS = ("edge", "tlLogic", "junction", "connection", "roundabout", "poly")
_LOCATION = {
    "netOffset": "0.00,0.00",
    "convBoundary": "0.00,0.00,0.00,0.00",
    "origBoundary": "0.00,0.00,0.00,0.00",
    "projParameter": "!",
}


def sanitize_network(root: Element) -> Element:
    """Copy edges, junctions, connections, fixed signal programs and outlines of a network."""
    net = Element("net", {"version": root.get("version", "1.20"), "walkingareas": "true"})
    SubElement(net, "location", _LOCATION)
    for item in root:
        if item.tag in _KEPT_ELEMENTS:
            copy = _copy_element(net, item)
            for child in item:
                if child.tag in _KEPT_CHILDREN.get(item.tag, ()):
                    _copy_element(copy, child)
    return net


def _copy_element(parent: Element, item: Element) -> Element:
    kept = {name: value for name in _KEPT_ATTRIBUTES[item.tag].split() if (value := item.get(name))}
    # Actuated programs read detectors and parameters that name files; a fixed one is harmless.
    if item.tag == "tlLogic":
        kept["type"] = "static"
    return SubElement(parent, item.tag, kept)


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
