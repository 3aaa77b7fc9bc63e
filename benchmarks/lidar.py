"""How fast the LiDAR is, and how much the weather costs: `python benchmarks/lidar.py [SPEC]`.

All five sensors of one frame of a dense scenario look at the same moment. The bare cast is Embree
alone: the same rays against one scene of the same triangles, built beforehand, its answers thrown
away. It is run next to every measurement, so that ratios hold on a busy machine too. With
`--frames N` it also runs N frames and prints what they leave behind in memory.
"""

import argparse
import resource
import statistics
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from advercity_dsl import Spec, Weather
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from advercity.compiler import find_weather
from advercity.poses import transform
from advercity.randomness import generator
from advercity.rendering.casting import Caster, Rays
from advercity.runner.stage import set_stage, world_of
from advercity.runner.viewpoints import Viewpoints
from advercity.sensors.lidar import LidarAir, air_of, beams, shoot, sweep
from advercity.traffic.trace import Frame
from advercity.weather.derivation import atmosphere_of
from advercity.world.scene import Mesh, World

WEATHERS = ("clear_day", "soft_rain_day", "heavy_rain_day", "fog_day", "foggy_heavy_rain_day")
WARM_UP = 2


class Scene:
    """All sensors of a scenario, ready to look."""

    def __init__(self, spec: Spec) -> None:
        stage = set_stage(spec)
        self.viewpoints = Viewpoints(spec, stage.trace)
        self.world = world_of(spec, stage.network)
        self.caster = Caster(self.world)
        self.frames = len(stage.trace)
        self.agents = spec.agents

    def look(self, frame: Frame, air: LidarAir) -> int:
        """Points of all sensors in a frame."""
        points = 0
        for agent in self.agents:
            lidar = agent.sensors.lidar
            self.caster.place(frame, frozenset({agent.number}))
            pose = self.viewpoints.lidar_pose(agent, frame)
            scan = shoot(lidar, pose, self.caster, puddle_coverage=air.puddle_coverage)
            rng = generator("benchmark", agent.id, frame.index)
            points += len(sweep(lidar, scan, air, rng, states=frame.states).points)
        return points

    def cast(self, frame: Frame) -> None:
        """What `look` does up to the first surfaces, all rays in one go."""
        for agent in self.agents:
            self.caster.place(frame, frozenset({agent.number}))
            shoot(agent.sensors.lidar, self.viewpoints.lidar_pose(agent, frame), self.caster)

    def rays(self, frame: Frame) -> list[Rays]:
        """The rays of every sensor."""
        found: list[Rays] = []
        for agent in self.agents:
            pose = self.viewpoints.lidar_pose(agent, frame)
            directions = (beams(agent.sensors.lidar) @ pose[:3, :3].T).astype(np.float32)
            origins = np.repeat(pose[None, :3, 3].astype(np.float32), len(directions), axis=0)
            found.append(Rays(origins, np.ascontiguousarray(directions)))
        return found


def bare_cast(world: World, frame: Frame, rays: Sequence[Rays]) -> Callable[[], None]:
    """Embree alone on everything that is there in a frame."""
    vertices, triangles, first = [np.empty((0, 3), np.float32)], [np.empty((0, 3), np.int32)], 0

    def add(mesh: Mesh, world_from_mesh: Any) -> None:
        nonlocal first
        vertices.append(transform(world_from_mesh, mesh.vertices).astype(np.float32))
        triangles.append(mesh.triangles + np.int32(first))
        first += len(mesh.vertices)

    for mesh in world.static:
        add(mesh, np.eye(4))
    for state in frame.states:
        for mesh in world.bodies[state.actor.blueprint].parts:
            add(mesh, state.world_from_body)
    scene: Any = EmbreeScene(robust=True)
    TriangleMesh(scene, np.concatenate(vertices), np.concatenate(triangles))

    def run() -> None:
        for one in rays:
            limits = np.full(len(one), 200.0, np.float32)
            scene.run(one.origins, one.directions, limits, output=True)

    return run


def seconds(work: Callable[[], object]) -> float:
    """How long it takes."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def without_weather() -> Weather:
    """Nothing in the air, nothing on the ground, no sun."""
    return Weather.model_validate(
        {"id": "none", "time": "night", "air": {"mor_m": None}, "sun": {"elevation_deg": -30}}
    )


def table(scene: Scene, frame: Frame, rounds: int) -> None:
    """Print one row per weather."""
    rays = scene.rays(frame)
    bare = bare_cast(scene.world, frame, rays)
    count = sum(len(one) for one in rays)
    weathers = [without_weather(), *(find_weather(name).declaration for name in WEATHERS)]
    print(f"{len(rays)} sensors, {count} rays, {len(frame.states)} actors, {rounds} rounds\n")
    print("| weather | points | M points/s | M rays/s | Embree alone | ratio |")
    print("|---|---|---|---|---|---|")
    for weather in weathers:
        air = air_of(weather, atmosphere_of(weather, "urban"))
        alone: list[float] = []
        whole: list[float] = []
        points = scene.look(frame, air)
        for _ in range(rounds + WARM_UP):
            alone.append(seconds(bare))
            whole.append(seconds(lambda air=air: scene.look(frame, air)))
        ratio = statistics.median(
            a / b for a, b in zip(alone[WARM_UP:], whole[WARM_UP:], strict=True)
        )
        bare_s, whole_s = (statistics.median(times[WARM_UP:]) for times in (alone, whole))
        rates = (n / s / 1e6 for n, s in ((points, whole_s), (count, whole_s), (count, bare_s)))
        cells = " | ".join(f"{rate:.2f}" for rate in (*rates, ratio))
        print(f"| {weather.id} | {points} | {cells} |")


def memory(scene: Scene, frames: int) -> None:
    """Print how large the process is along the way."""
    weather = find_weather("foggy_heavy_rain_day").declaration
    air = air_of(weather, atmosphere_of(weather, "urban"))
    for number in range(frames + 1):
        if number % max(1, frames // 4) == 0:
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
            print(f"after {number} frames: peak {peak:.0f} MiB")
        scene.look(scene.viewpoints.frame(number % scene.frames), air)


def main() -> None:
    """Read the command line, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("spec", nargs="?", default="compiled/ui_clear_day_dense.json", type=Path)
    parser.add_argument("--rounds", default=7, type=int)
    parser.add_argument("--frames", default=0, type=int)
    chosen = parser.parse_args()
    scene = Scene(Spec.model_validate_json(chosen.spec.read_text()))
    table(scene, scene.viewpoints.frame(50), chosen.rounds)
    if chosen.frames:
        memory(scene, chosen.frames)


if __name__ == "__main__":
    main()
