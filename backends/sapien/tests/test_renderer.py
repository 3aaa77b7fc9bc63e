"""Content and labels of images, with both shader packs."""

from dataclasses import replace

import numpy as np
import pytest

from advercity.geometry.mesh import Wheel
from advercity.geometry.poses import invert_pose, pose_matrix, transform_points
from advercity.semantics import Semantic
from advercity.world import Body
from tests.box_scenes import (
    Open,
    air_of,
    centre,
    frame_of,
    luminance,
    state,
    uniform,
    view_of,
    world_of,
)
from tests.render_builders import (
    build_box,
)

pytestmark = [pytest.mark.render, pytest.mark.usefixtures("ideal_surfaces")]


def test_a_known_box_is_labelled_to_the_pixel_and_measured_to_the_millimetre(
    opened: Open,
) -> None:
    with opened(world_of(), air_of(sky=uniform(1000.0))) as renderer:
        renderer.place(frame_of(state(7, (10.0, 0.0, 0.0))))
        capture = renderer.render_camera(view_of())
    # Its front is 2 m square, 9 m ahead, seen with a focal length of 80 px around (80, 60).
    edge = 80.0 / 9.0
    columns = np.abs(np.arange(160) + 0.5 - 80.0) < edge
    rows = np.abs(np.arange(120) + 0.5 - 60.0) < edge
    expected = rows[:, None] & columns[None, :]
    assert np.array_equal(capture.instance == 7, expected)
    assert np.array_equal(capture.semantic == Semantic.VEHICLE, expected)
    np.testing.assert_allclose(capture.depth[expected], 9.0, atol=1e-3)
    np.testing.assert_allclose(capture.normal[expected], np.tile([-1.0, 0, 0], (expected.sum(), 1)))
    assert np.all(np.isinf(capture.depth[~expected]))
    assert capture.radiance.dtype == capture.depth.dtype == capture.normal.dtype == np.float32
    assert (capture.semantic.dtype, capture.instance.dtype) == (np.uint8, np.int32)


def test_a_point_is_seen_at_the_pixel_of_the_pinhole_model(opened: Open) -> None:
    camera = pose_matrix((3.0, -2.0, 1.5), yaw=0.7, pitch=0.2, roll=0.1)
    target = transform_points(camera, [8.0, 2.5, -1.5])
    mark = build_box(target, (0.1, 0.1, 0.1), semantic=Semantic.TRAFFIC_SIGN)
    with opened(world_of(mark), air_of(sky=uniform(1000.0))) as renderer:
        renderer.place(frame_of())
        capture = renderer.render_camera(view_of(camera))
    rows, columns = np.nonzero(capture.semantic == Semantic.TRAFFIC_SIGN)
    assert columns.mean() + 0.5 == pytest.approx(80.0 - 80.0 * 2.5 / 8.0, abs=0.6)
    assert rows.mean() + 0.5 == pytest.approx(60.0 + 80.0 * 1.5 / 8.0, abs=0.6)


def test_pixels_on_an_edge_show_both_sides_by_their_parts(opened: Open) -> None:
    """The top of a black wall, at the height of the camera, seen with the head tilted."""
    wall = build_box((11.0, 0.0, -29.0), (1.0, 400.0, 60.0), "black")
    with opened(world_of(wall), air_of(sky=uniform(1000.0)), samples=256) as renderer:
        renderer.place(frame_of())
        capture = renderer.render_camera(view_of(pose_matrix((0.0, 0.0, 1.0), roll=0.3)))
    # Eleven places along each axis of a pixel; the sixth is its middle.
    column, row = np.meshgrid((np.arange(1760) + 0.5) / 11.0, (np.arange(1320) + 0.5) / 11.0)
    is_sky = (row - 60.0) * np.cos(0.3) < (80.0 - column) * np.sin(0.3)
    covered = is_sky.reshape(120, 11, 160, 11).mean(axis=(1, 3))
    seen = luminance(capture) / 1000.0
    np.testing.assert_allclose(seen, covered, atol=0.26)
    edge = (covered > 0.0) & (covered < 1.0)
    assert np.abs(seen - covered)[edge].mean() < 0.1
    np.testing.assert_array_equal(np.isinf(capture.depth), is_sky[5::11, 5::11])


