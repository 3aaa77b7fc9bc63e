import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

import psutil
import pytest
from advercity_dsl import Spec

from advercity.compiler import write_specs
from advercity.dataset.index import DatasetIndex
from advercity.dataset.manifest import Manifest
from advercity.dataset.partial_files import lock_file
from advercity.dataset.scenario_folders import find_staging_folder
from advercity.dataset.verification import verify_dataset
from advercity.dataset.writer import FrameWriter, ScenarioWriter
from advercity.errors import BackendError, InputError, RunError
from advercity.pipeline import (
    Progress,
    ResourceLimits,
    RunOptions,
    RunResources,
    ScenarioResult,
    preparation,
    raise_failures,
    run_scenarios,
)
from advercity.pipeline.executors import run_batch
from advercity.pipeline.preparation import resolve_backend
from advercity.pipeline.progress import ignore_progress
from advercity.pipeline.scenario import join_scenario, run_scenario
from advercity.rendering.backend import Capabilities
from advercity.run_options import (
    ProfileName,
    format_byte_size,
    format_duration,
    parse_byte_size,
    parse_duration,
)
from advercity.testing import FakeBackend, RecordingListener
from tests.builders import identify

OptionsFor = Callable[[Path], RunOptions]


class Killer:
    """Kills the worker that joined, once."""

    def __init__(self, claimed: Path) -> None:
        self._claimed = claimed
        self.seen: list[psutil.Process] = []

    def on_progress(self, progress: Progress) -> None:
        """Kill it when both have claimed a frame."""
        if not self.seen and self._claimed.exists() and len(list(self._claimed.iterdir())) > 1:
            # Other children, such as servers of other tests, may be older than the workers.
            workers = [one for one in psutil.Process().children() if is_worker(one)]
            _, *self.seen = sorted(workers, key=start_time)
            for process in self.seen:
                process.kill()

    def on_result(self, result: ScenarioResult) -> None:
        """Do nothing."""


def is_worker(process: psutil.Process) -> bool:
    return "advercity.pipeline.worker_process" in process.cmdline()


def start_time(process: psutil.Process) -> float:
    return process.create_time()


def claims(output: Path, spec: Spec) -> Path:
    return output / ".staging" / spec.id / "claims"


def tree(root: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(root)): path.read_bytes() for path in root.rglob("*") if path.is_file()
    }


@pytest.mark.sumo
def test_a_scenario_that_crashes_or_takes_too_much_memory_does_not_stop_the_others(
    few: list[Spec],
    stunts: Path,
    seen: Path,
    options: OptionsFor,
    listener: RecordingListener,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "4,7")
    (stunts / "1.crash").touch()
    (stunts / "2.hog").touch()
    chosen = options(tmp_path / "output")
    limits = ResourceLimits(memory_bytes=1_000_000_000)
    results = run_scenarios(few, chosen, listener=listener, resources=RunResources(2, limits))
    assert [result.scenario for result in results] == [spec.id for spec in few]
    errors = sorted(str(result.error) for result in results if result.error)
    assert len(errors) == 2
    assert "more than the 1.0 GB allowed for it; raise `max_memory_bytes`" in errors[0]
    assert errors[1].startswith("worker process ended (killed by SIGSEGV) in starting 0")
    with pytest.raises(RunError, match="2 of 3 scenarios failed"):
        raise_failures(results)
    good = [result for result in results if result.error is None]
    for result in good:
        folder = tmp_path / "output" / result.scenario
        files = [path for path in folder.rglob("*") if path.is_file()]
        assert result.frames == 1
        assert result.size_bytes == sum(
            path.stat().st_size for path in files if path.name != "manifest.json"
        )
        assert 50e6 < result.peak_memory_bytes < 1e9
    assert len(listener.results) == 3
    again = run_scenarios(few, chosen, listener=listener, resources=RunResources(2))
    raise_failures(again)
    assert verify_dataset(tmp_path / "output") == []
    assert {path.name for path in (tmp_path / "output").iterdir()} == {
        *(spec.id for spec in few),
        "index.json",
    }
    assert {path.read_text() for path in seen.iterdir()} == {"4", "7"}


