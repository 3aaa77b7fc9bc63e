"""Recorded trajectories at the ticks: places, speeds, heights and lamps computed by hand."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from advercity_dsl import Spec

from advercity.compiler.recorded_roads import (
    Recording,
    ReplayChoice,
    load_recorded_table,
    write_recorded_road,
)
from advercity.frames import Lamp, Signal, Trace
from advercity.pipeline.preparation import load_or_simulate_traffic
from advercity.recordings.tracks import Track
from advercity.roads.mirrored_traffic import mirror_trace
from advercity.roads.network_file import SignalProgram
from advercity.roads.plan_frame import mirror_road
from advercity.traffic.motion_spline import interpolate_smoothly
from tests.recordings.recorded_files import GRADE, write_ind, write_street

EGO, OTHER_CAR, TRUCK, WALKER = 101, 1001, 102, 5001


@pytest.fixture(scope="module")
def replay(tmp_path_factory: pytest.TempPathFactory) -> list[Spec]:
    folder = tmp_path_factory.mktemp("recorded")
    choice = ReplayChoice(
        name="hill", ego="1", connected=["3"], weathers=["clear_day", "fog_day"], looks="shaped"
    )
    recording = load_recorded_table(write_ind(folder))
    return write_recorded_road(recording, write_street(folder), choice, folder / "hill")


@pytest.fixture(scope="module")
def trace(replay: list[Spec]) -> Trace:
    return load_or_simulate_traffic(replay[0]).trace


def test_an_actor_is_where_it_was_recorded(trace: Trace) -> None:
    _, ego = trace.get_track(EGO)
    time_s = 0.1 * np.arange(41)
    assert len(trace) == 41
    assert ego["x"] == pytest.approx(50 + 10 * time_s + 0.5 * time_s**2, abs=1e-5)
    assert ego["y"] == pytest.approx(-1.75, abs=1e-6)
    assert ego["vx"] == pytest.approx(10 + time_s, abs=1e-3)
    assert ego["ax"] == pytest.approx(1.0, abs=0.02)  # the file has hundredths of a millimetre
    _, other = trace.get_track(OTHER_CAR)
    assert other["x"] == pytest.approx(160 - 8 * time_s, abs=1e-5)
    assert np.cos(other["yaw"]) == pytest.approx(-1.0)


def test_the_road_gives_height_and_pitch(trace: Trace) -> None:
    _, ego = trace.get_track(EGO)
    _, other = trace.get_track(OTHER_CAR)
    middle = slice(3, -3)
    assert ego["z"][middle] == pytest.approx(GRADE * ego["x"][middle], abs=2e-3)
    # Positive pitch is nose down: the ego drives up, the other car down.
    assert ego["pitch"][middle] == pytest.approx(-math.atan(GRADE), abs=1e-3)
    assert other["pitch"][middle] == pytest.approx(math.atan(GRADE), abs=1e-3)
    assert ego["vz"][middle] == pytest.approx(GRADE * ego["vx"][middle], abs=2e-3)


def test_a_body_is_that_of_the_class_whose_size_is_nearest(
    replay: list[Spec], trace: Trace
) -> None:
    actors = {actor.id: actor for actor in trace.actors}
    assert {number: actor.actor_class for number, actor in actors.items()} == {
        EGO: "car",
        TRUCK: "truck",
        OTHER_CAR: "car",
        WALKER: "pedestrian",
    }
    assert actors[EGO].size[0] == pytest.approx(4.6, abs=0.2)
    assert actors[OTHER_CAR].size[0] == pytest.approx(4.2, abs=0.2)
    for actor in actors.values():
        blueprint = replay[0].blueprints[actor.blueprint]
        assert actor.size == (blueprint.length_m, blueprint.width_m, blueprint.height_m)


def test_one_that_is_held_shows_its_brake_lamps(trace: Trace) -> None:
    _, truck = trace.get_track(TRUCK)
    _, ego = trace.get_track(EGO)
    assert (truck["lamps"] & Lamp.BRAKE).all()
    assert not (ego["lamps"] & Lamp.BRAKE).any()
    assert truck["speed"] == pytest.approx(0.0, abs=1e-6)


def test_weathers_have_one_traffic(replay: list[Spec]) -> None:
    clear, fog = (load_or_simulate_traffic(spec).trace_sha256 for spec in replay)
    assert replay[0].weather.id != replay[1].weather.id
    assert clear == fog


def test_front_wheels_point_along_the_circle(tmp_path: Path) -> None:
    """Around a circle of 20 m at 5 m/s, a car turns at 0.25 rad/s."""
    times_s = np.arange(0, 4.001, 0.04)
    angle = 0.25 * times_s - math.pi / 2
    places = np.column_stack([120 + 20 * np.cos(angle), 18.25 + 20 * np.sin(angle)])
    track = Track("c", "car", (4.6, 1.8, 0), times_s, places, 0.25 * times_s)
    choice = ReplayChoice(name="circle", ego="c", looks="shaped")
    recording = Recording(tmp_path / "circle.csv", [track])
    (spec,) = write_recorded_road(recording, write_street(tmp_path), choice, tmp_path / "out")

    actor, rows = load_or_simulate_traffic(spec).trace.get_track(EGO)

    half_wheelbase_m = 0.6 * actor.size[0] / 2
    assert rows["speed"] == pytest.approx(5.0, abs=0.01)
    assert rows["yaw_rate"] == pytest.approx(0.25, abs=1e-4)
    assert rows["steering"] == pytest.approx(math.atan(half_wheelbase_m / 20), abs=1e-3)
    # A turn to the left accelerates to the left.
    left = rows["ay"] * np.cos(rows["yaw"]) - rows["ax"] * np.sin(rows["yaw"])
    assert left == pytest.approx(5**2 / 20, abs=0.02)


def test_an_actor_is_there_while_it_was_recorded(tmp_path: Path) -> None:
    recording = load_recorded_table(write_ind(tmp_path))
    late = replace(recording.tracks[1], times_s=recording.tracks[1].times_s + 2.5)
    recording = replace(recording, tracks=[recording.tracks[0], late])
    choice = ReplayChoice(name="late", ego="1", looks="shaped", from_s=1.0, to_s=3.0)
    (spec,) = write_recorded_road(recording, write_street(tmp_path), choice, tmp_path / "out")

    trace = load_or_simulate_traffic(spec).trace

    assert len(trace) == 21
    _, ego = trace.get_track(EGO)
    assert ego["x"][0] == pytest.approx(60.5, abs=1e-5)
    _, other = trace.get_track(OTHER_CAR)
    assert other["tick"].tolist() == list(range(15, 21))  # from 2.5 s of the recording on
    assert other["x"][0] == pytest.approx(160.0, abs=1e-5)


def test_a_spline_passes_through_its_values_and_is_smooth() -> None:
    times_s = np.array([0.0, 0.1, 0.25, 0.3, 0.5, 0.6, 0.8])
    values = np.array([0.0, 1, 4, 2, 2, 7, 1])
    assert interpolate_smoothly(times_s, values, times_s)[0] == pytest.approx(values)
    fine = np.linspace(0, 0.8, 80_001)
    place, rate, bend = interpolate_smoothly(times_s, values, fine)
    assert np.diff(place) / 1e-5 == pytest.approx((rate[1:] + rate[:-1]) / 2, abs=1e-2)
    assert np.abs(np.diff(bend)).max() < 1.0  # its second derivative is in hundreds, without jumps


@pytest.mark.parametrize("count", [2, 3, 4, 9])
def test_a_spline_of_a_parabola_is_the_parabola(count: int) -> None:
    times_s = np.cumsum(np.linspace(0.03, 0.05, count))
    square = 3.0 if count > 2 else 0.0
    values = 1 + 2 * times_s + square * times_s**2
    at_s = np.linspace(times_s[0], times_s[-1], 7)
    place, rate, bend = interpolate_smoothly(times_s, values, at_s)
    assert place == pytest.approx(1 + 2 * at_s + square * at_s**2)
    assert rate == pytest.approx(2 + 2 * square * at_s)
    assert bend == pytest.approx(np.full(7, 2 * square), abs=1e-6)


def test_lights_run_their_program() -> None:
    program = SignalProgram("j", 2.0, ((30.0, "G"), (3.0, "y"), (27.0, "r")))
    shown = [program.find_state(time_s) for time_s in (2.0, 31.9, 32.0, 35.0, 61.9, 62.0, 0.0)]
    assert shown == ["G", "G", "y", "r", "r", "G", "r"]
    assert Signal.RED == 0


def test_on_a_left_hand_road_tracks_are_in_the_world(replay: list[Spec], trace: Trace) -> None:
    """The map's network is that of a mirrored map; the tracks of the spec are on the other side."""
    left = replay[0].model_copy(update={"road": mirror_road(replay[0].road)})

    found = load_or_simulate_traffic(left).trace

    assert left.road.is_left_hand
    assert mirror_trace(found).compute_sha256() == trace.compute_sha256()
    _, ego = found.get_track(EGO)
    _, image = trace.get_track(EGO)
    assert ego["y"] == pytest.approx(-image["y"])
    assert ego["z"] == pytest.approx(image["z"])
