"""Nobody's files are lost: runs delete what they wrote, by name, and never through a link."""

import json
import os
import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from threading import Event, Thread

import pytest
from advercity_dsl import Spec

from advercity import atomic_files
from advercity.dataset import partial_files, writer
from advercity.dataset.formats import FORMATS, FrameFileNames
from advercity.dataset.manifest import Manifest
from advercity.dataset.opv2v import select_encoder
from advercity.dataset.partial_files import FileRecord, append_to_journal, set_aside
from advercity.dataset.remote import SharedScenario, upload_part, verify_store
from advercity.dataset.scenario_folders import MANIFEST_FILE, find_staging_folder
from advercity.dataset.store import DatasetLease, DatasetStore
from advercity.dataset.verification import restore_files, verify_dataset, verify_scenario
from advercity.dataset.writer import ScenarioWriter
from advercity.errors import AdvercityError, RunError
from tests.builders import SensorFramesOf, identify
from tests.dataset.conftest import LENGTH

FOREIGN = (
    "+101/000061_mylabels.json",
    "+101/000099_pred.npy",
    "+101/000060_dir/notes.txt",
    "+101/000061.pcd.bak",
    "+101/000061_camera4.png",  # of a rig with five cameras
    "+101/000062.pcd",  # of a longer scenario
    "+101/61.pcd",
    "+101/0000061.pcd",
    "-1/000061_additional_gnss_imu.yaml",  # units have none
    "101/000061.pcd",  # as the other layout names the ego
    "102/000061_lidar.ply",
    "notes.txt",
    "000061.pcd",
    "+101/000060.yaml.kept",
)
OF_A_LATER_FRAME = ("+101/000061.pcd", "103/000061_objects.json", "-2/000061.yaml")
"""Of a frame that no run has made yet."""


@pytest.fixture
def resume(spec: Spec) -> Callable[..., None]:
    """Opens a scenario again, and makes no frame."""

    def resume(scenario: Path, *, fresh: bool = False) -> None:
        identity = identify(spec)
        with ScenarioWriter(scenario.parent, spec, identity, length=LENGTH, fresh=fresh) as opened:
            opened.finish()

    return resume


def add(scenario: Path, *paths: str) -> dict[str, str]:
    """Add files with texts of their own; the texts by path."""
    for path in paths:
        (scenario / path).parent.mkdir(parents=True, exist_ok=True)
        (scenario / path).write_text(f"precious {path}")
    return {path: f"precious {path}" for path in paths}


def texts(scenario: Path, *paths: str) -> dict[str, str]:
    return {path: (scenario / path).read_text() for path in paths if (scenario / path).exists()}


@pytest.mark.parametrize("format", FORMATS)
def test_the_names_of_a_layout_are_those_that_its_encoder_writes(
    format: str, spec: Spec, sensor_frames_of: SensorFramesOf
) -> None:
    names = FrameFileNames(spec, format, length=LENGTH)
    encode = select_encoder(format, "binary_compressed")
    written = encode(sensor_frames_of(1), (), name="000061")
    assert {names.find_frame(path) for path in written} == {1}
    listed = {
        f"{folder}/000061{suffix}"
        for agent in spec.agents
        for folder in (FORMATS[format].format_folder(agent),)
        for suffix in FORMATS[format].list_suffixes(agent)
    }
    assert listed == written.keys()


def test_foreign_files_are_told_from_damage_and_survive_everything(
    scenario: Path,
    resume: Callable[..., None],
    sensor_frames_of: SensorFramesOf,
    caplog: pytest.LogCaptureFixture,
) -> None:
    foreign = (*FOREIGN, *OF_A_LATER_FRAME)
    precious = add(scenario, *foreign)
    assert {(one.path, one.kind) for one in verify_dataset(scenario)} == {
        (path, "foreign") for path in foreign
    }
    resume(scenario)
    assert texts(scenario, *foreign) == precious
    assert not caplog.records
    (scenario / "102" / "000060.pcd").unlink()
    left = restore_files(scenario, verify_scenario(scenario), sensor_frames_of)
    assert {problem.path for problem in left} == {*foreign}
    assert texts(scenario, *foreign) == precious
    assert (scenario / "102" / "000060.pcd").exists()
    resume(scenario, fresh=True)
    assert texts(scenario, *foreign) == precious
    assert not list(scenario.glob("*/000060.pcd"))
    assert f"{scenario}: {len(foreign)} files of no run kept" in caplog.text


