"""Draws contact sheets of bodies: each blueprint from four sides, by day and by night."""

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from advercity_dsl import Blueprint, Camera, Mount

from advercity.assets.bodies import build_body
from advercity.assets.catalogue import compute_body_facts
from advercity.assets.model_store import ModelStore
from advercity.compiler.library import find_weather
from advercity.frames import Actor, ActorState, Frame, Lamp
from advercity.geometry import poses
from advercity.geometry.arrays import Uint8Array
from advercity.geometry.mesh import Mesh
from advercity.geometry.poses import Matrix
from advercity.media import draw_label_bar
from advercity.physics.atmosphere import compute_atmosphere
from advercity.rendering.backend import RENDER_PROFILES, Backend, CameraView, Renderer
from advercity.semantics import Semantic
from advercity.sensors.camera import expose_image, meter_exposure
from advercity.sensors.camera.optics import add_stray_light
from advercity.traffic.paints import CONNECTED_PAINT, draw_paint
from advercity.traffic.weather_effects import apply_lamp_state
from advercity.world import StreetLamp, World

VIEWS = (("three quarters", 0.6), ("side", np.pi / 2), ("rear", np.pi), ("front", 0.0))
"""Azimuths of the camera, in radians to the left of the body's front."""
SHEET_WEATHERS = ("clear_day", "clear_night")
CELL_PX = (320, 200)
FIELD_OF_VIEW_RAD = np.radians(30.0)
RAISED_CAMERA_RATIO, LEVEL_CAMERA_RATIO = 0.18, 0.08
"""Height of the camera above the centre of the body, as a fraction of its distance."""
STREET_LAMPS = tuple(StreetLamp((x, y, 8.0)) for x in (-9.0, 9.0) for y in (-7.0, 7.0))
STEERING_RAD = np.radians(20.0)
BLINKING_ACTOR_ID = 2
"""Id of an actor whose indicators are lit at time 0; the phase depends on the id."""
CLEAN_LENS_FRACTION = 0.02
"""Fraction of the light scattered by a clean lens."""
ALL_LAMPS = Lamp.BRAKE | Lamp.LEFT | Lamp.RIGHT


def draw_body_sheet(
    blueprints: Mapping[str, Blueprint], backend: Backend, store: ModelStore
) -> Uint8Array:
    """Draw an image (h, w, 3), BGR: a row per blueprint, four views by day and four by night."""
    world = World(
        id="sheet",
        static=(build_ground(),),
        bodies={
            name: build_body(name, blueprint, store if store.prepare_model(blueprint) else None)
            for name, blueprint in blueprints.items()
        },
        lanes=(),
        street_lamps=STREET_LAMPS,
        network=Path(),
        material_maps=store.images,
    )
    halves = [
        list(_render_views(world, blueprints, backend, weather)) for weather in SHEET_WEATHERS
    ]
    rows = [
        np.vstack(
            [
                draw_label_bar(_format_label(name, blueprint, store), 8 * CELL_PX[0]),
                np.hstack([*day, *night]),
            ]
        )
        for (name, blueprint), day, night in zip(blueprints.items(), *halves, strict=True)
    ]
    return np.vstack(rows)


def _render_views(
    world: World, blueprints: Mapping[str, Blueprint], backend: Backend, weather_id: str
) -> Iterator[list[Uint8Array]]:
    """Render four views of each blueprint under a weather."""
    weather = find_weather(weather_id).declaration
    atmosphere = compute_atmosphere(weather, "rural")
    with backend.open(world, atmosphere, RENDER_PROFILES["preview"]) as renderer:
        for name, blueprint in blueprints.items():
            frame = apply_lamp_state(_build_frame(name, blueprint), weather.lamps)
            renderer.place(frame)
            yield [_render_view(renderer, blueprint, azimuth) for _, azimuth in VIEWS]


def _build_frame(name: str, blueprint: Blueprint) -> Frame:
    paint = CONNECTED_PAINT
    if blueprint.actor_class == "pedestrian":
        paint = draw_paint(blueprint.actor_class, name)
    lamps = Lamp(0) if blueprint.actor_class == "pedestrian" else ALL_LAMPS
    # A semi-trailer blinks like its tractor unit, which is not in the picture.
    number, towed_by = (
        (BLINKING_ACTOR_ID + 1, BLINKING_ACTOR_ID)
        if blueprint.semitrailer
        else (BLINKING_ACTOR_ID, 0)
    )
    actor = Actor.from_blueprint(number, name, blueprint, paint, towed_by=towed_by)
    state = ActorState(actor, np.eye(4), 0.0, 0.0, lamps, steering_rad=STEERING_RAD)
    return Frame(index=0, time_s=0.0, states=(state,), signals={})


def _render_view(renderer: Renderer, blueprint: Blueprint, azimuth: float) -> Uint8Array:
    width, height = CELL_PX
    place = _place_camera(blueprint, azimuth)
    return take_photograph(renderer, CameraView(place, width, height, FIELD_OF_VIEW_RAD))


def take_photograph(renderer: Renderer, view: CameraView) -> Uint8Array:
    """Render a view as a camera without noise exposes it: (h, w, 3), BGR."""
    camera = Camera(mounts=(Mount(),), noise=False)
    light = add_stray_light(
        renderer.render_camera(view).radiance,
        horizontal_fov_rad=view.horizontal_fov_rad,
        fraction=CLEAN_LENS_FRACTION,
    )
    setting = meter_exposure(light, camera.exposure)
    exposed = expose_image(light, camera, setting, np.random.default_rng(0))
    return exposed.image[..., ::-1]


def _place_camera(blueprint: Blueprint, azimuth: float) -> Matrix:
    """Place the camera a little above the body's centre, where the body fills the image."""
    extent_m = max(blueprint.length_m, 1.6 * blueprint.height_m, blueprint.width_m)
    away = 0.62 * extent_m / np.tan(FIELD_OF_VIEW_RAD / 2) + blueprint.width_m / 2
    raised = RAISED_CAMERA_RATIO if azimuth == VIEWS[0][1] else LEVEL_CAMERA_RATIO
    place = away * np.array([np.cos(azimuth), np.sin(azimuth), raised])
    place[2] += blueprint.height_m / 2
    return poses.pose_matrix(place, yaw=azimuth + np.pi, pitch=float(np.arctan(raised)))


def build_ground() -> Mesh:
    """Build a plain of asphalt."""
    corners = [(-200.0, -200.0, 0.0), (200.0, -200.0, 0.0), (200.0, 200.0, 0.0), (-200.0, 200.0, 0)]
    return Mesh(
        name="ground",
        vertices=np.array(corners, dtype=np.float32),
        triangles=np.array([(0, 1, 2), (0, 2, 3)], dtype=np.int32),
        material="asphalt",
        semantic=Semantic.ROAD,
    )


def _format_label(name: str, blueprint: Blueprint, store: ModelStore) -> str:
    facts = compute_body_facts(name, blueprint, store)
    size = f"{blueprint.length_m:.2f} x {blueprint.width_m:.2f} x {blueprint.height_m:.2f} m"
    return f"{name}: {blueprint.actor_class}, {size}, {facts.source}, {facts.attribution}"
