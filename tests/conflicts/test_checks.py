"""What keeps a conflict from being staged is told to whoever wrote it."""

import re
import shutil
from itertools import pairwise
from pathlib import Path

import pytest
from advercity_dsl import Typology

from advercity.compiler import DiagnosticsError, load_library
from advercity.compiler.crossing import compile_library

NHTSA = Path(__file__).parents[2] / "library" / "nhtsa"


@pytest.fixture
def copied(tmp_path: Path) -> Path:
    """A copy of the shipped library with one weather, which is quicker to cross."""
    shutil.copytree(NHTSA, tmp_path / "nhtsa")
    for path in (tmp_path / "nhtsa" / "weather").glob("*.yaml"):
        if path.stem != "clear_day":
            path.unlink()
    return tmp_path / "nhtsa"


def edited(library: Path, path: str, old: str, new: str) -> None:
    text = (library / path).read_text()
    assert old in text
    (library / path).write_text(text.replace(old, new))


def select_road(library: Path, road: str) -> None:
    """Select one road in the suite, without conflicts on the others."""
    edited(library, "suites/adver_city.yaml", "roads: all", f"roads: [{road}]")
    path = library / "suites/adver_city.yaml"
    others = rf"^  (?!{road}:)\w+: \[(?:ltap|ped|cyc|od)_.*\n"
    path.write_text(re.sub(others, "", path.read_text(), flags=re.MULTILINE))


