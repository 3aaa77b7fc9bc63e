"""Every actor's motion is one smooth trajectory, differentiated here by differences alone."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from advercity_dsl import Imu, Spec
from numpy.typing import NDArray

from advercity.frames import Actor, Frame, Trace
from advercity.sensors.imu import measure_imu

pytestmark = pytest.mark.sumo
Simulated = Callable[[Spec], Trace]
Columns = NDArray[np.float64]
EMERGENCY_M_S2 = 2.5
"""Change of speed above which the second before and after it counts as an emergency."""


@pytest.fixture(
    scope="module",
    params=[
        "ui_clear_day_sparse",
        "rsnj_clear_day_dense",
        pytest.param("unj_clear_day_dense", marks=pytest.mark.slow),
        pytest.param("ui_clear_day_dense", marks=pytest.mark.slow),
    ],
)
def name(request: pytest.FixtureRequest) -> str:
    """The id of a spec."""
    return request.param


@pytest.fixture(scope="module")
def trace(name: str, specs: dict[str, Spec], simulate: Simulated) -> Trace:
    return simulate(specs[name])


def tracks_of(trace: Trace) -> list[tuple[Actor, NDArray[np.void]]]:
    tracks = [trace.get_track(actor.id) for actor in trace.actors]
    return [(actor, rows) for actor, rows in tracks if len(rows) > 3]


def columns(rows: NDArray[np.void], *names: str) -> Columns:
    return np.column_stack([rows[name] for name in names])


def lengths(vectors: Columns) -> Columns:
    return np.linalg.norm(vectors, axis=1)


def test_speed_velocity_and_displacement_agree_at_every_tick(trace: Trace):
    for actor, rows in tracks_of(trace):
        places, velocity = columns(rows, "x", "y", "z"), columns(rows, "vx", "vy", "vz")
        steps = np.diff(places, axis=0) / trace.tick_s
        moved = (places[2:] - places[:-2]) / (2 * trace.tick_s)
        mean_speed = (rows["speed"][1:] + rows["speed"][:-1]) / 2

        assert lengths(moved - velocity[1:-1]).max() < 0.1, actor
        assert np.abs(lengths(steps) - mean_speed).max() < 0.1, actor
        np.testing.assert_allclose(lengths(velocity), rows["speed"], atol=1e-9)


def test_accelerations_and_turn_rates_are_derivatives(trace: Trace):
    for actor, rows in tracks_of(trace):
        velocity, acceleration = columns(rows, "vx", "vy", "vz"), columns(rows, "ax", "ay", "az")
        gained = (velocity[2:] - velocity[:-2]) / (2 * trace.tick_s)
        yaw = np.unwrap(rows["yaw"])
        turned = (yaw[2:] - yaw[:-2]) / (2 * trace.tick_s)
        nodded = (rows["pitch"][2:] - rows["pitch"][:-2]) / (2 * trace.tick_s)

        assert lengths(gained - acceleration[1:-1]).max() < 0.5, actor
        assert np.abs(turned - rows["yaw_rate"][1:-1]).max() < 0.1, actor
        assert np.abs(nodded - rows["pitch_rate"][1:-1]).max() < 0.05, actor


def test_nobody_accelerates_in_jerks(name: str, trace: Trace, specs: dict[str, Spec]):
    spec = specs[name]
    staged = {actor.number for conflict in spec.conflicts for actor in conflict.actors}
    connected = {agent.number for agent in spec.agents}

    for actor, rows in tracks_of(trace):
        jerk = np.diff(columns(rows, "ax", "ay", "az"), axis=0) / trace.tick_s
        along = np.abs(np.diff(rows["acceleration"])) / trace.tick_s
        hard = np.abs(rows["acceleration"][:-1]) > EMERGENCY_M_S2
        around = np.convolve(hard, np.ones(21), mode="full")[10:-10] > 0
        assert lengths(jerk).max() < (20 if actor.id in staged | connected else 30), actor
        if actor.id in staged | connected and actor.actor_class != "pedestrian":
            assert lengths(jerk)[~around].max(initial=0) < 5, actor
        elif actor.id in staged:
            assert along[~around].max(initial=0) < 6.5, actor


def test_people_turn_no_faster_than_people_do(trace: Trace):
    rates = [
        np.degrees(np.abs(rows["yaw_rate"])).max()
        for actor, rows in tracks_of(trace)
        if actor.actor_class == "pedestrian"
    ]

    assert max(rates, default=0) < 180
    assert sum(rate > 130 for rate in rates) <= 0.05 * len(rates)


def test_who_stands_stands_exactly(trace: Trace):
    standing = 0
    for actor, rows in tracks_of(trace):
        places = columns(rows, "x", "y", "z", "yaw")
        stands = (rows["speed"][1:] == 0) & (rows["speed"][:-1] == 0)
        standing += int(stands.sum())
        if actor.actor_class != "pedestrian":
            assert not np.diff(places, axis=0)[stands].any(), actor
    assert standing > 0


def test_the_imu_measures_the_acceleration_that_others_annotate(
    name: str, trace: Trace, specs: dict[str, Spec]
):
    number = specs[name].ego.number
    frames = [trace.build_frame(index) for index in range(len(trace))]
    forces = np.array(
        [measure(frames[max(index - 1, 0)], frames[index], number) for index in range(len(frames))]
    )
    states = [frame.get_state(number) for frame in frames]
    pitches = [math.asin(-state.world_from_body[2, 0]) for state in states]
    by_gravity = -9.81 * np.sin(pitches)

    annotated = np.array([state.acceleration_m_s2 for state in states])
    np.testing.assert_allclose(forces[:, 0] - by_gravity, annotated, atol=1e-6)
    places = np.array([state.world_from_body[:3, 3] for state in states])
    second = np.diff(places, n=2, axis=0) / trace.tick_s**2
    turned = [
        state.world_from_body[:3, :3] @ force for state, force in zip(states, forces, strict=True)
    ]
    assert lengths(np.array(turned)[1:-1] - [0, 0, 9.81] - second).max() < 0.3
    assert np.abs(np.diff(forces, axis=0)).max() < 1.0


def measure(before: Frame, now: Frame, number: int) -> NDArray[np.float64]:
    last, this = before.get_state(number), now.get_state(number)
    poses, motions = (last.world_from_body, this.world_from_body), (last.motion, this.motion)
    found = measure_imu(Imu(), poses, motions, 0.1, key=("motion",), frame=now.index)
    assert found is not None
    return found.specific_force
