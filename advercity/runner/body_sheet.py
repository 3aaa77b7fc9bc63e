"""Contact sheets of bodies: each blueprint from four sides, by day and by night with its lamps."""

from collections.abc import Iterator, Mapping
from pathlib import Path

import cv2
import numpy as np
from advercity_dsl import Blueprint, Camera, Mount
from numpy.typing import NDArray

from advercity import poses
from advercity.compiler.shipped import find_weather
from advercity.poses import Matrix
from advercity.rendering.backend import PROFILES, Backend, CameraView, Renderer
from advercity.semantics import Semantic
from advercity.sensors.camera import expose, meter
from advercity.sensors.camera.stray_light import scattered
from advercity.traffic.lamps import lit
from advercity.traffic.trace import Actor, ActorState, Frame, Lamp
from advercity.weather.derivation import atmosphere_of
from advercity.world.assets import Shelf
from advercity.world.bodies import CONNECTED_PAINT, body
from advercity.world.scene import Mesh, StreetLamp, World

VIEWS = (("three quarters", 0.6), ("side", np.pi / 2), ("rear", np.pi), ("front", 0.0))
"""Where the camera stands around the body, in radians to the left of its front."""
WEATHERS = ("clear_day", "clear_night")
CELL_PX = (320, 200)
BAR_PX = 20
FIELD_OF_VIEW_RAD = np.radians(30.0)
OBLIQUE, LEVEL = 0.18, 0.08
"""Height of the camera over the middle of the body, as a share of its distance."""
STREET_LAMPS = tuple(StreetLamp((x, y, 8.0)) for x in (-9.0, 9.0) for y in (-7.0, 7.0))
COATS = "cloth_red"
STEERING_RAD = np.radians(20.0)
BLINKS_AT_ONCE = 2
"""An actor whose indicators are lit at the beginning."""
CLEAN_LENS = 0.02
"""Share of the light that it scatters."""
ALL_LAMPS = Lamp.BRAKE | Lamp.LEFT | Lamp.RIGHT

Image = NDArray[np.uint8]


def body_sheet(blueprints: Mapping[str, Blueprint], backend: Backend, shelf: Shelf) -> Image:
    """A picture (h, w, 3), BGR: a row for each blueprint, four views by day and four by night."""
    world = World(
        id="sheet",
        static=(_ground(),),
        bodies={name: body(name, blueprint, shelf) for name, blueprint in blueprints.items()},
        lanes=(),
        street_lamps=STREET_LAMPS,
        network=Path(),
    )
    halves = [list(_pictures(world, blueprints, backend, weather)) for weather in WEATHERS]
    rows = [
        np.vstack([_label(name, blueprint, shelf, 8 * CELL_PX[0]), np.hstack([*day, *night])])
        for (name, blueprint), day, night in zip(blueprints.items(), *halves, strict=True)
    ]
    return np.vstack(rows)


def _pictures(
    world: World, blueprints: Mapping[str, Blueprint], backend: Backend, weather_id: str
) -> Iterator[list[Image]]:
    """Four views of each blueprint under a weather."""
    weather = find_weather(weather_id).declaration
    atmosphere = atmosphere_of(weather, "rural")
    with backend.open(world, atmosphere, PROFILES["preview"]) as renderer:
        for name, blueprint in blueprints.items():
            frame = lit(_frame(name, blueprint), weather.lamps)
            renderer.place(frame)
            yield [_picture(renderer, blueprint, azimuth) for _, azimuth in VIEWS]


def _frame(name: str, blueprint: Blueprint) -> Frame:
    paint = COATS if blueprint.actor_class == "pedestrian" else CONNECTED_PAINT
    size = (blueprint.length_m, blueprint.width_m, blueprint.height_m)
    lamps = Lamp(0) if blueprint.actor_class == "pedestrian" else ALL_LAMPS
    actor = Actor(BLINKS_AT_ONCE, blueprint.actor_class, name, paint, size)
    state = ActorState(actor, np.eye(4), 0.0, 0.0, lamps, steering_rad=STEERING_RAD)
    return Frame(index=0, time_s=0.0, states=(state,), signals={})


def _picture(renderer: Renderer, blueprint: Blueprint, azimuth: float) -> Image:
    width, height = CELL_PX
    view = CameraView(_standing(blueprint, azimuth), width, height, FIELD_OF_VIEW_RAD)
    camera = Camera(mounts=(Mount(),), noise=False)
    light = scattered(
        renderer.camera(view).radiance,
        horizontal_fov_rad=view.horizontal_fov_rad,
        share=CLEAN_LENS,
    )
    setting = meter(light, camera.exposure)
    picture = expose(light, camera, setting, np.random.default_rng(0))
    return picture[..., ::-1]


def _standing(blueprint: Blueprint, azimuth: float) -> Matrix:
    """Where the camera stands: so far that the body fills the picture, a little above it."""
    reach = max(blueprint.length_m, 1.6 * blueprint.height_m, blueprint.width_m)
    away = 0.62 * reach / np.tan(FIELD_OF_VIEW_RAD / 2) + blueprint.width_m / 2
    raised = OBLIQUE if azimuth == VIEWS[0][1] else LEVEL
    place = away * np.array([np.cos(azimuth), np.sin(azimuth), raised])
    place[2] += blueprint.height_m / 2
    return poses.pose(place, yaw=azimuth + np.pi, pitch=float(np.arctan(raised)))


def _ground() -> Mesh:
    corners = [(-200.0, -200.0, 0.0), (200.0, -200.0, 0.0), (200.0, 200.0, 0.0), (-200.0, 200.0, 0)]
    return Mesh(
        name="ground",
        vertices=np.array(corners, dtype=np.float32),
        triangles=np.array([(0, 1, 2), (0, 2, 3)], dtype=np.int32),
        material="asphalt",
        semantic=Semantic.ROAD,
    )


def _label(name: str, blueprint: Blueprint, shelf: Shelf, width: int) -> Image:
    bar = np.full((BAR_PX, width, 3), 32, np.uint8)
    where = "shaped here" if shelf.find(blueprint) is None else _terms(blueprint)
    size = f"{blueprint.length_m:.2f} x {blueprint.width_m:.2f} x {blueprint.height_m:.2f} m"
    text = f"{name}: {blueprint.actor_class}, {size}, {where}"
    cv2.putText(
        bar, text, (6, BAR_PX - 6), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (235,) * 3, 1, cv2.LINE_AA
    )
    return bar


def _terms(blueprint: Blueprint) -> str:
    model = blueprint.model
    return f"{model.pack or model.file} by {model.author}, {model.licence}" if model else ""
