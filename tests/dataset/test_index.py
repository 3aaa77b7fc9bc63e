"""The index of a set of scenarios."""

import json
import shutil
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from advercity_dsl import Spec

from advercity.dataset.index import (
    EMPTY_INDEX,
    INDEX_FILE,
    DatasetIndex,
    IndexWriter,
)
from advercity.dataset.remote import verify_store
from advercity.dataset.verification import verify_dataset
from advercity.dataset.writer import ScenarioWriter
from advercity.errors import InputError, RunError
from tests.builders import identify
from tests.dataset.conftest import LENGTH, Make


@pytest.fixture
def others(spec: Spec) -> list[Spec]:
    """Scenarios like the hand-made one, but for their names."""
    return [spec.model_copy(update={"id": f"other_{number}"}) for number in range(3)]


def states(root: Path) -> dict[str, str]:
    index = DatasetIndex.load(root)
    assert index is not None
    return {name: entry.state for name, entry in index.scenarios.items()}


def test_the_index_has_every_requested_scenario_with_its_state(
    spec: Spec, others: list[Spec], make: Make, tmp_path: Path
) -> None:
    index = IndexWriter(tmp_path, [spec, *others])
    make(tmp_path, spec, 2)
    index.record_result(spec.id, failed=False)
    make(tmp_path, others[0], 1)
    index.record_result("other_0", failed=False)
    index.record_result("other_1", failed=True)
    expected = {"other_0": "partial", "other_1": "failed", "other_2": "waiting", spec.id: "whole"}
    assert states(tmp_path) == expected
    assert list(states(tmp_path)) == sorted(expected)
    found = DatasetIndex.load(tmp_path)
    assert found is not None
    assert found.format_summary() == "4 scenarios: 1 whole, 1 partial, 1 failed, 1 waiting"
    whole, files = found.scenarios[spec.id], list((tmp_path / spec.id).rglob("*.*"))
    assert (whole.frames, whole.length, whole.files) == (2, 2, len(files) - 1)
    assert whole.size_bytes == sum(f.stat().st_size for f in files if f.name != "manifest.json")
    assert verify_dataset(tmp_path) == []


@pytest.mark.parametrize("frames", [LENGTH, LENGTH - 1])
def test_a_run_that_is_refused_leaves_the_entry_of_a_scenario_as_it_was(
    spec: Spec, make: Make, tmp_path: Path, frames: int
) -> None:
    make(tmp_path, spec, frames)
    end(IndexWriter(tmp_path, [spec]), spec)
    before = (tmp_path / INDEX_FILE).read_bytes()
    index = IndexWriter(tmp_path, [spec])
    full = ScenarioWriter(tmp_path, spec, identify(spec, profile="full"), length=LENGTH)
    with pytest.raises(RunError, match="was made from another spec, version or device"), full:
        pass
    index.record_result(spec.id, failed=True, refused=True)
    assert (tmp_path / INDEX_FILE).read_bytes() == before


def test_an_error_while_frames_are_made_is_in_the_index(
    spec: Spec, make: Make, tmp_path: Path
) -> None:
    make(tmp_path, spec, LENGTH - 1)
    IndexWriter(tmp_path, [spec]).record_result(spec.id, failed=True)
    assert states(tmp_path) == {spec.id: "failed"}


def test_the_next_run_continues_the_index_and_the_same_dataset_has_the_same_bytes(
    spec: Spec, others: list[Spec], make: Make, tmp_path: Path
) -> None:
    both = [spec, others[0]]
    for root, batches in ((tmp_path / "once", [both]), (tmp_path / "twice", [[both[0]], both])):
        for batch in batches:
            index = IndexWriter(root, batch)
            for one in batch:
                make(root, one, 2)
                index.record_result(one.id, failed=False)
    once, twice = ((tmp_path / name / INDEX_FILE).read_bytes() for name in ("once", "twice"))
    assert once == twice


def test_an_unfinished_run_records_no_manifest_of_its_scenarios(
    spec: Spec, others: list[Spec], make: Make, tmp_path: Path
) -> None:
    for one in (spec, others[0]):
        make(tmp_path, one, 1)
        IndexWriter(tmp_path, [one]).record_result(one.id, failed=False)
    IndexWriter(tmp_path, [spec]).record_start(spec.id, missing_frames=1)
    make(tmp_path, spec, 2)
    assert states(tmp_path) == {spec.id: "waiting", "other_0": "partial"}
    assert verify_dataset(tmp_path) == []


def test_a_run_that_ends_before_it_makes_frames_leaves_the_records_of_scenarios(
    spec: Spec, others: list[Spec], make: Make, tmp_path: Path
) -> None:
    for one in (spec, others[0]):
        make(tmp_path, one, LENGTH)
        IndexWriter(tmp_path, [one]).record_result(one.id, failed=False)
    before = (tmp_path / INDEX_FILE).read_bytes()
    IndexWriter(tmp_path, [spec, others[0]]).record_start(spec.id, missing_frames=0)
    assert (tmp_path / INDEX_FILE).read_bytes() == before


def test_a_scenario_that_is_deleted_while_its_run_starts_awaits_its_result(
    spec: Spec, make: Make, tmp_path: Path
) -> None:
    make(tmp_path, spec, 1)
    index = IndexWriter(tmp_path, [spec])
    end(index, spec)
    shutil.rmtree(tmp_path / spec.id)
    index.record_start(spec.id, missing_frames=0)
    assert states(tmp_path) == {spec.id: "waiting"}


