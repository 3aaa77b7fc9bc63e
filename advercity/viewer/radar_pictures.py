"""Colours of radar detections by velocity, and pictures of a radar over azimuth and range."""

import math

import cv2
import numpy as np
from advercity_dsl import Radar
from numpy.typing import NDArray

from advercity.geometry.arrays import FloatArray, Uint8Array
from advercity.sensors.measurements import RadarDetections
from advercity.sensors.sensor_frame import RadarScan

FULL_COLOUR_M_S = 15.0
"""Radial velocity with a full colour: red for receding objects, blue for approaching ones."""
MAX_LEVEL_DB = 50.0
_STILL, _AWAY, _CLOSER = (
    np.array(colour) for colour in ((220, 220, 220), (230, 40, 30), (40, 70, 255))
)
PICTURE_RANGES, PICTURE_AZIMUTHS = 300, 240
MARK_PX = 2


def colour_velocities(velocity_m_s: FloatArray) -> NDArray[np.uint8]:
    """Compute RGB (n, 3) of radial velocities (n,)."""
    fraction = np.clip(velocity_m_s / FULL_COLOUR_M_S, -1.0, 1.0)[:, None]
    full = np.where(fraction > 0.0, _AWAY, _CLOSER)
    return (_STILL + np.abs(fraction) * (full - _STILL)).astype(np.uint8)


def draw_range_azimuth(radar: Radar, scan: RadarScan) -> Uint8Array:
    """Draw the strongest power (h, w, 3), RGB; far is above, left is left.

    Without a cube, detections are drawn as squares.
    """
    if scan.cube is None:
        level_db = _mark_detections(radar, scan.detections)
    else:
        level_db = np.flip(scan.cube.power_db.max(axis=2).astype(np.float32), axis=(0, 1))
    levels = np.clip(level_db / MAX_LEVEL_DB * 255.0, 0.0, 255.0).astype(np.uint8)
    size = (PICTURE_AZIMUTHS, PICTURE_RANGES)
    large = cv2.resize(levels, size, interpolation=cv2.INTER_NEAREST)
    return np.ascontiguousarray(cv2.applyColorMap(large, cv2.COLORMAP_INFERNO)[..., ::-1], np.uint8)


def _mark_detections(radar: Radar, detections: RadarDetections) -> FloatArray:
    """Mark the signal-to-noise ratio (ranges, azimuths) of detections, strong ones last."""
    picture = np.zeros((PICTURE_RANGES, PICTURE_AZIMUTHS), np.float32)
    order = np.argsort(detections.snr_db, kind="stable")
    x, y, _ = detections.points[order].T
    off = np.arctan2(y, x) / math.radians(radar.azimuth_fov_deg)
    range_m = np.linalg.norm(detections.points[order], axis=1)
    rows = ((1.0 - range_m / radar.range_m) * PICTURE_RANGES).astype(int)
    columns = ((0.5 - off) * PICTURE_AZIMUTHS).astype(int)
    for row, column, level in zip(rows, columns, detections.snr_db[order], strict=True):
        top, left = max(row - MARK_PX, 0), max(column - MARK_PX, 0)
        picture[top : row + MARK_PX + 1, left : column + MARK_PX + 1] = level
    return picture
