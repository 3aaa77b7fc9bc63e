"""Rigid poses as 4x4 matrices, named by where they lead: `world_from_body @ point_in_body`.

World frame: right-handed, x east, y north, z up, metres. Body frame: x forward, y left, z up.
Rotations are right-handed, applied roll (x), then pitch (y), then yaw (z); so a positive pitch
turns the nose down and a positive yaw turns it left.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Matrix = NDArray[np.float64]

OPTICAL_FROM_BODY: Matrix = np.array(
    [[0.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)
"""From x forward, y left, z up to the optical axes of a camera: x right, y down, z ahead."""


def rotation_matrix(*, yaw: float = 0.0, pitch: float = 0.0, roll: float = 0.0) -> Matrix:
    """Build the 3x3 rotation `Rz(yaw) Ry(pitch) Rx(roll)`, angles in radians."""
    cy, sy = np.cos(yaw), np.sin(yaw)
    cp, sp = np.cos(pitch), np.sin(pitch)
    cr, sr = np.cos(roll), np.sin(roll)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def pose_matrix(
    position: ArrayLike, *, yaw: float = 0.0, pitch: float = 0.0, roll: float = 0.0
) -> Matrix:
    """Build a 4x4 pose from a position (3,) in metres and angles in radians."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_matrix(yaw=yaw, pitch=pitch, roll=roll)
    matrix[:3, 3] = position
    return matrix


def invert_pose(matrix: Matrix) -> Matrix:
    """Invert a rigid pose (4, 4)."""
    result = np.eye(4)
    result[:3, :3] = matrix[:3, :3].T
    result[:3, 3] = -matrix[:3, :3].T @ matrix[:3, 3]
    return result


def mirror_pose(matrix: Matrix) -> Matrix:
    """Mirror the place of a body at the x axis (world y negated); it stays a rotation.

    A body symmetric about its x-z plane becomes its mirror image.
    """
    mirrored = matrix.copy()
    mirrored[1] = -mirrored[1]
    mirrored[:, 1] = -mirrored[:, 1]
    return mirrored


def to_yaw_pitch_roll(matrix: Matrix) -> tuple[float, float, float]:
    """Convert a pose or rotation to yaw, pitch and roll in radians; pitch within ±pi/2."""
    yaw = float(np.arctan2(matrix[1, 0], matrix[0, 0]))
    pitch = float(np.arcsin(np.clip(-matrix[2, 0], -1.0, 1.0)))
    roll = float(np.arctan2(matrix[2, 1], matrix[2, 2]))
    return yaw, pitch, roll


def to_quaternion(matrix: Matrix) -> Matrix:
    """Convert a pose or rotation to a unit quaternion (4,), the real part first."""
    halves = np.array(to_yaw_pitch_roll(matrix)) / 2.0
    (cy, cp, cr), (sy, sp, sr) = np.cos(halves), np.sin(halves)
    return np.array(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ]
    )


def transform_points(matrix: Matrix, points: ArrayLike) -> NDArray[np.float64]:
    """Transform points (..., 3) by a pose (4, 4)."""
    return np.asarray(points, dtype=np.float64) @ matrix[:3, :3].T + matrix[:3, 3]


def to_rotation_vector(rotation: Matrix) -> Matrix:
    """Convert a rotation (3, 3) of less than half a turn to axis times angle (3,), radians."""
    twice_sine = np.array(
        [
            rotation[2, 1] - rotation[1, 2],
            rotation[0, 2] - rotation[2, 0],
            rotation[1, 0] - rotation[0, 1],
        ]
    )
    angle = np.arctan2(np.linalg.norm(twice_sine), np.trace(rotation) - 1.0)
    return twice_sine / (2.0 * np.sinc(angle / np.pi))


def from_rotation_vector(vector: Matrix) -> Matrix:
    """Convert axis times angle (3,), radians, to a rotation (3, 3)."""
    return _turn_partly(vector, np.ones((1, 1, 1)))[0]


def _turn_partly(vector: Matrix, part: Matrix) -> Matrix:
    """Compute rotations (n, 3, 3) by parts (n, 1, 1) of axis times angle, by Rodrigues' formula."""
    x, y, z = vector
    across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angle = part * np.sqrt(x * x + y * y + z * z)
    return (
        np.eye(3)
        + part * np.sinc(angle / np.pi) * across
        + 0.5 * (part * np.sinc(angle / (2.0 * np.pi))) ** 2 * (across @ across)
    )


def interpolate_poses(first: Matrix, second: Matrix, fraction: ArrayLike) -> Matrix:
    """Interpolate poses (n, 4, 4) at fractions (n,) between two poses (4, 4).

    Positions are linear, rotations go evenly about one axis; 0 and 1 give the two poses exactly.
    """
    part = np.asarray(fraction, dtype=np.float64)[:, None, None]
    turn = _turn_partly(to_rotation_vector(first[:3, :3].T @ second[:3, :3]), part)
    result = np.zeros((len(part), 4, 4))
    result[:, :3, :3] = first[:3, :3] @ turn
    result[:, :3, 3] = first[:3, 3] + part[:, :, 0] * (second[:3, 3] - first[:3, 3])
    result[:, 3, 3] = 1.0
    return result
