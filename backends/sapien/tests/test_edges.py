"""Edges in large images of the raster pack, which draws their surfaces again in tiles."""

import itertools

import numpy as np
import pytest
from advercity_sapien import SapienBackend, edges
from advercity_sapien.culling import PixelRect, compute_view_frustum
from advercity_sapien.edges import cut_into_tiles

from advercity.geometry.arrays import Float64Array
from advercity.geometry.poses import pose_matrix
from advercity.rendering.backend import CameraCapture, RenderProfile
from advercity.semantics import Semantic
from advercity.world import World
from tests.box_scenes import air_of, frame_of, luminance, state, uniform, view_of, world_of
from tests.render_builders import build_box

LARGE = (1920, 1080)
PROFILE = RenderProfile("test", 1.0, "raster")


def photograph(world: World, camera: Float64Array) -> CameraCapture:
    with SapienBackend().open(world, air_of(sky=uniform(1000.0)), PROFILE) as renderer:
        renderer.place(frame_of(state(7, (10.0, 0.0, 0.0))))
        return renderer.render_camera(view_of(camera, size=LARGE, hide=7))


@pytest.mark.render
@pytest.mark.usefixtures("ideal_surfaces")
def test_pixels_on_an_edge_show_both_sides_and_are_labelled_by_their_middles() -> None:
    wall = build_box((11.0, 0.0, -29.0), (1.0, 400.0, 60.0), "black", Semantic.WALL)
    seen = photograph(world_of(wall), pose_matrix((0.0, 0.0, 1.0), roll=0.3))
    # Five places along each axis of a pixel; the third is its middle.
    column, row = np.meshgrid((np.arange(9600) + 0.5) / 5.0, (np.arange(5400) + 0.5) / 5.0)
    is_sky = (row - 540.0) * np.cos(0.3) < (960.0 - column) * np.sin(0.3)
    covered = is_sky.reshape(1080, 5, 1920, 5).mean(axis=(1, 3))
    light = luminance(seen) / 1000.0
    np.testing.assert_allclose(light, covered, atol=0.35)
    edge = (covered > 0.0) & (covered < 1.0)
    assert np.abs(light - covered)[edge].mean() < 0.1
    assert light.mean() == pytest.approx(covered.mean(), rel=1e-3)
    is_wall = seen.semantic == Semantic.WALL
    assert np.mean(is_wall != ~is_sky[2::5, 2::5]) < 1e-5
    assert np.array_equal(is_wall, np.isfinite(seen.depth))
    assert np.unique(seen.semantic[~is_wall]).size == 1


@pytest.mark.render
@pytest.mark.usefixtures("ideal_surfaces")
def test_a_wire_of_half_a_pixel_is_not_broken_in_a_large_image() -> None:
    """Focal length 960 px: 0.5 px at 10 m are 5.2 mm."""
    wire = build_box((10.0, 0.0, 1.0), (0.005, 60.0, 0.0052), "black")
    seen = photograph(world_of(wire), pose_matrix((0.0, 0.0, 1.0), roll=0.1))
    missing = (1.0 - luminance(seen) / 1000.0).sum(axis=0)
    assert missing.mean() == pytest.approx(0.5 / np.cos(0.1), rel=0.1)
    assert missing.min() > 0.1


@pytest.mark.render
@pytest.mark.usefixtures("ideal_surfaces")
def test_images_do_not_show_where_tiles_meet(monkeypatch: pytest.MonkeyPatch) -> None:
    posts = [build_box((10.0, y, 0.0), (0.02, 0.02, 9.0), "grey") for y in np.arange(-9, 9, 0.35)]
    camera = pose_matrix((0.0, 0.0, 1.0), roll=0.2)
    one = photograph(world_of(*posts), camera)
    monkeypatch.setattr(edges, "MAX_TILE_PX", 400 * 300)
    other = photograph(world_of(*posts), camera)
    difference = np.abs(luminance(one) - luminance(other)) / 1000.0
    starts = np.array([tile.left_px for tile in cut_into_tiles(*LARGE) if tile.left_px > 0])
    seams = (starts[:, None] + np.arange(-edges.MARGIN_PX, 4 * edges.MARGIN_PX)).ravel()
    # Samples on the very edge of a post may fall to either side, near seams as often as elsewhere.
    assert difference.mean() < 1e-4
    assert difference[:, seams].mean() < 2.0 * difference.mean()


@pytest.mark.render
@pytest.mark.usefixtures("ideal_surfaces")
@pytest.mark.parametrize("size", [(96, 54), LARGE])
def test_an_image_is_the_same_after_one_of_panes_elsewhere(size: tuple[int, int]) -> None:
    ahead = [
        build_box((10.0, y, 0.0), (0.01, 0.2, 9.0), "glass", Semantic.VEHICLE)
        for y in np.arange(-9, 9, 0.5)
    ]
    behind = [build_box((-10.0, y, 0.0), (0.02, 0.1, 9.0), "grey") for y in np.arange(-9, 9, 0.3)]
    views = [
        view_of(pose_matrix((0.0, 0.0, 1.0), yaw=yaw, roll=0.1), size=size) for yaw in (0.0, np.pi)
    ]
    world = world_of(*ahead, *behind)
    # Light varies from pixel to pixel: even light would not show which pixels are mixed.
    air = air_of(sky=lambda sine: 1000.0 * (1.0 + sine))
    with SapienBackend().open(world, air, PROFILE) as renderer:
        renderer.place(frame_of())
        before, _, after = (renderer.render_camera(views[index]) for index in (1, 0, 1))
    assert np.array_equal(before.radiance, after.radiance)
    assert np.array_equal(before.instance, after.instance)


@pytest.mark.parametrize("size", [(1920, 1080), (961, 541), (3001, 517), (1280, 960)])
def test_tiles_of_one_size_cover_an_image_and_overlap_by_margins(size: tuple[int, int]) -> None:
    tiles = list(cut_into_tiles(*size))
    assert len({(tile.width_px, tile.height_px) for tile in tiles}) == 1
    for length, starts, extent in (
        (size[0], {tile.left_px for tile in tiles}, tiles[0].width_px),
        (size[1], {tile.top_px for tile in tiles}, tiles[0].height_px),
    ):
        assert min(starts) == 0
        assert max(starts) + extent == length
        for one, other in itertools.pairwise(sorted(starts)):
            assert other + 2 * edges.MARGIN_PX <= one + extent


def test_a_part_of_an_image_sees_what_is_in_it() -> None:
    view = view_of(pose_matrix((0.0, 0.0, 0.0)), size=(200, 100))
    upper_left = compute_view_frustum(view, PixelRect(0, 0, 100, 50))
    # x forward, y left, z up; the image shows 10 m to the left and 5 m up at 10 m.
    points = np.array(
        [(10, 9, 4), (10, -1, 4), (10, 9, -1), (10, 11, 4), (10, 9, 6), (-10, -9, -4)]
    )
    seen = upper_left.may_intersect(points.astype(float), np.zeros((6, 3)))
    assert seen.tolist() == [True, False, False, False, False, False]
