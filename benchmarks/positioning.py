"""What GNSS, IMU and bus cost a frame: `python benchmarks/positioning.py`.

The ego at a sparse urban intersection, 20 s after its first frame; bare noise has no rows, for it
costs nothing.
"""

import statistics
import sys
from collections.abc import Callable
from itertools import compress
from pathlib import Path

from advercity_dsl import Agent, Gnss, Imu
from advercity_dsl.can_bus import CanBus
from advercity_dsl.inertial import RoadVibration
from advercity_dsl.positioning import SatelliteReceiver
from benchmark_scene import BenchmarkScene
from measurement import Measurement, format_table, measure_run_time

from advercity.rendering.backend import RENDER_PROFILES
from advercity.sensors.agent_poses import AgentPoses
from advercity.sensors.gnss.driver import GnssDriver
from advercity.sensors.motion_drivers import CanDriver, ImuDriver
from advercity.sensors.stage import Stage
from advercity.testing import FakeRenderer

SPEC, FIRST_FRAME = Path("compiled/ui_clear_day_sparse.json"), 200
MAX_FRAME_S = 0.05
"""A tenth of what a frame takes to sense."""


def run_benchmark(*, quick: bool) -> list[Measurement]:
    """Measure successive frames with each sensor alone."""
    scene, frames = BenchmarkScene(SPEC, FIRST_FRAME), 10 if quick else 40
    single, rtk = (
        Gnss(mode="satellites", receiver=SatelliteReceiver(corrections=corrections))
        for corrections in ("none", "rtk")
    )
    imu = Imu(grade="consumer", rate_hz=100, vibration=RoadVibration())
    cases = {
        "fix from satellites": _with_sensors(scene.ego, gnss=single),
        "fix with RTK": _with_sensors(scene.ego, gnss=rtk),
        "consumer IMU at 100 Hz on a road": _with_sensors(scene.ego, imu=imu),
        "bus at 50 Hz": _with_sensors(scene.ego, imu=None, can=CanBus(rate_hz=50)),
    }
    return [
        Measurement(
            name,
            _measure_median_s(_build_work(scene, agent), frames),
            "s of a core a frame",
            at_most=MAX_FRAME_S,
        )
        for name, agent in cases.items()
    ]


def _with_sensors(agent: Agent, **sensors: object) -> Agent:
    return agent.model_copy(update={"sensors": agent.sensors.model_copy(update=sensors)})


def _build_work(scene: BenchmarkScene, agent: Agent) -> Callable[[int], object]:
    """Build what measures the receiver, inertial unit and bus of an agent in a frame."""
    alone = scene.spec.model_copy(update={"agents": (agent,)})
    poses = AgentPoses(alone, scene.trace)
    stage = Stage(poses, scene.world, FakeRenderer(), RENDER_PROFILES["preview"])
    drivers = [driver(stage) for driver in (GnssDriver, ImuDriver, CanDriver)]

    def work(index: int) -> object:
        stage.place(index)
        for driver in drivers:
            driver.prepare()
        has = (True, agent.sensors.imu is not None, agent.sensors.can is not None)
        return [driver.measure(agent, 0) for driver in compress(drivers, has)]

    return work


def _measure_median_s(work: Callable[[int], object], frames: int) -> float:
    work(FIRST_FRAME)
    indices = range(FIRST_FRAME + 1, FIRST_FRAME + 1 + frames)
    times = [measure_run_time(lambda index=index: work(index)).cpu_s for index in indices]
    return statistics.median(times)


if __name__ == "__main__":
    print(format_table(run_benchmark(quick="--full" not in sys.argv)))
