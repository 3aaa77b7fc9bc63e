"""How fast the LiDAR is, and how much the weather costs: `python benchmarks/lidar.py [SPEC]`.

All five sensors of a dense scenario scan, frame after frame, on one core. Each measurement comes
with two baselines: the same rays against one scene of the same triangles, built beforehand, for the
triangle and the range of each hit alone. One is Embree through its Python wrapper, ray by ray; the
other casts rays in packets, as the LiDAR does. All are measured in processor time, so that ratios
hold on a busy machine too. With `--frames N` it also runs N frames and prints the memory in use.
"""

import argparse
import resource
import statistics
from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from advercity_dsl import Agent, Lidar, RoadsideUnit, Weather
from benchmark_scene import BenchmarkScene
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from measurement import Measurement, measure_run_time

from advercity.compiler import find_weather
from advercity.frames import Frame
from advercity.geometry.arrays import FloatArray
from advercity.physics.atmosphere import compute_atmosphere
from advercity.randomness import create_generator
from advercity.rendering import embree
from advercity.rendering.raycaster import Raycaster
from advercity.sensors.lidar import (
    LidarConditions,
    beam_directions,
    cast_scan,
    derive_lidar_conditions,
    measure_point_cloud,
)

WEATHERS = ("clear_day", "soft_rain_day", "heavy_rain_day", "fog_day", "foggy_heavy_rain_day")
WARM_UP = 2
FIRST_FRAME = 50
TRIALS = 3
"""Calls of which the quickest counts: other processes can only add time."""
RANGE_M = 200.0
SPEC = Path("compiled/ui_clear_day_dense.json")


EFFECTS: dict[str, dict[str, Any]] = {
    "range noise by signal": {"range_noise_m": 0.02, "range_noise_model": "signal"},
    "reflectivity levels": {"receiver": {"white_level": 100}},
    "gain control": {"receiver": {"near_field_m": 30}},
    "field of view": {"receiver": {"field_of_view_mrad": 3}},
    "stray light": {"receiver": {"stray_light_db": -50}},
    "dual returns": {"echoes": "dual"},
    "motion": {"motion_distortion": True},
    "7 sub-rays": {"sub_rays": 7},
}
"""Fields of a LiDAR whose cost is measured one by one, against a LiDAR without."""


class LidarScene(BenchmarkScene):
    """All sensors of a scenario, and a ray caster."""

    def __init__(self, spec_path: Path) -> None:
        super().__init__(spec_path, FIRST_FRAME)
        self.caster = Raycaster(self.world)

    def load_frames(self, count: int) -> list[Frame]:
        """Load frames from the first on, with all their bodies built."""
        frames = [self.poses.load_frame(FIRST_FRAME + number) for number in range(count)]
        for frame in frames:
            self.caster.place(frame)
        return frames

    def count_points(
        self, agent: Agent, frame: Frame, air: LidarConditions, lidar: Lidar | None = None
    ) -> int:
        """Scan with an agent's sensor, or another one in its place, and count the points."""
        lidar = lidar or agent.sensors.lidars[0]
        is_roadside = isinstance(agent.place, RoadsideUnit)
        self.caster.place(frame, frozenset() if is_roadside else frozenset({agent.number}))
        pose = self.poses.world_from_sensors("lidar", agent, frame)[0]
        scan = cast_scan(lidar, pose, self.caster, puddle_coverage=air.puddle_coverage)
        rng = create_generator("benchmark", agent.id, frame.index)
        return len(measure_point_cloud(lidar, scan, air, rng, states=frame.states).points)

    def compute_rays(self, agent: Agent, frame: Frame) -> tuple[FloatArray, FloatArray]:
        """Compute origins and directions (n, 3) of a sensor's rays."""
        pose = self.poses.world_from_sensors("lidar", agent, frame)[0]
        directions = (beam_directions(agent.sensors.lidars[0]) @ pose[:3, :3].T).astype(np.float32)
        origins = np.repeat(pose[None, :3, 3].astype(np.float32), len(directions), axis=0)
        return origins, np.ascontiguousarray(directions)


