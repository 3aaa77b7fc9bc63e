"""Samples between two frames see velocities and other sensors at their own instants."""

from typing import Any

import numpy as np
import pytest
from advercity_dsl import Mount, Radar, Spec
from advercity_dsl.positioning import Gnss

from advercity.frames import STATE_DTYPE, Actor, Trace
from advercity.rendering.backend import RenderProfile
from advercity.sensors.agent_poses import AgentPoses
from advercity.sensors.gnss import driver as gnss_driver
from advercity.sensors.radar import driver as radar_driver
from advercity.sensors.stage import Stage
from advercity.testing import CAR, FakeRenderer, build_flat_world, load_example_spec

EGO, OTHER, TICK_S = 101, 102, 0.1
SPEED_M_S, ACCELERATION_M_S2 = 12.0, -3.0
MIDDLE = 1


def place_two_vehicles(**sensors: Any) -> tuple[Stage, Spec]:
    """Place two vehicles that brake, 30 m apart, in the middle one of three frames."""
    spec = load_example_spec("ui_clear_day_sparse")
    agents = tuple(
        agent.model_copy(update={"sensors": agent.sensors.model_copy(update=sensors)})
        for agent in spec.agents
        if agent.number in (EGO, OTHER)
    )
    road = spec.road.model_copy(update={"surroundings": ()})
    spec = spec.model_copy(update={"agents": agents, "road": road})
    states = np.zeros((3, 2), STATE_DTYPE)
    states["tick"], states["actor"] = np.arange(3)[:, None], np.arange(2)
    time_s = (np.arange(3)[:, None] - MIDDLE) * TICK_S
    states["vx"] = states["speed"] = SPEED_M_S + ACCELERATION_M_S2 * time_s
    states["ax"] = ACCELERATION_M_S2
    states["x"] = SPEED_M_S * time_s + ACCELERATION_M_S2 / 2 * time_s**2 + [0.0, 30.0]
    cars = tuple(Actor(number, "car", "car", "car_paint_red", CAR.size) for number in (EGO, OTHER))
    trace = Trace(TICK_S, 0, cars, states.ravel(), (), np.zeros((3, 0), np.uint8))
    profile = RenderProfile("fake", 1.0, "raster")
    stage = Stage(AgentPoses(spec, trace), build_flat_world(), FakeRenderer(), profile)
    stage.place(MIDDLE)
    return stage, spec


@pytest.mark.parametrize("offset_ms", [30.0, 45.0, 0.0])
def test_a_radar_is_disturbed_by_others_where_they_are_at_its_sample(
    offset_ms: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    mount = Mount(x_m=2.5, z_m=0.6)
    radar = Radar(mounts=(mount,), rate_hz=20.0, offset_ms=offset_ms)
    stage, spec = place_two_vehicles(radar=radar)
    seen: list[tuple[Any, Any]] = []

    def record(placed: Any, others: Any, *rest: object) -> Any:
        seen.append((placed, *others))
        raise InterruptedError

    monkeypatch.setattr(radar_driver, "scan_radar", record)
    driver = radar_driver.RadarDriver(stage)
    driver.prepare()
    for agent in spec.agents:
        with pytest.raises(InterruptedError):
            driver.measure(agent, 0)
    late_s = -((0.05 - offset_ms / 1000) % 0.05)
    ahead_m = SPEED_M_S * late_s + ACCELERATION_M_S2 / 2 * late_s**2 + 2.5
    for placed, other in (seen[0], seen[1][::-1]):
        assert placed.world_from_radar[0, 3] == pytest.approx(ahead_m, abs=1e-9)
        assert other.world_from_radar[0, 3] == pytest.approx(ahead_m + 30.0, abs=1e-9)
        speeds = placed.velocity[0], other.velocity[0]
        assert speeds == pytest.approx([SPEED_M_S + ACCELERATION_M_S2 * late_s] * 2)


def test_fixes_between_frames_are_taken_at_their_own_velocities(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found: list[tuple[float, float]] = []

    def record(self: object, time_s: float, *, velocity: Any, **rest: object) -> None:
        found.append((time_s, float(velocity[0])))

    monkeypatch.setattr(gnss_driver.ReceiverInPlace, "measure", record)
    stage, _ = place_two_vehicles(gnss=Gnss(mode="satellites", rate_hz=50.0))
    gnss_driver.GnssDriver(stage).prepare()
    times_s, speeds_m_s = np.array(found).reshape(2, 5, 2)[0].T
    np.testing.assert_allclose(times_s, [0.02, 0.04, 0.06, 0.08, 0.1])
    np.testing.assert_allclose(speeds_m_s, [12.24, 12.18, 12.12, 12.06, 12.0])
