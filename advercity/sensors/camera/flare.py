"""Ghosts: discs of light that two reflections inside a lens throw opposite bright lamps."""

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from advercity.rendering.backend import CameraCapture
from advercity.rendering.lamps import intensity_towards
from advercity.sensors.camera.shot import Shot
from advercity.weather.atmosphere import Atmosphere

Array = NDArray[np.float64]

REFLECTED = 5e-5
"""Of the light of a lamp, what two coated surfaces send into one ghost."""
GHOSTS: tuple[tuple[float, float, tuple[float, float, float]], ...] = (
    (0.4, 2.0, (0.7, 1.1, 0.9)),
    (0.7, 3.5, (0.8, 1.0, 1.5)),
    (1.2, 5.0, (1.3, 0.9, 0.8)),
    (-0.5, 1.5, (1.0, 1.0, 1.0)),
    (-1.3, 4.0, (0.9, 1.1, 0.7)),
)
"""Where a ghost stands on the line from the lamp through the middle, its radius in degrees, tint.

A place of 0 is the middle itself, 1 is as far beyond it as the lamp is on this side.
"""
SOFT_EDGE = 0.25
"""Of a ghost's radius."""
LEAST_LX = 0.05
"""Lamps that light the lens less throw none that are seen."""


def with_ghosts(
    light: NDArray[np.float32], capture: CameraCapture, shot: Shot, atmosphere: Atmosphere
) -> NDArray[np.float32]:
    """A picture (h, w, 3) in cd/m² with the ghosts of the sun and of lamps it looks into."""
    strength = shot.camera.flare
    if strength == 0.0:
        return light
    found = light.copy()
    for column, row, lux in _sources(capture, shot, atmosphere):
        for place, radius_deg, tint in GHOSTS:
            at = _mirrored(column, row, place, shot)
            radius = math.radians(radius_deg)
            luminance = strength * REFLECTED / (math.pi * radius**2) * lux * np.array(tint)
            _add_disc(found, at, radius * shot.focal_px, luminance)
    return found


def _sources(
    capture: CameraCapture, shot: Shot, atmosphere: Atmosphere
) -> Iterator[tuple[float, float, Array]]:
    """Column, row and illuminance (3,) of the lens in lx of every lamp that is in the picture."""
    if atmosphere.sun_lx > 0.0:
        place = _place(shot, atmosphere.sun_direction, math.inf, capture)
        if place is not None:
            yield (*place, atmosphere.sun_lx * np.asarray(atmosphere.sun_colour))
    if not shot.lamps:
        return
    way = np.array([lamp.position for lamp in shot.lamps]) - shot.eye
    distance = np.linalg.norm(way, axis=1)
    lux = intensity_towards(shot.lamps, -(way / distance[:, None])[:, None])[:, 0] / distance**2
    lux *= np.exp(-atmosphere.extinction_550nm * distance)
    for index in np.flatnonzero(lux > LEAST_LX).tolist():
        place = _place(shot, way[index], float(distance[index]), capture)
        if place is not None:
            yield (*place, lux[index] * np.asarray(shot.lamps[index].colour))


def _place(
    shot: Shot, way: Array, distance_m: float, capture: CameraCapture
) -> tuple[float, float] | None:
    """Column and row where something stands in the picture; None if it is hidden or beside."""
    IN_HOUSING_M = 0.5
    point = shot.in_camera(way[None, :])
    if point[0, 0] <= 0.0:
        return None
    column, row = (float(item[0]) for item in shot.pixels(point))
    height, width = capture.depth.shape
    if not (0.0 <= column < width and 0.0 <= row < height):
        return None
    behind = float(capture.depth[int(row), int(column)])
    along = distance_m * float(point[0, 0]) / float(np.linalg.norm(way))
    return (column, row) if behind >= along - IN_HOUSING_M else None


def _mirrored(column: float, row: float, place: float, shot: Shot) -> tuple[float, float]:
    middle_x, middle_y = shot.view.width_px / 2.0, shot.view.height_px / 2.0
    return middle_x + place * (middle_x - column), middle_y + place * (middle_y - row)


def _add_disc(
    picture: NDArray[np.float32], at: tuple[float, float], radius_px: float, luminance: Array
) -> None:
    height, width = picture.shape[:2]
    left, right = max(0, math.floor(at[0] - radius_px)), min(width, math.ceil(at[0] + radius_px))
    top, bottom = max(0, math.floor(at[1] - radius_px)), min(height, math.ceil(at[1] + radius_px))
    if left >= right or top >= bottom:
        return
    down, across = np.mgrid[top:bottom, left:right] + 0.5
    from_edge = 1.0 - np.hypot(across - at[0], down - at[1]) / radius_px
    disc = np.clip(from_edge / SOFT_EDGE, 0.0, 1.0)
    picture[top:bottom, left:right] += (disc[..., None] * luminance).astype(np.float32)
