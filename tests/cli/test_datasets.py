"""Commands on datasets: what they refuse, write and print."""

import errno
import os
import shutil
from pathlib import Path

import pytest
from advercity_dsl import Spec

from advercity.dataset.index import IndexWriter
from advercity.dataset.writer import ScenarioWriter
from tests.builders import TWO_ROADS_FRAMES, identify
from tests.command_line import Command


@pytest.mark.parametrize("name", ["stats", "video", "sheet", "view"])
def test_commands_explain_a_scenario_without_frames(
    advercity: Command,
    tmp_path: Path,
    spec: Spec,
    name: str,
) -> None:
    with ScenarioWriter(tmp_path, spec, identify(spec), length=TWO_ROADS_FRAMES) as writer:
        writer.finish()
    code, out, err = advercity(name, tmp_path / spec.id)
    assert (code, out) == (2, "")
    assert err.endswith("no frames here yet; `advercity run` with its spec makes them\n")
    assert len(err.splitlines()) == 1


def test_verify_names_the_scenarios_that_the_index_lacks(
    advercity: Command,
    tmp_path: Path,
    spec: Spec,
) -> None:
    with ScenarioWriter(tmp_path, spec, identify(spec), length=TWO_ROADS_FRAMES) as writer:
        writer.finish()
    IndexWriter(tmp_path, [spec]).record_result(spec.id, failed=False)
    shutil.copytree(tmp_path / spec.id, tmp_path / "copy")
    code, _, said = advercity("verify", tmp_path)
    assert code == 0
    assert said.endswith("; 1 scenario: 1 partial; not in index.json: copy\n")


@pytest.mark.parametrize("name", ["verify", "repair", "stats", "video", "split", "sheet"])
def test_commands_refuse_a_folder_without_a_dataset(
    advercity: Command, tmp_path: Path, name: str
) -> None:
    code, out, err = advercity(name, tmp_path)
    assert (code, out) == (2, "")
    assert "so not a dataset" in err
    assert len(err.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["verify", "repair", "stats", "video", "split", "sheet", "view"])
def test_commands_distinguish_a_missing_folder_and_a_file(
    advercity: Command, tmp_path: Path, name: str
) -> None:
    notes = tmp_path / "notes"
    notes.touch()
    missing = advercity(name, tmp_path / "no")
    file = advercity(name, notes)
    assert missing == (
        2,
        "",
        f"error: {tmp_path / 'no'}: no such folder; is the path right?\n",
    )
    assert file == (2, "", f"error: {notes}: is a file; name the folder of a dataset\n")


def test_verify_escapes_the_names_of_foreign_files(
    advercity: Command,
    two_roads: Path,
    tmp_path: Path,
) -> None:
    scenario = shutil.copytree(
        two_roads / "ui_clear_night_dense", tmp_path / "ui_clear_night_dense"
    )
    Path(os.fsdecode(bytes(scenario) + b"/\x1b[2J\n\xff")).touch()
    code, out, err = advercity("verify", scenario)
    assert (code, err) == (0, "every file is as its manifest says\n")
    assert out == f"{scenario}/\\x1b[2J\\n\\udcff: not part of the dataset\n"


def test_statistics_of_a_dataset_with_a_damaged_manifest_are_refused_with_its_place(
    advercity: Command, tmp_path: Path
) -> None:
    manifest = tmp_path / "scenario" / "manifest.json"
    manifest.parent.mkdir()
    manifest.write_bytes(b'{"identity": "\xff"}')
    code, out, err = advercity("stats", tmp_path, "--output", tmp_path / "out")
    assert (code, out) == (2, "")
    assert err == f"error: {manifest}:1:15: is not UTF-8 text; save it as UTF-8\n"


@pytest.mark.parametrize("name", ["sheet", "view"])
def test_commands_on_one_scenario_list_those_of_a_dataset(
    advercity: Command,
    two_roads: Path,
    name: str,
) -> None:
    code, out, err = advercity(name, two_roads)
    assert (code, out) == (2, "")
    assert "name one of its scenarios: rcnj_fog_day_sparse, ui_clear_night_dense" in err