def test_what_a_killed_run_left_of_a_frame_is_removed_and_no_other_file(
    scenario: Path,
    spec: Spec,
    resume: Callable[..., None],
    sensor_frames_of: SensorFramesOf,
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    moved: list[Path] = []

    def end_process(*_: object) -> None:
        raise KeyboardInterrupt

    def move_some(source: Path, target: Path) -> None:
        if len(moved) == 5:
            end_process()
        moved.append(target)
        atomic_files.move_file(source, target)

    with monkeypatch.context() as patched:
        patched.setattr(writer, "move_file", move_some)
        patched.setattr(ScenarioWriter, "finish", end_process)
        opened = ScenarioWriter(scenario.parent, spec, identify(spec), length=LENGTH)
        with pytest.raises(KeyboardInterrupt), opened:
            opened.write_frame(1, sensor_frames_of(1))
    moved[0].write_text("precious")
    taken = add(scenario, "-2/000061.yaml")
    damage = {one.path for one in verify_scenario(scenario) if one.is_damage}
    assert damage == {path.relative_to(scenario).as_posix() for path in moved[1:]}
    resume(scenario)
    assert f"{scenario}: 4 files of incomplete frames removed" in caplog.text
    kept = moved[0].with_name(f"{moved[0].name}.kept")
    assert kept.read_text() == "precious"
    assert not any(path.exists() for path in moved)
    assert not (scenario / "-2" / "000061.yaml").exists()
    assert texts(scenario, "-2/000061.yaml.kept") == {
        "-2/000061.yaml.kept": taken["-2/000061.yaml"]
    }


CHANGED = ("+101/000060.yaml", "-1/000060.pcd", "data_protocol.yaml")


@pytest.mark.parametrize("by", ["run", "run --fresh", "repair"])
def test_a_file_that_its_user_changed_is_kept_under_another_name(
    scenario: Path,
    spec: Spec,
    sensor_frames_of: SensorFramesOf,
    caplog: pytest.LogCaptureFixture,
    by: str,
) -> None:
    original = {path: (scenario / path).read_bytes() for path in CHANGED}
    for again in ("", "1"):
        precious = add(scenario, *CHANGED)
        caplog.clear()
        if by == "repair":
            restore_files(scenario, verify_scenario(scenario), sensor_frames_of)
        else:
            fresh = by == "run --fresh"
            identity = identify(spec)
            with ScenarioWriter(
                scenario.parent, spec, identity, length=LENGTH, fresh=fresh
            ) as opened:
                opened.write_frame(0, sensor_frames_of(0))
                opened.finish()
        assert {path: (scenario / path).read_bytes() for path in CHANGED} == original
        kept = texts(scenario, *(f"{path}.kept{again}" for path in CHANGED))
        assert kept == {f"{path}.kept{again}": text for path, text in precious.items()}
        assert all(f"{path}.kept{again}" in caplog.text for path in CHANGED)
    assert not any(problem.is_damage for problem in verify_scenario(scenario))


def indent_more(path: Path) -> None:
    path.write_text(json.dumps(json.loads(path.read_text()), indent=4))


def note_in_weather(path: Path) -> None:
    document = json.loads(path.read_text())
    document["weather"]["sun_elevation_deg"] = 12.5
    path.write_text(json.dumps(document, indent=1) + "\n")


def move_and_link(path: Path) -> None:
    target = path.parent.parent / f"shared_{path.name}"
    path.rename(target)
    path.symlink_to(target)


@pytest.mark.parametrize("fresh", [False, True])
@pytest.mark.parametrize("change", [indent_more, note_in_weather, move_and_link])
def test_a_manifest_that_its_user_changed_is_kept_under_another_name(
    scenario: Path,
    resume: Callable[..., None],
    caplog: pytest.LogCaptureFixture,
    change: Callable[[Path], None],
    fresh: bool,
) -> None:
    manifest = scenario / MANIFEST_FILE
    change(manifest)
    changed = manifest.read_bytes()
    resume(scenario, fresh=fresh)
    kept = scenario / "manifest.json.kept"
    assert kept.read_bytes() == changed
    assert kept.is_symlink() == (change is move_and_link)
    assert f"{scenario}: 1 file not as the manifest has them, kept as {kept.name}" in caplog.text
    assert not manifest.is_symlink()
    assert not any(problem.is_damage for problem in verify_scenario(scenario))
    caplog.clear()
    resume(scenario)
    assert not caplog.records


def test_a_link_in_place_of_the_spec_is_kept_under_another_name(
    scenario: Path, resume: Callable[..., None], caplog: pytest.LogCaptureFixture
) -> None:
    move_and_link(scenario / "data_protocol.yaml")
    resume(scenario)
    assert (scenario / "data_protocol.yaml.kept").is_symlink()
    assert not (scenario / "data_protocol.yaml").is_symlink()
    assert "kept as data_protocol.yaml.kept" in caplog.text


def test_a_file_kept_under_another_name_replaces_none_that_comes_meanwhile(tmp_path: Path) -> None:
    texts_of_others: list[str] = []
    ended = Event()

    def take_free_names() -> None:
        """Make files of the names that come next, as somebody may at any moment."""
        while not ended.is_set():
            with suppress(FileExistsError):
                number = len(list(tmp_path.glob("a.kept*")))
                with (tmp_path / f"a.kept{number or ''}").open("x") as stream:
                    texts_of_others.append(f"of others {number}")
                    stream.write(texts_of_others[-1])

    other = Thread(target=take_free_names)
    other.start()
    for number in range(100):
        (tmp_path / "a").write_text(f"changed {number}")
        set_aside(tmp_path, ["a"])
    ended.set()
    other.join()
    found = [path.read_text() for path in tmp_path.iterdir()]
    assert sorted(found) == sorted([*texts_of_others, *(f"changed {n}" for n in range(100))])


def test_a_file_in_the_place_of_one_that_a_run_writes_is_kept_under_another_name(
    scenario: Path, spec: Spec, sensor_frames_of: SensorFramesOf, caplog: pytest.LogCaptureFixture
) -> None:
    precious = add(scenario, *OF_A_LATER_FRAME)
    with ScenarioWriter(scenario.parent, spec, identify(spec), length=LENGTH) as opened:
        opened.write_frame(1, sensor_frames_of(1))
        opened.finish()
    kept = texts(scenario, *(f"{path}.kept" for path in precious))
    assert kept == {f"{path}.kept": text for path, text in precious.items()}
    assert not any(problem.is_damage for problem in verify_scenario(scenario))
    assert f"{scenario}: 3 files not as the manifest has them, kept as +101/000061.pcd.kept" in (
        caplog.text
    )


IN_STAGING = (
    "notes.txt",
    "journal_mine.jsonl",
    "incoming/notes.txt",
    "incoming/+101/000061.pcd",
    "incoming/mine/000061.pcd",
    "claims/mine/notes.txt",
)


@pytest.mark.parametrize("fresh", [False, True])
def test_files_of_others_among_unfinished_ones_stay_and_are_reported(
    scenario: Path,
    spec: Spec,
    resume: Callable[..., None],
    sensor_frames_of: SensorFramesOf,
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
    fresh: bool,
) -> None:
    staging = scenario.parent / ".staging" / scenario.name
    precious = add(staging, *IN_STAGING)
    with monkeypatch.context() as patched:

        def end_process(*_: object) -> None:
            raise KeyboardInterrupt

        patched.setattr(writer, "move_file", end_process)
        patched.setattr(ScenarioWriter, "finish", end_process)
        opened = ScenarioWriter(scenario.parent, spec, identify(spec), length=LENGTH)
        with pytest.raises(KeyboardInterrupt), opened:
            opened.claim_frame(1)
            opened.write_frame(1, sensor_frames_of(1))
    left = {path.relative_to(staging).as_posix() for path in staging.rglob("*")}
    assert len(left) > 100
    with partial_files.lock_scenario(scenario):
        pass
    resume(scenario, fresh=fresh)
    assert restore_files(scenario, (), lambda frame: ()) == []
    found = {path.relative_to(staging).as_posix() for path in staging.rglob("*") if path.is_file()}
    assert found == precious.keys()
    assert texts(staging, *IN_STAGING) == precious
    kept = (
        f"{staging}: {len(IN_STAGING)} files kept, not written by this version; delete the folder"
    )
    assert kept in caplog.text


@pytest.mark.parametrize("fresh", [False, True])
def test_files_of_others_among_the_parts_of_a_store_stay(
    scenario: Path, spec: Spec, tmp_path: Path, fresh: bool
) -> None:
    store = DatasetStore(str(tmp_path / "store"))
    upload_part(store, scenario)
    staging = tmp_path / "store" / ".staging" / spec.id
    precious = add(staging, "notes.json", "mine/000060_000060.txt")
    shared = SharedScenario(store, spec, identify(spec), LENGTH)
    shared.begin(fresh=fresh)
    assert shared.finish().frames == (() if fresh else (0,))
    found = {path.relative_to(staging).as_posix() for path in staging.rglob("*") if path.is_file()}
    assert found == precious.keys()


def upload_some_files(
    store: DatasetStore, scenario: Path, count: int, monkeypatch: pytest.MonkeyPatch
) -> list[str]:
    """Upload a part from a machine that stops after so many files; return their paths."""
    write, written = store.write, list[str]()

    def write_some(path: str, content: bytes) -> None:
        if len(written) == count:
            raise RunError("the machine stops")
        written.append(path)
        write(path, content)

    with monkeypatch.context() as patched, pytest.raises(RunError, match="stops"):
        patched.setattr(store, "write", write_some)
        upload_part(store, scenario)
    return written


def test_what_a_machine_left_of_a_part_is_removed_from_a_store_and_no_other_file(
    scenario: Path, spec: Spec, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store, folder = DatasetStore(str(tmp_path / "store")), tmp_path / "store" / spec.id
    shared = SharedScenario(store, spec, identify(spec), LENGTH)
    shared.begin(fresh=False)
    written = upload_some_files(store, scenario, 5, monkeypatch)
    changed = written.pop().removeprefix(f"{spec.id}/")
    precious = add(folder, "103/000061_objects.json", "notes.txt", changed)
    assert shared.finish().frames == ()
    assert not any((tmp_path / "store" / path).exists() for path in written)
    assert texts(folder, *precious) == precious
    with pytest.raises(RunError, match=r"00006\d[\w.]+: is of no run, in the place of"):
        shared.begin(fresh=False)
    assert texts(folder, *precious) == precious


def test_a_frame_of_a_store_that_has_lost_a_file_is_made_again(
    scenario: Path, spec: Spec, tmp_path: Path
) -> None:
    store, folder = DatasetStore(str(tmp_path / "store")), tmp_path / "store" / spec.id
    shared = SharedScenario(store, spec, identify(spec), LENGTH)
    shared.begin(fresh=False)
    upload_part(store, scenario)
    frame = shared.finish().frames[0]
    had = {path.relative_to(folder) for path in folder.rglob("*") if path.is_file()}
    precious = add(folder, "102/notes.txt")
    (folder / "102" / f"{60 + frame:06d}.pcd").unlink()
    assert frame not in {record.frame for record in shared.begin(fresh=False).values()}
    assert texts(folder, *precious) == precious
    upload_part(store, scenario)
    assert frame in shared.finish([frame]).frames
    (folder / "102" / "notes.txt").unlink()
    assert {path.relative_to(folder) for path in folder.rglob("*") if path.is_file()} == had
    assert verify_store(str(tmp_path / "store")) == []


def test_a_run_whose_store_is_deleted_meanwhile_reports_the_frames_that_are_gone(
    scenario: Path, spec: Spec, tmp_path: Path
) -> None:
    store = DatasetStore(str(tmp_path / "store"))
    shared = SharedScenario(store, spec, identify(spec), LENGTH)
    shared.begin(fresh=False)
    upload_part(store, scenario)
    shutil.rmtree(tmp_path / "store")
    with pytest.raises(RunError, match=f"{spec.id}: files of 1 frames are gone from the output"):
        shared.finish([0])
    assert verify_store(str(tmp_path / "store")) == []
    shared.begin(fresh=False)
    upload_part(store, scenario)
    assert shared.finish([0]).frames == (0,)


def test_verifying_a_store_tells_unfinished_files_from_those_of_others(
    scenario: Path, spec: Spec, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = DatasetStore(str(tmp_path / "store"))
    SharedScenario(store, spec, identify(spec), LENGTH).begin(fresh=False)
    written = upload_some_files(store, scenario, 4, monkeypatch)
    _, *uploaded, changed = (path.removeprefix(f"{spec.id}/") for path in written)
    mine = ["+101/000061_objects.json", "102/000061.pcd", changed, "notes.txt"]
    add(tmp_path / "store" / spec.id, *mine)
    kinds = {one.path: one.kind for one in verify_store(str(tmp_path / "store"))}
    assert kinds == dict.fromkeys(uploaded, "unfinished") | dict.fromkeys(mine, "foreign")


def test_what_a_dead_machine_left_of_a_file_in_a_store_is_removed_and_no_other_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store, incoming = DatasetStore(str(tmp_path)), tmp_path / ".staging" / "incoming"

    def stop(*_: object) -> None:
        raise RunError("the machine stops")

    with monkeypatch.context() as patched, pytest.raises(RunError, match="stops"):
        patched.setattr("advercity.dataset.store.move_file", stop)
        store.write("a/b", b"of a run")
    assert len(list(incoming.iterdir())) == 1
    precious = add(incoming, "notes.txt", "0123456789abcdef0123456789abcdef", "mine/thesis.txt")
    with DatasetLease(store):
        pass
    assert texts(incoming, *store_files(incoming)) == precious


def store_files(folder: Path) -> list[str]:
    return [path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()]


@pytest.mark.parametrize("fresh", [False, True])
def test_a_run_stops_at_a_changed_file_of_a_whole_scenario_in_a_store(
    spec: Spec, tmp_path: Path, fresh: bool
) -> None:
    store, folder = DatasetStore(str(tmp_path)), tmp_path / spec.id
    shared = SharedScenario(store, spec, identify(spec), LENGTH)
    shared.begin(fresh=False)
    shared.begin(fresh=fresh)  # the file of the first run is in the way of no other
    precious = add(folder, "data_protocol.yaml")
    with pytest.raises(RunError, match=r"data_protocol\.yaml: is of no run, in the place of"):
        shared.begin(fresh=fresh)
    shared.finish()
    assert texts(folder, *precious) == precious


def test_a_machine_that_stops_between_two_files_of_a_scenario_leaves_one_to_continue(
    spec: Spec, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = DatasetStore(str(tmp_path))
    shared, write = SharedScenario(store, spec, identify(spec), LENGTH), store.write

    def write_one(path: str, content: bytes) -> None:
        if any(tmp_path.rglob("*.*")):
            raise RunError("the machine stops")
        write(path, content)

    with monkeypatch.context() as patched, pytest.raises(RunError, match="stops"):
        patched.setattr(store, "write", write_one)
        shared.begin(fresh=False)
    assert shared.begin(fresh=False) == {}
    assert verify_dataset(tmp_path) == []


def test_no_lease_is_written_behind_a_link(tmp_path: Path) -> None:
    output, elsewhere = tmp_path / "output", tmp_path / "elsewhere"
    output.mkdir()
    elsewhere.mkdir()
    (output / ".staging").symlink_to(elsewhere)
    with (
        pytest.raises(RunError, match=r"\.staging is a link"),
        DatasetLease(DatasetStore(str(output))),
    ):
        pass
    assert list(elsewhere.iterdir()) == []


def test_an_unfinished_file_that_changes_before_its_repair_stays(scenario: Path) -> None:
    path, left = "+101/000061.pcd", b"of a killed run"
    (scenario / path).write_bytes(left)
    find_staging_folder(scenario).mkdir(parents=True)
    append_to_journal(scenario, 0, {path: FileRecord.from_content(left, frame=1)}, moved=False)
    problems = verify_scenario(scenario)
    assert [(one.path, one.kind) for one in problems] == [(path, "unfinished")]
    precious = add(scenario, path)
    restore_files(scenario, problems, lambda frame: ())
    assert texts(scenario, *precious) == precious


def test_fresh_stops_at_a_file_that_a_user_changed_in_a_store(
    scenario: Path, spec: Spec, tmp_path: Path
) -> None:
    store, folder = DatasetStore(str(tmp_path / "store")), tmp_path / "store" / spec.id
    upload_part(store, scenario)
    changed = next(path.relative_to(folder).as_posix() for path in folder.rglob("*_objects.json"))
    precious = add(folder, changed)
    shared = SharedScenario(store, spec, identify(spec), LENGTH)
    with pytest.raises(RunError, match=f"{changed}: is of no run, in the place of"):
        shared.begin(fresh=True)
    assert texts(folder, *precious) == precious


@pytest.mark.parametrize("text", ["{}", "", "[]", '{"manifest_version": 3}', "\0" * 300])
def test_fresh_empties_no_folder_whose_manifest_is_none(
    tmp_path: Path, spec: Spec, resume: Callable[..., None], text: str
) -> None:
    folder = tmp_path / spec.id
    (folder / "+101").mkdir(parents=True)
    (folder / MANIFEST_FILE).write_text(text)
    precious = add(folder, "thesis.tex", "+101/000060.pcd")
    with pytest.raises(AdvercityError, match=r"manifest\.json.*delete the folder") as caught:
        resume(folder, fresh=True)
    assert "None" not in str(caught.value)
    assert texts(folder, *precious) == precious


def test_fresh_removes_no_file_that_a_doctored_manifest_lists(
    scenario: Path, resume: Callable[..., None]
) -> None:
    precious = add(scenario, "thesis.tex", "../thesis.tex")
    manifest = json.loads((scenario / MANIFEST_FILE).read_text())
    record = manifest["files"]["data_protocol.yaml"]
    manifest["files"]["thesis.tex"] = record
    (scenario / MANIFEST_FILE).write_text(json.dumps(manifest))
    resume(scenario, fresh=True)
    assert texts(scenario, *precious) == precious
    for outside in ("../thesis.tex", "/etc/passwd", "+101/../../thesis.tex", "..", "a/..", "./a"):
        changed = {**manifest, "files": {outside: record}}
        (scenario / MANIFEST_FILE).write_text(json.dumps(changed))
        with pytest.raises(RunError, match="no path within the scenario"):
            Manifest.load(scenario)


LINKS = ["+101", "", "../.staging", "../.staging/{id}", "../.staging/{id}/incoming"]


@pytest.mark.parametrize("fresh", [False, True])
@pytest.mark.parametrize("place", LINKS)
def test_a_link_to_a_folder_is_refused_and_nothing_behind_it_is_touched(
    scenario: Path, tmp_path: Path, resume: Callable[..., None], place: str, fresh: bool
) -> None:
    """It was put there between two runs; what a run wrote itself is behind it, too."""
    inside = scenario / place.format(id=scenario.name)
    elsewhere = tmp_path / "other_disk"
    if inside.exists():
        inside.rename(elsewhere)
    else:
        elsewhere.mkdir()
        inside.parent.mkdir(parents=True, exist_ok=True)
    inside.symlink_to(elsewhere)
    precious = add(elsewhere, "000061.pcd", "lock", "notes.txt", "0/+101/000061.pcd")
    before = {path: path.read_bytes() for path in elsewhere.rglob("*") if path.is_file()}
    with pytest.raises(RunError, match=r"is a link to .*other_disk; .*in place of the link"):
        resume(scenario, fresh=fresh)
    with pytest.raises(RunError, match="is a link to"):
        restore_files(scenario, (), lambda frame: ())
    assert texts(elsewhere, *precious) == precious
    after = {path: path.read_bytes() for path in elsewhere.rglob("*") if path.is_file()}
    assert after == before
    assert inside.is_symlink()


def test_starting_over_in_another_layout_deletes_nothing_behind_a_link(
    scenario: Path, tmp_path: Path, spec: Spec
) -> None:
    """The ego's folder has another name there, so only the former manifest names the link."""
    (scenario / "+101").rename(tmp_path / "other_disk")
    (scenario / "+101").symlink_to(tmp_path / "other_disk")
    before = sorted(path.name for path in (tmp_path / "other_disk").iterdir())
    identity = identify(spec, format="adver_city")
    with (
        pytest.raises(RunError, match=r"\+101: is a link to .*other_disk"),
        ScenarioWriter(scenario.parent, spec, identity, length=LENGTH, fresh=True),
    ):
        pass
    assert sorted(path.name for path in (tmp_path / "other_disk").iterdir()) == before


def test_a_folder_that_becomes_a_link_during_a_run_ends_it(
    scenario: Path, tmp_path: Path, spec: Spec, sensor_frames_of: SensorFramesOf
) -> None:
    elsewhere = tmp_path / "other_disk"
    precious: dict[str, str] = {}
    with (
        pytest.raises(RunError, match="is a link to"),
        ScenarioWriter(scenario.parent, spec, identify(spec), length=LENGTH) as opened,
    ):
        (scenario / "103").rename(elsewhere)
        (scenario / "103").symlink_to(elsewhere)
        precious |= add(elsewhere, "000061.pcd")
        opened.write_frame(1, sensor_frames_of(1))
    assert len(list(elsewhere.glob("000060*"))) == 25
    assert texts(elsewhere, "000061.pcd") == precious


def test_the_output_may_be_a_link_and_a_linked_folder_is_verified(
    scenario: Path, tmp_path: Path, resume: Callable[..., None]
) -> None:
    output = tmp_path / "link"
    output.symlink_to(scenario.parent)
    resume(output / scenario.name)
    assert output.is_symlink()
    (scenario / "103").rename(tmp_path / "other_disk")
    (scenario / "103").symlink_to(tmp_path / "other_disk")
    assert verify_dataset(output) == []


def test_a_link_in_place_of_a_file_is_never_written_through(
    scenario: Path, tmp_path: Path, spec: Spec, sensor_frames_of: SensorFramesOf
) -> None:
    targets = add(tmp_path / "targets", "manifest.json", "000061.pcd", "data_protocol.yaml")
    shutil.copy(scenario / MANIFEST_FILE, tmp_path / "targets" / MANIFEST_FILE)
    places = {path: Path(path).name for path in (MANIFEST_FILE, *CHANGED[2:], "+101/000061.pcd")}
    for path, target in places.items():
        (scenario / path).unlink(missing_ok=True)
        (scenario / path).symlink_to(tmp_path / "targets" / target)
    manifest = (tmp_path / "targets" / MANIFEST_FILE).read_bytes()
    with ScenarioWriter(scenario.parent, spec, identify(spec), length=LENGTH) as opened:
        opened.write_frame(1, sensor_frames_of(1))
        opened.finish()
    assert (tmp_path / "targets" / MANIFEST_FILE).read_bytes() == manifest
    del targets[MANIFEST_FILE]
    assert texts(tmp_path / "targets", *targets) == targets
    assert not any((scenario / path).is_symlink() for path in places)
    assert not any(problem.is_damage for problem in verify_scenario(scenario))


def test_what_a_journal_lists_is_on_the_disk_with_content_and_name(
    tmp_path: Path, spec: Spec, sensor_frames_of: SensorFramesOf, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Files and their announcement are synced before the renaming, their folders after it."""
    synced: dict[int, tuple[int, int]] = {}
    really_sync, really_append = os.fsync, partial_files.append_to_journal

    def sync(descriptor: int) -> None:
        state = os.fstat(descriptor)
        synced[state.st_ino] = (state.st_size, state.st_mtime_ns)
        really_sync(descriptor)

    def append(
        scenario: Path, process: int, records: dict[str, FileRecord], *, moved: bool
    ) -> Path:
        for path in records if moved else ():
            state = (scenario / path).stat()
            assert synced[state.st_ino] == (state.st_size, state.st_mtime_ns), path
            folder = (scenario / path).parent.stat()
            assert synced[folder.st_ino][1] == folder.st_mtime_ns, path
        checked.append((len(records), moved))
        return really_append(scenario, process, records, moved=moved)

    checked: list[tuple[int, bool]] = []
    monkeypatch.setattr(os, "fsync", sync)

    def move(source: Path, target: Path) -> None:
        (journal,) = tmp_path.glob(".staging/*/journal_0.jsonl")
        state = journal.stat()
        assert synced[state.st_ino] == (state.st_size, state.st_mtime_ns)
        atomic_files.move_file(source, target)

    monkeypatch.setattr(writer, "append_to_journal", append)
    monkeypatch.setattr(writer, "move_file", move)
    with ScenarioWriter(tmp_path, spec, identify(spec), length=1) as opened:
        opened.write_frame(0, sensor_frames_of(0))
        opened.finish()
    assert checked == [(123, False), (123, True)]
    manifest = (opened.scenario / MANIFEST_FILE).stat()
    assert synced[manifest.st_ino][0] == manifest.st_size