def test_a_thin_wire_is_not_broken(opened: Open) -> None:
    """A wire of two thirds of a pixel shows in every column, by its part."""
    wire = build_box((10.5, 0.0, 1.0), (1.0, 60.0, 0.08), "black")
    with opened(world_of(wire), air_of(sky=uniform(1000.0)), samples=256) as renderer:
        renderer.place(frame_of())
        view = view_of(pose_matrix((0.0, 0.0, 1.0), roll=0.1))
        seen = luminance(renderer.render_camera(view)) / 1000.0
    missing = (1.0 - seen).sum(axis=0)[20:140]
    assert missing.mean() == pytest.approx(0.08 * 8.0 / np.cos(0.1), rel=0.2)
    assert missing.min() > 0.2


def test_every_pixel_with_depth_lies_on_what_it_is_labelled(opened: Open) -> None:
    ground = build_box((0.0, 0.0, -0.5), (200.0, 200.0, 1.0), semantic=Semantic.ROAD)
    camera = pose_matrix((0.0, 0.0, 2.0), yaw=0.3, pitch=0.1)
    with opened(world_of(ground), air_of(sky=uniform(1000.0)), samples=3) as renderer:
        renderer.place(frame_of(state(3, (12.0, 3.0, 0.0), yaw=0.5)))
        capture = renderer.render_camera(view_of(camera))
    row, column = np.indices(capture.depth.shape) + 0.5
    rays = np.stack([np.ones_like(row), (80.0 - column) / 80.0, (60.0 - row) / 80.0], axis=-1)
    known = np.isfinite(capture.depth)
    points = transform_points(camera, rays[known] * capture.depth[known][:, None])
    road = capture.semantic[known] == Semantic.ROAD
    np.testing.assert_allclose(points[road, 2], 0.0, atol=2e-3)
    in_box = transform_points(invert_pose(pose_matrix((12.0, 3.0, 1.0), yaw=0.5)), points[~road])
    np.testing.assert_allclose(np.abs(in_box).max(axis=1), 1.0, atol=2e-3)
    assert np.array_equal(capture.instance[known] == 3, ~road)


def test_a_camera_does_not_see_its_carrier_but_all_else(opened: Open) -> None:
    wall = build_box((21.0, 0.0, 1.0), (2.0, 60.0, 60.0), semantic=Semantic.WALL)
    with opened(world_of(wall), air_of(sky=uniform(1000.0))) as renderer:
        renderer.place(frame_of(state(1, (5.0, 0.0, 0.0)), state(2, (10.0, 3.0, 0.0))))
        hidden = renderer.render_camera(view_of(hide=1))
        shown = renderer.render_camera(view_of())
    assert set(np.unique(shown.instance)) == {0, 1, 2}
    assert set(np.unique(hidden.instance)) == {0, 2}
    assert centre(hidden.depth) == pytest.approx(20.0, abs=1e-3)
    assert centre(hidden.semantic) == Semantic.WALL


def test_wheels_turn_and_steer_with_their_actor_and_hide_with_it(opened: Open) -> None:
    # Seen from the left: a bar of 1.6 m by 0.2 m along x, turning 0.8 m above ground.
    bar = build_box((0, 0, 0.8), (1.6, 0.2, 0.2), semantic=Semantic.VEHICLE)
    rolling = replace(bar, wheel=Wheel((0.0, 0.0, 0.8), is_steered=True))
    body = Body((rolling,), (1.6, 0.2, 1.6))
    world = replace(world_of(build_box((0, 9, 4), (20, 1, 9))), bodies={"box": body})
    view = view_of(pose_matrix((0.0, -4.0, 0.8), yaw=np.pi / 2))

    def extent_px(*, travelled_m: float = 0.0, steering_rad: float = 0.0) -> list[int]:
        rolled = replace(state(1, (0, 0, 0)), travelled_m=travelled_m, steering_rad=steering_rad)
        renderer.place(frame_of(rolled))
        capture = renderer.render_camera(view)
        assert (capture.semantic[capture.instance == 1] == Semantic.VEHICLE).all()
        return np.ptp(np.argwhere(capture.instance == 1), axis=0).tolist()

    with opened(world, air_of(sky=uniform(1000.0))) as renderer:
        assert extent_px() == pytest.approx([4, 32], abs=1.5)
        assert extent_px(travelled_m=0.8 * np.pi / 2) == pytest.approx([32, 4], abs=1.5)
        # 1.6 m at 30 degrees; one end is 0.4 m nearer and looks larger.
        assert extent_px(steering_rad=np.pi / 6) == pytest.approx([4, 28], abs=1.5)
        assert not (renderer.render_camera(replace(view, hide=frozenset({1}))).instance == 1).any()


