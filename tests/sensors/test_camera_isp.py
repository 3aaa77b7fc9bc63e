"""Images of an ISP against images without one, formulas of its stages, and OpenCV."""

from typing import Any

import cv2
import numpy as np
import pytest
from advercity_dsl import Camera, Isp, Mount, RawOutput
from numpy.typing import NDArray
from pydantic import ValidationError

from advercity import develop_raw
from advercity.randomness import create_generator
from advercity.sensors.camera import ExposureSettings, expose_image
from tests.sensors.test_camera_readout import SATURATION, WARM, expose, ramp

PLAIN = {"denoise": 0, "sharpening": 0}


def process(light: NDArray[Any], isp: dict[str, Any], **said: Any) -> NDArray[np.uint8]:
    """Make the image of light (h, w, 3) in cd/m² by an ISP."""
    return expose(light, isp=Isp.model_validate(isp), **said).image


def fill(shape: tuple[int, int], *colours: list[float]) -> NDArray[np.float64]:
    """Fill halves of an image, from the left, with balanced light in full pixels."""
    return np.concatenate([np.full((*shape, 3), colour) for colour in colours], axis=1) * (
        SATURATION * WARM
    )


def luma(image: NDArray[np.uint8]) -> NDArray[np.float64]:
    return image @ np.array([77, 150, 29]) / 256


@pytest.mark.parametrize("level", [0.02, 0.18, 0.6, 3.8])
def test_grey_stays_grey_and_as_bright_as_without_an_isp(level: float) -> None:
    light = fill((128, 192), [level] * 3)
    means = process(light, {}).mean(axis=(0, 1))
    np.testing.assert_allclose(means, expose(light).image.mean(axis=(0, 1)), atol=1)
    np.testing.assert_allclose(means, means[0], atol=0.5)


@pytest.mark.parametrize("demosaic", ["bilinear", "edge_aware"])
def test_demosaicing_fringes_an_edge_of_colours_by_one_pixel(demosaic: str) -> None:
    light = fill((32, 16), [0.5, 0.1, 0.05], [0.05, 0.1, 0.5])
    image = process(light, PLAIN | {"demosaic": demosaic}, noise=False)
    without = expose(light, noise=False).image
    differs = np.abs(image[2:-2].astype(int) - without[2:-2]).max(axis=(0, 2))
    assert (differs[15:17] > 40).all()
    assert differs[:15].max() <= 1 and differs[17:].max() <= 1


@pytest.mark.parametrize("fraction", [0.3, 0.5, 0.9])
@pytest.mark.parametrize("exposures", [1, 3])
def test_denoising_leaves_the_noise_of_its_formula_on_even_surfaces(
    fraction: float, exposures: int
) -> None:
    noisy = ExposureSettings(ev100=8.61, iso=5000, shutter_s=0.005)
    camera = Camera(
        width_px=400,
        height_px=300,
        mounts=(Mount(),),
        raw=RawOutput(bits=16, highlights_ev=4),
        combined_exposures=exposures,
        isp=Isp(denoise=0, sharpening=0),
    )
    # Above a full pixel, which three exposures resolve with the noise of the second, beside what
    # fills the last, so that the tone curve is that of all highlights.
    light = np.full((300, 400, 3), 1.5 * SATURATION)
    light[:, 300:] = 100 * SATURATION
    exposed = expose_image(light.astype(np.float32), camera, noisy, create_generator("isp"))
    assert exposed.raw is not None
    denoised = develop_raw(
        exposed.raw,
        camera.model_copy(update={"isp": Isp(denoise=fraction, sharpening=0)}),
        exposed.readout,
    )
    # Where the filter is red, red is not interpolated.
    red = [image[::2, :290:2, 0].astype(float) for image in (exposed.image, denoised)]
    # Without the variance that rounding to 8 bits adds.
    before, after = (np.sqrt(values.var() - 1 / 12) for values in red)
    kept = 1 - fraction
    expected = np.sqrt(kept**2 + (fraction**2 + 2 * kept * fraction) / 25)
    assert after / before == pytest.approx(expected, rel=0.05)


