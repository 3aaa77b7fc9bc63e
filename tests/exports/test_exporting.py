"""What all exports have in common: they resume, replace nothing of others, and can be verified."""

import errno
import hashlib
import json
import re
import shutil
import signal
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import pytest
from advercity_dsl import Spec
from advercity_exports import kitti
from advercity_exports.oxts import format_oxts

from advercity.atomic_files import format_partial_name, move_file
from advercity.compiler import write_specs
from advercity.dataset.agent_view import AgentView
from advercity.dataset.partial_files import lock_scenario
from advercity.dataset.reader import FrameView
from advercity.dataset.splits import link_splits
from advercity.dataset.writer import ScenarioWriter
from advercity.errors import InputError, RunError
from advercity.exports import export_folder
from advercity.exports.export_folder import verify_export
from advercity.exports.exporting import export_dataset
from advercity.exports.registry import load_export_formats
from advercity.pipeline.progress import Progress, ProgressCallback
from tests.builders import SensorFramesOf, identify, write_scenario
from tests.command_line import Command
from tests.dsl.test_sensor_kinds import install, run

IMAGE = "training/image_2/000004.png"
KILLED_EXPORT = """
import os, signal, sys
from pathlib import Path
from advercity.exports import export_folder
from advercity.exports.exporting import export_dataset

export_folder.move_file = lambda *paths: os.kill(os.getpid(), signal.SIGKILL)
export_dataset("kitti", Path(sys.argv[1]), Path(sys.argv[2]))
"""


@pytest.fixture
def dataset(two_roads: Path, tmp_path: Path) -> Path:
    """A copy of a dataset of two scenarios with three frames each."""
    return shutil.copytree(two_roads, tmp_path / "dataset")


