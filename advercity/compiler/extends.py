"""`extends`: a declaration over those that it builds on.

Mappings merge key by key; numbers, text and lists replace; `null` in place of a mapping takes the
inherited one away. Name and provenance (`id`, `title`, `source`, `assumption`) are never
inherited. Where two parents disagree, the declaration has to say which value it means.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, cast

from advercity_dsl.base import suggest_name

from advercity.compiler.diagnostics import Diagnostic, DiagnosticsError
from advercity.compiler.source import SourceDocument, SourcePosition, ValuePath, format_value_path

DOCUMENT_KEYS = ("extends", "version")
"""Keys of a document that are no fields of what it declares."""
NEVER_INHERITED = ("id", "title", "source", "assumption")
DeclarationKey = tuple[str, str]
"""Kind and id."""


@dataclass(frozen=True)
class ResolvedDeclaration:
    """A declaration's data with all that it extends merged in.

    Attributes:
        data: Plain values.
        document: Where it is written.
        origins: The document that each inherited value stands in, by path.
    """

    data: dict[str, Any]
    document: SourceDocument
    origins: Mapping[ValuePath, SourceDocument]

    def has_value(self, where: ValuePath) -> bool:
        """Whether there is a value at `where`, its own or inherited."""
        return where in self.origins or self.document.has_value(where)

    def replace_value(self, where: ValuePath, value: Any) -> "ResolvedDeclaration":
        """The same with another value at a path; ProblemsError if it leads out of a list."""
        try:
            return replace(self, data=replace_values(self.data, {where: value}))
        except IndexError:
            message, hint = "the list has no such item", "items count from 0"
            raise DiagnosticsError.from_diagnostic(
                self.build_diagnostic(where, message, hint=hint)
            ) from None

    def find_document(self, where: ValuePath) -> SourceDocument:
        """The file in which the value at `where`, or the nearest around it, stands."""
        for length in range(len(where), 0, -1):
            if self.document.has_value(where[:length]):
                return self.document
            if where[:length] in self.origins:
                return self.origins[where[:length]]
        return self.document

    def find_position(self, where: ValuePath) -> SourcePosition:
        """Of the value at `where` in its document."""
        return self.find_document(where).find_position(where)

    def build_diagnostic(
        self, where: ValuePath, message: str, *, hint: str = "", key: bool = False
    ) -> Diagnostic:
        """A problem with the value (or key) at `where`, in the file that says it."""
        return self.find_document(where).build_diagnostic(where, message, hint=hint, key=key)


def resolve_extends(
    name: DeclarationKey, heads: Mapping[DeclarationKey, SourceDocument]
) -> ResolvedDeclaration:
    """The declaration `name` with what it extends.

    Raises:
        ProblemsError: It extends what is not there, itself, or parents that disagree.
    """
    return _resolve_chain(name, heads, ())


def _resolve_chain(
    name: DeclarationKey, heads: Mapping[DeclarationKey, SourceDocument], below: tuple[str, ...]
) -> ResolvedDeclaration:
    document = heads[name]
    own = {key: value for key, value in document.data.items() if key not in DOCUMENT_KEYS}
    if "extends" not in document.data:
        return ResolvedDeclaration(own, document, {})
    chain = (*below, name[1])
    parents = [
        _resolve_chain((name[0], parent), heads, chain)
        for parent in _find_parents(document, name, heads, chain)
    ]
    merged: dict[str, Any] = {}
    origins: dict[ValuePath, SourceDocument] = {}
    for parent in parents:
        inherited = {key: value for key, value in parent.data.items() if key not in NEVER_INHERITED}
        clash = _find_disagreement(merged, inherited, own, ())
        if clash:
            raise DiagnosticsError.from_diagnostic(
                _build_disagreement_diagnostic(document, clash, merged, inherited)
            )
        merged = _merge_mappings(merged, inherited)
        origins |= {
            where: parent.find_document(where) for where in _list_value_paths(inherited, ())
        }
    return ResolvedDeclaration(_merge_mappings(merged, own), document, origins)


def _find_parents(
    document: SourceDocument,
    name: DeclarationKey,
    heads: Mapping[DeclarationKey, SourceDocument],
    chain: tuple[str, ...],
) -> list[str]:
    written = document.data["extends"]
    parents = cast(list[Any], written) if isinstance(written, list) else [written]
    known = [other for kind, other in heads if kind == name[0]]
    for index, parent in enumerate(parents):
        where = ("extends", index) if isinstance(written, list) else ("extends",)
        if not isinstance(parent, str):
            problem = document.build_diagnostic(
                where, f"must name a {name[0]}", hint="write an id, or a list of ids"
            )
            raise DiagnosticsError.from_diagnostic(problem)
        if parent in chain:
            raise DiagnosticsError.from_diagnostic(
                _build_cycle_diagnostic(chain[chain.index(parent) :], name[0], heads)
            )
        if parent not in known:
            message = f"there is no {name[0]} '{parent}' in this library"
            others = [other for other in known if other != name[1]]
            raise DiagnosticsError.from_diagnostic(
                document.build_diagnostic(where, message, hint=suggest_name(parent, others))
            )
    return parents


def _build_cycle_diagnostic(
    circle: tuple[str, ...], kind: str, heads: Mapping[DeclarationKey, SourceDocument]
) -> Diagnostic:
    """The same problem from wherever the circle was entered."""
    begin = circle.index(min(circle))
    around = (*circle[begin:], *circle[:begin], circle[begin])
    hint = "take one of these `extends` away" if len(circle) > 1 else "take it away"
    message = f"goes in a circle: {' > '.join(around)}"
    return heads[kind, around[0]].build_diagnostic(("extends",), message, hint=hint)


def _find_disagreement(
    first: Mapping[str, Any], second: Mapping[str, Any], own: Any, where: ValuePath
) -> ValuePath | None:
    """Path of a value that two parents give differently and the declaration does not."""
    said: dict[str, Any] = own if isinstance(own, dict) else {}
    for key in (key for key in first if key in second and key != "kind"):
        one, other = first[key], second[key]
        if isinstance(one, dict) and isinstance(other, dict):
            if key in said and not isinstance(said[key], dict):
                continue
            inner = _find_disagreement(
                cast(dict[str, Any], one), cast(dict[str, Any], other), said.get(key), (*where, key)
            )
            if inner:
                return inner
        elif key not in said and one != other:
            return (*where, key)
    return None


def _build_disagreement_diagnostic(
    document: SourceDocument, where: ValuePath, first: Mapping[str, Any], second: Mapping[str, Any]
) -> Diagnostic:
    one, other = (_get_value(data, where) for data in (first, second))
    message = f"what it extends disagrees on {format_value_path(where)}: {one} and {other}"
    return document.build_diagnostic(
        ("extends",), message, hint=f"give {format_value_path(where)} here"
    )


def _get_value(data: Any, where: ValuePath) -> Any:
    for part in where:
        data = data[part]
    return data


def _merge_mappings(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    result = dict(base)
    for key, value in over.items():
        old = result.get(key)
        if isinstance(old, dict) and isinstance(value, dict):
            result[key] = _merge_mappings(cast(dict[str, Any], old), cast(dict[str, Any], value))
        elif isinstance(old, dict) and value is None:
            del result[key]
        else:
            result[key] = value
    return result


def _list_value_paths(data: Any, where: ValuePath) -> list[ValuePath]:
    inner: list[ValuePath] = [where] if where else []
    if isinstance(data, dict):
        items = list(cast(dict[str, Any], data).items())
    elif isinstance(data, list):
        items = list(enumerate(cast(list[Any], data)))
    else:
        items = []
    for key, value in items:
        inner += _list_value_paths(value, (*where, key))
    return inner


def replace_values(data: Any, values: Mapping[ValuePath, Any]) -> Any:
    """A copy of nested data with other values at some paths; mappings on the way are made."""
    result = data
    for where, value in values.items():
        result = _replace_value(result, where, value)
    return result


def _replace_value(data: Any, where: ValuePath, value: Any) -> Any:
    if not where:
        return value
    head, rest = where[0], where[1:]
    if isinstance(data, list) and isinstance(head, int):
        items = list(cast(list[Any], data))
        items[head] = _replace_value(items[head], rest, value)
        return items
    mapping = dict(cast(dict[Any, Any], data)) if isinstance(data, dict) else {}
    mapping[head] = _replace_value(mapping.get(head), rest, value)
    return mapping
