"""Progress and results of scenarios, and their listeners."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Protocol

from advercity.errors import AdvercityError, RunError


@dataclass(frozen=True)
class Progress:
    """Progress of a scenario.

    Attributes:
        scenario: Id of its spec.
        phase: Current step, in a word or two; `done` at the end.
        done: Finished frames.
        total: Requested frames; 0 until the traffic is known.
        size_bytes: Files of the scenario so far.
        address: Address of the live view, if there is one.
    """

    scenario: str
    phase: str
    done: int = 0
    total: int = 0
    size_bytes: int = 0
    address: str | None = None


PREPARATION = {
    "traffic": "simulate the traffic, or load it",
    "world": "build the world and its bodies, or load them",
    "renderer": "open the renderer",
}
"""Steps before the first frame, by phase, in their order."""
ProgressCallback = Callable[[Progress], None]
"""Called repeatedly while a scenario is being made."""


def ignore_progress(progress: Progress) -> None:
    """Discard progress."""


@dataclass(frozen=True)
class ScenarioResult:
    """Result of a scenario.

    Attributes:
        scenario: Id of its spec.
        error: Why it failed; None if it succeeded.
        frames: Requested frames in the dataset.
        size_bytes: Files of the scenario.
        time_s: Wall-clock time.
        peak_memory_bytes: Largest resident memory of its processes at one time.
        worker_count: Workers of the scenario.
        setup_s: Wall-clock time before the first frame, without the traffic simulation.
        frame_s: Wall-clock time per frame of a worker; None if none made two.
    """

    scenario: str
    error: AdvercityError | None
    frames: int
    size_bytes: int
    time_s: float
    peak_memory_bytes: int
    worker_count: int = 1
    setup_s: float = 0.0
    frame_s: float | None = None


class RunListener(Protocol):
    """Receives progress and results of a run."""

    def on_progress(self, progress: Progress) -> None:
        """Handle the progress of a scenario."""
        ...

    def on_result(self, result: ScenarioResult) -> None:
        """Handle the end of a scenario."""
        ...


class SilentListener:
    """Discards progress and results."""

    def on_progress(self, progress: Progress) -> None:
        """Discard it."""

    def on_result(self, result: ScenarioResult) -> None:
        """Discard it."""


def raise_failures(results: Iterable[ScenarioResult]) -> None:
    """Raise the error of a single scenario, or one error listing those of several.

    Raises:
        AdvercityError: The only scenario failed.
        RunError: Some of several failed; the text says which and why.
    """
    every = list(results)
    failed = [(item.scenario, item.error) for item in every if item.error is not None]
    if len(every) == 1 and failed:
        raise failed[0][1]
    if failed:
        lines = [line for name, error in failed for line in f"{name}: {error}".splitlines()]
        raise RunError(*lines, f"{len(failed)} of {len(every)} scenarios failed")
