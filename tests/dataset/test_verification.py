"""What verify finds, restore mends; and a disk that fails leaves nothing half-written."""

import errno
import fcntl
import os
import resource
import shutil
import signal
from collections.abc import Callable
from pathlib import Path
from typing import IO

import pytest
from advercity_dsl import Spec

from advercity.dataset import partial_files
from advercity.dataset.verification import restore_files, verify_dataset, verify_scenario
from advercity.dataset.writer import ScenarioWriter
from advercity.errors import RunError
from advercity.sensors.sensor_frame import SensorFrame
from tests.builders import SensorFramesOf, identify

FRAMES = 2
Run = Callable[[Path], None]


@pytest.fixture(scope="module")
def run(spec: Spec, sensor_frames_of: SensorFramesOf) -> Run:
    """Writes what is missing of the two-frame scenario."""

    def run(root: Path) -> None:
        identity = identify(spec)
        with ScenarioWriter(root, spec, identity, length=FRAMES) as writer:
            for index in sorted(set(range(FRAMES)) - writer.done_frames):
                writer.write_frame(index, sensor_frames_of(index))
            writer.finish()

    return run


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory, run: Run) -> Path:
    root = tmp_path_factory.mktemp("original") / "whole"
    run(root)
    return root


@pytest.fixture
def scenario(tmp_path: Path, original: Path, spec: Spec) -> Path:
    """A copy to be damaged."""
    return shutil.copytree(original, tmp_path / "whole") / spec.id


def tree(root: Path) -> dict[str, bytes]:
    return {
        path.relative_to(root).as_posix(): path.read_bytes()
        for path in root.rglob("*")
        if path.is_file()
    }


def flip(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def test_missing_and_changed_files_are_restored_and_no_other_is_touched(
    scenario: Path, original: Path, sensor_frames_of: SensorFramesOf, spec: Spec
) -> None:
    (scenario / "102" / "000061.pcd").unlink()
    changed = scenario / "-1" / "000061_camera3.png"
    flip(changed)
    flipped = changed.read_bytes()
    (scenario / "data_protocol.yaml").unlink()
    untouched = {
        path: path.stat().st_mtime_ns for path in scenario.glob("+101/*") if path.is_file()
    }
    asked: list[int] = []

    def readings(frame: int) -> tuple[SensorFrame, ...]:
        asked.append(frame)
        return sensor_frames_of(frame)

    assert restore_files(scenario, verify_scenario(scenario), readings) == []
    assert asked == [1]
    kept = scenario / "-1" / "000061_camera3.png.kept"
    assert kept.read_bytes() == flipped
    kept.unlink()
    assert tree(scenario) == tree(original / spec.id)
    assert {path: path.stat().st_mtime_ns for path in untouched} == untouched
    assert [path.name for path in scenario.parent.iterdir()] == [scenario.name]


def test_an_unknown_file_is_kept_and_reported(
    scenario: Path, sensor_frames_of: SensorFramesOf
) -> None:
    (scenario / "103" / "notes.txt").write_text("mine")
    (problem,) = restore_files(scenario, verify_scenario(scenario), sensor_frames_of)
    assert (problem.path, problem.kind) == ("103/notes.txt", "foreign")
    assert (scenario / "103" / "notes.txt").read_text() == "mine"


def test_content_that_differs_from_the_manifest_is_not_written(
    scenario: Path, sensor_frames_of: SensorFramesOf
) -> None:
    (scenario / "102" / "000061.pcd").unlink()
    with pytest.raises(RunError, match="its new content differs from the manifest"):
        restore_files(
            scenario, verify_scenario(scenario), lambda frame: sensor_frames_of(frame + 1)
        )
    assert not (scenario / "102" / "000061.pcd").exists()


def test_a_scenario_that_is_being_written_is_not_restored(
    scenario: Path,
    sensor_frames_of: SensorFramesOf,
    spec: Spec,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(partial_files, "LOCK_TIMEOUT_S", 0.2)
    identity = identify(spec)
    with (
        ScenarioWriter(scenario.parent, spec, identity, length=FRAMES),
        pytest.raises(RunError, match="another run is writing"),
    ):
        restore_files(scenario, (), sensor_frames_of)


def test_a_scenario_that_is_being_written_is_said_to_be_and_the_run_goes_on(
    scenario: Path, sensor_frames_of: SensorFramesOf, spec: Spec
) -> None:
    """Only that problem, although a file is missing; afterwards every file counts again."""
    next(scenario.rglob("*.pcd")).unlink()
    with ScenarioWriter(scenario.parent, spec, identify(spec), length=FRAMES) as writer:
        (told,) = verify_dataset(scenario.parent)
        assert str(told) == f"{scenario}: a run is writing it; verify it when the run has ended"
        writer.finish()
    assert all(problem.kind == "missing" for problem in verify_dataset(scenario.parent))


def in_a_child(act: Callable[[], object], prepare: Callable[[], object]) -> str:
    """Text of the RunError that `act` raises in a process of its own; other errors are none."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        message = ""
        try:
            prepare()
            act()
        except RunError as error:
            message = str(error)
        os.write(writing, message.encode())
        os._exit(0)
    os.close(writing)
    with os.fdopen(reading) as stream:
        message = stream.read()
    os.waitpid(child, 0)
    return message


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_file_over_the_size_limit_is_reported_and_the_frame_is_absent(
    tmp_path: Path, original: Path, run: Run, spec: Spec
) -> None:
    """As on a full disk, some bytes of a file are written and the rest are not."""

    def limit() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        sizes = [path.stat().st_size for path in (original / spec.id).rglob("000060_camera*")]
        resource.setrlimit(resource.RLIMIT_FSIZE, (min(sizes) // 2, resource.RLIM_INFINITY))

    root = tmp_path / "full"
    message = in_a_child(lambda: run(root), limit)
    assert "File too large: make room or choose another `output`" in message
    assert not list((root / spec.id).glob("*/*"))
    run(root)
    assert tree(root) == tree(original)


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_read_only_folder_is_reported(tmp_path: Path, run: Run) -> None:
    """Root may write anywhere, so the child gives up its rights."""
    root = tmp_path / "read_only"
    root.mkdir(mode=0o555)
    unprivileged = 65_534
    message = in_a_child(
        lambda: run(root),
        lambda: os.geteuid() == 0 and (os.setgid(unprivileged), os.setuid(unprivileged)),
    )
    assert f"{root}" in message
    assert "Permission denied" in message
    assert not list(root.iterdir())


def test_a_folder_that_cannot_be_read_is_not_said_to_be_empty(
    scenario: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As for another user; the one who runs the tests may read all."""
    folder, scan = scenario / "102", os.scandir

    def scan_or_refuse(path: str | Path) -> object:
        if Path(path) == folder:
            raise PermissionError(errno.EACCES, "Permission denied", str(path))
        return scan(path)

    monkeypatch.setattr(os, "scandir", scan_or_refuse)
    with pytest.raises(RunError, match=f"^{folder}: cannot be read: Permission denied"):
        verify_dataset(scenario)


def test_a_lock_is_on_the_file_that_other_processes_see(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The last owner of the lock may delete the file after it was opened here."""
    path, flock = tmp_path / "lock", fcntl.flock
    owners = ["last"]

    def end_owner(stream: IO[bytes], kind: int) -> None:
        if owners:
            owners.clear()
            path.unlink()
        flock(stream, kind)

    monkeypatch.setattr(fcntl, "flock", end_owner)
    with partial_files.lock_file(path) as stream:
        assert os.path.samestat(os.fstat(stream.fileno()), path.stat())
