"""How fast the LiDAR is, and how much the weather costs: `python benchmarks/lidar.py [SPEC]`.

All five sensors of a dense scenario look, frame after frame, on one core. The bare cast is Embree
alone: the same rays against one scene of the same triangles, built beforehand, for which triangle
each ray meets and how far away; its answers are thrown away. It is run next to every
measurement and both are measured in processor time, so that ratios hold on a busy machine too.
Roadside units stand still, which spares them most of the cast; the last column is of the vehicles'
sensors alone. With `--frames N` it also runs N frames and prints what they leave behind in memory.
"""

import argparse
import resource
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from advercity_dsl import Agent, RoadsideUnit, Spec, Weather
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from advercity.compiler import find_weather
from advercity.poses import transform
from advercity.randomness import generator
from advercity.rendering.casting import Caster
from advercity.runner.stage import set_stage, world_of
from advercity.runner.viewpoints import Viewpoints
from advercity.sensors.lidar import LidarAir, air_of, beams, shoot, sweep
from advercity.traffic.trace import Frame
from advercity.weather.derivation import atmosphere_of
from advercity.world.scene import Mesh, World

Result = TypeVar("Result")
Floats = NDArray[np.floating[Any]]

WEATHERS = ("clear_day", "soft_rain_day", "heavy_rain_day", "fog_day", "foggy_heavy_rain_day")
WARM_UP = 2
FIRST = 50
"""Frame to begin with."""


class Scene:
    """All sensors of a scenario, ready to look."""

    def __init__(self, spec: Spec) -> None:
        stage = set_stage(spec)
        self.viewpoints = Viewpoints(spec, stage.trace)
        self.world = world_of(spec, stage.network)
        self.caster = Caster(self.world)
        self.frames = len(stage.trace)
        self.agents = spec.agents

    def look(self, agent: Agent, frame: Frame, air: LidarAir) -> int:
        """Points of a sensor in a frame."""
        lidar = agent.sensors.lidar
        roadside = isinstance(agent.place, RoadsideUnit)
        self.caster.place(frame, frozenset() if roadside else frozenset({agent.number}))
        pose = self.viewpoints.lidar_pose(agent, frame)
        scan = shoot(lidar, pose, self.caster, puddle_coverage=air.puddle_coverage)
        rng = generator("benchmark", agent.id, frame.index)
        return len(sweep(lidar, scan, air, rng, states=frame.states).points)

    def rays(self, agent: Agent, frame: Frame) -> tuple[Floats, Floats]:
        """Origins and directions of a sensor's rays."""
        pose = self.viewpoints.lidar_pose(agent, frame)
        directions = (beams(agent.sensors.lidar) @ pose[:3, :3].T).astype(np.float32)
        origins = np.repeat(pose[None, :3, 3].astype(np.float32), len(directions), axis=0)
        return origins, np.ascontiguousarray(directions)


def everything(world: World, frame: Frame) -> Any:
    """Embree's scene of all that is there in a frame."""
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
    return scene


def bare_cast(scene: Any, origins: Floats, directions: Floats) -> None:
    """Embree alone; it commits its scene when it is first asked."""
    scene.run(origins, directions, np.full(len(origins), 200.0, np.float32), output=True)


def timed(work: Callable[[], Result]) -> tuple[float, Result]:
    """Seconds of processor time that it takes, and what comes of it."""
    start = time.process_time()
    result = work()
    return time.process_time() - start, result


def without_weather() -> Weather:
    """Nothing in the air, nothing on the ground, no sun."""
    return Weather.model_validate(
        {"id": "none", "time": "night", "air": {"mor_m": None}, "sun": {"elevation_deg": -30}}
    )


class Round:
    """What each sensor took in one frame, seconds: Embree alone and everything."""

    def __init__(self, scene: Scene, frame: Frame, air: LidarAir) -> None:
        self.points = self.rays = 0
        self.bare: list[float] = []
        self.whole: list[float] = []
        everyone = everything(scene.world, frame)
        for agent in scene.agents:
            rays = scene.rays(agent, frame)
            bare_cast(everyone, *(part[:1] for part in rays))
            bare_s, _ = timed(lambda rays=rays: bare_cast(everyone, *rays))
            whole_s, points = timed(lambda agent=agent: scene.look(agent, frame, air))
            self.bare.append(bare_s)
            self.whole.append(whole_s)
            self.rays += len(rays[0])
            self.points += points

    def ratio(self, agents: slice) -> float:
        """Rate of everything over that of Embree alone."""
        return sum(self.bare[agents]) / sum(self.whole[agents])


def table(scene: Scene, rounds: int) -> None:
    """Print one row per weather."""
    weathers = [without_weather(), *(find_weather(name).declaration for name in WEATHERS)]
    vehicles = slice(sum(not isinstance(agent.place, RoadsideUnit) for agent in scene.agents))
    actors = len(scene.viewpoints.frame(FIRST).states)
    print(f"{len(scene.agents)} sensors, {actors} actors, {rounds} frames, medians\n")
    print("| weather | points | M points/s | M rays/s | Embree alone | ratio | vehicles' ratio |")
    print("|---|---|---|---|---|---|---|")
    for weather in weathers:
        air = air_of(weather, atmosphere_of(weather, "urban"))
        frames = map(scene.viewpoints.frame, range(FIRST, FIRST + rounds + WARM_UP))
        done = [Round(scene, frame, air) for frame in frames][WARM_UP:]
        cells = [
            statistics.median(one.points / sum(one.whole) / 1e6 for one in done),
            statistics.median(one.rays / sum(one.whole) / 1e6 for one in done),
            statistics.median(one.rays / sum(one.bare) / 1e6 for one in done),
            statistics.median(one.ratio(slice(None)) for one in done),
            statistics.median(one.ratio(vehicles) for one in done),
        ]
        points = round(statistics.median(one.points for one in done))
        print(f"| {weather.id} | {points} | {' | '.join(f'{cell:.2f}' for cell in cells)} |")


def memory(scene: Scene, frames: int) -> None:
    """Print how large the process is along the way."""
    weather = find_weather("foggy_heavy_rain_day").declaration
    air = air_of(weather, atmosphere_of(weather, "urban"))
    for number in range(frames + 1):
        if number % max(1, frames // 4) == 0:
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
            print(f"after {number} frames: peak {peak:.0f} MiB")
        frame = scene.viewpoints.frame(number % scene.frames)
        for agent in scene.agents:
            scene.look(agent, frame, air)


def main() -> None:
    """Read the command line, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("spec", nargs="?", default="compiled/ui_clear_day_dense.json", type=Path)
    parser.add_argument("--rounds", default=7, type=int)
    parser.add_argument("--frames", default=0, type=int)
    chosen = parser.parse_args()
    scene = Scene(Spec.model_validate_json(chosen.spec.read_text()))
    table(scene, chosen.rounds)
    if chosen.frames:
        memory(scene, chosen.frames)


if __name__ == "__main__":
    main()
