"""`advercity simulate`: traffic without sensors, and what it amounts to."""

import json
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import av
import numpy as np
import pytest
import shapely
from advercity_dsl import Spec
from advercity_dsl.conflict import OutcomeCriteria, StagedActor, StagedConflict

from advercity.compiler import write_specs
from advercity.conflicts.achieved_parameters import measure_parameters
from advercity.conflicts.metrics import ActorTrack
from advercity.conflicts.outcome import ConflictOutcome, evaluate_outcomes
from advercity.errors import InputError, RunError, StagingError
from advercity.frames import STATE_DTYPE, Actor, Trace
from advercity.pipeline import RunOptions, preparation
from advercity.pipeline.preparation import TrafficResult, load_or_simulate_traffic
from advercity.pipeline.traffic_report import simulate_to_folder
from tests.command_line import Command

EGO = 101
OTHER = 9001


def shortened(spec: Spec) -> Spec:
    """Ten kept frames."""
    timing = spec.timing.model_copy(update={"max_ticks": spec.timing.warm_up_ticks + 10})
    return spec.model_copy(update={"timing": timing, "conflicts": ()})


@pytest.mark.sumo
def test_simulate_writes_the_trace_its_report_and_a_video(
    specs: dict[str, Spec], tmp_path: Path, advercity: Command
) -> None:
    spec = shortened(specs["ri_clear_day_sparse"])
    path = tmp_path / "compiled" / f"{spec.id}.json"
    write_specs([spec], tmp_path / "compiled")
    ran = advercity("simulate", path, "--output", tmp_path / "out")
    assert ran.code == 0
    folder = tmp_path / "out" / spec.id
    assert sorted(one.name for one in folder.iterdir()) == ["plan.mp4", "report.json", "trace.npz"]
    told = json.loads((folder / "report.json").read_text())
    trace = Trace.load(folder / "trace.npz")
    assert told["frames"] == len(trace) == 10
    assert told["actors"]["pedestrian"] == spec.demand.walkers
    assert told["overlaps"] == []
    assert told["stopping"]["distance_m"] == 16.92  # 30 km/h: 12.5 m to react, 4.42 m to brake
    with av.open(str(folder / "plan.mp4")) as film:
        pictures = [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]
    assert len(pictures) == 10
    assert np.ptp(pictures[0].astype(int), axis=(0, 1)).min() > 100
    assert str(len(trace)) in ran.out


