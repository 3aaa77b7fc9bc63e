import json
import math
import os
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import psutil
import pytest
from advercity_dsl import Spec

from advercity.compiler import with_digest
from advercity.dataset.reader import Scenario
from advercity.dataset.writer import ScenarioWriter
from advercity.errors import InputError, RunError, StagingError
from advercity.pipeline import (
    RunOptions,
    RunResources,
    estimate,
    raise_failures,
    run_records,
    run_scenarios,
)
from advercity.pipeline.estimate import (
    RunEstimate,
    ScenarioEstimate,
    check_resources,
    choose_worker_count,
    estimate_rates,
    estimate_run,
)
from advercity.pipeline.progress import ScenarioResult
from advercity.pipeline.run_records import FrameWork, RunRecord
from advercity.rendering.backend import RENDER_PROFILES
from tests.builders import TWO_ROADS_FRAMES, SensorFramesOf, identify

OptionsFor = Callable[[Path], RunOptions]


def larger(spec: Spec, camera: dict[str, int], lidar: dict[str, int]) -> Spec:
    """Change the sensors, and make the traffic too long to simulate for an estimate."""
    data = spec.model_dump(mode="json")
    for agent in data["agents"]:
        agent["sensors"]["camera"] |= camera
        agent["sensors"]["lidar"] |= lidar
    data["timing"]["max_ticks"] = 1_000_000
    return with_digest(Spec.model_validate(data))


def ask(spec: Spec, options: RunOptions, **changes: Any) -> RunResources:
    return check_resources([spec], replace(options, jobs=1, **changes), is_local=True)


def four_cores(process: int) -> set[int]:
    return {0, 1, 2, 3}


def test_the_work_of_a_frame_follows_from_the_rig(specs: dict[str, Spec]) -> None:
    """Three vehicles and two roadside units with four cameras and 32 x 3750 beams each."""
    work = FrameWork.from_spec(specs["ui_fog_day_sparse"], scale=0.25)
    assert (work.agents, work.images) == (5, 20)
    assert work.pixels == 20 * 480 * 270
    assert work.beams == 5 * 120_000


def test_images_of_rolling_shutters_take_the_time_of_their_bands(
    specs: dict[str, Spec], records: Path, tmp_path: Path, options: OptionsFor
) -> None:
    document = specs["ui_fog_day_sparse"].model_dump(mode="json")
    for agent in document["agents"][:1]:
        agent["sensors"]["camera"]["shutter"] = {"readout_ms": 30, "bands": 6}
    rolling = with_digest(Spec.model_validate(document))
    work = FrameWork.from_spec(rolling, scale=0.25)
    assert (work.images, work.pixels, work.renders) == (20, 20 * 480 * 270, 2.0)
    known = record(pixels=work.pixels, beams=work.beams)
    rates = estimate_rates(work, [known])
    assert (rates.frame_s, rates.frame_bytes) == (2 * known.frame_s, known.frame_bytes)
    estimate = estimate_run([rolling], options(tmp_path), simulate=False).estimates[0]
    assert str(estimate.to_row()["images"]).endswith("(rendered 2 times)")


