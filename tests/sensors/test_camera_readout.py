"""Linear and raw images against the light that made them, the photon transfer curve and OpenCV."""

from typing import Any

import cv2
import numpy as np
import pytest
from advercity_dsl import Camera, Mount, RawOutput
from numpy.typing import NDArray
from pydantic import ValidationError

from advercity.randomness import create_generator
from advercity.sensors.camera import ExposedImage, ExposureSettings, expose_image
from advercity.sensors.camera.electronics import build_tone_curve

SETTING = ExposureSettings(ev100=8.61, iso=100, shutter_s=0.005)
SATURATION = SETTING.saturation_cd_m2
WARM = np.array([1.3, 0.95, 0.6])


def expose(light: NDArray[Any], **said: Any) -> ExposedImage:
    """Expose light (h, w, 3) in cd/m² with a sensor of its size."""
    height, width = light.shape[:2]
    camera = Camera(width_px=width, height_px=height, mounts=(Mount(),), **said)
    rng = create_generator("readout")
    return expose_image(light.astype(np.float32), camera, SETTING, rng, white_point=WARM)


def ramp(brightest: float) -> NDArray[np.float64]:
    """Coloured light (64, 128, 3) that brightens from dark to a multiple of saturation."""
    across = np.linspace(0.0, brightest * SATURATION, 128)
    return np.broadcast_to(across[None, :, None] * [1.0, 0.8, 0.5], (64, 128, 3))


def test_a_linear_image_has_the_light_before_white_balance_and_tone() -> None:
    light = ramp(8.0)
    exposed = expose(light, hdr=True, noise=False)
    assert exposed.hdr is not None
    step = SATURATION / 4095 * WARM.max()
    np.testing.assert_allclose(exposed.readout.scale_hdr(exposed.hdr), light, atol=0.51 * step)


def test_the_tone_curve_of_a_linear_image_is_the_image() -> None:
    exposed = expose(ramp(100.0), hdr=True, highlights_ev=2)
    assert exposed.hdr is not None
    assert exposed.hdr.max() == 4 * 4095
    np.testing.assert_array_equal(build_tone_curve(2.0)[exposed.hdr], exposed.image)


@pytest.mark.parametrize("pattern", ["rggb", "bggr", "grbg", "gbrg"])
def test_opencv_makes_the_colours_of_the_light_of_a_raw_image(pattern: str) -> None:
    light = np.full((32, 48, 3), 0.7 * SATURATION) * [1.0, 0.6, 0.3]
    raw = RawOutput.model_validate({"pattern": pattern, "bits": 14, "black_level": 256})
    exposed = expose(light, raw=raw, noise=False)
    assert exposed.raw is not None
    code = getattr(cv2, f"COLOR_Bayer{pattern.upper()}2RGB")
    colours = (cv2.cvtColor(exposed.raw, code).astype(float) - 256) / (16_383 - 256) * SATURATION
    np.testing.assert_allclose(colours[2:-2, 2:-2], light[2:-2, 2:-2], atol=SATURATION / 16_000)


def test_raw_electrons_follow_the_photon_transfer_curve() -> None:
    raw = RawOutput(bits=16, black_level=1024)
    levels = (0.0, 0.02, 0.1, 0.3, 0.6, 0.8)
    mean, variance = [], []
    for level in levels:
        exposed = expose(np.full((400, 500, 3), level * SATURATION), raw=raw)
        assert exposed.raw is not None
        electrons = exposed.readout.count_electrons(exposed.raw, raw).astype(np.float64)
        mean.append(electrons.mean())
        variance.append(electrons.var())
    np.testing.assert_allclose(mean, np.multiply(levels, 10_000), atol=1)
    # Shot noise of Poisson, and 3 electrons of read noise.
    np.testing.assert_allclose(variance, np.add(mean, 9), rtol=0.015)


def test_raw_values_end_at_a_full_pixel_and_read_noise_shows_below_black() -> None:
    raw = RawOutput(bits=16, black_level=1024)
    exposed = expose(ramp(3.0), raw=raw)
    assert exposed.raw is not None
    assert exposed.raw.max() == 65_535
    assert exposed.raw[:, 0].min() < 1024 < exposed.raw[:, 0].max()


def test_images_are_the_same_with_and_without_others_of_their_sensor() -> None:
    alone, all_of_them = expose(ramp(2.0)), expose(ramp(2.0), hdr=True, raw=RawOutput())
    assert alone.hdr is None and alone.raw is None
    np.testing.assert_array_equal(alone.image, all_of_them.image)


def test_a_black_level_leaves_half_of_the_values_for_light() -> None:
    assert RawOutput(bits=8, black_level=127).full_value == 255
    with pytest.raises(ValidationError, match="more than half"):
        RawOutput(bits=8, black_level=128)
