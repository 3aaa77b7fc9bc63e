"""What weather costs a camera: `python benchmarks/camera.py [--rounds N] [WEATHER ...]`.

A preview camera of 480x270 pixels in the ego of a dense urban intersection, against SAPIEN's own
raster pack on the same scene: the same bodies, the same shadow map. Ours is rendered, and then the
picture is made of it: rain before the lens, lens, electronics. All are taken in turn, so that
ratios hold on a busy machine too. What an effect costs is the difference between two weathers.
"""

import argparse
import math
import statistics
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import sapien
from advercity_dsl import Spec
from advercity_sapien.culling import SunShadow
from advercity_sapien.sapien_scene import SapienScene
from advercity_sapien.shader_constants import FAR_M, NEAR_M
from advercity_sapien.shader_table import ShaderTable
from measurement import Figure

from advercity.compiler import find_weather, read_spec, with_weather
from advercity.frames import Frame
from advercity.physics.atmosphere import Atmosphere, compute_atmosphere
from advercity.pipeline.agent_poses import AgentPoses
from advercity.pipeline.preparation import load_or_build_world, load_or_simulate_traffic
from advercity.randomness import create_generator
from advercity.rendering.backend import CameraView, RenderProfile, load_backend
from advercity.rendering.light_sources import list_light_sources
from advercity.sensors.camera import CameraConditions, CameraExposure, render_image
from advercity.world import World

SPEC = Path("compiled/ui_clear_day_dense.json")
STOCK = Path(sapien.__file__).parent / "vulkan_shader"
SIZE, FRAME, WARM_UP = (480, 270), 40, 2
GOAL = 1.5
QUICK = ["fog_day", "heavy_rain_night"]
WEATHERS = [
    *("clear_day", "soft_rain_day", "heavy_rain_day", "fog_day", "foggy_heavy_rain_day"),
    *("clear_night", "soft_rain_night", "heavy_rain_night", "fog_night"),
    *("foggy_heavy_rain_night", "glare_day"),
]


class NoBindings:
    """SAPIEN's pack knows neither air nor lamps."""

    def attach_to_camera(self, camera: sapien.render.RenderCameraComponent) -> None:
        """Nothing to see."""

    def set_lit_lamps(self, body: sapien.render.RenderBodyComponent, lamp_bits: int) -> None:
        """Do nothing."""

    def set_hidden(self, body: sapien.render.RenderBodyComponent, *, hidden: bool) -> None:
        """Do nothing."""

    def upload_table(self, table: ShaderTable) -> None:
        """Do nothing."""


def stock_pictures(
    world: World,
    air: Atmosphere,
    frame: Frame,
    views: Sequence[CameraView],
    pack: str = "default",
) -> Callable[[], None]:
    """Takes pictures of one size with a pack of SAPIEN's own, and fetches all that ours have."""
    scene = sapien.Scene([sapien.render.RenderSystem(sapien.Device("cpu"))])
    stage, sun = SapienScene(world, scene, NoBindings(), night=air.night), SunShadow(air, scene)
    stage.place_actors(frame)
    width, height = views[0].width_px, views[0].height_px
    camera = sapien.render.RenderCameraComponent(width, height, str(STOCK / pack))
    entity = sapien.Entity()
    entity.add_component(camera)
    scene.add_entity(entity)

    def take() -> None:
        for view in views:
            focal = width / 2.0 / math.tan(view.horizontal_fov_rad / 2.0)
            camera.set_perspective_parameters(
                NEAR_M, FAR_M, focal, focal, width / 2, height / 2, 0.0
            )
            entity.set_pose(sapien.Pose(view.world_from_camera))
            sun.update(view)
            scene.update_render()
            camera.take_picture()
            for name in ("Color", "Position", "Segmentation", "Normal"):
                camera.get_picture(name)

    return take


def figures(*, quick: bool) -> list[Figure]:
    """A picture by day and by night, or in every weather."""
    rounds, weathers = (3, QUICK) if quick else (9, WEATHERS)
    spec = read_spec(SPEC)
    found: list[Figure] = []
    for weather in weathers:
        stock, rendered, made = measure(spec, weather, rounds)
        ratio = (rendered + made) / stock
        found.append(Figure(f"picture, {weather}", ratio, "SAPIEN's `default` pack", at_most=GOAL))
    return found


def measure(spec: Spec, weather: str, rounds: int) -> tuple[float, float, float]:
    """Median seconds of SAPIEN's picture, of our rendering, and of making the picture of it."""
    authored = with_weather(spec, find_weather(weather)).weather
    stage = load_or_simulate_traffic(spec)
    viewpoints = AgentPoses(spec, stage.trace)
    frame, world = viewpoints.load_frame(FRAME), load_or_build_world(spec, stage.network_path)
    air, ego = compute_atmosphere(authored, spec.road.land_use), spec.agents[0]
    view = CameraView(
        viewpoints.world_from_cameras(ego, FRAME)[0],
        *SIZE,
        math.radians(ego.sensors.camera.horizontal_fov_deg),
        hide=frozenset({ego.number}),
    )
    stock = stock_pictures(world, air, frame, [view])
    lamps = tuple(list_light_sources(world, frame)) if air.night else ()
    shot = CameraExposure(view, ego.sensors.camera, frame, viewpoints.velocity(ego, frame), lamps)
    camera_air = CameraConditions.build(air, authored.lens, "bench")
    with load_backend("sapien").open(world, air, RenderProfile("bench", 1.0, "raster")) as renderer:
        renderer.place(frame)

        def develop() -> None:
            mount = shot.camera.mounts[0]
            render_image(capture, shot, camera_air, create_generator("bench"), mount=mount)

        capture = renderer.render_camera(view)
        steps = (stock, lambda: renderer.render_camera(view), develop)
        times: tuple[list[float], ...] = ([], [], [])
        for _ in range(rounds + WARM_UP):
            for taken, step in zip(times, steps, strict=True):
                start = time.perf_counter()
                step()
                taken.append(time.perf_counter() - start)
    stock_s, rendered_s, developed_s = (statistics.median(taken[WARM_UP:]) for taken in times)
    return stock_s, rendered_s, developed_s


def main() -> None:
    """Print a row for every weather."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("weathers", nargs="*", default=WEATHERS)
    parser.add_argument("--rounds", type=int, default=9)
    options = parser.parse_args()
    spec = read_spec(SPEC)
    print("| weather | SAPIEN's, ms | rendered | made | ratio of both |\n|---|---|---|---|---|")
    for weather in options.weathers:
        stock, *own = measure(spec, weather, options.rounds)
        cells = [f"{item * 1e3:.0f}" for item in (stock, *own)]
        print(f"| {' | '.join([weather, *cells, f'{sum(own) / stock:.2f}'])} |", flush=True)


if __name__ == "__main__":
    main()
