"""Staged conflicts: what the library stages, and what becomes of it in SUMO."""

import random
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from advercity_dsl import Spec

from advercity.compiler.crossing import compile_library
from advercity.conflicts.clearance import Blockage
from advercity.conflicts.metrics import ActorTrack, find_overlaps
from advercity.conflicts.outcome import evaluate_outcomes
from advercity.conflicts.trajectories import compute_lateral_offsets
from advercity.errors import RunError
from advercity.frames import Trace
from advercity.roads.sumo_network import write_sumo_network
from advercity.traffic.dry_run import format_blockages, format_unmet_conflicts
from advercity.traffic.route_file import (
    CAR_FOLLOWING,
    CONNECTED_CAR_FOLLOWING,
    EMERGENCY_EXTRA_M_S2,
)
from advercity.traffic.simulation import simulate_in_subprocess
from advercity.traffic.sumo_recording import SumoRecording

pytestmark = pytest.mark.sumo
ROADS = ("ui", "unj", "ri", "rsnj", "rcnj")
Simulated = Callable[[str], Trace]
COUNTED = """
import sys
import libsumo
from advercity.traffic import sumo_worker

*files, counts = sys.argv[1:]
start = libsumo.start
libsumo.start = lambda words: start([*words, "--statistic-output", counts])
sumo_worker.main(*files)
"""
"""Traffic as ever, with SUMO's own counts of what went wrong in the last rehearsal."""


@pytest.fixture(scope="module")
def simulated(specs: dict[str, Spec], simulate: Callable[[Spec], Trace]) -> Simulated:
    """The trace of a spec."""
    return lambda name: simulate(specs[name])


@pytest.fixture(scope="module")
def crossed(library: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Spec]:
    """Every conflict on every road that calls for it, on a clear day."""
    folder = tmp_path_factory.mktemp("crossed") / "nhtsa"
    others = shutil.ignore_patterns("*_night.yaml", "fog*", "soft*", "heavy*", "glare*")
    shutil.copytree(library / "nhtsa", folder, ignore=others)
    return {spec.id: spec for spec in compile_library(folder, suite="conflicts")}


@pytest.fixture(scope="module")
def overtaking(crossed: dict[str, Spec], tmp_path_factory: pytest.TempPathFactory) -> Trace:
    """An actor that overtakes a cyclist while the ego comes towards it."""
    spec = crossed["rsnj_od_overtake_clear_day_sparse"]
    return simulate_in_subprocess(
        spec, write_sumo_network(spec.road, tmp_path_factory.mktemp("overtaking"))
    )


@pytest.mark.parametrize("road", ROADS)
def test_the_conflicts_of_a_road_happen_without_any_overlap(
    road: str, specs: dict[str, Spec], simulated: Simulated
):
    spec = specs[f"{road}_clear_day_sparse"]

    trace = simulated(spec.id)

    assert [(item.conflict, item.missed) for item in evaluate_outcomes(spec, trace)] == [
        (conflict.conflict, ()) for conflict in spec.conflicts
    ]
    assert list(find_overlaps(trace)) == []


def test_traffic_without_conflicts_has_no_overlaps_either(specs: dict[str, Spec], tmp_path: Path):
    """As drawn first, two of these pedestrians walk through each other."""
    spec = specs["ri_clear_day_dense"].model_copy(update={"conflicts": ()})

    trace = simulate_in_subprocess(spec, write_sumo_network(spec.road, tmp_path))

    assert list(find_overlaps(trace)) == []


@pytest.mark.parametrize("drawn", range(3))
def test_conflicts_drawn_from_the_second_suite_happen_without_any_overlap(
    drawn: int, crossed: dict[str, Spec], simulate: Callable[[Spec], Trace]
):
    sparse = sorted(name for name in crossed if name.endswith("sparse"))
    spec = crossed[random.Random(1).sample(sparse, 3)[drawn]]

    trace = simulate(spec)

    assert [item.missed for item in evaluate_outcomes(spec, trace)] == [()]
    assert list(find_overlaps(trace)) == []


@pytest.mark.slow
def test_dry_runs_that_alternate_settle_once_blocking_actors_start_elsewhere(
    crossed: dict[str, Spec], tmp_path: Path
):
    spec = crossed["ui_rtip_clear_day_dense"]

    trace = simulate_in_subprocess(spec, write_sumo_network(spec.road, tmp_path))

    assert [item.missed for item in evaluate_outcomes(spec, trace)] == [()]
    assert list(find_overlaps(trace)) == []


@pytest.mark.parametrize(
    ("road", "repeats"),
    [
        # The actor stood in a queue, far from where it was to meet the ego.
        ("rsnj", 3),
        # It drove behind a slower vehicle and was a third of a second late.
        pytest.param("rcnj", 2, marks=pytest.mark.slow),
    ],
)
def test_who_holds_a_staged_actor_up_starts_elsewhere(
    road: str, repeats: int, library: Path, tmp_path: Path
):
    suite = (
        f"kind: suite\nid: queue\nextends: diverse\nroads: [{road}]\ndensities: [dense]\n"
        f"repeats: {repeats}\n"
    )
    (tmp_path / "queue.yaml").write_text(suite + "weathers: [clear_day]\n")
    *_, spec = compile_library(library, tmp_path, suite="queue")

    trace = simulate_in_subprocess(spec, write_sumo_network(spec.road, tmp_path))

    assert [(item.missed, item.outside) for item in evaluate_outcomes(spec, trace)] == [((), ())]
    assert list(find_overlaps(trace)) == []


