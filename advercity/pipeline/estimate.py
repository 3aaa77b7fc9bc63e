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
from advercity.pipeline.cache import compute_traffic_key
from advercity.pipeline.calibration import (
    MachineRates,
    Workload,
    load_or_measure_rates,
    resolve_requested_profile,
)
from advercity.pipeline.machine import (
    count_usable_cores,
    divide_slots,
    find_visible_gpus,
    free_memory_bytes,
    total_memory_bytes,
)
from advercity.pipeline.options import (
    ResourceLimits,
    RunOptions,
    RunResources,
    format_byte_size,
    format_duration,
)
from advercity.pipeline.preparation import load_cached_trace, load_or_simulate_traffic

MAX_TOTAL_BYTES = 10**12
MAX_TOTAL_S = 30 * 86_400
MAX_DISK_FRACTION = 0.9
MAX_MEMORY_FRACTION = 0.9
MAX_FREE_MEMORY_FRACTION = 0.5
MIN_FRAMES_PER_WORKER = 16
"""A process more pays from so many on: starting takes it as long as some frames."""
MAX_ACTOR_TICKS = 20_000_000
"""Traffic of more than this is not simulated for a plan: it would take long itself."""


@dataclass(frozen=True)
class ScenarioEstimate:
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

    def to_row(self) -> dict[str, str | int]:
        """A row of a table, by its heads."""
        return {
            "scenario": self.scenario,
            "frames": f"{'' if self.is_exact else 'at most '}{self.frames}",
            "pictures": self.pictures,
            "size": format_byte_size(self.size_bytes),
            "time": format_duration(self.time_s),
            "memory": format_byte_size(self.memory_bytes),
        }


@dataclass(frozen=True)
class RunEstimate:
    """What runs will take together.

    Attributes:
        estimates: One for each.
        jobs: Processes at a time.
        rates: That it is reckoned with.
    """

    estimates: tuple[ScenarioEstimate, ...]
    jobs: int
    rates: MachineRates

    @property
    def total(self) -> ScenarioEstimate:
        """All of them together."""
        share = max(1 / self.jobs, self.rates.busy_cores / count_usable_cores())
        largest = sorted(self.estimates, key=lambda item: item.memory_bytes, reverse=True)
        places = sorted(map(len, divide_slots(self.jobs, len(largest))), reverse=True)
        memory_bytes = sum(
            item.memory_bytes * min(count, max(1, item.frames))
            for item, count in zip(largest, places, strict=False)
        )
        scenarios = "1 scenario" if len(largest) == 1 else f"{len(largest)} scenarios"
        at_a_time = "1 process" if self.jobs == 1 else f"{self.jobs} processes"
        return ScenarioEstimate(
            scenario=f"{scenarios}, {at_a_time}",
            frames=sum(item.frames for item in self.estimates),
            is_exact=all(item.is_exact for item in self.estimates),
            pictures=sum(item.pictures for item in self.estimates),
            size_bytes=sum(item.size_bytes for item in self.estimates),
            time_s=min(1.0, share) * sum(item.time_s for item in self.estimates),
            memory_bytes=memory_bytes,
        )

    @property
    def limits(self) -> ResourceLimits:
        """Beyond which something is wrong with a scenario, on a machine that is busy."""
        memory_bytes = max(item.memory_bytes for item in self.estimates)
        time_s = max(item.time_s for item in self.estimates)
        return ResourceLimits(
            memory_bytes=max(4 * 10**9, 3 * memory_bytes), time_s=3600 + 20 * time_s
        )

    def describe_excess(self, output: Path | None) -> list[str]:
        """What of it is larger than anyone means who does not say so; none if all is well.

        Args:
            output: Folder on this machine; None if others do the work.
        """
        total, found = self.total, list[str]()
        free = math.inf if output is None else shutil.disk_usage(_find_existing_parent(output)).free
        most = min(MAX_TOTAL_BYTES, MAX_DISK_FRACTION * free)
        if total.size_bytes > most:
            there = "" if output is None else f" ({format_byte_size(free)} are free at {output})"
            found.append(
                f"about {format_byte_size(total.size_bytes)} of files, more than"
                f" {format_byte_size(most)}{there}"
            )
        if output is None:
            return found
        if total.time_s > MAX_TOTAL_S:
            found.append(f"about {total.time_s / 86_400:.0f} days, more than 30")
        memory = MAX_MEMORY_FRACTION * total_memory_bytes()
        if total.memory_bytes > memory:
            found.append(
                f"about {format_byte_size(total.memory_bytes)} of memory, more than"
                f" {format_byte_size(memory)} of this machine's"
            )
        return found