@pytest.mark.sumo
def test_a_refused_run_leaves_a_partial_scenario_partial_and_says_once_what_it_keeps(
    few: list[Spec],
    stunts: Path,
    options: OptionsFor,
    listener: RecordingListener,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
) -> None:
    spec, dataset = few[0], tmp_path / "output"
    with ScenarioWriter(dataset, spec, identify(spec), length=2) as writer:
        writer.finish()
    notes = find_staging_folder(dataset / spec.id) / "notes.txt"
    notes.parent.mkdir(parents=True)
    notes.write_text("mine")
    (result,) = run_scenarios([spec], options(dataset), listener=listener)
    assert "was made from another spec, version or device" in str(result.error)
    (message,) = caplog.messages
    assert message.startswith(f"{notes.parent}: 1 file kept, not written by this version; delete")
    index = DatasetIndex.load(dataset)
    assert index is not None
    assert index.scenarios[spec.id].state == "partial"


@pytest.mark.sumo
def test_a_worker_that_fails_while_it_is_looked_at_has_failed(
    few: list[Spec],
    stunts: Path,
    options: OptionsFor,
    listener: RecordingListener,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    (stunts / "0.crash").touch()
    looked_at = set[int]()
    look = os.waitid

    def look_late(kind: int, pid: int, options: int) -> os.waitid_result | None:
        """Find a process still alive the first time, and let it end right after."""
        if pid in looked_at:
            return look(kind, pid, options)
        look(kind, pid, os.WEXITED | os.WNOWAIT)
        return looked_at.add(pid)

    monkeypatch.setattr(os, "waitid", look_late)
    chosen = options(tmp_path / "output")
    (result,) = run_scenarios(few[:1], chosen, listener=listener, resources=RunResources(1))
    assert "killed by SIGSEGV" in str(result.error)


@pytest.mark.sumo
def test_several_workers_make_one_scenario_with_the_bytes_of_a_single_one(
    few: list[Spec],
    stunts: Path,
    seen: Path,
    options: OptionsFor,
    listener: RecordingListener,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Three workers make six frames, at least one each; each sees a GPU of its own."""
    frames = slice(0, 6)
    alone, shared = (replace(options(tmp_path / name), frames=frames) for name in ("one", "three"))
    raise_failures(run_scenarios(few[:1], alone, listener=listener))
    (alone_pid,) = seen.iterdir()
    alone_pid.unlink()
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "4,7,9")
    monkeypatch.setenv("MEET", f"{claims(tmp_path / 'three', few[0])}:3")
    (result,) = run_scenarios(few[:1], shared, listener=listener, resources=RunResources(3))
    raise_failures([result])
    assert result.frames == 6
    assert result.size_bytes == Manifest.load(tmp_path / "three" / few[0].id).size_bytes
    assert tree(tmp_path / "three") == tree(tmp_path / "one")
    assert sorted(path.read_text() for path in seen.iterdir()) == ["4", "7", "9"]
    phases = list(dict.fromkeys(progress.phase for progress in listener.progress))
    assert phases == ["traffic", "world", "renderer", "frames", "done"]
    seen_progress = [progress for progress in listener.progress if progress.phase == "frames"]
    assert all(progress.done <= progress.total == 6 for progress in seen_progress)


@pytest.mark.sumo
def test_a_run_whose_worker_is_killed_fails_and_the_next_one_resumes(
    few: list[Spec],
    stunts: Path,
    options: OptionsFor,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    chosen = replace(options(tmp_path / "output"), frames=slice(0, 6))
    claimed = claims(tmp_path / "output", few[0])
    monkeypatch.setenv("MEET", f"{claimed}:2")
    killer = Killer(claimed)
    (result,) = run_scenarios(few[:1], chosen, listener=killer, resources=RunResources(2))
    message = "worker 2 of 2: worker process ended (killed by SIGKILL)"
    assert str(result.error).startswith(message)
    assert psutil.wait_procs(killer.seen, timeout=60)[1] == []
    monkeypatch.delenv("MEET")
    (result,) = run_scenarios(few[:1], chosen, listener=killer, resources=RunResources(2))
    raise_failures([result])
    assert verify_dataset(tmp_path / "output") == []
    assert not (tmp_path / "output" / ".staging").exists()


def test_a_scenario_that_takes_too_long_is_killed_and_reported(
    few: list[Spec], stunts: Path, options: OptionsFor, listener: RecordingListener, tmp_path: Path
) -> None:
    (stunts / "1.hang").touch()
    chosen = options(tmp_path / "output")
    results = run_scenarios(
        few[:1],
        chosen,
        listener=listener,
        resources=RunResources(limits=ResourceLimits(time_s=0.5)),
    )
    with pytest.raises(RunError, match=r"took longer than 0:0.*`max_time_s`"):
        raise_failures(results)
    assert not (tmp_path / "output").exists()


@pytest.mark.sumo
def test_a_scenario_that_cannot_be_recorded_in_the_index_has_failed(
    few: list[Spec], stunts: Path, options: OptionsFor, listener: RecordingListener, tmp_path: Path
) -> None:
    staging = tmp_path / "output" / ".staging" / "index.json"
    staging.mkdir(parents=True)
    (staging / "incoming").touch()
    (result,) = run_scenarios(few[:1], options(tmp_path / "output"), listener=listener)
    assert result.frames == 1
    assert "index.json/incoming: File exists" in str(result.error)


def start_two_runs(specs: list[Spec], stunts: Path, stunt: str) -> subprocess.Popen[str]:
    """Start a run of two scenarios; return it when both do the stunt."""
    folder = stunts.parent
    write_specs(specs[:2], folder / "compiled")
    for name in ("1", "2"):
        (stunts / f"{name}.{stunt}").touch()
    process = subprocess.Popen(
        [
            *(sys.executable, "-c", "from advercity.cli import main; main()", "run"),
            *map(str, sorted((folder / "compiled").glob("*.json"))),
            *("--jobs", "2", "--backend", "stunts", "--profile", "preview", "--output", "output"),
        ],
        cwd=folder,
        stderr=subprocess.PIPE,
        text=True,
    )
    while any(stunts.iterdir()):
        assert process.poll() is None
        time.sleep(0.02)
    return process


def test_an_interrupted_run_without_a_frame_says_so_and_leaves_no_process_behind(
    few: list[Spec], stunts: Path, tmp_path: Path
) -> None:
    with start_two_runs(few, stunts, "hang") as process:
        children = psutil.Process(process.pid).children(recursive=True)
        assert len(children) == 2
        process.send_signal(signal.SIGINT)
        _, told = process.communicate(timeout=60)
    assert process.returncode == 130
    assert told.endswith("error: interrupted; no frame was finished\n")
    assert psutil.wait_procs(children, timeout=60)[1] == []
    assert not (tmp_path / "output").exists()


def test_an_interrupted_run_says_where_frames_are_and_how_to_go_on(
    few: list[Spec], stunts: Path, options: OptionsFor, listener: RecordingListener, tmp_path: Path
) -> None:
    raise_failures(run_scenarios(few[2:3], options(tmp_path / "output"), listener=listener))
    with start_two_runs(few, stunts, "hang") as process:
        process.send_signal(signal.SIGINT)
        _, told = process.communicate(timeout=60)
    assert process.returncode == 130
    assert told.endswith(
        "error: interrupted; finished frames are kept in output, and the same command makes the"
        " others\n"
    )


def test_workers_in_native_code_end_with_a_run_that_is_killed(
    few: list[Spec], stunts: Path
) -> None:
    with start_two_runs(few, stunts, "native") as process:
        children = psutil.Process(process.pid).children(recursive=True)
        process.kill()
        assert len(children) == 2
        left = psutil.wait_procs(children, timeout=2)[1]
        # Not every init process reaps at once.
        assert all(child.status() == psutil.STATUS_ZOMBIE for child in left)


@pytest.mark.sumo
def test_a_frame_that_no_worker_made_is_an_error(
    few: list[Spec],
    stunts: Path,
    options: OptionsFor,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    chosen = replace(options(tmp_path / "output"), frames=slice(0, 2))
    monkeypatch.setattr(FrameWriter, "claim_frame", lambda writer, frame: not frame)  # pyright: ignore
    with pytest.raises(RunError, match="no worker made frame 1"):
        run_scenario(few[0], chosen)
    assert Manifest.load(tmp_path / "output" / few[0].id).frames == (0,)


@pytest.mark.sumo
def test_a_worker_that_would_write_other_bytes_does_not_join(
    few: list[Spec], stunts: Path, options: OptionsFor, tmp_path: Path
) -> None:
    chosen = options(tmp_path / "output")
    scenario = run_scenario(few[0], chosen)
    before = tree(scenario)
    other = replace(chosen, scale=0.5, frames=slice(0, 2))
    with pytest.raises(RunError, match=r"its workers differ \(scale: 1.0, 0.5\); use `jobs` 1"):
        join_scenario(few[0], other, 1, ignore_progress)
    assert tree(scenario) == before


@pytest.mark.sumo
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_an_interrupted_run_of_several_workers_leaves_no_process_behind(
    few: list[Spec],
    stunts: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    number: signal.Signals,
) -> None:
    """One of them is stopped, so that it cannot end by itself."""
    with shared_run(few[0], tmp_path, monkeypatch) as (process, children):
        children[-1].suspend()
        process.send_signal(number)
        assert process.wait(60) == (130 if number == signal.SIGINT else -signal.SIGKILL)
        assert psutil.wait_procs(children, timeout=60)[1] == []


@pytest.mark.sumo
def test_a_scenario_is_locked_as_long_as_one_of_its_workers_lives(
    few: list[Spec],
    stunts: Path,
    options: OptionsFor,
    listener: RecordingListener,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with shared_run(few[0], tmp_path, monkeypatch) as (process, children):
        process.send_signal(signal.SIGSTOP)  # else it would end the other worker
        children[0].kill()
        monkeypatch.delenv("MEET")
        (result,) = run_scenarios(few[:1], options(tmp_path / "output"), listener=listener)
        assert "another run is writing this scenario" in str(result.error)
        process.kill()
        process.wait(60)
        assert psutil.wait_procs(children, timeout=60)[1] == []
    raise_failures(run_scenarios(few[:1], options(tmp_path / "output"), listener=listener))


def test_a_run_into_an_output_that_another_one_writes_is_refused_at_once(
    few: list[Spec], stunts: Path, options: OptionsFor, tmp_path: Path
) -> None:
    """Before any worker is started."""
    chosen = options(tmp_path / "output")
    staging = find_staging_folder(chosen.folder / few[1].id)
    began_s = time.monotonic()
    with lock_file(staging / "lock"), pytest.raises(RunError) as told:
        run_batch(few[:2], chosen)
    assert time.monotonic() - began_s < 3
    assert f"{few[1].id}: another run is writing this scenario" in str(told.value)
    assert not (chosen.folder / few[0].id).exists()


@contextmanager
def shared_run(
    spec: Spec, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> Generator[tuple[subprocess.Popen[bytes], list[psutil.Process]]]:
    """Start a run whose two workers wait in their first frames for ever; yield its processes."""
    write_specs([spec], folder / "compiled")
    claimed = claims(folder / "output", spec)
    monkeypatch.setenv("MEET", f"{claimed}:9")
    process = subprocess.Popen(
        [
            *(sys.executable, "-c", "from advercity.cli import main; main()", "run"),
            *(str(folder / "compiled" / f"{spec.id}.json"), "--output", str(folder / "output")),
            *("--jobs", "2", "--backend", "stunts", "--profile", "preview", "--scale", "1"),
        ],
        stderr=subprocess.DEVNULL,
    )
    children: list[psutil.Process] = []
    try:
        while not claimed.exists() or len(list(claimed.iterdir())) < 2:
            assert process.poll() is None
            time.sleep(0.02)
        children = sorted(psutil.Process(process.pid).children(), key=start_time)
        yield process, children
    finally:
        process.kill()
        process.wait()
        for child in children:
            with suppress(psutil.NoSuchProcess):
                child.kill()


def test_sizes_and_times_are_read_with_their_units() -> None:
    assert parse_byte_size("--max-memory", "1.5 GB") == 1_500_000_000
    assert parse_byte_size("--max-memory", "2GiB") == 2 * 2**30
    assert parse_duration("--max-time", "90 min") == 5400
    assert parse_duration("--max-time", "0.5h") == 1800
    assert (format_byte_size(3_440_000_000), format_byte_size(12)) == ("3.4 GB", "12 B")
    assert (format_duration(7), format_duration(12_345)) == ("0:07", "3:25:45")


@pytest.mark.parametrize("text", ["4", "GB", "-1 GB", "0 GB", "4 gigs", "1e9 B", ""])
def test_a_size_without_a_unit_is_bad_input(text: str) -> None:
    with pytest.raises(InputError, match=r"--max-memory .*write 4 GB"):
        parse_byte_size("--max-memory", text)


def test_a_run_is_refused_at_once_while_another_one_still_simulates(
    few: list[Spec], stunts: Path, options: OptionsFor, tmp_path: Path
) -> None:
    """Both hang before any file of a dataset is written."""
    with start_two_runs(few, stunts, "hang") as process:
        began_s = time.monotonic()
        try:
            with pytest.raises(RunError, match=f"{few[0].id}: another run is writing"):
                run_batch(few[:1], options(tmp_path / "output"))
            assert time.monotonic() - began_s < 3
        finally:
            process.terminate()
    assert not (tmp_path / "output").exists()


@pytest.mark.parametrize(
    ("profile", "has_gpu", "has_mitsuba", "chosen", "said"),
    [
        ("full", False, True, "mitsuba", "backend mitsuba: no device here traces rays"),
        ("full", False, False, "sapien", "it would take seconds (no LLVM library)"),
        ("full", True, True, "sapien", ""),
        ("preview", False, True, "sapien", ""),
        ("auto", False, True, "sapien", ""),
    ],
)
def test_auto_traces_with_mitsuba_where_no_gpu_does_and_says_so(
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
    *,
    profile: ProfileName,
    has_gpu: bool,
    has_mitsuba: bool,
    chosen: str,
    said: str,
) -> None:
    class Sapien(FakeBackend):
        def capabilities(self) -> Capabilities:
            return replace(super().capabilities(), ray_traced=True, hardware=has_gpu)

    class Mitsuba(FakeBackend):
        def capabilities(self) -> Capabilities:
            if not has_mitsuba:
                raise BackendError("no LLVM library")
            return super().capabilities()

    backends = {"sapien": Sapien, "mitsuba": Mitsuba}

    def load(name: str) -> FakeBackend:
        return backends[name]()

    monkeypatch.setattr(preparation, "load_backend", load)
    options = RunOptions(tmp_path, backend="auto", profile=profile)
    assert resolve_backend(options).backend == chosen
    assert said in caplog.text
    assert bool(caplog.text) == bool(said)
    assert resolve_backend(replace(options, backend="fake")).backend == "fake"


@pytest.mark.parametrize(("profile", "said"), [("auto", 1), ("preview", 0)])
def test_auto_says_once_that_it_took_the_preview(
    few: list[Spec],
    stunts: Path,
    options: OptionsFor,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
    profile: ProfileName,
    said: int,
) -> None:
    """The run ends at once by its time limit; what counts is what was said before."""
    chosen = replace(options(tmp_path / "output"), profile=profile)
    run_batch(few[:1], replace(chosen, max_time_s=0.001))
    assert caplog.text.count("profile preview: no device here traces rays in hardware") == said
