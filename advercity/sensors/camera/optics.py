"""Drops, dust and snow on the glass before a lens; much too near to be sharp.

Light that a lens scatters away from where it belongs: veils around lamps and the sun.

Ghosts: discs of light that two reflections inside a lens throw opposite bright lamps.

Pictures are darker towards their corners.
"""

import math
from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from advercity_dsl import Mount
from advercity_dsl.weather import Lens
from numpy.typing import NDArray

from advercity.geometry.arrays import Float32Array, Float64Array
from advercity.materials import SNOWFLAKE_ALBEDO
from advercity.physics.atmosphere import Atmosphere
from advercity.physics.lamp_beams import intensity_towards
from advercity.rendering.backend import CameraCapture
from advercity.sensors.camera.exposure import CameraExposure

GLASS_DISTANCE_M = 0.05
"""Before the entrance pupil."""
SPOT_MM = {"water": 3.0, "dust": 0.8, "snow": 6.0}
"""Median diameter of a spot, by what it is."""
SPOT_SIZE_DEVIATION = 0.35
"""Of the logarithm of diameters."""
DROP_MAGNIFICATION = -2.5
"""How a drop shows what is behind it: upside down, and that much of it within its own width."""
GLASS_DUST_ALBEDO = 0.3
SIDE_VIEW_DEG, REAR_VIEW_DEG = 45.0, 135.0
"""Headings from which a camera looks to the side, and to the rear."""


def glass_coverage(lens: Lens, mount: Mount) -> float:
    """Share of the glass of a camera that is covered, by where it looks; 0 if lenses stay clean."""
    if not lens.enabled:
        return 0.0
    turned = abs(math.remainder(mount.yaw_deg, 360.0))
    if turned < SIDE_VIEW_DEG:
        return lens.coverage.front
    return lens.coverage.side if turned < REAR_VIEW_DEG else lens.coverage.rear


def apply_glass(
    light: Float32Array, shot: CameraExposure, lens: Lens, coverage: float, rng: np.random.Generator
) -> Float32Array:
    """A picture (h, w, 3) in cd/m² through glass of which a share is covered.

    Args:
        light: What comes to the glass.
        shot: Its focal length and aperture say how blurred the glass is.
        lens: What is on it.
        coverage: 0 leaves the picture as it is.
        rng: Of this camera; the same puts the same spots in the same places.
    """
    if coverage == 0.0:
        return light
    height, width = light.shape[:2]
    middle, radius_px = _draw_spots(shot, lens.kind, coverage, rng)
    mask = np.zeros((height, width), np.float32)
    shift = np.zeros((height, width, 2), np.float32)
    for at, radius in zip(middle, radius_px, strict=True):
        _stamp_spot(mask, shift, at, radius)
    blur_px = max(shot.aperture_m * shot.focal_px / GLASS_DISTANCE_M, 1.0)
    mask = cv2.GaussianBlur(mask, (0, 0), blur_px / 4.0)[..., None]
    mean = light.mean(axis=(0, 1))
    if lens.kind == "water":
        down, across = np.mgrid[:height, :width].astype(np.float32)
        behind = cv2.remap(
            cv2.GaussianBlur(light, (0, 0), blur_px),
            across + shift[..., 0],
            down + shift[..., 1],
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REFLECT_101,
        )
        spot = (behind + mean) / 2.0
    else:
        spot = mean * (GLASS_DUST_ALBEDO if lens.kind == "dust" else SNOWFLAKE_ALBEDO)
    return (light * (1.0 - mask) + spot * mask).astype(np.float32)


