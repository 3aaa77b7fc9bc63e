"""How fast the LiDAR is, and how much the weather costs: `python benchmarks/lidar.py [SPEC]`.

All five sensors of a dense scenario look, frame after frame, on one core. Beside every measurement
two bare casts run: the same rays against one scene of the same triangles, built beforehand, for
which triangle each ray meets and how far away; their answers are thrown away. One is Embree as its
Python wrapper has it, ray by ray; the other takes rays in packets, as the LiDAR does. All are
measured in processor time, so that ratios hold on a busy machine too. With `--frames N` it also
runs N frames and prints what they leave behind in memory.
"""

import argparse
import math
import resource
import statistics
import time
from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np
import psutil
from advercity_dsl import Agent, Lidar, RoadsideUnit, Spec, Weather
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from measurement import Figure
from numpy.typing import NDArray

from advercity.compiler import find_weather, read_spec
from advercity.frames import Frame
from advercity.geometry.poses import transform_points
from advercity.physics.atmosphere import compute_atmosphere
from advercity.pipeline.agent_poses import AgentPoses
from advercity.pipeline.preparation import load_or_build_world, load_or_simulate_traffic
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
from advercity.world import World

Result = TypeVar("Result")
Floats = NDArray[np.floating[Any]]
Rows = NDArray[np.intp]

WEATHERS = ("clear_day", "soft_rain_day", "heavy_rain_day", "fog_day", "foggy_heavy_rain_day")
WARM_UP = 2
FIRST = 50
"""Frame to begin with."""
TRIALS = 3
"""Of everything that is timed; what others do to the machine only adds."""
RANGE_M = 200.0
SPEC = Path("compiled/ui_clear_day_dense.json")


class Scene:
    """All sensors of a scenario, ready to look."""

    def __init__(self, spec: Spec) -> None:
        stage = load_or_simulate_traffic(spec)
        self.viewpoints = AgentPoses(spec, stage.trace)
        self.world = load_or_build_world(spec, stage.network_path)
        self.caster = Raycaster(self.world)
        self.frames = len(stage.trace)
        self.agents = spec.agents

    def look(self, agent: Agent, frame: Frame, air: LidarConditions) -> int:
        """Points of a sensor in a frame."""
        lidar = agent.sensors.lidar
        roadside = isinstance(agent.place, RoadsideUnit)
        self.caster.place(frame, frozenset() if roadside else frozenset({agent.number}))
        pose = self.viewpoints.world_from_lidar(agent, frame)
        scan = cast_scan(lidar, pose, self.caster, puddle_coverage=air.puddle_coverage)
        rng = create_generator("benchmark", agent.id, frame.index)
        return len(measure_point_cloud(lidar, scan, air, rng, states=frame.states).points)

    def rays(self, agent: Agent, frame: Frame) -> tuple[Floats, Floats]:
        """Origins and directions of a sensor's rays."""
        pose = self.viewpoints.world_from_lidar(agent, frame)
        directions = (beam_directions(agent.sensors.lidar) @ pose[:3, :3].T).astype(np.float32)
        origins = np.repeat(pose[None, :3, 3].astype(np.float32), len(directions), axis=0)
        return origins, np.ascontiguousarray(directions)


class Bare:
    """Embree alone with all that is there in a frame."""

    def __init__(self, world: World, frame: Frame) -> None:
        there = [(mesh, np.eye(4)) for mesh in world.static]
        for state in frame.states:
            parts = world.bodies[state.actor.blueprint].parts
            there += [(mesh, state.world_from_body) for mesh in parts]
        moved = [
            replace(mesh, vertices=transform_points(at, mesh.vertices).astype(np.float32))
            for mesh, at in there
        ]
        starts = np.cumsum([0, *(len(mesh.vertices) for mesh in moved)]).astype(np.int32)
        triangles = [mesh.triangles + start for mesh, start in zip(moved, starts, strict=False)]
        self._single: Any = EmbreeScene(robust=True)
        self.mesh = np.concatenate([mesh.vertices for mesh in moved]), np.concatenate(triangles)
        TriangleMesh(self._single, *self.mesh)
        self._packets = embree.EmbreeScene([embree.EmbreeMesh(moved)], np.eye(4)[None])
        # The wrapper commits its scene when it is first asked.
        self.single(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))

    def single(self, origins: Floats, directions: Floats) -> None:
        """Cast ray by ray."""
        limits = np.full(len(origins), RANGE_M, np.float32)
        self._single.run(origins, directions, limits, output=True)

    def packets(self, origins: Floats, directions: Floats, order: Rows) -> None:
        """Cast 16 rays at a time."""
        self._packets.cast(origins, directions, RANGE_M, ray_order=order)


def timed(work: Callable[[], Result]) -> tuple[float, Result]:
    """Least seconds of processor time that it takes in a few trials, and what comes of it."""
    least_s, result = math.inf, None
    for _ in range(TRIALS):
        start = time.process_time()
        result = work()
        least_s = min(least_s, time.process_time() - start)
    return least_s, cast("Result", result)


def without_weather() -> Weather:
    """Nothing in the air, nothing on the ground, no sun."""
    return Weather.model_validate(
        {"id": "none", "time": "night", "air": {"mor_m": None}, "sun": {"elevation_deg": -30}}
    )


