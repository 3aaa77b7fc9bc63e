"""What effects of weather and options of cameras cost: `python benchmarks/effects.py`.

The ego's front camera at a sparse urban intersection with the samples, path depth and denoiser of
the `full` profile, at a twentieth of its width and height: as much as a machine without a graphics
card manages. An image is traced, and then processed: drops, lens, electronics. Each effect is alone
and measured in turns with the image without it, in processor time; most of both is rays, so ratios
hold at other sizes as well, except for drops and lens, whose fixed part is smaller where there are
more pixels.

What a rig may ask of a camera besides costs no rays: it is measured against the processing of a
whole image alone. A thermal image of 640 x 512 pixels is measured in seconds of one core.
"""

import sys
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from typing import Any

from advercity_dsl import Camera, Isp, Mount, PointSpread, RawOutput, ThermalCamera, Weather
from benchmark_scene import BenchmarkScene
from measurement import Measurement, format_table, measure_run_time

from advercity.geometry.poses import pose_matrix
from advercity.physics.atmosphere import compute_atmosphere
from advercity.randomness import create_generator
from advercity.rendering.backend import RENDER_PROFILES, load_backend
from advercity.rendering.light_sources import list_light_sources
from advercity.rendering.raycaster import Raycaster
from advercity.sensors.camera import CameraConditions, CameraExposure, render_image
from advercity.sensors.thermal import (
    ThermalConditions,
    cast_thermal,
    derive_thermal_conditions,
    take_thermal_image,
)
from advercity.sensors.thermal.driver import build_thermal_model
from advercity.testing import make_capture
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


CAMERA_OPTIONS: dict[str, dict[str, Any]] = {
    "linear image": {"hdr": True},
    "raw image": {"raw": RawOutput()},
    "image signal processor": {"isp": Isp(jpeg_quality=90)},
    "point spread": {"point_spread": PointSpread(centre_mrad=0.4, corner_mrad=1.5)},
}
THERMAL = ThermalCamera(mounts=(Mount(x_m=2.0, z_m=1.0),))


def run_benchmark(*, quick: bool) -> list[Measurement]:
    """Measure every effect against the image without it."""
    scene, rounds = BenchmarkScene(SPEC, FRAME), 3 if quick else 7
    options = [
        Measurement(f"processed image, {name}", ratio, "without it")
        for name, ratio in measure_options(scene, rounds=rounds)
    ]
    thermals = [
        Measurement(f"thermal image, {name}", seconds, "s of a core")
        for name, seconds in measure_thermal_images(scene, rounds=rounds)
    ]
    return (
        options
        + thermals
        + [
            Measurement(f"traced image, {name}", ratio, baseline)
            for baseline, without, effects in (
                ("a clear day", DAY, DAY_EFFECTS),
                ("a clear night", NIGHT, NIGHT_EFFECTS),
            )
            for name, ratio in measure_ratios(scene, without, effects, rounds=rounds)
        ]
    )


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


def measure_options(scene: BenchmarkScene, *, rounds: int) -> Iterator[tuple[str, float]]:
    """Measure the processing of whole images with each option relative to that without."""
    weather = Weather.model_validate({"id": "effect"} | DAY)
    air = compute_atmosphere(weather, scene.spec.road.land_use)
    conditions = CameraConditions.build(air, weather.lens, "bench")
    camera = scene.ego.sensors.cameras[0].model
    view = scene.list_views(scene.ego, PROFILE.with_scale(1.0))[0]
    capture = make_capture(view.width_px, view.height_px)
    velocity = scene.poses.velocity(scene.ego, scene.frame)

    def process_s(kind: Camera) -> float:
        exposure = CameraExposure(view, kind, scene.frame, velocity, ())
        rng, mount = create_generator("bench"), camera.mounts[0]
        return measure_run_time(
            lambda: render_image(capture, exposure, conditions, rng, mount=mount)
        ).cpu_s

    for name, changes in CAMERA_OPTIONS.items():
        with_option = camera.model_copy(update=changes)
        pairs = [(process_s(camera), process_s(with_option)) for _ in range(rounds)]
        before, after = (median(times) for times in zip(*pairs, strict=True))
        print(f"{name}: {after:.2f} s, {before:.2f} s without", file=sys.stderr, flush=True)
        yield name, after / before


def measure_thermal_images(scene: BenchmarkScene, *, rounds: int) -> Iterator[tuple[str, float]]:
    """Measure thermal images of the scene by day, when shadows are cast, and by night."""
    raycaster, model = Raycaster(scene.world), build_thermal_model(THERMAL, 1.0)
    mount = pose_matrix((THERMAL.mounts[0].x_m, 0.0, THERMAL.mounts[0].z_m))
    pose = scene.poses.world_from_agent(scene.ego, scene.frame.index) @ mount
    hide = frozenset({scene.ego.number})
    for name, parts in (("day", DAY), ("night", NIGHT)):
        weather = Weather.model_validate({"id": "effect"} | parts)
        air = compute_atmosphere(weather, scene.spec.road.land_use)
        conditions = derive_thermal_conditions(air, weather)

        def take_image(conditions: ThermalConditions = conditions) -> None:
            view = cast_thermal(model, pose, scene.frame, raycaster, conditions, hide=hide)
            rng, states = create_generator("bench"), scene.frame.states
            take_thermal_image(THERMAL, view, conditions, states, rng, seed=1, name="bench")

        take_image()
        yield name, median(measure_run_time(take_image).cpu_s for _ in range(rounds))


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
    camera, velocity = ego.sensors.cameras[0].model, scene.poses.velocity(ego, frame)
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
