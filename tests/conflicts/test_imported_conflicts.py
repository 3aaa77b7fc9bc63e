"""Conflicts on imported roads, with agents placed by the arms of a junction."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from advercity_dsl import MapNetwork, RoadsideUnit, Spec, Vehicle

from advercity.conflicts.outcome import evaluate_outcomes
from advercity.errors import InputError
from advercity.roads.imported_streets import read_imported_streets
from advercity.roads.sumo_network import write_sumo_network
from advercity.traffic.simulation import simulate_in_subprocess
from tests.roads.imported_roads import AT_JUNCTION, compiled_suite

AT_J1: dict[str, Any] = {
    **AT_JUNCTION,
    "at_junction": {**AT_JUNCTION["at_junction"], "junction": "j1"},
}


@pytest.fixture(scope="module")
def staged(library: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Spec]:
    """Every conflict of the library at the signalised crossroads."""
    return compiled_suite(
        library,
        tmp_path_factory.mktemp("staged"),
        AT_JUNCTION,
        roads=["imported"],
        cross_conflicts="all",
        standings=["primary", "extension"],
    )


@pytest.fixture(scope="module")
def left_turns(
    library: Path, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, dict[str, Spec]]:
    """Left turns across traffic, by who resolves them; their draws are else the same."""

    def compile_turns(resolver: str) -> dict[str, Spec]:
        folder = tmp_path_factory.mktemp(resolver)
        turn = {"cross_conflicts": ["ltap_od_ego_turns"], "resolved_by": {resolver: 1}}
        return compiled_suite(library, folder, AT_J1, repeats=3, **turn)

    return {resolver: compile_turns(resolver) for resolver in ("actor", "ego")}


def get_ego_speed_km_h(spec: Spec) -> float:
    (conflict,) = spec.conflicts
    return conflict.parameters["ego_speed_km_h"]


def find_conflicts(specs: dict[str, Spec]) -> set[str]:
    return {name.removeprefix("imported_j1_").removesuffix("_clear_day_sparse") for name in specs}


def test_agents_are_where_their_arms_are(staged: dict[str, Spec]):
    """Streets are 6.4 m wide, lanes 3.2 m, and meet at the origin; traffic drives on the right."""
    spec = staged["imported_j1_scp_signal_violation_clear_day_sparse"]
    ego, other, unit = (agent.place for agent in spec.agents)
    assert isinstance(ego, Vehicle)
    assert isinstance(other, Vehicle)
    assert isinstance(unit, RoadsideUnit)

    assert ego.spawn_m[0] == pytest.approx(1.6, abs=0.05)
    assert ego.heading_deg == pytest.approx(90, abs=0.5)
    assert ego.spawn_m[1] == pytest.approx(-80 - 7.2, abs=0.1)
    assert ego.destination_m == pytest.approx((1.6, 60 + 7.2), abs=0.1)
    # From the ego's left is from the west, and right of that is south.
    assert other.spawn_m[1] == pytest.approx(-1.6, abs=0.05)
    assert other.heading_deg == pytest.approx(0, abs=0.5)
    assert other.destination_m[0] == pytest.approx(-1.6, abs=0.05)
    assert other.destination_m[1] < -50
    assert (ego.waits_s, other.waits_s) == (0, 3)
    # Right of the northern arm seen towards the junction, off the paving, looking at its centre.
    assert -12 < unit.position_m[0] < -3.2
    assert unit.position_m[1] > 3.2
    to_centre = np.degrees(np.arctan2(-unit.position_m[1], -unit.position_m[0]))
    assert unit.yaw_deg == pytest.approx(to_centre, abs=3)


def test_conflicts_of_an_intersection_can_be_staged_at_a_junction_of_a_map(
    staged: dict[str, Spec],
):
    found = find_conflicts(staged)

    assert {"ltap_od_ego_turns", "scp_signal_violation", "ped_right_turn"} <= found
    # A junction with lights is no place for these, nor is it away from junctions.
    assert not {"scp_unsignalised", "od_overtake", "od_drift"} & found


def test_the_paths_of_a_left_turn_across_traffic_meet_inside_the_junction(
    staged: dict[str, Spec],
):
    spec = staged["imported_j1_ltap_od_ego_turns_clear_day_sparse"]
    (conflict,) = spec.conflicts
    ego = spec.ego.place
    assert isinstance(ego, Vehicle)

    # The ego turns from the south to the west; the other comes from the north in the lane at -1.6.
    assert ego.destination_m[0] < -50
    assert conflict.point_m[0] == pytest.approx(-1.6, abs=0.6)
    assert -2 < conflict.point_m[1] < 4
    assert conflict.actors[0].route == ("grosse_strasse_1", "grosse_strasse_2")


def test_a_spec_claims_only_the_crash_groups_that_it_stages(staged: dict[str, Spec]):
    for spec in staged.values():
        typologies = {conflict.typology for conflict in spec.conflicts}
        assert {group.typology for group in spec.groups} <= typologies


@pytest.mark.sumo
def test_a_conflict_at_a_junction_of_a_map_happens(staged: dict[str, Spec], tmp_path: Path):
    spec = staged["imported_j1_ltap_od_ego_turns_clear_day_sparse"]

    trace = simulate_in_subprocess(spec, write_sumo_network(spec.road, tmp_path))

    assert [item.missed for item in evaluate_outcomes(spec, trace)] == [()]


@pytest.mark.sumo
def test_another_vehicle_that_arrives_first_drives_on_until_the_conflict_has_happened(
    library: Path, tmp_path: Path
):
    agents = {
        "cav1": {"kind": "vehicle", "role": "ego", "arm": "south", "waits_s": 2},
        "cav2": {"kind": "vehicle", "arm": "opposite", "start_m": 30, "end_m": 15},
    }
    crossed = {"cross_conflicts": ["ped_left_turn"], "resolved_by": {"actor": 1}}
    road: dict[str, object] = {**AT_JUNCTION, "at_junction": {"junction": "j1", "agents": agents}}
    (spec,) = compiled_suite(library, tmp_path, road, roads=["imported"], **crossed).values()
    other = spec.agents[1].place
    assert isinstance(other, Vehicle)

    trace = simulate_in_subprocess(spec, write_sumo_network(spec.road, tmp_path))

    assert [item.missed for item in evaluate_outcomes(spec, trace)] == [()]
    _, rows = trace.get_track(spec.agents[1].number)
    # It comes from the north, and is in every frame, as is the ego.
    assert rows["y"][-1] < other.destination_m[1] - 20
    assert len(rows) == len(trace)


TWO_LIGHTS = """<osm version="0.6">
  <node id="1" lat="48.0" lon="11.0"><tag k="highway" v="traffic_signals"/></node>
  <node id="2" lat="48.0" lon="11.0012"><tag k="highway" v="traffic_signals"/></node>
  <node id="3" lat="48.0" lon="10.998"/><node id="4" lat="48.0" lon="11.0032"/>
  <node id="5" lat="48.0014" lon="11.0"/><node id="6" lat="47.9986" lon="11.0"/>
  <node id="7" lat="48.0014" lon="11.0012"/><node id="8" lat="47.9986" lon="11.0012"/>
  <way id="11"><nd ref="3"/><nd ref="1"/><nd ref="2"/><nd ref="4"/>
    <tag k="highway" v="secondary"/><tag k="lanes" v="2"/></way>
  <way id="12"><nd ref="5"/><nd ref="1"/><nd ref="6"/>
    <tag k="highway" v="secondary"/><tag k="lanes" v="2"/></way>
  <way id="13"><nd ref="7"/><nd ref="2"/><nd ref="8"/>
    <tag k="highway" v="secondary"/><tag k="lanes" v="2"/></way>
