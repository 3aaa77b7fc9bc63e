"""Conflicts that a map is said to stage, and declarations that stage them."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from advercity_dsl import Road
from advercity_dsl.road import JunctionAgents

from advercity.compiler import map_suggestions
from advercity.compiler.crossing import compile_library
from advercity.compiler.map_suggestions import suggest_conflicts, write_suggestions
from advercity.errors import InputError
from advercity.roads.junction_arms import place_at_every_arm
from tests.roads.imported_roads import DATA


def test_what_is_suggested_compiles_as_it_is_suggested(library: Path, tmp_path: Path) -> None:
    found = suggest_conflicts(DATA / "crossroads.osm", "osm")
    written = {path.name for path in write_suggestions(found, DATA / "crossroads.osm", tmp_path)}
    assert written == {"crossroads.yaml", "suite.yaml", "crossroads.osm"}
    asked = sorted({name for item in found.junctions for name in item.conflicts})
    suite = yaml.safe_load((tmp_path / "suite.yaml").read_text())
    (tmp_path / "suite.yaml").write_text(yaml.safe_dump(suite | {"cross_conflicts": asked}))

    specs = compile_library(library, tmp_path, suite="crossroads")

    staged = {(spec.road.id, spec.provenance.conflict) for spec in specs}
    assert {
        (f"{item.road}_{item.junction}", name)
        for item in found.junctions
        for name in item.conflicts
    } == staged


def test_a_junction_with_lights_is_suggested_conflicts_of_such(library: Path) -> None:
    found = suggest_conflicts(DATA / "crossroads.osm", "osm")

    signals = next(item for item in found.junctions if item.control == "signals")

    assert "ltap_od_ego_turns" in signals.conflicts
    assert "scp_unsignalised" not in signals.conflicts
    # Nobody holds up those who walk or ride on a path of their own.
    kinds = [name.startswith(("ped_", "cyc_")) for name in signals.conflicts]
    assert kinds == sorted(kinds, reverse=True)
    assert {"(north)", "(south)"} <= set(signals.arms.replace(",", "").split())


def test_a_map_without_a_junction_of_three_arms_says_so() -> None:
    with pytest.raises(InputError, match="no junction of three arms"):
        suggest_conflicts(DATA / "bend.xodr", "opendrive")


def write_two_junctions(folder: Path) -> Path:
    """Write the crossroads with a side street to the north, 104 m east of it."""
    middle = '<nd ref="1"/><nd ref="4"/>'
    nodes = '<node id="7" lat="48.0" lon="11.0014"/><node id="8" lat="48.0018" lon="11.0014"/>'
    way = '<way id="14"><nd ref="7"/><nd ref="8"/><tag k="highway" v="residential"/></way>'
    text = (DATA / "crossroads.osm").read_text()
    assert middle in text
    text = text.replace(middle, '<nd ref="1"/><nd ref="7"/><nd ref="4"/>')
    text = text.replace('<way id="11">', f'{nodes}<way id="11">')
    file = folder / "two.osm"
    file.write_text(text.replace("</osm>", f"{way}</osm>"))
    return file


def test_a_junction_that_fails_does_not_cost_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def place(road: Road, declared: JunctionAgents, junction: str) -> list[Road]:
        if junction == "j1":
            raise InputError("its arms cross")
        return place_at_every_arm(road, declared, junction)

    monkeypatch.setattr(map_suggestions, "place_at_every_arm", place)
    seen: list[tuple[int, int]] = []

    found = suggest_conflicts(
        write_two_junctions(tmp_path),
        "osm",
        on_junction=lambda done, total: seen.append((done, total)),
    ).junctions

    assert {item.junction: item.reason for item in found}["j1"] == "its arms cross"
    assert {item.junction for item in found if item.reason != "its arms cross"} == {"j7"}
    assert seen == [(0, 2), (1, 2)]


def test_the_junctions_with_the_most_arms_are_tried_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(map_suggestions, "MAX_JUNCTIONS", 1)

    found = suggest_conflicts(write_two_junctions(tmp_path), "osm")

    assert found.untried_count == 1
    assert {(item.junction, item.arms.count("(")) for item in found.junctions} == {("j1", 4)}


def test_the_ego_comes_from_the_arm_from_which_a_conflict_can_be_staged(
    library: Path, tmp_path: Path
) -> None:
    """Without an arm to the south, two conflicts need an ego on the main street or not on it."""
    file = tmp_path / "tee.osm"
    file.write_text((DATA / "crossroads.osm").read_text().replace('<nd ref="3"/>', ""))
    found = suggest_conflicts(file, "osm")
    suggested = {
        name for item in found.junctions if item.junction == "j1" for name in item.conflicts
    }
    list(write_suggestions(found, file, tmp_path))
    suite = yaml.safe_load((tmp_path / "suite.yaml").read_text())
    asked = {"cross_conflicts": ["ltap_od_ego_turns", "rtip"]}
    (tmp_path / "suite.yaml").write_text(yaml.safe_dump(suite | asked))

    specs = compile_library(library, tmp_path, suite="tee")

    assert {*asked["cross_conflicts"]} <= suggested
    headings = {spec.provenance.conflict: spec.road.ego.heading_deg for spec in specs}
    assert abs(np.cos(np.radians(headings["ltap_od_ego_turns"]))) > 0.9
    assert np.sin(np.radians(headings["rtip"])) < -0.9


def test_arms_of_a_left_hand_map_are_those_of_the_world(tmp_path: Path) -> None:
    """A junction of three arms, none of which leads to the south."""
    street, to_the_south = '<tag k="highway" v="secondary"/>', '<nd ref="3"/>'
    text = (DATA / "crossroads.osm").read_text()
    assert to_the_south in text
    text = text.replace(to_the_south, "")
    file = tmp_path / "junction.osm"
    file.write_text(text.replace(street, f'{street}<tag k="driving_side" v="left"/>'))

    found = suggest_conflicts(file, "osm").junctions

    signals = next(item for item in found if item.control == "signals")
    directions = {arm.rpartition(" ")[2] for arm in signals.arms.split(", ")}
    assert directions == {"(north)", "(east)", "(west)"}
    assert signals.conflicts
