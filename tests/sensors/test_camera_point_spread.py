"""Blur by the lens against the second moments that a rig declares."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from advercity_dsl import Camera, Mount, PointSpread
from pydantic import ValidationError

from advercity.compiler import find_weather
from advercity.physics.atmosphere import compute_atmosphere
from advercity.randomness import create_generator
from advercity.rendering.backend import CameraView
from advercity.sensors.camera import CameraConditions, CameraExposure, render_image
from advercity.sensors.camera.point_spread import spread_points
from advercity.testing import make_capture, make_frame

HEIGHT, WIDTH, FOCAL_PX = 180, 320, 250.0
SPREAD = PointSpread(centre_mrad=1.2, corner_mrad=10.0)
"""0.3 pixels in the middle, 2.5 in the corners."""


@pytest.mark.parametrize(
    ("column", "row"), [(160, 90), (220, 90), (160, 160), (280, 40), (300, 20)]
)
def test_a_point_has_the_variance_of_its_place(column: int, row: int) -> None:
    light = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    light[row, column] = (5.0, 2.0, 1.0)
    image = spread_points(light, SPREAD, FOCAL_PX)
    np.testing.assert_allclose(image.sum(axis=(0, 1)), (5.0, 2.0, 1.0), rtol=2e-3)
    field = math.hypot(column + 0.5 - 160, row + 0.5 - 90) / math.hypot(160, 90)
    expected = 0.3**2 + (2.5**2 - 0.3**2) * field**4
    for axis, middle in ((0, column), (1, row)):
        profile = image[..., 0].sum(axis=axis) / image[..., 0].sum()
        off = np.arange(len(profile)) - middle
        # The width grows across the point itself, in so small an image.
        assert (profile * off).sum() == pytest.approx(0.0, abs=0.1)
        assert (profile * off**2).sum() == pytest.approx(expected, rel=0.02)


def test_a_blur_that_is_even_over_the_image_is_that_of_opencv() -> None:
    light = np.zeros((81, 81, 3), np.float32)
    light[40, 40] = 1.0
    image = spread_points(light, PointSpread(centre_mrad=20.0, corner_mrad=20.0), 250.0)
    np.testing.assert_allclose(
        image, cv2.GaussianBlur(light, (0, 0), 5.0), atol=0.015 * image.max()
    )


def test_even_light_stays_even() -> None:
    light = np.full((HEIGHT, WIDTH, 3), 7.0, np.float32)
    np.testing.assert_allclose(spread_points(light, SPREAD, FOCAL_PX), light, rtol=1e-6)


def test_edges_in_images_are_wider_in_the_corners() -> None:
    bars = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    bars[:, (np.arange(WIDTH) // 20) % 2 == 0] = 2000.0
    seen = replace(make_capture(WIDTH, HEIGHT), radiance=bars)
    fov_deg = 2 * math.degrees(math.atan(WIDTH / 2 / FOCAL_PX))
    view = CameraView(np.eye(4), WIDTH, HEIGHT, math.radians(fov_deg))
    weather = find_weather("clear_day").declaration
    conditions = CameraConditions.build(compute_atmosphere(weather, "urban"), weather.lens, "test")

    def measure_steepness(spread: PointSpread | None, place: tuple[slice, slice]) -> float:
        camera = Camera(
            width_px=WIDTH, height_px=HEIGHT, mounts=(Mount(),), noise=False, point_spread=spread
        )
        exposure = CameraExposure(view, camera, make_frame(), np.zeros(3))
        rng = create_generator("test")
        image = render_image(seen, exposure, conditions, rng, mount=Mount()).image
        return float(np.abs(np.diff(image[place].astype(float), axis=1)).max())

    middle, corner = (slice(80, 100), slice(130, 190)), (slice(0, 20), slice(0, 60))
    assert measure_steepness(SPREAD, middle) > 1.5 * measure_steepness(SPREAD, corner)
    assert measure_steepness(None, middle) < 1.2 * measure_steepness(None, corner)


def test_a_blur_of_a_point_over_too_many_pixels_is_refused() -> None:
    tele = {"horizontal_fov_deg": 10.0, "mounts": (Mount(),)}
    assert Camera.model_validate(tele | {"point_spread": {"corner_mrad": 2.7}}).focal_px > 10_000
    with pytest.raises(ValidationError, match="more than 30 pixels"):
        Camera.model_validate(tele | {"point_spread": {"corner_mrad": 2.8}})
    with pytest.raises(ValidationError, match="less than `centre_mrad`"):
        PointSpread(centre_mrad=1.0)
