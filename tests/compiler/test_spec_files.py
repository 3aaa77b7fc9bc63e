import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from advercity_dsl import Spec

from advercity.compiler import (
    DiagnosticsError,
    describe_spec_differences,
    read_spec,
    to_json,
    with_digest,
    write_specs,
)
from advercity.compiler.crossing import compile_library
from advercity.errors import InputError
from tests.builders import Write


def test_specs_are_read_back_as_they_were_written(specs: dict[str, Spec], tmp_path: Path) -> None:
    spec = specs["rcnj_fog_night_dense"]
    write_specs([spec], tmp_path)
    assert read_spec(tmp_path / f"{spec.id}.json") == spec


def test_a_spec_stays_below_forty_kilobytes(specs: dict[str, Spec]) -> None:
    assert max(len(to_json(spec)) for spec in specs.values()) < 40_000


def test_writing_removes_obsolete_specs_of_the_suite_and_nothing_else(
    write: Write, tmp_path: Path
) -> None:
    """A copy under another name, and a spec that was edited, are the user's."""
    (spec,) = compile_library(write())
    folder = tmp_path / "compiled"
    write_specs([spec], folder)
    written = json.loads((folder / f"{spec.id}.json").read_text())
    (folder / "gone.json").write_text(to_json(with_digest(spec.model_copy(update={"id": "gone"}))))
    mine = {"mine": {"mine": 1}, "copy": written, "edited": written | {"id": "edited"}}
    for name, data in mine.items():
        (folder / f"{name}.json").write_text(json.dumps(data))
    assert write_specs([spec], folder) == "1 unchanged, 1 removed"
    left = {path.stem for path in folder.iterdir()}
    assert left == {"lane_clear_day_sparse", *mine}


def test_a_file_that_is_not_as_compiled_is_not_replaced(write: Write, tmp_path: Path) -> None:
    """An edited spec, and anything of that name; a spec of an earlier compilation is replaced."""
    (spec,) = compile_library(write())
    path = tmp_path / f"{spec.id}.json"
    write_specs([spec], tmp_path)
    other = spec.weather.model_copy(update={"title": "other"})
    edited = spec.model_copy(update={"weather": other})
    path.write_text(to_json(with_digest(edited)))
    assert write_specs([spec], tmp_path) == "1 changed"
    for mine in (to_json(edited), "mine", "[]"):
        path.write_text(mine)
        with pytest.raises(InputError, match=r"\.json: is not as it was compiled, .*rename or del"):
            write_specs([spec], tmp_path)
        assert path.read_text() == mine


def test_links_to_specs_are_neither_removed_nor_replaced(write: Write, tmp_path: Path) -> None:
    (spec,) = compile_library(write())
    folder, elsewhere = tmp_path / "compiled", tmp_path / "elsewhere"
    former = spec.model_copy(
        update={"weather": spec.weather.model_copy(update={"title": "former"})}
    )
    write_specs([with_digest(former.model_copy(update={"id": "gone"}))], elsewhere)
    write_specs([with_digest(former)], elsewhere)
    write_specs([], folder)
    gone, current = folder / "gone.json", folder / f"{spec.id}.json"
    gone.symlink_to(elsewhere / gone.name)
    assert write_specs([spec], folder) == "1 new"
    current.unlink()
    current.symlink_to(elsewhere / current.name)
    with pytest.raises(InputError, match="is not as it was compiled, and would be replaced"):
        write_specs([spec], folder)
    assert gone.is_symlink() and current.is_symlink()


def test_what_a_killed_compilation_has_left_is_removed(write: Write, tmp_path: Path) -> None:
    (spec,) = compile_library(write())
    folder = tmp_path / "compiled"
    code = f"""
import os
from pathlib import Path
from advercity.atomic_files import open_partial_path
with open_partial_path(Path({str(folder / "a.json")!r})) as partial:
    partial.write_text("half")
    os._exit(9)
"""
    assert subprocess.run([sys.executable, "-c", code]).returncode == 9
    (folder / ".partial-mine").mkdir()
    assert len(list(folder.iterdir())) == 2
    write_specs([spec], folder)
    assert {path.name for path in folder.iterdir()} == {f"{spec.id}.json", ".partial-mine"}


