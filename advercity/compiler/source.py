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

from advercity.compiler.diagnostics import Diagnostic, DiagnosticsError

MAX_BYTES = 4_000_000
MAX_DEPTH = 40
MAX_VALUES = 100_000

PathPart = str | int
ValuePath = tuple[PathPart, ...]


@dataclass(frozen=True)
class SourcePosition:
    """A position in a file, counted from 1."""

    line: int
    column: int
    width: int = 1


@dataclass(frozen=True)
class SourceDocument:
    """One file, read.

    Attributes:
        path: As it was asked for.
        data: Plain dicts, lists and scalars.
        positions: Where each value, by its path from the root, begins.
        key_positions: Where each mapping key, by the same path, begins.
        diagnostics: What is wrong in it before anything is known of its kind.
    """

    path: Path
    text: str
    data: Any
    positions: dict[ValuePath, SourcePosition]
    key_positions: dict[ValuePath, SourcePosition]
    diagnostics: tuple[Diagnostic, ...] = ()

    def has_value(self, where: ValuePath) -> bool:
        """Whether there is a value at `where`."""
        return where in self.positions

    def find_position(self, where: ValuePath, *, key: bool = False) -> SourcePosition:
        """Of the value (or its key) at `where`, else of the nearest value around it."""
        if key and where in self.key_positions:
            return self.key_positions[where]
        for length in range(len(where), -1, -1):
            if where[:length] in self.positions:
                return self.positions[where[:length]]
        return SourcePosition(1, 1)

    def build_diagnostic(
        self, where: ValuePath, message: str, *, hint: str = "", key: bool = False
    ) -> Diagnostic:
        """A problem with the value (or key) at `where`."""
        at = self.find_position(where, key=key)
        return build_text_diagnostic(self.path, self.text, at, message, value_path=where, hint=hint)


def _split_lines(text: str) -> list[str]:
    """Lines as YAML counts them."""
    return re.split("\r\n|[\n\r\x85\u2028\u2029]", text)


def build_text_diagnostic(
    path: Path,
    text: str,
    position: SourcePosition,
    message: str,
    *,
    value_path: ValuePath = (),
    hint: str = "",
) -> Diagnostic:
    """A problem at a place of `text`, along with the line there."""
    lines = _split_lines(text)
    line = lines[position.line - 1] if position.line <= len(lines) else ""
    return Diagnostic(
        path,
        position.line,
        position.column,
        format_value_path(value_path),
        message,
        hint,
        line,
        position.width,
    )


def format_value_path(where: ValuePath) -> str:
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


_YAML_MESSAGES = {
    "mapping values are not allowed in this context": (
        "a ':' stands where none can",
        "put text that holds ': ' in quotes, and align keys of one mapping",
    ),
    "found character that cannot start any token": (
        "a value cannot begin with this character",
        "put it in quotes",
    ),
    "found unexpected end of stream": ("quotes or a bracket are not closed", "close them"),
    "did not find expected ',' or ']'": ("a list [ is not closed", "close it with ]"),
    "did not find expected ',' or '}'": ("a mapping { is not closed", "close it with }"),
    "did not find expected '-' indicator": (
        "a list does not go on with '- '",
        "indent keys below their item, or take the '- ' away",
    ),
    "did not find expected key": (
        "no key stands here",
        "give keys of one mapping the same indentation, and each a ':'",
    ),
    "could not find expected ':'": ("a key has no ':'", "write `key: value`"),
    "but found another document": (
        "a second document begins here",
        "put each declaration into a file of its own",
    ),
    "found undefined alias": ("there is no anchor of this name", "write the values out"),
}
"""What the parser says, in words of the author, with a way out."""
_TAB_MESSAGE = ("a tab stands in the indentation", "indent with spaces")


def read_document(path: Path) -> SourceDocument:
    """Read a YAML or JSON file; ProblemsError with the place of every problem."""
    return parse_document(path, read_source_text(path))


def read_source_text(path: Path) -> str:
    """Text of a file of sensible size; ProblemsError if there is none."""
    try:
        if path.is_dir():
            raise _build_file_error(path, "is a folder", "name a file in it")
        if not path.is_file():
            raise _build_file_error(
                path, "is no file" if path.exists() else "there is no such file"
            )
        with path.open("rb") as file:
            raw = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise _build_file_error(path, f"cannot be read: {error.strerror}") from None
    if len(raw) > MAX_BYTES:
        raise _build_file_error(
            path, f"is larger than {MAX_BYTES // 1_000_000} MB; is it a declaration?"
        )
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        message = f"is not UTF-8 text (line {line})"
        raise _build_file_error(path, message, "save it as UTF-8") from None


def _build_file_error(path: Path, message: str, hint: str = "") -> DiagnosticsError:
    return DiagnosticsError.from_diagnostic(Diagnostic(path, 0, 0, "", message, hint))


def parse_document(path: Path, text: str) -> SourceDocument:
    """Parse YAML or JSON text that came from `path`."""
    try:
        _check_safety(path, text)
        loader = _Loader(text)
        try:
            root = loader.get_single_node()
        finally:
            loader.dispose()
    except yaml.MarkedYAMLError as error:
        raise DiagnosticsError.from_diagnostic(
            _build_syntax_diagnostic(path, text, error)
        ) from None
    except yaml.YAMLError:
        at = next(_find_control_characters(text), SourcePosition(1, 1))
        message, hint = "a control character stands here", "take it away; is this a text file?"
        raise DiagnosticsError.from_diagnostic(
            build_text_diagnostic(path, text, at, message, hint=hint)
        ) from None
    if root is None:
        hint = "`advercity new` writes one to start from"
        raise DiagnosticsError.from_diagnostic(Diagnostic(path, 1, 1, "", "is empty", hint))
    builder = _DataBuilder(path, text)
    data = builder.build(root, ())
    return SourceDocument(
        path, text, data, builder.positions, builder.key_positions, tuple(builder.diagnostics)
    )


