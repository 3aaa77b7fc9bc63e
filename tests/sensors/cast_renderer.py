"""A renderer of depths and actors alone: rays through the middles of pixels, without a device."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from advercity.frames import Frame
from advercity.physics.atmosphere import Atmosphere
from advercity.rendering.backend import CameraCapture, CameraView
from advercity.rendering.raycaster import Raycaster, Rays
from advercity.testing import make_capture
from advercity.world import World

MAX_RANGE_M = 1000.0


class CastRenderer:
    """Casts rays into a world; the radiance of what is hit is its actor's id, in red."""

    def __init__(self, world: World) -> None:
        self._raycaster = Raycaster(world)
        self._frame: Frame | None = None
        self.frames: list[Frame] = []

    @property
    def times_s(self) -> list[float]:
        """Times of all frames that were placed."""
        return [frame.time_s for frame in self.frames]

    def change_atmosphere(self, atmosphere: Atmosphere) -> None:
        """Do nothing: there is no light."""

    def place(self, frame: Frame) -> None:
        """Place the actors, and record the frame."""
        self._frame = frame
        self.frames.append(frame)

    def render_cameras(self, views: Sequence[CameraView]) -> Iterator[CameraCapture]:
        """Render images, in order."""
        return map(self.render_camera, views)

    def render_camera(self, view: CameraView) -> CameraCapture:
        """Cast a ray through the middle of every pixel."""
        assert self._frame is not None
        self._raycaster.place(self._frame, hide=view.hide)
        size, pose = (view.height_px, view.width_px), view.world_from_camera
        focal_px = view.width_px / (2 * np.tan(view.horizontal_fov_rad / 2))
        row, column = np.indices(size).reshape(2, -1) + 0.5
        right, down = (column - size[1] / 2) / focal_px, (row - size[0] / 2) / focal_px
        rays = np.stack([np.ones_like(right), -right, -down], axis=1)
        length = np.linalg.norm(rays, axis=1, keepdims=True)
        directions = (rays / length @ pose[:3, :3].T).astype(np.float32)
        origins = np.tile(pose[:3, 3].astype(np.float32), (len(rays), 1))
        hits = self._raycaster.cast(Rays(origins, directions), MAX_RANGE_M)
        blank = make_capture(view.width_px, view.height_px, radiance_cd_m2=0.0)
        blank.radiance[..., 0] = hits.instance.reshape(size)
        return replace(
            blank,
            depth=(hits.range_m / length[:, 0]).astype(np.float32).reshape(size),
            normal=hits.normal.reshape(*size, 3),
            semantic=hits.semantic.reshape(size),
            instance=hits.instance.reshape(size),
        )
