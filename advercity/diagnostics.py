"""Diagnostics of files: place, message, hint and an excerpt of the line."""

import unicodedata
from dataclasses import dataclass
from pathlib import Path

from advercity.errors import InputError

MAX_EXCERPT_CHARACTERS = 100
"""Longest shown part of a line."""
MAX_LISTED = 100
"""Most listed errors; one mistake in a generated file may be thousands of errors."""


@dataclass(frozen=True)
class Diagnostic:
    """One error in a file; line 0 means the file as a whole.

    Attributes:
        path: The file.
        line: Counted from 1.
        column: Counted from 1.
        value_path: Dotted path of the value, `fog.mor_m`.
        message: The error.
        hint: How to correct it.
        line_text: The line of the file.
        width: Number of characters to underline.
        origin: The same error in the file of the value, if this one inherits it.
    """

    path: Path
    line: int
    column: int
    value_path: str
    message: str
    hint: str = ""
    line_text: str = ""
    width: int = 1
    origin: "Diagnostic | None" = None

    @property
    def place(self) -> str:
        """`file:line:column`, or the file as a whole."""
        return f"{self.path}:{self.line}:{self.column}" if self.line else f"{self.path}"

    @property
    def headline(self) -> str:
        """`file:line:column: fog.mor_m: message; hint`."""
        value = f" {self.value_path}:" if self.value_path else ""
        hint = f"; {self.hint}" if self.hint else ""
        origin = f" (inherited from {self.origin.place})" if self.origin else ""
        return f"{self.place}:{value} {self.message}{hint}{origin}"

    @property
    def lines(self) -> tuple[str, ...]:
        """The headline and, indented below it, the line with carets under the value."""
        if not self.line_text.strip():
            return (self.headline,)
        number = f"{self.line:>5}"
        excerpt, carets = self._format_excerpt()
        return self.headline, f"{number} | {excerpt}", f"{' ' * len(number)} | {carets}"

    def _format_excerpt(self) -> tuple[str, str]:
        """Return the part of the line around the value, and the carets below it."""
        is_long = len(self.line_text) > MAX_EXCERPT_CHARACTERS
        begin = max(0, self.column - 1 - MAX_EXCERPT_CHARACTERS // 2) if is_long else 0
        end = begin + MAX_EXCERPT_CHARACTERS
        # Tabs and control characters would shift the carets or change the terminal's state.
        excerpt = "".join(
            character if character.isprintable() else " " for character in self.line_text[begin:end]
        ).rstrip()
        before = excerpt[: self.column - 1 - begin]
        width = max(1, min(self.width, len(excerpt) - len(before)))
        prefix = "..." if begin else ""
        suffix = "..." if end < len(self.line_text) else ""
        indent = " " * _count_terminal_columns(prefix + before)
        return prefix + excerpt + suffix, indent + "^" * width


def _count_terminal_columns(text: str) -> int:
    """Return the width of `text` in a terminal, where wide characters take two columns."""
    return sum(2 if unicodedata.east_asian_width(character) in "WF" else 1 for character in text)


class DiagnosticsError(InputError):
    """All errors found in some files, without duplicates, in the order of the files.

    An error in a file is not listed again for its heirs.
    """

    def __init__(self, *diagnostics: Diagnostic) -> None:
        unique = [item for item in dict.fromkeys(diagnostics) if item.origin not in diagnostics]
        self.diagnostics = tuple(sorted(unique, key=lambda d: (str(d.path), d.line, d.column)))
        lines = [line for item in self.diagnostics[:MAX_LISTED] for line in item.lines]
        if len(self.diagnostics) > MAX_LISTED:
            lines.append(f"... and {len(self.diagnostics) - MAX_LISTED} more errors")
        super().__init__(*lines)

    def __reduce__(self) -> tuple[type["DiagnosticsError"], tuple[Diagnostic, ...]]:
        """Pickle it, to report it from one process to another."""
        return DiagnosticsError, self.diagnostics