def _build_syntax_diagnostic(path: Path, text: str, error: yaml.MarkedYAMLError) -> Diagnostic:
    mark = error.problem_mark or error.context_mark
    at = SourcePosition(mark.line + 1, mark.column + 1) if mark else SourcePosition(1, 1)
    what = error.problem or "cannot be parsed"
    message, hint = _YAML_MESSAGES.get(what, (what, ""))
    lines = _split_lines(text)
    if at.line <= len(lines) and "\t" in lines[at.line - 1][: at.column]:
        message, hint = _TAB_MESSAGE
    elif error.context_mark and "not closed" in message:
        at = SourcePosition(error.context_mark.line + 1, error.context_mark.column + 1)
    elif at.line > len(lines) and lines:
        at = SourcePosition(len(lines), len(lines[-1]) + 1)
    return build_text_diagnostic(path, text, at, f"not valid YAML: {message}", hint=hint)


def _find_control_characters(text: str) -> Iterator[SourcePosition]:
    for number, line in enumerate(_split_lines(text), start=1):
        for column, character in enumerate(line, start=1):
            if not character.isprintable() and character != "\t":
                yield SourcePosition(number, column)


def _check_safety(path: Path, text: str) -> None:
    """Stop at foreign tags and at depth before any tree is built."""
    depth = 0
    for event in _iterate_events(text):
        message = hint = ""
        if getattr(event, "tag", None):
            message = f"the tag {event.tag.removeprefix('tag:yaml.org,2002:')} is not used here"
            hint = "write the plain value"
        elif isinstance(event, yaml.CollectionStartEvent):
            depth += 1
            if depth > MAX_DEPTH:
                message = f"is nested deeper than {MAX_DEPTH} levels"
                hint = "no declaration needs that; is a bracket not closed?"
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        if message:
            mark: Any = event.start_mark
            at = SourcePosition(mark.line + 1, mark.column + 1)
            raise DiagnosticsError.from_diagnostic(
                build_text_diagnostic(path, text, at, message, hint=hint)
            )


def _iterate_events(text: str) -> Iterator[Any]:
    yield from yaml.parse(text, Loader=_Loader)


class _DataBuilder:
    """Turns a node tree into data, noting places and duplicate keys."""

    def __init__(self, path: Path, text: str) -> None:
        self.path = path
        self.text = text
        self.positions: dict[ValuePath, SourcePosition] = {}
        self.key_positions: dict[ValuePath, SourcePosition] = {}
        self.diagnostics: list[Diagnostic] = []
        self._constructor = yaml.constructor.SafeConstructor()

    def build(self, node: yaml.Node, where: ValuePath) -> Any:
        if len(where) > MAX_DEPTH or len(self.positions) >= MAX_VALUES:
            message = f"aliases (*) expand to more than {MAX_VALUES} values or {MAX_DEPTH} levels"
            hint = "write the values out"
            raise DiagnosticsError.from_diagnostic(
                build_text_diagnostic(
                    self.path, self.text, _find_node_position(node), message, hint=hint
                )
            )
        self.positions[where] = _find_node_position(node)
        if isinstance(node, yaml.MappingNode):
            return self._build_mapping(node, where)
        if isinstance(node, yaml.SequenceNode):
            return [self.build(item, (*where, index)) for index, item in enumerate(node.value)]
        try:
            return self._constructor.construct_object(node)
        except (ValueError, yaml.YAMLError):
            self._add_diagnostic(node, where, f"'{node.value[:40]}' cannot be read as a number")
            return None

    def _build_mapping(self, node: yaml.MappingNode, where: ValuePath) -> dict[str, Any]:
        result: dict[str, Any] = {}
        for key_node, value_node in node.value:
            key = key_node.value
            if not isinstance(key_node, yaml.ScalarNode) or not isinstance(key, str):
                self._add_diagnostic(
                    key_node, where, "a key must be a plain name", "write `name: value`"
                )
                continue
            inner = (*where, key)
            if key in result:
                first = self.key_positions[inner].line
                self._add_diagnostic(
                    key_node, inner, f"is here twice, first in line {first}", "keep one"
                )
                continue
            self.key_positions[inner] = _find_node_position(key_node)
            result[key] = self.build(value_node, inner)
        return result

    def _add_diagnostic(
        self, node: yaml.Node, where: ValuePath, message: str, hint: str = ""
    ) -> None:
        self.diagnostics.append(
            build_text_diagnostic(
                self.path,
                self.text,
                _find_node_position(node),
                message,
                value_path=where,
                hint=hint,
            )
        )


def _find_node_position(node: yaml.Node) -> SourcePosition:
    """Where a node begins, and how wide it is if it is a scalar within one line."""
    begin, end = node.start_mark, node.end_mark
    one_line = isinstance(node, yaml.ScalarNode) and begin.line == end.line
    width = max(1, end.column - begin.column) if one_line else 1
    return SourcePosition(begin.line + 1, begin.column + 1, width)
