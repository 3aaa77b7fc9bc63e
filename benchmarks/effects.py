"""What each effect of weather costs a traced image: `python benchmarks/effects.py`.

The ego's front camera at a sparse urban intersection with the samples, path depth and denoiser of
the `full` profile, at a twentieth of its width and height: as much as a machine without a graphics
card manages. An image is traced, and then processed: drops, lens, electronics. Each effect is alone
and measured in turns with the image without it, in processor time; most of both is rays, so ratios
hold at other sizes as well, except for drops and lens, whose fixed part is smaller where there are
more pixels.
"""

import sys
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from typing import Any

from advercity_dsl import Weather
from benchmark_scene import BenchmarkScene
from measurement import Measurement, format_table, measure_run_time

from advercity.physics.atmosphere import compute_atmosphere
from advercity.randomness import create_generator
from advercity.rendering.backend import RENDER_PROFILES, load_backend
from advercity.rendering.light_sources import list_light_sources
from advercity.sensors.camera import CameraConditions, CameraExposure, render_image
from advercity.traffic.weather_effects import apply_lamp_state

SPEC, FRAME, SCALE = Path("compiled/ui_clear_day_sparse.json"), 40, 0.05
PROFILE = RENDER_PROFILES["full"].with_scale(SCALE)
WeatherParts = dict[str, Any]
DAY: WeatherParts = {
    "time": "day",
    "air": {"mor_m": None},
    "sun": {"elevation_deg": 60, "azimuth_deg": 180},
    "lens": {"enabled": False},
}
NIGHT: WeatherParts = DAY | {
    "time": "night",
    "sun": {"elevation_deg": -30, "azimuth_deg": 0},
    "lamps": {"low_beam": True},
}
FILM: WeatherParts = {"wetness": 1, "puddle_coverage": 0.35, "film_mm": 0.8}
DAY_EFFECTS: dict[str, WeatherParts] = {
    "fog": {"fog": {"mor_m": 75}, "sky": {"oktas": 8}},
    "sun through fog": {"fog": {"mor_m": 300}},
    "wet road": {"surface": FILM},
    "snow cover": {"snow": {"depth_mm": 40}},
    "rain before the camera": {"rain": {"rate_mm_h": 50}},
    "drops and stray light": {"lens": {"coverage": {"front": 0.04}, "stray_light": 0.05}},
    "night with lamps": NIGHT,
}
NIGHT_EFFECTS: dict[str, WeatherParts] = {
    "lamps in fog": {"fog": {"mor_m": 75}},
    "wet road under lamps": {"surface": FILM},
}


def run_benchmark(*, quick: bool) -> list[Measurement]:
    """Measure every effect against the image without it."""
    scene, rounds = BenchmarkScene(SPEC, FRAME), 3 if quick else 7
    return [
        Measurement(f"traced image, {name}", ratio, baseline)
        for baseline, without, effects in (
            ("a clear day", DAY, DAY_EFFECTS),
            ("a clear night", NIGHT, NIGHT_EFFECTS),
        )
        for name, ratio in measure_ratios(scene, without, effects, rounds=rounds)
    ]


def measure_ratios(
    scene: BenchmarkScene,
    without: WeatherParts,
    effects: dict[str, WeatherParts],
    *,
    rounds: int,
) -> Iterator[tuple[str, float]]:
    """Measure images with each effect relative to images without, taken in turns."""
    with _open_weather(scene, without) as plain_s:
        for name, parts in effects.items():
            with _open_weather(scene, without | parts) as effect_s:
                pairs = [(plain_s(), effect_s()) for _ in range(rounds)]
            before, after = (median(times) for times in zip(*pairs, strict=True))
            print(f"{name}: {after:.2f} s, {before:.2f} s without", file=sys.stderr, flush=True)
            yield name, after / before


@contextmanager
def _open_weather(
    scene: BenchmarkScene, parts: WeatherParts
) -> Generator[Callable[[], float], None, None]:
    """Open the scene in a weather: a function that measures the processor time of an image."""
    weather = Weather.model_validate({"id": "effect"} | parts)
    air = compute_atmosphere(weather, scene.spec.road.land_use)
    conditions = CameraConditions.build(air, weather.lens, "bench")
    frame, ego = apply_lamp_state(scene.frame, weather.lamps), scene.ego
    view = scene.list_views(ego, PROFILE)[0]
    lamps = tuple(list_light_sources(scene.world, frame)) if air.night else ()
    camera, velocity = ego.sensors.camera, scene.poses.velocity(ego, frame)
    exposure = CameraExposure(view, camera, frame, velocity, lamps)
    with load_backend("sapien").open(scene.world, air, PROFILE) as renderer:
        renderer.place(frame)

        def take_image() -> None:
            capture, rng = renderer.render_camera(view), create_generator("bench")
            render_image(capture, exposure, conditions, rng, mount=camera.mounts[0])

        # The first image builds the shaders.
        take_image()
        yield lambda: measure_run_time(take_image).cpu_s


if __name__ == "__main__":
    print(format_table(run_benchmark(quick="--quick" in sys.argv)))