def estimate_run(
    specs: Sequence[Spec], options: RunOptions, *, jobs: int | None, measure: bool, simulate: bool
) -> RunEstimate:
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
    rates = load_or_measure_rates(options, measure=measure)
    if simulate:
        _simulate_missing_traffic(specs, jobs or count_usable_cores())
    scale = resolve_requested_profile(options).scale
    forecasts = tuple(_estimate_scenario(spec, options, rates, scale) for spec in specs)
    return RunEstimate(forecasts, jobs or choose_worker_count(forecasts), rates)


def choose_worker_count(forecasts: Sequence[ScenarioEstimate]) -> int:
    """Processes at a time that keep this machine busy and leave it half of its free memory.

    One for each graphics card. Without any, one for each core, since a renderer in software uses
    several at once for part of the time only; but one more for a scenario has to save more time
    than its start takes.
    """
    frames = sum(item.frames for item in forecasts)
    useful = max(len(forecasts), frames // MIN_FRAMES_PER_WORKER)
    gpus = find_visible_gpus()
    if gpus:
        return min(len(gpus), useful)
    largest = max(item.memory_bytes for item in forecasts)
    fitting = int(MAX_FREE_MEMORY_FRACTION * free_memory_bytes() / largest)
    return max(1, min(count_usable_cores(), useful, fitting))


def check_resources(
    specs: Sequence[Spec],
    options: RunOptions,
    *,
    requested_limits: ResourceLimits,
    jobs: int | None,
    allow_large: bool,
    is_local: bool,
) -> RunResources:
    """What runs may begin with; limits and jobs that were not asked for are the plan's.

    Raises:
        InputError: They take more than declared limits; the text says what, and the ways out.
    """
    plan = estimate_run(specs, options, jobs=jobs, measure=False, simulate=False)
    output = options.output if is_local else None
    if not allow_large and plan.describe_excess(output) and not plan.total.is_exact:
        plan = estimate_run(specs, options, jobs=jobs, measure=False, simulate=True)
    found = [] if allow_large else plan.describe_excess(output)
    if found:
        raise InputError(
            f"this would take {'; '.join(found)}: make less (--frames, --scale, fewer specs),"
            " choose another --output or fewer --jobs, or say --allow-large;"
            " `advercity plan` tells more"
        )
    limits = ResourceLimits(
        memory_bytes=requested_limits.memory_bytes or plan.limits.memory_bytes,
        time_s=requested_limits.time_s or plan.limits.time_s,
    )
    return RunResources(plan.jobs, limits)


def _simulate_missing_traffic(specs: Sequence[Spec], jobs: int) -> None:
    """Traffic that specs share is simulated once."""
    wanted = {
        compute_traffic_key(spec): spec
        for spec in specs
        if _count_actor_ticks(spec) <= MAX_ACTOR_TICKS
    }
    with ThreadPoolExecutor(jobs) as pool:
        list(pool.map(load_or_simulate_traffic, wanted.values()))


def _count_actor_ticks(spec: Spec) -> int:
    return (spec.demand.vehicles + spec.demand.walkers) * spec.timing.max_ticks


def _estimate_scenario(
    spec: Spec, options: RunOptions, rates: MachineRates, scale: float
) -> ScenarioEstimate:
    work = Workload.from_spec(spec, scale)
    trace = load_cached_trace(spec)
    length = spec.timing.max_ticks - spec.timing.warm_up_ticks if trace is None else len(trace)
    frames = len(set(range(length)[options.frames]) - _find_done_frames(spec, options))
    frame_bytes = (
        rates.bytes_per_beam * work.beams
        + rates.bytes_per_agent * work.agents
        + rates.compute_image_bytes(scale) * work.pixels
    )
    frame_s = rates.s_per_beam * work.beams + rates.s_per_pixel * work.pixels
    return ScenarioEstimate(
        scenario=spec.id,
        frames=frames,
        is_exact=trace is not None,
        pictures=frames * work.pictures,
        size_bytes=round(frames * frame_bytes),
        time_s=(rates.setup_s if frames else 0.0) + frames * frame_s,
        memory_bytes=round(rates.memory_bytes + rates.memory_bytes_per_pixel * work.pixels),
    )


def _find_done_frames(spec: Spec, options: RunOptions) -> set[int]:
    """Frames that a run would find there."""
    if not options.fresh:
        with suppress(AdvercityError):  # the run itself says what is wrong there
            return set(Manifest.load(options.output / spec.id).frames)
    return set()


def _find_existing_parent(path: Path) -> Path:
    """The folder itself, or the nearest above it that exists."""
    whole = path.resolve()
    return next(folder for folder in (whole, *whole.parents) if folder.exists())
