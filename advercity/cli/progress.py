"""Progress of a run: a bar with the time left for people, nothing for pipes."""

import sys
from collections.abc import Generator, Sequence
from contextlib import contextmanager

from advercity_dsl import Spec
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from advercity.cli.output import errors
from advercity.runner import Report


@contextmanager
def progress(specs: Sequence[Spec]) -> Generator[Report, None, None]:
    """A report function that draws one bar per scenario on stderr; silent when piped."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=errors, disable=not sys.stderr.isatty()) as bars:
        tasks = {spec.id: bars.add_task(f"{spec.id} (waiting)", total=None) for spec in specs}

        def report(scenario: str, stage: str, done: int, total: int) -> None:
            bars.update(
                tasks[scenario],
                description=f"{scenario} ({stage})",
                completed=done,
                total=total or None,
            )

        yield report
