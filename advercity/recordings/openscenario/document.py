"""Files of a scenario as XML, with the parameters of each part, and the problems found."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree.ElementTree import Element

from advercity.diagnostics import Diagnostic, DiagnosticsError
from advercity.documents import read_bytes
from advercity.errors import InputError, describe_cause
from advercity.foreign.ledger import Ledger
from advercity.foreign.standards import load_standard
from advercity.foreign.xml_documents import MAX_XML_BYTES, LocatedElement, parse_xml
from advercity.recordings.openscenario.expressions import substitute


@dataclass
class Findings:
    """Facts about all files of a scenario.

    Attributes:
        problems: The first problem of each element, by file, line and column.
        ledger: Omitted parts.
        entities: Names of the entities, moved or not.
        find_entry: Finds the catalogue's entry for an element.
    """

    problems: dict[tuple[Path, int, int], Diagnostic] = field(
        default_factory=dict[tuple[Path, int, int], Diagnostic]
    )
    ledger: Ledger = field(default_factory=Ledger)
    entities: set[str] = field(default_factory=set[str])
    find_entry: "Callable[[Scope, Element], tuple[Scope, Element] | None] | None" = None

    def raise_problems(self) -> None:
        """Raise DiagnosticsError if there are problems."""
        if self.problems:
            raise DiagnosticsError(*self.problems.values())


@dataclass(frozen=True)
class Source:
    """A file, its lines and its root."""

    path: Path
    lines: tuple[str, ...]
    root: Element


@dataclass(frozen=True)
class Scope:
    """A part of a file, and its parameters.

    Attributes:
        source: The file.
        parameters: Their values by name.
        findings: Takes problems and omissions.
    """

    source: Source
    parameters: Mapping[str, str]
    findings: Findings

    def nest(self, element: Element, assigned: Mapping[str, str] | None = None) -> "Scope":
        """Return the scope in an element with declared parameters; assigned values hold."""
        known = dict(self.parameters)
        for item in element.iterfind("ParameterDeclarations/ParameterDeclaration"):
            name = item.get("name", "")
            inner = Scope(self.source, {**known}, self.findings)
            known[name] = (assigned or {}).get(name) or inner.get(item, "value", "")
        return Scope(self.source, known, self.findings)

    def resolve(self, parent: Element, *tags: str) -> "tuple[Scope, Element] | None":
        """Find an element in its parent, or in the parent's catalogue.

        Returns:
            The scope in the element, and the element; None, and a problem, if there is none.
        """
        inline = next((item for item in parent if item.tag in tags), None)
        if inline is not None:
            return self.nest(inline), inline
        reference = parent.find("CatalogReference")
        if reference is None or self.findings.find_entry is None:
            self.refuse(parent, f"has no <{'> or <'.join(tags)}>")
            return None
        return self.findings.find_entry(self, reference)

    def refuse(self, element: Element, message: str, hint: str = "") -> None:
        """Keep the first problem of an element, to be raised with all others."""
        line, column = 0, 0
        if isinstance(element, LocatedElement):
            line, column = element.line, element.column
        text = self.source.lines[line - 1] if 0 < line <= len(self.source.lines) else ""
        width = len(element.tag) + 1
        path, name = self.source.path, f"<{element.tag}>"
        self.findings.problems.setdefault(
            (path, line, column),
            Diagnostic(path, line, column, name, message, hint, text, width),
        )

    def audit(self, element: Element) -> None:
        """Refuse or list all unsupported parts of an element."""
        load_standard("openscenario").audit(element, self.findings.ledger, self.refuse)

    def get(self, element: Element, name: str, default: str | None = None) -> str:
        """Return an attribute, with parameters replaced by their values."""
        value = element.get(name, default)
        if value is None:
            self.refuse(element, f"has no attribute '{name}'")
            return ""
        try:
            return substitute(value, self.parameters)
        except ValueError as error:
            self.refuse(element, str(error), "give it in <ParameterDeclarations>")
            return ""

    def get_number(self, element: Element, name: str, default: float | None = None) -> float:
        """Return an attribute as a number; NaN, and a problem, if it is none."""
        if default is not None and element.get(name) is None:
            return default
        text = self.get(element, name)
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if text and not math.isfinite(number):
            self.refuse(element, f'{name}="{text[:40]}" is not a number')
        return number

    def get_flag(self, element: Element, name: str, *, default: bool = False) -> bool:
        """Return a boolean attribute."""
        return self.get(element, name, "true" if default else "false") in ("true", "1")


def open_source(path: Path) -> Source:
    """Open a file; InputError if it cannot be read or is not XML."""
    try:
        raw = read_bytes(path, max_bytes=MAX_XML_BYTES)
        root = parse_xml(raw)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {describe_cause(error)}") from None
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return Source(path, tuple(raw.decode("utf-8", errors="replace").splitlines()), root)
