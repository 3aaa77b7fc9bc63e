"""YAML and JSON text as plain data, with the position of every value.

Reading is safe: no tags, no duplicate keys, limits on size, depth and expansion of aliases.
Booleans and numbers follow YAML 1.2 (`on` is text, `1e-6` is a number).
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import yaml
from advercity_dsl.base import ValuePath

from advercity.compiler.diagnostics import Diagnostic, DiagnosticsError
from advercity.errors import describe_cause

# Far above any declaration, since maps and models are files of their own.
MAX_BYTES = 4_000_000
MAX_DEPTH = 40
MAX_VALUES = 100_000


@dataclass(frozen=True)
class SourcePosition:
    """A position in a file; line and column count from 1."""

    line: int
    column: int
    width: int = 1


@dataclass(frozen=True)
class SourceDocument:
    """A parsed file.

    Attributes:
        path: The file, as requested.
        text: Its content.
        data: Plain dicts, lists and scalars.
        positions: Position of each value, by its path from the root.
        key_positions: Position of each mapping key, by the same path.
        diagnostics: Errors that do not depend on the kind of the declaration.
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
        return build_text_diagnostic(
            self.path, self.text, position, message, value_path=value_path, hint=hint
        )


def build_text_diagnostic(
    path: Path,
    text: str,
    position: SourcePosition,
    message: str,
    *,
    value_path: ValuePath = (),
    hint: str = "",
) -> Diagnostic:
    """Build a diagnostic at a position of `text`, with the line for its excerpt."""
    lines = _split_lines(text)
    return Diagnostic(
        path,
        position.line,
        position.column,
        format_value_path(value_path),
        message,
        hint,
        lines[position.line - 1] if position.line <= len(lines) else "",
        position.width,
    )


def _split_lines(text: str) -> list[str]:
    """Split text into the lines that YAML counts."""
    # str.splitlines() also splits at form feeds and separators, which would shift line numbers.
    return re.split("\r\n|[\n\r\x85\u2028\u2029]", text)


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
        IndexError: A path leads to an item that a list does not have.
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

    # Its own table: PyYAML would otherwise copy that of YAML 1.1, where `on` and `1_0` are values.
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


_YAML_MESSAGES = {
    "mapping values are not allowed in this context": (
        "unexpected ':'",
        "put text that contains ': ' in quotes, and align the keys of a mapping",
    ),
    "found character that cannot start any token": (
        "a value cannot begin with this character",
        "put it in quotes",
    ),
    "found unexpected end of stream": ("quotes or a bracket are not closed", "close them"),
    "did not find expected ',' or ']'": ("a list [ is not closed", "close it with ]"),
    "did not find expected ',' or '}'": ("a mapping { is not closed", "close it with }"),
    "did not find expected '-' indicator": (
        "expected the next list item, '- '",
        "indent keys below their item, or remove the '- '",
    ),
    "did not find expected key": (
        "expected a key",
        "give the keys of a mapping the same indentation, and each a ':'",
    ),
    "could not find expected ':'": ("a key has no ':'", "write `key: value`"),
    "but found another document": (
        "a second document begins here",
        "put each declaration into its own file",
    ),
    "found undefined alias": ("unknown anchor", "write the values out"),
}
"""Message and hint for each message of the parser."""
_TAB_MESSAGE = ("a tab in the indentation", "indent with spaces")


def read_document(path: Path) -> SourceDocument:
    """Read a YAML or JSON file.

    Raises:
        DiagnosticsError: The file cannot be read or parsed.
    """
    return parse_document(path, read_source_text(path))


def read_source_text(path: Path) -> str:
    """Read a file as UTF-8 text.

    Raises:
        DiagnosticsError: The file is missing, unreadable, too large, or not UTF-8.
    """
    try:
        if path.is_dir():
            raise _build_file_error(path, "is a folder", "name a file in it")
        if not path.is_file():
            message = "is not a file" if path.exists() else "file not found"
            raise _build_file_error(path, message)
        with path.open("rb") as file:
            # One byte more shows that a file is too large without reading all of it.
            raw = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise _build_file_error(path, f"cannot be read: {describe_cause(error)}") from None
    if len(raw) > MAX_BYTES:
        message = f"is larger than {MAX_BYTES // 1_000_000} MB; is it a declaration?"
        raise _build_file_error(path, message)
    try:
        # Editors on Windows begin files with a byte order mark.
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        message = f"is not UTF-8 text (line {line})"
        raise _build_file_error(path, message, "save it as UTF-8") from None


def _build_file_error(path: Path, message: str, hint: str = "") -> DiagnosticsError:
    return DiagnosticsError(Diagnostic(path, 0, 0, "", message, hint))


def parse_document(path: Path, text: str) -> SourceDocument:
    """Parse YAML or JSON text of the file `path`.

    Raises:
        DiagnosticsError: The text is not valid YAML, empty, or exceeds a limit.
    """
    root = _compose_tree(path, text)
    if root is None:
        hint = "`advercity new` writes a declaration to start from"
        raise DiagnosticsError(Diagnostic(path, 1, 1, "", "is empty", hint))
    builder = _DataBuilder(path, text)
    data = builder.build(root, ())
    return SourceDocument(
        path, text, data, builder.positions, builder.key_positions, tuple(builder.diagnostics)
    )


