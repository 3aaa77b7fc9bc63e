"""CARLA's left-handed frame, which OPV2V files are in: the only home of the mirror to it.

Axes: x forward, y right, z up, metres. A positive yaw turns right, a positive pitch lifts the
nose, a positive roll lowers the right side. A pose is written `[x, y, z, roll, yaw, pitch]`,
in degrees, and means `T · Ryaw · Rpitch · Rroll`.

Both frames share x and z, so one is the other mirrored: y changes its sign, and with it yaw and
pitch (here a positive pitch lowers the nose in the right-handed frame).
"""

from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from advercity.geometry import poses
from advercity.geometry.poses import Matrix

_MIRROR = np.array([1.0, -1.0, 1.0])
_MIRROR_POSE = np.diag([1.0, -1.0, 1.0, 1.0])
_Angle = TypeVar("_Angle", float, NDArray[np.float64])


def mirror_points(points: ArrayLike) -> NDArray[np.float64]:
    """Convert points or vectors (..., 3) from one frame to the other."""
    return np.asarray(points, dtype=np.float64) * _MIRROR


def mirror_xyz(x: float, y: float, z: float) -> tuple[float, float, float]:
    """Convert one point or vector, some ten times faster than `mirror_points` does."""
    return x, -y, z


def mirror_columns(table: NDArray[np.void]) -> None:
    """Convert the columns `y` and `raw_y` of a point table (n,) in place."""
    # Multiplying keeps the bytes of float32 columns; `0 - y` would write another zero.
    for name in {"y", "raw_y"}.intersection(table.dtype.names or ()):
        table[name] *= -1


def mirror_angle(angle: _Angle) -> _Angle:
    """Convert an angle, or angles (n,), about the vertical axis."""
    return -angle


def mirror_angular_rate(rate: ArrayLike) -> NDArray[np.float64]:
    """Convert an angular rate (..., 3) from one frame to the other.

    It is an axial vector: the component across the mirror keeps its sign, the others change it.
    """
    return np.asarray(rate, dtype=np.float64) * -_MIRROR


def mirror_pose(matrix: Matrix) -> Matrix:
    """Convert a pose (4, 4): the result maps mirrored points to mirrored points."""
    return _MIRROR_POSE @ matrix @ _MIRROR_POSE


def compute_carla_angles_deg(matrix: Matrix) -> NDArray[np.float64]:
    """Compute roll, yaw and pitch in CARLA's sense, in degrees, of a right-handed pose."""
    yaw, pitch, roll = poses.to_yaw_pitch_roll(matrix)
    return np.rad2deg([roll, -yaw, -pitch])


def carla_pose_from_matrix(matrix: Matrix) -> NDArray[np.float64]:
    """Convert a right-handed pose (4, 4) to `[x, y, z, roll, yaw, pitch]`."""
    return np.concatenate([mirror_points(matrix[:3, 3]), compute_carla_angles_deg(matrix)])


def matrix_from_carla_pose(pose: ArrayLike) -> Matrix:
    """Convert `[x, y, z, roll, yaw, pitch]` to a right-handed pose (4, 4)."""
    x, y, z, roll, yaw, pitch = np.asarray(pose, dtype=np.float64)
    roll, yaw, pitch = np.deg2rad([roll, -yaw, -pitch])
    return poses.pose_matrix(mirror_xyz(x, y, z), yaw=yaw, pitch=pitch, roll=roll)
