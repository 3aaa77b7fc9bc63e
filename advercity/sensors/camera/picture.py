"""The way from what a renderer captured to what a camera reports.

Radiance in cd/m² passes the air (the sun's disc, spray, drops and flakes), the glass, the lens
(scattered light, ghosts, vignetting) and the electronics (exposure, white balance, noise, tone).
What is not there leaves the picture exactly as it is.
"""

import math
from dataclasses import dataclass

import numpy as np
from advercity_dsl import Mount, Weather
from numpy.typing import NDArray

from advercity.randomness import generator
from advercity.rendering.backend import CameraCapture
from advercity.sensors.camera.ambience import Ambience
from advercity.sensors.camera.electronics import expose, meter
from advercity.sensors.camera.falling import Block, blocks_of
from advercity.sensors.camera.flare import with_ghosts
from advercity.sensors.camera.glass import coverage_of, through_glass
from advercity.sensors.camera.shot import Shot
from advercity.sensors.camera.spray import with_spray
from advercity.sensors.camera.stray_light import scattered
from advercity.sensors.camera.streaks import with_falling
from advercity.sensors.camera.sun import with_sun
from advercity.sensors.camera.vignetting import vignetted
from advercity.sensors.camera.white_balance import white_of
from advercity.weather.atmosphere import Atmosphere


@dataclass(frozen=True, eq=False)
class CameraAir:
    """Air and light as cameras have them, worked out once per scenario.

    Attributes:
        weather: As authored.
        atmosphere: What it makes of light.
        blocks: All that falls, the same for every camera.
        ambience: Light from around.
        white: (3,) colour that is shown as grey.
        white_card_cd_m2: What a white card on open ground shows; inf by night, when no
            light is everywhere.
        key: Of everything random in front of the lenses.
    """

    weather: Weather
    atmosphere: Atmosphere
    blocks: tuple[Block, ...]
    ambience: Ambience
    white: NDArray[np.float64]
    white_card_cd_m2: float
    key: tuple[int | str, ...]

    @staticmethod
    def of(weather: Weather, atmosphere: Atmosphere, *key: int | str) -> "CameraAir":
        """Of a weather; the same key lets the same drops fall."""
        return CameraAir(
            weather=weather,
            atmosphere=atmosphere,
            blocks=blocks_of(weather, *key, "falling"),
            ambience=Ambience.of(atmosphere),
            white=white_of(atmosphere),
            white_card_cd_m2=math.inf if atmosphere.night else atmosphere.ground_lx / math.pi,
            key=key,
        )


def photograph(
    capture: CameraCapture,
    shot: Shot,
    air: CameraAir,
    rng: np.random.Generator,
    *,
    mount: Mount,
    carrier: str = "",
) -> NDArray[np.uint8]:
    """The picture (h, w, 3) RGB that a camera takes.

    Args:
        capture: What its pixels met.
        shot: Where from, of what, with which camera.
        air: Between.
        rng: Of this camera and frame, for the electronics.
        mount: How the camera sits on its carrier.
        carrier: Whose it is; tells what is on its glass from what is on another's.
    """
    light = _on_sensor(capture, shot, air, mount, carrier)
    exposure = shot.camera.exposure
    setting = meter(light, exposure, white_card_cd_m2=air.white_card_cd_m2)
    if air.blocks and setting.shutter_s != exposure.shutter_s:
        # How drops streak is known only now, and hardly changes what was metered.
        light = _on_sensor(capture, shot.open_for(setting.shutter_s), air, mount, carrier)
    return expose(light, shot.camera, setting, rng, white=air.white)


def in_air(capture: CameraCapture, shot: Shot, air: CameraAir) -> CameraCapture:
    """The capture with the sun's disc and with what the air before the camera holds."""
    seen = with_sun(capture, shot.view, air.atmosphere)
    seen = with_spray(seen, shot, air.weather, air.ambience)
    extinction = air.atmosphere.extinction_550nm
    return with_falling(seen, shot, air.blocks, air.ambience, extinction=extinction)


def _on_sensor(
    capture: CameraCapture, shot: Shot, air: CameraAir, mount: Mount, carrier: str
) -> NDArray[np.float32]:
    """Light (h, w, 3) in cd/m² that comes through air, glass and lens while the shutter is open."""
    before_lens = in_air(capture, shot, air)
    lens = air.weather.lens
    spots = generator(*air.key, "glass", carrier, *map(str, mount.model_dump().values()))
    light = through_glass(before_lens.radiance, shot, lens, coverage_of(lens, mount), spots)
    light = scattered(
        light, horizontal_fov_rad=shot.view.horizontal_fov_rad, share=lens.stray_light
    )
    light = with_ghosts(light, capture, shot, air.atmosphere)
    return vignetted(light, shot.focal_px, shot.camera.vignetting)
