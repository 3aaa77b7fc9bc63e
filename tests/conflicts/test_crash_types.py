"""Staged conflicts are what NHTSA calls them, by an independent look at their traces."""

from collections.abc import Callable
from pathlib import Path

import pytest
from advercity_dsl import Spec
from advercity_dsl.conflict import StagedConflict
from sumolib.net import Net, readNet

from advercity.compiler.crossing import compile_library
from advercity.conflicts.metrics import find_overlaps
from advercity.conflicts.report import build_table_rows, build_traffic_report
from advercity.frames import Trace
from advercity.roads.sumo_network import write_sumo_network
from advercity.traffic.simulation import simulate_in_subprocess
from tests.crash_types import measure_red_s, name_crash_type, runs_red
from tests.roads.imported_roads import AT_JUNCTION, compiled_suite

pytestmark = pytest.mark.sumo
LIBRARY = Path(__file__).parents[2] / "library" / "nhtsa"
EGO = 101


def check_crash_type(
    spec: Spec, conflict: StagedConflict, trace: Trace, net: Net | None = None
) -> None:
    actor, road = conflict.actors[0], net or spec.road

    assert name_crash_type(trace, EGO, actor.number) in conflict.stages
    assert not runs_red(trace, road, EGO)
    assert runs_red(trace, road, actor.number) == (conflict.violates == "signal")
    # Who runs a red light does the critical act.
    assert (actor.part == "subject" and conflict.ego == "other") or conflict.violates is None


@pytest.mark.parametrize(
    ("name", "crash_types"),
    [
        ("ui_clear_day_dense", (30, 10, 12)),
        # The other traces; weathers share them, so that these ten are those of all 110.
        pytest.param("unj_clear_day_dense", (10,), marks=pytest.mark.slow),
        pytest.param("ri_clear_day_dense", (30, 12), marks=pytest.mark.slow),
        pytest.param("rsnj_clear_day_dense", (19,), marks=pytest.mark.slow),
        pytest.param("rcnj_clear_day_dense", (19,), marks=pytest.mark.slow),
        ("ui_clear_day_sparse", (30, 10, 12)),
        ("unj_clear_day_sparse", (10,)),
        ("ri_clear_day_sparse", (30, 12)),
        ("rsnj_clear_day_sparse", (19,)),
        ("rcnj_clear_day_sparse", (19,)),
    ],
)
def test_the_scenarios_stage_what_they_say(
    name: str,
    crash_types: tuple[int, ...],
    specs: dict[str, Spec],
    simulate: Callable[[Spec], Trace],
):
    spec = specs[name]
    trace = simulate(spec)

    report = build_traffic_report(spec, trace, "")
    rows = build_table_rows([report])
    assert report.problems == ()
    for number, conflict, row in zip(crash_types, spec.conflicts, rows, strict=True):
        crash_type = f"nhtsa2019:{number}"
        assert name_crash_type(trace, EGO, conflict.actors[0].number) == crash_type
        assert row["NHTSA type"] == crash_type
        check_crash_type(spec, conflict, trace)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("suite", "name"),
    [
        ("conflicts", "rsnj_od_overtake_clear_day_sparse"),
        ("diverse", "ui_clear_day_sparse_r2"),
        ("diverse", "unj_clear_day_sparse_r3"),
        ("diverse", "ri_clear_day_dense_r4"),
        ("diverse", "rsnj_clear_day_sparse_r5"),
        ("diverse", "rcnj_clear_day_dense_r2"),
    ],
)
def test_other_suites_stage_what_they_say(
    suite: str, name: str, library: Path, simulate: Callable[[Spec], Trace]
):
    spec = next(spec for spec in compile_library(library, suite=suite) if spec.id == name)
    trace = simulate(spec)

    (outcome,) = build_traffic_report(spec, trace, "").staged
    assert (outcome.missed, outcome.outside) == ((), ())
    check_crash_type(spec, spec.conflicts[0], trace)


@pytest.mark.parametrize(
    "conflict",
    [
        "scp_signal_violation",
        *(
            pytest.param(conflict, marks=pytest.mark.slow)
            for conflict in (
                "cyc_farside_crossing",
                "cyc_left_turn",
                "cyc_right_hook",
                "ltap_od_ego_turns",
                "ltap_od_other_turns",
                "ped_right_turn",
                "rtip",
            )
        ),
    ],
)
def test_conflicts_at_a_junction_of_a_map_are_of_their_types(
    conflict: str, library: Path, tmp_path: Path
):
    suite = {"roads": ["imported"], "cross_conflicts": [conflict]}
    (spec,) = compiled_suite(library, tmp_path, AT_JUNCTION, **suite).values()
    network = write_sumo_network(spec.road, tmp_path)

    trace = simulate_in_subprocess(spec, network)

    check_crash_type(spec, spec.conflicts[0], trace, readNet(str(network)))


def test_who_runs_a_light_arrives_moving_in_its_first_seconds_of_red(
    specs: dict[str, Spec], simulate: Callable[[Spec], Trace]
):
    spec = specs["ui_clear_day_dense"]
    trace = simulate(spec)
    actor = spec.conflicts[0].actors[0]
    _, rows = trace.get_track(actor.number)
    outcome, *_ = build_traffic_report(spec, trace, "").staged

    red_s = measure_red_s(trace, spec.road, actor.number)
    (reported,) = (item for item in outcome.parameters if item.name == "since_red_s")

    assert red_s is not None
    assert 2.0 < red_s < 6.5
    assert abs(reported.achieved - red_s) < 0.6  # its front, and here its middle
    at_line = next(i for i, row in enumerate(rows) if row["speed"] > 0.98 * actor.speed_m_s)
    assert rows["speed"][20:at_line].min() > 2.0


def test_most_egos_of_the_scenarios_have_to_evade(
    specs: dict[str, Spec], simulate: Callable[[Spec], Trace]
):
    sparse = [specs[f"{road}_clear_day_sparse"] for road in ("ui", "unj", "ri", "rsnj", "rcnj")]

    resolutions = [
        outcome.resolution
        for spec in sparse
        for outcome in build_traffic_report(spec, simulate(spec), "").staged
    ]

    evading = [
        item.ego_braking_m_s2 > 3.0 or (item.ego_aside_m or 0.0) > 0.4 for item in resolutions
    ]
    assert sum(evading) >= len(evading) / 2


def list_crashes() -> list[Spec]:
    """A scenario of every conflict, on the first road that it is crossed with."""
    crashes = {
        spec.provenance.conflict: spec
        for spec in reversed(compile_library(LIBRARY.parent, suite="crashes"))
        if spec.weather.id == "clear_day"
    }
    return list(crashes.values())


@pytest.mark.slow
def test_every_conflict_that_nobody_resolves_is_a_collision_of_its_type(tmp_path: Path):
    for spec in list_crashes():
        folder = tmp_path / spec.id
        folder.mkdir()
        trace = simulate_in_subprocess(spec, write_sumo_network(spec.road, folder))
        (outcome,) = build_traffic_report(spec, trace, "").staged

        assert outcome.missed == (), spec.id
        assert outcome.resolution.impact is not None
        assert {overlap.tick for overlap in find_overlaps(trace)} <= {len(trace) - 1}
        check_crash_type(spec, spec.conflicts[0], trace)
