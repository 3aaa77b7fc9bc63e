"""Moments at which a scene is rendered for one image: rows and parts of their exposure."""

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from advercity_dsl import Camera, Shutter
from numpy.typing import NDArray

from advercity.rendering.backend import CAPTURE_ARRAYS, CameraCapture
from advercity.sensors.camera_model import CameraModel
from advercity.sensors.rolling_shutter import compute_row_times

LABEL_ARRAYS = [name for name in CAPTURE_ARRAYS if name != "radiance"]


class Instant(NamedTuple):
    """A time at which the scene is rendered."""

    time_s: float
    """Time from the frame's instant."""
    exposure_s: float | None = None
    """Exposure around it for the flicker of lamps; None if they do not flicker."""


class Moment(NamedTuple):
    """An instant for which a band of rows of an image is rendered."""

    instant: Instant
    band: int
    """Number of the band, from the top."""
    weight: float
    """Fraction of the band's exposure."""
    has_labels: bool
    """Whether it is the middle of the exposure, the moment of the labels."""


def list_moments(camera: Camera, shutter_s: float) -> tuple[Moment, ...]:
    """List the moments of an image of a camera with an exposure of `shutter_s` for each row."""
    shutter = camera.shutter or Shutter()
    bands = shutter.bands if camera.is_rolling else 1
    middles_s = compute_row_times((np.arange(bands) + 0.5) / bands, camera, 1).tolist()
    part_s = shutter_s / shutter.blur_samples
    parts = range(-(shutter.blur_samples // 2), shutter.blur_samples // 2 + 1)
    return tuple(
        Moment(
            instant=Instant(middle_s + part * part_s, part_s if shutter.led_flicker else None),
            band=band,
            weight=1 / shutter.blur_samples,
            has_labels=part == 0,
        )
        for band, middle_s in enumerate(middles_s)
        for part in parts
    )


@lru_cache(maxsize=8)
def locate_bands(model: CameraModel, count: int) -> NDArray[np.intp]:
    """Locate the bands (h, w) of rows of an image in its rendered plane.

    Pixels of the plane beyond the image belong to the nearest band.
    """
    width, height = model.rendered_size
    row, column = np.indices((height, width)).reshape(2, -1) + 0.5
    rows = model.distort(model.from_rendered(np.stack([column, row], axis=1)))[:, 1]
    bands = np.floor(rows * count / model.height_px).clip(0, count - 1)
    return bands.astype(np.intp).reshape(height, width)


class MomentBlender:
    """Blends the captures of an image's moments: means of light, selected labels.

    Args:
        moments: Moments of the image.
        model: Projection of the camera to the image.
    """

    def __init__(self, moments: Sequence[Moment], model: CameraModel) -> None:
        self._moments, self._model = moments, model
        self._blend: CameraCapture | None = None

    @property
    def instants(self) -> set[Instant]:
        """Instants at which a capture is needed."""
        return {moment.instant for moment in self._moments}

    def add(self, capture: CameraCapture, instant: Instant) -> None:
        """Add the capture of the scene at one of the instants."""
        if len(self._moments) == 1:
            self._blend = capture
            return
        if self._blend is None:
            arrays = (np.zeros_like(getattr(capture, name)) for name in CAPTURE_ARRAYS)
            self._blend = CameraCapture(*arrays)
        for moment in self._moments:
            if moment.instant == instant:
                self._add_band(capture, self._blend, moment)

    def finish(self) -> CameraCapture:
        """Return the capture of the whole image, after captures of all instants were added."""
        assert self._blend is not None, "no capture was added"
        return self._blend

    def _add_band(self, source: CameraCapture, target: CameraCapture, moment: Moment) -> None:
        is_shown = locate_bands(self._model, 1 + self._moments[-1].band) == moment.band
        rows = np.flatnonzero(is_shown.any(axis=1))
        some = slice(rows[0], rows[-1] + 1) if len(rows) else slice(0)
        where = is_shown[some]
        light = np.float32(moment.weight) * source.radiance[some]
        np.add(target.radiance[some], light, out=target.radiance[some], where=where[..., None])
        for name in LABEL_ARRAYS if moment.has_labels else ():
            labels = getattr(target, name)[some]
            selected = where.reshape(*where.shape, *(1 for _ in labels.shape[2:]))
            np.copyto(labels, getattr(source, name)[some], where=selected)
