"""`extends`: merging a declaration with its parents.

Mappings merge key by key; numbers, text and lists replace; `null` instead of a mapping removes the
inherited one. Identity and provenance (`id`, `title`, `source`, `assumption`) are never inherited.
If two parents disagree, the declaration must give the value itself.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, cast

from advercity_dsl.base import ValuePath

from advercity.compiler.shipped_library import suggest_declaration
from advercity.compiler.source import (
    SourceDocument,
    SourcePosition,
    format_value_path,
    iterate_values,
    replace_values,
)
from advercity.diagnostics import Diagnostic, DiagnosticsError

DOCUMENT_KEYS = ("extends", "version")
"""Keys of a document other than the declaration's fields."""
NEVER_INHERITED = ("id", "title", "source", "assumption")
DeclarationKey = tuple[str, str]
"""Kind and id."""
Documents = Mapping[DeclarationKey, SourceDocument]


@dataclass(frozen=True)
class ResolvedDeclaration:
    """Data of a declaration, merged with its parents' data.

    Attributes:
        data: Plain values.
        document: The declaration's own file.
        origins: Document of each inherited value, by path.
    """

    data: dict[str, Any]
    document: SourceDocument
    origins: Mapping[ValuePath, SourceDocument]

    def has_value(self, value_path: ValuePath) -> bool:
        """Return whether a value at a path is given or inherited."""
        return value_path in self.origins or self.document.has_value(value_path)

    def replace_value(self, value_path: ValuePath, value: Any) -> "ResolvedDeclaration":
        """Return a copy with another value at a path.

        Raises:
            DiagnosticsError: The path leads to a missing item of a list.
        """
        try:
            return replace(self, data=replace_values(self.data, {value_path: value}))
        except IndexError:
            message, hint = "the list has no such item", "items count from 0"
            raise DiagnosticsError(self.build_diagnostic(value_path, message, hint=hint)) from None

    def find_document(self, value_path: ValuePath) -> SourceDocument:
        """Return the document with the value at a path, or with its nearest enclosing value."""
        for length in range(len(value_path), 0, -1):
            if self.document.has_value(value_path[:length]):
                return self.document
            if value_path[:length] in self.origins:
                return self.origins[value_path[:length]]
        return self.document

    def find_position(self, value_path: ValuePath) -> SourcePosition:
        """Return the position of a value in its document."""
        return self.find_document(value_path).find_position(value_path)

    def build_diagnostic(
        self, value_path: ValuePath, message: str, *, hint: str = "", key: bool = False
    ) -> Diagnostic:
        """Build a diagnostic at a value (or key), at `extends` if the value is inherited."""
        giver = self.find_document(value_path)
        found = giver.build_diagnostic(value_path, message, hint=hint, key=key)
        if giver is self.document:
            return found
        own = self.document.build_diagnostic(("extends",), message, hint=hint)
        return replace(own, value_path=found.value_path, origin=found)


def resolve_extends(name: DeclarationKey, documents: Documents) -> ResolvedDeclaration:
    """Merge a declaration with all its parents.

    Raises:
        DiagnosticsError: A parent is unknown, extends form a cycle, or parents disagree.
    """
    return _resolve_chain(name, documents, ())


def _resolve_chain(
    name: DeclarationKey, documents: Documents, descendants: tuple[str, ...]
) -> ResolvedDeclaration:
    document = documents[name]
    own = {key: value for key, value in document.data.items() if key not in DOCUMENT_KEYS}
    if "extends" not in document.data:
        return ResolvedDeclaration(own, document, {})
    chain = (*descendants, name[1])
    parents = [
        _resolve_chain((name[0], parent), documents, chain)
        for parent in _find_parents(document, name, documents, chain)
    ]
    merged: dict[str, Any] = {}
    origins: dict[ValuePath, SourceDocument] = {}
    for parent in parents:
        inherited = {key: value for key, value in parent.data.items() if key not in NEVER_INHERITED}
        # Before merging, since the last parent would win silently.
        _check_agreement(document, merged, inherited, own)
        merged = merge_mappings(merged, inherited)
        origins |= {path: parent.find_document(path) for path, _ in iterate_values(inherited)}
    return ResolvedDeclaration(merge_mappings(merged, own), document, origins)


