"""Who resolves a staged conflict: the actor, the ego, both or nobody."""

import shutil
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from advercity_dsl import ActorClass, Spec
from advercity_dsl.conflict import Resolver
from advercity_dsl.traffic import ReactionConditions

from advercity.compiler import DiagnosticsError
from advercity.compiler.crossing import compile_library
from advercity.conflicts.metrics import ActorTrack, find_overlaps
from advercity.conflicts.reaction import compute_braking_speeds, find_perception, plan_reaction
from advercity.conflicts.report import build_table_rows, build_traffic_report
from advercity.conflicts.trajectories import PathCrossing
from advercity.frames import STATE_DTYPE, Actor, Trace
from advercity.pipeline.cache import compute_traffic_key
from advercity.roads.sumo_network import write_sumo_network
from advercity.traffic.simulation import simulate_in_subprocess

TICK_S = 0.1
LIBRARY = Path(__file__).parents[2] / "library" / "nhtsa"


def driving(speed_m_s: float, ticks: int = 100) -> ActorTrack:
    """A car that goes east from the origin."""
    rows = np.zeros(ticks, STATE_DTYPE)
    rows["tick"], rows["speed"] = np.arange(ticks), speed_m_s
    rows["x"] = speed_m_s * TICK_S * np.arange(ticks)
    return ActorTrack(101, np.array([4.0, 2.0]), rows)


def brake(**changes: float) -> np.ndarray:
    options = {"stop_m": 50.0, "braking_m_s2": 5.0, "hardest_m_s2": 8.0, "earliest_s": 0.0}
    return compute_braking_speeds(driving(10.0), **{**options, **changes}, tick_s=TICK_S)


def stop_at_m(speeds: np.ndarray) -> float:
    """Where a car stops that drives at 10 m/s until it is commanded."""
    return float(np.nansum(np.where(np.isnan(speeds[:-1]), 10.0, speeds[:-1])) * TICK_S)


def test_an_ego_brakes_as_late_as_it_can_and_stops_at_the_station():
    """From 10 m/s, 5 m/s² take 10 m: it drives 40 m first, for 4 s."""
    speeds = brake()

    assert np.flatnonzero(~np.isnan(speeds))[0] == pytest.approx(40, abs=1)
    assert np.diff(speeds[42:55]) == pytest.approx(-0.5)
    assert stop_at_m(speeds) == pytest.approx(50, abs=1.0)


def test_an_ego_that_sees_the_actor_late_brakes_harder():
    """44 m after 4.4 s leave 6 m: 10² / (2 * 6) = 8.3 m/s², of which tyres hold 8."""
    speeds = brake(earliest_s=4.4)

    assert np.isnan(speeds[:44]).all()
    assert -np.diff(speeds[44:50]) / TICK_S == pytest.approx(8.0)


def test_an_ego_on_a_slippery_road_brakes_when_it_would_on_a_dry_one_and_comes_too_far():
    """10² / (2 * 2) = 25 m instead of 10 m."""
    speeds = brake(hardest_m_s2=2.0)

    assert np.flatnonzero(~np.isnan(speeds))[0] == pytest.approx(40, abs=1)
    assert stop_at_m(speeds) == pytest.approx(65, abs=1.5)


def build_scene(*others: tuple[ActorClass, float, float]) -> Trace:
    """The ego goes east at 10 m/s; the others stand: class and place."""
    ticks = 60
    rows = np.zeros((ticks, 1 + len(others)), STATE_DTYPE)
    rows["tick"] = np.arange(ticks)[:, None]
    rows["actor"] = np.arange(1 + len(others))
    rows["x"][:, 0] = 10 * TICK_S * np.arange(ticks)
    for index, (_, x, y) in enumerate(others, start=1):
        rows["x"][:, index], rows["y"][:, index] = x, y
    classes: tuple[ActorClass, ...] = ("car", *(name for name, _, _ in others))
    actors = tuple(
        Actor(101 + index, name, "any", "car_paint_blue", (4.0, 2.0, 1.5))
        for index, name in enumerate(classes)
    )
    return Trace(TICK_S, 0, actors, rows.ravel(), (), np.zeros((ticks, 0), np.uint8))


