"""Shows progress: bars at a terminal, a line per scenario in a pipe."""

import sys
import time
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from threading import Lock

from advercity_dsl import Spec
from rich import progress as rich_progress

from advercity.cli.output import end_status, format_options, print_remark, stderr_console
from advercity.pipeline import Progress, ScenarioResult
from advercity.pipeline.progress import PREPARATION
from advercity.run_options import format_byte_size, format_duration


class ProgressView:
    """Shows a bar over all scenarios and one per running scenario.

    Of several scenarios, it also prints a line for each at its end.
    """

    def __init__(
        self, specs: Sequence[Spec], bars: rich_progress.Progress, *, things: str, page: str | None
    ) -> None:
        self._bars, self._things, self._page = bars, things, page
        self._has_shown_address = False
        self._told: set[str] = set()
        self._many = len(specs) > 1
        self._known = {spec.id: Progress(spec.id, "waiting") for spec in specs}
        self._over: dict[str, ScenarioResult | None] = {}
        self._began_s = time.monotonic()
        self._lock = Lock()
        self._tasks: dict[str, rich_progress.TaskID] = {}
        self._all = bars.add_task("", total=None) if self._many else None
        if not self._many:
            self._show(*self._known.values())

    def on_progress(self, progress: Progress) -> None:
        """Show the progress of a scenario."""
        with self._lock:
            self._known[progress.scenario] = progress
            self._show(progress)
            self._tell_step(progress)
            if progress.address is not None and not self._has_shown_address:
                self._show_address(progress.address)
            if progress.phase == "done":
                self._over.setdefault(progress.scenario, None)
                self._remove(progress.scenario)
            self._update_total()

    def on_result(self, result: ScenarioResult) -> None:
        """Show the result of a scenario."""
        with self._lock:
            self._over[result.scenario] = result
            self._remove(result.scenario)
            self._update_total()
            if self._many:
                stderr_console.print(self._format_result(result), markup=False)

    def _tell_step(self, progress: Progress) -> None:
        """Print each step of preparation once: the first scenario takes longest."""
        if progress.phase in PREPARATION and progress.phase not in self._told:
            self._told.add(progress.phase)
            print_remark(f"{progress.scenario}: {PREPARATION[progress.phase]}")

    def _show_address(self, address: str) -> None:
        self._has_shown_address = True
        print_remark(f"live view at {address}; open it with: advercity view {address}")
        if self._page is not None:
            print_remark(f"in a browser: {self._page}")

    def _show(self, progress: Progress) -> None:
        name = progress.scenario
        if name not in self._tasks:
            self._tasks[name] = self._bars.add_task(name, total=None)
        self._bars.update(
            self._tasks[name],
            description=f"{name} ({progress.phase})",
            completed=progress.done,
            total=progress.total or None,
        )

    def _remove(self, scenario: str) -> None:
        if self._many and scenario in self._tasks:
            self._bars.remove_task(self._tasks.pop(scenario))

    def _update_total(self) -> None:
        if self._all is None:
            return
        done, total = self._count_frames()
        left = "" if self._remaining_s is None else f", {format_duration(self._remaining_s)} left"
        size = format_byte_size(sum(item.size_bytes for item in self._known.values()))
        text = f"{len(self._over)} of {len(self._known)} scenarios, {size}{left}"
        self._bars.update(self._all, description=text, completed=done, total=total or None)

    def _count_frames(self) -> tuple[int, int]:
        """Count frames done and in all; a scenario not yet begun counts like the mean of others."""
        totals = [item.total for item in self._known.values() if item.total]
        unknown = len(self._known) - len(totals)
        total = sum(totals) + round(unknown * sum(totals) / max(1, len(totals)))
        return sum(item.done for item in self._known.values()), total

    @property
    def _remaining_s(self) -> float | None:
        done, total = self._count_frames()
        if not done:
            return None
        return (time.monotonic() - self._began_s) * (total - done) / done

    def _format_result(self, result: ScenarioResult) -> str:
        place = f"{len(self._over)}/{len(self._known)} {result.scenario}"
        if result.error is not None:
            return f"{place}: failed: {format_options(str(result.error))}"
        left = "" if self._remaining_s is None else f"; {format_duration(self._remaining_s)} left"
        return (
            f"{place}: {result.frames} {self._things}, {format_byte_size(result.size_bytes)} in"
            f" {format_duration(result.time_s)}, {format_byte_size(result.peak_memory_bytes)} of"
            f" memory{left}"
        )


@contextmanager
def show_progress(
    specs: Sequence[Spec], *, things: str = "frames", page: str | None = None
) -> Generator[ProgressView]:
    """Show progress of scenarios on stderr.

    Args:
        specs: The scenarios.
        things: Noun for the counted items.
        page: Address at which browsers find the live view.
    """
    end_status()
    columns = (
        rich_progress.TextColumn("{task.description}"),
        rich_progress.BarColumn(),
        rich_progress.MofNCompleteColumn(),
        rich_progress.TextColumn(things),
        rich_progress.TimeElapsedColumn(),
    )
    with rich_progress.Progress(
        *columns, console=stderr_console, disable=not sys.stderr.isatty()
    ) as bars:
        yield ProgressView(specs, bars, things=things, page=page)
