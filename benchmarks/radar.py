"""How fast the radar is: `python benchmarks/radar.py`.

The ego's front radar of 60,000 rays and three bounces in a dense scenario, on one core, against
the first rays alone in packets, as the LiDAR's baseline casts them. Processor time.
"""

import statistics
from pathlib import Path

import numpy as np
from advercity_dsl import Mount, Radar
from benchmark_scene import BenchmarkScene
from measurement import Measurement, measure_run_time

from advercity.compiler import find_weather
from advercity.geometry.poses import pose_matrix
from advercity.physics.atmosphere import compute_atmosphere
from advercity.randomness import create_generator
from advercity.rendering.raycaster import Raycaster, Rays
from advercity.sensors.radar import (
    PlacedRadar,
    RadarConditions,
    SceneMotion,
    derive_radar_conditions,
    scan_radar,
)
from advercity.sensors.radar.antenna import build_ray_fan

SPEC, FRAME = Path("compiled/ui_clear_day_dense.json"), 50
RADAR = Radar(mounts=(Mount(x_m=2.3, z_m=0.6),))
MAX_SCAN_S = 0.3
"""Per sensor and frame; a scan uses one core."""


def run_benchmark(*, quick: bool) -> list[Measurement]:
    """Measure a scan in clear air and in heavy rain."""
    scene = BenchmarkScene(SPEC, FRAME)
    ego, frame = scene.ego, scene.frame
    caster, motion = Raycaster(scene.world), SceneMotion(scene.frame, scene.world.bodies)
    caster.place(frame, frozenset({ego.number}))
    pose = scene.poses.world_from_agent(ego, FRAME) @ pose_matrix((2.3, 0.0, 0.6))
    placed = PlacedRadar(RADAR, RADAR.mounts[0], pose, scene.poses.velocity(ego, frame), ego.number)
    directions = (build_ray_fan(RADAR).directions @ pose[:3, :3].T).astype(np.float32)
    rays = Rays(np.tile(pose[:3, 3].astype(np.float32), (len(directions), 1)), directions)
    found: list[Measurement] = []
    for name in ("clear_day", "heavy_rain_day"):
        weather = find_weather(name).declaration
        atmosphere = compute_atmosphere(weather, "urban")
        air = derive_radar_conditions(atmosphere, weather.lens, weather.fog)

        def scan(air: RadarConditions = air) -> None:
            scan_radar(placed, (), caster, motion, air, create_generator("benchmark"))

        scan()
        rounds = range(3 if quick else 9)
        scan_s = statistics.median(measure_run_time(scan).cpu_s for _ in rounds)
        cast_s = statistics.median(
            measure_run_time(lambda: caster.cast(rays, RADAR.range_m)).cpu_s for _ in rounds
        )
        found += [
            Measurement(f"radar, {name}", scan_s, "s of a core for a scan", at_most=MAX_SCAN_S),
            Measurement(f"radar, {name}", cast_s / scan_s, "rate of its first rays alone"),
        ]
    return found


if __name__ == "__main__":
    for item in run_benchmark(quick=True):
        print(item)