MISTAKES = {
    "V1 a parameter without its unit": (
        "conflicts/od_drift.yaml",
        "  drift_time_s:",
        "  drift_time:",
        "parameters.drift_time: no such field; did you mean 'drift_time_s'?",
    ),
    "V2 an id without its edition": (
        "conflicts/od_drift.yaml",
        "nhtsa2019:19",
        '"19"',
        'stages.0: 19 does not name an edition; write "nhtsa2019:19" or "nhtsa2007:19"',
    ),
    "V2 an unknown crash type": (
        "conflicts/od_drift.yaml",
        "nhtsa2019:19",
        "nhtsa2019:77",
        "stages.0: unknown crash type 'nhtsa2019:77'",
    ),
    "V3 a threshold that drops a group": (
        "suites/adver_city.yaml",
        "fatality_rate_percent: 0.30",
        "fatality_rate_percent: 0.50",
        "no selected group calls for crossing_paths on 'ui'",
    ),
    "V4 a head-on conflict beside a median": (
        "suites/adver_city.yaml",
        "unj: [ped_farside_crossing]",
        "unj: [od_drift]",
        "'od_drift' cannot be staged on 'unj': a median divides it",
    ),
    "V5 an ego that may not go fast enough": (
        "conflicts/od_drift.yaml",
        "ego_speed_km_h: {draw: {uniform: [20, 80]}",
        "ego_speed_km_h: {draw: {uniform: [38, 80]}",
        "38 to 80 km/h leave 1.0 km/h below the 39.0 km/h that the ego drives there on 'rcnj'",
    ),
    "V5 an ego that turns left too slowly": (
        "conflicts/ltap_od_ego_turns.yaml",
        "ego_speed_km_h: {draw: {uniform: [10, 25]}",
        "ego_speed_km_h: {draw: {uniform: [40, 60]}",
        "40 to 60 km/h leave 0.0 km/h below",
    ),
    "V8 one event before the other is over": (
        "suites/adver_city.yaml",
        "ui: [ltap_od_ego_turns, ped_farside_crossing, cyc_nearside_obstructed]",
        "ui: [ltap_od_ego_turns, ped_left_turn, cyc_nearside_obstructed]",
        "s after 'ltap_od_ego_turns'; at least 4 s are needed",
    ),
    "V8 an event before anybody could see it coming": (
        "suites/adver_city.yaml",
        "warm_up_ticks: 59",
        "warm_up_ticks: 300",
        "s after the recording begins; at least 4 s are needed",
    ),
    "V6 an approach that is too short": (
        "conflicts/ped_farside_crossing.yaml",
        "braking_m_s2: {draw: {uniform: [2.0, 3.0]}}",
        "braking_m_s2: {draw: 0.02}",
        "there is room to reach",
    ),
    "V6 a junction too near the end of its street": (
        "conflicts/ltap_od_ego_turns.yaml",
        "actor_speed_km_h: {draw: {uniform: [30, 80]}",
        "actor_speed_km_h: {draw: {uniform: [50, 80]}",
        "km/h and stop again, not the 50 to 80 km/h asked for",
    ),
    "V7 a pedestrian who outruns everybody": (
        "conflicts/ped_farside_crossing.yaml",
        "actor_speed_km_h: {draw: {uniform: [6, 11]}",
        "actor_speed_km_h: {draw: {uniform: [6, 20]}",
        "up to 20 km/h, but a pedestrian goes no faster than 12 km/h",
    ),
    "V7 a drift that is a swerve": (
        "conflicts/od_drift.yaml",
        "drift_time_s: {draw: {uniform: [2.0, 2.6]}}",
        "drift_time_s: {draw: 1.0}",
        "no driver that drifts exceeds",
    ),
    "V7 an overtaking that is a swerve": (
        "conflicts/od_overtake.yaml",
        "drift_time_s: {draw: {uniform: [3.1, 3.4]}",
        "drift_time_s: {draw: 2.0",
        "no driver that overtakes exceeds 1.5",
    ),
    "V8 a cyclist who is too fast to be overtaken": (
        "conflicts/od_overtake.yaml",
        "passed_speed_km_h: {draw: {uniform: [9, 13]}",
        "passed_speed_km_h: {draw: 40",
        "the cyclist is not slower than the actor that overtakes it",
    ),
    "V8 an actor that would come too late": (
        "conflicts/ltap_od_ego_turns.yaml",
        "actor_speed_km_h: {draw: {uniform: [30, 80]}",
        "actor_speed_km_h: {draw: 1",
        "s to the point, but the ego is there after",
    ),
    "V9 a conflict that always misses": (
        "conflicts/ltap_od_ego_turns.yaml",
        "time_to_collision_below_s: 2.0",
        "time_to_collision_below_s: 0.2",
        "that is never below 0.2 s",
    ),
    "V10 pedestrians where nobody walks": (
        "roads/unj.yaml",
        "walkers: 60",
        "walkers: 0",
        "'unj' has no walkers, whose number",
    ),
    "V10 glare by night": (
        "weather/clear_day.yaml",
        "time: day",
        "time: night",
        "sun.elevation_deg: the sun is at 60 deg, but it is night (time)",
    ),
    "V11 a vehicle beside the map": (
        "roads/unj.yaml",
        "spawn_m: [218.69, 5.03]",
        "spawn_m: [1000, 2000]",
        "m from the nearest lane of this map; the limit is 3.5 m; is it the right map?",
    ),
    "V11 a roadside unit of another town": (
        "roads/unj.yaml",
        "position_m: [140.61, 12.2, 8.61]",
        "position_m: [-300, 900, 8.61]",
        "from the nearest lane of this map; the limit is 100 m; is it the right map?",
    ),
    "V12 parked cars too far away to hide anybody": (
        "conflicts/ped_nearside_obstructed.yaml",
        "obstruction_gap_m: {draw: {uniform: [0.5, 1.5]}",
        "obstruction_gap_m: {draw: 70",
        "the ego sees the actor all the time: parked cars that end 70.0 m before it hide nothing",
    ),
    "V13 an id that is taken": (
        "suites/conflicts.yaml",
        "id: conflicts",
        "id: adver_city",
        "id: suite 'adver_city' is already declared in",
    ),
    "V14 a group that nothing stages": (
        "suites/adver_city.yaml",
        "ri: [ltap_od_ego_turns, cyc_nearside_obstructed]",
        "ri: [ltap_od_ego_turns]",
        "'ri' is selected for pedalcyclist, which none of its scenarios stages",
    ),
    "V14 a group whose turn never comes": (
        "suites/adver_city.yaml",
        "default: true",
        "default: true\nstaged_at_once: 2\nrepeats: 1",
        "'ui' is selected for pedalcyclist, which none of its scenarios stages",
    ),
    "V14 a conflict after a collision": (
        "suites/adver_city.yaml",
        "default: true",
        "default: true\nresolved_by: {nobody: 1}",
        "the scenario ends with the collision of 'ltap_od_ego_turns'",
    ),
    "V14 an ego that would have to turn both ways": (
        "suites/adver_city.yaml",
        "ri: [ltap_od_ego_turns, cyc_nearside_obstructed]",
        "ri: [ltap_od_ego_turns, cyc_right_hook]",
        "the ego cannot go left and right in one scenario",
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_what_keeps_a_conflict_from_happening_is_reported(mistake: str, copied: Path):
    path, old, new, message = MISTAKES[mistake]
    edited(copied, path, old, new)

    with pytest.raises(DiagnosticsError) as caught:
        for suite in ("adver_city", "conflicts"):
            compile_library(copied, suite=suite)

    assert message in str(caught.value)


def test_a_suite_that_lists_its_roads_stages_any_conflict_on_them(copied: Path):
    select_road(copied, "ri")
    edited(
        copied,
        "suites/adver_city.yaml",
        "ri: [ltap_od_ego_turns, cyc_nearside_obstructed]",
        "ri: [ltap_od_ego_turns]",
    )

    specs = compile_library(copied, suite="adver_city")

    assert {tuple(item.conflict for item in spec.conflicts) for spec in specs} == {
        ("ltap_od_ego_turns",)
    }


def test_v13_ids_are_unique_and_specs_are_the_same_each_time(copied: Path):
    first, second = compile_library(copied), compile_library(copied)

    assert len({spec.id for spec in first}) == len(first) == 10
    assert [spec.provenance.digest for spec in first] == [spec.provenance.digest for spec in second]


def test_conflicts_crossed_with_roads_make_31_cells(copied: Path):
    specs = compile_library(copied, suite="conflicts")

    assert len({(spec.road.id, spec.conflicts[0].conflict) for spec in specs}) == 31
    assert len(specs) == 31 * 2
    assert all(len(spec.conflicts) == 1 for spec in specs)
    for conflict in (spec.conflicts[0] for spec in specs):
        hides = "obstruction_gap_m" in conflict.parameters
        assert (conflict.parameters.get("occlusion_m", 0.0) > 3.0) == hides


def test_no_conflict_has_a_parameter_outside_its_declared_range(copied: Path):
    conflicts = [
        conflict
        for suite in ("adver_city", "conflicts", "unsignalised")
        for spec in compile_library(copied, suite=suite)
        for conflict in spec.conflicts
    ]

    assert len(conflicts) == 16 + 62 + 6
    for conflict in conflicts:
        for name, (low, high) in conflict.declared.items():
            value = conflict.parameters[name]
            assert low - 0.01 <= value <= high + 0.01, (conflict.conflict, name)


def test_junctions_without_lights_have_stop_signs_for_those_from_the_sides(copied: Path):
    specs = compile_library(copied, suite="unsignalised")

    assert {(spec.road.id, spec.conflicts[0].conflict) for spec in specs} == {
        (road, conflict)
        for road in ("ui", "ri")
        for conflict in ("scp_unsignalised", "ltap_ld", "ltip")
    }
    for spec in specs:
        junction = spec.road.junctions["j_main"]
        streets = {movement.split(".")[0] for movement in junction.movements}
        assert (junction.control, junction.signals) == ("stop", None)
        assert {sign.street for sign in junction.signs} == {
            street for street in streets if street[:4] in ("east", "west")
        }


def test_conflicts_that_only_fit_are_crossed_where_a_suite_says_so(copied: Path):
    suite = "suites/unsignalised.yaml"
    edited(copied, suite, "[scp_unsignalised, ltap_ld, ltip]", "[ped_left_turn]")
    edited(copied, suite, "[variant]", "[extension]")

    specs = compile_library(copied, suite="unsignalised")

    assert [spec.id for spec in specs] == ["ri_ped_left_turn_clear_day_sparse"]


def test_a_road_of_its_own_that_a_crossed_conflict_does_not_fit_is_not_left_out(copied: Path):
    """Only junctions that a rule has chosen are: a road that somebody declared is reported."""
    edited(copied, "roads/ri.yaml", "max_speed_km_h: 30", "max_speed_km_h: 6")

    with pytest.raises(DiagnosticsError, match="'ri'") as caught:
        compile_library(copied, suite="unsignalised")

    assert "'ui'" not in str(caught.value)


def test_another_conflict_leaves_the_draws_of_the_others(copied: Path):
    edited(copied, "suites/adver_city.yaml", "default: true", "default: true\nstaged_at_once: 1")
    select_road(copied, "unj")
    before = {spec.id: spec.conflicts for spec in compile_library(copied)}
    edited(
        copied,
        "suites/adver_city.yaml",
        "unj: [ped_farside_crossing]",
        "unj: [ped_farside_crossing, ped_along_road]",
    )

    assert {spec.id: spec.conflicts for spec in compile_library(copied)} == before


def test_who_crosses_next_crosses_farther_on(copied: Path):
    select_road(copied, "unj")
    pair = "unj: [ped_farside_crossing, ped_nearside_crossing]"
    edited(copied, "suites/adver_city.yaml", "unj: [ped_farside_crossing]", pair)
    edited(copied, "roads/unj.yaml", "destination_m: [67.61, 3.66]", "destination_m: [20, 3.66]")

    for spec in compile_library(copied):
        far, near = spec.conflicts

        assert near.station_m > far.station_m + 40.0
        assert near.window_s[0] >= far.window_s[0] + 4.0


def test_both_densities_of_a_road_stage_the_same_and_every_group_that_calls_for_it(copied: Path):
    wanted = {
        "ui": {"crossing_paths", "pedestrian", "pedalcyclist"},
        "unj": {"pedestrian"},
        "ri": {"crossing_paths", "pedalcyclist"},
        "rsnj": {"opposite_direction"},
        "rcnj": {"opposite_direction"},
    }
    staged: dict[str, set[tuple[str, ...]]] = {}
    for spec in compile_library(copied):
        staged.setdefault(spec.road.id, set()).add(tuple(one.conflict for one in spec.conflicts))
        assert {conflict.typology for conflict in spec.conflicts} == wanted[spec.road.id]
        times_s = [sum(conflict.window_s) / 2 for conflict in spec.conflicts]
        assert all(later - one >= 4.0 for one, later in pairwise(times_s))

    assert {road: len(kinds) for road, kinds in staged.items()} == dict.fromkeys(wanted, 1)


def test_repeats_take_turns_over_the_conflicts_of_a_road_in_both_densities(copied: Path):
    turns = ("ltap_od_ego_turns", "ped_left_turn", "cyc_left_turn")
    select_road(copied, "ui")
    edited(
        copied,
        "suites/adver_city.yaml",
        "ui: [ltap_od_ego_turns, ped_farside_crossing, cyc_nearside_obstructed]",
        f"ui: [{', '.join(turns)}]",
    )
    edited(copied, "suites/adver_city.yaml", "default: true", "repeats: 3\nstaged_at_once: 1")

    staged = [
        (spec.density.id, spec.id[-2:], [one.conflict for one in spec.conflicts])
        for spec in compile_library(copied, suite="adver_city")
    ]

    assert sorted(staged) == [
        (density, f"r{repeat}", [turn])
        for density in ("dense", "sparse")
        for repeat, turn in enumerate(turns, start=1)
    ]


def test_diverse_stages_all_conflicts(copied: Path):
    staged = {
        one.conflict for spec in compile_library(copied, suite="diverse") for one in spec.conflicts
    }

    assert staged == {path.stem for path in (copied / "conflicts").iterdir()}
    assert len(staged) == 20


def test_both_editions_are_whole_and_joined():
    typologies = load_library(NHTSA).get_declarations(Typology).values()
    newer = [item for typology in typologies for item in typology.crash_types]
    older = {item.id for typology in typologies for item in typology.earlier}

    assert {item.id for item in newer} == {f"nhtsa2019:{number}" for number in range(1, 37)}
    assert older == {f"nhtsa2007:{number}" for number in range(1, 38)}
    assert {name for item in newer for name in item.derived_from} == older