class EmbreeBaseline:
    """Embree alone with all meshes of a frame.

    Attributes:
        mesh: Vertices (n, 3) and triangles (m, 3) of all together.
    """

    def __init__(self, scene: BenchmarkScene, frame: Frame) -> None:
        meshes = scene.list_world_meshes(frame)
        starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)]).astype(np.int32)
        triangles = [mesh.triangles + start for mesh, start in zip(meshes, starts, strict=False)]
        self._single: Any = EmbreeScene(robust=True)
        self.mesh = np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(triangles)
        TriangleMesh(self._single, *self.mesh)
        self._packets = embree.EmbreeScene([embree.EmbreeMesh(meshes)], np.eye(4)[None])
        # The wrapper builds its acceleration structure at the first cast.
        self.cast_single(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))

    def cast_single(self, origins: FloatArray, directions: FloatArray) -> None:
        """Cast ray by ray."""
        limits = np.full(len(origins), RANGE_M, np.float32)
        self._single.run(origins, directions, limits, output=True)

    def cast_packets(self, origins: FloatArray, directions: FloatArray, rings: int) -> None:
        """Cast 16 rays of a ring at a time."""
        self._packets.cast(origins, directions, RANGE_M, rings=rings)


class Open3dBaseline:
    """Open3D's ray caster, on one thread like all the others."""

    def __init__(self, embree_baseline: EmbreeBaseline) -> None:
        open3d: Any = import_module("open3d")
        self._tensor: Any = open3d.core.Tensor
        self._scene: Any = open3d.t.geometry.RaycastingScene(nthreads=1)
        vertices, triangles = embree_baseline.mesh
        self._scene.add_triangles(self._tensor(vertices), self._tensor(triangles.astype(np.uint32)))

    def cast(self, origins: FloatArray, directions: FloatArray) -> None:
        """Cast rays; the first cast builds the acceleration structure."""
        self._scene.cast_rays(self._tensor(np.hstack([origins, directions])), nthreads=1)


class LidarRound:
    """Processor time of all sensors in one frame: the baselines, and all that the LiDAR does."""

    def __init__(self, scene: LidarScene, frame: Frame, air: LidarConditions) -> None:
        self.points = self.rays = 0
        self.single_s = self.packets_s = 0.0
        baseline = EmbreeBaseline(scene, frame)
        self.whole_s = measure_run_time(lambda: scene.caster.place(frame)).cpu_s
        for agent in scene.spec.agents:
            rays, rings = scene.compute_rays(agent, frame), agent.sensors.lidars[0].channels
            self.single_s += measure_min_cpu_s(lambda rays=rays: baseline.cast_single(*rays))
            self.packets_s += measure_min_cpu_s(
                lambda rays=rays, rings=rings: baseline.cast_packets(*rays, rings)
            )
            self.whole_s += measure_min_cpu_s(
                lambda agent=agent: scene.count_points(agent, frame, air)
            )
            self.rays += len(rays[0])
            self.points += scene.count_points(agent, frame, air)

    @property
    def rates(self) -> tuple[float, ...]:
        """Rates in millions per second, and ratios to Embree alone, in the table's order."""
        return (
            self.points / self.whole_s / 1e6,
            self.rays / self.whole_s / 1e6,
            self.rays / self.single_s / 1e6,
            self.single_s / self.whole_s,
            self.rays / self.packets_s / 1e6,
            self.packets_s / self.whole_s,
        )


def run_benchmark(*, quick: bool) -> list[Measurement]:
    """Measure everything that LiDARs do against ray casting alone."""
    rounds, names = (3, WEATHERS[-1:]) if quick else (9, WEATHERS)
    scene = LidarScene(SPEC)
    frames = scene.load_frames(rounds + WARM_UP)
    found: list[Measurement] = []
    for weather in (build_clear_weather(), *(find_weather(name).declaration for name in names)):
        rows = measure_rounds(scene, frames, weather)
        ratio = statistics.median(row.single_s / row.whole_s for row in rows)
        found.append(
            Measurement(f"LiDAR, {weather.id}", ratio, "rate of Embree alone", at_least=0.5)
        )
    effects = measure_effects(scene, frames[WARM_UP])
    found += [
        Measurement(f"LiDAR, {name}", ratio, "time of a scan without")
        for name, ratio in effects.items()
    ]
    if find_spec("open3d"):
        ratio = statistics.median(_measure_against_open3d(scene, item) for item in frames[WARM_UP:])
        found.append(Measurement("LiDAR, none", ratio, "rate of Open3D's caster", at_least=0.5))
    return found