def test_an_overtaking_vehicle_passes_the_cyclist_and_is_back_before_the_ego_comes(
    crossed: dict[str, Spec], overtaking: Trace
):
    spec = crossed["rsnj_od_overtake_clear_day_sparse"]
    ego, actor, cyclist = (
        ActorTrack.from_trace(overtaking, number) for number in (101, 4001, 4002)
    )
    ticks = np.intersect1d(actor.rows["tick"], cyclist.rows["tick"])
    here, there = actor.at_ticks(ticks), cyclist.at_ticks(ticks)

    from_cyclist = np.einsum("nad,nd->na", there.axes, here.centres - there.centres)
    beside = np.abs(from_cyclist[:, 0]) < (here.size[0] + there.size[0]) / 2
    free = from_cyclist[beside, 1] - (here.size[1] + there.size[1]) / 2

    assert from_cyclist[0, 0] < -10
    assert from_cyclist[-1, 0] > 10
    assert beside.sum() > 5
    assert free.min() > 1.5
    assert _least_distance_m(ego, actor) > spec.road.sections["country_road"].left[0].width_m - 0.2


def _least_distance_m(ego: ActorTrack, actor: ActorTrack) -> float:
    """Between the middles of two tracks."""
    ticks = np.intersect1d(ego.rows["tick"], actor.rows["tick"])
    return float(
        np.linalg.norm(ego.at_ticks(ticks).centres - actor.at_ticks(ticks).centres, axis=1).min()
    )


def test_an_excursion_goes_out_stays_for_as_long_as_declared_and_comes_back():
    times_s = np.arange(0, 10.01, 0.1)

    offsets = compute_lateral_offsets(
        times_s, shift_m=2.0, out_s=3.0, hold_s=1.5, return_s=2.0, end_s=9.0
    )

    assert offsets[times_s <= 2.5].max() < 1e-9
    assert offsets[np.isclose(times_s, 4.0)][0] == pytest.approx(1.0)
    np.testing.assert_allclose(offsets[(times_s > 5.49) & (times_s < 7.01)], 2.0)
    assert offsets[np.isclose(times_s, 8.0)][0] == pytest.approx(1.0)
    np.testing.assert_allclose(offsets[times_s >= 8.99], 0.0, atol=1e-9)


def test_staging_leaves_as_many_people_and_vehicles_as_were_asked_for(
    specs: dict[str, Spec], simulated: Simulated
):
    spec = specs["unj_clear_day_sparse"]

    classes = [actor.actor_class for actor in simulated(spec.id).actors]

    assert classes.count("pedestrian") == spec.demand.walkers
    assert len(classes) - classes.count("pedestrian") <= spec.demand.vehicles + 3


def test_staging_is_the_same_on_every_run(specs: dict[str, Spec], tmp_path: Path):
    spec = specs["ri_clear_day_sparse"]
    network = write_sumo_network(spec.road, tmp_path)

    first, second = simulate_in_subprocess(spec, network), simulate_in_subprocess(spec, network)

    np.testing.assert_array_equal(first.states, second.states)
    assert first.actors == second.actors


def test_every_weather_of_a_road_and_density_stages_the_same(specs: dict[str, Spec]):
    for road in ROADS:
        for density in ("sparse", "dense"):
            first, *others = (
                spec.conflicts
                for spec in specs.values()
                if spec.road.id == road and spec.density.id == density
            )
            assert len(first) >= 1
            assert others == [first] * 10


def test_every_spec_stages_each_group_that_its_road_is_there_for(specs: dict[str, Spec]):
    for spec in specs.values():
        staged = {conflict.typology for conflict in spec.conflicts}
        assert staged == {group.typology for group in spec.groups}


def test_an_actor_that_stops_short_lets_the_ego_go_first(
    specs: dict[str, Spec], simulated: Simulated
):
    spec = specs["ri_clear_day_sparse"]
    trace = simulated(spec.id)
    numbers = np.array([actor.id for actor in trace.actors])[trace.states["actor"]]

    # An actor for which the ego brakes goes first.
    yielding = [conflict for conflict in spec.conflicts if conflict.resolved_by != "ego"]
    assert yielding
    for conflict in yielding:
        passes = [
            np.argmin(np.hypot(*(_middles(trace, numbers, number) - conflict.point_m).T))
            for number in (101, conflict.actors[0].number)
        ]
        assert passes[0] < passes[1]


