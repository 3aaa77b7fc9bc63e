"""Numbers from OpenCOOD's own functions, then invariants."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from advercity.dataset.carla_frame import (
    carla_pose_from_matrix,
    compute_carla_angles_deg,
    matrix_from_carla_pose,
    mirror_angular_rate,
    mirror_points,
    mirror_pose,
)
from advercity.geometry import poses
from advercity.geometry.poses import Matrix


def left_handed(pose: list[float]) -> Matrix:
    """A pose as the file means it: maps stored points to stored world points."""
    return mirror_pose(matrix_from_carla_pose(pose))


def test_a_pose_is_read_as_opencood_reads_it() -> None:
    expected = [
        [0.813798, -0.255236, -0.522099, 1],
        [0.296198, 0.955112, -0.005236, 2],
        [0.5, -0.150384, 0.852869, 3],
        [0, 0, 0, 1],
    ]
    np.testing.assert_allclose(left_handed([1, 2, 3, 10, 20, 30]), expected, atol=1e-6)


def test_points_go_from_agent_to_agent_as_in_opencood() -> None:
    ego = left_handed([100, 50, 1.9, 0, 90, 0])
    other = left_handed([120, 60, 5, 0, -150, -12])
    point = poses.transform_points(poses.invert_pose(ego) @ other, (10.0, 0.0, 0.0))
    np.testing.assert_allclose(point, (5.109262, -11.528993, 1.020883), atol=1e-6)


def test_a_box_is_in_the_ego_frame_as_in_opencood() -> None:
    ego = left_handed([100, 50, 1.9, 0, 90, 0])
    box = left_handed([110, 70, 0.75, 0, 45, 0])
    bottom = [(2.4, -1, -0.75), (2.4, 1, -0.75), (-2.4, 1, -0.75), (-2.4, -1, -0.75)]
    corners = poses.transform_points(poses.invert_pose(ego) @ box, bottom)
    expected = [
        (20.98995, -12.404163, -1.9),
        (22.404163, -10.989949, -1.9),
        (19.01005, -7.595837, -1.9),
        (17.595837, -9.010051, -1.9),
    ]
    np.testing.assert_allclose(corners, expected, atol=1e-5)


def test_a_camera_projects_as_in_opencood() -> None:
    ego = left_handed([100, 50, 1.9, 0, 90, 0])
    camera = left_handed([100, 52.5, 1, 0, 90, 0])
    extrinsic = poses.invert_pose(camera) @ ego
    np.testing.assert_allclose(extrinsic, poses.pose_matrix((-2.5, 0, 0.9)), atol=1e-9)
    x, y, z = poses.transform_points(extrinsic, (20.0, -10.0, -1.15))
    np.testing.assert_allclose((x, y, z), (17.5, -10, -0.25), atol=1e-9)
    focal_px = 800 / (2 * np.tan(np.deg2rad(50)))
    pixel = (400 + focal_px * y / x, 300 - focal_px * z / x)
    np.testing.assert_allclose(pixel, (208.2058, 304.7949), atol=1e-4)


def test_left_turns_and_raised_noses_change_their_signs() -> None:
    left_and_down = poses.pose_matrix((1, 2, 3), yaw=np.deg2rad(30), pitch=np.deg2rad(10))
    np.testing.assert_allclose(carla_pose_from_matrix(left_and_down), (1, -2, 3, 0, -30, -10))


def test_turning_left_is_a_negative_rate_about_z() -> None:
    np.testing.assert_array_equal(mirror_angular_rate((0.1, 0.2, 0.3)), (-0.1, 0.2, -0.3))


angle = st.floats(-89, 89)
pose = st.tuples(*[st.floats(-500, 500)] * 3, st.floats(-179, 179), st.floats(-179, 179), angle)


@given(pose)
def test_a_pose_survives_a_round_trip(values: tuple[float, ...]) -> None:
    np.testing.assert_allclose(
        carla_pose_from_matrix(matrix_from_carla_pose(values)), values, atol=1e-6
    )


@given(pose, st.tuples(*[st.floats(-100, 100)] * 3))
def test_moving_then_mirroring_is_mirroring_then_moving(
    values: tuple[float, ...], point: tuple[float, float, float]
) -> None:
    matrix = matrix_from_carla_pose(values)
    np.testing.assert_allclose(
        mirror_points(poses.transform_points(matrix, point)),
        poses.transform_points(mirror_pose(matrix), mirror_points(point)),
        atol=1e-9,
    )


@given(angle, angle)
def test_angular_rates_mirror_like_the_rotations_they_make(roll: float, yaw: float) -> None:
    """A small rotation about `rate` (Rodrigues), mirrored, is the rotation about its mirror."""
    rate = np.deg2rad([roll, 10.0, yaw]) * 1e-4
    np.testing.assert_allclose(
        mirror_pose(_small_rotation(rate)), _small_rotation(mirror_angular_rate(rate)), atol=1e-12
    )


def _small_rotation(rate: np.ndarray) -> Matrix:
    x, y, z = rate
    matrix = np.eye(4)
    matrix[:3, :3] += [[0, -z, y], [z, 0, -x], [-y, x, 0]]
    return matrix


def test_angles_are_in_the_order_roll_yaw_pitch() -> None:
    matrix = poses.pose_matrix((0, 0, 0), roll=0.1, yaw=-0.2, pitch=-0.3)
    np.testing.assert_allclose(compute_carla_angles_deg(matrix), np.rad2deg([0.1, 0.2, 0.3]))