@pytest.mark.parametrize(
    ("others", "visibility_m", "perceived_s"),
    [
        # The line from (10 t, 0) to (60, 10) passes the car's corner (42, 6) until
        # 10 t = 42 - 6 * 18 / 4 = 15; a bicycle hides nobody.
        ((("car", 40.0, 7.0),), None, 1.5),
        ((("bicycle", 40.0, 7.0),), None, 0.0),
        # (60 - 10 t)² + 10² is 30² at 10 t = 31.7.
        ((), 30.0, 3.2),
    ],
)
def test_the_ego_perceives_whom_it_sees(
    others: tuple[tuple[ActorClass, float, float], ...],
    visibility_m: float | None,
    perceived_s: float,
):
    trace = build_scene(("pedestrian", 60.0, 10.0), *others)
    ego, actor = (ActorTrack.from_trace(trace, number) for number in (101, 102))
    conditions = ReactionConditions(friction=0.8, visibility_m=visibility_m)

    found_s, hidden_by = find_perception(trace, ego, actor, conditions, until_s=5.0)

    assert found_s == pytest.approx(perceived_s, abs=0.11)
    assert hidden_by == ({103} if perceived_s == 1.5 else set())


@pytest.mark.parametrize("seed", range(8))
def test_the_ego_perceives_at_the_first_tick_from_which_the_actor_is_near_enough(seed: int):
    random = np.random.default_rng(seed)
    x, y, visibility_m = random.uniform(40, 70), random.uniform(2, 9), random.uniform(12, 35)
    trace = build_scene(("pedestrian", x, y))
    ego, actor = (ActorTrack.from_trace(trace, number) for number in (101, 102))
    conditions = ReactionConditions(friction=0.8, visibility_m=visibility_m)

    found_s, _ = find_perception(trace, ego, actor, conditions, until_s=(x - 2) / 10)

    first = next(t for t in range(60) if np.hypot(x - 10 * TICK_S * t, y) <= visibility_m)
    assert found_s == pytest.approx(first * TICK_S)


def resolve(spec: Spec, resolver: Resolver, friction: float = 0.8) -> Spec:
    """The first conflict alone, resolved by others than declared."""
    first = spec.conflicts[0]
    parameters = {**first.parameters, "ego_braking_m_s2": 5.0}
    changed = first.model_copy(update={"resolved_by": resolver, "parameters": parameters})
    reaction = ReactionConditions(friction=friction, is_paired=True)
    return spec.model_copy(update={"conflicts": (changed,), "reaction": reaction})


def test_an_ego_brakes_for_a_second_though_the_actor_stops_sooner(specs: dict[str, Spec]):
    """From 10 m/s it brakes 3 s after the start; the other, who goes on at 5 s, stops then."""
    trace = build_scene(("pedestrian", 40.0, 0.0))
    walker = trace.states["actor"] == 1
    time_s = TICK_S * np.arange(60)
    walked_m = 1.5 * np.minimum(time_s, 3.1) + 8.0 * np.maximum(time_s - 5.0, 0.0)
    trace.states["y"][walker], trace.states["yaw"][walker] = walked_m - 7.0, np.pi / 2
    trace.states["speed"][walker] = np.gradient(walked_m, TICK_S)
    trace.states["speed"][~walker] = 10.0
    spec = resolve(specs["unj_clear_day_sparse"], "both")
    (conflict,) = spec.conflicts
    other = conflict.actors[0].model_copy(update={"number": 102})
    conflict = conflict.model_copy(update={"actors": (other,), "point_m": (40.0, 0.0)})
    meeting = PathCrossing(distance_m=7.0, ego_s=4.0, stop_m=4.5, enter_m=5.5, clear_s=4.4)

    commands = plan_reaction(spec, conflict, trace, meeting).speed_commands_m_s

    assert np.count_nonzero(~np.isnan(commands)) == pytest.approx(10, abs=1)


