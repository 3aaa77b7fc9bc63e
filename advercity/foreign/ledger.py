"""The record of the parts of a foreign file that the data lack.

Every element and attribute of a format is read, has no effect, is refused, or is left out.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from xml.etree.ElementTree import Element

from advercity_dsl.road import LeftOut

from advercity.foreign.xml_documents import get_line


@dataclass
class _Entry:
    plural: str
    line: int
    count: int = 0


class Ledger:
    """Counts the omitted parts of a file, by name."""

    def __init__(self) -> None:
        self._entries: dict[str, _Entry] = {}

    def leave_out(
        self, name: str, *, plural: str = "", at: Element | int = 0, count: int = 1
    ) -> None:
        """Record omitted parts of the file.

        Args:
            name: Their name in the singular, `bus lane`.
            plural: Their name in the plural, if it is not the singular with an `s`.
            at: The first of them, or its line; 0 if the format has no lines.
            count: Their number.
        """
        line = at if isinstance(at, int) else get_line(at)
        entry = self._entries.setdefault(name, _Entry(plural or f"{name}s", line))
        entry.count += count

    @property
    def left_out(self) -> tuple[LeftOut, ...]:
        """Omitted parts, in the order of their first places."""
        return tuple(
            LeftOut(name=name if item.count == 1 else item.plural, count=item.count, line=item.line)
            for name, item in self._entries.items()
        )


def describe_left_out(parts: Iterable[LeftOut]) -> str:
    """Describe omissions in one line: `12 superelevations (line 40), 3 bus lanes`."""
    return ", ".join(
        f"{part.count} {part.name}{f' (line {part.line})' if part.line else ''}" for part in parts
    )


def merge_left_out(*parts: Iterable[LeftOut]) -> tuple[LeftOut, ...]:
    """Join records of several files or readers; equal names are counted together."""
    found: dict[str, LeftOut] = {}
    for part in (item for group in parts for item in group):
        known = found.get(part.name)
        total = part.count + (known.count if known else 0)
        found[part.name] = (known or part).model_copy(update={"count": total})
    return tuple(found.values())
