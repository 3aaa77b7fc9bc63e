"""What the system refuses is one line with its cause; what is no place for a dataset is refused."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from advercity_dsl import Spec

from advercity.errors import InputError, RunError
from advercity.pipeline import RunOptions, RunResources, run_scenarios
from advercity.pipeline.output_folder import check_output_folder
from advercity.testing import RecordingListener
from advercity.traffic.simulation import write_simulated_trace
from tests.command_line import Command

OptionsFor = Callable[[Path], RunOptions]


@pytest.mark.parametrize("inside", ["", "nhtsa", "nhtsa/roads"])
def test_a_library_is_no_place_for_a_dataset(library: Path, tmp_path: Path, inside: str) -> None:
    copy = shutil.copytree(library, tmp_path / "library")
    with pytest.raises(InputError, match=r"is a library, with .*\.yaml; name another folder"):
        check_output_folder(copy / inside)


def test_a_dataset_and_a_folder_of_other_things_are_places_for_one(
    two_roads: Path, tmp_path: Path
) -> None:
    (tmp_path / "notes.yaml").write_text("shopping: [milk]\nkind: of list\n")
    (tmp_path / "binary.yaml").write_bytes(bytes(range(256)))
    for folder in (two_roads, tmp_path, tmp_path / "new"):
        check_output_folder(folder)


@pytest.mark.parametrize("inside", ["", "+101", "new", "+101/new/deeper"])
def test_a_scenario_is_no_place_for_another_dataset(two_roads: Path, inside: str) -> None:
    message = rf"in a scenario .* write into that dataset, {two_roads}, or"
    with pytest.raises(InputError, match=message):
        check_output_folder(two_roads / "rcnj_fog_day_sparse" / inside)


def test_the_folder_of_unfinished_files_is_no_place_for_a_dataset(two_roads: Path) -> None:
    for inside in ("", "mine", "rcnj_fog_day_sparse/incoming"):
        with pytest.raises(InputError, match=f"among the unfinished files .* {two_roads}, or"):
            check_output_folder(two_roads / ".staging" / inside)


def test_the_root_and_the_home_folder_are_no_places_for_a_dataset(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "link").symlink_to("/")
    for path, name in (
        (Path("/"), "the root of the file system"),
        (tmp_path / "link", "the root of the file system"),
        (tmp_path, "your home folder"),
    ):
        with pytest.raises(InputError, match=f"is {name}; name a folder in it"):
            check_output_folder(path)
    check_output_folder(tmp_path / "output")
    (tmp_path / "index.json").touch()  # of a dataset that is there already, and goes on
    check_output_folder(tmp_path)


def test_a_link_to_nothing_is_no_place_for_a_dataset(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to("gone")
    with pytest.raises(InputError, match="link: is a link to gone, which is not there"):
        check_output_folder(tmp_path / "link")


def test_a_name_that_no_disk_takes_is_refused(tmp_path: Path) -> None:
    for path in (tmp_path / ("x" * 300), tmp_path / ("x" * 300) / "y"):
        with pytest.raises(InputError, match=r"`output` .*: File name too long") as caught:
            check_output_folder(path)
        assert len(str(caught.value)) < 120


@pytest.mark.parametrize(
    ("stunt", "message"),
    [
        ("1.memory", "out of memory: no memory is left; allow more, or use fewer `jobs`"),
        ("1.disk", "/somewhere: No space left on device"),
    ],
)
def test_a_worker_without_memory_or_disk_says_so_in_one_line(
    few: list[Spec],
    stunts: Path,
    options: OptionsFor,
    listener: RecordingListener,
    tmp_path: Path,
    stunt: str,
    message: str,
) -> None:
    (stunts / stunt).touch()
    (result,) = run_scenarios(few[:1], options(tmp_path / "output"), listener=listener)
    assert str(result.error) == message


def full_folder(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Have no temporary file take more than a few bytes, as on a disk that is nearly full."""
    folder.mkdir()
    monkeypatch.setenv("TMPDIR", str(folder))
    monkeypatch.setattr("tempfile.tempdir", "/dev/null")


def test_a_full_temporary_folder_is_named(
    few: list[Spec],
    stunts: Path,
    options: OptionsFor,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    full_folder(tmp_path / "full", monkeypatch)
    expected = rf"temporary folder {tmp_path}/full: .*; set TMPDIR to one with room"
    with pytest.raises(RunError, match=expected):
        run_scenarios(few[:1], options(tmp_path / "output"), resources=RunResources(1))
    with pytest.raises(RunError, match=expected):
        write_simulated_trace(few[0], tmp_path / "road.net.xml", tmp_path / "trace.npz")


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (MemoryError("Unable to allocate 4 GiB"), "out of memory: Unable to allocate 4 GiB; "),
        (OSError(28, "No space left on device", "/full"), "/full: No space left on device"),
        (OSError("Cannot call rmtree on a symbolic link"), "Cannot call rmtree on a symbolic link"),
    ],
)
def test_a_command_that_the_system_fails_says_so_in_one_line(
    monkeypatch: pytest.MonkeyPatch, advercity: Command, error: Exception, message: str
) -> None:
    def fail() -> None:
        raise error

    monkeypatch.setattr("advercity.pipeline.cache_entries.clear_cache", fail)
    code, _, said = advercity("cache", "clear")
    assert code == 1
    assert said.startswith(f"error: {message}")
    assert len(said.splitlines()) == 1
