"""Damages datasets, traces and caches at random, as `benchmarks/fuzz.py` does by the thousand."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from advercity_dsl import Spec

from advercity.frames import STATE_DTYPE, Actor, Trace
from advercity.randomness import create_generator
from advercity.scene.world_storage import save_world
from advercity.world import World
from benchmarks.fuzz_files import CacheFuzzer, DatasetFuzzer, Recording, TraceFuzzer
from benchmarks.fuzz_inputs import ExportFuzzer, MapFuzzer, PredictionFuzzer, RecordingFuzzer
from benchmarks.mutations import damage_bytes
from tests.builders import SensorFramesOf, identify, write_scenario

SEED = 3


@pytest.fixture(scope="module")
def datasets(
    tmp_path_factory: pytest.TempPathFactory, spec: Spec, sensor_frames_of: SensorFramesOf
) -> DatasetFuzzer:
    identities = [identify(spec, format=layout) for layout in ("opv2v", "adver_city")]
    frames = [sensor_frames_of(0), sensor_frames_of(1)]
    return DatasetFuzzer(Recording(spec, identities, frames), tmp_path_factory.mktemp("datasets"))


@pytest.fixture(scope="module")
def trace() -> Trace:
    states = np.zeros(40, STATE_DTYPE)
    states["tick"] = np.arange(40)
    actor = Actor(101, "car", "lincoln_mkz_2017", "car_paint_white", (4.9, 2.06, 1.51))
    return Trace(0.1, 59, (actor,), states, ("north",), np.zeros((40, 1), np.uint8))


def test_damaged_files_of_a_dataset_are_read_or_refused_and_none_is_lost(
    datasets: DatasetFuzzer,
) -> None:
    outcomes = {datasets.check(number, SEED)[1] for number in range(60)}
    assert outcomes == {"read", "refused"}


@pytest.mark.slow
def test_a_thousand_damaged_files_are_read_or_refused_and_none_is_lost(
    datasets: DatasetFuzzer,
) -> None:
    for number in range(60, 1060):
        datasets.check(number, SEED)


def test_damaged_traces_are_read_or_refused(trace: Trace, tmp_path: Path) -> None:
    fuzzer = TraceFuzzer(trace, tmp_path)
    assert {fuzzer.check(number, SEED)[1] for number in range(60)} == {"read", "refused"}


def test_damaged_entries_of_the_cache_are_made_again(trace: Trace, tmp_path: Path) -> None:
    trace.save(tmp_path / "trace.npz")
    save_world(World("empty", (), {}, (), Path("road.net.xml")), tmp_path / "world.npz")
    entries = {
        f"traces/{'a' * 64}.npz": (tmp_path / "trace.npz").read_bytes(),
        f"worlds/{'b' * 64}.npz": (tmp_path / "world.npz").read_bytes(),
        "runs.jsonl": b"{}",
    }
    fuzzer = CacheFuzzer(entries, tmp_path)
    for number in range(60):
        fuzzer.check(number, SEED)


@pytest.mark.slow
def test_tables_of_damaged_datasets_are_refused_with_one_message(
    spec: Spec, sensor_frames_of: SensorFramesOf, tmp_path: Path
) -> None:
    scenario = write_scenario(tmp_path / "whole", spec, sensor_frames_of)
    targets = ["manifest.json", "+101/000060.yaml", "+101/000060.pcd", "+101/000060_objects.json"]
    for number, target in enumerate(targets):
        copy = shutil.copytree(scenario, tmp_path / str(number) / scenario.name)
        rng = create_generator(SEED, "command mutation", number)
        (copy / target).write_bytes(damage_bytes((copy / target).read_bytes(), rng))
        code = "from advercity.cli import main; main()"
        options = ["stats", str(copy.parent), "--output", str(tmp_path / f"out{number}")]
        ran = subprocess.run(
            [sys.executable, "-W", "ignore", "-c", code, *options],
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
        assert ran.returncode in (0, 1, 2), ran.stderr
        assert "Traceback" not in ran.stderr


def test_damaged_recordings_are_read_or_refused(tmp_path: Path) -> None:
    fuzzer = RecordingFuzzer(tmp_path)
    outcomes = [fuzzer.check(number, SEED) for number in range(30)]
    assert {outcome for kind, outcome in outcomes if "command" not in kind} == {"read", "refused"}


@pytest.mark.sumo
def test_damaged_maps_are_read_or_refused(tmp_path: Path) -> None:
    fuzzer = MapFuzzer(tmp_path)
    assert {fuzzer.check(number, SEED)[1] for number in range(40)} == {"read", "refused"}


def test_damaged_predictions_are_read_or_refused(two_roads: Path, tmp_path: Path) -> None:
    fuzzer = PredictionFuzzer(two_roads, tmp_path)
    assert {fuzzer.check(number, SEED)[1] for number in range(30)} == {"read", "refused"}


def test_damaged_exports_are_verified_and_made_again_and_no_file_is_lost(
    two_roads: Path, tmp_path: Path
) -> None:
    fuzzer = ExportFuzzer(two_roads, tmp_path, ("calibration",))
    assert {fuzzer.check(number, SEED)[1] for number in range(20)} == {"read", "refused"}
