"""A frame is complete or absent: interruption at any point, resumption, locking, attribution."""

import itertools
import json
import os
import re
import resource
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from advercity_dsl import BodyModel, Spec

from advercity.dataset import partial_files
from advercity.dataset.attribution import format_attribution
from advercity.dataset.manifest import Identity, Manifest, find_vector_instructions
from advercity.dataset.partial_files import FileRecord
from advercity.dataset.scenario_folders import MANIFEST_FILE, find_scenarios
from advercity.dataset.verification import FileProblem, restore_files, verify_scenario
from advercity.dataset.writer import ATTRIBUTION_FILE, ScenarioWriter
from advercity.digests import compute_rounding_digest
from advercity.errors import InputError, RunError
from advercity.texture_packs import EZ_TREE
from tests.builders import SensorFramesOf, identify

FRAMES = 2
FILES_PER_FRAME = 123
Make = Callable[..., ScenarioWriter]
Run = Callable[[Path], list[int]]


@pytest.fixture(scope="module")
def writer(spec: Spec) -> Make:
    """Makes a writer of the two-frame scenario in a folder."""

    def make(root: Path, *, profile: str = "preview", fresh: bool = False) -> ScenarioWriter:
        identity = identify(spec, profile=profile)
        return ScenarioWriter(root, spec, identity, length=FRAMES, fresh=fresh)

    return make


@pytest.fixture(scope="module")
def run(writer: Make, sensor_frames_of: SensorFramesOf) -> Run:
    """Writes what is missing; the frames it wrote."""

    def run(root: Path) -> list[int]:
        with writer(root) as dataset:
            missing = [index for index in range(FRAMES) if index not in dataset.done_frames]
            for index in missing:
                dataset.write_frame(index, sensor_frames_of(index))
            dataset.finish()
        return missing

    return run


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory, run: Run) -> Path:
    """A dataset that was never interrupted; not to be changed."""
    root = tmp_path_factory.mktemp("original") / "whole"
    assert run(root) == [0, 1]
    return root


@pytest.fixture
def whole(tmp_path: Path, original: Path) -> Path:
    """A copy of it."""
    return shutil.copytree(original, tmp_path / "whole")


def tree(root: Path) -> dict[str, bytes]:
    return {
        path.relative_to(root).as_posix(): path.read_bytes() if path.is_file() else b""
        for path in root.rglob("*")
    }


def frames_with_any_file(root: Path) -> set[str]:
    return {path.name[:6] for path in root.glob("*/*/[0-9]*")}


def test_a_finished_scenario_matches_its_manifest(whole: Path) -> None:
    (scenario,) = find_scenarios(whole)
    manifest = Manifest.load(scenario)
    assert (manifest.complete, manifest.frames) == (True, (0, 1))
    assert len(manifest.files) == FRAMES * FILES_PER_FRAME + 1
    assert verify_scenario(scenario) == []


def test_the_manifest_has_no_times_and_no_machine_paths(whole: Path, tmp_path: Path) -> None:
    (scenario,) = find_scenarios(whole)
    text = (scenario / MANIFEST_FILE).read_text()
    assert str(tmp_path) not in text
    assert set(json.loads(text)) == {
        *("manifest_version", "identity", "weather", "spec"),
        *("length", "complete", "frames", "files"),
    }


def test_the_order_in_which_frames_are_written_does_not_matter(
    original: Path, tmp_path: Path, writer: Make, sensor_frames_of: SensorFramesOf
) -> None:
    with writer(tmp_path / "backwards") as dataset:
        for index in reversed(range(FRAMES)):
            dataset.write_frame(index, sensor_frames_of(index))
        dataset.finish()
    assert tree(tmp_path / "backwards") == tree(original)


def test_a_second_run_has_nothing_to_do_and_changes_nothing(whole: Path, run: Run) -> None:
    before = tree(whole)
    assert run(whole) == []
    assert tree(whole) == before


class _Interrupted(Exception):
    pass


def when_moving(count: int, happens: Callable[[], None]) -> Callable[[Path, Path], Path]:
    """`Path.replace`, before the `count`-th call of which something `happens`."""
    calls = itertools.count()
    really_replace = Path.replace

    def replace(source: Path, target: Path) -> Path:
        if next(calls) == count:
            happens()
        return really_replace(source, target)

    return replace


def interrupt() -> None:
    raise _Interrupted


MOMENTS = pytest.mark.parametrize("moves", [0, 1, 2, 3, 40, 124, 125, 126, 150, 247])


