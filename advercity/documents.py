"""YAML and JSON of unknown authors, read as plain data within limits.

Every such file is read here, and none exhausts memory, time or the stack: only regular files of
limited size, no deep nesting, no expansion of aliases, no tags, no merge keys, no duplicate keys,
UTF-8 only. Errors are diagnostics with file, line and column.
"""

import difflib
import json
import re
import stat
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, cast

import numpy as np
import yaml

from advercity.diagnostics import Diagnostic, DiagnosticsError
from advercity.errors import describe_cause

MAX_YAML_BYTES = 4_000_000
"""Far above any declaration or frame; PyYAML reads about a megabyte a second."""
MAX_JSON_BYTES = 256_000_000
"""Ten times the manifest of the longest scenario."""
MAX_MODEL_BYTES = 200_000_000
"""Largest 3-D model of a user."""
MAX_DEPTH = 40
MAX_VALUES = 100_000
MAX_NUMBER_LENGTH = 400
"""Longest text of a number; Python takes quadratic time for the digits of an integer."""


@dataclass(frozen=True)
class SourcePosition:
    """A position in a file; line and column count from 1."""

    line: int
    column: int
    width: int = 1

    @staticmethod
    def from_offset(text: str, offset: int) -> "SourcePosition":
        """Return the position of a character, by its index in the text."""
        before = split_lines(text[:offset])
        return SourcePosition(len(before), len(before[-1]) + 1)


def read_bytes(path: Path, *, max_bytes: int) -> bytes:
    """Read a regular file.

    Raises:
        DiagnosticsError: It is a folder, a pipe or a device, or larger than `max_bytes`.
        OSError: It is missing or unreadable.
    """
    found = path.stat()
    mode = found.st_mode  # opening a pipe would wait for its writer
    if stat.S_ISDIR(mode):
        first = min((item for item in path.glob("[!.]*.*") if item.is_file()), default=None)
        example = f", such as {first}" if first else ""
        raise _build_file_error(path, "is a folder", f"name a file in it{example}")
    if not stat.S_ISREG(mode):
        raise _build_file_error(path, "is not a regular file", "copy its content into one")
    with path.open("rb") as file:
        # One byte more shows that a file is too large without reading all of it; Python takes the
        # memory for the requested size.
        raw = file.read(min(found.st_size, max_bytes) + 1)
    if len(raw) > max_bytes:
        raise _build_file_error(
            path, f"is larger than {max_bytes / 1e6:g} MB", "is it the right file?"
        )
    return raw


def read_text(path: Path, *, max_bytes: int = MAX_YAML_BYTES) -> str:
    """Read a file as UTF-8 text.

    Raises:
        DiagnosticsError: The file is missing, unreadable, not regular, too large, or not UTF-8.
    """
    try:
        return decode_text(read_bytes(path, max_bytes=max_bytes), path)
    except FileNotFoundError:
        raise _build_file_error(path, "file not found", suggest_path(path)) from None
    except OSError as error:
        raise _build_file_error(path, f"cannot be read: {describe_cause(error)}") from None


def decode_text(raw: bytes, path: Path) -> str:
    """Decode UTF-8 text of the file `path`; DiagnosticsError if it is something else."""
    try:
        # Editors on Windows begin files with a byte order mark.
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        column = error.start - raw.rfind(b"\n", 0, error.start)
        diagnostic = Diagnostic(path, line, column, "", "is not UTF-8 text", "save it as UTF-8")
        raise DiagnosticsError(diagnostic) from None


def suggest_path(path: Path) -> str:
    """Return a hint for a missing path: the most similar name there, or none."""
    names = [item.name for item in path.parent.glob("*")]
    if path.name in names:
        return "it is a link that leads nowhere"
    close = difflib.get_close_matches(path.name, names, n=1)
    return f"did you mean '{path.parent / close[0]}'?" if close else ""


def _build_file_error(path: Path, message: str, hint: str = "") -> DiagnosticsError:
    return DiagnosticsError(Diagnostic(path, 0, 0, "", message, hint))


# Cached for files with hundreds of errors.
@lru_cache(maxsize=2)
def split_lines(text: str) -> list[str]:
    """Split text into YAML's lines."""
    # str.splitlines() also splits at form feeds and separators, which would shift line numbers.
    return re.split("\r\n|[\n\r\x85\u2028\u2029]", text)


