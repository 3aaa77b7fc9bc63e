"""Images of materials: in place, to scale, averaged far away, without effect on the mean."""

from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from advercity_sapien import SapienBackend
from advercity_sapien.material_textures import drop_unseen_detail
from numpy.typing import NDArray

from advercity.frames import Actor, ActorState, Frame, Lamp
from advercity.geometry.mesh import Mesh
from advercity.geometry.poses import pose_matrix
from advercity.material_maps import MaterialMaps
from advercity.materials import MATERIALS
from advercity.physics.atmosphere import Atmosphere
from advercity.rendering.backend import CameraView, RenderProfile
from advercity.semantics import Semantic
from advercity.world import Body, World
from tests.render_builders import PACKS, build_clear_air

pytestmark = pytest.mark.render

Renderer = Literal["raster", "ray_traced"]
every_renderer = pytest.mark.parametrize("renderer", PACKS)
SIDE = 128
QUARTERS = np.array([[20, 90], [160, 230]], dtype=np.uint8)
"""Greys of the quarters of an image, the northern ones first."""
TRIANGLES = np.array([(0, 1, 2), (0, 2, 3)], dtype=np.int32)
CORNERS = np.array([(-400, -400, 0), (400, -400, 0), (400, 400, 0), (-400, 400, 0)], np.float32)