@pytest.mark.parametrize("friction", [0.25, 0.5, 0.8])
def test_an_ego_that_swerves_at_the_last_moment_uses_the_grip_that_braking_leaves(
    friction: float, specs: dict[str, Spec]
):
    trace = build_scene(("car", 60.0, 0.0))
    coming = trace.states["actor"] == 1
    trace.states["x"][coming] -= 10.0 * TICK_S * np.arange(60)
    trace.states["yaw"][coming] = np.pi
    trace.states["speed"] = 10.0
    spec = resolve(specs["rsnj_clear_day_sparse"], "ego", friction)
    # It sees the other from 20 m, a second before they meet.
    late = ReactionConditions(friction=friction, visibility_m=20.0)
    spec = spec.model_copy(update={"reaction": late})
    (conflict,) = spec.conflicts
    other = conflict.actors[0].model_copy(update={"number": 102})

    found = plan_reaction(spec, conflict.model_copy(update={"actors": (other,)}), trace, None)

    assert found.offsets_m is not None
    assert found.offsets_m.min() == pytest.approx(-2.4, abs=0.01)
    aside = found.offsets_m[: int(found.offsets_m.argmin()) + 1]
    lateral_m_s2 = np.abs(np.diff(aside, n=2)).max() / TICK_S**2
    # Its braking takes 70 % of the grip at most.
    grip_m_s2 = friction * 9.81
    braking_m_s2 = min(5.0, 0.7 * grip_m_s2)
    assert np.hypot(lateral_m_s2, braking_m_s2) == pytest.approx(grip_m_s2, rel=0.03)
    assert np.abs(np.diff(found.offsets_m, n=2)).max() / TICK_S**2 < grip_m_s2


@pytest.mark.sumo
@pytest.mark.parametrize("resolver", ["actor", "ego", "both"])
def test_who_resolves_a_conflict_brakes_and_nobody_else_does(
    resolver: Resolver, specs: dict[str, Spec], simulate: Callable[[Spec], Trace]
):
    spec = resolve(specs["ri_clear_day_dense"], resolver)
    trace = simulate(spec)
    (outcome,) = build_traffic_report(spec, trace, "").staged
    found = outcome.resolution

    assert outcome.missed == ()
    assert list(find_overlaps(trace)) == []
    assert found.impact is None
    assert (found.ego_braking_m_s2 > 3.0) == (resolver in ("ego", "both"))
    assert (found.actor_braking_m_s2 > 3.0) == (resolver in ("actor", "both"))
    ego, actor = (ActorTrack.from_trace(trace, number).rows for number in (101, outcome.actor))
    point = spec.conflicts[0].point_m
    passes = [
        np.argmin(np.hypot(rows["x"] - point[0], rows["y"] - point[1])) for rows in (ego, actor)
    ]
    assert (ego["tick"][passes[0]] > actor["tick"][passes[1]]) == (resolver == "ego")


@pytest.mark.sumo
@pytest.mark.parametrize("name", ["rsnj_clear_day_sparse", "rcnj_clear_day_sparse"])
def test_an_ego_that_is_met_head_on_brakes_as_well_as_steers(
    name: str, specs: dict[str, Spec], simulate: Callable[[Spec], Trace]
):
    spec = specs[name]
    (outcome,) = build_traffic_report(spec, simulate(spec), "").staged

    declared = spec.conflicts[0].parameters["ego_braking_m_s2"]
    assert outcome.resolution.ego_braking_m_s2 == pytest.approx(declared, rel=0.15)
    assert outcome.resolution.ego_aside_m is not None
    assert outcome.resolution.ego_aside_m > 0.3
    # It would have been on time, had it driven on.
    assert (outcome.missed, outcome.outside) == ((), ())


@pytest.mark.sumo
def test_a_conflict_that_nobody_resolves_ends_in_a_collision(
    specs: dict[str, Spec], simulate: Callable[[Spec], Trace]
):
    spec = resolve(specs["ri_clear_day_dense"], "nobody")
    trace = simulate(spec)
    report = build_traffic_report(spec, trace, "")
    (outcome,) = report.staged
    impact = outcome.resolution.impact

    assert report.problems == ()
    assert {(item.first, item.second, item.tick) for item in find_overlaps(trace)} <= {
        (101, outcome.actor, len(trace) - 1)
    }
    assert impact is not None
    assert impact.tick == len(trace) - 1
    ego, actor = (ActorTrack.from_trace(trace, number).rows[-1] for number in (101, outcome.actor))
    assert impact.ego_speed_m_s == pytest.approx(ego["speed"], abs=0.001)
    assert 25 < 3.6 * impact.actor_speed_m_s == pytest.approx(3.6 * actor["speed"], abs=0.01)
    relative = np.hypot(ego["vx"] - actor["vx"], ego["vy"] - actor["vy"])
    assert impact.relative_speed_m_s == pytest.approx(relative, abs=0.001)
    (row,) = build_table_rows([report])
    assert row["resolved by"] == "nobody"
    assert str(row["impact km/h"]).startswith("ego ")
    soon = (replace(outcome, ego_at_s=3.0), replace(outcome, id="conflict_2", ego_at_s=6.5))
    assert [text.partition(") comes ")[2] for text in replace(report, staged=soon).problems] == [
        "3.0 s after the recording begins",
        "3.5 s after conflict_1",
    ]