</osm>
"""


@pytest.mark.parametrize(("arm", "junction"), [("west", "j2"), ("east", "j1")])
def test_all_lights_on_the_way_of_the_ego_to_its_junction_begin_with_green(
    library: Path, tmp_path: Path, arm: str, junction: str
):
    (tmp_path / "two_lights.osm").write_text(TWO_LIGHTS)
    agents = {"cav1": {"kind": "vehicle", "role": "ego", "arm": arm, "start_m": 150}}
    road: dict[str, object] = {
        **AT_JUNCTION,
        "imported": {"source": "osm", "file": "two_lights.osm"},
        "at_junction": {"junction": junction, "agents": agents},
    }
    (spec,) = compiled_suite(library, tmp_path, road, roads=["imported"]).values()
    ego, network = spec.ego.place, spec.road.imported
    assert isinstance(ego, Vehicle)
    assert isinstance(network, MapNetwork)

    signals = read_imported_streets(network.network).signals
    lights = [signals[pair] for pair in pairwise(ego.route) if pair in signals]
    assert [program.find_next_green_s(link, 0.0) for program, link in lights] == [0, 0]


def test_an_ego_that_brakes_is_fast_enough_to_brake_late(left_turns: dict[str, dict[str, Spec]]):
    """From where it stops it is 5 to 6 m: 1.5 s at 12 km/h, which is too long, 1.1 s at 19."""
    by_actor, by_ego = (
        map(get_ego_speed_km_h, left_turns[resolver].values()) for resolver in ("actor", "ego")
    )
    pairs = list(zip(by_actor, by_ego, strict=True))

    assert any(before < 12 < after for before, after in pairs)
    assert all(before == after for before, after in pairs if before > 19)
    assert all(before <= after for before, after in pairs)


@pytest.mark.sumo
def test_a_left_turn_whose_speed_was_drawn_again_happens(
    left_turns: dict[str, dict[str, Spec]], tmp_path: Path
):
    slow = left_turns["actor"]
    spec = left_turns["ego"][min(slow, key=lambda name: get_ego_speed_km_h(slow[name]))]
    assert get_ego_speed_km_h(spec) > min(map(get_ego_speed_km_h, slow.values()))

    trace = simulate_in_subprocess(spec, write_sumo_network(spec.road, tmp_path))
    (outcome,) = evaluate_outcomes(spec, trace)

    assert outcome.missed == ()
    assert outcome.resolution.ego_evades
    gap, wanted_s = outcome.met.post_encroachment_s, spec.conflicts[0].parameters
    assert gap is not None
    # SUMO's driver sets out some tenths of a second after it may.
    assert 0 <= gap.value - wanted_s["post_encroachment_s"] < 0.6


@pytest.mark.parametrize(
    "fractions", [{"ego": 0.5, "both": 0, "actor": 0.5}, {"ego": 1, "both": 0, "actor": 0}]
)
def test_an_ego_that_is_too_slow_everywhere_leaves_the_conflict_to_the_actor(
    library: Path, tmp_path: Path, fractions: dict[str, float]
):
    conflict = {
        "kind": "conflict",
        "id": "slow_turn",
        "extends": "ltap_od_ego_turns",
        "parameters": {"ego_speed_km_h": {"draw": {"uniform": [4, 10]}}},
        "resolved_by": fractions,
    }
    (tmp_path / "slow_turn.yaml").write_text(yaml.safe_dump(conflict))

    def compile_turns() -> dict[str, Spec]:
        crossed = ["slow_turn"]
        return compiled_suite(library, tmp_path, AT_J1, cross_conflicts=crossed, repeats=4)

    if fractions["actor"] > 0:
        assert {spec.conflicts[0].resolved_by for spec in compile_turns().values()} == {"actor"}
    else:
        with pytest.raises(InputError, match=r"10.0 km/h there, too slow .* \{actor: 1\}"):
            compile_turns()


@pytest.mark.parametrize(
    ("junction", "agent", "complaint"),
    [
        ("j1", {"kind": "vehicle", "arm": "upwards"}, "'upwards' is no arm of 'j1'; "),
        ("j1", {"kind": "vehicle", "arm": "wesst"}, r"did you mean 'west'\? Arms: .* \(south\)"),
        ("j99", {"kind": "vehicle"}, "no junction 'j99'"),
        ("stop", {"kind": "vehicle"}, "nor one of three arms .*; this road has signals"),
    ],
)
def test_an_arm_or_junction_that_is_not_there_is_reported(
    library: Path, tmp_path: Path, junction: str, agent: dict[str, str], complaint: str
):
    agents = {"cav1": {"kind": "vehicle", "role": "ego"}, "cav2": agent}
    road: dict[str, object] = {
        **AT_JUNCTION,
        "at_junction": {"junction": junction, "agents": agents},
    }

    with pytest.raises(InputError, match=complaint) as refused:
        compiled_suite(library, tmp_path, road)

    assert "road.yaml:" in str(refused.value)


def test_a_suite_whose_conflicts_fit_no_junction_says_why_and_what_fits(
    library: Path, tmp_path: Path
):
    suite = {"roads": ["imported"], "cross_conflicts": ["ltip", "od_drift"]}
    with pytest.raises(InputError) as refused:
        compiled_suite(library, tmp_path, AT_JUNCTION, **suite)

    first, second = (line for line in str(refused.value).splitlines() if "suite.yaml:" in line)
    assert "'ltip' has a place on no road of the suite: the ego's junction has traffic" in first
    assert "'od_drift' has a place on no road of the suite: it is an intersection, not" in second
    assert "these fit: cyc_farside_crossing, " in first
