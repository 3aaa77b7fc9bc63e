import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import psutil
import pytest
from advercity_dsl import Spec

from advercity.errors import InputError
from advercity.pipeline import (
    ResourceLimits,
    RunOptions,
    RunResources,
    raise_failures,
    run_scenarios,
)
from advercity.pipeline.calibration import MachineRates, Workload
from advercity.pipeline.estimate import (
    RunEstimate,
    check_resources,
    choose_worker_count,
    estimate_run,
)

OptionsFor = Callable[[Path], RunOptions]


def larger(spec: Spec, camera: dict[str, int], lidar: dict[str, int]) -> Spec:
    """With other sensors, and a traffic that would take too long to simulate for a plan."""
    data = spec.model_dump(mode="json")
    for agent in data["agents"]:
        agent["sensors"]["camera"] |= camera
        agent["sensors"]["lidar"] |= lidar
    data["timing"]["max_ticks"] = 1_000_000
    return Spec.model_validate(data)


def ask(
    spec: Spec,
    options: RunOptions,
    *,
    asked: ResourceLimits | None = None,
    allow_large: bool = False,
) -> RunResources:
    return check_resources(
        [spec],
        options,
        requested_limits=asked or ResourceLimits(),
        jobs=1,
        allow_large=allow_large,
        is_local=True,
    )


def four_cores(process: int) -> set[int]:
    return {0, 1, 2, 3}


def test_the_work_of_a_frame_follows_from_the_rig(specs: dict[str, Spec]) -> None:
    """Three vehicles and two roadside units with four cameras and 32 x 3750 beams each."""
    work = Workload.from_spec(specs["ui_fog_day_sparse"], scale=0.25)
    assert (work.agents, work.pictures) == (5, 20)
    assert work.pixels == 20 * 480 * 270
    assert work.beams == 5 * 120_000


@pytest.mark.sumo
@pytest.mark.render
def test_a_plan_is_within_a_factor_of_two_of_what_comes_out(
    specs: dict[str, Spec], witness: Any, tmp_path: Path
) -> None:
    """Measured in fog, foretold for a clear night."""
    spec = specs["ri_clear_night_sparse"]
    options = RunOptions(tmp_path, profile="preview", scale=0.05, frames=slice(0, 3))
    plan = estimate_run([spec], options, jobs=1, measure=True, simulate=True)
    (foretold,) = plan.estimates
    assert plan.rates.measured["backend"] == "sapien"
    assert foretold.is_exact
    assert (foretold.frames, foretold.pictures) == (3, 60)
    outcomes = run_scenarios([spec], options, listener=witness)
    raise_failures(outcomes)
    assert 0.5 < foretold.size_bytes / outcomes[0].size_bytes < 2.0
    assert 0.5 < foretold.memory_bytes / outcomes[0].peak_memory_bytes < 2.0
    (left,) = estimate_run([spec], options, jobs=1, measure=False, simulate=False).estimates
    assert (left.frames, left.size_bytes, left.time_s) == (0, 0, 0.0)


def test_scenarios_at_a_time_share_cores_and_add_up_in_memory(
    few: list[Spec], options: OptionsFor, tmp_path: Path
) -> None:
    first = estimate_run(few, options(tmp_path), jobs=1, measure=False, simulate=False).estimates[0]
    items = tuple(replace(first, time_s=t, memory_bytes=m) for t, m in ((10, 5), (20, 9), (30, 7)))
    alone = RunEstimate(items, 1, MachineRates(busy_cores=0.0)).total
    both = RunEstimate(items, 2, MachineRates(busy_cores=0.0)).total
    assert (alone.time_s, alone.memory_bytes) == (60, 9)
    assert (both.time_s, both.memory_bytes) == (30, 16)


def test_more_jobs_than_scenarios_share_the_frames_and_each_takes_the_memory(
    few: list[Spec], options: OptionsFor, tmp_path: Path
) -> None:
    """Of four each scenario gets two; of five the larger one three; of nine no more than frames."""
    first = estimate_run(few, options(tmp_path), jobs=1, measure=False, simulate=False).estimates[0]
    items = tuple(replace(first, frames=40, time_s=30, memory_bytes=memory) for memory in (5, 9))
    four, five = (RunEstimate(items, jobs, MachineRates(busy_cores=0.0)).total for jobs in (4, 5))
    assert (four.time_s, four.memory_bytes) == (15, 28)
    assert (five.time_s, five.memory_bytes) == (12, 37)
    assert five.scenario == "2 scenarios, 5 processes"
    short = RunEstimate(tuple(replace(item, frames=2) for item in items), 9, MachineRates()).total
    assert short.memory_bytes == 28


@pytest.mark.parametrize(
    ("frames", "memory_bytes", "cards", "jobs"),
    [
        ([20], 1, "", 1),
        ([33], 1, "", 2),
        ([5, 5, 5], 1, "", 3),
        ([500], 1, "", 4),
        ([500], 6, "", 3),
        ([500], 100, "", 1),
        ([20], 1, "4,7", 1),
        ([500], 1, "4,7", 2),
    ],
)
def test_as_many_processes_as_suit_cards_or_cores_memory_and_frames(
    few: list[Spec],
    options: OptionsFor,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    *,
    frames: list[int],
    memory_bytes: int,
    cards: str,
    jobs: int,
) -> None:
    """A machine of four cores with 40 bytes of free memory, half of which may be taken."""
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", cards)
    monkeypatch.setattr(os, "sched_getaffinity", four_cores)
    monkeypatch.setattr(psutil, "virtual_memory", lambda: SimpleNamespace(available=40))
    first = estimate_run(few, options(tmp_path), jobs=1, measure=False, simulate=False).estimates[0]
    made = [replace(first, frames=count, memory_bytes=memory_bytes) for count in frames]
    assert choose_worker_count(made) == jobs


def test_pictures_of_more_pixels_take_more_bytes_a_pixel() -> None:
    rates = MachineRates(bytes_per_pixel=((0.125, 1.0), (0.25, 1.5)))
    assert rates.compute_image_bytes(1.0) == pytest.approx(2.5)
    assert rates.compute_image_bytes(0.05) == 1.5


@pytest.mark.parametrize(
    ("camera", "lidar", "told"),
    [
        ({}, {"azimuths": 36_000, "channels": 256}, r"TB of files, more than"),
        ({"width_px": 8192, "height_px": 8192}, {}, r"of memory, more than"),
        ({}, {}, r"about \d+ days, more than 30"),
    ],
)
def test_a_spec_that_would_fill_a_machine_is_refused_before_anything_is_made(
    specs: dict[str, Spec],
    tmp_path: Path,
    camera: dict[str, int],
    lidar: dict[str, int],
    told: str,
) -> None:
    spec = larger(specs["ui_fog_day_dense"], camera, lidar)
    options = RunOptions(tmp_path / "output", profile="full")
    with pytest.raises(InputError, match=rf"{told}.*--allow-large"):
        ask(spec, options)
    assert ask(spec, options, allow_large=True).worker_count == 1
    assert not (tmp_path / "output").exists()


def test_limits_that_are_asked_for_hold_and_the_others_are_the_plans(
    few: list[Spec], options: OptionsFor, tmp_path: Path
) -> None:
    limits = ask(few[0], options(tmp_path), asked=ResourceLimits(memory_bytes=123)).limits
    assert limits.memory_bytes == 123
    assert limits.time_s is not None
    assert limits.time_s > 3600