def _compose_tree(path: Path, text: str) -> yaml.Node | None:
    try:
        _check_safety(path, text)
        return _Loader(text).get_single_node()
    except yaml.MarkedYAMLError as error:
        raise DiagnosticsError(_build_syntax_diagnostic(path, text, error)) from None
    except yaml.YAMLError:
        # libyaml reports characters that it cannot read without a position.
        position = next(_find_control_characters(text), SourcePosition(1, 1))
        message, hint = "unexpected control character", "remove it; is this a text file?"
        raise DiagnosticsError(
            build_text_diagnostic(path, text, position, message, hint=hint)
        ) from None


def _build_syntax_diagnostic(path: Path, text: str, error: yaml.MarkedYAMLError) -> Diagnostic:
    mark = error.problem_mark or error.context_mark
    position = SourcePosition(mark.line + 1, mark.column + 1) if mark else SourcePosition(1, 1)
    problem = error.problem or "cannot be parsed"
    message, hint = _YAML_MESSAGES.get(problem, (problem, ""))
    lines = _split_lines(text)
    if position.line <= len(lines) and "\t" in lines[position.line - 1][: position.column]:
        message, hint = _TAB_MESSAGE
    elif error.context_mark and "not closed" in message:
        # The parser notices a missing bracket lines later; the opening one is what to look at.
        position = SourcePosition(error.context_mark.line + 1, error.context_mark.column + 1)
    elif position.line > len(lines) and lines:
        # At the end of the file the parser names the line after the last.
        position = SourcePosition(len(lines), len(lines[-1]) + 1)
    return build_text_diagnostic(path, text, position, f"not valid YAML: {message}", hint=hint)


def _find_control_characters(text: str) -> Iterator[SourcePosition]:
    for number, line in enumerate(_split_lines(text), start=1):
        for column, character in enumerate(line, start=1):
            if not character.isprintable() and character != "\t":
                yield SourcePosition(number, column)


def _check_safety(path: Path, text: str) -> None:
    """Raise on tags and on excessive depth, before the parser builds a tree by recursion."""
    depth = 0
    for event in _iterate_events(text):
        message = hint = ""
        if getattr(event, "tag", None):
            tag = event.tag.removeprefix("tag:yaml.org,2002:")
            message, hint = f"the tag {tag} is not supported", "write the plain value"
        elif isinstance(event, yaml.CollectionStartEvent):
            depth += 1
            if depth > MAX_DEPTH:
                message = f"is nested deeper than {MAX_DEPTH} levels"
                hint = "no declaration needs that; is a bracket not closed?"
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        if message:
            mark: Any = event.start_mark
            position = SourcePosition(mark.line + 1, mark.column + 1)
            raise DiagnosticsError(build_text_diagnostic(path, text, position, message, hint=hint))


def _iterate_events(text: str) -> Iterator[Any]:
    # PyYAML's type stubs know neither the loader's subclass nor the events' attributes.
    yield from yaml.parse(text, Loader=_Loader)


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
        # Nested aliases make a small file expand to billions of values.
        if len(value_path) > MAX_DEPTH or len(self.positions) >= MAX_VALUES:
            message = f"aliases (*) expand to more than {MAX_VALUES} values or {MAX_DEPTH} levels"
            raise DiagnosticsError(
                self._build_diagnostic(node, (), message, "write the values out")
            )
        self.positions[value_path] = _find_node_position(node)
        if isinstance(node, yaml.MappingNode):
            return self._build_mapping(node, value_path)
        if isinstance(node, yaml.SequenceNode):
            return [self.build(item, (*value_path, index)) for index, item in enumerate(node.value)]
        try:
            return self._constructor.construct_object(node)
        except (ValueError, yaml.YAMLError):
            message = f"'{node.value[:40]}' cannot be read as a number"
            self.diagnostics.append(self._build_diagnostic(node, value_path, message))
            return None

    def _build_mapping(self, node: yaml.MappingNode, value_path: ValuePath) -> dict[str, Any]:
        result: dict[str, Any] = {}
        for key_node, value_node in node.value:
            key = key_node.value
            if not isinstance(key_node, yaml.ScalarNode) or not isinstance(key, str):
                message, hint = "a key must be a plain name", "write `name: value`"
                self.diagnostics.append(self._build_diagnostic(key_node, value_path, message, hint))
                continue
            inner = (*value_path, key)
            if key in result:
                message = f"duplicate key, first in line {self.key_positions[inner].line}"
                self.diagnostics.append(
                    self._build_diagnostic(key_node, inner, message, "keep one")
                )
                continue
            self.key_positions[inner] = _find_node_position(key_node)
            result[key] = self.build(value_node, inner)
        return result

    def _build_diagnostic(
        self, node: yaml.Node, value_path: ValuePath, message: str, hint: str = ""
    ) -> Diagnostic:
        position = _find_node_position(node)
        return build_text_diagnostic(
            self.path, self.text, position, message, value_path=value_path, hint=hint
        )


def _find_node_position(node: yaml.Node) -> SourcePosition:
    """Return the start of a node, with its width if it is a scalar within one line."""
    begin, end = node.start_mark, node.end_mark
    is_one_line = isinstance(node, yaml.ScalarNode) and begin.line == end.line
    width = max(1, end.column - begin.column) if is_one_line else 1
    return SourcePosition(begin.line + 1, begin.column + 1, width)
