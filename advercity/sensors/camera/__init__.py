"""Turns rendered radiance into camera images: air before the lens, glass, lens, electronics."""

from advercity.sensors.camera.electronics import (
    ExposureSettings,
    digitise,
    meter_exposure,
)
from advercity.sensors.camera.exposed_image import ExposedImage, expose_image
from advercity.sensors.camera.exposure import CameraExposure
from advercity.sensors.camera.falling_particles import move_blocks
from advercity.sensors.camera.image_formation import (
    CameraConditions,
    add_air_effects,
    meter_image,
    render_image,
)
from advercity.sensors.camera.image_processing import develop_raw

__all__ = [
    "CameraConditions",
    "CameraExposure",
    "ExposedImage",
    "ExposureSettings",
    "add_air_effects",
    "develop_raw",
    "digitise",
    "expose_image",
    "meter_exposure",
    "meter_image",
    "move_blocks",
    "render_image",
]
