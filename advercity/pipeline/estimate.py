"""Estimates time, disk space and memory of runs, and refuses runs too large for the machine.

Work follows from the spec, the number of frames from the traffic. Rates come from recorded runs of
similar work on this machine (`run_records`). Without such a run, files and memory are upper bounds
for any machine, and the time is unknown.
"""

import math
import shutil
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median

from advercity_dsl import Spec

from advercity.atomic_files import resolve_links
from advercity.dataset.manifest import Manifest
from advercity.errors import AdvercityError, InputError, RunError
from advercity.pipeline.cache import compute_traffic_key
from advercity.pipeline.machine import (
    count_usable_cores,
    find_visible_gpus,
    free_memory_bytes,
    total_memory_bytes,
)
from advercity.pipeline.preparation import (
    load_cached_trace,
    load_or_simulate_traffic,
    resolve_backend,
    resolve_profile,
)
from advercity.pipeline.run_records import FrameWork, RunRecord, load_records
from advercity.pipeline.sensor_choice import choose_sensors
from advercity.pipeline.workers import MIN_FRAMES_PER_WORKER
from advercity.rendering.backend import RENDER_PROFILES, RenderProfile, load_backend
from advercity.run_options import (
    ResourceLimits,
    RunOptions,
    RunResources,
    format_byte_size,
    format_duration,
)

MAX_TOTAL_BYTES = 10**12
MAX_TOTAL_S = 30 * 86_400
MAX_DISK_FRACTION = 0.9
MAX_MEMORY_FRACTION = 0.9
MAX_FREE_MEMORY_FRACTION = 0.5
MAX_ACTOR_TICKS = 20_000_000
"""Estimates do not simulate traffic with more actors times ticks: it takes too long."""
MAX_EXTRAPOLATION = 2.0
"""Largest ratio of work, either way, between a frame and a comparable recorded frame."""
RECORDS_USED = 5
"""Number of latest comparable records; estimates use the median of their rates."""

# Upper bounds without comparable records. Three bytes a pixel hold an image of pure noise; a real
# image with its class and depth maps is smaller. A beam in fog has up to two returns.
BYTES_PER_PIXEL = 3.0
BYTES_PER_BEAM = 30.0
OTHER_BYTES_PER_AGENT = 200e3
MEMORY_BYTES, MEMORY_BYTES_PER_PIXEL = 900e6, 60.0
# Rates of two cores without a GPU, only for the time limit, which is 20 times as long.
SLOW_SETUP_S, SLOW_S_PER_BEAM, SLOW_S_PER_PIXEL = 20.0, 3e-6, 6e-7
SLOW_S_PER_TRACED_SAMPLE = 2.5e-6


@dataclass(frozen=True)
class FrameRates:
    """Time, files and memory of a scenario's frame and its worker on this machine.

    Attributes:
        setup_s: Wall-clock time until the first frame; None if unknown.
        frame_s: Wall-clock time per frame of a worker alone; None if unknown.
        frame_bytes: Files of a frame.
        memory_bytes: Resident memory of a worker.
    """

    setup_s: float | None
    frame_s: float | None
    frame_bytes: float
    memory_bytes: float


def estimate_rates(work: FrameWork, records: Sequence[RunRecord]) -> FrameRates:
    """Estimate the rates of frames from the last recorded runs of similar work.

    Args:
        work: Work of a frame.
        records: Runs with the same backend, renderer and layout on this machine, newest last.
    """
    most_bytes = (
        BYTES_PER_PIXEL * work.pixels
        + BYTES_PER_BEAM * work.beams
        + OTHER_BYTES_PER_AGENT * work.agents
    )
    most_memory_bytes = MEMORY_BYTES + MEMORY_BYTES_PER_PIXEL * work.pixels
    alike = [record for record in records if _is_comparable(work, record)][-RECORDS_USED:]
    if not alike:
        return FrameRates(None, None, most_bytes, most_memory_bytes)
    factors = [max(work.pixels / one.pixels, work.beams / one.beams) for one in alike]
    scaled = list(zip(alike, factors, strict=True))
    return FrameRates(
        setup_s=median(one.setup_s for one in alike),
        frame_s=median(one.frame_s * factor * work.renders / one.renders for one, factor in scaled),
        frame_bytes=min(most_bytes, median(one.frame_bytes * factor for one, factor in scaled)),
        memory_bytes=median(one.memory_bytes * max(1.0, factor) for one, factor in scaled),
    )


