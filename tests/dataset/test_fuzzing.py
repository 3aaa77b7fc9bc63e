"""Damages the files of a dataset, traces and caches at random, and reads them as users do."""

import json
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from advercity_dsl import Spec

import advercity
from advercity.dataset.agent_view import AgentView
from advercity.dataset.facts import collect_scenario_facts
from advercity.dataset.index import DatasetIndex, IndexWriter
from advercity.dataset.partial_files import FileRecord, append_to_journal
from advercity.dataset.scenario_folders import find_staging_folder
from advercity.dataset.verification import verify_dataset
from advercity.errors import AdvercityError
from advercity.frames import STATE_DTYPE, Actor, Trace
from advercity.pipeline.cache_entries import load_or_build_entry
from advercity.randomness import create_generator
from advercity.scene.world_storage import load_world, save_world
from advercity.world import World
from tests.builders import SensorFramesOf, write_scenario
from tests.compiler.test_fuzzing import load_script

SCRIPT = load_script()
ODD_BYTES = (
    *(b"", b"\0" * 64, b"\xff\xfe", b"[" * 100_000, b"{" * 100_000, b'{"a":' * 100_000),
    *(b"- " * 50_000, b"? " * 50_000, b"&a [*a]", b"<<: *a", b"!!python/none x", b"NaN"),
    *(b"1e999", b"9" * 5000, b"null", b"[]", b"{}", b'""', b"-1", b"2026-99-99", b"1:59" * 999),
)
Read = Callable[[Path], object]


def damage(raw: bytes, rng: np.random.Generator) -> bytes:
    """Return the bytes with one to four damages."""
    for _ in range(int(rng.integers(1, 5))):
        begin, end = sorted(int(at) for at in rng.integers(len(raw) + 1, size=2))
        short = min(end, begin + int(rng.integers(1, 9)))
        odd = ODD_BYTES[int(rng.integers(len(ODD_BYTES)))]
        match int(rng.integers(6)):
            case 0:
                raw = raw[:begin]
            case 1:
                raw = raw[:begin] + odd + raw[short:]
            case 2:
                raw = raw[:begin] + rng.bytes(short - begin) + raw[short:]
            case 3:
                raw = raw[:begin] + raw[short:]
            case 4:
                raw = raw[:end] + raw[begin:end] + raw[end:]
            case _:
                raw = raw[:begin] + bytes(end - begin) + raw[end:]
    return raw


def read_view(view: AgentView) -> None:
    fields: tuple[Callable[[], object], ...] = (
        *(lambda: view.boxes, lambda: view.extras, lambda: view.cloud, lambda: view.speed_m_s),
        *(lambda: view.world_from_agent, lambda: view.world_from_lidar, lambda: view.image(0)),
        *(lambda: view.world_from_camera(0), lambda: view.intrinsic(0), lambda: view.semantic(0)),
        *(lambda: view.depth(0), lambda: view.bird_view("dynamic"), lambda: view.measured),
    )
    for read in fields:
        with suppress(AdvercityError):
            read()


def read_dataset(folder: Path) -> None:
    """Read everything of a dataset; each reader may refuse with a message, nothing else."""
    with suppress(AdvercityError):
        for frame in islice(advercity.open_dataset(folder), 3):
            read_view(frame["cav1"])
    with suppress(AdvercityError):
        verify_dataset(folder)
    with suppress(AdvercityError):
        DatasetIndex.load(folder)
    for scenario in folder.glob("*/manifest.json"):
        with suppress(AdvercityError):
            collect_scenario_facts(scenario.parent)


@pytest.fixture(scope="module")
def dataset(
    tmp_path_factory: pytest.TempPathFactory, spec: Spec, sensor_frames_of: SensorFramesOf
) -> Path:
    folder = tmp_path_factory.mktemp("fuzzed")
    scenario = write_scenario(folder, spec, sensor_frames_of)
    index = IndexWriter(folder, [spec])
    index.record_result(spec.id, failed=False)
    files = json.loads((scenario / "manifest.json").read_text())["files"]
    find_staging_folder(scenario).mkdir(parents=True, exist_ok=True)
    records = {path: FileRecord(**record) for path, record in islice(files.items(), 20)}
    append_to_journal(scenario, 0, records, moved=False)
    append_to_journal(scenario, 0, records, moved=True)
    return folder


