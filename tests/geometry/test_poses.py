"""Poses: angles, inverses and interpolation."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from advercity.geometry import poses
from advercity.geometry.poses import rotation_matrix, to_rotation_vector

YAW = st.floats(-3.1, 3.1)
TILT = st.floats(-1.5, 1.5)


def test_a_positive_pitch_turns_the_nose_down_and_a_positive_yaw_turns_it_left() -> None:
    nose = np.array([1.0, 0.0, 0.0])
    assert (poses.rotation_matrix(pitch=0.1) @ nose)[2] < 0
    assert (poses.rotation_matrix(yaw=0.1) @ nose)[1] > 0


@given(yaw=YAW, pitch=TILT, roll=YAW)
def test_angles_come_back_from_the_matrix(yaw: float, pitch: float, roll: float) -> None:
    matrix = poses.pose_matrix((1, 2, 3), yaw=yaw, pitch=pitch, roll=roll)
    np.testing.assert_allclose(poses.to_yaw_pitch_roll(matrix), (yaw, pitch, roll), atol=1e-9)
    np.testing.assert_allclose(poses.invert_pose(matrix) @ matrix, np.eye(4), atol=1e-12)


@given(yaw=YAW, pitch=TILT, roll=TILT)
def test_a_quaternion_turns_vectors_as_its_matrix_does(
    yaw: float, pitch: float, roll: float
) -> None:
    matrix = poses.rotation_matrix(yaw=yaw, pitch=pitch, roll=roll)
    w, x, y, z = poses.to_quaternion(matrix)
    axis, v = np.array([x, y, z]), np.array([0.3, -0.5, 0.8])
    turned = v + 2 * np.cross(axis, np.cross(axis, v) + w * v)
    np.testing.assert_allclose(turned, matrix @ v, atol=1e-9)


@given(yaw=st.floats(-1, 1), pitch=st.floats(-1, 1), fraction=st.floats(0, 1))
def test_interpolation_goes_straight_and_turns_evenly(
    yaw: float, pitch: float, fraction: float
) -> None:
    first, second = poses.pose_matrix((0, 0, 0)), poses.pose_matrix((2, 4, 6), yaw=yaw, pitch=pitch)
    (between,) = poses.interpolate_poses(first, second, np.array([fraction]))
    np.testing.assert_allclose(between[:3, 3], fraction * np.array([2, 4, 6]), atol=1e-12)
    whole = poses.to_rotation_vector(second[:3, :3])
    np.testing.assert_allclose(
        poses.to_rotation_vector(between[:3, :3]), fraction * whole, atol=1e-9
    )


def test_interpolation_is_exact_at_both_ends() -> None:
    first = poses.pose_matrix((1, 0, 0), yaw=0.3)
    second = poses.pose_matrix((5, 2, 1), yaw=1.1, roll=0.2)
    ends = poses.interpolate_poses(first, second, np.array([0.0, 1.0]))
    np.testing.assert_allclose(ends, [first, second], atol=1e-12)


@given(x=st.floats(-1.7, 1.7), y=st.floats(-1.7, 1.7), z=st.floats(-1.7, 1.7))
def test_a_rotation_gives_its_axis_and_angle_back(x: float, y: float, z: float) -> None:
    vector = np.array([x, y, z])
    angle = float(np.linalg.norm(vector))
    across = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    turned = (
        np.eye(3)
        + np.sinc(angle / np.pi) * across
        + 0.5 * np.sinc(angle / 2 / np.pi) ** 2 * across @ across
    )
    np.testing.assert_allclose(to_rotation_vector(turned), vector, atol=1e-6)


def test_a_yaw_is_a_rotation_about_the_vertical() -> None:
    np.testing.assert_allclose(
        to_rotation_vector(rotation_matrix(yaw=0.3)), [0, 0, 0.3], atol=1e-12
    )
