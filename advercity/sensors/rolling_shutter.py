"""Rolling shutters: the times of rows, and the places of moving points in an image.

Rows are exposed from the top at an even pace; the middle of the image at the frame's instant.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from advercity.geometry import poses
from advercity.geometry.arrays import Float64Array, FloatArray
from advercity.geometry.poses import Matrix
from advercity.sensors.camera_model import CameraModel

if TYPE_CHECKING:
    from advercity_dsl import Camera

    from advercity.frames import ActorState

ROUNDS = 5
"""Rounds of the search for a point's row; each multiplies the error by the point's movement down
the image in the readout, over the height of the image."""


def compute_row_times(rows: FloatArray, camera: Camera, height_px: int) -> Float64Array:
    """Compute the times of places (n,) down an image, in seconds from the frame's instant.

    The middle of the first row is at 0.5. Without a rolling shutter, all times are 0.
    """
    readout_s = 0.0 if camera.shutter is None else camera.shutter.readout_ms / 1000
    return readout_s * (rows / height_px - 0.5)


@dataclass(frozen=True, eq=False)
class RollingCamera:
    """Poses of a camera during its readout.

    Attributes:
        readout_s: Time from the upper edge of the image to the lower one.
        upper: `world_from_camera` (4, 4), body axes, half the readout before the frame's instant.
        lower: The same, half the readout after the frame's instant.
    """

    readout_s: float
    upper: Matrix
    lower: Matrix

    def find_row_poses(self, height_px: int) -> Matrix:
        """Find the poses (h, 4, 4) at the times of the middles of rows."""
        fractions = (np.arange(height_px) + 0.5) / height_px
        return poses.interpolate_poses(self.upper, self.lower, fractions)

    def place_points(self, points: Float64Array, model: CameraModel) -> Float64Array:
        """Place points (n, 3) of the world in body axes at the times of their rows.

        `model` is the projection of the camera.
        """
        return self._place(lambda fractions: points, len(points), model)

    def place_moving_points(
        self, state: ActorState, points: Float64Array, model: CameraModel
    ) -> Float64Array:
        """Place points (n, 3) of an actor, given in its frame, as `place_points` does."""
        upper, lower = (
            state.motion.advance_pose(state.world_from_body, half * self.readout_s)
            for half in (-0.5, 0.5)
        )

        def move(fractions: Float64Array) -> Float64Array:
            world_from_body = poses.interpolate_poses(upper, lower, fractions)
            turned = np.einsum("nij,nj->ni", world_from_body[:, :3, :3], points)
            return turned + world_from_body[:, :3, 3]

        return self._place(move, len(points), model)

    def _place(
        self, move: Callable[[Float64Array], Float64Array], count: int, model: CameraModel
    ) -> Float64Array:
        """Place n points; `move` returns them in the world at fractions (n,) of the readout."""
        fractions, placed = np.full(count, 0.5), np.zeros((count, 3))
        for _ in range(ROUNDS):
            world_from_camera = poses.interpolate_poses(self.upper, self.lower, fractions)
            offsets = move(fractions) - world_from_camera[:, :3, 3]
            placed = np.einsum("nji,nj->ni", world_from_camera[:, :3, :3], offsets)
            rows = model.pixels_from_camera(placed)[:, 1]
            # Points in the camera's plane have no row, and no place in the image.
            fractions = np.clip(np.nan_to_num(rows / model.height_px, nan=0.5), 0.0, 1.0)
        return placed
