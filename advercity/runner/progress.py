"""What those who run scenarios tell those who watch."""

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Progress:
    """How far a scenario is.

    Attributes:
        scenario: Its id.
        stage: What is being done, in a word or two; `done` at the end.
        done: Frames that are finished.
        total: Frames in all; 0 as long as nobody knows.
        size_bytes: Of the scenario's files so far.
    """

    scenario: str
    stage: str
    done: int = 0
    total: int = 0
    size_bytes: int = 0


Report = Callable[[Progress], None]
"""Called again and again while a scenario is being made."""


def no_report(progress: Progress) -> None:
    """Keeps progress to itself."""
