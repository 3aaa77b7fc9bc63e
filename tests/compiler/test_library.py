import shutil
from pathlib import Path

import pytest
from advercity_dsl import Conflict

from advercity.compiler import (
    find_weather,
    load_library,
)
from advercity.errors import InputError
from tests.builders import SMALL_LIBRARY, Write, describe_errors

FOG = "kind: weather\nid: fog\ntime: day\n"


def test_a_conflict_builds_on_one_of_the_shipped_library_that_is_not_its_own(
    tmp_path: Path,
) -> None:
    (tmp_path / "hook.yaml").write_text(
        "kind: conflict\nid: hook\nextends: cyc_right_hook\ntitle: A truck turns\n"
    )
    library = load_library(tmp_path)
    (conflict,) = library.get_declarations(Conflict).values()
    assert (conflict.id, conflict.actor.comes) == ("hook", "alongside")
    assert list(library.entries) == [("conflict", "hook")]


def test_all_errors_of_all_files_are_reported_together_in_order(write: Write) -> None:
    folder = write(
        weather="kind: weather\nid: w\ntime: noon\nrain: {rate_mm_h: -1}\nwnd: {}\n",
        density="kind: density\nid: sparse\nvehicles: many\nwalkers: 1\n",
    )
    lines = describe_errors(folder).splitlines()
    assert [line.split(" ")[0] for line in lines] == [
        "density.yaml:3:11:",
        "weather.yaml:3:7:",
        "weather.yaml:4:19:",
        "weather.yaml:5:1:",
    ]


def test_an_empty_folder_is_not_a_library(tmp_path: Path) -> None:
    assert "no declarations" in describe_errors(tmp_path)


def test_a_link_out_of_the_library_shows_nothing_of_its_file(write: Write, tmp_path: Path) -> None:
    secret = tmp_path / "secret.yaml"
    secret.write_text("password: swordfish\n")
    folder = write()
    (folder / "inside.yaml").symlink_to(folder / "weather.yaml")
    (folder / "mine.yaml").symlink_to(secret)
    found = describe_errors(folder)
    assert "mine.yaml: is a link out of the library; put the file itself in its place" in found
    assert "inside.yaml: is a link" not in found
    assert "swordfish" not in found


def test_a_file_may_extend_a_neighbour(tmp_path: Path) -> None:
    (tmp_path / "fog.yaml").write_text(FOG + "extends: clear_day\nfog: {mor_m: 75}\n")
    (tmp_path / "thick.yaml").write_text(FOG.replace("fog", "thick") + "extends: fog\n")
    (tmp_path / "broken.yaml").write_text("kind: weather\n- nothing\n")
    assert find_weather(str(tmp_path / "thick.yaml")).declaration.fog.mor_m == 75


def test_a_folder_that_is_too_large_for_a_library_is_not_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("advercity.compiler.library.MAX_FILES", 5)
    shutil.copytree(SMALL_LIBRARY, tmp_path / "deep" / "library")
    with pytest.raises(InputError, match="more than 5 files and folders; is it a library folder"):
        load_library(tmp_path)