class Round:
    """What the sensors took in one frame, seconds: Embree alone, one way and the other, and all."""

    def __init__(self, scene: Scene, frame: Frame, air: LidarConditions) -> None:
        self.points = self.rays = 0
        self.single_s = self.packets_s = self.whole_s = 0.0
        bare = Bare(scene.world, frame)
        start = time.process_time()
        scene.caster.place(frame)
        self.whole_s += time.process_time() - start
        for agent in scene.agents:
            rays, order = scene.rays(agent, frame), ring_by_ring(agent.sensors.lidar)
            self.single_s += timed(lambda rays=rays: bare.single(*rays))[0]
            self.packets_s += timed(lambda rays=rays, order=order: bare.packets(*rays, order))[0]
            whole_s, points = timed(lambda agent=agent: scene.look(agent, frame, air))
            self.whole_s += whole_s
            self.rays += len(order)
            self.points += points

    def figures(self) -> tuple[float, ...]:
        """Rates in millions a second, and ratios to Embree alone, as the table has them."""
        return (
            self.points / self.whole_s / 1e6,
            self.rays / self.whole_s / 1e6,
            self.rays / self.single_s / 1e6,
            self.single_s / self.whole_s,
            self.rays / self.packets_s / 1e6,
            self.packets_s / self.whole_s,
        )


class Open3d:
    """Open3D's ray caster, on one thread like all the others."""

    def __init__(self, bare: Bare) -> None:
        open3d: Any = import_module("open3d")
        self._tensor: Any = open3d.core.Tensor
        self._scene: Any = open3d.t.geometry.RaycastingScene(nthreads=1)
        vertices, triangles = bare.mesh
        self._scene.add_triangles(self._tensor(vertices), self._tensor(triangles.astype(np.uint32)))

    def cast(self, origins: Floats, directions: Floats) -> None:
        """Cast rays; the scene is built when it is first asked."""
        self._scene.cast_rays(self._tensor(np.hstack([origins, directions])), nthreads=1)


def figures(*, quick: bool) -> list[Figure]:
    """Everything that LiDARs do, against ray casters that do nothing else."""
    rounds, names = (3, WEATHERS[-1:]) if quick else (9, WEATHERS)
    scene = Scene(read_spec(SPEC))
    frames = [scene.viewpoints.load_frame(FIRST + number) for number in range(rounds + WARM_UP)]
    for frame in frames:
        scene.caster.place(frame)
    found: list[Figure] = []
    for weather in (without_weather(), *(find_weather(name).declaration for name in names)):
        air = derive_lidar_conditions(compute_atmosphere(weather, "urban"), weather.lens)
        done = [Round(scene, frame, air) for frame in frames][WARM_UP:]
        ratio = statistics.median(one.single_s / one.whole_s for one in done)
        found.append(Figure(f"LiDAR, {weather.id}", ratio, "rate of bare Embree", at_least=0.5))
    if find_spec("open3d"):
        ratio = statistics.median(_against_open3d(scene, frame) for frame in frames[WARM_UP:])
        found.append(Figure("LiDAR, none", ratio, "rate of Open3D's caster", at_least=0.5))
    return found


def _against_open3d(scene: Scene, frame: Frame) -> float:
    """Rate of all that is done without weather over that of Open3D's rays alone."""
    peer, weather = Open3d(Bare(scene.world, frame)), without_weather()
    air = derive_lidar_conditions(compute_atmosphere(weather, "urban"), weather.lens)
    bare_s = whole_s = 0.0
    for agent in scene.agents:
        rays = scene.rays(agent, frame)
        peer.cast(*(part[:1] for part in rays))
        bare_s += timed(lambda rays=rays: peer.cast(*rays))[0]
        whole_s += timed(lambda agent=agent: scene.look(agent, frame, air))[0]
    return bare_s / whole_s


def ring_by_ring(lidar: Lidar) -> Rows:
    """Rows of a turn's beams, each channel's side by side."""
    return np.arange(lidar.azimuths * lidar.channels).reshape(-1, lidar.channels).T.ravel()


def table(scene: Scene, rounds: int) -> None:
    """Print one row per weather."""
    weathers = [without_weather(), *(find_weather(name).declaration for name in WEATHERS)]
    frames = [scene.viewpoints.load_frame(FIRST + number) for number in range(rounds + WARM_UP)]
    for frame in frames:
        # Bodies are built when they are first met.
        scene.caster.place(frame)
    print(
        f"{len(scene.agents)} sensors, {len(frames[0].states)} actors, {rounds} frames, medians\n"
    )
    print("| weather | points | M points/s | M rays/s | Embree alone | ratio | packets | ratio |")
    print("|---|---|---|---|---|---|---|---|")
    for weather in weathers:
        air = derive_lidar_conditions(compute_atmosphere(weather, "urban"), weather.lens)
        done = [Round(scene, frame, air) for frame in frames][WARM_UP:]
        cells = np.median([one.figures() for one in done], axis=0)
        points = round(statistics.median(one.points for one in done))
        print(f"| {weather.id} | {points} | {' | '.join(f'{cell:.2f}' for cell in cells)} |")


def memory(scene: Scene, frames: int) -> None:
    """Print how large the process is along the way."""
    weather = find_weather("foggy_heavy_rain_day").declaration
    air = derive_lidar_conditions(compute_atmosphere(weather, "urban"), weather.lens)
    for number in range(frames + 1):
        if number % max(1, frames // 4) == 0:
            resident = psutil.Process().memory_info().rss / 2**20
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
            print(f"after {number} frames: {resident:.0f} MiB, at most {peak:.0f} MiB")
        frame = scene.viewpoints.load_frame(number % scene.frames)
        for agent in scene.agents:
            scene.look(agent, frame, air)


def main() -> None:
    """Read the command line, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("spec", nargs="?", default=SPEC, type=Path)
    parser.add_argument("--rounds", default=7, type=int)
    parser.add_argument("--frames", default=0, type=int)
    chosen = parser.parse_args()
    scene = Scene(Spec.model_validate_json(chosen.spec.read_text()))
    table(scene, chosen.rounds)
    if chosen.frames:
        memory(scene, chosen.frames)


if __name__ == "__main__":
    main()
