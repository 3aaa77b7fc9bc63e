"""What runs will take, before anything is made; and a refusal of what is larger than anyone means.

Rates are this machine's (`calibration`), work is the spec's (`workload`), and how many frames there
are is known from the traffic, or at most what the spec's timing allows.
"""

import math
import shutil
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from advercity_dsl import Spec

from advercity.dataset.manifest import Manifest
from advercity.errors import AdvercityError, InputError
from advercity.runner.batch import shared_out
from advercity.runner.cache import traffic_key
from advercity.runner.calibration import Rates, profile_asked_for, rates_here
from advercity.runner.gpus import visible_gpus
from advercity.runner.limits import Limits, size_in_words, time_in_words
from advercity.runner.machine import cores, free_memory_bytes, memory_bytes
from advercity.runner.options import Options
from advercity.runner.stage import kept_trace, set_stage
from advercity.runner.workload import Workload

LARGEST_BYTES = 10**12
LONGEST_S = 30 * 86_400
SHARE_OF_DISK = 0.9
SHARE_OF_MEMORY = 0.9
SHARE_OF_FREE_MEMORY = 0.5
FRAMES_PER_PROCESS = 16
"""A process more pays from so many on: starting takes it as long as some frames."""
ACTOR_TICKS = 20_000_000
"""Traffic of more than this is not simulated for a plan: it would take long itself."""


@dataclass(frozen=True)
class Forecast:
    """What a scenario will take, frames that are done left out.

    Attributes:
        scenario: Its id.
        frames: To make.
        is_exact: Whether that is known, or at most so many.
        pictures: Of all cameras, in all those frames.
        size_bytes: Of all files to write.
        time_s: Alone on this machine.
        memory_bytes: At its most.
    """

    scenario: str
    frames: int
    is_exact: bool
    pictures: int
    size_bytes: int
    time_s: float
    memory_bytes: int

    def told(self) -> dict[str, str | int]:
        """A row of a table, by its heads."""
        return {
            "scenario": self.scenario,
            "frames": f"{'' if self.is_exact else 'at most '}{self.frames}",
            "pictures": self.pictures,
            "size": size_in_words(self.size_bytes),
            "time": time_in_words(self.time_s),
            "memory": size_in_words(self.memory_bytes),
        }


@dataclass(frozen=True)
class Plan:
    """What runs will take together.

    Attributes:
        forecasts: One for each.
        jobs: Processes at a time.
        rates: That it is reckoned with.
    """

    forecasts: tuple[Forecast, ...]
    jobs: int
    rates: Rates

    @property
    def total(self) -> Forecast:
        """All of them together."""
        share = max(1 / self.jobs, self.rates.busy_cores / cores())
        largest = sorted(self.forecasts, key=lambda item: item.memory_bytes, reverse=True)
        places = sorted(map(len, shared_out(self.jobs, len(largest))), reverse=True)
        memory_bytes = sum(
            item.memory_bytes * min(count, max(1, item.frames))
            for item, count in zip(largest, places, strict=False)
        )
        scenarios = "1 scenario" if len(largest) == 1 else f"{len(largest)} scenarios"
        at_a_time = "1 process" if self.jobs == 1 else f"{self.jobs} processes"
        return Forecast(
            scenario=f"{scenarios}, {at_a_time}",
            frames=sum(item.frames for item in self.forecasts),
            is_exact=all(item.is_exact for item in self.forecasts),
            pictures=sum(item.pictures for item in self.forecasts),
            size_bytes=sum(item.size_bytes for item in self.forecasts),
            time_s=min(1.0, share) * sum(item.time_s for item in self.forecasts),
            memory_bytes=memory_bytes,
        )

    @property
    def limits(self) -> Limits:
        """Beyond which something is wrong with a scenario, on a machine that is busy."""
        memory_bytes = max(item.memory_bytes for item in self.forecasts)
        time_s = max(item.time_s for item in self.forecasts)
        return Limits(memory_bytes=max(4 * 10**9, 3 * memory_bytes), time_s=3600 + 20 * time_s)

    def complaints(self, output: Path | None) -> list[str]:
        """What of it is larger than anyone means who does not say so; none if all is well.

        Args:
            output: Folder on this machine; None if others do the work.
        """
        total, found = self.total, list[str]()
        free = math.inf if output is None else shutil.disk_usage(_nearest_folder(output)).free
        most = min(LARGEST_BYTES, SHARE_OF_DISK * free)
        if total.size_bytes > most:
            there = "" if output is None else f" ({size_in_words(free)} are free at {output})"
            found.append(
                f"about {size_in_words(total.size_bytes)} of files, more than"
                f" {size_in_words(most)}{there}"
            )
        if output is None:
            return found
        if total.time_s > LONGEST_S:
            found.append(f"about {total.time_s / 86_400:.0f} days, more than 30")
        memory = SHARE_OF_MEMORY * memory_bytes()
        if total.memory_bytes > memory:
            found.append(
                f"about {size_in_words(total.memory_bytes)} of memory, more than"
                f" {size_in_words(memory)} of this machine's"
            )
        return found


