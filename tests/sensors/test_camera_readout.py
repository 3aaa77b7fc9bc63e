"""Linear and raw images against the light that made them, the photon transfer curve and OpenCV."""

import math
from typing import Any

import cv2
import numpy as np
import pytest
from advercity_dsl import Camera, Mount, RawOutput
from numpy.typing import NDArray
from pydantic import ValidationError
from scipy import stats

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


def test_noise_of_pixels_is_normal_and_independent_of_place_and_colour() -> None:
    """Red, green and blue pixels next to each other: of 50,000, 0.023 is five sigma."""
    raw = RawOutput(bits=16, black_level=1024)
    exposed = expose(np.full((400, 500, 3), 0.3 * SATURATION), raw=raw)
    assert exposed.raw is not None
    electrons = exposed.readout.count_electrons(exposed.raw, raw).astype(np.float64)
    tiles = electrons.reshape(200, 2, 250, 2).transpose(1, 3, 0, 2).reshape(4, -1)
    right = electrons.reshape(200, 2, 250, 2)[:, 0, :, 0][:, 1:].ravel()
    left = electrons.reshape(200, 2, 250, 2)[:, 0, :, 0][:, :-1].ravel()
    np.testing.assert_allclose(np.corrcoef(tiles), np.eye(4), atol=0.023)
    assert abs(np.corrcoef(left, right)[0, 1]) < 0.023
    # Shot noise of 3000 electrons and read noise of 3 together.
    assert stats.kstest((electrons.ravel()[::20] - 3000) / math.sqrt(3009), "norm").pvalue > 1e-4


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


@pytest.mark.parametrize(("exposures", "ratio"), [(2, 16.0), (3, 4.0)])
def test_the_signal_to_noise_ratio_dips_where_a_shorter_exposure_takes_over(
    exposures: int, ratio: float
) -> None:
    levels = np.array([0.1, 0.85, 0.95, 3.3, 3.9, 12.0, 14.0])
    # The number of the exposure: switched at 0.9 of a full pixel.
    number = np.clip(np.ceil(np.log(levels / 0.9) / np.log(ratio)), 0, exposures - 1)
    electrons = 10_000 * levels / ratio**number
    expected = electrons / np.sqrt(electrons + 9 + (10_000 / 4095) ** 2 / 12)
    found: list[float] = []
    for level in levels.tolist():
        light = np.full((200, 300, 3), level * SATURATION) * WARM
        exposed = expose(light, hdr=True, combined_exposures=exposures)
        assert exposed.hdr is not None
        values = exposed.hdr.astype(np.float64)
        assert values.mean() == pytest.approx(4095 * level, rel=2e-3)
        found.append(float(values.mean() / values.std()))
    np.testing.assert_allclose(found, expected, rtol=0.01)
    # Just above the switch, by the root of the ratio.
    assert found[1] / found[2] == pytest.approx(np.sqrt(ratio), rel=0.1)


def test_exposures_without_noise_differ_from_one_by_their_steps() -> None:
    one, three = (expose(ramp(8.0), hdr=True, noise=False, combined_exposures=n) for n in (1, 3))
    assert one.hdr is not None and three.hdr is not None
    difference = np.abs(one.hdr.astype(int) - three.hdr)
    assert difference.max() == 8
    assert (difference[one.hdr < 0.9 * 4095] == 0).all()


def test_exposures_need_highlights_to_resolve() -> None:
    with pytest.raises(ValidationError, match="no effect without highlights_ev"):
        Camera(mounts=(Mount(),), highlights_ev=0, combined_exposures=2)
