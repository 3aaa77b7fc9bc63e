"""An OpenSCENARIO document as XML; what is wrong in it is collected by line and column."""

import math
from collections.abc import Iterator
from pathlib import Path
from xml.etree.ElementTree import Element
from xml.parsers import expat

from advercity.diagnostics import Diagnostic, DiagnosticsError
from advercity.documents import read_bytes
from advercity.errors import InputError, describe_cause
from advercity.foreign.xml_documents import MAX_XML_BYTES, parse_xml


class ScenarioDocument:
    """An OpenSCENARIO document, the values of its parameters, and what its reader finds in it.

    Args:
        path: The file; InputError if it cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            raw = read_bytes(path, max_bytes=MAX_XML_BYTES)
        except OSError as error:
            raise InputError(f"{path}: cannot be read: {describe_cause(error)}") from None
        try:
            self.root = parse_xml(raw)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
        self._places = dict(zip(self.root.iter(), _list_places(raw), strict=True))
        self._lines = raw.decode("utf-8", errors="replace").splitlines()
        self._parameters = {
            item.get("name", ""): item.get("value", "")
            for item in self.root.iterfind("ParameterDeclarations/ParameterDeclaration")
        }
        self._problems: list[Diagnostic] = []
        self._left_out: dict[str, list[int]] = {}

    def refuse(self, element: Element, message: str, hint: str) -> None:
        """Keep a problem of an element, to be raised with all others."""
        line, column = self._places[element]
        text = self._lines[line - 1] if line <= len(self._lines) else ""
        width = len(element.tag) + 1
        self._problems.append(
            Diagnostic(self.path, line, column, f"<{element.tag}>", message, hint, text, width)
        )

    def raise_problems(self) -> None:
        """Raise DiagnosticsError if there are problems."""
        if self._problems:
            raise DiagnosticsError(*self._problems)

    def get(self, element: Element, name: str, default: str | None = None) -> str:
        """Return an attribute, with a parameter replaced by its value."""
        value = element.get(name, default)
        if value is None:
            self.refuse(element, f"has no attribute '{name}'", "")
            return ""
        if value.startswith("$"):
            known = self._parameters.get(value[1:])
            if known is None:
                hint = "only `$name` of a <ParameterDeclaration> is replaced"
                self.refuse(element, f"'{value[:40]}' has no value", hint)
            return known or ""
        return value

    def get_number(self, element: Element, name: str, default: str | None = None) -> float:
        """Return an attribute as a number; NaN, and a problem, if it is none."""
        text = self.get(element, name, default)
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if text and not math.isfinite(number):
            self.refuse(element, f'{name}="{text[:40]}" is not a number', "")
        return number

    def remark(self, element: Element, what: str) -> None:
        """Keep that an element is left out."""
        line, _ = self._places[element]
        inner = next((item for item in element if item.tag.endswith("Action")), element)
        text = f"<{inner.tag}> is left out{f': {what}' if what else ''}"
        self._left_out.setdefault(text, []).append(line)

    def list_left_out(self) -> Iterator[str]:
        """List what is left out; one of a kind stands for all of it."""
        for text, lines in self._left_out.items():
            count = f" (and {len(lines) - 1} more of them)" if len(lines) > 1 else ""
            yield f"{self.path}:{lines[0]}: {text}{count}"


def _list_places(raw: bytes) -> list[tuple[int, int]]:
    """List line and column of every element, in the order of the document."""
    places: list[tuple[int, int]] = []
    parser = expat.ParserCreate()

    def enter(*_: object) -> None:
        places.append((parser.CurrentLineNumber, parser.CurrentColumnNumber + 1))

    parser.StartElementHandler = enter
    parser.Parse(raw, True)
    return places
