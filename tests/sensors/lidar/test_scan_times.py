"""The scans of a LiDAR follow each other at its own rate, whatever the rate of frames."""

from dataclasses import replace

import numpy as np
import pytest
from advercity_dsl import Lidar, Spec

from advercity.frames import STATE_DTYPE, Actor, Trace
from advercity.sensors.agent_poses import AgentPoses
from advercity.sensors.lidar.driver import find_scan_time


@pytest.mark.parametrize("tick_s", [0.1, 0.05])
@pytest.mark.parametrize("rate_hz", [None, 10.0, 12.5, 20.0])
@pytest.mark.parametrize("shift_s", [0.0, 0.02])
def test_a_scan_is_numbered_by_the_time_since_the_first_frame(
    tick_s: float, rate_hz: float | None, shift_s: float, specs: dict[str, Spec]
) -> None:
    frames = 40
    states = np.zeros(frames, dtype=STATE_DTYPE)
    states["tick"] = np.arange(frames)
    car = Actor(1001, "car", "sedan", "car_paint_red", (4.0, 1.8, 1.5))
    trace = Trace(tick_s, 59, (car,), states, (), np.zeros((frames, 0), np.uint8))
    poses = AgentPoses(specs["ui_clear_day_sparse"], trace)
    lidar = Lidar(rate_hz=rate_hz)
    for index in (0, 7, 39):
        frame = trace.build_frame(index)
        found = find_scan_time(lidar, replace(frame, time_s=frame.time_s + shift_s), poses)
        rate = rate_hz or 1 / tick_s
        assert found.period_s == pytest.approx(1 / rate)
        assert found.index == pytest.approx((index * tick_s + shift_s) * rate, abs=1e-6)
