"""What is wrong with what people wrote, each with its place, its line and a way out."""

import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from advercity_dsl.base import suggest_name

from advercity.errors import InputError

MAX_EXCERPT_CHARACTERS = 100
"""Characters of a line that are shown."""


@dataclass(frozen=True)
class Diagnostic:
    """One thing that is wrong, and where; line 0 means the file as a whole."""

    path: Path
    line: int
    column: int
    value_path: str
    """Dotted path of the value, `fog.mor_m`."""
    message: str
    hint: str = ""
    line_text: str = ""
    """The line that it stands in."""
    width: int = 1
    """Characters of that line that it is about."""

    @property
    def headline(self) -> str:
        """`file:line:column: fog.mor_m: what is wrong; way out`."""
        place = f"{self.path}:{self.line}:{self.column}" if self.line else f"{self.path}"
        middle = f" {self.value_path}:" if self.value_path else ""
        return f"{place}:{middle} {self.message}" + (f"; {self.hint}" if self.hint else "")

    def __str__(self) -> str:
        """The headline and, below it and indented, the line with carets under what is meant."""
        if not self.line_text.strip():
            return self.headline
        number = f"{self.line:>5}"
        shown, caret = self._excerpt()
        return f"{self.headline}\n{number} | {shown}\n{' ' * len(number)} | {caret}"

    def _excerpt(self) -> tuple[str, str]:
        """The part of the line around the problem, and the carets."""
        begin = (
            max(0, self.column - 1 - MAX_EXCERPT_CHARACTERS // 2)
            if len(self.line_text) > MAX_EXCERPT_CHARACTERS
            else 0
        )
        shown = "".join(
            character if character.isprintable() else " "
            for character in self.line_text[begin : begin + MAX_EXCERPT_CHARACTERS]
        ).rstrip()
        before = shown[: self.column - 1 - begin]
        width = max(1, min(self.width, len(shown) - len(before)))
        at_begin = "..." if begin else ""
        at_end = "..." if begin + MAX_EXCERPT_CHARACTERS < len(self.line_text) else ""
        return at_begin + shown + at_end, " " * _count_terminal_columns(
            at_begin + before
        ) + "^" * width


def _count_terminal_columns(text: str) -> int:
    """Columns that a terminal gives to `text`."""
    return sum(2 if unicodedata.east_asian_width(character) in "WF" else 1 for character in text)


class DiagnosticsError(InputError):
    """Everything that is wrong with some files, in the order of the files."""

    def __init__(self, problems: Sequence[Diagnostic]) -> None:
        unique = dict.fromkeys(problems)
        self.diagnostics = tuple(sorted(unique, key=lambda p: (str(p.path), p.line, p.column)))
        super().__init__("\n".join(str(problem) for problem in self.diagnostics))

    @classmethod
    def from_diagnostic(cls, problem: Diagnostic) -> "DiagnosticsError":
        """An error with one problem."""
        return cls([problem])


__all__ = ["Diagnostic", "DiagnosticsError", "suggest_name"]
