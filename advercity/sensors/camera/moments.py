"""Moments at which a scene is rendered for one image: rows may be exposed one after the other."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from advercity_dsl import Camera
from numpy.typing import NDArray

from advercity.rendering.backend import CAPTURE_ARRAYS, CameraCapture
from advercity.sensors.camera_model import CameraModel
from advercity.sensors.rolling_shutter import compute_row_times


class Moment(NamedTuple):
    """A time at which the scene is rendered for a band of rows of an image."""

    time_s: float
    """Time from the frame's instant."""
    band: int
    """Number of the band, from the top."""


def list_moments(camera: Camera) -> tuple[Moment, ...]:
    """List the moments of an image of a camera, in the order of time."""
    middles = (np.arange(camera.renders) + 0.5) / camera.renders
    times_s = compute_row_times(middles, camera, 1).tolist()
    return tuple(Moment(time_s, band) for band, time_s in enumerate(times_s))


@lru_cache(maxsize=8)
def locate_bands(model: CameraModel, count: int) -> NDArray[np.intp]:
    """Locate the bands (h, w) of rows of an image in the plane that is rendered for it.

    What the plane shows beyond the image belongs to the nearest band.
    """
    width, height = model.rendered_size
    row, column = np.indices((height, width)).reshape(2, -1) + 0.5
    shift = np.subtract((width, height), (model.width_px, model.height_px)) / 2
    rows = model.distort(np.stack([column, row], axis=1) - shift)[:, 1]
    bands = np.floor(rows * count / model.height_px).clip(0, count - 1)
    return bands.astype(np.intp).reshape(height, width)


class MomentBlender:
    """Puts the captures of an image's moments together to one.

    Args:
        camera: The camera.
        model: Its projection to the image.
    """

    def __init__(self, camera: Camera, model: CameraModel) -> None:
        self._moments, self._model = list_moments(camera), model
        self._blend: CameraCapture | None = None

    @property
    def times_s(self) -> set[float]:
        """Times at which a capture is needed."""
        return {moment.time_s for moment in self._moments}

    def add(self, capture: CameraCapture, time_s: float) -> None:
        """Add the capture of the scene at one of the times."""
        if len(self._moments) == 1:
            self._blend = capture
            return
        if self._blend is None:
            self._blend = CameraCapture(*(getattr(capture, name).copy() for name in CAPTURE_ARRAYS))
        for moment in self._moments:
            if moment.time_s == time_s:
                self._copy_band(capture, self._blend, moment.band)

    def finish(self) -> CameraCapture:
        """Return the capture of the whole image, once those of all times have been added."""
        assert self._blend is not None, "no capture was added"
        return self._blend

    def _copy_band(self, source: CameraCapture, target: CameraCapture, band: int) -> None:
        is_shown = locate_bands(self._model, len(self._moments)) == band
        rows = np.flatnonzero(is_shown.any(axis=1))
        some = slice(rows[0], rows[-1] + 1) if len(rows) else slice(0)
        for name, (_, channels) in CAPTURE_ARRAYS.items():
            where = is_shown[some][..., None] if channels else is_shown[some]
            np.copyto(getattr(target, name)[some], getattr(source, name)[some], where=where)