def list_targets(dataset: Path) -> list[Path]:
    """One file of each kind; those that others depend on come more often."""
    (scenario,) = (path.parent for path in dataset.glob("*/manifest.json"))
    agent = scenario / "+101"
    targets = [path for path in sorted(agent.iterdir()) if "camera" not in path.name]
    targets += [agent / "000060_camera0.png", dataset / "index.json"]
    journal = next(find_staging_folder(scenario).glob("journal_*"))
    return [*targets, *[agent / "000060.yaml", scenario / "manifest.json", journal] * 3]


def check_dataset(number: int, dataset: Path) -> None:
    rng = create_generator(3, "dataset mutation", number)
    targets = list_targets(dataset)
    target = targets[int(rng.integers(len(targets)))]
    whole = target.read_bytes()
    try:
        is_text = target.suffix in (".yaml", ".json", ".jsonl") and rng.random() < 0.5
        target.write_bytes(SCRIPT.mutate(whole.decode(), rng) if is_text else damage(whole, rng))
        with SCRIPT.time_limit():
            read_dataset(dataset)
    finally:
        target.write_bytes(whole)


def write_trace(path: Path) -> None:
    states = np.zeros(40, STATE_DTYPE)
    states["tick"] = np.arange(40)
    actor = Actor(101, "car", "lincoln_mkz_2017", "car_paint_white", (4.9, 2.06, 1.51))
    signals = np.zeros((40, 1), np.uint8)
    Trace(0.1, 59, (actor,), states, ("north",), signals).save(path)


def write_world(path: Path) -> None:
    save_world(World("empty", (), {}, (), Path("road.net.xml")), path)


def read_network(path: Path) -> World:
    return load_world(path, Path("road.net.xml"))


def check_array_file(
    number: int, folder: Path, write: Callable[[Path], None], load: Read, *, cached: bool
) -> None:
    """Damage a trace or a world; in the cache it is made again, elsewhere refused."""
    rng = create_generator(3, "array mutation", number)
    path = folder / "entry.npz"
    if cached:
        load_or_build_entry("worlds/entry.npz", write, load)
        path = next(folder.rglob("entry.npz"))
    else:
        write(path)
    path.write_bytes(damage(path.read_bytes(), rng))
    with SCRIPT.time_limit():
        if cached:
            load_or_build_entry("worlds/entry.npz", write, load)
        else:
            with suppress(AdvercityError):
                load(path)


def run_mutations(
    numbers: Iterator[int], dataset: Path, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ADVERCITY_CACHE", str(folder))
    for number in numbers:
        match number % 10:
            case 0:
                check_array_file(number, folder, write_trace, Trace.load, cached=False)
            case 1:
                check_array_file(number, folder, write_world, read_network, cached=True)
            case _:
                check_dataset(number, dataset)


def test_damaged_files_of_a_dataset_are_read_or_refused(
    dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_mutations(iter(range(100)), dataset, tmp_path, monkeypatch)


@pytest.mark.slow
def test_thousands_of_damaged_files_are_read_or_refused(
    dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_mutations(iter(range(100, 6000)), dataset, tmp_path, monkeypatch)


@pytest.mark.slow
@pytest.mark.parametrize("command", ["verify", "stats", "sheet"])
def test_commands_refuse_damaged_datasets_with_one_message(
    command: str, dataset: Path, tmp_path: Path
) -> None:
    for number in range(5):
        copy = tmp_path / str(number)
        shutil.copytree(dataset, copy)
        rng = create_generator(3, "command mutation", number)
        target = list_targets(copy)[-1 - number]
        target.write_bytes(damage(target.read_bytes(), rng))
        options = ["--output", str(tmp_path / f"out{number}")] if command != "verify" else []
        code = "from advercity.cli import main; main()"
        ran = subprocess.run(
            [sys.executable, "-W", "ignore", "-c", code, command, str(copy), *options],
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
        assert ran.returncode in (0, 1, 2), ran.stderr
        assert "Traceback" not in ran.stderr
