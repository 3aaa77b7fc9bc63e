"""Renders the pictures of docs/bodies.md: sheets with the installed models, and a lorry that turns.

python docs/make_body_pictures.py [FOLDER [NAME ...]]
"""

import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import cv2
import numpy as np
from advercity_dsl import Blueprint

from advercity.assets.bodies import build_body
from advercity.assets.catalogue import load_catalogue_blueprints
from advercity.assets.model_store import open_model_store
from advercity.compiler.library import find_weather
from advercity.frames import FRONT_DTYPE, Actor, Frame, Lamp, Trace
from advercity.geometry import poses
from advercity.geometry.arrays import Uint8Array
from advercity.physics.atmosphere import compute_atmosphere
from advercity.pipeline.body_sheet import build_ground, draw_body_sheet, take_photograph
from advercity.rendering.backend import RENDER_PROFILES, Backend, CameraView, load_backend
from advercity.traffic.semitrailers import TowedTrailer
from advercity.traffic.vehicle_motion import compute_lorry_states
from advercity.traffic.weather_effects import apply_lamp_state
from advercity.world import World


def has_attachment(item: Blueprint) -> bool:
    """Return whether a pedestrian has a pram, a dog or a wheelchair."""
    return item.looks is not None and item.looks.attachment != "none"


SHEETS: dict[str, Callable[[Blueprint], bool]] = {
    "cars": lambda item: item.actor_class == "car",
    "vans_and_trucks": lambda item: item.actor_class in ("van", "truck"),
    "two_wheelers": lambda item: item.actor_class in ("bicycle", "motorcycle"),
    "people": lambda item: item.actor_class == "pedestrian" and not has_attachment(item),
    "attachments": has_attachment,
}
SCALE = 0.5
JPEG_QUALITY = 76
LORRY = "lorry_turning"
LORRY_VIEWS = (
    ((11.0, 8.5, 2.4), (-1.7, 0.9, 1.8), 54.0),
    ((-17.5, 18.0, 4.2), (-5.5, 2.6, 1.7), 44.0),
)
"""Where two cameras are and look, in the frame of the tractor unit, and their fields of view."""
LORRY_SIZE_PX = (880, 460)
TURN_RADIUS_M, TURN_SPEED_M_S, TURN_TICKS = 14.0, 4.0, 90
"""Of the front axle; after so many ticks, that is 147 degrees, the semi-trailer has followed."""


def main() -> None:
    """Write a sheet for each group, and the lorry."""
    home = Path(__file__).parent / "images/bodies"
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else home
    names = sys.argv[2:] or [*SHEETS, LORRY]
    folder.mkdir(parents=True, exist_ok=True)
    backend = load_backend("sapien")
    for name in names:
        catalogue = load_catalogue_blueprints()
        if name == LORRY:
            picture = draw_turning_lorry(catalogue, backend)
        else:
            shown = {key: item for key, item in catalogue.items() if SHEETS[name](item)}
            sheet = draw_body_sheet(shown, backend, open_model_store())
            picture = cv2.resize(sheet, None, fx=SCALE, fy=SCALE, interpolation=cv2.INTER_AREA)
        options = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
        _, content = cv2.imencode(".jpg", picture.astype(np.uint8), options)
        (folder / f"{name}.jpg").write_bytes(content.tobytes())


def draw_turning_lorry(catalogue: Mapping[str, Blueprint], backend: Backend) -> Uint8Array:
    """Draw the lorry of the catalogue in a turn from two sides, at its full size."""
    names = "lorry_tractor", "curtain_semitrailer"
    world = World(
        id="turn",
        static=(build_ground(),),
        bodies={name: build_body(name, catalogue[name]) for name in names},
        lanes=(),
        network=Path(),
    )
    weather = find_weather("clear_day").declaration
    frame = apply_lamp_state(turn_lorry(catalogue, *names), weather.lamps)
    world_from_tractor = frame.states[0].world_from_body
    pictures: list[Uint8Array] = []
    with backend.open(
        world, compute_atmosphere(weather, "rural"), RENDER_PROFILES["preview"]
    ) as renderer:
        renderer.place(frame)
        for eye, target, field_deg in LORRY_VIEWS:
            place, aim = poses.transform_points(world_from_tractor, [eye, target])
            along = aim - place
            pitch = -float(np.arctan2(along[2], np.hypot(*along[:2])))
            pose = poses.pose_matrix(place, yaw=float(np.arctan2(along[1], along[0])), pitch=pitch)
            view = CameraView(pose, *LORRY_SIZE_PX, np.radians(field_deg))
            pictures.append(take_photograph(renderer, view))
    return np.hstack(pictures)


def turn_lorry(catalogue: Mapping[str, Blueprint], tractor: str, trailer: str) -> Frame:
    """Drive a lorry around a turn to the left, and return its last frame."""
    coupling, running = catalogue[tractor].tows, catalogue[trailer].semitrailer
    assert coupling is not None and running is not None
    actor = Actor.from_blueprint(2, tractor, catalogue[tractor], "car_paint_red")
    towed = Actor.from_blueprint(
        3, trailer, catalogue[trailer], "car_paint_blue", towed_by=actor.id
    )
    angle = TURN_SPEED_M_S * 0.1 / TURN_RADIUS_M * np.arange(TURN_TICKS)
    fronts = np.zeros(TURN_TICKS, FRONT_DTYPE)
    fronts["tick"], fronts["yaw"], fronts["speed"] = np.arange(TURN_TICKS), angle, TURN_SPEED_M_S
    fronts["x"], fronts["y"] = TURN_RADIUS_M * np.sin(angle), -TURN_RADIUS_M * np.cos(angle)
    fronts["lamps"] = Lamp.LEFT
    states = compute_lorry_states(
        fronts,
        actor.size[0],
        TowedTrailer(towed, coupling.behind_front_m, running.kingpin_m, running.wheelbase_m),
        tick_s=0.1,
        trailer_heading_rad=0.0,
    )
    rows = np.concatenate([track[-20:-19] for track in states])
    rows["tick"], rows["actor"] = 0, [0, 1]
    signals = np.zeros((1, 0), np.uint8)
    return Trace(0.1, 0, (actor, towed), rows, (), signals).build_frame(0)


if __name__ == "__main__":
    main()
