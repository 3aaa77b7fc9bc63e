r"""Tables of the parts of foreign formats, and their treatment by advercity.

`tables/<format>.yaml` names every element of a standard once, by its own name, or by `parent/name`
where elements of one name differ. Under it, `.` is the element itself, the other keys are its
attributes:

    road/type/speed: {.: read, max: read, unit: read}
    lane/height: {.: "left out unless 0: lane height", ...}

| disposition | meaning |
|---|---|
| `read` | has an effect on the result |
| `none` | has no visible effect: names, ids, dates |
| `left out: NAME` | is omitted and listed; NAME may be `singular \| plural` |
| `left out unless VALUE: NAME` | likewise, but for this value, the usual one; `0\|no`: either |
| `refuse: REASON` | the file cannot be used |

Parts below an omitted element are omitted with it.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

from advercity.documents import parse_yaml
from advercity.errors import InputError
from advercity.foreign.ledger import Ledger
from advercity.foreign.xml_documents import get_line

TABLES = Path(__file__).parent / "tables"
ELEMENT = "."
"""Key of the element itself among its attributes."""
LEFT_OUT = re.compile(r"left out(?: unless (?P<usual>[^:]*))?: (?P<name>.+)")
REFUSED = re.compile(r"refuse: (?P<reason>.+)")
Refuse = Callable[[Element, str], None]
"""Takes a refused element, and the reason."""


def raise_refusal(element: Element, reason: str) -> None:
    """Raise an InputError with the line of a refused element."""
    raise InputError(f"line {get_line(element)}: <{element.tag}>: {reason}")


@dataclass(frozen=True)
class Standard:
    """Treatment of every part of a format.

    Attributes:
        name: Name and version of the standard.
        elements: Dispositions by attribute, by `name` or `parent/name` of the element.
    """

    name: str
    elements: Mapping[str, Mapping[str, str]]

    def audit(self, root: Element, ledger: Ledger, refuse: Refuse = raise_refusal) -> None:
        """Record every omitted part of a document, and refuse those with `refuse`."""
        self._audit_element(root, (root.tag,), ledger, refuse)

    def audit_columns(
        self,
        layout: str,
        columns: Iterable[str],
        ledger: Ledger,
        *,
        kind: str = "column",
        line: int = 1,
    ) -> None:
        """Record the omitted columns of a table, or other omitted names.

        Args:
            layout: The row of this standard for them.
            columns: Their names.
            ledger: Record of omissions.
            kind: Noun for names unknown to the standard.
            line: Their line; 0 if the format has no lines.
        """
        row = self.elements[layout]
        for column in columns:
            if column in row:
                apply_disposition(row[column], "", line, ledger)
            else:
                name = _shorten(column)
                ledger.leave_out(f"{kind} {name}", plural=f"{kind}s {name}", at=line)

    def audit_tags(self, element: Element, kind: str, ledger: Ledger) -> None:
        """Record the omitted tags, keys with values, of an element.

        Args:
            element: A node, way or relation with `<tag k= v=>`.
            kind: The row of this standard for it.
            ledger: Record of omissions.
        """
        for tag in element.iter("tag"):
            key, value = tag.get("k", ""), tag.get("v", "")
            known = _find_tag(self.elements[kind], key, value)
            if known is None:
                _leave_out_unknown("tag", _shorten(key), tag, ledger)
            else:
                apply_disposition(known, value, tag, ledger)

    def find_row(self, tags: tuple[str, ...]) -> Mapping[str, str] | None:
        """Find the row of an element by its tag and those around it, the outermost first."""
        names = ("/".join(tags[start:]) for start in range(len(tags)))
        return next((self.elements[name] for name in names if name in self.elements), None)

    def _audit_element(
        self, element: Element, tags: tuple[str, ...], ledger: Ledger, refuse: Refuse
    ) -> None:
        row = self.find_row(tags)
        if row is None:
            _leave_out_unknown("element", f"<{_shorten(element.tag)}>", element, ledger)
            return
        known = row.get(ELEMENT, "read")
        if apply_disposition(known, element.text or "", element, ledger, refuse):
            return
        for attribute, value in element.attrib.items():
            known = row.get(attribute)
            if known is None:
                name = f"{_shorten(element.tag)}@{_shorten(attribute)}"
                _leave_out_unknown("attribute", name, element, ledger)
            else:
                apply_disposition(known, value, element, ledger, refuse)
        for child in element:
            self._audit_element(child, (*tags, child.tag), ledger, refuse)


@cache
def load_standard(name: str) -> Standard:
    """Load the table of a format: `opendrive`, `osm`, `sumo_network`, `openscenario`."""
    path = TABLES / f"{name}.yaml"
    data: Any = parse_yaml(path.read_bytes(), path)
    return Standard(data["standard"], data["elements"])


def list_dispositions(standard: Standard) -> Iterator[tuple[str, str, str]]:
    """List element, attribute and disposition of every part."""
    for element, row in standard.elements.items():
        for attribute, disposition in row.items():
            yield element, attribute, disposition


def is_disposition(text: str) -> bool:
    """Return whether a text is one of the dispositions above."""
    return text in ("read", "none") or bool(LEFT_OUT.fullmatch(text) or REFUSED.fullmatch(text))


def _find_tag(row: Mapping[str, str], key: str, value: str) -> str | None:
    """Find the disposition of a tag: of key and value, of the key, or of its longest pattern."""
    known = row.get(f"{key}={value}") or row.get(key)
    if known is not None:
        return known
    patterns = [name for name in row if "*" in name and fnmatchcase(key, name)]
    return row[max(patterns, key=len)] if patterns else None


def apply_disposition(
    disposition: str,
    value: str,
    at: Element | int,
    ledger: Ledger,
    refuse: Refuse = raise_refusal,
) -> bool:
    """Record a part of a file if it is left out; return whether it is left out or refused."""
    refused = REFUSED.fullmatch(disposition)
    if refused and not isinstance(at, int):
        refuse(at, refused["reason"])
        return True
    left_out = LEFT_OUT.fullmatch(disposition)
    if left_out is None or _is_usual(value.strip(), left_out["usual"]):
        return False
    singular, _, plural = (part.strip() for part in left_out["name"].partition("|"))
    ledger.leave_out(singular, plural=plural, at=at)
    return True


def _leave_out_unknown(kind: str, name: str, at: Element, ledger: Ledger) -> None:
    ledger.leave_out(f"unknown {kind} {name}", plural=f"unknown {kind}s {name}", at=at)


def _is_usual(value: str, usual: str | None) -> bool:
    return usual is not None and any(_is_equal(value, item.strip()) for item in usual.split("|"))


def _is_equal(value: str, usual: str) -> bool:
    try:
        return float(value) == float(usual)
    except ValueError:
        return value == usual


def _shorten(name: str) -> str:
    return name[:40]
