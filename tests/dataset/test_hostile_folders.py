"""Folders that were made to harm: nothing hangs, and nothing elsewhere is read or written."""

import json
import os
import shutil
from pathlib import Path
from typing import Any

import pytest
from advercity_dsl import Spec

from advercity.dataset.scenario_folders import MANIFEST_FILE, find_staging_folder
from advercity.dataset.verification import restore_files, verify_dataset, verify_scenario
from advercity.dataset.writer import ScenarioWriter
from advercity.errors import RunError
from tests.builders import SensorFramesOf, identify
from tests.dataset.conftest import LENGTH

CLOUD = "+101/000060.pcd"


def doctor_manifest(scenario: Path, path: str, record: dict[str, Any]) -> None:
    document = json.loads((scenario / MANIFEST_FILE).read_text())
    document["files"][path] = document["files"].get(path, {}) | record
    (scenario / MANIFEST_FILE).write_text(json.dumps(document))


@pytest.mark.parametrize("kind", ["pipe", "device"])
def test_a_recorded_file_that_is_none_is_damage_and_is_not_opened(
    scenario: Path, kind: str
) -> None:
    (scenario / CLOUD).unlink()
    if kind == "pipe":
        os.mkfifo(scenario / CLOUD)
    else:
        (scenario / CLOUD).symlink_to("/dev/zero")
    doctor_manifest(scenario, CLOUD, {"size": 0})
    (problem,) = verify_dataset(scenario)
    assert (problem.path, problem.kind) == (CLOUD, "changed")


@pytest.mark.parametrize(
    "line",
    [
        *(
            {path: {"size": 1, "sha256": "0" * 64, "frame": frame}}
            for path, frame in [("../x", None), ("\0", 1), (CLOUD, -5), ("+101/000061.pcd", 10**9)]
        ),
        [],
        [{}, {}],
        [[]],
        None,
    ],
)
def test_a_doctored_journal_changes_nothing(scenario: Path, spec: Spec, line: object) -> None:
    before = (scenario / MANIFEST_FILE).read_bytes()
    journal = find_staging_folder(scenario) / "journal_0.jsonl"
    journal.parent.mkdir(parents=True)
    journal.write_text(json.dumps(line) + "\n")
    assert verify_dataset(scenario) == []
    with ScenarioWriter(scenario.parent, spec, identify(spec), length=LENGTH) as writer:
        assert writer.done_frames == {0}
        writer.finish()
    assert (scenario / MANIFEST_FILE).read_bytes() == before


def test_a_manifest_with_frames_beyond_its_end_is_refused(scenario: Path) -> None:
    doctor_manifest(scenario, CLOUD, {"frame": 10**9})
    with pytest.raises(RunError, match=r"000060\.pcd is of frame 1000000000 of 2"):
        verify_dataset(scenario)


def test_a_recorded_file_that_no_run_writes_is_not_said_to_be_repaired(
    scenario: Path, sensor_frames_of: SensorFramesOf
) -> None:
    (scenario / "notes.txt").write_text("mine")
    doctor_manifest(scenario, "notes.txt", {"size": 1, "sha256": "0" * 64, "frame": 0})
    left = restore_files(scenario, verify_scenario(scenario), sensor_frames_of)
    assert [(problem.path, problem.kind) for problem in left] == [("notes.txt", "changed")]
    assert (scenario / "notes.txt").read_text() == "mine"


@pytest.mark.parametrize("kind", ["pipe", "folder", "file in place of the folder"])
def test_a_lock_that_is_none_hangs_no_command(scenario: Path, spec: Spec, kind: str) -> None:
    staging = find_staging_folder(scenario)
    if kind == "file in place of the folder":
        staging.parent.write_text("mine")
    else:
        staging.mkdir(parents=True)
        (os.mkfifo if kind == "pipe" else os.mkdir)(staging / "lock")
    assert verify_dataset(scenario) == []
    with pytest.raises(RunError, match=r"\.staging/"):
        ScenarioWriter(scenario.parent, spec, identify(spec), length=LENGTH).__enter__()


def test_unfinished_files_are_not_written_through_a_link(
    scenario: Path, spec: Spec, tmp_path: Path
) -> None:
    mine = tmp_path / "mine" / "000061.pcd.advercity-partial"
    mine.parent.mkdir()
    mine.write_text("mine")
    incoming = find_staging_folder(scenario) / "incoming"
    incoming.mkdir(parents=True)
    (incoming / "+101").symlink_to(mine.parent)
    with pytest.raises(RunError, match=r"incoming/\+101: is a link to "):
        ScenarioWriter(scenario.parent, spec, identify(spec), length=LENGTH).__enter__()
    assert mine.read_text() == "mine"


@pytest.mark.parametrize("place", ["journal", "unfinished file"])
def test_a_link_to_itself_is_one_message(
    scenario: Path, spec: Spec, sensor_frames_of: SensorFramesOf, place: str
) -> None:
    with ScenarioWriter(scenario.parent, spec, identify(spec), length=LENGTH) as writer:
        writer.write_frame(1, sensor_frames_of(1))
        journal = find_staging_folder(scenario) / "journal_0.jsonl"
        announced, _ = journal.read_bytes().splitlines(keepends=True)
        killed = shutil.copytree(scenario.parent, scenario.parent.with_name("killed"))
    scenario = killed / scenario.name
    journal = find_staging_folder(scenario) / "journal_0.jsonl"
    journal.write_bytes(announced)
    loop = journal if place == "journal" else scenario / "+101" / "000061.pcd"
    loop.unlink()
    loop.symlink_to(loop.name)
    with pytest.raises(RunError, match=rf"{loop.name}: cannot be read: Too many levels"):
        verify_scenario(scenario)
    with (
        pytest.raises(RunError, match="Too many levels of symbolic links"),
        ScenarioWriter(killed, spec, identify(spec), length=LENGTH),
    ):
        pass
    assert loop.is_symlink()