@pytest.fixture
def records(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """File of a machine on which nothing was run yet."""
    path = tmp_path / "runs.jsonl"
    monkeypatch.setattr(run_records, "RECORDS_FILE", str(path))
    return path


def record(**changes: Any) -> RunRecord:
    """A run of 1,000 pixels and 100 beams an agent on a machine of two cores."""
    values = {
        **{"machine": "m", "backend": "b", "renderer": "raster", "format": "opv2v"},
        **{"pixels": 1000, "beams": 100, "setup_s": 5.0, "frame_s": 2.0},
        **{"frame_bytes": 3000.0, "memory_bytes": 1e9},
    }
    return RunRecord.model_validate(values | changes)


def test_records_of_runs_are_limited_in_number_and_other_lines_stay(
    records: Path,
    tmp_path: Path,
    spec: Spec,
    sensor_frames_of: SensorFramesOf,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    identity = identify(spec, renderer="raster", scale="0.25")
    with ScenarioWriter(tmp_path / "data", spec, identity, length=1) as writer:
        writer.write_frame(0, sensor_frames_of(0))
        writer.finish()
    options = RunOptions(tmp_path / "data", jobs=1, backend="b")
    result = ScenarioResult(spec.id, None, 1, 1, 1.0, 1000, frame_s=7.0)
    monkeypatch.setattr(run_records, "MAX_RECORDS", 2)
    lines = [record(frame_s=number).model_dump_json() for number in (1.0, 2.0)]
    records.write_bytes("\n".join([lines[0], "mine", lines[1]]).encode() + b"\n\xff\n")
    run_records.record_run(spec, options, result, worker_count=1)
    mine, second, odd, new = records.read_bytes().splitlines()
    assert (mine, second.decode(), odd) == (b"mine", lines[1], b"\xff")
    assert b'"frame_s":7.0' in new
    elsewhere = records.rename(tmp_path / "elsewhere")
    records.symlink_to(elsewhere)
    run_records.record_run(spec, options, result, worker_count=1)
    assert records.is_symlink()
    assert len(elsewhere.read_bytes().splitlines()) == 4
    records.unlink()
    os.mkfifo(records)
    run_records.record_run(spec, options, result, worker_count=1)
    assert records.is_fifo()


@pytest.mark.sumo
@pytest.mark.render
@pytest.mark.slow
def test_an_estimate_is_within_a_factor_of_two_of_what_comes_out(
    specs: dict[str, Spec], records: Path, tmp_path: Path
) -> None:
    """Recorded in fog, estimated for a clear night."""
    options = RunOptions(
        tmp_path / "fog", jobs=1, profile="preview", scale=0.05, frames=slice(0, 3)
    )
    raise_failures(run_scenarios([specs["ri_fog_day_sparse"]], options))
    spec, options = specs["ri_clear_night_sparse"], replace(options, output=tmp_path / "night")
    (expected,) = estimate_run([spec], options).estimates
    assert expected.is_exact
    assert (expected.frames, expected.pictures) == (3, 60)
    assert expected.time_s is not None
    (result,) = run_scenarios([spec], options)
    raise_failures([result])
    assert 0.5 < expected.size_bytes / result.size_bytes < 2.0
    assert 0.5 < expected.memory_bytes / result.peak_memory_bytes < 2.0
    (left,) = estimate_run([spec], options, simulate=False).estimates
    assert (left.frames, left.size_bytes, left.time_s) == (0, 0, 0.0)


def test_scenarios_whose_traffic_fails_are_named_next_to_the_estimates_of_the_others(
    few: list[Spec],
    options: OptionsFor,
    records: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    broken = few[0].model_copy(
        update={"id": "broken", "seeds": few[0].seeds.model_copy(update={"traffic": 7})}
    )

    def simulate(spec: Spec) -> None:
        if spec.id == "broken":
            raise StagingError("broken: nowhere to stop")

    monkeypatch.setattr(estimate, "load_or_simulate_traffic", simulate)
    found = estimate_run([*few, broken], options(tmp_path))
    assert [item.scenario for item in found.estimates] == [spec.id for spec in few]
    assert list(map(str, found.errors)) == ["broken: nowhere to stop"]
    with pytest.raises(RunError, match="nowhere to stop"):
        estimate_run([broken], options(tmp_path))


def test_without_a_comparable_run_the_time_is_unknown_and_the_rest_an_upper_bound(
    few: list[Spec], options: OptionsFor, records: Path, tmp_path: Path
) -> None:
    work = FrameWork(agents=1, images=1, pixels=10_000, beams=100)
    for known in ([], [record()]):
        rates = estimate_rates(work, known)
        assert (rates.setup_s, rates.frame_s) == (None, None)
        assert rates.frame_bytes == 3 * 10_000 + 30 * 100 + 200e3
    estimate = estimate_run(few, options(tmp_path), simulate=False)
    assert estimate.total.time_s is None
    row = estimate.total.to_row()
    assert row["time"] == "unknown"
    assert str(row["size"]).startswith("at most ")
    assert str(row["memory"]).startswith("at most ")


def test_frames_that_exist_are_counted_apart(
    records: Path, two_roads: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ADVERCITY_CACHE", str(tmp_path))  # without the trace of another test
    spec = Scenario(two_roads / "ui_clear_night_dense").spec
    options = RunOptions(two_roads, jobs=1, backend="fake", profile="preview")
    (found,) = estimate_run([spec], options, simulate=False).estimates
    possible = spec.timing.max_ticks - spec.timing.warm_up_ticks
    assert found.existing_frames == TWO_ROADS_FRAMES
    assert found.frames == possible - TWO_ROADS_FRAMES
    assert str(found.to_row()["frames"]).endswith(f"{found.frames} ({TWO_ROADS_FRAMES} exist)")


def test_rates_are_the_median_of_the_last_runs_of_about_as_much_work() -> None:
    work = FrameWork(agents=1, images=1, pixels=2000, beams=100)
    older = [record(frame_s=1.0, pixels=2000)] * 3
    alike = [record(frame_s=time_s, pixels=1600) for time_s in (3.0, 30.0, 4.0, 5.0, 3.5)]
    rates = estimate_rates(work, [*older, *alike, record(frame_s=100.0, pixels=20_000)])
    assert rates.frame_s == pytest.approx(4.0 * 2000 / 1600)
    assert rates.setup_s == 5.0
    assert rates.frame_bytes == pytest.approx(3000 * 2000 / 1600)


@pytest.mark.parametrize(("pixels", "beams"), [(900, 100), (4100, 100), (2000, 49), (2000, 201)])
def test_runs_of_less_than_half_or_more_than_twice_the_work_say_nothing(
    pixels: int, beams: int
) -> None:
    work = FrameWork(agents=1, images=1, pixels=2000, beams=100)
    rates = estimate_rates(work, [record(pixels=pixels, beams=beams)])
    assert (rates.setup_s, rates.frame_s) == (None, None)


def test_files_are_never_estimated_to_be_more_than_noise_would_take() -> None:
    work = FrameWork(agents=1, images=1, pixels=1000, beams=100)
    rates = estimate_rates(work, [record(frame_bytes=1e10)])
    assert rates.frame_bytes == 3 * 1000 + 30 * 100 + 200e3


@pytest.mark.parametrize(
    "change",
    [
        *({"frame_s": 1e9}, {"frame_s": -1.0}, {"frame_s": math.nan}, {"frame_bytes": 1e15}),
        *({"setup_s": math.inf}, {"pixels": 0}, {"memory_bytes": 1e18}),
    ],
)
def test_a_record_that_no_machine_can_have_made_is_ignored(
    change: dict[str, float], records: Path
) -> None:
    machine = run_records.describe_machine()
    good = record(machine=machine)
    bad = good.model_dump(mode="json") | change
    records.write_text(f"{json.dumps(bad)}\n{good.model_dump_json()}\n")
    found = run_records.load_records(backend="b", renderer="raster", format="opv2v")
    assert found == [good]


def test_a_shared_cache_keeps_the_last_runs_of_every_machine_apart(
    monkeypatch: pytest.MonkeyPatch, records: Path
) -> None:
    lines = [record(machine="other"), record(machine=run_records.describe_machine())]
    records.write_text("\n".join(["{}", *(line.model_dump_json() for line in lines)]))
    found = run_records.load_records(backend="b", renderer="raster", format="opv2v")
    assert found == lines[1:]
    assert run_records.load_records(backend="b", renderer="ray_traced", format="opv2v") == []


def items_of(
    few: list[Spec], options: RunOptions, changes: Sequence[dict[str, Any]]
) -> tuple[ScenarioEstimate, ...]:
    first = estimate_run(few[:1], options, simulate=False).estimates[0]
    return tuple(replace(first, **change) for change in changes)


def test_scenarios_at_a_time_share_cores_and_add_up_in_memory(
    few: list[Spec], options: OptionsFor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", four_cores)
    changes = [{"time_s": t, "memory_bytes": m} for t, m in ((10, 5), (20, 9), (30, 7))]
    items = items_of(few, options(tmp_path), changes)
    alone, both = (RunEstimate(items, jobs).total for jobs in (1, 2))
    assert (alone.time_s, alone.memory_bytes) == (60, 9)
    assert (both.time_s, both.memory_bytes) == (30, 16)


def test_more_jobs_than_scenarios_join_the_largest_and_each_takes_its_memory(
    few: list[Spec], options: OptionsFor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of nine no more than there are frames; a fifth makes four cores no faster."""
    monkeypatch.setattr(os, "sched_getaffinity", four_cores)
    changes = [{"frames": 40, "time_s": 30, "memory_bytes": memory} for memory in (5, 9)]
    items = items_of(few, options(tmp_path), changes)
    four, five = (RunEstimate(items, jobs).total for jobs in (4, 5))
    assert (four.time_s, four.memory_bytes) == (15, 32)
    assert (five.time_s, five.memory_bytes) == (15, 41)
    assert five.scenario == "2 scenarios, 5 processes"
    short = RunEstimate(tuple(replace(item, frames=2) for item in items), 9).total
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
def test_as_many_workers_as_suit_gpus_or_cores_memory_and_frames(
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
    changes = [{"frames": count, "memory_bytes": memory_bytes} for count in frames]
    made = items_of(few, options(tmp_path), changes)
    assert choose_worker_count(made) == jobs


@pytest.mark.parametrize(
    ("camera", "lidar", "told"),
    [
        ({}, {"azimuths": 36_000, "channels": 256}, r"TB of files, more than"),
        ({"width_px": 8192, "height_px": 8192}, {}, r"of memory, more than"),
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
    options = RunOptions(tmp_path / "output", jobs=1, profile="full")
    with pytest.raises(InputError, match=rf"{told}.*`allow_large`"):
        ask(spec, options)
    assert ask(spec, options, allow_large=True).worker_count == 1
    assert not (tmp_path / "output").exists()


def test_the_frames_that_a_refusal_names_are_not_refused(
    specs: dict[str, Spec], tmp_path: Path
) -> None:
    spec = larger(specs["ui_fog_day_dense"], {}, {"azimuths": 18_000, "channels": 128})
    options = RunOptions(tmp_path / "output", jobs=1, profile="preview", scale=0.01)
    with pytest.raises(InputError, match=r"`frames` 0:\d+") as caught:
        ask(spec, options)
    (last,) = re.findall(r"`frames` 0:(\d+)", str(caught.value))
    assert ask(spec, replace(options, frames=slice(0, int(last)))).worker_count == 1
    with pytest.raises(InputError, match="of files, more than"):
        ask(spec, replace(options, frames=slice(0, 2 * int(last))))


def test_a_run_of_months_is_refused_where_a_comparable_one_was_recorded(
    specs: dict[str, Spec], records: Path, tmp_path: Path
) -> None:
    spec = larger(specs["ui_fog_day_dense"], {}, {})
    options = RunOptions(tmp_path / "output", jobs=1, profile="full")
    work = FrameWork.from_spec(spec, RENDER_PROFILES["full"].scale)
    known = record(
        machine=run_records.describe_machine(),
        backend="sapien",
        renderer="ray_traced",
        pixels=work.pixels,
        beams=work.beams,
        frame_s=60.0,
    )
    unknown = estimate_run([spec], options, simulate=False)
    assert not any("days" in text for text in unknown.describe_excess(tmp_path))
    records.write_text(known.model_dump_json())
    with pytest.raises(InputError, match=r"about \d+ days, more than 30.*`allow_large`"):
        ask(spec, options)


def test_requested_limits_hold_and_the_others_come_from_the_estimate(
    few: list[Spec], options: OptionsFor, tmp_path: Path
) -> None:
    limits = ask(few[0], options(tmp_path), max_memory_bytes=123).limits
    assert limits.memory_bytes == 123
    assert limits.time_s is not None
    assert limits.time_s > 3600


def test_traced_images_have_time_for_every_sample(
    specs: dict[str, Spec], options: OptionsFor, tmp_path: Path
) -> None:
    large = [
        replace(options(tmp_path), profile=profile, scale=1.0) for profile in ("preview", "full")
    ]
    raster, traced = (
        ask(specs["ui_fog_day_sparse"], item, allow_large=True).limits.time_s or 0.0
        for item in large
    )
    assert traced > 5.0 * raster