def test_denoising_leaves_edges() -> None:
    light = fill((32, 16), [0.05] * 3, [0.5] * 3)
    images = [process(light, {"denoise": x, "sharpening": 0}, noise=False) for x in (0, 0.9)]
    assert np.abs(images[0].astype(int) - images[1]).max() <= 1


@pytest.mark.parametrize("overshoot", [0.1, 0.25, 0.5])
def test_sharpening_overshoots_an_edge_by_its_fraction(overshoot: float) -> None:
    # Of green alone, whose edges along rows demosaicing leaves sharp.
    light = fill((32, 16), [0, 0.05, 0], [0, 0.3, 0]).transpose(1, 0, 2)
    without, sharpened = (
        luma(process(light, {"denoise": 0, "sharpening": x}, noise=False)) for x in (0, overshoot)
    )
    height = without[20, 10] - without[10, 10]
    assert sharpened[16, 10] - without[16, 10] == pytest.approx(overshoot * height, abs=0.6)
    np.testing.assert_array_equal(sharpened[18:-2], without[18:-2])


@pytest.mark.parametrize("quality", [20, 90])
def test_compression_is_that_of_opencv(quality: int) -> None:
    light = ramp(2.0)
    image = cv2.cvtColor(process(light, {}), cv2.COLOR_RGB2BGR)
    _, encoded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    expected: Any = cv2.imdecode(encoded, cv2.IMREAD_COLOR_RGB)
    np.testing.assert_array_equal(process(light, {"jpeg_quality": quality}), expected)


@pytest.mark.parametrize(
    "raw",
    [
        {"pattern": "grbg", "bits": 12, "black_level": 64},
        {"pattern": "bggr", "bits": 16, "black_level": 512, "highlights_ev": 4},
    ],
)
def test_the_raw_image_gives_the_image(raw: dict[str, Any]) -> None:
    said: dict[str, Any] = {"raw": RawOutput.model_validate(raw), "isp": Isp(jpeg_quality=80)}
    exposed = expose(ramp(6.0), combined_exposures=3, **said)
    assert exposed.raw is not None
    camera = Camera(width_px=128, height_px=64, mounts=(Mount(),), combined_exposures=3, **said)
    np.testing.assert_array_equal(develop_raw(exposed.raw, camera, exposed.readout), exposed.image)


def test_an_image_is_the_same_without_the_fast_instructions_of_opencv() -> None:
    isp = {"jpeg_quality": 70}
    expected = process(ramp(3.0), isp)
    cv2.setUseOptimized(False)
    try:
        np.testing.assert_array_equal(process(ramp(3.0), isp), expected)
    finally:
        cv2.setUseOptimized(True)


def test_a_sensor_without_highlights_is_white_where_it_is_full() -> None:
    image = process(ramp(3.0), {}, highlights_ev=0, noise=False)
    assert (image[:, -20:] == 255).all()
    assert (image[:, :4] < 100).all()


def test_raw_values_with_highlights_have_the_noise_of_their_exposures() -> None:
    raw = RawOutput(bits=16, black_level=1024, highlights_ev=4)
    for level, ratio in ((0.5, 1), (3.0, 4), (12.0, 16)):
        light = np.full((200, 300, 3), level * SATURATION)
        exposed = expose(light, raw=raw, combined_exposures=3)
        assert exposed.raw is not None
        electrons = exposed.readout.count_electrons(exposed.raw, raw).astype(np.float64)
        assert electrons.mean() == pytest.approx(10_000 * level, rel=2e-3)
        assert electrons.var() == pytest.approx(ratio * 10_000 * level + 9 * ratio**2, rel=0.02)


def test_raw_highlights_are_those_of_the_sensor() -> None:
    with pytest.raises(ValidationError, match="more than the sensor resolves, 2"):
        Camera(mounts=(Mount(),), highlights_ev=2, raw=RawOutput(highlights_ev=4))


def test_a_linear_image_changes_nothing_in_the_image_of_an_isp() -> None:
    np.testing.assert_array_equal(process(ramp(2.0), {}), process(ramp(2.0), {}, hdr=True))
