"""Light of sun and sky on surfaces, with both shader packs."""

import numpy as np
import pytest
from advercity_sapien import SapienBackend

from advercity.geometry.mesh import Mesh
from advercity.geometry.poses import pose_matrix
from advercity.physics.atmosphere import Atmosphere
from advercity.rendering.backend import CameraView, RenderProfile
from advercity.semantics import Semantic
from advercity.world import World
from tests.box_scenes import (
    Floats,
    Open,
    air_of,
    centre,
    frame_of,
    luminance,
    uniform,
    view_of,
    world_of,
)
from tests.render_builders import (
    LUMINANCE,
    build_box,
)

pytestmark = [pytest.mark.render, pytest.mark.usefixtures("ideal_surfaces")]


def test_white_card_has_the_luminance_of_its_illuminance(opened: Open) -> None:
    air = air_of(sky=lambda sine: 2000.0 + 6000.0 * np.abs(sine), sun_lx=8e4, sun_elevation_deg=40)
    card = build_box((0.0, 0.0, -0.5), (200.0, 200.0, 1.0), "white")
    with opened(world_of(card), air, samples=64) as renderer:
        renderer.place(frame_of())
        capture = renderer.render_camera(
            view_of(pose_matrix((0, 0, 5), pitch=np.pi / 2), size=(24, 16))
        )
    expected = (8e4 * np.sin(np.radians(40.0)) + air.sky_lx) / np.pi
    assert float(luminance(capture).mean()) == pytest.approx(expected, rel=0.02)


def test_upright_white_card_under_a_uniform_dome_is_as_bright_as_the_dome(opened: Open) -> None:
    card = build_box((11.0, 0.0, 1.0), (2.0, 4.0, 4.0), "white")
    with opened(world_of(card), air_of(sky=uniform(3000.0))) as renderer:
        renderer.place(frame_of())
        capture = renderer.render_camera(view_of())
    assert centre(luminance(capture)) == pytest.approx(3000.0, rel=0.01)


def test_surfaces_in_shadow_have_only_the_light_of_the_sky(opened: Open) -> None:
    ground = build_box((0.0, 0.0, -0.5), (200.0, 200.0, 1.0), "white")
    wall = build_box((5.0, 0.0, 2.0), (1.0, 40.0, 4.0))
    air = air_of(sky=uniform(0.0), sun_lx=5e4)
    with opened(world_of(ground, wall), air) as renderer:
        renderer.place(frame_of())
        above = pose_matrix((7.0, 0.0, 8.0), pitch=np.pi / 2)
        seen = luminance(renderer.render_camera(view_of(above, size=(160, 160))))
    # Image rows run against x, ten pixels a metre: the shadow ends at 5.5 + 4 - 1 = 9.5 m + 0.
    lit, shaded = seen[10, 80], seen[90, 80]
    assert lit == pytest.approx(5e4 * np.sin(np.radians(45.0)) / np.pi, rel=0.01)
    assert shaded == pytest.approx(0.0, abs=1.0)


def test_the_foot_of_a_wall_gets_less_of_the_sky_than_open_ground(opened: Open) -> None:
    ground = build_box((0.0, 0.0, -0.5), (200.0, 200.0, 1.0), "white")
    wall = build_box((7.0, 0.0, 1.5), (1.0, 60.0, 3.0), "black")
    ahead = view_of(pose_matrix((0.0, 0.0, 2.0), pitch=0.3), size=(160, 160))
    with opened(world_of(ground, wall), air_of(sky=uniform(1000.0)), samples=64) as renderer:
        renderer.place(frame_of())
        seen = renderer.render_camera(ahead)
    along = luminance(seen)[:, 60:100].mean(axis=1)
    on_ground = seen.normal[:, 80, 2] > 0.9
    depth = np.where(on_ground, seen.depth[:, 80], 0.0)
    foot = along[depth > depth.max() - 0.3].mean()
    open_ground = along[(depth > 0.0) & (depth < 3.5)].mean()
    assert 0.35 < foot / open_ground < 0.85
    assert open_ground == pytest.approx(1000.0, rel=0.12)


def test_open_ground_and_an_open_wall_hide_nothing_from_themselves() -> None:
    ground = build_box((0.0, 0.0, -0.5), (200.0, 200.0, 1.0), "white")
    profile = RenderProfile("test", 1.0, "raster")
    with SapienBackend().open(world_of(ground), air_of(sky=uniform(1000.0)), profile) as renderer:
        renderer.place(frame_of())
        for pitch in (0.1, 0.5, 1.5):
            seen = renderer.render_camera(view_of(pose_matrix((0.0, 0.0, 1.5), pitch=pitch)))
            lit = luminance(seen)[np.isfinite(seen.depth)]
            np.testing.assert_allclose(lit, 1000.0, rtol=0.01)


def test_wet_asphalt_is_darker_below_and_mirrors_the_sky_ahead(opened: Open) -> None:
    ground = build_box((0.0, 0.0, -0.5), (2000.0, 200.0, 1.0), "asphalt")
    seen: dict[float, Floats] = {}
    for wetness in (0.0, 1.0):
        air = air_of(sky=uniform(1000.0), wetness=wetness)
        with opened(world_of(ground), air, samples=32) as renderer:
            renderer.place(frame_of())
            down = renderer.render_camera(
                view_of(pose_matrix((0, 0, 5), pitch=np.pi / 2), size=(16, 16))
            )
            ahead = renderer.render_camera(view_of(size=(64, 64)))
        seen[wetness] = np.array([luminance(down).mean(), luminance(ahead)[34].mean()])
    assert seen[1.0][0] < 0.9 * seen[0.0][0]
    assert seen[1.0][1] > 2.0 * seen[0.0][1]