def build_text_diagnostic(
    path: Path,
    text: str,
    position: SourcePosition,
    message: str,
    *,
    value_path: str = "",
    hint: str = "",
) -> Diagnostic:
    """Build a diagnostic at a position of `text`, with the line for its excerpt."""
    lines = split_lines(text)
    line_text = lines[position.line - 1] if position.line <= len(lines) else ""
    place = (position.line, position.column)
    return Diagnostic(path, *place, value_path, message, hint, line_text, position.width)


# JSON


def parse_json(source: str | bytes, path: Path, *, hint: str = "") -> Any:
    """Parse JSON of the file `path`.

    Args:
        source: Its content.
        path: The file, for messages.
        hint: Advice for an invalid file.

    Raises:
        DiagnosticsError: It is not valid, too deep, or repeats a key.
    """
    text = decode_text(source, path) if isinstance(source, bytes) else source
    try:
        if _measure_json_depth(text) > MAX_DEPTH:
            raise ValueError
        return json.loads(text, object_pairs_hook=_build_object, parse_constant=_refuse_constant)
    except ValueError as error:
        offset, message = _describe_json_error(text, error)
        position = SourcePosition.from_offset(text, offset)
        message = f"not valid JSON: {message}"
        raise DiagnosticsError(
            build_text_diagnostic(path, text, position, message, hint=hint)
        ) from None


_ALL_BUT_BRACKETS = bytes(code for code in range(256) if code not in b'[]{}"')


def _measure_json_depth(text: str) -> int:
    """Return the highest number of open brackets, outside of texts."""
    # Whole manifests pass through here: bytes are dropped by the million, not looked at one by one.
    raw = text.encode()
    unescaped = re.sub(rb"\\.", b"", raw, flags=re.DOTALL) if b"\\" in raw else raw
    outside = b"".join(unescaped.translate(None, _ALL_BUT_BRACKETS).split(b'"')[::2])
    brackets = np.frombuffer(outside, np.uint8)
    opens = (brackets == ord("[")) | (brackets == ord("{"))
    return int(np.cumsum(np.where(opens, 1, -1)).max(initial=0))


def _build_object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    result = dict(pairs)
    if len(result) < len(pairs):
        raise ValueError
    return result


def _refuse_constant(name: str) -> float:
    raise ValueError(f"{name} is not a number in JSON")


# A text without an end reaches to the end of the file: no character is looked at twice.
_JSON_TOKEN = re.compile(
    r'\\.|("(?:[^"\\]|\\.)*+(?:"|\\?\Z))(\s*+:)?|[\[{]|[\]}]|-?(?:NaN|Infinity)|\d++',
    re.DOTALL,
)


def _describe_json_error(text: str, error: ValueError) -> tuple[int, str]:
    """Find the error in a refused text: index of the character, and message."""
    if isinstance(error, json.JSONDecodeError):
        return error.pos, f"{error.msg[0].lower()}{error.msg[1:]}"
    keys: list[set[str]] = []
    for match in _JSON_TOKEN.finditer(text):
        part = match[0]
        if part in "[{":
            keys.append(set())
        elif part in "]}":
            keys = keys[:-1]
        elif match[2] and keys:
            if match[1] in keys[-1]:
                return match.start(), f"duplicate key {match[1][:80]}"
            keys[-1].add(match[1])
        elif part.endswith(("NaN", "Infinity")):
            return match.start(), f"{part} is not a number in JSON"
        elif part.isdigit() and len(part) > MAX_NUMBER_LENGTH:
            return match.start(), f"a number of {len(part)} digits"
        if len(keys) > MAX_DEPTH:
            return match.start(), f"nested deeper than {MAX_DEPTH} levels"
    return 0, str(error)


# YAML