def _is_comparable(work: FrameWork, record: RunRecord) -> bool:
    ratios = (
        work.pixels / record.pixels,
        work.beams / record.beams,
        work.renders / record.renders,
    )
    return all(1 / MAX_EXTRAPOLATION <= ratio <= MAX_EXTRAPOLATION for ratio in ratios)


@dataclass(frozen=True)
class ScenarioEstimate:
    """Time, disk space and memory of a scenario, without its existing frames.

    Attributes:
        scenario: Id of its spec.
        frames: Frames to make.
        existing_frames: Frames already in the output.
        is_exact: Whether the number of frames is exact; else it is an upper bound.
        pictures: Images of all cameras in those frames.
        renders: How often each is rendered, on average.
        size_bytes: Files to write.
        time_s: Wall-clock time with one worker; None if no comparable run was recorded.
        memory_bytes: Resident memory of a worker.
    """

    scenario: str
    frames: int
    existing_frames: int
    is_exact: bool
    pictures: int
    size_bytes: int
    time_s: float | None
    memory_bytes: int
    renders: float = 1.0

    def to_row(self) -> dict[str, str | int]:
        """Return the row of a table, by its heads."""
        existing = f" ({self.existing_frames} exist)" if self.existing_frames else ""
        times = f"{self.pictures} (rendered {self.renders:.3g} times)"
        bound = "at most " if self.time_s is None else ""  # no comparable record
        return {
            "scenario": self.scenario,
            "frames": f"{'' if self.is_exact else 'at most '}{self.frames}{existing}",
            "images": times if self.renders > 1 else self.pictures,
            "size": f"{bound}{format_byte_size(self.size_bytes)}",
            "time": "unknown" if self.time_s is None else format_duration(self.time_s),
            "memory": f"{bound}{format_byte_size(self.memory_bytes)}",
        }


@dataclass(frozen=True)
class RunEstimate:
    """Time, disk space and memory of a run of several scenarios.

    Attributes:
        estimates: One per scenario.
        jobs: Worker processes at a time.
        limits: Limits beyond which something is wrong with a scenario, even on a busy machine.
        errors: Failed traffic simulations; their scenarios have no estimate.
    """

    estimates: tuple[ScenarioEstimate, ...]
    jobs: int
    limits: ResourceLimits = field(default_factory=ResourceLimits)
    errors: tuple[AdvercityError, ...] = ()

    @property
    def total(self) -> ScenarioEstimate:
        """All scenarios together."""
        items = self.estimates
        times_s = [item.time_s for item in items if item.time_s is not None]
        pictures = sum(item.pictures for item in items)
        at_a_time = min(self.jobs, max(count_usable_cores(), len(find_visible_gpus())))
        scenarios = "1 scenario" if len(items) == 1 else f"{len(items)} scenarios"
        workers = "1 process" if self.jobs == 1 else f"{self.jobs} processes"
        return ScenarioEstimate(
            scenario=f"{scenarios}, {workers}",
            frames=sum(item.frames for item in items),
            existing_frames=sum(item.existing_frames for item in items),
            is_exact=all(item.is_exact for item in items),
            pictures=pictures,
            renders=sum(item.renders * item.pictures for item in items) / max(1, pictures) or 1.0,
            size_bytes=sum(item.size_bytes for item in items),
            time_s=sum(times_s) / at_a_time if len(times_s) == len(items) else None,
            memory_bytes=self._sum_memory(),
        )

    def _sum_memory(self) -> int:
        """Sum the memory of the largest workers running at a time."""
        largest = sorted(self.estimates, key=lambda item: item.memory_bytes, reverse=True)
        total_bytes = sum(item.memory_bytes for item in largest[: self.jobs])
        joiners = max(0, self.jobs - len(largest))
        for item in largest:
            count = min(joiners, max(0, item.frames - 1))
            total_bytes += count * item.memory_bytes
            joiners -= count
        return total_bytes

    def describe_excess(self, output: Path | None) -> list[str]:
        """Describe each limit exceeded by a run without `allow_large`; empty if it fits.

        Args:
            output: Folder on this machine; None if other machines do the work.
        """
        total, found = self.total, list[str]()
        free = _measure_free_bytes(output)
        most_bytes = _compute_most_bytes(free)
        if total.size_bytes > most_bytes:
            space = "" if output is None else f" ({format_byte_size(free)} are free at {output})"
            found.append(
                f"about {format_byte_size(total.size_bytes)} of files, more than"
                f" {format_byte_size(most_bytes)}{space}"
            )
        if output is None:
            return found
        if total.time_s is not None and total.time_s > MAX_TOTAL_S:
            found.append(f"about {total.time_s / 86_400:.0f} days, more than 30")
        most_bytes = MAX_MEMORY_FRACTION * total_memory_bytes()
        if total.memory_bytes > most_bytes:
            found.append(
                f"about {format_byte_size(total.memory_bytes)} of memory, more than"
                f" {format_byte_size(most_bytes)} of this machine's"
            )
        return found

    def count_fitting_frames(self, output: Path | None) -> int:
        """Count the frames per scenario whose files fit in the output."""
        frame_bytes = sum(item.size_bytes / item.frames for item in self.estimates if item.frames)
        return int(_compute_most_bytes(_measure_free_bytes(output)) / max(1.0, frame_bytes))