def test_leaves_are_seen_from_both_sides(opened: Open) -> None:
    leaf = Mesh(
        "leaf",
        np.array([[5, -1, 0], [5, 1, 0], [5, 0, 2]], dtype=np.float32),
        np.array([[0, 1, 2]], dtype=np.int32),
        "leaves",
        Semantic.VEGETATION,
    )
    with opened(world_of(leaf), air_of(sky=uniform(1000.0))) as renderer:
        renderer.place(frame_of())
        captures = [
            renderer.render_camera(view_of(pose_matrix((x, 0, 1), yaw=yaw)))
            for x, yaw in ((0, 0), (10, np.pi))
        ]
    for capture, x in zip(captures, (-1.0, 1.0), strict=True):
        assert centre(capture.semantic) == Semantic.VEGETATION
        np.testing.assert_allclose(capture.normal[60, 80], [x, 0.0, 0.0], atol=1e-6)


def test_light_comes_through_leaves(opened: Open) -> None:
    leaf = Mesh(
        "leaf",
        np.array([[5, -3, -2], [5, 3, -2], [5, 0, 4]], dtype=np.float32),
        np.array([[0, 1, 2]], dtype=np.int32),
        "leaves",
        Semantic.VEGETATION,
    )
    with opened(world_of(leaf), air_of(sun_lx=5e4, sun_elevation_deg=0.0)) as renderer:
        renderer.place(frame_of())
        before, behind = (
            renderer.render_camera(view_of(pose_matrix((x, 0, 1), yaw=yaw), size=(40, 40)))
            for x, yaw in ((0, 0), (10, np.pi))
        )
    lit, through = (luminance(item)[15:25, 15:25].mean() for item in (before, behind))
    # The albedo of the material, and 0.4 of it.
    assert lit == pytest.approx(5e4 / np.pi * (LUMINANCE @ (0.06, 0.13, 0.03)), rel=0.25)
    assert through == pytest.approx(0.4 * lit, rel=0.05)


@pytest.mark.parametrize("away_m", [10.0, 120.0, 165.0])
def test_the_sun_casts_shadows_nearby_and_far_away(away_m: float) -> None:
    ground = build_box((0.0, 0.0, -0.5), (600.0, 600.0, 1.0), "white")
    wall = build_box((0.0, 0.0, 4.0), (2.0, 60.0, 8.0))
    profile = RenderProfile("test", 1.0, "raster")
    # Its shadow is from 1 m to 9 m behind it.
    poses = [
        pose_matrix((x, -away_m, 30.0), yaw=np.pi / 2, pitch=np.arctan2(30.0, away_m))
        for x in (5.0, 13.0)
    ]
    with SapienBackend().open(world_of(ground, wall), air_of(sun_lx=5e4), profile) as renderer:
        renderer.place(frame_of())
        shaded, lit = (centre(luminance(renderer.render_camera(view_of(at)))) for at in poses)
    assert shaded == pytest.approx(0.0, abs=1.0)
    assert lit == pytest.approx(5e4 * np.sin(np.radians(45.0)) / np.pi, rel=0.01)


def test_the_edge_of_a_shadow_has_no_steps_close_up() -> None:
    ground = build_box((0.0, 0.0, -0.5), (200.0, 200.0, 1.0), "white")
    wall = build_box((5.0, 0.0, 2.0), (1.0, 40.0, 4.0))
    # The shadow ends at 9.5 m; a texel of its map is nine rows of this image.
    above = view_of(pose_matrix((9.5, 0.0, 0.25), pitch=np.pi / 2), size=(160, 160))
    profile = RenderProfile("test", 1.0, "raster")
    with SapienBackend().open(world_of(ground, wall), air_of(sun_lx=5e4), profile) as renderer:
        renderer.place(frame_of())
        across = luminance(renderer.render_camera(above))[:, 80]
    lit = 5e4 * np.sin(np.radians(45.0)) / np.pi
    assert across[[0, -1]] == pytest.approx([lit, 0.0], rel=0.01, abs=1.0)
    assert np.abs(np.diff(across)).max() < lit / 15.0


def traced(
    world: World, air: Atmosphere, view: CameraView, *, samples: int, path_depth: int = 1
) -> Floats:
    profile = RenderProfile("test", 1.0, "ray_traced", samples=samples, path_depth=path_depth)
    with SapienBackend().open(world, air, profile) as renderer:
        renderer.place(frame_of())
        return luminance(renderer.render_camera(view))


def test_longer_paths_bring_light_round_the_corner() -> None:
    ground = build_box((0.0, 0.0, -0.5), (200.0, 200.0, 1.0), "white")
    roof = build_box((0.0, 0.0, 3.5), (6.0, 6.0, 1.0))
    below = view_of(pose_matrix((0.0, 0.0, 1.0), pitch=-np.pi / 2), size=(16, 16))
    # The ceiling sees no sun; the sunlit ground around it does, one bounce further on.
    air = air_of(sun_lx=5e4, sun_elevation_deg=80.0)
    dark, lit = (
        traced(world_of(ground, roof), air, below, samples=16, path_depth=depth).mean()
        for depth in (0, 2)
    )
    assert dark == 0.0
    assert lit > 500.0


def test_more_samples_make_less_noise() -> None:
    ground = build_box((0.0, 0.0, -0.5), (200.0, 200.0, 1.0), "white")
    air = air_of(sky=lambda sine: 9000.0 * np.maximum(sine, 0.0) ** 4)
    down = view_of(pose_matrix((0.0, 0.0, 5.0), pitch=np.pi / 2), size=(24, 24))
    few, many = (traced(world_of(ground), air, down, samples=samples).std() for samples in (2, 32))
    # Sixteen times the samples, a quarter of the noise.
    assert 3.0 < few / many < 5.5