def list_parents(document: SourceDocument) -> list[Any]:
    """List the names that a document extends, as written."""
    written = document.data.get("extends", [])
    return cast(list[Any], written) if isinstance(written, list) else [written]


def _find_parents(
    document: SourceDocument, name: DeclarationKey, documents: Documents, chain: tuple[str, ...]
) -> list[str]:
    is_list = isinstance(document.data["extends"], list)
    parents = list_parents(document)
    for index, parent in enumerate(parents):
        value_path = ("extends", index) if is_list else ("extends",)
        if not isinstance(parent, str):
            message, hint = f"must name a {name[0]}", "write an id, or a list of ids"
            raise DiagnosticsError(document.build_diagnostic(value_path, message, hint=hint))
        if parent in chain:
            cycle = chain[chain.index(parent) :]
            raise DiagnosticsError(_build_cycle_diagnostic(cycle, name[0], documents))
        if (name[0], parent) not in documents:
            others = [other for kind, other in documents if kind == name[0] and other != name[1]]
            message = f"unknown {name[0]} '{parent}'"
            hint = suggest_declaration(name[0], parent, others)
            raise DiagnosticsError(document.build_diagnostic(value_path, message, hint=hint))
    return parents


def _build_cycle_diagnostic(cycle: tuple[str, ...], kind: str, documents: Documents) -> Diagnostic:
    """Build the diagnostic of a cycle, the same wherever resolving entered it."""
    # Begins at the smallest name: every member of the cycle reports the same error once.
    first = cycle.index(min(cycle))
    names = (*cycle[first:], *cycle[:first], cycle[first])
    hint = "remove one of these `extends`" if len(cycle) > 1 else "remove it"
    message = f"circular extends: {' > '.join(names)}"
    return documents[kind, names[0]].build_diagnostic(("extends",), message, hint=hint)


def _check_agreement(
    document: SourceDocument, first: Mapping[str, Any], second: Mapping[str, Any], own: Any
) -> None:
    disagreement = _find_disagreement(first, second, own, ())
    if disagreement is None:
        return
    value_path, one, other = disagreement
    field = format_value_path(value_path)
    message = f"parents disagree on {field}: {one} and {other}"
    raise DiagnosticsError(
        document.build_diagnostic(("extends",), message, hint=f"give {field} here")
    )


def _find_disagreement(
    first: Mapping[str, Any], second: Mapping[str, Any], own: Any, value_path: ValuePath
) -> tuple[ValuePath, Any, Any] | None:
    """Return path and values where two parents differ and the declaration gives no value."""
    given: dict[str, Any] = own if isinstance(own, dict) else {}
    for key in (key for key in first if key in second and key != "kind"):
        one, other, inner_path = first[key], second[key], (*value_path, key)
        if isinstance(one, dict) and isinstance(other, dict):
            if key in given and not isinstance(given[key], dict):
                continue
            mappings = cast(dict[str, Any], one), cast(dict[str, Any], other)
            found = _find_disagreement(*mappings, given.get(key), inner_path)
            if found:
                return found
        elif key not in given and one != other:
            return inner_path, one, other
    return None


def merge_mappings(base: Mapping[str, Any], override: Mapping[str, Any]) -> dict[str, Any]:
    """Merge a mapping into another one, as `extends` does."""
    result = dict(base)
    for key, value in override.items():
        old = result.get(key)
        if isinstance(old, dict) and isinstance(value, dict):
            result[key] = merge_mappings(cast(dict[str, Any], old), cast(dict[str, Any], value))
        elif isinstance(old, dict) and value is None:
            # Only components are removed: for a scalar, null is a value of its own.
            del result[key]
        else:
            result[key] = value
    return result
