"""How fast the radar is: `python benchmarks/radar.py`.

The ego's front radar of 60,000 rays and three bounces scans a dense scenario on one core. Its
baseline is Embree alone through its Python wrapper: all rays that the scan casts, mirrored ones and
those back to the radar included, cast again for the triangle and the range. Processor time.
"""

import statistics
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from advercity_dsl import Mount, Radar
from benchmark_scene import BenchmarkScene
from lidar import EmbreeBaseline
from measurement import Measurement, measure_run_time

from advercity.compiler import find_weather
from advercity.geometry.poses import pose_matrix
from advercity.physics.atmosphere import compute_atmosphere
from advercity.randomness import create_generator
from advercity.rendering.raycaster import Raycaster, RayHits, Rays
from advercity.sensors.radar import (
    PlacedRadar,
    RadarConditions,
    SceneMotion,
    derive_radar_conditions,
    scan_radar,
)
from advercity.world import World

SPEC, FRAME = Path("compiled/ui_clear_day_dense.json"), 50
MOUNT = Mount(x_m=2.3, z_m=0.6)
RADAR = Radar(mounts=(MOUNT,))
MAX_SCAN_S = 0.3
"""Per sensor and frame; a scan uses one core."""


class RecordingRaycaster(Raycaster):
    """A ray caster that keeps the rays it casts."""

    def __init__(self, world: World) -> None:
        super().__init__(world)
        self.kept: list[Rays] = []

    def cast(self, rays: Rays, max_range_m: float) -> RayHits:
        """Keep rays and cast them."""
        self.kept.append(rays)
        return super().cast(rays, max_range_m)


class RadarScene(BenchmarkScene):
    """A scenario with a radar on the ego's front bumper."""

    def __init__(self) -> None:
        super().__init__(SPEC, FRAME)
        ego = self.ego
        pose = self.poses.world_from_agent(ego, FRAME) @ pose_matrix((MOUNT.x_m, 0.0, MOUNT.z_m))
        velocity = self.poses.velocity(ego, self.frame)
        self.placed = PlacedRadar(RADAR, MOUNT, pose, velocity, ego.number)
        self.motion = SceneMotion(self.frame, self.world.bodies)

    def scan(self, caster: Raycaster, air: RadarConditions) -> None:
        """Place the frame, which costs next to nothing again, and scan once."""
        caster.place(self.frame, frozenset({self.ego.number}))
        rng = create_generator("benchmark")
        scan_radar(self.placed, (), caster, self.motion, air, rng)

    def record_rays(self, air: RadarConditions) -> list[Rays]:
        """List the rays that a scan casts, bounce by bounce."""
        caster = RecordingRaycaster(self.world)
        self.scan(caster, air)
        return caster.kept

    def build_baseline(self) -> EmbreeBaseline:
        """Build the baseline of the frame without the ego, whose bumper the radar is in."""
        others = tuple(one for one in self.frame.states if one.actor.id != self.ego.number)
        return EmbreeBaseline(self, replace(self.frame, states=others))


def run_benchmark(*, quick: bool) -> list[Measurement]:
    """Measure a scan in clear air and in heavy rain."""
    scene, rounds = RadarScene(), 3 if quick else 9
    caster, baseline = Raycaster(scene.world), scene.build_baseline()
    found: list[Measurement] = []
    for name in ("clear_day", "heavy_rain_day"):
        weather = find_weather(name).declaration
        atmosphere = compute_atmosphere(weather, "urban")
        air = derive_radar_conditions(atmosphere, weather.lens)
        rays = scene.record_rays(air)
        scan_s = _measure_median_s(lambda air=air: scene.scan(caster, air), rounds)
        embree_s = _measure_median_s(lambda rays=rays: _cast(baseline, rays), rounds)
        what = f"radar, {name}"
        found += [
            Measurement(what, scan_s, "s of a core for a scan", at_most=MAX_SCAN_S),
            Measurement(what, embree_s / scan_s, "rate of Embree alone"),
        ]
    return found


def _cast(baseline: EmbreeBaseline, bounces: list[Rays]) -> None:
    for rays in bounces:
        baseline.cast_single(rays.origins, rays.directions)


def _measure_median_s(work: Callable[[], object], rounds: int) -> float:
    """Measure the median processor time of some calls after a first one."""
    work()
    return statistics.median(measure_run_time(work).cpu_s for _ in range(rounds))


if __name__ == "__main__":
    for item in run_benchmark(quick=False):
        print(item)