def _measure_free_bytes(output: Path | None) -> float:
    """Measure the free space at a folder; infinite if other machines do the work."""
    return math.inf if output is None else shutil.disk_usage(_find_existing_parent(output)).free


def _compute_most_bytes(free_bytes: float) -> float:
    return min(MAX_TOTAL_BYTES, MAX_DISK_FRACTION * free_bytes)


def estimate_run(
    specs: Sequence[Spec], options: RunOptions, *, simulate: bool = True
) -> RunEstimate:
    """Estimate time, disk space and memory of running specs.

    Args:
        specs: Scenarios to run.
        options: How to run them; existing frames in the output are left out.
        simulate: Simulate missing traffic, up to `MAX_ACTOR_TICKS`; else the number of frames is
            an upper bound.

    Raises:
        InputError: An option does not fit.
        RunError: The traffic simulation of every scenario fails.
    """
    options = resolve_backend(options)
    specs = [choose_sensors(spec, options) for spec in specs]
    failed: dict[str, AdvercityError] = {}
    if simulate:
        failed = _simulate_missing_traffic(specs, options.jobs or count_usable_cores())
        specs = [spec for spec in specs if compute_traffic_key(spec) not in failed]
        if not specs:
            raise RunError(*map(str, failed.values()))
    profile = resolve_requested_profile(options)
    records = load_records(
        backend=options.backend, renderer=profile.renderer, format=options.format
    )
    works = [FrameWork.from_spec(spec, profile.scale) for spec in specs]
    rates = [estimate_rates(work, records) for work in works]
    estimates = tuple(
        _estimate_scenario(spec, options, work, rate)
        for spec, work, rate in zip(specs, works, rates, strict=True)
    )
    worker_count = options.jobs or choose_worker_count(estimates)
    limits = _choose_limits(estimates, works, profile)
    return RunEstimate(estimates, worker_count, limits, tuple(failed.values()))


def _choose_limits(
    estimates: Sequence[ScenarioEstimate], works: Sequence[FrameWork], profile: RenderProfile
) -> ResourceLimits:
    pixel_s = SLOW_S_PER_PIXEL
    if profile.renderer == "ray_traced":
        pixel_s += SLOW_S_PER_TRACED_SAMPLE * profile.samples
    slow_s = [
        SLOW_SETUP_S
        + item.frames * (SLOW_S_PER_BEAM * work.beams + pixel_s * work.pixels * work.renders)
        for item, work in zip(estimates, works, strict=True)
    ]
    times_s = [item.time_s for item in estimates if item.time_s is not None]
    memory_bytes = max(item.memory_bytes for item in estimates)
    return ResourceLimits(
        memory_bytes=max(4 * 10**9, 3 * memory_bytes), time_s=3600 + 20 * max([*slow_s, *times_s])
    )


def resolve_requested_profile(options: RunOptions) -> RenderProfile:
    """Resolve the profile and its scale; only `auto` has to open the device."""
    if options.profile == "auto":
        return resolve_profile(options, load_backend(options.backend).capabilities())
    return RENDER_PROFILES[options.profile].with_scale(options.scale)


