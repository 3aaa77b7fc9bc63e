"""Declarations and specs as plain data, with the position of every value.

Booleans and numbers follow YAML 1.2 (`on` is text, `1e-6` is a number).
"""

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import yaml
from advercity_dsl.base import ValuePath

from advercity.diagnostics import Diagnostic, DiagnosticsError
from advercity.documents import (
    SourcePosition,
    build_text_diagnostic,
    compose_yaml,
    read_text,
)


@dataclass(frozen=True)
class SourceDocument:
    """A parsed file.

    Attributes:
        path: The file, as requested.
        text: Its content.
        data: Plain dicts, lists and scalars.
        positions: Position of each value, by its path from the root.
        key_positions: Position of each mapping key, by the same path.
        diagnostics: Errors independent of the declaration's kind.
    """

    path: Path
    text: str
    data: Any
    positions: dict[ValuePath, SourcePosition]
    key_positions: dict[ValuePath, SourcePosition]
    diagnostics: tuple[Diagnostic, ...] = ()

    def has_value(self, value_path: ValuePath) -> bool:
        """Return whether the document has a value at a path."""
        return value_path in self.positions

    def select(self, value_path: ValuePath) -> "SourceDocument":
        """Return the part of the document below a path, with its positions in the file."""
        data = self.data
        for name in value_path:
            data = data[name]
        size = len(value_path)
        positions, key_positions = (
            {path[size:]: place for path, place in places.items() if path[:size] == value_path}
            for places in (self.positions, self.key_positions)
        )
        return replace(self, data=data, positions=positions, key_positions=key_positions)

    def find_position(self, value_path: ValuePath, *, key: bool = False) -> SourcePosition:
        """Return the position of a value (or its key), else of the nearest enclosing value."""
        if key and value_path in self.key_positions:
            return self.key_positions[value_path]
        for length in range(len(value_path), -1, -1):
            if value_path[:length] in self.positions:
                return self.positions[value_path[:length]]
        return SourcePosition(1, 1)

    def build_diagnostic(
        self, value_path: ValuePath, message: str, *, hint: str = "", key: bool = False
    ) -> Diagnostic:
        """Build a diagnostic at the value (or key) of a path."""
        position = self.find_position(value_path, key=key)
        return _build_diagnostic(self.path, self.text, position, value_path, message, hint)


def _build_diagnostic(
    path: Path,
    text: str,
    position: SourcePosition,
    value_path: ValuePath,
    message: str,
    hint: str,
) -> Diagnostic:
    dotted = format_value_path(value_path)
    return build_text_diagnostic(path, text, position, message, value_path=dotted, hint=hint)


def format_value_path(value_path: ValuePath) -> str:
    """Format `('fog', 'mor_m')` as `fog.mor_m`."""
    return ".".join(map(str, value_path))


def iterate_values(data: Any, value_path: ValuePath = ()) -> Iterator[tuple[ValuePath, Any]]:
    """Yield nested data and everything inside it, each with its path, outer values first."""
    yield value_path, data
    items: Any = ()
    if isinstance(data, dict):
        items = cast(dict[str, Any], data).items()
    elif isinstance(data, list):
        items = enumerate(cast(list[Any], data))
    for key, value in items:
        yield from iterate_values(value, (*value_path, key))


def replace_values(data: Any, values: Mapping[ValuePath, Any]) -> Any:
    """Return a copy of nested data with other values at some paths, creating missing mappings.

    Raises:
        IndexError: A path leads to a missing item of a list.
    """
    for value_path, value in values.items():
        data = _replace_value(data, value_path, value)
    return data


def _replace_value(data: Any, value_path: ValuePath, value: Any) -> Any:
    if not value_path:
        return value
    head, rest = value_path[0], value_path[1:]
    if isinstance(data, list) and isinstance(head, int):
        items = list(cast(list[Any], data))
        items[head] = _replace_value(items[head], rest, value)
        return items
    mapping = dict(cast(dict[Any, Any], data)) if isinstance(data, dict) else {}
    mapping[head] = _replace_value(mapping.get(head), rest, value)
    return mapping


