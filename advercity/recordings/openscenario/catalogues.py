"""Entries of catalogues: files in a scenario's folders."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

from advercity.errors import InputError, describe_cause
from advercity.recordings.openscenario.document import Findings, Scope, Source, open_source

MAX_CATALOGUE_FILES = 200
"""Files of all catalogues together."""


@dataclass(frozen=True)
class Catalogue:
    """A catalogue: its file, without entries, and its entries by name."""

    source: Source
    entries: Mapping[str, Element]


class Catalogues:
    """The catalogues of a scenario, opened when something is looked up.

    Args:
        scope: The scenario's.
        root: Folder in which all catalogues must be.
    """

    def __init__(self, scope: Scope, root: Path) -> None:
        self._scope = scope
        self._root = root.resolve()
        self._audited: set[Element] = set()
        self._catalogues: dict[str, Catalogue] | None = None

    def find(self, scope: Scope, reference: Element) -> tuple[Scope, Element] | None:
        """Find the entry of a reference, with its assigned parameters.

        Returns:
            The scope in the entry, and the entry; None, and a problem, if there is none.
        """
        if self._catalogues is None:
            self._catalogues = self._open()
        name, entry = scope.get(reference, "catalogName"), scope.get(reference, "entryName")
        found = self._catalogues.get(name)
        if found is None:
            known = ", ".join(self._catalogues) or "none"
            scope.refuse(reference, f"there is no catalogue '{name[:40]}'", f"there are: {known}")
            return None
        element = found.entries.get(entry)
        if element is None:
            message = f"{found.source.path.name} has no entry '{entry[:40]}'"
            scope.refuse(reference, message)
            return None
        inner = Scope(found.source, {}, scope.findings)
        for part in (found.source.root, element):
            if part not in self._audited:
                self._audited.add(part)
                inner.audit(part)
        assigned = {
            item.get("parameterRef", "").removeprefix("$"): scope.get(item, "value", "")
            for item in reference.iterfind("ParameterAssignments/ParameterAssignment")
        }
        nested = inner.nest(element, assigned)
        unknown = [name for name in assigned if name not in nested.parameters]
        if unknown:
            name = f"assignment of a parameter that '{entry[:40]}' has not"
            scope.findings.ledger.leave_out(name, at=reference, count=len(unknown))
        return nested, element

    def _open(self) -> dict[str, Catalogue]:
        found: dict[str, Catalogue] = {}
        files: dict[str, Catalogue] = {}
        for count, path in enumerate(self._list_files()):
            if count >= MAX_CATALOGUE_FILES:
                raise InputError(f"{path}: there are over {MAX_CATALOGUE_FILES} catalogue files")
            source = open_source(path)
            catalogue = source.root.find("Catalog")
            if catalogue is not None:
                entries = {name: item for item in reversed(catalogue) if (name := item.get("name"))}
                catalogue[:] = [item for item in catalogue if not item.get("name")]
                opened = Catalogue(source, entries)
                found.setdefault(catalogue.get("name", ""), opened)
                files.setdefault(path.stem, opened)
        # Some scenarios name the file instead.
        return {**files, **found}

    def _list_files(self) -> Iterator[Path]:
        for directory in self._scope.source.root.iterfind("CatalogLocations/*/Directory"):
            folder = self._scope.source.path.parent / self._scope.get(directory, "path")
            if not folder.resolve().is_relative_to(self._root):
                message = f"{folder} is outside {self._root}"
                hint = "name the folder that has scenario and catalogues with `root`"
                self._scope.refuse(directory, message, hint)
                continue
            try:
                yield from sorted(folder.glob("*.xosc"))
            except OSError as error:
                self._scope.refuse(directory, f"cannot be read: {describe_cause(error)}")


def start_scope(source: Source, findings: Findings, overrides: Mapping[str, str]) -> Scope:
    """Return the scope of a whole file."""
    return Scope(source, {}, findings).nest(source.root, overrides)
