"""Poses of sensors on their carriers."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from advercity.geometry import poses
from advercity.geometry.poses import Matrix

if TYPE_CHECKING:
    from advercity_dsl import Mount


def carrier_from_sensor(mount: Mount) -> Matrix:
    """Return the pose (4, 4) of a sensor in the frame of its carrier, in body axes."""
    return poses.pose_matrix(
        (mount.x_m, mount.y_m, mount.z_m),
        yaw=math.radians(mount.yaw_deg),
        pitch=math.radians(mount.pitch_deg),
        roll=math.radians(mount.roll_deg),
    )