def measure_effects(scene: LidarScene, frame: Frame) -> dict[str, float]:
    """Measure the time of the ego's scan in fog with each effect, relative to one without."""
    air, ego = derive_conditions(find_weather("fog_day").declaration), scene.spec.agents[0]
    plain = ego.sensors.lidars[0]

    def measure(fields: dict[str, Any]) -> float:
        lidar = Lidar.model_validate(plain.model_dump() | fields)
        scene.count_points(ego, frame, air, lidar)
        return measure_min_cpu_s(lambda: scene.count_points(ego, frame, air, lidar))

    without_s = measure({})
    return {name: measure(fields) / without_s for name, fields in EFFECTS.items()}


def measure_rounds(scene: LidarScene, frames: list[Frame], weather: Weather) -> list[LidarRound]:
    """Measure all frames after the warm-up in a weather."""
    air = derive_conditions(weather)
    return [LidarRound(scene, frame, air) for frame in frames][WARM_UP:]


def measure_min_cpu_s(work: Callable[[], object]) -> float:
    """Measure the least processor time of a few calls."""
    return min(measure_run_time(work).cpu_s for _ in range(TRIALS))


def derive_conditions(weather: Weather) -> LidarConditions:
    """Derive the LiDAR's conditions of a weather in town."""
    return derive_lidar_conditions(compute_atmosphere(weather, "urban"), weather.lens)


def build_clear_weather() -> Weather:
    """Build a weather without air, water or sun."""
    return Weather.model_validate(
        {"id": "none", "time": "night", "air": {"mor_m": None}, "sun": {"elevation_deg": -30}}
    )


def _measure_against_open3d(scene: LidarScene, frame: Frame) -> float:
    """Measure the rate of all that is done without weather relative to Open3D's rays alone."""
    peer = Open3dBaseline(EmbreeBaseline(scene, frame))
    air = derive_conditions(build_clear_weather())
    baseline_s = whole_s = 0.0
    for agent in scene.spec.agents:
        rays = scene.compute_rays(agent, frame)
        peer.cast(*(part[:1] for part in rays))
        baseline_s += measure_min_cpu_s(lambda rays=rays: peer.cast(*rays))
        whole_s += measure_min_cpu_s(lambda agent=agent: scene.count_points(agent, frame, air))
    return baseline_s / whole_s


def print_table(scene: LidarScene, rounds: int) -> None:
    """Print one row per weather."""
    frames = scene.load_frames(rounds + WARM_UP)
    sensors, actors = len(scene.spec.agents), len(frames[0].states)
    print(f"{sensors} sensors, {actors} actors, {rounds} frames, medians\n")
    print("| weather | points | M points/s | M rays/s | Embree alone | ratio | packets | ratio |")
    print("|---|---|---|---|---|---|---|---|")
    for weather in (build_clear_weather(), *(find_weather(name).declaration for name in WEATHERS)):
        rows = measure_rounds(scene, frames, weather)
        cells = np.median([row.rates for row in rows], axis=0)
        points = round(statistics.median(row.points for row in rows))
        print(f"| {weather.id} | {points} | {' | '.join(f'{cell:.2f}' for cell in cells)} |")


def print_memory(scene: LidarScene, frames: int) -> None:
    """Print the memory of the process during many frames."""
    air = derive_conditions(find_weather("foggy_heavy_rain_day").declaration)
    for number in range(frames + 1):
        if number % max(1, frames // 4) == 0:
            resident = psutil.Process().memory_info().rss / 2**20
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
            print(f"after {number} frames: {resident:.0f} MiB, at most {peak:.0f} MiB")
        frame = scene.poses.load_frame(number % scene.length)
        for agent in scene.spec.agents:
            scene.count_points(agent, frame, air)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("spec", nargs="?", default=SPEC, type=Path)
    parser.add_argument("--rounds", default=7, type=int)
    parser.add_argument("--frames", default=0, type=int)
    options = parser.parse_args()
    scene = LidarScene(options.spec)
    print_table(scene, options.rounds)
    print("\n| effect | time of a scan in fog |\n|---|---|")
    for name, ratio in measure_effects(scene, scene.load_frames(1)[0]).items():
        print(f"| {name} | {ratio:.2f} |")
    if options.frames:
        print_memory(scene, options.frames)


if __name__ == "__main__":
    main()
