"""XML from unknown authors, with the line and column of every element.

A document type is refused, and with it every entity and every external file. Size and depth are
limited. A default namespace is removed: `<road>` is found with and without one.
"""

from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element
from xml.parsers import expat

from advercity.errors import InputError

MAX_XML_BYTES = 64_000_000
MAX_XML_DEPTH = 60


class LocatedElement(Element):
    """An element with its place in the file; line and column count from 1."""

    line: int = 0
    column: int = 0


def parse_xml(raw: bytes) -> Element:
    """Parse a document.

    Args:
        raw: The bytes of the file.

    Returns:
        The root; it and all elements in it are `LocatedElement`s.

    Raises:
        InputError: The document is too large, too deep, unsafe or not XML.
    """
    if len(raw) > MAX_XML_BYTES:
        raise InputError(f"has {len(raw)} bytes; at most {MAX_XML_BYTES} are read")
    try:
        return _TreeParser().parse(raw)
    except (expat.ExpatError, ValueError, LookupError) as error:
        raise InputError(f"is not XML: {error}") from None


def get_line(element: Element) -> int:
    """Return the line on which an element begins in its file; 0 if it is from no file."""
    return element.line if isinstance(element, LocatedElement) else 0


def to_xml_bytes(root: Element) -> bytes:
    """Encode a tree as UTF-8 text without comments."""
    return ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)


class _TreeParser:
    """Builds a tree from expat's events, with the places dropped by ElementTree."""

    def __init__(self) -> None:
        self._builder = ElementTree.TreeBuilder(element_factory=LocatedElement)
        self._depth = 0
        # Names of a namespace come as `URI}name`.
        parser = expat.ParserCreate(namespace_separator="}")
        parser.buffer_text = True
        parser.StartDoctypeDeclHandler = _refuse_document_type
        parser.StartElementHandler = self._enter
        parser.EndElementHandler = self._leave
        parser.CharacterDataHandler = self._builder.data
        self._parser = parser

    def parse(self, raw: bytes) -> Element:
        self._parser.Parse(raw, True)
        return self._builder.close()

    def _enter(self, name: str, attributes: dict[str, str]) -> None:
        self._depth += 1
        if self._depth > MAX_XML_DEPTH:
            raise InputError(f"is nested deeper than {MAX_XML_DEPTH} levels")
        plain = {_drop_namespace(key): value for key, value in attributes.items()}
        element: Any = self._builder.start(_drop_namespace(name), plain)
        element.line = self._parser.CurrentLineNumber
        element.column = self._parser.CurrentColumnNumber + 1

    def _leave(self, name: str) -> None:
        self._depth -= 1
        self._builder.end(_drop_namespace(name))


def _refuse_document_type(*_: object) -> None:
    raise InputError("has a document type (<!DOCTYPE ...>), which is not needed; remove it")


def _drop_namespace(name: str) -> str:
    return name.rpartition("}")[2]