def parse_yaml(source: str | bytes, path: Path, *, hint: str = "") -> Any:
    """Parse YAML 1.1 of the file `path`, as the loaders of OPV2V do; None if it is empty.

    Args:
        source: Its content.
        path: The file, for messages.
        hint: Advice for an invalid file.

    Raises:
        DiagnosticsError: It is not valid, exceeds a limit, repeats a key, or has tags or merges.
    """
    text = decode_text(source, path) if isinstance(source, bytes) else source
    with _report_yaml_errors(path, text, hint):
        if not _is_evidently_flat(text):
            _check_events(path, text, hint)
        try:
            return yaml.load(text, Loader=_PlainLoader)  # noqa: S506  derived from the safe one
        except (ArithmeticError, ValueError):
            raise _find_unreadable_scalar(text) from None


def compose_yaml(text: str, path: Path, loader: type[yaml.CSafeLoader]) -> yaml.Node | None:
    """Parse YAML of the file `path` into nodes, with the loader's types of plain scalars.

    Raises:
        DiagnosticsError: It is not valid, exceeds a limit, or has tags.
    """
    with _report_yaml_errors(path, text):
        _check_events(path, text)
        return loader(text).get_single_node()


class _PlainLoader(yaml.CSafeLoader):
    """Refuses duplicate keys, and numbers of any length."""

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        mapping = cast(dict[Any, Any], super().construct_mapping(node, deep))
        if len(mapping) != len(node.value):
            raise yaml.MarkedYAMLError(problem="duplicate key", problem_mark=_find_repeated(node))
        return mapping

    def construct_yaml_int(self, node: Any) -> int:
        if len(node.value) > MAX_NUMBER_LENGTH:
            raise ValueError
        return super().construct_yaml_int(node)


_PlainLoader.add_constructor("tag:yaml.org,2002:int", _PlainLoader.construct_yaml_int)


def _find_unreadable_scalar(text: str) -> yaml.MarkedYAMLError:
    """Describe the first number or date without a value in a text."""
    loader = _PlainLoader(text)
    pending: list[Any] = [loader.get_single_node()]
    while pending:
        node = pending.pop()
        if isinstance(node, yaml.MappingNode):
            pending += [part for pair in reversed(node.value) for part in reversed(pair)]
        elif isinstance(node, yaml.SequenceNode):
            pending += reversed(node.value)
        else:
            try:
                loader.construct_object(node)
            except (ArithmeticError, ValueError):
                problem = f"'{node.value[:40]}' is no number or date"
                return yaml.MarkedYAMLError(problem=problem, problem_mark=node.start_mark)
    return yaml.MarkedYAMLError(problem="cannot be read")


def _find_repeated(node: Any) -> Any:
    """Return the mark of the first repeated key of a mapping."""
    seen: set[str] = set()
    for key, _ in node.value:
        if key.value in seen:
            return key.start_mark
        seen.add(str(key.value))
    return node.start_mark  # such as 1 and 0x1


_UNUSUAL = ("*", "&", "!", "<<", "\r", "\t", "\x85", "\u2028", "\u2029")
_DEEP_BLOCK = re.compile(r"\n[ ?:-]{20}")
_FLAT_COLLECTION = re.compile(r"""\[[^][{}"'#\n]*\]|\{[^][{}"'#\n]*\}""")


def _is_evidently_flat(text: str) -> bool:
    """Return whether a text certainly has no aliases, tags, merges or deep nesting.

    Each bracket is closed before anything that could hide its end, so none is inside another.
    Blocks begin after indentation and indicators, so they are nested twice per column at most. The
    check takes a fiftieth of the time of parsing; frames usually pass it.
    """
    if any(part in text for part in _UNUSUAL) or _DEEP_BLOCK.search(f"\n{text}"):
        return False
    rest = _FLAT_COLLECTION.sub("", text)
    return "[" not in rest and "{" not in rest


@dataclass
class _Nesting:
    """An open collection, or the document: its name if others may repeat it, and extent."""

    anchor: str | None = None
    values: int = 0
    height: int = 0


