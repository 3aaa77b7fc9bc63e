"""Lenses against OpenCV's projection, which is written independently of this one."""

import math

import numpy as np
import pytest
from advercity_dsl import Camera, Mount
from advercity_dsl.lens import BrownConradyLens, CameraLens, KannalaBrandtLens
from numpy.typing import NDArray

from advercity.geometry.arrays import Float64Array
from advercity.sensors.camera.lens_map import LensMap, build_lens_map
from advercity.sensors.camera_model import CameraModel
from tests.sensors.opencv_lens import project_points

BARREL = BrownConradyLens(model="brown_conrady", k1=-0.3, k2=0.12, p1=0.0008, p2=-0.0011, k3=-0.02)
PINCUSHION = BrownConradyLens(model="brown_conrady", k1=0.1)
FISHEYE = KannalaBrandtLens(model="kannala_brandt", k1=-0.02, k2=0.004, k3=-0.001, k4=0.0002)
WIDTH, HEIGHT = 320, 200
LENSES = [(BARREL, 80.0), (PINCUSHION, 60.0), (FISHEYE, 110.0)]


def model_of(lens: CameraLens, fov_deg: float) -> CameraModel:
    camera = Camera(
        width_px=WIDTH,
        height_px=HEIGHT,
        horizontal_fov_deg=fov_deg,
        lens=lens,
        mounts=(Mount(),),
    )
    return CameraModel.build(camera, WIDTH, HEIGHT)


def rays_in(model: CameraModel, count: int = 5000) -> Float64Array:
    """Rays (n, 3) through the image, of any length."""
    rng = np.random.default_rng(1)
    pixels = model.undistort(rng.random((count, 2)) * (model.width_px, model.height_px))
    column, row = ((pixels - (model.width_px / 2, model.height_px / 2)) / model.focal_px).T
    return np.stack([np.ones(count), -column, -row], axis=1) * rng.uniform(1, 50, (count, 1))


@pytest.mark.parametrize(("lens", "fov_deg"), LENSES)
def test_points_are_where_opencv_projects_them(lens: CameraLens, fov_deg: float) -> None:
    model = model_of(lens, fov_deg)
    points = rays_in(model)
    expected = project_points(model, lens, points)
    np.testing.assert_allclose(model.pixels_from_camera(points), expected, atol=1e-3)
    # The rays were chosen by the inverse: they are in the image, and fill it.
    assert (expected > -1e-2).all()
    assert (expected < (WIDTH + 1e-2, HEIGHT + 1e-2)).all()
    np.testing.assert_allclose(expected.max(axis=0), (WIDTH, HEIGHT), atol=1)


@pytest.mark.parametrize(("lens", "fov_deg"), LENSES)
def test_the_width_spans_the_declared_angle(lens: CameraLens, fov_deg: float) -> None:
    model = model_of(lens, fov_deg)
    half = math.radians(fov_deg / 2)
    sides = np.array([[math.cos(half), side * math.sin(half), 0.0] for side in (1, -1)])
    columns = project_points(model, lens, sides)[:, 0]
    assert columns[1] - columns[0] == pytest.approx(WIDTH, abs=1e-3)


@pytest.mark.parametrize(("lens", "fov_deg"), LENSES)
def test_what_is_outside_the_image_never_folds_back_into_it(
    lens: CameraLens, fov_deg: float
) -> None:
    model = model_of(lens, fov_deg)
    off, around = np.meshgrid(np.linspace(76, 89.9, 30), np.linspace(0, 360, 73))
    off, around = np.deg2rad(off.ravel()), np.deg2rad(around.ravel())
    rays = np.stack([np.cos(off), np.sin(off) * np.cos(around), np.sin(off) * np.sin(around)], 1)
    pixels = model.pixels_from_camera(rays)
    inside = (pixels > 0) & (pixels < (WIDTH, HEIGHT))
    assert not inside.all(axis=1).any()


@pytest.mark.parametrize(("lens", "fov_deg"), LENSES)
def test_the_rendered_plane_just_covers_the_image(lens: CameraLens, fov_deg: float) -> None:
    model = model_of(lens, fov_deg)
    points = rays_in(model, 100_000)
    reach_px = np.abs(points[:, 1:] / points[:, :1] * model.focal_px).max(axis=0)
    half = np.array(model.rendered_size) / 2
    assert (half >= reach_px).all()
    assert (half < reach_px + (0.02 * half + 3)).all()


def map_of(model: CameraModel) -> LensMap:
    found = build_lens_map(model)
    assert found is not None
    return found


def draw_wall_edge(model: CameraModel, left: float) -> NDArray[np.float32]:
    """Draw the rendered plane: white to the right of a vertical edge 1 ahead and `left` left."""
    width, height = model.rendered_size
    edge_px = width / 2 - left * model.focal_px
    cover = np.clip(np.arange(width) + 1 - edge_px, 0, 1)
    return np.broadcast_to(cover[None, :, None], (height, width, 3)).astype(np.float32)


@pytest.mark.parametrize(("lens", "fov_deg"), LENSES)
def test_the_edge_of_a_wall_is_curved_as_opencv_predicts(lens: CameraLens, fov_deg: float) -> None:
    model = model_of(lens, fov_deg)
    left = 0.8 * math.tan(math.radians(fov_deg / 2))
    image = map_of(model).average(draw_wall_edge(model, left))[..., 0]
    # In each row, all is dark left of the edge: the sum is the distance to it.
    found = WIDTH - image.sum(axis=1)
    up = np.linspace(-1, 1, 4001) * HEIGHT / model.focal_px * 1.5
    line = np.stack([np.ones_like(up), np.full_like(up, left), up], axis=1)
    pixels = project_points(model, lens, line)
    order = np.argsort(pixels[:, 1])
    expected = np.interp(np.arange(HEIGHT) + 0.5, pixels[order, 1], pixels[order, 0])
    np.testing.assert_allclose(found, expected, atol=0.15)
    assert np.ptp(expected) > 1.5


def test_light_is_averaged_over_what_a_pixel_sees() -> None:
    """Near the corners of a fisheye a pixel covers many of the plane: stripes become grey."""
    model = model_of(FISHEYE, 110.0)
    width, height = model.rendered_size
    stripes = np.zeros((height, width, 3), np.float32)
    stripes[:, ::2] = 1
    image = map_of(model).average(stripes)[..., 0]
    assert np.std(image[:20, :20]) < 0.1
    assert np.std(image[HEIGHT // 2 - 10 :, WIDTH // 2 - 10 :][:20, :20]) > 0.2


def test_a_camera_without_lens_is_a_pinhole() -> None:
    camera = Camera(horizontal_fov_deg=90, mounts=(Mount(),))
    model = CameraModel.build(camera, 200, 100)
    assert model.rendered_size == (200, 100)
    assert build_lens_map(model) is None
    pixels = model.pixels_from_camera(np.array([[2.0, 1.0, -1.0]]))
    np.testing.assert_allclose(pixels, [[50, 100]])
