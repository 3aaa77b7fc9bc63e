"""Forms a camera image from rendered radiance.

Radiance in cd/m² passes the air (the sun's disc, spray, drops and flakes), the glass, the lens
(stray light, ghosts, vignetting, distortion, blur) and the electronics (exposure, white balance,
noise, tone). Absent effects leave the image unchanged bit for bit.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from advercity_dsl import Mount
from advercity_dsl.weather_components import Lens
from numpy.typing import NDArray

from advercity.physics.atmosphere import Atmosphere
from advercity.physics.weather_parts.part import Precipitation
from advercity.randomness import create_generator
from advercity.rendering.backend import CameraCapture
from advercity.sensors.camera.electronics import (
    ExposureSettings,
    find_white_point,
    meter_exposure,
)
from advercity.sensors.camera.exposed_image import ExposedImage, expose_image
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
from advercity.sensors.camera.point_spread import spread_points
from advercity.sensors.camera.scene_light import AmbientLight, add_sun_disc
from advercity.sensors.camera.spray_veil import add_spray


@dataclass(frozen=True, eq=False)
class CameraConditions:
    """Air and light for cameras.

    Attributes:
        atmosphere: Air and light of the scene.
        lens: Drops, dust or snow on the glass of the cameras.
        blocks: Falling drops and flakes, the same for every camera.
        ambient_light: Light on particles in the air.
        white_point: (3,) colour shown as grey.
        white_card_cd_m2: Luminance of a white card on open ground; inf by night, under lamps.
        key: Random key of everything in front of the lenses.
    """

    atmosphere: Atmosphere
    lens: Lens
    blocks: tuple[ParticleBlock, ...]
    ambient_light: AmbientLight
    white_point: NDArray[np.float64]
    white_card_cd_m2: float
    key: tuple[int | str, ...]

    @staticmethod
    def build(
        atmosphere: Atmosphere,
        lens: Lens,
        *key: int | str,
        all_moments: Sequence[Precipitation] | None = None,
    ) -> "CameraConditions":
        """Derive the conditions; the same key gives the same drops.

        `all_moments` is for a changing weather, as in `build_particle_blocks`.
        """
        return CameraConditions(
            atmosphere=atmosphere,
            lens=lens,
            blocks=build_particle_blocks(atmosphere, *key, "falling", all_moments=all_moments),
            key=key,
            **_derive_light(atmosphere),
        )

    def change(
        self, atmosphere: Atmosphere, lens: Lens, blocks: tuple[ParticleBlock, ...]
    ) -> "CameraConditions":
        """Return the conditions of another moment; light is derived again if the sky differs."""
        same = atmosphere.sky is self.atmosphere.sky
        light = {} if same else _derive_light(atmosphere)
        return replace(self, atmosphere=atmosphere, lens=lens, blocks=blocks, **light)


def _derive_light(atmosphere: Atmosphere) -> dict[str, Any]:
    """Derive the fields of `CameraConditions` that depend on light alone."""
    return {
        "ambient_light": AmbientLight.from_atmosphere(atmosphere),
        "white_point": find_white_point(atmosphere),
        "white_card_cd_m2": math.inf if atmosphere.night else atmosphere.ground_lx / math.pi,
    }


def render_image(
    capture: CameraCapture,
    exposure: CameraExposure,
    conditions: CameraConditions,
    rng: np.random.Generator,
    *,
    mount: Mount,
    carrier: str = "",
) -> ExposedImage:
    """Form the image of a camera.

    `mount` and `carrier` decide the spots on the glass; `rng` is the generator of this camera and
    frame, for the electronics.
    """
    light = _light_on_sensor(capture, exposure, conditions, mount, carrier)
    setting = _meter_light(light, exposure, conditions)
    if conditions.blocks and setting.shutter_s != exposure.camera.exposure.shutter_s:
        # The shutter decides how drops streak. Streaks hardly change the metered light, so one
        # correction is enough.
        light = _light_on_sensor(
            capture, exposure.with_shutter(setting.shutter_s), conditions, mount, carrier
        )
    return expose_image(light, exposure.camera, setting, rng, white_point=conditions.white_point)


def meter_image(
    capture: CameraCapture,
    exposure: CameraExposure,
    conditions: CameraConditions,
    *,
    mount: Mount,
    carrier: str = "",
) -> ExposureSettings:
    """Meter the exposure of the image of `render_image`."""
    light = _light_on_sensor(capture, exposure, conditions, mount, carrier)
    return _meter_light(light, exposure, conditions)


def _meter_light(
    light: NDArray[np.float32], exposure: CameraExposure, conditions: CameraConditions
) -> ExposureSettings:
    control = exposure.camera.exposure
    return meter_exposure(light, control, white_card_cd_m2=conditions.white_card_cd_m2)


def add_air_effects(
    capture: CameraCapture, exposure: CameraExposure, conditions: CameraConditions
) -> CameraCapture:
    """Add the sun's disc, spray, and falling drops and flakes to a capture."""
    atmosphere, light = conditions.atmosphere, conditions.ambient_light
    capture = add_sun_disc(capture, exposure.view, atmosphere)
    capture = add_spray(capture, exposure, light, water_film_mm=atmosphere.water_film_mm)
    extinction = atmosphere.extinction.at_550nm
    return add_falling_particles(capture, exposure, conditions.blocks, light, extinction=extinction)


def _light_on_sensor(
    capture: CameraCapture,
    exposure: CameraExposure,
    conditions: CameraConditions,
    mount: Mount,
    carrier: str,
) -> NDArray[np.float32]:
    """Compute the light (h, w, 3) in cd/m² behind air, glass and lens."""
    # Effects come in the order of the light's path to the sensor.
    before_lens = add_air_effects(capture, exposure, conditions)
    lens = conditions.lens
    place = carrier, *map(str, mount.model_dump().values())
    spots = create_generator(*conditions.key, "glass", *place)
    covered = glass_coverage(lens, mount)
    light = apply_glass(before_lens.radiance, exposure, lens.kind, covered, spots)
    dirt = exposure.camera.dirt
    if dirt is not None:
        # The key has no weather, road or frame, as dirt stays in its place.
        spots = create_generator(dirt.seed, "dirt", *place)
        light = apply_glass(light, exposure, "dust", dirt.coverage, spots)
    fov_rad = exposure.view.horizontal_fov_rad
    light = add_stray_light(light, horizontal_fov_rad=fov_rad, fraction=lens.stray_light)
    light = add_lens_ghosts(light, capture, exposure, conditions.atmosphere)
    light = apply_vignetting(light, exposure.focal_px, exposure.camera.vignetting)
    # Effects before distortion depend on the angle of a ray, effects after it on the pixel.
    if exposure.lens_map is not None:
        light = exposure.lens_map.average(light)
    spread = exposure.camera.point_spread
    return light if spread is None else spread_points(light, spread, exposure.focal_px)