class _Loader(yaml.CSafeLoader):
    """Resolves plain scalars by the core schema of YAML 1.2 instead of YAML 1.1."""

    # Its own table: PyYAML would otherwise copy YAML 1.1's, where `on` and `1_0` are values.
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


def read_document(path: Path) -> SourceDocument:
    """Read a YAML or JSON file.

    Raises:
        DiagnosticsError: The file cannot be read or parsed.
    """
    return parse_document(path, read_text(path))


def parse_document(path: Path, text: str) -> SourceDocument:
    """Parse YAML or JSON text of the file `path`.

    Raises:
        DiagnosticsError: The text is not valid YAML, empty, or exceeds a limit.
    """
    root = compose_yaml(text, path, _Loader)
    if root is None:
        hint = "`advercity new` writes a declaration to start from"
        raise DiagnosticsError(Diagnostic(path, 1, 1, "", "is empty", hint))
    builder = _DataBuilder(path, text)
    data = builder.build(root, ())
    return SourceDocument(
        path, text, data, builder.positions, builder.key_positions, tuple(builder.diagnostics)
    )


class _DataBuilder:
    """Converts a node tree into data, recording positions and duplicate keys."""

    def __init__(self, path: Path, text: str) -> None:
        self.path = path
        self.text = text
        self.positions: dict[ValuePath, SourcePosition] = {}
        self.key_positions: dict[ValuePath, SourcePosition] = {}
        self.diagnostics: list[Diagnostic] = []
        self._constructor = yaml.constructor.SafeConstructor()

    def build(self, node: yaml.Node, value_path: ValuePath) -> Any:
        self.positions[value_path] = _find_node_position(node)
        if isinstance(node, yaml.MappingNode):
            return self._build_mapping(node, value_path)
        if isinstance(node, yaml.SequenceNode):
            return [self.build(item, (*value_path, index)) for index, item in enumerate(node.value)]
        return self._build_scalar(node, value_path)

    def _build_scalar(self, node: yaml.Node, value_path: ValuePath) -> Any:
        message, hint = f"'{node.value[:40]}' is too large for a number", ""
        try:
            value = self._constructor.construct_object(node)
            if value is None and node.value == "":
                message = "the value is missing"
                hint = "write one, `null` for none, or remove the field"
            elif not isinstance(value, float) or math.isfinite(value) or "n" in node.value.lower():
                return value
        except (ValueError, yaml.YAMLError):
            pass
        self._report(node, value_path, message, hint)
        return None

    def _build_mapping(self, node: yaml.MappingNode, value_path: ValuePath) -> dict[str, Any]:
        result: dict[str, Any] = {}
        for key_node, value_node in node.value:
            key = key_node.value
            if not isinstance(key_node, yaml.ScalarNode) or not isinstance(key, str):
                message, hint = "a key must be a plain name", "write `name: value`"
                self._report(key_node, value_path, message, hint)
                continue
            inner = (*value_path, key)
            if key in result:
                message = f"duplicate key, first in line {self.key_positions[inner].line}"
                self._report(key_node, inner, message, "keep one")
                continue
            self.key_positions[inner] = _find_node_position(key_node)
            result[key] = self.build(value_node, inner)
        return result

    def _report(self, node: yaml.Node, value_path: ValuePath, message: str, hint: str) -> None:
        position = _find_node_position(node)
        self.diagnostics.append(
            _build_diagnostic(self.path, self.text, position, value_path, message, hint)
        )


def _find_node_position(node: yaml.Node) -> SourcePosition:
    """Return the start of a node, with its width if it is a scalar within one line."""
    begin, end = node.start_mark, node.end_mark
    is_one_line = isinstance(node, yaml.ScalarNode) and begin.line == end.line
    width = max(1, end.column - begin.column) if is_one_line else 1
    return SourcePosition(begin.line + 1, begin.column + 1, width)
