"""`extends`: a declaration over those that it builds on.

Mappings merge key by key; numbers, text and lists replace; `null` in place of a mapping takes the
inherited one away. Name and provenance (`id`, `title`, `source`, `assumption`) are never
inherited. Where two parents disagree, the declaration has to say which value it means.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, cast

from advercity.compiler.problems import Problem, ProblemsError, nearest
from advercity.compiler.source import Document, Place, Where, dotted

ABOUT_THE_FILE = ("extends", "version")
"""Keys of a document that are no fields of what it declares."""
OWN = ("id", "title", "source", "assumption")
Name = tuple[str, str]
"""Kind and id."""


@dataclass(frozen=True)
class Resolved:
    """A declaration's data with all that it extends merged in.

    Attributes:
        data: Plain values.
        document: Where it is written.
        origins: The document that each inherited value stands in, by path.
    """

    data: dict[str, Any]
    document: Document
    origins: Mapping[Where, Document]

    def has(self, where: Where) -> bool:
        """Whether there is a value at `where`, its own or inherited."""
        return where in self.origins or self.document.has(where)

    def with_value(self, where: Where, value: Any) -> "Resolved":
        """The same with another value at a path; ProblemsError if it leads out of a list."""
        try:
            return replace(self, data=replaced(self.data, {where: value}))
        except IndexError:
            message, hint = "the list has no such item", "items count from 0"
            raise ProblemsError.of(self.problem(where, message, hint=hint)) from None

    def document_of(self, where: Where) -> Document:
        """The file in which the value at `where`, or the nearest around it, stands."""
        for length in range(len(where), 0, -1):
            if self.document.has(where[:length]):
                return self.document
            if where[:length] in self.origins:
                return self.origins[where[:length]]
        return self.document

    def place(self, where: Where) -> Place:
        """Of the value at `where` in its document."""
        return self.document_of(where).place(where)

    def problem(self, where: Where, message: str, *, hint: str = "", key: bool = False) -> Problem:
        """A problem with the value (or key) at `where`, in the file that says it."""
        return self.document_of(where).problem(where, message, hint=hint, key=key)


def resolve(name: Name, heads: Mapping[Name, Document]) -> Resolved:
    """The declaration `name` with what it extends.

    Raises:
        ProblemsError: It extends what is not there, itself, or parents that disagree.
    """
    return _resolve(name, heads, ())


def _resolve(name: Name, heads: Mapping[Name, Document], below: tuple[str, ...]) -> Resolved:
    document = heads[name]
    own = {key: value for key, value in document.data.items() if key not in ABOUT_THE_FILE}
    if "extends" not in document.data:
        return Resolved(own, document, {})
    chain = (*below, name[1])
    parents = [
        _resolve((name[0], parent), heads, chain)
        for parent in _parents(document, name, heads, chain)
    ]
    merged: dict[str, Any] = {}
    origins: dict[Where, Document] = {}
    for parent in parents:
        inherited = {key: value for key, value in parent.data.items() if key not in OWN}
        clash = _clash(merged, inherited, own, ())
        if clash:
            raise ProblemsError.of(_clash_problem(document, clash, merged, inherited))
        merged = _merged(merged, inherited)
        origins |= {where: parent.document_of(where) for where in _paths(inherited, ())}
    return Resolved(_merged(merged, own), document, origins)


def _parents(
    document: Document, name: Name, heads: Mapping[Name, Document], chain: tuple[str, ...]
) -> list[str]:
    written = document.data["extends"]
    parents = cast(list[Any], written) if isinstance(written, list) else [written]
    known = [other for kind, other in heads if kind == name[0]]
    for index, parent in enumerate(parents):
        where = ("extends", index) if isinstance(written, list) else ("extends",)
        if not isinstance(parent, str):
            problem = document.problem(
                where, f"must name a {name[0]}", hint="write an id, or a list of ids"
            )
            raise ProblemsError.of(problem)
        if parent in chain:
            raise ProblemsError.of(_circle(chain[chain.index(parent) :], name[0], heads))
        if parent not in known:
            message = f"there is no {name[0]} '{parent}' in this library"
            others = [other for other in known if other != name[1]]
            raise ProblemsError.of(document.problem(where, message, hint=nearest(parent, others)))
    return parents


def _circle(circle: tuple[str, ...], kind: str, heads: Mapping[Name, Document]) -> Problem:
    """The same problem from wherever the circle was entered."""
    begin = circle.index(min(circle))
    around = (*circle[begin:], *circle[:begin], circle[begin])
    hint = "take one of these `extends` away" if len(circle) > 1 else "take it away"
    message = f"goes in a circle: {' > '.join(around)}"
    return heads[kind, around[0]].problem(("extends",), message, hint=hint)


def _clash(
    first: Mapping[str, Any], second: Mapping[str, Any], own: Any, where: Where
) -> Where | None:
    """Path of a value that two parents give differently and the declaration does not."""
    said: dict[str, Any] = own if isinstance(own, dict) else {}
    for key in (key for key in first if key in second and key != "kind"):
        one, other = first[key], second[key]
        if isinstance(one, dict) and isinstance(other, dict):
            if key in said and not isinstance(said[key], dict):
                continue
            inner = _clash(
                cast(dict[str, Any], one), cast(dict[str, Any], other), said.get(key), (*where, key)
            )
            if inner:
                return inner
        elif key not in said and one != other:
            return (*where, key)
    return None


def _clash_problem(
    document: Document, where: Where, first: Mapping[str, Any], second: Mapping[str, Any]
) -> Problem:
    one, other = (_value(data, where) for data in (first, second))
    message = f"what it extends disagrees on {dotted(where)}: {one} and {other}"
    return document.problem(("extends",), message, hint=f"give {dotted(where)} here")


def _value(data: Any, where: Where) -> Any:
    for part in where:
        data = data[part]
    return data


def _merged(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    result = dict(base)
    for key, value in over.items():
        old = result.get(key)
        if isinstance(old, dict) and isinstance(value, dict):
            result[key] = _merged(cast(dict[str, Any], old), cast(dict[str, Any], value))
        elif isinstance(old, dict) and value is None:
            del result[key]
        else:
            result[key] = value
    return result


def _paths(data: Any, where: Where) -> list[Where]:
    inner: list[Where] = [where] if where else []
    if isinstance(data, dict):
        items = list(cast(dict[str, Any], data).items())
    elif isinstance(data, list):
        items = list(enumerate(cast(list[Any], data)))
    else:
        items = []
    for key, value in items:
        inner += _paths(value, (*where, key))
    return inner


def replaced(data: Any, values: Mapping[Where, Any]) -> Any:
    """A copy of nested data with other values at some paths; mappings on the way are made."""
    result = data
    for where, value in values.items():
        result = _replaced(result, where, value)
    return result


def _replaced(data: Any, where: Where, value: Any) -> Any:
    if not where:
        return value
    head, rest = where[0], where[1:]
    if isinstance(data, list) and isinstance(head, int):
        items = list(cast(list[Any], data))
        items[head] = _replaced(items[head], rest, value)
        return items
    mapping = dict(cast(dict[Any, Any], data)) if isinstance(data, dict) else {}
    mapping[head] = _replaced(mapping.get(head), rest, value)
    return mapping
