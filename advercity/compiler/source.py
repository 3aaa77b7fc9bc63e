"""YAML and JSON text as plain data that remembers where every value stands.

Safe by construction: no tags, no duplicate keys, limits on size, depth and what aliases expand
to, and the booleans and numbers of YAML 1.2 (`on` is text, `1e-6` is a number).
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from advercity.compiler.problems import Problem, ProblemsError

MAX_BYTES = 4_000_000
MAX_DEPTH = 40
MAX_VALUES = 100_000

Key = str | int
Where = tuple[Key, ...]


@dataclass(frozen=True)
class Place:
    """A position in a file, counted from 1."""

    line: int
    column: int


@dataclass(frozen=True)
class Document:
    """One file, read.

    Attributes:
        path: As it was asked for.
        data: Plain dicts, lists and scalars.
        places: Where each value, by its path from the root, begins.
        keys: Where each mapping key, by the same path, begins.
    """

    path: Path
    text: str
    data: Any
    places: dict[Where, Place]
    keys: dict[Where, Place]

    def place(self, where: Where, *, key: bool = False) -> Place:
        """Of the value (or its key) at `where`, else of the nearest value around it."""
        if key and where in self.keys:
            return self.keys[where]
        for length in range(len(where), -1, -1):
            if where[:length] in self.places:
                return self.places[where[:length]]
        return Place(1, 1)

    def problem(self, where: Where, message: str, *, hint: str = "", key: bool = False) -> Problem:
        """A problem with the value (or key) at `where`."""
        at = self.place(where, key=key)
        return Problem(self.path, at.line, at.column, dotted(where), message, hint)


def dotted(where: Where) -> str:
    """`('fog', 'mor_m')` as `fog.mor_m`."""
    return ".".join(str(part) for part in where)


class _Loader(yaml.CSafeLoader):
    """Resolves plain scalars as YAML 1.2's core schema does."""

    yaml_implicit_resolvers: dict[str, list[tuple[str, re.Pattern[str]]]] = {}  # noqa: RUF012


_NUMBER_START = list("-+.0123456789")
_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:bool", re.compile(r"^(?:true|True|TRUE|false|False|FALSE)$"), list("tTfF")
)
_Loader.add_implicit_resolver("tag:yaml.org,2002:null", re.compile(r"^(?:~|null|Null|NULL|)$"), [
    "~", "n", "N", "",
])  # fmt: skip
_Loader.add_implicit_resolver("tag:yaml.org,2002:int", re.compile(r"^[-+]?[0-9]+$"), _NUMBER_START)
_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?(?:(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?|\.?(?:inf|Inf|INF))$"),
    [*_NUMBER_START, "i", "I"],
)


def read(path: Path) -> Document:
    """Read a YAML or JSON file; ProblemsError with the place of every problem."""
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise ProblemsError.of(
            Problem(path, 0, 0, "", f"cannot be read: {error.strerror}")
        ) from None
    if len(raw) > MAX_BYTES:
        message = f"has {len(raw)} bytes; at most {MAX_BYTES} are read"
        raise ProblemsError.of(Problem(path, 0, 0, "", message))
    try:
        return parse(path, raw.decode("utf-8"))
    except UnicodeDecodeError as error:
        message = f"is not UTF-8 text (byte {error.start})"
        raise ProblemsError.of(Problem(path, 0, 0, "", message)) from None


def parse(path: Path, text: str) -> Document:
    """Parse YAML or JSON text that came from `path`."""
    try:
        _refuse_unsafe(path, text)
        loader = _Loader(text)
        try:
            root = loader.get_single_node()
        finally:
            loader.dispose()
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line, column = (mark.line + 1, mark.column + 1) if mark else (1, 1)
        what = error.problem or "cannot be parsed"
        raise ProblemsError.of(Problem(path, line, column, "", f"not valid YAML: {what}")) from None
    except yaml.YAMLError as error:
        raise ProblemsError.of(Problem(path, 1, 1, "", f"not valid YAML: {error}")) from None
    if root is None:
        raise ProblemsError.of(Problem(path, 1, 1, "", "is empty"))
    builder = _Builder(path)
    data = builder.build(root, ())
    if builder.problems:
        raise ProblemsError(builder.problems)
    return Document(path, text, data, builder.places, builder.keys)


def _refuse_unsafe(path: Path, text: str) -> None:
    """Stop at foreign tags and at depth before any tree is built."""
    depth = 0
    for event in _events(text):
        message = ""
        if getattr(event, "tag", None):
            message = f"the tag {event.tag} is not used here; write plain values"
        elif isinstance(event, yaml.CollectionStartEvent):
            depth += 1
            if depth > MAX_DEPTH:
                message = f"is nested deeper than {MAX_DEPTH} levels"
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        if message:
            mark: Any = event.start_mark
            raise ProblemsError.of(Problem(path, mark.line + 1, mark.column + 1, "", message))


def _events(text: str) -> Iterator[Any]:
    yield from yaml.parse(text, Loader=_Loader)


class _Builder:
    """Turns a node tree into data, noting places and duplicate keys."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.places: dict[Where, Place] = {}
        self.keys: dict[Where, Place] = {}
        self.problems: list[Problem] = []
        self._constructor = yaml.constructor.SafeConstructor()

    def build(self, node: yaml.Node, where: Where) -> Any:
        if len(where) > MAX_DEPTH or len(self.places) >= MAX_VALUES:
            message = f"aliases expand to more than {MAX_VALUES} values or {MAX_DEPTH} levels"
            at = _place(node)
            raise ProblemsError.of(Problem(self.path, at.line, at.column, "", message))
        self.places[where] = _place(node)
        if isinstance(node, yaml.MappingNode):
            return self._mapping(node, where)
        if isinstance(node, yaml.SequenceNode):
            return [self.build(item, (*where, index)) for index, item in enumerate(node.value)]
        try:
            return self._constructor.construct_object(node)
        except (ValueError, yaml.YAMLError):
            self._complain(node, where, f"'{node.value}' cannot be read")
            return None

    def _mapping(self, node: yaml.MappingNode, where: Where) -> dict[str, Any]:
        result: dict[str, Any] = {}
        for key_node, value_node in node.value:
            key = key_node.value
            if not isinstance(key_node, yaml.ScalarNode) or not isinstance(key, str):
                self._complain(key_node, where, "a key must be a plain name")
                continue
            inner = (*where, key)
            if key in result:
                first = self.keys[inner].line
                self._complain(key_node, inner, f"is here twice; first in line {first}")
                continue
            self.keys[inner] = _place(key_node)
            result[key] = self.build(value_node, inner)
        return result

    def _complain(self, node: yaml.Node, where: Where, message: str) -> None:
        at = _place(node)
        self.problems.append(Problem(self.path, at.line, at.column, dotted(where), message))


def _place(node: yaml.Node) -> Place:
    return Place(node.start_mark.line + 1, node.start_mark.column + 1)