@pytest.mark.sumo
def test_a_video_that_comes_while_the_traffic_is_simulated_stays(
    specs: dict[str, Spec], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    spec = shortened(specs["ri_clear_day_sparse"])
    video = tmp_path / spec.id / "plan.mp4"

    def simulate(spec: Spec) -> TrafficResult:
        video.parent.mkdir()
        video.write_text("of others")
        return load_or_simulate_traffic(spec)

    monkeypatch.setattr("advercity.pipeline.traffic_report.load_or_simulate_traffic", simulate)
    with pytest.raises(InputError, match=r"plan\.mp4: exists, and there is no record"):
        simulate_to_folder(spec, tmp_path, with_video=False)
    assert [path.name for path in video.parent.iterdir()] == ["plan.mp4"]
    assert video.read_text() == "of others"


@pytest.mark.sumo
def test_simulate_reports_what_succeeds_besides_what_fails(
    specs: dict[str, Spec],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    advercity: Command,
) -> None:
    bad, good = (shortened(specs[f"{road}_clear_day_sparse"]) for road in ("rcnj", "ri"))

    def simulate(spec: Spec) -> TrafficResult:
        if spec.id == bad.id:
            raise RunError(f"{spec.id}: traffic simulation failed: no reason")
        return load_or_simulate_traffic(spec)

    monkeypatch.setattr("advercity.pipeline.traffic_report.load_or_simulate_traffic", simulate)
    write_specs([bad, good], tmp_path / "compiled")
    paths = [tmp_path / "compiled" / f"{spec.id}.json" for spec in (bad, good)]
    ran = advercity("simulate", *paths, "--output", tmp_path / "out", "--no-video")
    assert ran.code == 1
    assert ran.err == f"error: {bad.id}: traffic simulation failed: no reason\n"
    assert good.id in ran.out
    assert (tmp_path / "out" / good.id / "report.json").exists()


@pytest.mark.sumo
def test_a_run_refuses_a_scenario_whose_conflict_does_not_happen(
    specs: dict[str, Spec], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    spec = specs["ri_clear_day_sparse"]
    conflict = spec.conflicts[0]
    strict = conflict.outcome.model_copy(update={"time_to_collision_below_s": 0.01})
    unmet = spec.model_copy(
        update={"conflicts": (conflict.model_copy(update={"outcome": strict}),)}
    )
    traffic = preparation.load_or_simulate_traffic(spec)
    stub = Mock(return_value=traffic)
    monkeypatch.setattr(preparation, "load_or_simulate_traffic", stub)
    options = RunOptions(output=tmp_path, backend="fake")

    with pytest.raises(RunError, match=f"{conflict.conflict}.*is not below 0.01 s"):
        preparation.prepare_scenario(unmet, options)
    assert preparation.prepare_scenario(spec, options).frame_count == len(traffic.trace)

    allowed = preparation.prepare_scenario(unmet, replace(options, allow_missed=True))
    (missed,) = allowed.identity.missed_conflicts
    assert "is not below 0.01 s" in missed
    assert not preparation.prepare_scenario(spec, options).identity.missed_conflicts


@pytest.mark.sumo
def test_traffic_that_cannot_be_staged_is_simulated_once_for_all_weathers(
    specs: dict[str, Spec], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("ADVERCITY_CACHE", str(tmp_path))
    clear, fog = (
        spec.model_copy(update={"timing": spec.timing.model_copy(update={"max_ticks": 65})})
        for spec in (specs["unj_clear_day_sparse"], specs["unj_fog_day_sparse"])
    )
    simulate = Mock(side_effect=preparation.write_simulated_trace)
    monkeypatch.setattr(preparation, "write_simulated_trace", simulate)
    for spec in (clear, fog, clear):
        with pytest.raises(StagingError, match=f"^{spec.id}: traffic .*raise timing.max_ticks"):
            load_or_simulate_traffic(spec)
    assert simulate.call_count == 1

    longer = clear.timing.model_copy(update={"max_ticks": 66})
    with pytest.raises(StagingError, match="max_ticks 66"):
        load_or_simulate_traffic(clear.model_copy(update={"timing": longer}))


@pytest.mark.sumo
def test_a_simulation_that_breaks_is_tried_again(
    specs: dict[str, Spec], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("ADVERCITY_CACHE", str(tmp_path))
    simulate = Mock(side_effect=RunError("no space left on device"))
    monkeypatch.setattr(preparation, "write_simulated_trace", simulate)
    for _ in range(2):
        with pytest.raises(RunError, match="no space left"):
            load_or_simulate_traffic(shortened(specs["unj_clear_day_sparse"]))
    assert simulate.call_count == 2


def crossing(offset_s: float, *, below_s: float = 3.0) -> tuple[StagedConflict, OutcomeCriteria]:
    """An actor who comes to (0, 0) from the south, 2 s after the start and `offset_s`."""
    wanted = OutcomeCriteria(
        arrival_tolerance_s=0.3,
        time_to_collision_below_s=below_s,
        post_encroachment_s=(0.2, 2.0),
    )
    actor = StagedActor.model_construct(
        id="conflict_1_walker",
        number=OTHER,
        behaviour="stops_short",
        path_m=((0.0, -10.0), (0.0, 10.0)),
    )
    staged = StagedConflict.model_construct(
        id="conflict_1",
        conflict="ped_nearside_crossing",
        stages=("nhtsa2019:10",),
        actors=(actor,),
        point_m=(0.0, 0.0),
        parameters={"arrival_offset_s": offset_s},
        declared={
            "actor_speed_km_h": (5.0, 10.0),
            "arrival_offset_s": (-0.2, 0.2),
            "braking_m_s2": (2.0, 3.0),
            "ego_speed_km_h": (40.0, 60.0),
        },
        outcome=wanted,
    )
    return staged, wanted


def crossed(spec: Spec, lag_s: float, meant_s: float, *, below_s: float = 3.0) -> ConflictOutcome:
    """The ego goes east at 10 m/s, the other north at 2 m/s; both would be at the origin."""
    ticks, tick_s = 60, 0.1
    time = np.linspace(0, (ticks - 1) * tick_s, ticks)
    rows = np.zeros((ticks, 2), STATE_DTYPE)
    rows["tick"], rows["actor"] = np.arange(ticks)[:, None], np.arange(2)
    rows["x"][:, 0], rows["speed"][:, 0], rows["travelled"][:, 0] = 10 * time - 20, 10, 10 * time
    rows["y"][:, 1] = 2 * (time - 2 - lag_s)
    rows["speed"][:, 1], rows["travelled"][:, 1] = 2, 2 * time
    rows["yaw"][:, 1] = np.pi / 2
    rows["vx"][:, 0], rows["vy"][:, 1] = 10, 2
    actors = (
        Actor(EGO, "car", "saloon", "car_paint_blue", (4.0, 2.0, 1.5)),
        Actor(OTHER, "pedestrian", "adult", "cloth_dark", (0.5, 0.5, 1.8)),
    )
    trace = Trace(tick_s, 60, actors, rows.ravel(), (), np.zeros((ticks, 0), np.uint8))
    staged, _ = crossing(meant_s, below_s=below_s)
    (found,) = evaluate_outcomes(spec.model_copy(update={"conflicts": (staged,)}), trace)
    return found


def test_an_ego_that_brakes_in_a_turn_would_have_gone_on_with_the_speed_of_its_front_axle(
    specs: dict[str, Spec],
):
    """Its centre turns on a circle of 10 m, its axle, 2.4 m ahead, at 5 m/s on one of 10.28 m.

    So it turns by 0.486 rad/s, and would be at 1.4 rad at 2.88 s; its centre at 5 m/s, at 2.8 s,
    its front, 4 m ahead, at 3.02 s.
    """
    tick_s, radius_m, axle_m, length_m = 0.1, 10.0, 2.4, 8.0
    speed_m_s = 5.0 * radius_m / float(np.hypot(radius_m, axle_m))
    time = np.arange(80) * tick_s
    speed = np.clip(speed_m_s - 5.0 * (time - 1.0), 0.0, speed_m_s)
    speed = np.where(time > 4.0, np.minimum(2.0 * (time - 4.0), speed_m_s), speed)
    travelled = np.cumsum(speed) * tick_s - speed[0] * tick_s
    angle = travelled / radius_m
    rows = np.zeros((80, 2), STATE_DTYPE)
    rows["tick"], rows["actor"] = np.arange(80)[:, None], np.arange(2)
    ego, other = rows[:, 0], rows[:, 1]
    ego["x"], ego["y"] = radius_m * np.sin(angle), radius_m * (1 - np.cos(angle))
    ego["yaw"], ego["speed"], ego["travelled"] = angle, speed, travelled
    ego["vx"], ego["vy"] = speed * np.cos(angle), speed * np.sin(angle)
    ego["acceleration"] = np.gradient(speed, tick_s)
    point = radius_m * np.array([np.sin(1.4), 1 - np.cos(1.4)])
    # The other one comes from the east, level with the point.
    other["x"], other["y"], other["yaw"] = point[0] - 5 * (time - 3.0), point[1], np.pi
    other["speed"], other["vx"], other["travelled"] = 5, -5, 5 * time
    actors = (
        Actor(EGO, "car", "saloon", "car_paint_blue", (length_m, 2.0, 1.5)),
        Actor(OTHER, "pedestrian", "adult", "cloth_dark", (0.5, 0.5, 1.8)),
    )
    trace = Trace(tick_s, 80, actors, rows.ravel(), (), np.zeros((80, 0), np.uint8))
    staged, _ = crossing(0.0)
    staged = staged.model_copy(
        update={
            "point_m": tuple(point.tolist()),
            "resolved_by": "ego",
            "parameters": {"arrival_offset_s": 0.0, "ego_speed_km_h": 18.0},
            "declared": {},
        }
    )

    spec = specs["ui_clear_day_sparse"].model_copy(update={"conflicts": (staged,)})
    (found,) = evaluate_outcomes(spec, trace)

    assert found.ego_at_s == pytest.approx(2.88, abs=0.03)


def test_a_conflict_happened_if_all_was_as_declared(specs: dict[str, Spec]):
    # 1 s late: the ego's tail (2 m) is gone at 2.2 s, the other's front comes to the ego's side
    # (1 m and 0.25 m before the origin) at 2 + 1 - 0.625 s: 0.2 s in between.
    found = crossed(specs["ui_clear_day_sparse"], lag_s=1.0, meant_s=1.0, below_s=6.0)

    assert found.ego_at_s == pytest.approx(2.0)
    assert found.actor_lag_s == pytest.approx(1.0)
    assert found.met.post_encroachment_s is not None
    assert found.met.post_encroachment_s.value == pytest.approx(0.2, abs=0.1)
    assert found.met.time_to_collision_on_way_s is None
    assert found.missed == ("time to collision (none) is not below 6 s",)


def test_a_conflict_that_ends_in_a_crash_is_no_near_miss(specs: dict[str, Spec]):
    found = crossed(specs["ui_clear_day_sparse"], lag_s=0.0, meant_s=0.0)

    assert not found.happened
    assert found.missed[0] == "they touch"
    assert found.met.time_to_collision_on_way_s is not None
    assert found.met.time_to_collision_on_way_s.value == pytest.approx(0.0)


def test_parameters_are_measured_and_those_outside_their_range_are_named(specs: dict[str, Spec]):
    """10 m/s are 36 km/h, below 40; 2 m/s are 7.2 km/h; 1 s is more than 0.2 s."""
    found = crossed(specs["ui_clear_day_sparse"], lag_s=1.0, meant_s=1.0)

    assert [str(item) for item in found.parameters] == [
        "36 (40 to 60)",
        "7.2 (5 to 10)",
        "1 (-0.2 to 0.2)",
    ]
    assert found.outside == ("ego_speed_km_h", "arrival_offset_s")


def test_an_encroachment_is_how_far_the_body_is_over_the_middle_between_both_lanes():
    """Lanes 3 m apart; 0.9 m from the ego's, a body 2 m wide is 1.6 m over their middle.

    Before and after, in bends, its centre is 0.2 m nearer to the ego than its lane.
    """
    ticks = np.arange(40)
    ego, actor = np.zeros(40, STATE_DTYPE), np.zeros(40, STATE_DTYPE)
    ego["tick"] = actor["tick"] = ticks
    ego["x"], actor["x"] = 2 * ticks - 39, 39 - 2 * ticks  # they pass between ticks 19 and 20
    actor["y"] = np.interp(ticks, [0, 8, 16], [2.8, 0.9, 2.8])
    staged = StagedConflict.model_construct(declared={"encroachment_m": (0.8, 1.2)})
    size = np.array([4.0, 2.0])

    (found,) = measure_parameters(
        staged,
        ActorTrack(EGO, size, ego),
        ActorTrack(OTHER, size, actor),
        ego_at_s=2.0,
        lag_s=0.0,
        lanes=(shapely.LineString([(-50, 0), (50, 0)]), shapely.LineString([(50, 3), (-50, 3)])),
        since_red_s=np.inf,
        tick_s=0.1,
    )

    assert found.achieved == pytest.approx(1.6)
    assert found.is_outside


def test_who_walks_aside_arrives_when_level_with_the_ego(specs: dict[str, Spec]):
    """The ego is at the origin at 2 s; 2 m to its right, one walks 1 m/s north-east.

    At 2.5 s it is level with the origin, 0.5 s after the ego.
    """
    ticks, tick_s, slant = 60, 0.1, np.sqrt(0.5)
    time = np.arange(ticks) * tick_s
    ego, walker = np.zeros(ticks, STATE_DTYPE), np.zeros(ticks, STATE_DTYPE)
    ego["tick"] = walker["tick"] = np.arange(ticks)
    ego["x"], ego["speed"], ego["vx"], ego["travelled"] = 10 * (time - 2), 10, 10, 10 * time
    walker["x"], walker["y"] = slant * (time - 2.5), slant * (time - 2.5) - 2.0
    walker["yaw"], walker["speed"], walker["travelled"] = np.pi / 4, 1, time
    walker["vx"] = walker["vy"] = slant
    ego["actor"], walker["actor"] = 0, 1
    actors = (
        Actor(EGO, "car", "saloon", "car_paint_blue", (4.0, 2.0, 1.5)),
        Actor(OTHER, "pedestrian", "adult", "cloth_dark", (0.5, 0.5, 1.8)),
    )
    rows = np.stack([ego, walker], axis=1).ravel()
    trace = Trace(tick_s, ticks, actors, rows, (), np.zeros((ticks, 0), np.uint8))
    staged, wanted = crossing(0.5)
    aside = staged.actors[0].model_copy(update={"behaviour": "steers_clear"})
    level = wanted.model_copy(update={"keeping": "velocity"})
    staged = staged.model_copy(
        update={"actors": (aside,), "outcome": level, "resolved_by": "actor"}
    )
    spec = specs["ui_clear_day_sparse"].model_copy(update={"conflicts": (staged,)})

    (found,) = evaluate_outcomes(spec, trace)

    assert found.actor_lag_s == pytest.approx(0.5, abs=0.02)


def test_an_actor_that_comes_too_late_has_missed_the_conflict(specs: dict[str, Spec]):
    found = crossed(specs["ui_clear_day_sparse"], lag_s=3.0, meant_s=0.5)

    assert "the actor comes 3.00 s after the ego instead of 0.50 s" in found.missed
    assert found.missed[-1].startswith("post-encroachment time 2.")
