"""Conflicts that a suite asks for and a road cannot stage: what is said, and where."""

from pathlib import Path

import pytest
import yaml

from advercity.compiler.crossing import compile_library, validate_paths
from advercity.errors import InputError

SUITE = {
    "kind": "suite",
    "id": "mine",
    "roads": ["ui"],
    "weathers": ["fog_day"],
    "densities": ["sparse"],
    "cross_conflicts": ["ltap_od_ego_turns"],
    "rig": "adver_city",
    "catalogue": "adver_city",
    "looks": "shaped",
}


def write_suite(folder: Path, **changes: object) -> Path:
    path = folder / "suite.yaml"
    path.write_text(yaml.safe_dump(SUITE | changes, sort_keys=False), encoding="utf-8")
    return path


def test_a_road_that_cannot_stage_a_conflict_is_named_and_the_others_are_compiled(
    library: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    write_suite(tmp_path, roads=["unj", "ui", "rcnj"], cross_conflicts=["ltap_od_ego_turns"])

    specs = compile_library(library, tmp_path, suite="mine")

    assert [spec.road.id for spec in specs] == ["ui"]
    assert caplog.messages == [
        f"{road}: cannot stage ltap_od_ego_turns: it is away from junctions, not an intersection"
        for road in ("unj", "rcnj")
    ]


def test_all_conflicts_are_those_that_fit_without_a_word(
    library: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    write_suite(tmp_path, roads=["rcnj"], cross_conflicts="all")

    assert len(compile_library(library, tmp_path, suite="mine")) == 2
    assert not caplog.messages


@pytest.mark.parametrize("asked", [{"cross_conflicts": ["ltip", "rtip"]}, {"stage": "groups"}])
def test_a_conflict_that_ships_and_cannot_be_solved_is_an_error_of_the_suite(
    library: Path, tmp_path: Path, asked: dict[str, object]
) -> None:
    """A recording that begins 30 s after the start leaves no time before the ego's junction."""
    if "stage" in asked:
        asked = {"cross_conflicts": [], "stage": {"rsnj": ["od_overtake"]}, "roads": ["rsnj"]}
    path = write_suite(tmp_path, timing={"warm_up_ticks": 300}, **asked)

    with pytest.raises(InputError) as caught:
        compile_library(library, tmp_path, suite="mine")

    headlines = [line for line in str(caught.value).splitlines() if ".yaml:" in line]
    assert headlines
    assert all(line.startswith(f"{path}:") for line in headlines)
    assert "'rtip' cannot be staged on 'ui': comes " in headlines[-1] or "stage" in asked


def test_validation_of_your_folder_looks_at_your_suites(library: Path, tmp_path: Path) -> None:
    write_suite(tmp_path)
    assert validate_paths(library, tmp_path).endswith(", 1 scenario")

    write_suite(tmp_path, cross_conflicts=["od_drift"])
    with pytest.raises(InputError) as caught:
        validate_paths(library, tmp_path)
    assert str(caught.value).count(".yaml:") == 1
    assert f"{tmp_path / 'suite.yaml'}:" in str(caught.value)


@pytest.mark.parametrize(
    ("fields", "told"),
    [
        ({"stage": {"ri": ["od_drift"]}}, "stage.ri: `roads` does not select 'ri'"),
        ({"roads": ["ui", "ui"]}, "roads.1: 'ui' is named twice"),
        ({"weathers": ["fog_*", "ice_?"]}, "weathers.1: unknown weather 'ice_?'"),
        ({"weathers": ["Fog_*"]}, "weathers.0: 'Fog_*' is neither an id nor a pattern"),
    ],
)
def test_names_of_a_suite_that_select_nothing_are_errors(
    library: Path, tmp_path: Path, fields: dict[str, object], told: str
) -> None:
    write_suite(tmp_path, cross_conflicts=[], **fields)
    with pytest.raises(InputError) as caught:
        compile_library(library, tmp_path, suite="mine")
    assert told in str(caught.value)


def test_a_sun_at_an_unknown_road_is_an_error(library: Path, tmp_path: Path) -> None:
    weather = tmp_path / "low_sun.yaml"
    sun = "{elevation_deg: 10 deg, azimuth_deg: 90 deg}"
    weather.write_text(f"kind: weather\nid: low_sun\nextends: clear_day\nsun_at:\n  rj: {sun}\n")
    write_suite(tmp_path, weathers=["low_sun"])
    with pytest.raises(InputError, match=r"sun_at\.rj: unknown road 'rj'"):
        compile_library(library, tmp_path, suite="mine")


def test_patterns_select_every_id_that_matches(library: Path, tmp_path: Path) -> None:
    write_suite(tmp_path, weathers=["fog_*", "clear_da?"], cross_conflicts=[])
    found = compile_library(library, tmp_path, suite="mine")
    assert sorted(spec.weather.id for spec in found) == ["clear_day", "fog_day", "fog_night"]


@pytest.mark.parametrize(("written", "hint"), [("fog*", "[fog*]"), ("fog_day", "[fog_day]")])
def test_a_text_in_place_of_a_list_is_told_how_to_write_one(
    library: Path, tmp_path: Path, written: str, hint: str
) -> None:
    write_suite(tmp_path, weathers=written)
    with pytest.raises(InputError) as caught:
        compile_library(library, tmp_path, suite="mine")
    assert hint in str(caught.value)
