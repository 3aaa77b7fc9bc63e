"""Worlds of boxes, their air, frames and views."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path

import numpy as np
from advercity_sapien.renderer import SapienRenderer
from numpy.typing import ArrayLike, NDArray

from advercity.frames import Actor, ActorState, Frame, Lamp, Signal
from advercity.geometry.mesh import Mesh
from advercity.geometry.poses import pose_matrix
from advercity.physics.atmosphere import Atmosphere
from advercity.physics.extinction import AirExtinction, extinction_from_mor
from advercity.physics.photometry import Colour, cubemap_directions, horizontal_illuminance
from advercity.physics.sky import build_airlight_cubemap
from advercity.physics.weather_parts.part import Extinction, Suspension
from advercity.rendering.backend import CameraCapture, CameraView
from advercity.semantics import Semantic
from advercity.world import Body, World
from tests.render_builders import (
    LUMINANCE,
    build_box,
)

Open = Callable[..., AbstractContextManager[SapienRenderer]]
Floats = NDArray[np.floating]

FORWARD = pose_matrix((0.0, 0.0, 1.0))
UNLIT = Lamp(0)


def world_of(*static: Mesh, **more: object) -> World:
    body = Body((build_box((0, 0, 1), (2, 2, 2), "paint", Semantic.VEHICLE),), (2.0, 2.0, 2.0))
    world = World("test", static, {"box": body}, lanes=(), network=Path("none"))
    return replace(world, **more)  # pyright: ignore[reportArgumentType]


def air_of(
    *,
    mor_m: float = 1e9,
    sky: Callable[[Floats], Floats] = np.zeros_like,
    sun_lx: float = 0.0,
    sun_elevation_deg: float = 45.0,
    airlight: Colour = (0.0, 0.0, 0.0),
    wetness: float = 0.0,
    night: bool = False,
) -> Atmosphere:
    """Air under a sky given as luminance by sine of elevation; the sun is behind FORWARD."""
    luminance = np.asarray(sky(cubemap_directions(32)[..., 2]), dtype=np.float32)
    cubemap = np.repeat(luminance[..., None], 3, axis=-1)
    elevation = np.radians(sun_elevation_deg)
    fog = Suspension("fog", Extinction(at_550nm=extinction_from_mor(mor_m)))
    return Atmosphere(
        extinction=AirExtinction((fog,)),
        sun_direction=np.array([-np.cos(elevation), 0.0, np.sin(elevation)]),
        sun_lx=sun_lx,
        sun_colour=(1.0, 1.0, 1.0),
        sky_lx=horizontal_illuminance(cubemap.astype(np.float64)),
        sky=cubemap,
        airlight=build_airlight_cubemap(airlight, airlight),
        street_lx=0.0,
        wetness=wetness,
        puddle_coverage=0.0,
        night=night,
    )


def grey(luminance: float) -> Colour:
    return luminance, luminance, luminance


def uniform(luminance: float) -> Callable[[Floats], Floats]:
    return lambda sine: np.full_like(sine, luminance)


def state(
    number: int, at: ArrayLike, *, paint: str = "grey", lamps: Lamp = UNLIT, yaw: float = 0.0
) -> ActorState:
    actor = Actor(number, "car", "box", paint, (2.0, 2.0, 2.0))
    return ActorState(actor, pose_matrix(at, yaw=yaw), 0.0, 0.0, lamps)


def frame_of(*states: ActorState, index: int = 0, **signals: Signal) -> Frame:
    return Frame(index, 0.0, states, signals)


def view_of(
    at: NDArray[np.float64] = FORWARD, *, size: tuple[int, int] = (160, 120), hide: int = 0
) -> CameraView:
    return CameraView(at, *size, np.radians(90.0), frozenset({hide} - {0}))


def luminance(capture: CameraCapture) -> Floats:
    return capture.radiance @ LUMINANCE


def centre(picture: NDArray[np.number]) -> float:
    return float(picture[picture.shape[0] // 2, picture.shape[1] // 2])
