"""What is wrong with what people wrote, each with its place and a way out."""

import difflib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from advercity.errors import InputError


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

    def __str__(self) -> str:
        """`file:line:column: fog.mor_m: what is wrong; way out`."""
        place = f"{self.path}:{self.line}:{self.column}" if self.line else f"{self.path}"
        middle = f" {self.where}:" if self.where else ""
        return f"{place}:{middle} {self.message}" + (f"; {self.hint}" if self.hint else "")


class ProblemsError(InputError):
    """Everything that is wrong with some files, in the order of the files."""

    def __init__(self, problems: Sequence[Problem]) -> None:
        self.problems = tuple(sorted(problems, key=lambda p: (str(p.path), p.line, p.column)))
        super().__init__("\n".join(str(problem) for problem in self.problems))

    @classmethod
    def of(cls, problem: Problem) -> "ProblemsError":
        """An error with one problem."""
        return cls([problem])


def nearest(name: str, valid: Iterable[str]) -> str:
    """A hint that names the nearest valid name, else all of them."""
    names = sorted(valid)
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    if close:
        return f"did you mean '{close[0]}'?"
    return f"there are: {', '.join(names[:12])}" if names else "there are none"