def test_a_scenario_that_ends_before_its_conflict_says_what_to_change(
    specs: dict[str, Spec], tmp_path: Path
):
    spec = specs["unj_clear_day_sparse"]
    timing = spec.timing.model_copy(update={"max_ticks": 65})

    with pytest.raises(RunError) as caught:
        simulate_in_subprocess(
            spec.model_copy(update={"timing": timing}), write_sumo_network(spec.road, tmp_path)
        )

    assert (
        "the ego does not cross the path of conflict_1 (ped_farside_crossing) before it arrives or"
        " the scenario ends, 6.5 s after the start (max_ticks 65); raise timing.max_ticks or lower"
        " the density"
    ) in str(caught.value)


def test_a_vehicle_that_ends_a_scenario_before_its_conflict_is_named(specs: dict[str, Spec]):
    spec = specs["unj_clear_day_sparse"]
    schedules: Any = {
        actor.number: SimpleNamespace(is_untriggered=True) for actor in spec.conflicts[0].actors
    }
    ended = SumoRecording({}, (), np.zeros((233, 0), np.uint8), arrived=frozenset({102}))

    message = format_unmet_conflicts(spec, schedules, ended)

    assert message.startswith(
        "the ego does not cross the path of conflict_1 (ped_farside_crossing) before cav2 leaves"
        " the site 23.3 s after the start, which ends the scenario; let cav2 wait (waits_s)"
    )


def test_the_message_names_blocking_and_blocked_actors(specs: dict[str, Spec]):
    spec = specs["ri_clear_day_sparse"]
    cyclist = spec.conflicts[1].actors[0].number

    message = format_blockages(
        spec, {Blockage(1007, cyclist), Blockage(cyclist, 1008), Blockage(102, cyclist)}
    )

    assert message.startswith(
        f"cav2 (102) blocks bicycle {cyclist} of conflict_2 (cyc_nearside_obstructed),"
        f" 1007 blocks bicycle {cyclist} of conflict_2 (cyc_nearside_obstructed),"
        f" bicycle {cyclist} of conflict_2 (cyc_nearside_obstructed) blocks 1008; lower the"
    )


@pytest.mark.parametrize("road", ["ui", "ri", "rcnj"])
def test_sumo_counts_no_teleports_collisions_or_emergencies(
    road: str, specs: dict[str, Spec], tmp_path: Path
):
    spec = specs[f"{road}_clear_day_sparse"]
    (tmp_path / "spec.json").write_text(spec.model_dump_json())
    files = [
        tmp_path / "spec.json",
        write_sumo_network(spec.road, tmp_path),
        tmp_path / "trace.npz",
    ]

    words = [sys.executable, "-c", COUNTED, *map(str, files), str(tmp_path / "counts.xml")]
    subprocess.run(words, check=True, capture_output=True)

    counts = ElementTree.parse(tmp_path / "counts.xml")
    driven, teleports, safety = map(counts.find, ("vehicles", "teleports", "safety"))
    assert driven is not None and int(driven.attrib["inserted"]) > 10
    assert teleports is not None and set(teleports.attrib.values()) == {"0"}
    assert safety is not None
    assert (safety.attrib["collisions"], safety.attrib["emergencyStops"]) == ("0", "0")
    # SUMO counts an ego that brakes for an actor as hard as its conflict declares, and a driver who
    # brakes late: it counts what SUMO asks of a driver for a step, not the braking of the body.
    braking = [item for item in spec.conflicts if item.resolved_by in ("ego", "both")]
    assert int(safety.attrib["emergencyBraking"]) <= len(braking)


CURVE_M_S2 = 0.5
"""SUMO limits speeds along the middle of lanes; where bends end, bodies on their inside gain more:
trucks up to 0.27, long cars 0.46, in dense traffic bicycles at the edge of tight turns 0.89."""


@pytest.mark.parametrize("road", ROADS)
def test_no_actor_accelerates_or_brakes_harder_than_it_can(
    road: str, specs: dict[str, Spec], simulated: Simulated
):
    spec = specs[f"{road}_clear_day_sparse"]
    trace = simulated(spec.id)
    staged = {one.number: one for conflict in spec.conflicts for one in conflict.actors}
    braking = max(item.parameters.get("ego_braking_m_s2", 0.0) for item in spec.conflicts)

    for actor in trace.actors:
        rows = ActorTrack.from_trace(trace, actor.id).rows
        # A semi-trailer gains and loses speed as its angle to the tractor unit changes, too.
        if actor.actor_class != "pedestrian" and not actor.towed_by:
            usual = CONNECTED_CAR_FOLLOWING if actor.id < 1000 else CAR_FOLLOWING[actor.actor_class]
            part = staged.get(actor.id)
            gains = part.acceleration_m_s2 if part else usual.acceleration_m_s2
            loses = part.braking_m_s2 if part else usual.deceleration_m_s2
            assert rows["acceleration"].max() <= gains + CURVE_M_S2, actor
            hardest = max(loses + EMERGENCY_EXTRA_M_S2, braking if actor.id == 101 else 0.0)
            assert rows["acceleration"].min() >= -hardest - 0.01, actor


def _middles(trace: Trace, numbers: np.ndarray, number: int) -> np.ndarray:
    rows = trace.states[numbers == number]
    return np.column_stack([rows["x"], rows["y"]])
