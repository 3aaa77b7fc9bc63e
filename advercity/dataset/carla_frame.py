"""CARLA's left-handed frame, which OPV2V files are written in; nowhere else is it used.

Axes: x forward, y right, z up, metres. A positive yaw turns right, a positive pitch lifts the
nose, a positive roll lowers the right side. A pose is written `[x, y, z, roll, yaw, pitch]`,
in degrees, and means `T · Ryaw · Rpitch · Rroll`.

Both frames share x and z, so one is the other mirrored: y changes its sign, and with it yaw and
pitch (here a positive pitch lowers the nose in the right-handed frame).
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from advercity.geometry import poses
from advercity.geometry.poses import Matrix

_MIRROR = np.array([1.0, -1.0, 1.0])
_MIRROR_POSE = np.diag([1.0, -1.0, 1.0, 1.0])


def mirror_points(points: ArrayLike) -> NDArray[np.float64]:
    """Points or vectors (..., 3) of one frame in the other."""
    return np.asarray(points, dtype=np.float64) * _MIRROR


def mirror_angular_rate(rate: ArrayLike) -> NDArray[np.float64]:
    """An angular rate (..., 3) of one frame in the other.

    An axial vector keeps its component across the mirror and reverses those along it.
    """
    return np.asarray(rate, dtype=np.float64) * -_MIRROR


def mirror_pose(matrix: Matrix) -> Matrix:
    """A pose (4, 4) of one frame in the other: maps mirrored points to mirrored points."""
    return _MIRROR_POSE @ matrix @ _MIRROR_POSE


def compute_carla_angles_deg(matrix: Matrix) -> NDArray[np.float64]:
    """Roll, yaw and pitch in CARLA's sense, degrees, of a right-handed pose."""
    yaw, pitch, roll = poses.to_yaw_pitch_roll(matrix)
    return np.rad2deg([roll, -yaw, -pitch])


def carla_pose_from_matrix(matrix: Matrix) -> NDArray[np.float64]:
    """`[x, y, z, roll, yaw, pitch]` of a right-handed pose (4, 4)."""
    return np.concatenate([mirror_points(matrix[:3, 3]), compute_carla_angles_deg(matrix)])


def matrix_from_carla_pose(pose: ArrayLike) -> Matrix:
    """Right-handed pose (4, 4) of `[x, y, z, roll, yaw, pitch]`."""
    x, y, z, roll, yaw, pitch = np.asarray(pose, dtype=np.float64)
    roll, yaw, pitch = np.deg2rad([roll, -yaw, -pitch])
    return poses.pose_matrix((x, -y, z), yaw=yaw, pitch=pitch, roll=roll)
