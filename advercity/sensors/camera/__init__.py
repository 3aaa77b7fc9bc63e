"""Turns rendered radiance into camera images: air before the lens, glass, lens, electronics."""

from advercity.sensors.camera.electronics import (
    ExposedImage,
    ExposureSettings,
    digitise,
    expose_image,
    meter_exposure,
)
from advercity.sensors.camera.exposure import CameraExposure
from advercity.sensors.camera.falling_particles import move_blocks
from advercity.sensors.camera.image_formation import (
    CameraConditions,
    add_air_effects,
    meter_image,
    render_image,
)

__all__ = [
    "CameraConditions",
    "CameraExposure",
    "ExposedImage",
    "ExposureSettings",
    "add_air_effects",
    "digitise",
    "expose_image",
    "meter_exposure",
    "meter_image",
    "move_blocks",
    "render_image",
]