def _draw_spots(
    shot: CameraExposure, kind: str, coverage: float, rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Column and row (n, 2) and radius (n,) in pixels of spots that cover a share of the glass."""
    height, width = shot.view.height_px, shot.view.width_px
    scale = shot.focal_px / GLASS_DISTANCE_M
    mean_area = (
        math.pi / 4.0 * (SPOT_MM[kind] * 1e-3 * scale) ** 2 * math.exp(2.0 * SPOT_SIZE_DEVIATION**2)
    )
    count = rng.poisson(-math.log1p(-min(coverage, 0.95)) * height * width / mean_area)
    diameter = SPOT_MM[kind] * 1e-3 * np.exp(SPOT_SIZE_DEVIATION * rng.standard_normal(count))
    return rng.random((count, 2)) * [width, height], diameter * scale / 2.0


def _stamp_spot(
    mask: Float32Array, shift: Float32Array, at: NDArray[np.float64], radius: float
) -> None:
    height, width = mask.shape
    left, right = max(0, math.floor(at[0] - radius)), min(width, math.ceil(at[0] + radius))
    top, bottom = max(0, math.floor(at[1] - radius)), min(height, math.ceil(at[1] + radius))
    if left >= right or top >= bottom:
        return
    down, across = np.mgrid[top:bottom, left:right] + 0.5
    off = np.stack([across - at[0], down - at[1]], axis=-1)
    inside = np.hypot(off[..., 0], off[..., 1]) < radius
    mask[top:bottom, left:right][inside] = 1.0
    shift[top:bottom, left:right][inside] = ((DROP_MAGNIFICATION - 1.0) * off[inside]).astype(
        np.float32
    )


OpenCvArray = NDArray[np.floating[Any] | np.integer[Any]]
"""What OpenCV may return, by its stubs."""

STRAY_LIGHT_CORE_RAD = math.radians(0.5)
STRAY_LIGHT_CUTOFF_RAD = math.radians(60.0)
VEIL_WIDTH_PX = 256
"""Width at which the veil is worked out; it is smooth, so that is fine enough."""


def add_stray_light(
    radiance: Float32Array, *, horizontal_fov_rad: float, fraction: float
) -> Float32Array:
    """Radiance (h, w, 3) behind a lens that scatters `share` of the light.

    The point-spread function is (1 - e) delta + e C / (theta² + theta_0²)^1.5. The veil is worked
    out on a small copy of the picture, as around its middle; what is beyond the edges is taken to
    be like what is within.
    """
    height, width = radiance.shape[:2]
    scale = min(1.0, VEIL_WIDTH_PX / width)
    small_size = max(1, round(width * scale)), max(1, round(height * scale))
    small = cv2.resize(radiance, small_size, interpolation=cv2.INTER_AREA)
    focal_px = small_size[0] / (2.0 * math.tan(horizontal_fov_rad / 2.0))
    veil = _compute_veil(small.astype(np.float32), focal_px)
    spread = cv2.resize(veil, (width, height), interpolation=cv2.INTER_LINEAR)
    return cv2.addWeighted(radiance, 1.0 - fraction, spread, fraction, 0.0).astype(np.float32)


def _compute_veil(picture: Float32Array, focal_px: float) -> Float32Array:
    """The picture (h, w, 3) convolved with the scattering kernel, edges made up for."""
    height, width = picture.shape[:2]
    spectrum, within = _kernel_spectrum(height, width, focal_px)
    spread = [_convolve_channel(channel, spectrum) / within for channel in cv2.split(picture)]
    return np.maximum(np.stack(spread, axis=-1), 0.0).astype(np.float32)


def _convolve_channel(channel: OpenCvArray, spectrum: OpenCvArray) -> OpenCvArray:
    height, width = channel.shape
    padded = np.zeros(spectrum.shape)
    padded[:height, :width] = channel
    product = cv2.mulSpectrums(cv2.dft(padded, nonzeroRows=height), spectrum, 0)
    return cv2.idft(product, flags=cv2.DFT_SCALE, nonzeroRows=height)[:height, :width]


@lru_cache(maxsize=16)
def _kernel_spectrum(height: int, width: int, focal_px: float) -> tuple[OpenCvArray, OpenCvArray]:
    """Spectrum of the kernel for pictures of a size, and what of it falls within (h, w)."""
    spectrum = cv2.dft(_scattering_kernel((2 * height, 2 * width), focal_px))
    return spectrum, _convolve_channel(np.ones((height, width)), spectrum)


def _scattering_kernel(shape: tuple[int, int], focal_px: float) -> NDArray[np.float64]:
    """Scattering kernel of sum 1 around the optical axis, centred on [0, 0] and wrapped around."""
    rows, columns = (np.fft.fftfreq(count, 1.0 / count) for count in shape)
    angle = np.arctan(np.hypot(rows[:, None], columns[None, :]) / focal_px)
    kernel = np.where(
        angle < STRAY_LIGHT_CUTOFF_RAD, (angle**2 + STRAY_LIGHT_CORE_RAD**2) ** -1.5, 0.0
    )
    return kernel / kernel.sum()


GHOST_REFLECTANCE = 5e-5
"""Of the light of a lamp, what two coated surfaces send into one ghost."""
LENS_GHOSTS: tuple[tuple[float, float, tuple[float, float, float]], ...] = (
    (0.4, 2.0, (0.7, 1.1, 0.9)),
    (0.7, 3.5, (0.8, 1.0, 1.5)),
    (1.2, 5.0, (1.3, 0.9, 0.8)),
    (-0.5, 1.5, (1.0, 1.0, 1.0)),
    (-1.3, 4.0, (0.9, 1.1, 0.7)),
)
"""Where a ghost stands on the line from the lamp through the middle, its radius in degrees, tint.

A place of 0 is the middle itself, 1 is as far beyond it as the lamp is on this side.
"""
GHOST_EDGE_FRACTION = 0.25
"""Of a ghost's radius."""
MIN_GHOST_LX = 0.05
"""Lamps that light the lens less throw none that are seen."""


def add_lens_ghosts(
    light: NDArray[np.float32], capture: CameraCapture, shot: CameraExposure, atmosphere: Atmosphere
) -> NDArray[np.float32]:
    """A picture (h, w, 3) in cd/m² with the ghosts of the sun and of lamps it looks into."""
    strength = shot.camera.flare
    if strength == 0.0:
        return light
    found = light.copy()
    for column, row, lux in _find_ghost_sources(capture, shot, atmosphere):
        for place, radius_deg, tint in LENS_GHOSTS:
            at = _mirror_position(column, row, place, shot)
            radius = math.radians(radius_deg)
            luminance = strength * GHOST_REFLECTANCE / (math.pi * radius**2) * lux * np.array(tint)
            _add_disc(found, at, radius * shot.focal_px, luminance)
    return found


def _find_ghost_sources(
    capture: CameraCapture, shot: CameraExposure, atmosphere: Atmosphere
) -> Iterator[tuple[float, float, Float64Array]]:
    """Column, row and illuminance (3,) of the lens in lx of every lamp that is in the picture."""
    if atmosphere.sun_lx > 0.0:
        place = _locate_in_image(shot, atmosphere.sun_direction, math.inf, capture)
        if place is not None:
            yield (*place, atmosphere.sun_lx * np.asarray(atmosphere.sun_colour))
    if not shot.light_sources:
        return
    way = np.array([lamp.position for lamp in shot.light_sources]) - shot.position
    distance = np.linalg.norm(way, axis=1)
    lux = (
        intensity_towards(shot.light_sources, -(way / distance[:, None])[:, None])[:, 0]
        / distance**2
    )
    lux *= np.exp(-atmosphere.extinction.at_550nm * distance)
    for index in np.flatnonzero(lux > MIN_GHOST_LX).tolist():
        place = _locate_in_image(shot, way[index], float(distance[index]), capture)
        if place is not None:
            yield (*place, lux[index] * np.asarray(shot.light_sources[index].colour))


def _locate_in_image(
    shot: CameraExposure, way: Float64Array, distance_m: float, capture: CameraCapture
) -> tuple[float, float] | None:
    """Column and row where something stands in the picture; None if it is hidden or beside."""
    IN_HOUSING_M = 0.5
    point = shot.to_camera_axes(way[None, :])
    if point[0, 0] <= 0.0:
        return None
    column, row = (float(item[0]) for item in shot.project_points(point))
    height, width = capture.depth.shape
    if not (0.0 <= column < width and 0.0 <= row < height):
        return None
    behind = float(capture.depth[int(row), int(column)])
    along = distance_m * float(point[0, 0]) / float(np.linalg.norm(way))
    return (column, row) if behind >= along - IN_HOUSING_M else None


def _mirror_position(
    column: float, row: float, place: float, shot: CameraExposure
) -> tuple[float, float]:
    middle_x, middle_y = shot.view.width_px / 2.0, shot.view.height_px / 2.0
    return middle_x + place * (middle_x - column), middle_y + place * (middle_y - row)


def _add_disc(
    picture: NDArray[np.float32], at: tuple[float, float], radius_px: float, luminance: Float64Array
) -> None:
    height, width = picture.shape[:2]
    left, right = max(0, math.floor(at[0] - radius_px)), min(width, math.ceil(at[0] + radius_px))
    top, bottom = max(0, math.floor(at[1] - radius_px)), min(height, math.ceil(at[1] + radius_px))
    if left >= right or top >= bottom:
        return
    down, across = np.mgrid[top:bottom, left:right] + 0.5
    from_edge = 1.0 - np.hypot(across - at[0], down - at[1]) / radius_px
    disc = np.clip(from_edge / GHOST_EDGE_FRACTION, 0.0, 1.0)
    picture[top:bottom, left:right] += (disc[..., None] * luminance).astype(np.float32)


def apply_vignetting(
    light: NDArray[np.float32], focal_px: float, exponent: float
) -> NDArray[np.float32]:
    """A picture (h, w, 3) behind a lens that lets cos^exponent through, by the angle off its axis.

    4 is a plain lens without any vignetting of its own, 0 one that makes up for everything.
    """
    if exponent == 0.0:
        return light
    return light * _vignetting_factor(*light.shape[:2], focal_px, exponent)


@lru_cache(maxsize=4)
def _vignetting_factor(
    height: int, width: int, focal_px: float, exponent: float
) -> NDArray[np.float32]:
    """What comes through (h, w, 1) of the light."""
    down = (np.arange(height, dtype=np.float32) + 0.5 - height / 2.0) / focal_px
    right = (np.arange(width, dtype=np.float32) + 0.5 - width / 2.0) / focal_px
    cosine = 1.0 / np.sqrt(1.0 + down[:, None] ** 2 + right[None, :] ** 2)
    return (cosine**exponent)[..., None].astype(np.float32)