def choose_worker_count(estimates: Sequence[ScenarioEstimate]) -> int:
    """Choose how many processes keep this machine busy and leave it half of its free memory.

    One per GPU; without a GPU one per core, since a software renderer uses several only part of the
    time. A further worker of a scenario must save more time than its start takes.
    """
    frames = sum(item.frames for item in estimates)
    useful = max(len(estimates), frames // MIN_FRAMES_PER_WORKER)
    gpus = find_visible_gpus()
    if gpus:
        return min(len(gpus), useful)
    largest = max(item.memory_bytes for item in estimates)
    fitting = int(MAX_FREE_MEMORY_FRACTION * free_memory_bytes() / largest)
    return max(1, min(count_usable_cores(), useful, fitting))


def check_resources(specs: Sequence[Spec], options: RunOptions, *, is_local: bool) -> RunResources:
    """Choose the resources of a run: as requested, else as estimated.

    Raises:
        InputError: The run exceeds a limit; the text names the excess and remedies.
    """
    estimate = estimate_run(specs, options, simulate=False)
    output = options.folder if is_local else None
    if not options.allow_large and estimate.describe_excess(output) and not estimate.total.is_exact:
        # Upper bounds exceed; simulated traffic gives the true number of frames.
        estimate = estimate_run(specs, options, simulate=True)
    found = [] if options.allow_large else estimate.describe_excess(output)
    if found:
        fitting = estimate.count_fitting_frames(output)
        is_shorter = 0 < fitting < max(item.frames for item in estimate.estimates)
        frames = f"`frames` 0:{fitting}" if is_shorter else "`frames`"
        raise InputError(
            f"this would take {'; '.join(found)}: make less ({frames}, `scale`, fewer specs),"
            " choose another `output` or fewer `jobs`, or allow it with `allow_large`;"
            " `advercity estimate` shows more"
        )
    limits = ResourceLimits(
        memory_bytes=options.max_memory_bytes or estimate.limits.memory_bytes,
        time_s=options.max_time_s or estimate.limits.time_s,
    )
    return RunResources(estimate.jobs, limits)


def _simulate_missing_traffic(specs: Sequence[Spec], jobs: int) -> dict[str, AdvercityError]:
    """Simulate the missing traffic of specs, shared traffic once; return errors by traffic key."""
    wanted = {
        compute_traffic_key(spec): spec
        for spec in specs
        if _count_actor_ticks(spec) <= MAX_ACTOR_TICKS
    }
    failed: dict[str, AdvercityError] = {}

    def simulate(key: str) -> None:
        try:
            load_or_simulate_traffic(wanted[key])
        except AdvercityError as error:
            failed[key] = error

    with ThreadPoolExecutor(jobs) as pool:
        list(pool.map(simulate, wanted))
    return failed


def _count_actor_ticks(spec: Spec) -> int:
    return (spec.demand.vehicles + spec.demand.walkers) * spec.timing.max_ticks


def _estimate_scenario(
    spec: Spec, options: RunOptions, work: FrameWork, rates: FrameRates
) -> ScenarioEstimate:
    trace = load_cached_trace(spec)
    length = spec.timing.max_ticks - spec.timing.warm_up_ticks if trace is None else len(trace)
    wanted = {*options.select_frames(length, spec.timing.tick_s)}
    existing = wanted & _find_existing_frames(spec, options)
    frames = len(wanted) - len(existing)
    time_s = None if frames else 0.0
    if frames and rates.setup_s is not None and rates.frame_s is not None:
        time_s = rates.setup_s + frames * rates.frame_s
    return ScenarioEstimate(
        scenario=spec.id,
        frames=frames,
        existing_frames=len(existing),
        is_exact=trace is not None,
        pictures=frames * work.images,
        renders=work.renders,
        size_bytes=round(frames * rates.frame_bytes),
        time_s=time_s,
        memory_bytes=round(rates.memory_bytes),
    )


def _find_existing_frames(spec: Spec, options: RunOptions) -> set[int]:
    if not options.fresh:
        with suppress(AdvercityError):  # the run itself reports a bad manifest
            return set(Manifest.load(options.folder / spec.id).frames)
    return set()


def _find_existing_parent(path: Path) -> Path:
    """Find the nearest existing folder: the path itself, or one above it."""
    whole = resolve_links(path)
    return next(folder for folder in (whole, *whole.parents) if folder.exists())