@pytest.mark.parametrize("name", ["stats", "video", "split"])
def test_an_output_that_is_a_file_is_refused(
    advercity: Command,
    two_roads: Path,
    tmp_path: Path,
    name: str,
) -> None:
    notes = tmp_path / "notes"
    notes.write_text("mine")
    code, out, err = advercity(name, two_roads, "--output", notes)
    assert (code, out) == (2, "")
    assert "is a file" in err
    assert notes.read_text() == "mine"


def test_commands_print_what_they_wrote(
    advercity: Command,
    tmp_path: Path,
    two_roads: Path,
) -> None:
    code, out, err = advercity("split", two_roads, "--output", tmp_path)
    assert (code, err) == (0, "")
    assert out.splitlines() == [
        f"{tmp_path / 'train'}: 0",
        f"{tmp_path / 'validate'}: 1",
        f"{tmp_path / 'test'}: 1",
    ]
    videos = tmp_path / "videos"
    code, out, _ = advercity("video", tmp_path / "test", "--kind", "lidar", "--output", videos)
    assert (code, out.strip()) == (0, str(videos / "ui_clear_night_dense_lidar.mp4"))
    code, out, err = advercity("repair", two_roads)
    assert (code, out, err) == (0, "", "every file is as its manifest says\n")


@pytest.mark.parametrize("option", ["--train", "--validate", "--test"])
@pytest.mark.parametrize("road", ["../../evil", "rnj", "rcnj,,ui"])
def test_split_refuses_roads_that_are_none(
    advercity: Command, tmp_path: Path, two_roads: Path, option: str, road: str
) -> None:
    output = tmp_path / "splits"
    none = dict.fromkeys(("--train", "--validate", "--test"), "") | {option: road}
    options = [word for pair in none.items() for word in pair]
    code, out, err = advercity("split", two_roads, "--output", output, *options)
    assert (code, out, err.count("\n")) == (2, "", 1)
    wrong = "" if ",," in road else road
    assert f"no scenario of {two_roads} has the road '{wrong}'; it has rcnj, ui" in err
    assert not output.exists()


def test_split_takes_no_road_for_an_empty_split(
    advercity: Command, tmp_path: Path, two_roads: Path
) -> None:
    options = ("--train", "ui, rcnj", "--validate", "", "--test", "")
    code, out, _ = advercity("split", two_roads, "--output", tmp_path, *options)
    assert code == 0
    assert [line.rpartition(": ")[2] for line in out.splitlines()] == ["2", "0", "0"]


def test_a_folder_that_may_not_be_read_is_not_left_out_in_silence(
    advercity: Command, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, two_roads: Path
) -> None:
    """As for another user; the one who runs the tests may read all."""
    folder, may = two_roads / "ui_clear_night_dense", os.access

    def may_unless_there(path: str | Path, mode: int) -> bool:
        return path != folder and may(path, mode)

    monkeypatch.setattr(os, "access", may_unless_there)
    for arguments in (
        ("verify", two_roads),
        ("verify", folder),
        ("split", two_roads, "--output", tmp_path),
        ("view", folder),
    ):
        code, out, err = advercity(*arguments)
        assert (code, out) == (1, "")
        assert err == f"error: {folder}: cannot be read: Permission denied\n"


@pytest.mark.parametrize(
    "command", ["stats DATASET", "sheet DATASET/rcnj_fog_day_sparse", "new weather mine"]
)
def test_a_working_folder_that_is_gone_is_named_as_the_cause(
    advercity: Command,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    two_roads: Path,
    command: str,
) -> None:
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    code, _, err = advercity(*command.replace("DATASET", str(two_roads)).split())
    assert code in (1, 2)
    assert err.count("\n") == 1
    assert "the working folder has been deleted; change to one that exists" in err


def test_too_few_open_files_are_named_with_the_way_out(
    advercity: Command, monkeypatch: pytest.MonkeyPatch, two_roads: Path, tmp_path: Path
) -> None:
    def refuse(path: Path, **_: object) -> bytes:
        raise OSError(errno.EMFILE, os.strerror(errno.EMFILE), str(path))

    monkeypatch.setattr("advercity.dataset.manifest.read_bytes", refuse)
    code, _, err = advercity("split", two_roads, "--output", tmp_path)
    assert (code, err.count("\n")) == (1, 1)
    assert "manifest.json: cannot be read: Too many open files: allow more with `ulimit -n`" in err
