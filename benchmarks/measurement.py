"""The common form of what benchmarks find: figures against a peer or a limit.

Each benchmark has `figures(quick=...)`; `python benchmarks/bench.py` runs them all. A figure that
misses its goal is told in the table; it is a finding, not a failure, so the exit code says nothing
of it: exit code 1 is for a benchmark that broke.
"""

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Figure:
    """A median of several rounds.

    Attributes:
        what: Is measured.
        value: Usually a ratio, which holds on any machine and under any load.
        against: The peer that a ratio is to, or the unit.
        at_most: What is wanted of it.
        at_least: What is wanted of it.
    """

    what: str
    value: float
    against: str
    at_most: float | None = None
    at_least: float | None = None

    @property
    def holds(self) -> bool:
        """Whether it is as wanted, if anything is."""
        low, high = self.at_least, self.at_most
        return (low is None or self.value >= low) and (high is None or self.value <= high)

    @property
    def wanted(self) -> str:
        """The limits in words."""
        limits = ("at least", self.at_least), ("at most", self.at_most)
        return ", ".join(f"{word} {limit:g}" for word, limit in limits if limit is not None)


def table(figures: Iterable[Figure]) -> str:
    """A row of Markdown for each figure."""
    rows = ["| what | figure | against | wanted | |", "|---|---|---|---|---|"]
    for one in figures:
        verdict = ("holds" if one.holds else "MISSED") if one.wanted else ""
        rows.append(f"| {one.what} | {one.value:.3g} | {one.against} | {one.wanted} | {verdict} |")
    return "\n".join(rows)
