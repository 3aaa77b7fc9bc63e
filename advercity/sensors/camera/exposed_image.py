"""Exposes the light on a sensor to an image, and reports the exposure."""

from dataclasses import dataclass, replace

import numpy as np
from advercity_dsl import Camera
from numpy.typing import NDArray

from advercity.sensors.camera.electronics import (
    HIGHLIGHT_STEP,
    NEUTRAL_WHITE,
    ExposureSettings,
    build_tone_curve,
    digitise,
    digitise_raw,
    find_brightest_ev,
)
from advercity.sensors.camera.image_processing import develop_raw
from advercity.sensors.measurements import CameraReadout


@dataclass(frozen=True, eq=False)
class ExposedImage:
    """The outputs of one exposure.

    Attributes:
        image: (h, w, 3) uint8 RGB.
        readout: Exposure, and scale of the values of `hdr` and `raw`.
        hdr: (h, w, 3) uint16, linear, white-balanced; None if the camera writes none.
        raw: (h, w) uint16 of the sensor's pixels; None if the camera writes none.
    """

    image: NDArray[np.uint8]
    readout: CameraReadout
    hdr: NDArray[np.uint16] | None
    raw: NDArray[np.uint16] | None


def expose_image(
    light: NDArray[np.float32],
    camera: Camera,
    setting: ExposureSettings,
    rng: np.random.Generator,
    *,
    white_point: NDArray[np.float64] = NEUTRAL_WHITE,
) -> ExposedImage:
    """Expose and digitise the light on a sensor.

    `light` is (h, w, 3) cd/m² at any scale of the camera's size: a pixel of a smaller image gathers
    the light of all sensor pixels in its area. `white_point` (3,) of luminance 1 becomes grey.
    """
    pixels = light.shape[0] * light.shape[1]
    binned = max(1.0, camera.width_px * camera.height_px / pixels)
    setting = replace(
        setting,
        binned_pixels=binned,
        highlights_ev=camera.highlights_ev,
        combined_exposures=camera.combined_exposures,
    )
    red, green, blue = white_point.tolist()
    readout = CameraReadout(
        shutter_s=setting.shutter_s,
        iso=setting.iso,
        saturation_cd_m2=setting.saturation_cd_m2,
        white_point=(red, green, blue),
        full_well_e=setting.full_well_e,
        read_noise_e=setting.read_noise_e,
    )
    fill_fraction = light / (setting.saturation_cd_m2 * white_point).astype(np.float32)
    noise = rng if camera.noise else None
    if camera.isp is not None:
        raw = digitise_raw(light, camera, readout, noise)
        return ExposedImage(
            image=develop_raw(raw, camera, readout),
            readout=readout,
            hdr=digitise(fill_fraction, setting, noise) if camera.hdr else None,
            raw=raw if camera.raw else None,
        )
    digital = digitise(fill_fraction, setting, noise)
    sampled = fill_fraction[::HIGHLIGHT_STEP, ::HIGHLIGHT_STEP]
    brightest_ev = find_brightest_ev(sampled, camera.highlights_ev)
    return ExposedImage(
        image=build_tone_curve(brightest_ev).take(digital),
        readout=readout,
        hdr=digital if camera.hdr else None,
        # After the image, so its noise is the same with and without `raw`.
        raw=digitise_raw(light, camera, readout, noise) if camera.raw else None,
    )
