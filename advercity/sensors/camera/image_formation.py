"""The way from what a renderer captured to what a camera reports.

Radiance in cd/m² passes the air (the sun's disc, spray, drops and flakes), the glass, the lens
(scattered light, ghosts, vignetting) and the electronics (exposure, white balance, noise, tone).
What is not there leaves the picture exactly as it is.
"""

import math
from dataclasses import dataclass

import numpy as np
from advercity_dsl import Mount
from advercity_dsl.weather import Lens
from numpy.typing import NDArray

from advercity.physics.atmosphere import Atmosphere
from advercity.randomness import create_generator
from advercity.rendering.backend import CameraCapture
from advercity.sensors.camera.electronics import expose_image, find_white_point, meter_exposure
from advercity.sensors.camera.exposure import CameraExposure
from advercity.sensors.camera.falling_particles import ParticleBlock, build_particle_blocks
from advercity.sensors.camera.motion_streaks import add_falling_particles
from advercity.sensors.camera.optics import (
    add_lens_ghosts,
    add_stray_light,
    apply_glass,
    apply_vignetting,
    glass_coverage,
)
from advercity.sensors.camera.scene_light import AmbientLight, add_sun_disc
from advercity.sensors.camera.spray_veil import add_spray


@dataclass(frozen=True, eq=False)
class CameraConditions:
    """Air and light as cameras have them, worked out once per scenario.

    Attributes:
        atmosphere: Air and light of the scene.
        lens: What is on the lenses' glass.
        blocks: All that falls, the same for every camera.
        ambient_light: Light from around.
        white_point: (3,) colour that is shown as grey.
        white_card_cd_m2: What a white card on open ground shows; inf by night, when no
            light is everywhere.
        key: Of everything random in front of the lenses.
    """

    atmosphere: Atmosphere
    lens: Lens
    blocks: tuple[ParticleBlock, ...]
    ambient_light: AmbientLight
    white_point: NDArray[np.float64]
    white_card_cd_m2: float
    key: tuple[int | str, ...]

    @staticmethod
    def build(atmosphere: Atmosphere, lens: Lens, *key: int | str) -> "CameraConditions":
        """Derive the conditions; the same key lets the same drops fall."""
        return CameraConditions(
            atmosphere=atmosphere,
            lens=lens,
            blocks=build_particle_blocks(atmosphere, *key, "falling"),
            ambient_light=AmbientLight.from_atmosphere(atmosphere),
            white_point=find_white_point(atmosphere),
            white_card_cd_m2=math.inf if atmosphere.night else atmosphere.ground_lx / math.pi,
            key=key,
        )


def render_image(
    capture: CameraCapture,
    exposure: CameraExposure,
    conditions: CameraConditions,
    rng: np.random.Generator,
    *,
    mount: Mount,
    carrier: str = "",
) -> NDArray[np.uint8]:
    """The picture (h, w, 3) RGB that a camera takes.

    Args:
        capture: What its pixels met.
        exposure: Where from, of what, with which camera.
        conditions: Between.
        rng: Of this camera and frame, for the electronics.
        mount: How the camera sits on its carrier.
        carrier: Whose it is; tells what is on its glass from what is on another's.
    """
    light = _light_on_sensor(capture, exposure, conditions, mount, carrier)
    control = exposure.camera.exposure
    setting = meter_exposure(light, control, white_card_cd_m2=conditions.white_card_cd_m2)
    if conditions.blocks and setting.shutter_s != control.shutter_s:
        # How drops streak is known only now, and hardly changes what was metered.
        light = _light_on_sensor(
            capture, exposure.with_shutter(setting.shutter_s), conditions, mount, carrier
        )
    return expose_image(light, exposure.camera, setting, rng, white_point=conditions.white_point)


def add_air_effects(
    capture: CameraCapture, shot: CameraExposure, air: CameraConditions
) -> CameraCapture:
    """The capture with the sun's disc and with what the air before the camera holds."""
    seen = add_sun_disc(capture, shot.view, air.atmosphere)
    seen = add_spray(seen, shot, air.ambient_light, water_film_mm=air.atmosphere.water_film_mm)
    extinction = air.atmosphere.extinction.at_550nm
    return add_falling_particles(seen, shot, air.blocks, air.ambient_light, extinction=extinction)


def _light_on_sensor(
    capture: CameraCapture, shot: CameraExposure, air: CameraConditions, mount: Mount, carrier: str
) -> NDArray[np.float32]:
    """Light (h, w, 3) in cd/m² that comes through air, glass and lens while the shutter is open."""
    before_lens = add_air_effects(capture, shot, air)
    lens = air.lens
    spots = create_generator(*air.key, "glass", carrier, *map(str, mount.model_dump().values()))
    light = apply_glass(before_lens.radiance, shot, lens, glass_coverage(lens, mount), spots)
    light = add_stray_light(
        light, horizontal_fov_rad=shot.view.horizontal_fov_rad, fraction=lens.stray_light
    )
    light = add_lens_ghosts(light, capture, shot, air.atmosphere)
    return apply_vignetting(light, shot.focal_px, shot.camera.vignetting)