def test_differences_name_missing_and_obsolete_specs(write: Write, tmp_path: Path) -> None:
    (spec,) = compile_library(write())
    folder = tmp_path / "compiled"
    assert describe_spec_differences([spec], folder) == [
        f"{folder}/lane_clear_day_sparse.json: is missing"
    ]
    write_specs([spec], folder)
    assert describe_spec_differences([spec], folder) == []
    (folder / "lane_clear_day_sparse.json").write_text("{}")
    assert "differs" in describe_spec_differences([spec], folder)[0]


@pytest.mark.parametrize("field", ["id", "number"])
def test_agents_of_a_spec_have_different_ids_and_numbers(
    write: Write, tmp_path: Path, field: str
) -> None:
    (spec,) = compile_library(write())
    data = json.loads(to_json(spec))
    data["agents"][1][field] = data["agents"][0][field]
    path = tmp_path / "twins.json"
    path.write_text(json.dumps(data))
    with pytest.raises(InputError, match=f"two agents have the same {field}"):
        read_spec(path)


def test_a_truncated_spec_is_reported_with_its_position(write: Write, tmp_path: Path) -> None:
    (spec,) = compile_library(write())
    path = tmp_path / "cut.json"
    path.write_text(to_json(spec)[:-200])
    with pytest.raises(InputError, match=r"cut\.json:\d+:\d+: not valid JSON.*is it truncated\?"):
        read_spec(path)


def test_an_invalid_value_of_a_spec_is_reported_with_its_position(
    write: Write, tmp_path: Path
) -> None:
    (spec,) = compile_library(write())
    data = json.loads(to_json(spec))
    data["weather"]["rain"]["rate_mm_h"] = 1000
    path = tmp_path / "wet.json"
    path.write_text(json.dumps(data, indent=1))
    with pytest.raises(
        DiagnosticsError, match=r"wet\.json:\d+:\d+: weather\.rain\.rate_mm_h: .*150"
    ):
        read_spec(path)


def test_numbers_that_json_lacks_are_rejected(write: Write, tmp_path: Path) -> None:
    path = tmp_path / "nan.json"
    path.write_text('{"spec_version": NaN}')
    with pytest.raises(InputError, match="NaN is not a number in JSON"):
        read_spec(path)


@pytest.mark.parametrize(("version", "way_out"), [(0, "compile its library"), (2, "upgrade")])
def test_a_spec_of_another_version_is_reported_with_what_to_do(
    specs: dict[str, Spec], tmp_path: Path, version: int, way_out: str
) -> None:
    data = json.loads(to_json(specs["ui_fog_day_sparse"])) | {"spec_version": version}
    path = tmp_path / "spec.json"
    path.write_text(json.dumps(data))
    with pytest.raises(DiagnosticsError, match=f"has version {version}; this .* {way_out}"):
        read_spec(path)


@pytest.mark.parametrize("kind", ["pipe", "device", "dangling link", "other bytes"])
def test_what_is_no_text_in_place_of_a_spec_is_neither_opened_nor_replaced(
    write: Write, tmp_path: Path, kind: str
) -> None:
    (spec,) = compile_library(write())
    path = tmp_path / "specs" / f"{spec.id}.json"
    path.parent.mkdir()
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "other bytes":
        path.write_bytes(b"\xff\xfe{")
    else:
        path.symlink_to("/dev/zero" if kind == "device" else tmp_path / "nowhere")
    before = path.lstat()
    with pytest.raises(InputError, match=r"\.json: is not as it was compiled, .*rename or del"):
        write_specs([spec], path.parent)
    after = path.lstat()
    assert (after.st_ino, after.st_mode, after.st_mtime_ns) == (
        before.st_ino,
        before.st_mode,
        before.st_mtime_ns,
    )
    (difference,) = describe_spec_differences([spec], path.parent)
    wrong = "is missing" if kind == "dangling link" else "differs from what the library compiles to"
    assert difference == f"{path}: {wrong}"