@MOMENTS
def test_an_interrupted_run_is_completed_by_its_repetition(
    moves: int, original: Path, tmp_path: Path, run: Run
) -> None:
    root = tmp_path / "interrupted"
    with pytest.MonkeyPatch.context() as patch, pytest.raises(_Interrupted):
        patch.setattr(Path, "replace", when_moving(moves, interrupt))
        run(root)
    assert frames_with_any_file(root) == ({"000060"} if moves > FILES_PER_FRAME + 1 else set())
    run(root)
    assert tree(root) == tree(original)


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
@MOMENTS
def test_a_killed_run_is_completed_by_its_repetition(
    moves: int, original: Path, tmp_path: Path, run: Run
) -> None:
    """The child dies without any clearing up, as by SIGKILL."""
    root = tmp_path / "killed"
    child = os.fork()
    if child == 0:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(Path, "replace", when_moving(moves, lambda: os._exit(9)))
            run(root)
            os._exit(0)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 9
    run(root)
    assert tree(root) == tree(original)


def test_an_error_during_a_frame_leaves_none_of_its_files(
    tmp_path: Path, writer: Make, sensor_frames_of: SensorFramesOf, spec: Spec
) -> None:
    (tmp_path / spec.id).mkdir()
    with pytest.raises(RunError, match="Is a directory"), writer(tmp_path) as dataset:
        dataset.write_frame(0, sensor_frames_of(0))
        (tmp_path / spec.id / "+101" / "000061.pcd").mkdir()
        dataset.write_frame(1, sensor_frames_of(1))
    assert frames_with_any_file(tmp_path) - {"000060"} <= {"000061"}
    (tmp_path / spec.id / "+101" / "000061.pcd").rmdir()
    assert frames_with_any_file(tmp_path) == {"000060"}
    assert not (tmp_path / ".staging").exists()
    assert Manifest.load(tmp_path / spec.id).frames == (0,)


@pytest.mark.parametrize("lost_lines", [0, 1])
def test_a_journal_torn_at_its_end_costs_no_frame_that_is_whole(
    original: Path,
    tmp_path: Path,
    writer: Make,
    sensor_frames_of: SensorFramesOf,
    spec: Spec,
    lost_lines: int,
) -> None:
    """A frame has a line before its files are moved into place, and one after that."""
    root = tmp_path / "torn"
    with writer(root) as dataset:
        dataset.write_frame(0, sensor_frames_of(0))
        dataset.write_frame(1, sensor_frames_of(1))
    journal = root / ".staging" / spec.id / "journal_0.jsonl"
    lines = journal.read_bytes().splitlines(keepends=True)
    assert len(lines) == 4
    journal.write_bytes(b"".join(lines[: 4 - lost_lines])[:-20])
    done = {0, 1} if lost_lines == 0 else {0}
    with writer(root) as dataset:
        assert dataset.done_frames == done
        if 1 not in done:
            dataset.write_frame(1, sensor_frames_of(1))
        dataset.finish()
    assert {path: content for path, content in tree(root).items() if ".kept" not in path} == tree(
        original
    )


def test_a_frame_whose_line_the_disk_takes_in_part_is_reported_and_made_again(
    original: Path, tmp_path: Path, writer: Make, run: Run, sensor_frames_of: SensorFramesOf
) -> None:
    """The kernel writes what fits, and reports no error but the number of bytes."""
    append = partial_files.append_to_journal

    def append_within_limit(
        scenario: Path, process: int, records: dict[str, FileRecord], *, moved: bool
    ) -> Path:
        size = (scenario.parent / ".staging" / scenario.name / "journal_0.jsonl").stat().st_size
        before = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (size + 100, before[1]))
        try:
            return append(scenario, process, records, moved=moved)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)

    root = tmp_path / "full"
    with (
        pytest.MonkeyPatch.context() as patch,
        pytest.raises(RunError, match=r"journal_0\.jsonl: No space left on device"),
        writer(root) as dataset,
    ):
        dataset.write_frame(0, sensor_frames_of(0))
        patch.setattr("advercity.dataset.writer.append_to_journal", append_within_limit)
        dataset.write_frame(1, sensor_frames_of(1))
    assert run(root) == [1]
    assert tree(root) == tree(original)


def test_a_file_that_lost_its_content_in_a_power_cut_is_made_again(
    original: Path, tmp_path: Path, writer: Make, sensor_frames_of: SensorFramesOf, spec: Spec
) -> None:
    root = tmp_path / "cut"
    with writer(root) as dataset:
        dataset.write_frame(0, sensor_frames_of(0))
        dataset.write_frame(1, sensor_frames_of(1))
    lost = root / spec.id / "+101" / "000061.pcd"
    lost.write_bytes(bytes(lost.stat().st_size))
    with writer(root) as dataset:
        assert dataset.done_frames == {0}
        dataset.write_frame(1, sensor_frames_of(1))
        dataset.finish()
    found = tree(root)
    assert found.pop(f"{spec.id}/+101/000061.pcd.kept").count(0) == len(
        found[f"{spec.id}/+101/000061.pcd"]
    )
    assert found == tree(original)