def test_paint_is_the_actors_own(opened: Open) -> None:
    with opened(world_of(), air_of(sky=uniform(1000.0))) as renderer:
        renderer.place(
            frame_of(
                state(1, (9.0, 2.0, 0.0), paint="white"), state(2, (9.0, -2.0, 0.0), paint="black")
            )
        )
        capture = renderer.render_camera(view_of())
    # Pixels on edges show a part of the sky.
    assert np.median(luminance(capture)[capture.instance == 1]) > 500.0
    assert np.median(luminance(capture)[capture.instance == 2]) < 1.0


def test_a_pane_shows_what_is_behind_it_and_is_labelled_itself(opened: Open) -> None:
    pane = build_box((0, 0, 1), (0.01, 2, 2), "glass", Semantic.VEHICLE)
    wall = build_box((10.0, 0.0, 0.0), (1.0, 40.0, 40.0), "white")
    bodies = {"box": Body((pane,), (0.01, 2.0, 2.0))}
    with opened(world_of(wall, bodies=bodies), air_of(sun_lx=1e4), samples=64) as renderer:
        renderer.place(frame_of())
        bare = renderer.render_camera(view_of())
        # A sheet has two faces: the camera sees through the one towards it, the other looks away.
        renderer.place(frame_of(state(3, (6.0, 0.0, 0.0))))
        seen = renderer.render_camera(view_of())
    fraction = centre(luminance(seen)) / centre(luminance(bare))
    # Both faces reflect 0.0426 at right angles: 2 r / (1 + r) = 0.082 of a pane; 0.72 is its tint.
    assert 0.4 < fraction < 0.75
    assert centre(seen.instance) == 3
    assert centre(seen.depth) == pytest.approx(6.0, abs=0.01)
    assert centre(bare.depth) == pytest.approx(9.5, abs=0.01)


def test_static_panes_are_seen_through_unless_they_close_a_building(opened: Open) -> None:
    wall = build_box((10.0, 0.0, 0.0), (1.0, 40.0, 40.0), "white")

    def measure_behind(semantic: Semantic) -> float:
        pane = build_box((6.0, 0.0, 0.0), (0.01, 4.0, 4.0), "glass", semantic)
        with opened(world_of(wall, pane), air_of(sun_lx=1e4), samples=64) as renderer:
            renderer.place(frame_of())
            seen = renderer.render_camera(view_of())
        assert centre(seen.semantic) == semantic
        assert centre(seen.depth) == pytest.approx(6.0, abs=0.01)
        return centre(luminance(seen))

    assert measure_behind(Semantic.STATIC) > 5.0 * measure_behind(Semantic.BUILDING) > 0.0


@pytest.mark.parametrize(("night", "luminance_cd_m2"), [(True, 13.5), (False, 0.0)])
def test_windows_of_shops_shine_by_night(opened: Open, night: bool, luminance_cd_m2: float) -> None:
    pane = build_box((10.0, 0.0, 0.0), (1.0, 40.0, 40.0), "room_shop")
    with opened(world_of(pane), air_of(night=night), samples=64) as renderer:
        renderer.place(frame_of())
        seen = renderer.render_camera(view_of())
    assert centre(luminance(seen)) == pytest.approx(luminance_cd_m2, rel=0.01, abs=0.1)


def test_unfetched_images_do_no_harm(opened: Open) -> None:
    with opened(world_of(), air_of(sky=uniform(1000.0))) as renderer:
        renderer.place(frame_of(state(1, (8.0, 0.0, 0.0))))
        renderer.render_cameras([view_of(), view_of()])
        assert set(np.unique(renderer.render_camera(view_of()).instance)) == {0, 1}
        next(renderer.render_cameras([view_of(), view_of()]))
