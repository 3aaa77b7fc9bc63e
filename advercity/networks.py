"""SUMO networks as text that may come from anywhere: packed into a spec, and safe to simulate.

SUMO reads a network with the parser that also reads detectors and signal programmes that write
files, and a projection may name grids to open. So only the elements and attributes of a plain
network pass.
"""

import base64
import binascii
import zlib
from xml.etree.ElementTree import Element, SubElement

from advercity.errors import InputError
from advercity.xml_input import MAX_BYTES, read_xml, written

_KEPT = {
    "edge": "id from to function priority shape crossingEdges",
    "lane": "id index allow disallow speed length width shape customShape outlineShape type",
    "tlLogic": "id programID offset",
    "phase": "duration state",
    "junction": "id type x y z incLanes intLanes shape customShape",
    "request": "index response foes cont",
    "connection": "from to fromLane toLane via tl linkIndex dir state",
    "roundabout": "nodes edges",
}
_INSIDE = {"edge": ("lane",), "tlLogic": ("phase",), "junction": ("request",)}
_TOP = ("edge", "tlLogic", "junction", "connection", "roundabout")
_LOCATION = {
    "netOffset": "0.00,0.00",
    "convBoundary": "0.00,0.00,0.00,0.00",
    "origBoundary": "0.00,0.00,0.00,0.00",
    "projParameter": "!",
}


def cleaned(root: Element) -> Element:
    """A plain network: streets, junctions, connections and fixed signal programmes."""
    net = Element("net", {"version": root.get("version", "1.20"), "walkingareas": "true"})
    SubElement(net, "location", _LOCATION)
    for item in root:
        if item.tag in _TOP:
            copy = _copied(net, item)
            for child in item:
                if child.tag in _INSIDE.get(item.tag, ()):
                    _copied(copy, child)
    return net


def _copied(parent: Element, item: Element) -> Element:
    kept = {name: value for name in _KEPT[item.tag].split() if (value := item.get(name))}
    if item.tag == "tlLogic":
        kept["type"] = "static"
    return SubElement(parent, item.tag, kept)


def packed(net: Element) -> str:
    """A network as text that fits into a spec: zlib in Base64."""
    return base64.b64encode(zlib.compress(written(net), 9)).decode("ascii")


def unpacked(text: str) -> Element:
    """The plain network in what `packed` made; InputError if it is something else."""
    try:
        inflate = zlib.decompressobj()
        raw = inflate.decompress(base64.b64decode(text, validate=True), MAX_BYTES)
        if inflate.unconsumed_tail:
            raise InputError(f"inflates to more than {MAX_BYTES} bytes")
        return cleaned(read_xml(raw))
    except (InputError, binascii.Error, zlib.error) as error:
        raise InputError(f"imported.network: not a packed network: {error}") from None
