"""Textures of materials: visible up close, averaged far away, without effect on the mean."""

from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from advercity_sapien import SapienBackend
from numpy.typing import NDArray

from advercity.frames import Frame
from advercity.geometry.mesh import Mesh
from advercity.geometry.poses import pose_matrix
from advercity.materials import MATERIALS, Texture
from advercity.rendering.backend import CameraView, RenderProfile
from advercity.semantics import Semantic
from advercity.world import World
from tests.render_builders import build_clear_air

pytestmark = pytest.mark.render

TEXTURED = {
    material.texture: name
    for name, material in MATERIALS.items()
    # Rooms are no pattern: their visible part depends on the ray.
    if material.texture not in (Texture.PLAIN, Texture.ROOM, Texture.SHOP)
}
every_texture = pytest.mark.parametrize("name", TEXTURED.values())


def field(name: str) -> World:
    """A patch of a material, 800 m wide."""
    corners = np.array([(-400, -400, 0), (400, -400, 0), (400, 400, 0), (-400, 400, 0)])
    triangles = np.array([(0, 1, 2), (0, 2, 3)], dtype=np.int32)
    mesh = Mesh("field", corners.astype(np.float32), triangles, name, Semantic.STATIC)
    return World("field", (mesh,), {}, lanes=(), network=Path("none"))


def seen_from(
    name: str,
    places: NDArray[np.float64],
    renderer: Literal["raster", "ray_traced"] = "raster",
    *,
    pitch_deg: float = 90.0,
) -> NDArray[np.float64]:
    """Radiance (n, h, w, 3) over the sky's, looking down on a material from places (n, 3)."""
    profile = RenderProfile("test", 1.0, renderer, samples=1, path_depth=1)
    pictures: list[NDArray[np.float32]] = []
    with SapienBackend().open(field(name), build_clear_air(1000.0), profile) as opened:
        opened.place(Frame(index=0, time_s=0.0, states=(), signals={}))
        for place in places:
            world_from_camera = pose_matrix(tuple(place), pitch=np.radians(pitch_deg))
            view = CameraView(world_from_camera, 72, 48, np.radians(60))
            pictures.append(opened.render_camera(view).radiance)
    return np.stack(pictures).astype(np.float64) / 1000.0


def scattered(height_m: float, rows: int) -> NDArray[np.float64]:
    """Places (rows * rows, 3), one at random in each square of the field."""
    reach = 390 - 0.7 * height_m
    squares = np.indices((rows, rows)).reshape(2, -1)
    within = np.random.default_rng(4).random(squares.shape)
    x, y = ((squares + within) / rows * 2 - 1) * reach
    return np.column_stack([x, y, np.full(x.size, height_m)])


@every_texture
# Close by, a picture shows one spot of patterns as wide as 31 m: their mean takes many.
@pytest.mark.parametrize(("height_m", "rows"), [(2.0, 26), (60.0, 10)])
def test_a_texture_leaves_the_mean_of_its_material_alone(name: str, height_m: float, rows: int):
    mean = seen_from(name, scattered(height_m, rows)).mean(axis=(0, 1, 2))
    # The sky is below, too, and shines through leaves.
    through = 0.4 if MATERIALS[name].texture is Texture.LEAVES else 0.0
    expected = np.multiply(MATERIALS[name].albedo, 1.0 + through)
    np.testing.assert_allclose(mean, expected, rtol=0.03)


@every_texture
def test_a_texture_shows_from_close_by_and_fades_far_away(name: str):
    near, far = (seen_from(name, scattered(height, 3)) for height in (1.0, 250.0))
    assert (near.std(axis=(1, 2)) / near.mean()).mean() > 0.03
    step = np.abs(np.diff(far, axis=2)).mean() / far.mean()
    assert step < 0.02


@every_texture
def test_a_texture_does_not_flicker_as_the_camera_moves_by_a_tenth_of_a_pixel(name: str):
    places = np.array([(0, 0, 1.6), (0, 0.002, 1.6)])
    first, second = seen_from(name, places, pitch_deg=20.0)
    assert np.abs(first - second).mean() / first.mean() < 0.04


@pytest.mark.parametrize("name", ["asphalt", "brick"])
def test_both_renderers_show_the_same_texture(name: str):
    place = np.array([(3.0, 4.0, 1.5)])
    raster, traced = (seen_from(name, place, kind)[0] for kind in ("raster", "ray_traced"))
    # One ray of light from a uniform sky carries its mean.
    np.testing.assert_allclose(traced, raster, rtol=0.02)


def test_the_same_place_looks_the_same_every_time():
    first, second = (seen_from("grass", scattered(2.0, 2)) for _ in range(2))
    np.testing.assert_array_equal(first, second)