@pytest.mark.sumo
@pytest.mark.slow
def test_an_ego_that_would_stop_on_a_dry_road_does_not_on_snow(
    specs: dict[str, Spec], tmp_path: Path
):
    spec = resolve(specs["unj_clear_day_sparse"], "ego", friction=0.15)

    trace = simulate_in_subprocess(spec, write_sumo_network(spec.road, tmp_path))

    (outcome,) = build_traffic_report(spec, trace, "").staged
    assert outcome.missed[0] == "they touch"
    assert outcome.resolution.impact is not None


@pytest.fixture
def copied(tmp_path: Path) -> Path:
    """A copy of the library with two weathers, whose suites compile sooner."""
    kept = ("clear_day.yaml", "heavy_rain_day.yaml")
    weathers = [path.name for path in (LIBRARY / "weather").iterdir() if path.name not in kept]
    return shutil.copytree(LIBRARY, tmp_path / "nhtsa", ignore=shutil.ignore_patterns(*weathers))


def write_suite(library: Path, *lines: str) -> None:
    text = ["kind: suite", "id: few", "roads: [ri]", "densities: [sparse]", *lines]
    text += ["cross_conflicts: [cyc_left_turn]", "rig: adver_city", "catalogue: adver_city"]
    (library / "suites" / "few.yaml").write_text("\n".join(text))


def test_the_ego_reacts_as_in_one_weather_or_in_each_as_the_suite_declares(copied: Path):
    """Dry asphalt holds 0.8, soaked 0.5 (`DEFAULT_GRIP`)."""
    write_suite(copied, "resolved_by: {ego: 1}", "reaction_weather: clear_day")
    paired = compile_library(copied, suite="few")
    write_suite(copied, "resolved_by: {ego: 1}", "pairing: none")
    single = compile_library(copied, suite="few")

    assert [spec.reaction and spec.reaction.friction for spec in paired] == [0.8, 0.8]
    assert len({compute_traffic_key(spec) for spec in paired}) == 1
    dry, wet = (spec.reaction for spec in single)
    assert dry is not None
    assert wet is not None
    assert (dry.friction, wet.friction) == (0.8, pytest.approx(0.5, abs=0.05))
    assert len({compute_traffic_key(spec) for spec in single}) == 2


def test_who_resolves_a_conflict_is_drawn_by_its_fractions(copied: Path):
    write_suite(
        copied, "resolved_by: {ego: 0.5, nobody: 0.5}", "repeats: 16", "weathers: [clear_day]"
    )

    counts = Counter(spec.conflicts[0].resolved_by for spec in compile_library(copied, suite="few"))

    assert counts.total() == 16
    assert set(counts) == {"ego", "nobody"}
    assert 3 <= counts["ego"] <= 13


REFUSED = {
    "fractions": ("{ego: 0.5, both: 0.4}", "the fractions add up to 0.9; they must add up to 1"),
    "braking": ("{ego: 1}", "ego_braking_m_s2 is missing: the ego brakes where it takes part"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_resolution_that_cannot_be_is_refused(case: str, copied: Path):
    fractions, message = REFUSED[case]
    write_suite(copied, f"resolved_by: {fractions}")
    conflict = copied / "conflicts" / "cyc_left_turn.yaml"
    lines = conflict.read_text().splitlines()
    conflict.write_text("\n".join(line for line in lines if "ego_braking" not in line))

    with pytest.raises(DiagnosticsError) as caught:
        compile_library(copied, suite="few")

    assert message in str(caught.value)


def test_an_actor_that_runs_a_light_is_the_subject(copied: Path):
    conflict = copied / "conflicts" / "cyc_left_turn.yaml"
    conflict.write_text(conflict.read_text().replace("part: other", "part: subject"))

    with pytest.raises(DiagnosticsError) as caught:
        compile_library(copied, suite="adver_city")

    assert "the critical action is the actor's, which runs the light" in str(caught.value)
