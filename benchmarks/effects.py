"""What each effect of weather costs a traced picture: `python benchmarks/effects.py`.

The ego's front camera at a sparse urban intersection with the samples, path depth and denoiser of
the `full` profile, at a twentieth of its width and height, which is what a machine without a
graphics card manages. A picture is traced, and then made of what was traced: drops, lens,
electronics. Each effect stands alone and is measured in turns with the picture without it, in
processor time; most of both is rays, so ratios hold at other sizes as well, but for drops and lens,
whose fixed share is smaller where there are more pixels.
"""

import sys
import time
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from typing import Any

from advercity_dsl import Weather
from advercity_dsl.weather import Lamps
from measurement import Figure, table

from advercity.compiler import read_spec
from advercity.physics.atmosphere import compute_atmosphere
from advercity.pipeline.agent_poses import AgentPoses
from advercity.pipeline.preparation import load_or_build_world, load_or_simulate_traffic
from advercity.pipeline.sensing import build_camera_view
from advercity.randomness import create_generator
from advercity.rendering.backend import RENDER_PROFILES, Renderer, load_backend
from advercity.rendering.light_sources import list_light_sources
from advercity.sensors.camera import CameraConditions, CameraExposure, render_image
from advercity.traffic.weather_effects import apply_lamp_state

SPEC, FRAME, SCALE = Path("compiled/ui_clear_day_sparse.json"), 40, 0.05
Parts = dict[str, Any]
DAY: Parts = {
    "time": "day",
    "air": {"mor_m": None},
    "sun": {"elevation_deg": 60, "azimuth_deg": 180},
    "lens": {"enabled": False},
}
NIGHT: Parts = DAY | {
    "time": "night",
    "sun": {"elevation_deg": -30, "azimuth_deg": 0},
    "lamps": {"low_beam": True},
}
FILM: Parts = {"wetness": 1, "puddle_coverage": 0.35, "film_mm": 0.8}
BY_DAY: dict[str, Parts] = {
    "fog": {"fog": {"mor_m": 75}, "sky": {"oktas": 8}},
    "sun through fog": {"fog": {"mor_m": 300}},
    "wet road": {"surface": FILM},
    "snow cover": {"snow": {"depth_mm": 40}},
    "rain before the camera": {"rain": {"rate_mm_h": 50}},
    "drops and stray light": {"lens": {"coverage": {"front": 0.04}, "stray_light": 0.05}},
    "night with lamps": NIGHT,
}
BY_NIGHT: dict[str, Parts] = {
    "lamps in fog": {"fog": {"mor_m": 75}},
    "wet road under lamps": {"surface": FILM},
}


class Scene:
    """The world, the frame and the camera, whatever the weather."""

    def __init__(self) -> None:
        spec = read_spec(SPEC)
        stage = load_or_simulate_traffic(spec)
        self.viewpoints, self.ego = AgentPoses(spec, stage.trace), spec.agents[0]
        self.frame, self.world = (
            self.viewpoints.load_frame(FRAME),
            load_or_build_world(spec, stage.network_path),
        )
        self.road = spec.road
        self.profile = RENDER_PROFILES["full"].with_scale(SCALE)

    @contextmanager
    def opened(self, parts: Parts) -> Generator["Pictures"]:
        """Ready to take pictures in a weather."""
        weather = Weather.model_validate({"id": "effect"} | parts)
        air = compute_atmosphere(weather, self.road.land_use)
        with load_backend("sapien").open(self.world, air, self.profile) as renderer:
            conditions = CameraConditions.build(air, weather.lens, "bench")
            yield Pictures(self, renderer, conditions, weather.lamps)


class Pictures:
    """Of one scene in one weather."""

    def __init__(
        self, scene: Scene, renderer: Renderer, air: CameraConditions, lamps_on: Lamps
    ) -> None:
        frame, ego = apply_lamp_state(scene.frame, lamps_on), scene.ego
        renderer.place(frame)
        view = build_camera_view(
            ego, scene.viewpoints.world_from_cameras(ego, FRAME)[0], scene.profile
        )
        lamps = tuple(list_light_sources(scene.world, frame)) if air.atmosphere.night else ()
        velocity = scene.viewpoints.velocity(ego, frame)
        self._shot = CameraExposure(view, ego.sensors.camera, frame, velocity, lamps)
        self._renderer, self._air = renderer, air
        self.seconds()

    def seconds(self) -> float:
        """Processor time of a picture."""
        began = time.process_time()
        capture, mount = self._renderer.render_camera(self._shot.view), self._shot.camera.mounts[0]
        render_image(capture, self._shot, self._air, create_generator("bench"), mount=mount)
        return time.process_time() - began


def figures(*, quick: bool) -> list[Figure]:
    """Every effect against the picture without it."""
    scene, rounds = Scene(), 3 if quick else 7
    by_day = [*ratios(scene, DAY, BY_DAY, rounds=rounds)]
    by_night = [*ratios(scene, NIGHT, BY_NIGHT, rounds=rounds)]
    return [
        Figure(f"traced picture, {name}", ratio, against)
        for against, found in (("a clear day", by_day), ("a clear night", by_night))
        for name, ratio in found
    ]


def ratios(
    scene: Scene, without: Parts, effects: dict[str, Parts], *, rounds: int
) -> Iterator[tuple[str, float]]:
    """Median of pictures with each effect over that of pictures without, taken in turns."""
    with scene.opened(without) as plain:
        for name, parts in effects.items():
            with scene.opened(without | parts) as other:
                pairs = [(plain.seconds(), other.seconds()) for _ in range(rounds)]
            before, after = (median(times) for times in zip(*pairs, strict=True))
            print(f"{name}: {after:.2f} s, {before:.2f} s without", file=sys.stderr, flush=True)
            yield name, after / before


if __name__ == "__main__":
    print(table(figures(quick="--quick" in sys.argv)))