def quartered(tile_m: float) -> MaterialMaps:
    grey = np.kron(QUARTERS, np.ones((SIDE // 2, SIDE // 2), dtype=np.uint8))
    return MaterialMaps(np.repeat(grey[..., None], 3, axis=2), None, None, tile_m)


def speckled() -> MaterialMaps:
    rng = np.random.default_rng(3)
    color = rng.integers(40, 220, (SIDE, SIDE, 3), dtype=np.uint8)
    normal = rng.integers(108, 148, (SIDE, SIDE, 3), dtype=np.uint8)
    return MaterialMaps(color, normal, rng.integers(100, 200, (SIDE, SIDE), dtype=np.uint8), 2.0)


def light(byte: int) -> float:
    """Linear light of a byte of sRGB (IEC 61966-2-1)."""
    return ((byte / 255 + 0.055) / 1.055) ** 2.4


def field(name: str, maps: MaterialMaps) -> World:
    """A patch of a material, 800 m wide."""
    mesh = Mesh("field", CORNERS, TRIANGLES, name, Semantic.STATIC)
    found = {MATERIALS[name].maps: maps}
    return World("field", (mesh,), {}, lanes=(), network=Path("none"), material_maps=found)


def sun_from_the_east(elevation_deg: float = 45.0) -> Atmosphere:
    """Clear air under a black sky."""
    elevation = np.radians(elevation_deg)
    direction = np.array([np.cos(elevation), 0.0, np.sin(elevation)])
    black = np.full((6, 32, 32, 3), 1e-3, dtype=np.float32)
    return build_clear_air(sun_direction=direction, sun_lx=80_000.0, sky_lx=1e-3, sky=black)


def seen(
    world: World,
    places: NDArray[np.float64],
    renderer: Renderer = "raster",
    air: Atmosphere | None = None,
    *,
    pitch_deg: float = 90.0,
    scale: float = 1.0,
    states: tuple[ActorState, ...] = (),
) -> NDArray[np.float64]:
    """Radiance (n, h, w, 3) in kcd/m², looking down from places (n, 3), the north on the left."""
    profile = RenderProfile("test", scale, renderer, samples=1, path_depth=1)
    pictures: list[NDArray[np.float32]] = []
    with SapienBackend().open(world, air or build_clear_air(1000.0), profile) as opened:
        opened.place(Frame(index=0, time_s=0.0, states=states, signals={}))
        for place in places:
            world_from_camera = pose_matrix(tuple(place), pitch=np.radians(pitch_deg))
            view = CameraView(world_from_camera, 72, 48, np.radians(60))
            pictures.append(opened.render_camera(view).radiance)
    return np.stack(pictures).astype(np.float64) / 1000.0


def scattered(height_m: float, count: int = 60) -> NDArray[np.float64]:
    x, y = np.random.default_rng(4).uniform(-300, 300, (2, count))
    return np.column_stack([x, y, np.full(count, height_m)])


@every_renderer
def test_a_quarter_of_an_image_lies_where_it_belongs(renderer: Renderer) -> None:
    # Images of 2 m begin at the world's origin, and their rows run southwards.
    middles = np.array([(100.5, 51.5), (101.5, 51.5), (100.5, 50.5), (101.5, 50.5)])
    places = np.column_stack([middles, np.full(4, 0.3)])
    found = seen(field("brick", quartered(2.0)), places, renderer).mean(axis=(1, 2, 3))
    tones = np.array([light(int(byte)) for byte in QUARTERS.ravel()])
    # Variation over metres is not in the images. Texels have bytes of the brightest one.
    byte = tones.max() / 255 / tones.mean()
    np.testing.assert_allclose(found / found.mean(), tones / tones.mean(), rtol=0.03, atol=byte / 2)


@every_renderer
def test_relief_turns_a_surface_towards_the_sun(renderer: Renderer) -> None:
    even = quartered(2.0)
    even = replace(even, color=np.full_like(even.color, 128))
    normal = np.zeros((SIDE, SIDE, 3), dtype=np.uint8)
    # 30 degrees to the east: x is sin 30 = 0.5.
    normal[..., 0], normal[..., 1] = round(255 * 0.75), 128
    flat, tilted = (
        seen(field("brick", maps), scattered(1.0, 2), renderer, sun_from_the_east()).mean()
        for maps in (even, replace(even, normal=normal))
    )
    assert tilted / flat == pytest.approx(np.cos(np.radians(15)) / np.cos(np.radians(45)), rel=0.02)


@every_renderer
def test_relief_that_is_too_fine_to_be_seen_tilts_nothing(renderer: Renderer) -> None:
    grazing = sun_from_the_east(elevation_deg=3.0)
    bumpy = speckled()
    even, seen_from_afar = (
        seen(field("asphalt", maps), scattered(40.0, 2), renderer, grazing).mean()
        for maps in (replace(bumpy, normal=None), bumpy)
    )
    assert seen_from_afar == pytest.approx(even, rel=0.05)


@pytest.mark.parametrize("name", ["asphalt", "brick"])
def test_images_leave_the_mean_of_their_material_alone(name: str) -> None:
    places = np.concatenate([scattered(2.0), scattered(60.0)])
    near, far = np.split(seen(field(name, speckled()), places).mean(axis=(1, 2)), 2)
    np.testing.assert_allclose(near.mean(axis=0), MATERIALS[name].albedo, rtol=0.03)
    np.testing.assert_allclose(far.mean(axis=0), MATERIALS[name].albedo, rtol=0.03)


def test_what_moves_has_images_by_coordinates_of_its_own_alone() -> None:
    dark = np.tile(np.array([[0.5, 1.5]], dtype=np.float32), (4, 1))
    bare = Mesh("plate", CORNERS / np.float32(400), TRIANGLES, "brick", Semantic.VEHICLE)
    bodies = {
        "bare": Body((bare,), (2.0, 2.0, 0.1)),
        "own": Body((replace(bare, uv=dark),), (2.0, 2.0, 0.1)),
    }
    world = replace(field("brick", quartered(2.0)), static=(), bodies=bodies)
    states = tuple(
        ActorState(
            Actor(number, "car", name, "", (2.0, 2.0, 0.1)),
            pose_matrix((4.5 * number, 1.5, 0.0)),
            speed_m_s=0.0,
            acceleration_m_s2=0.0,
            lamps=Lamp(0),
        )
        for number, name in enumerate(bodies, start=1)
    )
    places = np.array([(4.5, 1.5, 0.5), (9.0, 1.5, 0.5)])
    bare_tone, own_tone = seen(world, places, states=states).mean(axis=(1, 2, 3))
    mean = np.mean(MATERIALS["brick"].albedo)
    assert bare_tone / mean == pytest.approx(1.0, abs=0.3)
    tones = np.array([light(int(byte)) for byte in QUARTERS.ravel()])
    assert own_tone / bare_tone == pytest.approx(tones[0] / tones.mean(), rel=0.4)


@pytest.mark.parametrize("name", ["asphalt", "brick"])
def test_both_renderers_show_the_same_images(name: str) -> None:
    world, place = field(name, speckled()), np.array([(3.0, 4.0, 1.5)])
    raster, traced = (seen(world, place, kind, pitch_deg=40.0) for kind in ("raster", "ray_traced"))
    # One ray of light from a uniform sky carries its mean.
    # Both interpolate in bytes, at places differing in the last bits.
    np.testing.assert_allclose(traced, raster, rtol=0.03, atol=0.03 * raster.mean())


def test_grains_do_not_repeat_where_courses_of_bricks_do() -> None:
    places = np.array([(40.0, 40.0, 0.5), (42.0, 40.0, 0.5)])
    alike = {
        name: np.corrcoef(*(view.ravel() for view in seen(field(name, speckled()), places)))[0, 1]
        for name in ("asphalt", "brick")
    }
    assert alike["brick"] > 0.99
    assert abs(alike["asphalt"]) < 0.3


@pytest.mark.parametrize("name", ["asphalt", "brick"])
def test_detail_that_small_images_do_not_show_is_missed_in_none(name: str) -> None:
    # At a fiftieth of its size an image has pixels of 0.05 m a metre away, three texels here.
    world, places = field(name, speckled()), scattered(4.0, 4)
    full, small = (seen(world, places, scale=scale) for scale in (1.0, 0.02))
    # Bytes are rounded at every halving.
    deviation = np.abs(small / full - 1.0).mean()
    assert 0.0 < deviation < 0.01


@pytest.mark.parametrize(
    ("finest_m", "side"), [(0.0, 1024), (0.001, 1024), (0.003, 1024), (0.004, 512)]
)
def test_texels_are_as_fine_as_images_show(finest_m: float, side: int) -> None:
    texels = np.random.default_rng(5).integers(-127, 128, (1024, 1024, 2)).astype(np.int8)
    kept = drop_unseen_detail(texels, tile_m=2.0, finest_m=finest_m)
    assert (kept.shape, kept.dtype) == ((side, side, 2), np.int8)
    assert kept.mean() == pytest.approx(texels.mean(), abs=0.01)


@pytest.mark.parametrize("name", ["asphalt", "brick"])
def test_images_do_not_flicker_as_the_camera_moves_by_a_tenth_of_a_pixel(name: str) -> None:
    places = np.array([(0, 0, 1.6), (0, 0.002, 1.6)])
    first, second = seen(field(name, speckled()), places, pitch_deg=20.0)
    assert np.abs(first - second).mean() / first.mean() < 0.04