def test_a_scenario_whose_manifest_a_run_has_changed_awaits_its_result(
    spec: Spec, make: Make, tmp_path: Path
) -> None:
    make(tmp_path, spec, 1)
    index = IndexWriter(tmp_path, [spec])
    end(index, spec)
    make(tmp_path, spec, 2)
    index.record_start(spec.id, missing_frames=0)
    assert states(tmp_path) == {spec.id: "waiting"}


def test_a_missing_scenario_and_a_changed_manifest_are_found(
    spec: Spec, others: list[Spec], make: Make, tmp_path: Path
) -> None:
    index = IndexWriter(tmp_path, [spec, others[0]])
    for one in (spec, others[0]):
        make(tmp_path, one, 1)
        index.record_result(one.id, failed=False)
    with (tmp_path / spec.id / "manifest.json").open("a") as manifest:
        manifest.write("\n")
    shutil.rmtree(tmp_path / "other_0")
    problems = sorted(map(str, verify_dataset(tmp_path)))
    assert problems == [
        f"{tmp_path}/other_0/manifest.json: missing",
        f"{tmp_path}/{spec.id}/manifest.json: changed",
    ]
    shutil.rmtree(tmp_path / spec.id)
    assert {problem.kind for problem in verify_dataset(tmp_path)} == {"missing"}


def end(index: IndexWriter, spec: Spec) -> None:
    index.record_result(spec.id, failed=False)


def test_concurrent_runs_lose_no_entry(others: list[Spec], make: Make, tmp_path: Path) -> None:
    for one in others:
        make(tmp_path, one, 0)
    with ThreadPoolExecutor() as pool:
        for _ in range(20):
            (tmp_path / INDEX_FILE).unlink(missing_ok=True)
            indices = [IndexWriter(tmp_path, [one]) for one in others]
            list(pool.map(end, indices, others))
            assert set(states(tmp_path)) == {one.id for one in others}


def test_no_index_is_written_without_a_scenario(spec: Spec, tmp_path: Path) -> None:
    IndexWriter(tmp_path / "dataset", [spec]).record_result(spec.id, failed=True)
    assert not (tmp_path / "dataset").exists()
    with pytest.raises(InputError, match="not a dataset"):
        verify_dataset(tmp_path)


@pytest.mark.parametrize("name", ["../elsewhere", "/", "", "a\nb", "\0", 300 * "x"])
def test_an_index_names_no_folder_elsewhere(
    spec: Spec, make: Make, tmp_path: Path, name: str
) -> None:
    make(tmp_path, spec, 1)
    end(IndexWriter(tmp_path, [spec]), spec)
    path = tmp_path / INDEX_FILE
    data = json.loads(path.read_text())
    data["scenarios"][name] = data["scenarios"][spec.id]
    path.write_text(json.dumps(data))
    with pytest.raises(RunError, match=r"not an index of this version; rename or delete it"):
        verify_dataset(tmp_path)


def test_a_damaged_index_is_reported_with_a_remedy(spec: Spec, tmp_path: Path) -> None:
    (tmp_path / INDEX_FILE).write_text("{}}")
    with pytest.raises(InputError, match=r"index\.json:1:3: .*extra data; rename or delete it"):
        IndexWriter(tmp_path, [spec])
    for text in ('{"index_version": 2}', "{}", '{"index_version": 1}'):
        (tmp_path / INDEX_FILE).write_text(text)
        with pytest.raises(RunError, match=r"not an index of this version; rename or delete it"):
            IndexWriter(tmp_path, [spec])
        assert (tmp_path / INDEX_FILE).read_text() == text
    assert [path.name for path in tmp_path.iterdir()] == [INDEX_FILE]


def test_hidden_files_of_others_in_a_dataset_stay(spec: Spec, make: Make, tmp_path: Path) -> None:
    """Their names are those that partial files of the index had once."""
    make(tmp_path, spec, 1)
    mine = [tmp_path / ".index.json", tmp_path / ".index.lock"]
    for path in mine:
        path.write_text("mine")
    end(IndexWriter(tmp_path, [spec]), spec)
    assert [path.read_text() for path in mine] == ["mine", "mine"]
    assert not (tmp_path / ".staging").exists()


def test_a_failed_scenario_whose_manifest_is_lost_is_reported(
    spec: Spec, others: list[Spec], make: Make, tmp_path: Path
) -> None:
    index = IndexWriter(tmp_path, [spec, *others])
    make(tmp_path, spec, 1)
    make(tmp_path, others[0], 1)
    (tmp_path / "other_0" / "manifest.json").unlink()
    end(index, spec)
    for one in others:
        index.record_result(one.id, failed=True)
    assert list(map(str, verify_dataset(tmp_path))) == [
        f"{tmp_path}/other_0/manifest.json: missing"
    ]
    assert list(map(str, verify_store(str(tmp_path)))) == ["other_0/manifest.json: missing"]


def test_an_index_that_is_a_link_is_refused_and_called_a_file(spec: Spec, tmp_path: Path) -> None:
    dataset, shared = tmp_path / "data", tmp_path / "shared.json"
    dataset.mkdir()
    shared.write_bytes(EMPTY_INDEX.to_json())
    (dataset / "index.json").symlink_to(shared)
    with pytest.raises(RunError, match="put the file itself in place of the link"):
        IndexWriter(dataset, [spec])
    assert shared.read_bytes() == EMPTY_INDEX.to_json()
