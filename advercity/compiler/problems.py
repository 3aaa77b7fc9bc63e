"""What is wrong with what people wrote, each with its place, its line and a way out."""

import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from advercity_dsl.names import nearest

from advercity.errors import InputError

EXCERPT = 100
"""Characters of a line that are shown."""


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong, and where; line 0 means the file as a whole."""

    path: Path
    line: int
    column: int
    where: str
    """Dotted path of the value, `fog.mor_m`."""
    message: str
    hint: str = ""
    text: str = ""
    """The line that it stands in."""
    width: int = 1
    """Characters of that line that it is about."""

    @property
    def headline(self) -> str:
        """`file:line:column: fog.mor_m: what is wrong; way out`."""
        place = f"{self.path}:{self.line}:{self.column}" if self.line else f"{self.path}"
        middle = f" {self.where}:" if self.where else ""
        return f"{place}:{middle} {self.message}" + (f"; {self.hint}" if self.hint else "")

    def __str__(self) -> str:
        """The headline and, below it and indented, the line with carets under what is meant."""
        if not self.text.strip():
            return self.headline
        number = f"{self.line:>5}"
        shown, caret = self._excerpt()
        return f"{self.headline}\n{number} | {shown}\n{' ' * len(number)} | {caret}"

    def _excerpt(self) -> tuple[str, str]:
        """The part of the line around the problem, and the carets."""
        begin = max(0, self.column - 1 - EXCERPT // 2) if len(self.text) > EXCERPT else 0
        shown = "".join(
            character if character.isprintable() else " "
            for character in self.text[begin : begin + EXCERPT]
        ).rstrip()
        before = shown[: self.column - 1 - begin]
        width = max(1, min(self.width, len(shown) - len(before)))
        at_begin = "..." if begin else ""
        at_end = "..." if begin + EXCERPT < len(self.text) else ""
        return at_begin + shown + at_end, " " * _cells(at_begin + before) + "^" * width


def _cells(text: str) -> int:
    """Columns that a terminal gives to `text`."""
    return sum(2 if unicodedata.east_asian_width(character) in "WF" else 1 for character in text)


class ProblemsError(InputError):
    """Everything that is wrong with some files, in the order of the files."""

    def __init__(self, problems: Sequence[Problem]) -> None:
        unique = dict.fromkeys(problems)
        self.problems = tuple(sorted(unique, key=lambda p: (str(p.path), p.line, p.column)))
        super().__init__("\n".join(str(problem) for problem in self.problems))

    @classmethod
    def of(cls, problem: Problem) -> "ProblemsError":
        """An error with one problem."""
        return cls([problem])


__all__ = ["Problem", "ProblemsError", "nearest"]
