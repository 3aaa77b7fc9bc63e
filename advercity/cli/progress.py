"""Progress of runs: one view over all scenarios for people, a line per scenario for pipes."""

import sys
import time
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from threading import Lock

from advercity_dsl import Spec
from rich import progress as rich_progress

from advercity.cli.output import errors
from advercity.runner import Outcome, Progress
from advercity.runner.limits import size_in_words, time_in_words


class View:
    """What is known of all scenarios, and how it is shown.

    A bar over all and one for each that is being made; where nobody watches, and there are several
    scenarios, a line for each that ends.
    """

    def __init__(self, specs: Sequence[Spec], bars: rich_progress.Progress, *, things: str) -> None:
        self._bars, self._things = bars, things
        self._many = len(specs) > 1
        self._known = {spec.id: Progress(spec.id, "waiting") for spec in specs}
        self._over: dict[str, Outcome | None] = {}
        self._began_s = time.monotonic()
        self._lock = Lock()
        self._tasks: dict[str, rich_progress.TaskID] = {}
        self._all = bars.add_task("", total=None) if self._many else None

    def advanced(self, progress: Progress) -> None:
        """Show how far a scenario is."""
        with self._lock:
            self._known[progress.scenario] = progress
            self._show(progress)
            if progress.stage == "done":
                self._over.setdefault(progress.scenario, None)
                self._remove(progress.scenario)
            self._sum_up()

    def finished(self, outcome: Outcome) -> None:
        """Show how a scenario ended."""
        with self._lock:
            self._over[outcome.scenario] = outcome
            self._remove(outcome.scenario)
            self._sum_up()
            if self._many:
                errors.print(self._line(outcome), markup=False)

    def _show(self, progress: Progress) -> None:
        name = progress.scenario
        if name not in self._tasks:
            self._tasks[name] = self._bars.add_task(name, total=None)
        self._bars.update(
            self._tasks[name],
            description=f"{name} ({progress.stage})",
            completed=progress.done,
            total=progress.total or None,
        )

    def _remove(self, scenario: str) -> None:
        if self._many and scenario in self._tasks:
            self._bars.remove_task(self._tasks.pop(scenario))

    def _sum_up(self) -> None:
        if self._all is None:
            return
        done, total = self._steps()
        left = "" if self._left_s is None else f", {time_in_words(self._left_s)} left"
        size = size_in_words(sum(item.size_bytes for item in self._known.values()))
        text = f"{len(self._over)} of {len(self._known)} scenarios, {size}{left}"
        self._bars.update(self._all, description=text, completed=done, total=total or None)

    def _steps(self) -> tuple[int, int]:
        """Frames done and in all; a scenario that nobody knows of is like the others."""
        totals = [item.total for item in self._known.values() if item.total]
        unknown = len(self._known) - len(totals)
        total = sum(totals) + round(unknown * sum(totals) / max(1, len(totals)))
        return sum(item.done for item in self._known.values()), total

    @property
    def _left_s(self) -> float | None:
        done, total = self._steps()
        if not done:
            return None
        return (time.monotonic() - self._began_s) * (total - done) / done

    def _line(self, outcome: Outcome) -> str:
        place = f"{len(self._over)}/{len(self._known)} {outcome.scenario}"
        if outcome.error is not None:
            return f"{place}: failed: {outcome.error}"
        left = "" if self._left_s is None else f"; {time_in_words(self._left_s)} left"
        return (
            f"{place}: {outcome.frames} {self._things}, {size_in_words(outcome.size_bytes)} in"
            f" {time_in_words(outcome.time_s)}, {size_in_words(outcome.peak_memory_bytes)} of"
            f" memory{left}"
        )


@contextmanager
def progress(specs: Sequence[Spec], *, things: str = "frames") -> Generator[View]:
    """A view of scenarios on stderr; `things` is what is counted in them."""
    columns = (
        rich_progress.TextColumn("{task.description}"),
        rich_progress.BarColumn(),
        rich_progress.MofNCompleteColumn(),
        rich_progress.TextColumn(things),
        rich_progress.TimeElapsedColumn(),
    )
    with rich_progress.Progress(*columns, console=errors, disable=not sys.stderr.isatty()) as bars:
        yield View(specs, bars, things=things)