def test_an_unfinished_scenario_is_verified_with_its_journal(
    tmp_path: Path, writer: Make, sensor_frames_of: SensorFramesOf, spec: Spec
) -> None:
    with writer(tmp_path) as dataset:
        dataset.write_frame(1, sensor_frames_of(1))
    assert verify_scenario(tmp_path / spec.id) == []
    assert Manifest.load(tmp_path / spec.id).frames == (1,)


def test_a_second_writer_is_refused(
    tmp_path: Path, writer: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(partial_files, "LOCK_TIMEOUT_S", 0.2)
    with (
        writer(tmp_path),
        pytest.raises(RunError, match="another run is writing this scenario"),
        writer(tmp_path),
    ):
        pass


def test_a_writer_may_follow_one_that_failed_to_open(tmp_path: Path, writer: Make) -> None:
    with writer(tmp_path) as dataset:
        dataset.finish()
    with pytest.raises(RunError), writer(tmp_path, profile="full"):
        pass
    with writer(tmp_path) as dataset:
        dataset.finish()


def test_a_scenario_of_another_profile_is_not_continued(whole: Path, writer: Make) -> None:
    before = tree(whole)
    with (
        pytest.raises(RunError, match=r"profile: preview, full.*`fresh`"),
        writer(whole, profile="full"),
    ):
        pass
    assert tree(whole) == before


@pytest.mark.parametrize(
    ("field", "message"),
    [
        # As from a scene in the cache that was edited together with its checksum.
        ("world_sha256", "world_sha256: 0{20}, other"),
        ("vector_instructions", "vector instructions of the processor: .*, other"),
        ("rounding_sha256", "rounding of the processor's libraries: [0-9a-f]{20}, other"),
    ],
)
def test_a_scenario_of_another_world_or_processor_is_not_continued(
    whole: Path, spec: Spec, field: str, message: str
) -> None:
    identity = identify(spec, profile="preview").model_copy(update={field: "other"})
    with (
        pytest.raises(RunError, match=message),
        ScenarioWriter(whole, spec, identity, length=FRAMES),
    ):
        pass


@pytest.mark.skipif(
    "X86_V3" not in np.show_config(mode="dicts")["SIMD Extensions"]["found"], reason="no AVX2"
)
def test_vector_instructions_are_those_that_numpy_may_use() -> None:
    ran = subprocess.run(
        [
            sys.executable,
            "-c",
            "from advercity.dataset import manifest as m; print(m.find_vector_instructions())",
        ],
        env={**os.environ, "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert ran.stdout == "baseline(X86_V2)\n"
    assert find_vector_instructions() in ("X86_V3", "X86_V4")


@pytest.mark.skipif(
    "X86_V3" not in np.show_config(mode="dicts")["SIMD Extensions"]["found"], reason="no AVX2"
)
@pytest.mark.parametrize(
    ("setting", "differs"),
    [
        ("OPENBLAS_CORETYPE=Prescott", True),
        ("NPY_DISABLE_CPU_FEATURES=X86_V3 X86_V4", True),
        ("GLIBC_TUNABLES=glibc.cpu.hwcaps=-AVX2,-FMA", True),
        ("OPENBLAS_NUM_THREADS=1", False),
        ("OPENBLAS_NUM_THREADS=16", False),
    ],
)
def test_rounding_of_products_and_functions_is_told_apart(setting: str, differs: bool) -> None:
    name, _, value = setting.partition("=")
    ran = subprocess.run(
        [
            sys.executable,
            "-c",
            "from advercity.digests import compute_rounding_digest as d; print(d())",
        ],
        env=os.environ | {name: value},
        capture_output=True,
        text=True,
        check=True,
    )
    assert (ran.stdout.strip() != compute_rounding_digest()) == differs


def test_a_scenario_of_another_weather_is_not_continued(
    whole: Path, spec: Spec, specs: dict[str, Spec]
) -> None:
    other = spec.model_copy(update={"weather": specs["rcnj_clear_day_sparse"].weather})
    identity = identify(other, profile="preview")
    with (
        pytest.raises(RunError, match="spec_sha256"),
        ScenarioWriter(whole, other, identity, length=FRAMES),
    ):
        pass


@pytest.mark.parametrize("deleted", ["+101", "."])
def test_frames_that_are_deleted_during_a_run_are_not_listed_and_are_made_again(
    tmp_path: Path, writer: Make, run: Run, sensor_frames_of: SensorFramesOf, deleted: str
) -> None:
    with writer(tmp_path) as dataset:
        dataset.write_frame(0, sensor_frames_of(0))
        shutil.rmtree(dataset.scenario / deleted)
        dataset.write_frame(1, sensor_frames_of(1))
        assert dataset.finish().frames == (1,)
    assert verify_scenario(dataset.scenario) == []
    assert run(tmp_path) == [0]
    assert verify_scenario(dataset.scenario) == []


def test_fresh_starts_over(whole: Path, writer: Make, sensor_frames_of: SensorFramesOf) -> None:
    with writer(whole, profile="full", fresh=True) as dataset:
        assert dataset.done_frames == frozenset()
        assert frames_with_any_file(whole) == set()
        dataset.write_frame(0, sensor_frames_of(0))
        dataset.finish()
    manifest = Manifest.load(find_scenarios(whole)[0])
    assert (manifest.frames, manifest.complete) == ((0,), False)
    assert manifest.identity.renderer == {"profile": "full"}


def test_a_scenario_that_fresh_empties_in_part_counts_as_without_frames(
    whole: Path, writer: Make, run: Run, original: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    unlink, deleted = Path.unlink, itertools.count(1)

    def refuse_the_tenth(path: Path, missing_ok: bool = False) -> None:
        if next(deleted) == 10:
            raise PermissionError(1, "Operation not permitted", str(path))
        unlink(path, missing_ok=missing_ok)

    with monkeypatch.context() as patched:
        patched.setattr(Path, "unlink", refuse_the_tenth)
        message = "not permitted; `fresh` has deleted a part of the frames"
        with pytest.raises(RunError, match=message), writer(whole, fresh=True):
            pass
    manifest = Manifest.load(find_scenarios(whole)[0])
    assert (manifest.frames, manifest.complete) == ((), False)
    assert run(whole) == [0, 1]
    assert tree(whole) == tree(original)


@pytest.mark.parametrize("fresh", [False, True])
def test_a_folder_with_other_files_is_left_alone(
    tmp_path: Path, writer: Make, spec: Spec, fresh: bool
) -> None:
    precious = tmp_path / spec.id / "thesis.tex"
    precious.parent.mkdir()
    precious.write_text("chapter 1")
    with pytest.raises(RunError, match="not a dataset"), writer(tmp_path, fresh=fresh):
        pass
    assert precious.read_text() == "chapter 1"


def test_a_damaged_manifest_is_reported(whole: Path, writer: Make) -> None:
    (scenario,) = find_scenarios(whole)
    (scenario / MANIFEST_FILE).write_text("{}")
    with (
        pytest.raises(RunError, match=r"manifest.json: not a manifest.*delete the folder"),
        writer(whole),
    ):
        pass


def test_verify_finds_what_is_missing_extra_or_changed(whole: Path) -> None:
    (scenario,) = find_scenarios(whole)
    (scenario / "102" / "000060.pcd").unlink()
    (scenario / "103" / "notes.txt").write_text("x")
    path = scenario / "-1" / "000061_camera0.png"
    content = bytearray(path.read_bytes())
    content[-1] ^= 1
    path.write_bytes(content)
    assert verify_scenario(scenario) == [
        FileProblem(scenario, "-1/000061_camera0.png", "changed", 1),
        FileProblem(scenario, "102/000060.pcd", "missing", 0),
        FileProblem(scenario, "103/notes.txt", "foreign"),
    ]


def test_verify_needs_a_manifest(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no manifest\.json"):
        verify_scenario(tmp_path)
    with pytest.raises(InputError, match="not a dataset"):
        find_scenarios(tmp_path)


def test_a_frame_with_a_missing_file_is_made_again(whole: Path, run: Run) -> None:
    before = tree(whole)
    (find_scenarios(whole)[0] / "103" / "000061_semantic3.png").unlink()
    assert run(whole) == [1]
    assert tree(whole) == before


def test_a_folder_that_cannot_be_created_is_named(tmp_path: Path, writer: Make) -> None:
    obstacle = tmp_path / "file"
    obstacle.write_text("")
    with pytest.raises(RunError, match=str(obstacle)), writer(obstacle):
        pass


def test_a_folder_on_another_file_system_is_named(
    tmp_path: Path,
    writer: Make,
    sensor_frames_of: SensorFramesOf,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rename = Path.replace

    def refuse_across_mounts(path: Path, target: Path) -> Path:
        if target.parent.name == "102":
            raise OSError(18, "Invalid cross-device link", str(path), None, str(target))
        return rename(path, target)

    monkeypatch.setattr(Path, "replace", refuse_across_mounts)
    message = r"/102: is mounted from another file system than the dataset; mount or link the whole"
    with pytest.raises(RunError, match=message), writer(tmp_path) as dataset:
        dataset.write_frame(0, sensor_frames_of(0))
    (scenario,) = find_scenarios(tmp_path)
    assert frames_with_any_file(scenario) == set()
    assert not (tmp_path / ".staging").exists()


def test_a_full_disk_is_reported_and_finished_frames_stay(
    tmp_path: Path, writer: Make, sensor_frames_of: SensorFramesOf, spec: Spec
) -> None:
    def full(path: Path, content: bytes) -> None:
        raise OSError(28, "No space left on device", str(path))

    with pytest.raises(RunError, match="No space left on device"), writer(tmp_path) as dataset:
        dataset.write_frame(0, sensor_frames_of(0))
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("advercity.dataset.writer.write_file", full)
            dataset.write_frame(1, sensor_frames_of(1))
    assert verify_scenario(tmp_path / spec.id) == []
    assert Manifest.load(tmp_path / spec.id).frames == (0,)


MODEL = "ab" * 32


@pytest.fixture
def modelled(tmp_path: Path, spec: Spec) -> Path:
    """A scenario without frames, one of whose bodies is a model of the pack."""
    return written(tmp_path, spec)


def written(root: Path, spec: Spec, *missing: str) -> Path:
    model = BodyModel(
        pack="katorlegaz/concept-sedan-01v1", author="Kator Legaz", licence="CC-BY-3.0-US"
    )
    car = spec.blueprints["lincoln_mkz_2017"].model_copy(update={"model": model})
    blueprints = {**spec.blueprints, "lincoln_mkz_2017": car}
    assets = {"model/lincoln_mkz_2017": MODEL}
    spec = spec.model_copy(update={"blueprints": blueprints, "assets": assets})
    identity = Identity.for_spec(
        spec,
        trace_sha256="0" * 64,
        world_sha256="0" * 64,
        renderer={},
        missing_models=missing,
    )
    with ScenarioWriter(root, spec, identity, length=1) as dataset:
        dataset.finish()
    return dataset.scenario


def test_authors_and_licences_of_models_are_written(modelled: Path):
    text = (modelled / ATTRIBUTION_FILE).read_text()
    assert "| lincoln_mkz_2017 | katorlegaz/concept-sedan-01v1 | Kator Legaz |" in text
    assert "[CC-BY-3.0-US](https://creativecommons.org/licenses/by/3.0/us/)" in text
    assert "seat_leon" not in text
    assert Manifest.load(modelled).identity.bodies == {"lincoln_mkz_2017": MODEL}
    assert verify_scenario(modelled) == []


def test_authors_and_licences_of_photographs_are_written(spec: Spec):
    named = spec.model_copy(update={"assets": {EZ_TREE.asset: EZ_TREE.digest}})
    identity = Identity.for_spec(named, trace_sha256="0" * 64, world_sha256="0" * 64, renderer={})
    text = format_attribution(named, identity)
    for name in EZ_TREE.surfaces:
        assert re.search(
            rf"\| {name} \| @dgreenheck/ez-tree \S+ \| Daniel Greenheck \| \[MIT\]", text
        )
    assert "3-D models" not in text
    missing = identity.model_copy(update={"missing_models": (EZ_TREE.asset,)})
    assert format_attribution(named, missing) == ""


def test_without_models_no_attribution_is_written(tmp_path: Path, spec: Spec):
    scenario = written(tmp_path, spec, "lincoln_mkz_2017")
    assert not (scenario / ATTRIBUTION_FILE).exists()
    assert Manifest.load(scenario).identity.missing_models == ("lincoln_mkz_2017",)


def test_a_scenario_with_other_bodies_is_not_continued(modelled: Path, spec: Spec):
    with pytest.raises(RunError, match=r"missing_models: .*lincoln_mkz_2017"):
        written(modelled.parent, spec, "lincoln_mkz_2017")


def test_a_missing_attribution_is_restored(modelled: Path, sensor_frames_of: SensorFramesOf):
    text = (modelled / ATTRIBUTION_FILE).read_text()
    (modelled / ATTRIBUTION_FILE).unlink()
    assert restore_files(modelled, verify_scenario(modelled), sensor_frames_of) == []
    assert (modelled / ATTRIBUTION_FILE).read_text() == text