@dataclass
class _EventCounter:
    """Counts values and levels as if aliases were written out."""

    open: list[_Nesting] = field(default_factory=lambda: [_Nesting()])
    anchors: dict[str, _Nesting] = field(default_factory=dict[str, _Nesting])

    def add(self, event: Any) -> tuple[str, str] | None:
        """Count an event; return message and hint if a limit is exceeded."""
        if getattr(event, "tag", None):
            tag = event.tag.removeprefix("tag:yaml.org,2002:")
            return f"the tag {tag} is not supported", "write the plain value"
        if isinstance(event, yaml.CollectionStartEvent):
            self.open.append(_Nesting(event.anchor))
        elif isinstance(event, yaml.CollectionEndEvent):
            closed = self.open.pop()
            self._add_value(closed.anchor, closed.values + 1, closed.height + 1)
        elif isinstance(event, yaml.ScalarEvent):
            if event.value == "<<" and event.implicit[0]:
                return "merge keys (<<) are not supported", "write the values out, or `extends:`"
            self._add_value(event.anchor, 1, 0)
        elif isinstance(event, yaml.AliasEvent):
            if event.anchor not in self.anchors:
                return "unknown anchor, or one inside itself", "write the values out"
            known = self.anchors[event.anchor]
            self._add_value(None, known.values, known.height)
        return self._check_limits()

    def _add_value(self, anchor: str | None, values: int, height: int) -> None:
        self.open[-1].values += values
        self.open[-1].height = max(self.open[-1].height, height)
        if anchor:
            self.anchors[anchor] = _Nesting(None, values, height)

    def _check_limits(self) -> tuple[str, str] | None:
        if len(self.open) - 1 + self.open[-1].height > MAX_DEPTH:
            return f"is nested deeper than {MAX_DEPTH} levels", "is a bracket not closed?"
        if self.open[-1].values > MAX_VALUES:
            message = f"holds more than {MAX_VALUES} values, with its aliases (*) written out"
            return message, "no such file is that long"
        return None


def _check_events(path: Path, text: str, hint: str = "") -> None:
    """Raise on tags and exceeded limits, before the parser builds a tree by recursion."""
    counter = _EventCounter()
    for event in _iterate_events(text):
        found = counter.add(event)
        if found:
            position = SourcePosition(event.start_mark.line + 1, event.start_mark.column + 1)
            raise DiagnosticsError(
                build_text_diagnostic(path, text, position, found[0], hint=hint or found[1])
            )


def _iterate_events(text: str) -> Iterator[Any]:
    # PyYAML's type stubs do not know the events' attributes.
    yield from yaml.parse(text, Loader=yaml.CSafeLoader)


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


@contextmanager
def _report_yaml_errors(path: Path, text: str, hint: str = "") -> Generator[None]:
    try:
        yield
    except yaml.MarkedYAMLError as error:
        raise DiagnosticsError(_build_syntax_diagnostic(path, text, error, hint)) from None
    except yaml.YAMLError:
        # libyaml reports unreadable characters without a position.
        position = next(_find_control_characters(text), SourcePosition(1, 1))
        message, own_hint = "unexpected control character", "remove it; is this a text file?"
        raise DiagnosticsError(
            build_text_diagnostic(path, text, position, message, hint=hint or own_hint)
        ) from None


def _build_syntax_diagnostic(
    path: Path, text: str, error: yaml.MarkedYAMLError, hint: str
) -> Diagnostic:
    mark = error.problem_mark or error.context_mark
    position = SourcePosition(mark.line + 1, mark.column + 1) if mark else SourcePosition(1, 1)
    problem = error.problem or "cannot be parsed"
    message, own_hint = _YAML_MESSAGES.get(problem, (problem, ""))
    lines = split_lines(text)
    if position.line <= len(lines) and "\t" in lines[position.line - 1][: position.column]:
        message, own_hint = _TAB_MESSAGE
    elif error.context_mark and "not closed" in message:
        # The parser notices a missing bracket lines later; the author needs the opening one.
        position = SourcePosition(error.context_mark.line + 1, error.context_mark.column + 1)
    elif position.line > len(lines) and lines:
        # At the end of the file the parser names the line after the last.
        position = SourcePosition(len(lines), len(lines[-1]) + 1)
    message = f"not valid YAML: {message}"
    return build_text_diagnostic(path, text, position, message, hint=hint or own_hint)


def _find_control_characters(text: str) -> Iterator[SourcePosition]:
    for number, line in enumerate(split_lines(text), start=1):
        for column, character in enumerate(line, start=1):
            if not character.isprintable() and character != "\t":
                yield SourcePosition(number, column)
