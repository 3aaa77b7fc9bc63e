"""Boxes in and out of a view frustum."""

import numpy as np
import pytest
from advercity_sapien.culling import ConvexVolume, FrustumCuller, compute_view_frustum
from advercity_sapien.shader_bindings import RenderBody

from advercity.geometry.poses import pose_matrix
from advercity.rendering.backend import CameraView

SQUARE = CameraView(pose_matrix((10.0, 0.0, 1.0), yaw=np.pi / 2), 100, 100, np.radians(90.0))
"""Looks north from (10, 0, 1); at 8 m it sees 8 m to either side, up and down."""


@pytest.mark.parametrize(
    ("middle", "is_seen"),
    [
        ((10.0, 8.0, 1.0), True),
        ((17.0, 8.0, 1.0), True),
        ((18.9, 8.0, 1.0), True),
        ((20.1, 8.0, 1.0), False),
        ((-0.1, 8.0, 1.0), False),
        ((10.0, 8.0, 10.9), True),
        ((10.0, 8.0, 11.1), False),
        ((10.0, -2.1, 1.0), False),
        ((10.0, 0.0, 1.0), True),
    ],
)
def test_a_box_of_two_metres_is_seen_if_any_of_it_may_be(
    middle: tuple[float, float, float], is_seen: bool
) -> None:
    seen = compute_view_frustum(SQUARE).may_intersect(np.array([middle]), np.ones((1, 3)))
    assert seen.tolist() == [is_seen]


def test_a_box_around_the_camera_is_seen() -> None:
    assert (
        compute_view_frustum(SQUARE).may_intersect(np.zeros((1, 3)), np.full((1, 3), 500.0)).all()
    )


def test_a_volume_moves_with_its_body() -> None:
    between = ConvexVolume.from_body_planes(
        pose_matrix((5.0, 0.0, 0.0), yaw=np.pi),
        np.array([[1.0, 0, 0], [-1.0, 0, 0]]),
        np.array([0, -2.0]),
    )
    middles = np.array([[x, 0.0, 0.0] for x in (2.4, 2.6, 4.0, 5.4, 5.6)])
    seen = between.may_intersect(middles, np.full((5, 3), 0.5))
    assert seen.tolist() == [False, True, True, True, False]


@pytest.mark.parametrize(
    ("middle", "casts"),
    [
        ((10.0, 8.0, 1.0), True),
        # Towards the light, which is in the east and 45 degrees high.
        ((40.0, 8.0, 31.0), True),
        ((40.0, 8.0, 55.0), False),
        # Below all light rays to visible things, and on the other side of them.
        ((44.0, 8.0, 11.0), False),
        ((-1.0, 8.0, 1.0), False),
        ((10.0, -8.0, 1.0), False),
        # Its shadow passes behind the camera.
        ((25.0, -3.0, 16.0), False),
    ],
)
def test_boxes_between_the_light_and_what_is_seen_cast_shadows_on_it(
    middle: tuple[float, float, float], casts: bool
) -> None:
    towards_light = np.array([1.0, 0.0, 1.0]) / np.sqrt(2.0)
    casting = compute_view_frustum(SQUARE).sweep(towards_light)
    assert casting.may_intersect(np.array([middle]), np.ones((1, 3))).tolist() == [casts]


def test_a_swept_volume_has_all_that_was_in_it_moved_any_way() -> None:
    rng = np.random.default_rng(5)
    frustum = compute_view_frustum(SQUARE)
    points = np.array([10.0, 0.0, 1.0]) + rng.uniform(-1.0, 1.0, (500, 3)) * (9.0, 9.0, 9.0)
    seen = points[frustum.may_intersect(points, np.zeros((500, 3)))]
    for direction in rng.normal(size=(20, 3)):
        moved = seen + rng.uniform(0.0, 50.0, (len(seen), 1)) * direction
        swept = frustum.sweep(direction).intersect(frustum.sweep(direction), margin_m=1e-6)
        assert swept.may_intersect(moved, np.full(moved.shape, 1e-6)).all()


def test_an_intersection_has_what_is_less_than_the_margin_from_the_other_volume() -> None:
    east = ConvexVolume(np.array([[1.0, 0.0, 0.0]]), np.array([5.0]))
    north = ConvexVolume(np.array([[0.0, 2.0, 0.0]]), np.array([20.0]))
    middles = np.array([[6.0, 9.1, 0.0], [6.0, 8.9, 0.0], [4.0, 11.0, 0.0]])
    both = east.intersect(north, margin_m=1.0)
    assert both.may_intersect(middles, np.zeros((3, 3))).tolist() == [True, False, False]


def test_a_level_of_detail_is_made_when_it_is_first_seen_and_only_once() -> None:
    made: list[RenderBody] = []

    def make() -> RenderBody:
        made.append(RenderBody())
        return made[-1]

    culler = FrustumCuller()
    # A pixel at 8 m is 0.16 m wide.
    ahead = np.array([9.0, 8.0, 0.0]), np.array([11.0, 9.0, 2.0])
    culler.add_later(make, *ahead, pixel_m=(0.0, 0.1))
    culler.show_only([compute_view_frustum(SQUARE)], SQUARE)
    assert not made
    culler.add_later(make, *ahead, pixel_m=(0.1, 1.0))
    for volumes in ([compute_view_frustum(SQUARE)], [], [compute_view_frustum(SQUARE)]):
        culler.show_only(volumes or [ConvexVolume(np.eye(3), np.full(3, np.inf))], SQUARE)
        assert len(made) == 1
        assert made[0].visibility == float(bool(volumes))