@dataclass(frozen=True)
class Permit:
    """What runs may begin with: so many processes at a time, within limits."""

    jobs: int
    limits: Limits


def plan_of(
    specs: Sequence[Spec], options: Options, *, jobs: int | None, measure: bool, simulate: bool
) -> Plan:
    """What running specs will take.

    Args:
        specs: What to run.
        options: How; frames that are already in the output are left out.
        jobs: Processes at a time; None is as many as suit the machine.
        measure: Calibrate the machine if that has not been done.
        simulate: Simulate the traffic that is not known yet, unless there is very much of it.

    Raises:
        InputError: An option does not fit.
        RunError: Calibration or traffic fails.
    """
    rates = rates_here(options, measure=measure)
    if simulate:
        _simulate(specs, jobs or cores())
    scale = profile_asked_for(options).scale
    forecasts = tuple(_forecast(spec, options, rates, scale) for spec in specs)
    return Plan(forecasts, jobs or suitable_jobs(forecasts), rates)


def suitable_jobs(forecasts: Sequence[Forecast]) -> int:
    """Processes at a time that keep this machine busy and leave it half of its free memory.

    One for each graphics card. Without any, one for each core, since a renderer in software uses
    several at once for part of the time only; but one more for a scenario has to save more time
    than its start takes.
    """
    frames = sum(item.frames for item in forecasts)
    useful = max(len(forecasts), frames // FRAMES_PER_PROCESS)
    gpus = visible_gpus()
    if gpus:
        return min(len(gpus), useful)
    largest = max(item.memory_bytes for item in forecasts)
    fitting = int(SHARE_OF_FREE_MEMORY * free_memory_bytes() / largest)
    return max(1, min(cores(), useful, fitting))


def permitted(
    specs: Sequence[Spec],
    options: Options,
    *,
    asked: Limits,
    jobs: int | None,
    allow_large: bool,
    on_this_machine: bool,
) -> Permit:
    """What runs may begin with; limits and jobs that were not asked for are the plan's.

    Raises:
        InputError: They take more than declared limits; the text says what, and the ways out.
    """
    plan = plan_of(specs, options, jobs=jobs, measure=False, simulate=False)
    output = options.output if on_this_machine else None
    if not allow_large and plan.complaints(output) and not plan.total.is_exact:
        plan = plan_of(specs, options, jobs=jobs, measure=False, simulate=True)
    found = [] if allow_large else plan.complaints(output)
    if found:
        raise InputError(
            f"this would take {'; '.join(found)}: make less (--frames, --scale, fewer specs),"
            " choose another --output or fewer --jobs, or say --allow-large;"
            " `advercity plan` tells more"
        )
    limits = Limits(
        memory_bytes=asked.memory_bytes or plan.limits.memory_bytes,
        time_s=asked.time_s or plan.limits.time_s,
    )
    return Permit(plan.jobs, limits)


def _simulate(specs: Sequence[Spec], jobs: int) -> None:
    """Traffic that specs share is simulated once."""
    wanted = {traffic_key(spec): spec for spec in specs if _actor_ticks(spec) <= ACTOR_TICKS}
    with ThreadPoolExecutor(jobs) as pool:
        list(pool.map(set_stage, wanted.values()))


def _actor_ticks(spec: Spec) -> int:
    return (spec.demand.vehicles + spec.demand.walkers) * spec.timing.max_ticks


def _forecast(spec: Spec, options: Options, rates: Rates, scale: float) -> Forecast:
    work = Workload.of(spec, scale)
    trace = kept_trace(spec)
    length = spec.timing.max_ticks - spec.timing.warm_up_ticks if trace is None else len(trace)
    frames = len(set(options.frames.of(length)) - _done(spec, options))
    frame_bytes = (
        rates.bytes_per_beam * work.beams
        + rates.bytes_per_agent * work.agents
        + rates.picture_bytes(scale) * work.pixels
    )
    frame_s = rates.s_per_beam * work.beams + rates.s_per_pixel * work.pixels
    return Forecast(
        scenario=spec.id,
        frames=frames,
        is_exact=trace is not None,
        pictures=frames * work.pictures,
        size_bytes=round(frames * frame_bytes),
        time_s=(rates.setup_s if frames else 0.0) + frames * frame_s,
        memory_bytes=round(rates.memory_bytes + rates.memory_bytes_per_pixel * work.pixels),
    )


def _done(spec: Spec, options: Options) -> set[int]:
    """Frames that a run would find there."""
    if not options.fresh:
        with suppress(AdvercityError):  # the run itself says what is wrong there
            return set(Manifest.load(options.output / spec.id).frames)
    return set()


def _nearest_folder(path: Path) -> Path:
    """The folder itself, or the nearest above it that exists."""
    whole = path.resolve()
    return next(folder for folder in (whole, *whole.parents) if folder.exists())
