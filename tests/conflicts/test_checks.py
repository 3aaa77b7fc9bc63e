"""What keeps a conflict from being staged is told to whoever wrote it."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from advercity_dsl import Conflict, Road, Spec, Typology, Vehicle

from advercity.compiler import DiagnosticsError, load_library
from advercity.compiler.crossing import compile_library
from advercity.conflicts.binding import match_conflict, with_ego_manoeuvre
from advercity.conflicts.ego_motion import NominalMotion
from advercity.conflicts.solver import build_car_outline, compute_sight_distance_m
from advercity.physics.stopping import compute_stopping_distance
from advercity.pipeline.descriptions import describe_spec
from advercity.roads.routes import RoutePath, RoutePlanner

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
        "stages.0: 'nhtsa2019:77' is no crash type of this library",
    ),
    "V3 a threshold that drops a group": (
        "suites/adver_city.yaml",
        "fatality_rate_percent: 0.30",
        "fatality_rate_percent: 0.50",
        "no selected group calls for crossing_paths on 'ui'",
    ),
    "V4 a head-on conflict beside a median": (
        "suites/adver_city.yaml",
        "unj: [ped_farside_crossing, ped_nearside_crossing]",
        "unj: [od_drift]",
        "'od_drift' cannot be staged on 'unj': a median divides it",
    ),
    "V5 an ego that may not go fast enough": (
        "conflicts/od_drift.yaml",
        "ego_speed_km_h: {draw: {uniform: [30, 80]}",
        "ego_speed_km_h: {draw: {uniform: [38, 80]}",
        "38 to 80 km/h leave 2 km/h below the ego's 40 km/h on 'rcnj'; at least 5 are needed",
    ),
    "V6 an approach that is too short": (
        "conflicts/ped_farside_crossing.yaml",
        "braking_m_s2: {draw: {uniform: [2.0, 3.0]}}",
        "braking_m_s2: {draw: 0.02}",
        "there is room to reach",
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
        "actor_speed_km_h: {draw: 4",
        "s to the point, but the ego is there after",
    ),
    "V9 a conflict that always misses": (
        "conflicts/ltap_od_ego_turns.yaml",
        "time_to_collision_below_s: 1.5",
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
        "sun.elevation_deg: the sun stands at 60 deg, but it is night",
    ),
    "V11 a vehicle beside the map": (
        "roads/unj.yaml",
        "spawn_m: [218.69, 5.03]",
        "spawn_m: [1000, 2000]",
        "m from the nearest lane of this map; it may be 3.5 m away; is it the right map?",
    ),
    "V11 a roadside unit of another town": (
        "roads/unj.yaml",
        "position_m: [140.61, 12.2, 8.61]",
        "position_m: [-300, 900, 8.61]",
        "from the nearest lane of this map; it may be 100 m away; is it the right map?",
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
        "id: suite 'adver_city' is declared in",
    ),
    "V14 a group that nothing stages": (
        "suites/adver_city.yaml",
        "ri: [ltap_od_ego_turns, cyc_left_turn]",
        "ri: [ltap_od_ego_turns]",
        "'ri' is selected for pedalcyclist, which none of its conflicts stages",
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_what_keeps_a_conflict_from_happening_is_told(mistake: str, copied: Path):
    path, old, new, message = MISTAKES[mistake]
    edited(copied, path, old, new)

    with pytest.raises(DiagnosticsError) as caught:
        for suite in ("adver_city", "conflicts"):
            compile_library(copied, suite=suite)

    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("mor_m", "told"),
    [
        # 35 km/h are 9.72 m/s: 14.58 m to react, 94.52 / (2 x 0.785 x 9.81) = 6.14 m to brake.
        (75, "21 m from 35 km/h, with 1.5 s to react and a friction of 0.79; visibility 75 m: the"
         " ego can stop in sight"),
        (15, "visibility 15 m: the ego cannot stop in sight"),
    ],
)  # fmt: skip
def test_v12_whether_the_ego_can_stop_in_sight_is_told(
    mor_m: float, told: str, specs: dict[str, Spec]
):
    spec = specs["ui_fog_day_sparse"]
    fog = spec.weather.fog.model_copy(update={"mor_m": mor_m})
    weather = spec.weather.model_copy(update={"fog": fog})

    facts = describe_spec(spec.model_copy(update={"weather": weather}))

    assert facts["stopping"].endswith(told)


def test_v12_whether_the_ego_can_stop_before_whoever_it_sees_late_is_told(specs: dict[str, Spec]):
    spec = specs["ui_clear_day_sparse"]
    first, *others = spec.conflicts
    hidden = first.model_copy(update={"parameters": first.parameters | {"occlusion_m": 12.0}})

    found = compute_stopping_distance(spec.model_copy(update={"conflicts": (*others, hidden)}))

    assert spec.ego.blueprint is not None
    half_m = spec.blueprints[spec.ego.blueprint].length_m / 2
    assert found.occlusion_m == pytest.approx(12.0 - half_m, abs=0.01)
    assert not found.can_stop_in_sight
    assert str(found).endswith("10 m past parked cars: the ego cannot stop in sight")
    assert compute_stopping_distance(spec).occlusion_m is None


def test_whoever_comes_out_behind_a_parked_car_is_seen_past_its_corner():
    """The line from 10 m/s ahead to 2 m/s aside passes the corner 1.5 m before, 3 m aside."""
    way = RoutePath(np.array([[0.0, 0.0], [100.0, 0.0]]), ())
    pace = NominalMotion(np.array([0.0, 100.0]), np.array([0.0, 10.0]))
    path = np.array([[80.0, -6.0], [80.0, 6.0]])
    car = build_car_outline(np.array([[74.0, -3.9], [78.5, -3.9]]), 1.8)

    seen_m = compute_sight_distance_m(way, pace, 80.0, path, 2.0, [car])

    assert seen_m == pytest.approx(16.5, abs=0.51)  # 0.2 * (seen - 1.5) = 3
    assert compute_sight_distance_m(way, pace, 80.0, path[::-1], 2.0, [car]) is None


def test_a_conflict_point_lies_on_the_ego_s_way_and_inside_the_scenario(specs: dict[str, Spec]):
    for spec in specs.values():
        for conflict in spec.conflicts:
            assert conflict.station_m > 0
            assert conflict.window_s[0] > 0


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
        assert (conflict.parameters.get("occlusion_m", 0.0) > 5.0) == hides


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

    assert [spec.id for spec in specs] == [
        "ri_ped_left_turn_clear_day_dense",
        "ri_ped_left_turn_clear_day_sparse",
    ]


@pytest.mark.parametrize(
    ("road", "leader"), {"unj": "cav3", "rsnj": "cav3", "rcnj": "cav2"}.items()
)
def test_where_nobody_may_lead_the_ego_who_led_it_starts_25_to_30_m_behind(road: str, leader: str):
    library = load_library(NHTSA)
    declared = library.get_declarations(Road)[road]
    moved = with_ego_manoeuvre(declared, library.get_declarations(Conflict)["od_overtake"])
    assert moved is not None

    ego, follower, original = moved.agents["cav1"], moved.agents[leader], declared.agents[leader]
    assert isinstance(ego, Vehicle)
    assert isinstance(follower, Vehicle)
    assert isinstance(original, Vehicle)
    way = RoutePlanner(moved).build_path(follower.route)

    assert (
        24.9
        <= way.find_nearest_station(ego.spawn_m) - way.find_nearest_station(follower.spawn_m)
        <= 30.1
    )
    assert follower.destination_m == original.destination_m
    assert [name for name in moved.agents if moved.agents[name] != declared.agents[name]] == [
        leader
    ]


def test_another_conflict_leaves_the_draws_of_the_others(copied: Path):
    more = {spec.id: spec.conflicts for spec in compile_library(copied)}
    edited(
        copied,
        "suites/adver_city.yaml",
        "unj: [ped_farside_crossing, ped_nearside_crossing]",
        "unj: [ped_farside_crossing]",
    )

    fewer = {spec.id: spec.conflicts for spec in compile_library(copied)}

    assert len(more["unj_clear_day_sparse"]) == len(fewer["unj_clear_day_sparse"]) + 1 == 2
    for name, conflicts in fewer.items():
        assert more[name][: len(conflicts)] == conflicts


def test_who_crosses_next_crosses_farther_on(copied: Path):
    specs = {spec.id: spec for spec in compile_library(copied)}

    far, near = specs["unj_clear_day_sparse"].conflicts

    assert near.station_m > far.station_m + 15.0


def test_a_conflict_says_how_it_stands_to_a_road():
    library = load_library(NHTSA)
    conflicts, roads = library.get_declarations(Conflict), library.get_declarations(Road)

    drift, turn = conflicts["od_drift"], conflicts["ped_left_turn"]
    overtaking = match_conflict(conflicts["od_overtake"], roads["unj"], called_for=True)

    assert match_conflict(drift, roads["rsnj"], called_for=True).standing == "primary"
    assert match_conflict(turn, roads["ri"], called_for=False).standing == "extension"
    assert overtaking.standing == "invalid"
    assert overtaking.reason == "a median divides it"
    assert (
        match_conflict(turn, roads["unj"], called_for=True).reason
        == "it is away from junctions, not an intersection"
    )


def test_both_editions_are_whole_and_joined():
    typologies = load_library(NHTSA).get_declarations(Typology).values()
    newer = [item for typology in typologies for item in typology.crash_types]
    older = {item.id for typology in typologies for item in typology.earlier}

    assert {item.id for item in newer} == {f"nhtsa2019:{number}" for number in range(1, 37)}
    assert older == {f"nhtsa2007:{number}" for number in range(1, 38)}
    assert {name for item in newer for name in item.derived_from} == older
