"""XML from outside, read so that it can neither fetch nor blow up anything.

A document type is refused, and with it every entity and every external file; size and depth are
limited. What goes on to other programs is written anew from the tree, so that they read what was
checked and nothing else.
"""

from xml.etree import ElementTree
from xml.etree.ElementTree import Element
from xml.parsers import expat

from advercity.errors import InputError

MAX_BYTES = 64_000_000
MAX_DEPTH = 60


def read_xml(raw: bytes) -> Element:
    """The root of a document; InputError if it is too large, too deep, unsafe or not XML."""
    if len(raw) > MAX_BYTES:
        raise InputError(f"has {len(raw)} bytes; at most {MAX_BYTES} are read")
    try:
        _check(raw)
        return ElementTree.fromstring(raw)  # noqa: S314  checked just now
    except (expat.ExpatError, ElementTree.ParseError, ValueError, LookupError) as error:
        raise InputError(f"is not XML: {error}") from None


def written(root: Element) -> bytes:
    """The tree as UTF-8 text, without comments."""
    return ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)


def _check(raw: bytes) -> None:
    depth = 0

    def refuse(*_: object) -> None:
        raise InputError("has a document type (<!DOCTYPE ...>), which maps do not need; remove it")

    def enter(*_: object) -> None:
        nonlocal depth
        depth += 1
        if depth > MAX_DEPTH:
            raise InputError(f"is nested deeper than {MAX_DEPTH} levels")

    def leave(_: object) -> None:
        nonlocal depth
        depth -= 1

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler = enter
    parser.EndElementHandler = leave
    parser.Parse(raw, True)
