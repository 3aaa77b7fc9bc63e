"""What weather costs a camera: `benchmarks/camera.py [--rounds N] [--width PX] [WEATHER ...]`.

A preview camera, of 480x270 pixels by default, in the ego of a dense urban intersection, against
SAPIEN's own raster pack on the same scene: the same bodies, the same shadow map. Ours is rendered
and then processed: rain before the lens, lens, electronics. All are measured in turns, in processor
time, so that ratios hold on a busy machine too. The cost of an effect is the difference between two
weathers.
"""

import argparse
import math
import statistics
from pathlib import Path

from advercity_dsl import Shutter
from benchmark_scene import BenchmarkScene
from measurement import Measurement, measure_run_time
from stock_renderer import StockRenderer

from advercity.compiler import find_weather, with_weather
from advercity.physics.atmosphere import compute_atmosphere
from advercity.randomness import create_generator
from advercity.rendering.backend import CameraView, RenderProfile, load_backend
from advercity.rendering.light_sources import list_light_sources
from advercity.sensors.camera import CameraConditions, CameraExposure, render_image
from advercity.sensors.camera.driver import build_camera_view
from advercity.sensors.camera.moments import list_moments

SPEC = Path("compiled/ui_clear_day_dense.json")
WIDTH_PX, FRAME, WARM_UP = 480, 40, 2
GOAL = 1.5
QUICK_WEATHERS = ["fog_day", "heavy_rain_night"]
WEATHERS = [
    *("clear_day", "soft_rain_day", "heavy_rain_day", "fog_day", "foggy_heavy_rain_day"),
    *("clear_night", "soft_rain_night", "heavy_rain_night", "fog_night"),
    *("foggy_heavy_rain_night", "glare_day"),
]


def run_benchmark(*, quick: bool) -> list[Measurement]:
    """Measure an image by day and by night, or in every weather."""
    rounds, weathers = (3, QUICK_WEATHERS) if quick else (9, WEATHERS)
    scene = BenchmarkScene(SPEC, FRAME)
    found: list[Measurement] = []
    for weather in weathers:
        stock_s, rendered_s, processed_s = measure_image(scene, weather, rounds)
        ratio = (rendered_s + processed_s) / stock_s
        found.append(
            Measurement(f"image, {weather}", ratio, "SAPIEN's `default` pack", at_most=GOAL)
        )
    band_s, image_s = measure_bands(scene, rounds)
    found.append(Measurement("band of a rolling shutter", band_s / image_s, "an image"))
    return found


def measure_bands(scene: BenchmarkScene, rounds: int) -> tuple[float, float]:
    """Measure median seconds of processor time of a band of a rolling shutter, and of an image."""
    ego, profile = scene.ego, RenderProfile("bench", WIDTH_PX / 1920, "raster")
    camera = ego.sensors.cameras[0].model.model_copy(
        update={"shutter": Shutter(readout_ms=30, bands=4)}
    )
    times_s = [moment.instant.time_s for moment in list_moments(camera, shutter_s=0.005)]
    views: dict[float, CameraView] = {}
    for time_s in times_s:
        pose = scene.poses.world_from_sensors("camera", ego, scene.frame, time_s=time_s)[0]
        views[time_s] = build_camera_view(ego, 0, pose, profile)
    with load_backend("sapien").open(scene.world, scene.air, profile) as renderer:

        def render_bands() -> None:
            for time_s, view in views.items():
                renderer.place(scene.frame.advance(time_s))
                renderer.render_camera(view)

        still = scene.list_views(ego, profile)[0]
        steps = (render_bands, lambda: renderer.render_camera(still))
        rows = [[measure_run_time(step).cpu_s for step in steps] for _ in range(WARM_UP + rounds)]
    bands_s, image_s = map(statistics.median, zip(*rows[WARM_UP:], strict=True))
    return bands_s / len(times_s), image_s


def measure_image(
    scene: BenchmarkScene, weather: str, rounds: int, width_px: int = WIDTH_PX
) -> tuple[float, float, float]:
    """Measure median processor time of SAPIEN's image, of our rendering, and of processing it."""
    authored = with_weather(scene.spec, find_weather(weather)).weather
    air, ego = compute_atmosphere(authored, scene.spec.road.land_use), scene.ego
    camera = ego.sensors.cameras[0].model
    view = CameraView(
        scene.poses.world_from_sensors("camera", ego, scene.frame)[0],
        width_px,
        width_px * 9 // 16,
        math.radians(camera.horizontal_fov_deg),
        hide=frozenset({ego.number}),
    )
    lamps = tuple(list_light_sources(scene.world, scene.frame)) if air.night else ()
    velocity = scene.poses.velocity(ego, scene.frame)
    exposure = CameraExposure(view, camera, scene.frame, velocity, lamps)
    conditions = CameraConditions.build(air, authored.lens, "bench")
    with (
        StockRenderer(SPEC, FRAME, [view], weather) as stock,
        load_backend("sapien").open(
            scene.world, air, RenderProfile("bench", 1.0, "raster")
        ) as renderer,
    ):
        renderer.place(scene.frame)
        capture = renderer.render_camera(view)

        def process() -> None:
            rng = create_generator("bench")
            render_image(capture, exposure, conditions, rng, mount=camera.mounts[0])

        steps = (lambda: renderer.render_camera(view), process)
        rows = [
            [stock.measure().cpu_s, *(measure_run_time(step).cpu_s for step in steps)]
            for _ in range(WARM_UP + rounds)
        ]
    stock_s, rendered_s, processed_s = map(statistics.median, zip(*rows[WARM_UP:], strict=True))
    return stock_s, rendered_s, processed_s


def main() -> None:
    """Print a row for every weather."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("weathers", nargs="*", default=WEATHERS)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--width", type=int, default=WIDTH_PX)
    options = parser.parse_args()
    scene = BenchmarkScene(SPEC, FRAME)
    print("| weather | SAPIEN's, ms | rendered | processed | ratio |\n|---|---|---|---|---|")
    for weather in options.weathers:
        stock_s, *own_s = measure_image(scene, weather, options.rounds, options.width)
        cells = [f"{item * 1e3:.0f}" for item in (stock_s, *own_s)]
        print(f"| {' | '.join([weather, *cells, f'{sum(own_s) / stock_s:.2f}'])} |", flush=True)


if __name__ == "__main__":
    main()