def snapshot(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def test_an_unknown_format_is_answered_with_all_formats(
    advercity: Command, dataset: Path, tmp_path: Path
) -> None:
    ran = advercity("export", "xyzzy", dataset, "--output", tmp_path / "export")
    assert ran.code == 2
    assert all(name in ran.err for name in load_export_formats().found)


def test_an_export_is_complete_and_verified(
    advercity: Command, dataset: Path, tmp_path: Path
) -> None:
    output = tmp_path / "exports" / "kitti"
    done = advercity("export", "kitti", dataset, "--output", output)
    assert (done.code, done.out) == (0, f"{output}\n")
    assert "2 scenarios, 6 frames, 152 files" in done.err
    verified = advercity("verify", output)
    assert (verified.code, verified.err) == (0, "every file is as its manifest says\n")
    (output / IMAGE).write_bytes(b"x")
    (output / "training/calib/000002.txt").unlink()
    (output / "notes.txt").touch()
    damaged = advercity("verify", output)
    assert (damaged.code, damaged.out) == (1, f"{output}/notes.txt: not part of the dataset\n")
    assert f"{output}/training/calib/000002.txt: missing" in damaged.err
    assert f"{output}/{IMAGE}: changed" in damaged.err


@pytest.mark.parametrize("pieces", [1, 4])
def test_an_export_that_was_cut_short_ends_with_the_same_files(
    dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, pieces: int
) -> None:
    whole = snapshot(export_dataset("kitti", dataset, tmp_path / "exports" / "whole").output)
    output = tmp_path / "exports" / "cut"
    samples: list[str] = []

    def fail_after(frame: FrameView, view: AgentView) -> str:
        samples.append(view.agent.id)
        if len(samples) > 5 * pieces + 2:  # in the middle of a frame of five agents
            raise KeyboardInterrupt
        return format_oxts(frame, view)

    with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
        patched.setattr(kitti, "format_oxts", fail_after)
        export_dataset("kitti", dataset, output)
    problems, manifest = verify_export(output)
    assert (problems, manifest.complete, len(manifest.pieces)) == ([], False, pieces)
    reports: list[Progress] = []
    export_dataset("kitti", dataset, output, report=reports.append)
    assert snapshot(output) == whole
    counted = [one for one in reports if one.phase != "verify"]
    assert [one.done for one in counted if one.scenario.startswith("rcnj")][:3] == [1, 2, 3]


def test_frames_that_are_added_to_a_dataset_are_added_to_its_export(
    spec: Spec, sensor_frames_of: SensorFramesOf, tmp_path: Path
) -> None:
    dataset, output = tmp_path / "dataset", tmp_path / "exports" / "kitti"
    with ScenarioWriter(dataset, spec, identify(spec), length=2) as writer:
        writer.write_frame(0, sensor_frames_of(0))
        writer.finish()
    export_dataset("kitti", dataset, output)
    first = (output / IMAGE).stat()
    with ScenarioWriter(dataset, spec, identify(spec), length=2) as writer:
        writer.write_frame(1, sensor_frames_of(1))
        writer.finish()
    result = export_dataset("kitti", dataset, output)
    assert (result.frames, result.files) == (2, 52)
    assert (output / IMAGE).stat() == first
    assert len((output / "ImageSets/trainval.txt").read_text().split()) == 10


def test_files_of_others_are_kept_and_changed_ones_are_set_aside(
    dataset: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    output = tmp_path / "exports" / "kitti"
    before = snapshot(export_dataset("kitti", dataset, output).output)
    (output / "notes.txt").write_text("mine")
    (output / IMAGE).write_bytes(b"edited")
    export_dataset("kitti", dataset, output)
    after = snapshot(output)
    assert after.pop("notes.txt") == b"mine"
    assert after.pop(f"{IMAGE}.kept") == b"edited"
    assert after == before
    assert f"kept as {IMAGE}.kept" in caplog.text
    export_dataset("kitti", dataset, output, fresh=True)
    assert snapshot(output) == before | {"notes.txt": b"mine", f"{IMAGE}.kept": b"edited"}


def test_another_dataset_is_not_mixed_into_an_export(
    dataset: Path, tmp_path: Path, spec: Spec, sensor_frames_of: SensorFramesOf
) -> None:
    output = tmp_path / "exports" / "kitti"
    export_dataset("kitti", dataset / spec.id, output)
    before = snapshot(output)
    other = tmp_path / "other" / spec.id
    identity = identify(spec, device="another")
    with ScenarioWriter(other.parent, spec, identity, length=1) as writer:
        writer.write_frame(0, sensor_frames_of(0))
        writer.finish()
    with pytest.raises(RunError, match=f"{spec.id}: not in the dataset, or made again since"):
        export_dataset("kitti", other, output)
    assert snapshot(output) == before
    export_dataset("kitti", other, output, fresh=True)
    assert len(snapshot(output)) == 28
    assert verify_export(output)[0] == []


def test_a_link_in_an_export_is_not_followed(dataset: Path, tmp_path: Path) -> None:
    output = tmp_path / "exports" / "kitti"
    (tmp_path / "elsewhere").mkdir()
    export_dataset("kitti", dataset, output)
    shutil.rmtree(output / "training" / "oxts")
    (output / "training" / "oxts").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(RunError, match="is a link"):
        export_dataset("kitti", dataset, output)
    assert list((tmp_path / "elsewhere").iterdir()) == []


def test_a_linked_folder_of_an_export_is_read_and_not_written(
    dataset: Path, tmp_path: Path
) -> None:
    output, elsewhere = tmp_path / "exports" / "kitti", tmp_path / "elsewhere"
    export_dataset("kitti", dataset, output)
    for path in ("training/velodyne", "training"):  # a link through a link, too
        (output / path).rename(elsewhere.with_name(f"of_{Path(path).name}"))
        (output / path).symlink_to(elsewhere.with_name(f"of_{Path(path).name}"))
        assert verify_export(output)[0] == []
    (output / "training/velodyne/000002.bin").write_bytes(b"x")
    assert [one.path for one in verify_export(output)[0]] == ["training/velodyne/000002.bin"]
    before = snapshot(tmp_path)
    for fresh in (False, True):
        with pytest.raises(RunError, match="is a link"):
            export_dataset("kitti", dataset, output, fresh=fresh)
    assert snapshot(tmp_path) == before


def test_a_staging_folder_of_others_is_kept(dataset: Path, tmp_path: Path) -> None:
    output = tmp_path / "exports"
    staging = output / ".staging"
    staging.mkdir(parents=True)
    ours = format_partial_name("0" * 8, 1, "0" * 8)
    for name in ("journal.jsonl", "export.json", "lock", "notes.txt", ours, f"{ours[:-1]}x"):
        (staging / name).write_text("mine")
        with pytest.raises(InputError, match="not an export"):
            export_dataset("kitti", dataset, output)
        assert snapshot(output) == {f".staging/{name}": b"mine"}
        (staging / name).unlink()
    (tmp_path / "mine").mkdir()
    staging.rmdir()
    staging.symlink_to(tmp_path / "mine")
    with pytest.raises(InputError, match="not an export"):
        export_dataset("kitti", dataset, output)


def test_an_export_that_was_killed_before_its_manifest_is_continued(
    dataset: Path, tmp_path: Path
) -> None:
    output = tmp_path / "exports"
    killed = subprocess.run([sys.executable, "-c", KILLED_EXPORT, dataset, output], check=False)
    assert killed.returncode == -signal.SIGKILL
    (left,) = output.rglob("export.json")
    assert left.parent.parent == output / ".staging"
    export_dataset("kitti", dataset, output)
    assert verify_export(output)[0] == []
    assert not (output / ".staging").exists()


def test_verify_says_how_each_kind_of_damage_is_mended(
    advercity: Command, dataset: Path, tmp_path: Path
) -> None:
    output = tmp_path / "exports"
    before = snapshot(export_dataset("kitti", dataset, output).output)
    same_size = bytes(len(before[IMAGE]))
    (output / IMAGE).write_bytes(same_size)
    said = advercity("verify", output).err
    assert "delete changed files, and `advercity export` writes them again" in said
    assert "missing" not in said
    (output / IMAGE).unlink()
    said = advercity("verify", output).err
    assert "writes missing files again" in said and "changed" not in said
    export_dataset("kitti", dataset, output)
    assert snapshot(output) == before
    (output / IMAGE).write_bytes(same_size)
    export_dataset("kitti", dataset, output, fresh=True)
    assert snapshot(output) == before | {f"{IMAGE}.kept": same_size}


@pytest.mark.parametrize(
    "place",
    [
        *("", "kitti", "new/kitti", "ui_clear_night_dense/kitti", "link"),
        *(".staging/a/b/c", "ui_clear_night_dense/-1/a/b/kitti"),
    ],
)
@pytest.mark.parametrize("by_link", [False, True])
def test_nothing_is_exported_or_linked_into_a_dataset(
    advercity: Command, dataset: Path, tmp_path: Path, place: str, by_link: bool
) -> None:
    (tmp_path / "outside").mkdir()
    (dataset / "link").symlink_to(tmp_path / "outside")  # loaders follow it
    (tmp_path / "link").symlink_to(dataset)
    output = (tmp_path / "link" if by_link else dataset) / place
    before = snapshot(dataset)
    for command in (("export", "kitti"), ("split",)):
        done = advercity(*command, dataset, "--output", output)
        assert done.code == 2
        assert ": is in a dataset;" in done.err or ": is a dataset;" in done.err
    assert snapshot(dataset) == before
    assert list((tmp_path / "outside").iterdir()) == []


@pytest.mark.parametrize("place", ["kitti", "train/kitti", "test/new/kitti"])
def test_nothing_is_exported_among_splits(
    advercity: Command, dataset: Path, tmp_path: Path, place: str
) -> None:
    splits = tmp_path / "splits"
    link_splits(dataset, splits)
    assert "is in a dataset" in refuse(advercity, "kitti", dataset, "--output", splits / place)
    assert sorted(path.name for path in splits.iterdir()) == sorted(
        ("splits.json", "test", "train", "validate")
    )


def test_a_manifest_of_another_program_makes_no_dataset_of_a_folder(
    dataset: Path, tmp_path: Path
) -> None:
    (tmp_path / "site").mkdir()
    (tmp_path / "site" / "manifest.json").write_text('{"manifest_version": 3}')
    export_dataset("kitti", dataset / "ui_clear_night_dense", tmp_path / "exports" / "kitti")


def test_a_link_to_a_place_in_a_dataset_is_refused(
    advercity: Command, dataset: Path, tmp_path: Path
) -> None:
    (dataset / "kitti").mkdir()
    (tmp_path / "link").symlink_to(dataset / "kitti")
    for command in (("export", "kitti"), ("split",)):
        done = advercity(*command, dataset, "--output", tmp_path / "link")
        assert done.code == 2 and "is in a dataset" in done.err
    assert list((dataset / "kitti").iterdir()) == []


def refuse(advercity: Command, *arguments: str | Path) -> str:
    done = advercity("export", *arguments)
    assert (done.code, done.out) == (2, "")
    (line,) = done.err.splitlines()
    return line


def test_a_disk_that_refuses_is_said_to_keep_frames_only_if_there_are_any(
    dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(RunError, match=r"/proc/advercity: [^;]*: make it writable or") as error:
        export_dataset("kitti", dataset, Path("/proc/advercity"))
    assert "kept" not in str(error.value)

    def refuse(*paths: Path) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    export_dataset("kitti", dataset, output := tmp_path / "kitti")
    monkeypatch.setattr(export_folder, "write_file", refuse)
    with pytest.raises(RunError, match="Permission denied; finished frames are kept: make it"):
        export_dataset("kitti", dataset, output)


def test_bad_input_is_explained(advercity: Command, dataset: Path, tmp_path: Path) -> None:
    output = tmp_path / "exports" / "kitti"
    assert "no such format to export to; did you mean kitti?" in refuse(
        advercity, "kity", dataset, "--output", output
    )
    assert "no such folder" in refuse(advercity, "kitti", tmp_path / "x", "--output", output)
    assert "is in a dataset" in refuse(advercity, "kitti", dataset, "--output", dataset / "kitti")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").touch()
    assert "not an export" in refuse(advercity, "kitti", dataset, "--output", tmp_path / "mine")
    (dataset / "ui_clear_night_dense" / "-1" / "000061_camera0.png").unlink()
    missing = refuse(advercity, "kitti", dataset, "--output", output)
    assert missing.endswith(
        "-1/000061_camera0.png: missing; `advercity verify` lists all such files,"
        " `advercity repair` restores them"
    )
    assert not output.joinpath("training/velodyne/000023.bin").exists()


def test_files_that_were_edited_are_exported_if_that_is_allowed_and_recorded(
    advercity: Command, dataset: Path, tmp_path: Path
) -> None:
    output, scenario = tmp_path / "exports" / "kitti", dataset / "ui_clear_night_dense"
    point_cloud, labels = scenario / "-1" / "000061.pcd", scenario / "+101" / "000060.yaml"
    text = labels.read_text()
    speed = next(line for line in text.splitlines() if line.startswith("ego_speed:"))
    labels.write_text(text.replace(speed, "ego_speed: 12.5"))
    assert "--allow-edited exports them as they are" in refuse(
        advercity, "kitti", dataset, "--output", output
    )
    done = advercity("export", "kitti", dataset, "--output", output, "--allow-edited")
    assert done.code == 0, done.err
    assert f"{scenario}: 1 file was changed since the run, and exported as they are" in done.err
    manifest = json.loads((output / "export.json").read_text())
    digest = hashlib.sha256(labels.read_bytes()).hexdigest()
    assert manifest["edited"] == {"ui_clear_night_dense/+101/000060.yaml": digest}
    before = snapshot(output)
    assert advercity("export", "kitti", dataset, "--output", output, "--allow-edited").code == 0
    assert snapshot(output) == before
    labels.write_text(text.replace(speed, "ego_speed: 13.5"))
    again = advercity("export", "kitti", dataset, "--output", output, "--allow-edited")
    assert again.code == 0, again.err
    after = snapshot(output)
    oxts = "training/oxts/000015.txt"
    assert {path for path in before if after[path] != before[path]} == {"export.json", oxts}
    point_cloud.unlink()
    missing = refuse(advercity, "kitti", dataset, "--output", output, "--allow-edited")
    assert "000061.pcd: missing" in missing


def test_a_refused_export_leaves_the_former_one_as_it_was(
    advercity: Command, dataset: Path, tmp_path: Path
) -> None:
    output, labels = tmp_path / "exports", dataset / "ui_clear_night_dense" / "+101" / "000060.yaml"
    labels.write_text(labels.read_text() + "# corrected\n")
    command = ("openlabel", dataset, "--output", output)
    assert advercity("export", *command, "--allow-edited").code == 0
    (output / "notes.txt").write_text("mine")
    before = snapshot(output)
    for more in ((), ("--fresh",)):
        assert f"{labels}: changed" in refuse(advercity, *command, *more)
        assert snapshot(output) == before
    assert advercity("export", *command, "--allow-edited").code == 0
    assert snapshot(output) == before


def test_an_export_of_which_nothing_was_made_again_stays_one(dataset: Path, tmp_path: Path) -> None:
    output = tmp_path / "exports"
    before = snapshot(export_dataset("calibration", dataset, output).output)
    (output / "notes.txt").write_text("mine")
    with pytest.raises(KeyboardInterrupt):
        export_dataset("calibration", dataset, output, fresh=True, report=interrupt_at("export"))
    assert verify_export(output)[1].pieces == {}
    export_dataset("calibration", dataset, output)
    assert snapshot(output) == before | {"notes.txt": b"mine"}


def interrupt_at(phase: str) -> ProgressCallback:
    def report(progress: Progress) -> None:
        if progress.phase in (phase, "done"):
            raise KeyboardInterrupt

    return report


@pytest.mark.parametrize("moved", [3, 29], ids=["in the first piece", "in the second"])
def test_an_export_that_is_interrupted_while_files_are_moved_goes_on(
    dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, moved: int
) -> None:
    scenario = dataset / "ui_clear_night_dense"
    whole = snapshot(export_dataset("kitti", scenario, tmp_path / "whole").output)
    output, targets = tmp_path / "exports", list[Path]()

    def move_some(source: Path, target: Path) -> None:
        if target.name != "export.json":
            targets.append(target)
            if len(targets) > moved:
                raise KeyboardInterrupt
        move_file(source, target)

    with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
        patched.setattr(export_folder, "move_file", move_some)
        export_dataset("kitti", scenario, output)
    assert all(target.exists() for target in targets[:moved])
    assert {problem.kind for problem in verify_export(output)[0]} == {"unfinished"}
    export_dataset("kitti", scenario, output)
    assert snapshot(output) == whole


@pytest.mark.parametrize("allow_edited", [False, True])
def test_a_file_that_is_changed_during_an_export_is_not_exported(
    dataset: Path, tmp_path: Path, allow_edited: bool
) -> None:
    output, scenario = tmp_path / "exports", dataset / "ui_clear_night_dense"
    whole = snapshot(export_dataset("kitti", scenario, tmp_path / "whole").output)
    image = scenario / "-1" / "000061_camera0.png"
    content = image.read_bytes()

    def edit_when_a_frame_is_done(progress: Progress) -> None:
        if (progress.phase, progress.done) == ("export", 1):
            image.write_bytes(bytes(len(content)))

    with pytest.raises(RunError, match=f"{re.escape(str(image))}: was changed during the export"):
        export_dataset(
            "kitti", scenario, output, allow_edited=allow_edited, report=edit_when_a_frame_is_done
        )
    problems, manifest = verify_export(output)
    assert (problems, manifest.complete, len(manifest.pieces)) == ([], False, 1)
    assert all((output / path).read_bytes() == whole[path] for path in manifest.files)
    if allow_edited:
        export_dataset("kitti", scenario, output, allow_edited=True)
        edited = verify_export(output)[1].edited
        assert edited == {
            "ui_clear_night_dense/-1/000061_camera0.png": hashlib.sha256(
                bytes(len(content))
            ).hexdigest()
        }
    else:
        image.write_bytes(content)
        export_dataset("kitti", scenario, output)
        assert snapshot(output) == whole


def test_labels_that_are_edited_after_an_export_are_seen_by_the_next_one(
    advercity: Command, dataset: Path, tmp_path: Path
) -> None:
    output, labels = tmp_path / "exports", dataset / "ui_clear_night_dense" / "+101" / "000060.yaml"
    before = snapshot(export_dataset("openlabel", dataset, output).output)
    labels.write_text(labels.read_text() + "# corrected\n")
    assert f"{labels}: changed" in refuse(advercity, "openlabel", dataset, "--output", output)
    assert snapshot(output) == before


def test_what_is_in_the_place_of_an_export_s_file_or_folder_is_named(
    advercity: Command, dataset: Path, tmp_path: Path
) -> None:
    output = tmp_path / "exports"
    export_dataset("calibration", dataset, output)
    folder = next(output.rglob("camera0.yaml"))
    folder.unlink()
    folder.mkdir()
    command = ("export", "calibration", dataset, "--output", output)
    done = advercity(*command)
    assert (done.code, f"{folder}: is a folder where the export has a file" in done.err) == (
        1,
        True,
    )
    shutil.rmtree(folder.parent)
    folder.parent.touch()
    done = advercity(*command)
    assert f"{folder.parent}: is a file where the export has a folder" in done.err
    folder.parent.unlink()
    assert advercity(*command).code == 0


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        pytest.param(".bak", "is hidden", id="hidden"),
        pytest.param("ui\\old", "has a backslash", id="backslash"),
        pytest.param("ui_\udcff", "not UTF-8", id="bytes"),
        pytest.param("export", "is reserved for export.json", id="manifest"),
    ],
)
def test_a_scenario_whose_name_cannot_be_in_an_export_is_refused(
    advercity: Command, dataset: Path, tmp_path: Path, name: str, reason: str
) -> None:
    (dataset / "ui_clear_night_dense").rename(dataset / name)
    output = tmp_path / "exports"
    line = refuse(advercity, "openlabel", dataset, "--output", output)
    assert reason in line and "rename the folder" in line
    assert not output.exists()


def test_a_dataset_or_another_export_is_not_written_into_an_export(
    advercity: Command, dataset: Path, spec: Spec, tmp_path: Path
) -> None:
    output = tmp_path / "exports"
    before = snapshot(export_dataset("calibration", dataset, output).output)
    write_specs([spec], tmp_path / "compiled")
    run = ("run", tmp_path / "compiled" / f"{spec.id}.json")
    for command, place, answer in (
        (("export", "kitti", dataset), "inner", "is in an export"),
        (("split", dataset), "", "is an export"),
        (("split", dataset), "new/splits", "is in an export"),
        (run, "", "is an export"),
        (run, "new", "is in an export"),
    ):
        done = advercity(*command, "--output", output / place)
        assert (done.code, answer in done.err) == (2, True), done.err
    assert snapshot(output) == before
    # Programs of others have files of that name, too.
    (tmp_path / "export.json").write_text("[]")
    assert advercity("split", dataset, "--output", tmp_path / "splits").code == 0


def test_an_export_during_which_a_run_begins_is_not_complete(dataset: Path, tmp_path: Path) -> None:
    output, scenario = tmp_path / "exports" / "kitti", dataset / "ui_clear_night_dense"
    with ExitStack() as runs, pytest.raises(RunError, match="a run wrote it during the export"):
        export_dataset(
            "kitti",
            dataset,
            output,
            report=lambda one: (
                runs.enter_context(lock_scenario(scenario))
                if (one.phase, one.done, one.scenario) == ("export", 2, scenario.name)
                else None
            ),
        )
    assert not json.loads((output / "export.json").read_text())["complete"]
    export_dataset("kitti", dataset, output)
    assert json.loads((output / "export.json").read_text())["complete"]


def test_a_frame_that_is_not_as_its_manifest_says_is_not_exported(
    advercity: Command, dataset: Path, tmp_path: Path
) -> None:
    labels = dataset / "ui_clear_night_dense" / "+101" / "000060.yaml"
    labels.write_text(labels.read_text().replace("angle", "angel", 1))
    line = refuse(advercity, "kitti", dataset, "--output", tmp_path / "exports" / "kitti")
    assert f"{labels}: changed; `advercity verify` lists all such files" in line


def test_a_split_shows_that_a_run_is_writing_its_dataset(
    advercity: Command, dataset: Path, tmp_path: Path
) -> None:
    assert advercity("split", dataset, "--output", tmp_path / "splits").code == 0
    scenario = dataset / "ui_clear_night_dense"
    with lock_scenario(scenario):
        exported = advercity("export", "kitti", tmp_path / "splits", "--output", tmp_path / "x")
        verified = advercity("verify", tmp_path / "splits")
    assert (exported.code, "a run is writing it" in exported.err) == (1, True)
    assert (verified.code, "a run is writing it" in verified.err) == (1, True)
    assert not (tmp_path / "splits" / "test" / ".staging").exists()


def test_a_format_says_which_layout_it_needs(
    advercity: Command, tmp_path: Path, spec: Spec, sensor_frames_of: SensorFramesOf
) -> None:
    dataset = tmp_path / "dataset"
    write_scenario(dataset, spec, sensor_frames_of, format="adver_city")
    line = refuse(advercity, "kitti", dataset, "--output", tmp_path / "exports")
    assert "has the layout adver_city" in line and "exported from opv2v" in line


def test_a_dataset_without_frames_is_explained(
    advercity: Command, tmp_path: Path, spec: Spec
) -> None:
    with ScenarioWriter(tmp_path / "dataset", spec, identify(spec), length=2) as writer:
        writer.finish()
    done = advercity("export", "kitti", tmp_path / "dataset", "--output", tmp_path / "exports")
    assert done.code == 2
    assert "no frames here yet" in done.err


def test_a_manifest_that_was_made_to_harm_deletes_nothing(dataset: Path, tmp_path: Path) -> None:
    output = tmp_path / "exports" / "kitti"
    export_dataset("kitti", dataset, output)
    (tmp_path / "precious").write_text("")
    document = json.loads((output / "export.json").read_text())
    digest = hashlib.sha256().hexdigest()
    for path, checksum in (("../../precious", digest), ("a\ud800", digest), ("a", digest[1:])):
        record = {"size": 0, "sha256": checksum, "piece": min(document["pieces"])}
        damaged = document["files"] | {path: record}
        (output / "export.json").write_text(json.dumps(document | {"files": damaged}))
        with pytest.raises((InputError, RunError), match="not the manifest of an export"):
            export_dataset("kitti", dataset, output, fresh=True)
    assert (tmp_path / "precious").exists()


def test_a_manifest_with_a_file_of_no_piece_is_refused(dataset: Path, tmp_path: Path) -> None:
    """To go on would remove the file, and call the export complete without it."""
    output = tmp_path / "kitti"
    export_dataset("kitti", dataset, output)
    document = json.loads((output / "export.json").read_text())
    path = min(document["files"])
    document["files"][path]["piece"] += "_"
    (output / "export.json").write_text(json.dumps(document))
    with pytest.raises(RunError, match="not the manifest of an export"):
        export_dataset("kitti", dataset, output)
    assert (output / path).is_file()


NAMES_FORMAT = """
from advercity.exports.pieces import split_by_scenario
from advercity.exports.registry import ExportFormat

FORMAT = ExportFormat("names", "agent_names:list_pieces")

def list_pieces(dataset, options):
    def write(scenario, files):
        for frame in files.track(scenario):
            names = ", ".join(frame.views)
        files.write(f"{scenario.path.name}.txt", names.encode())
    return split_by_scenario(dataset, write)
"""


def test_a_format_of_another_distribution_is_exported_to(dataset: Path, tmp_path: Path) -> None:
    """Its module is found by an entry point; no file of advercity names it."""
    install(
        tmp_path,
        name="agent_names",
        module=NAMES_FORMAT,
        group="advercity.exports",
        names="agent_names:FORMAT",
    )
    output = tmp_path / "names"
    code = f"sys.argv = ['advercity', 'export', 'names', {str(dataset)!r}, '--output', "
    code += f"{str(output)!r}]; from advercity.cli import main; main()"
    assert run(tmp_path, code) == str(output)
    assert [path.read_text() for path in sorted(output.glob("*.txt"))] == [
        "cav1, cav2, cav3, rsu1, rsu2"
    ] * 2
    assert verify_export(output)[0] == []
