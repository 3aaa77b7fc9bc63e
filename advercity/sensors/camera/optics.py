"""Optics of a camera: spots on the glass, stray light, ghosts of bright lamps, and vignetting."""

import math
from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from advercity_dsl import Mount
from advercity_dsl.weather_components import Lens
from numpy.typing import NDArray

from advercity.geometry.arrays import Float32Array, Float64Array
from advercity.materials import SNOWFLAKE_ALBEDO
from advercity.physics.atmosphere import Atmosphere
from advercity.physics.lamp_beams import intensity_towards
from advercity.rendering.backend import CameraCapture
from advercity.sensors.camera.exposure import CameraExposure
from advercity.sensors.covered_glass import find_side, list_coverage

GLASS_DISTANCE_M = 0.05
"""Distance of the glass from the entrance pupil: too close for a sharp image."""
SPOT_MM = {"water": 3.0, "dust": 0.8, "snow": 6.0}
"""Median diameter of a spot, by kind."""
SPOT_SIZE_DEVIATION = 0.35
"""Standard deviation of the logarithm of diameters."""
DROP_MAGNIFICATION = -2.5
"""Scale of the scene in a drop: inverted, and reduced to this many of the drop's own widths."""
GLASS_DUST_ALBEDO = 0.3
OpenCvArray = NDArray[np.floating[Any] | np.integer[Any]]
"""Arrays returned by OpenCV according to its type stubs."""

STRAY_LIGHT_CORE_RAD = math.radians(0.5)
STRAY_LIGHT_CUTOFF_RAD = math.radians(60.0)
VEIL_WIDTH_PX = 256
"""Width of the image for the computation of the veil, which is smooth."""
GHOST_REFLECTANCE = 5e-5
"""Fraction of a lamp's light in one ghost, after reflections at two coated surfaces."""
LENS_GHOSTS: tuple[tuple[float, float, tuple[float, float, float]], ...] = (
    (0.4, 2.0, (0.7, 1.1, 0.9)),
    (0.7, 3.5, (0.8, 1.0, 1.5)),
    (1.2, 5.0, (1.3, 0.9, 0.8)),
    (-0.5, 1.5, (1.0, 1.0, 1.0)),
    (-1.3, 4.0, (0.9, 1.1, 0.7)),
)
"""Position of each ghost on the line from lamp to image centre, its radius in degrees, tint.

Position 0 is the centre, 1 is as far beyond it as the lamp is on this side.
"""
GHOST_EDGE_FRACTION = 0.25
"""Width of a ghost's soft edge relative to its radius."""
LAMP_HOUSING_M = 0.5
"""Largest depth of a lamp behind the surface of its own housing."""
MIN_GHOST_LX = 0.05
"""Least illuminance of the lens by a lamp for visible ghosts."""


def glass_coverage(lens: Lens, mount: Mount) -> float:
    """Return the covered fraction of a camera's glass by its heading; 0 if lenses stay clean."""
    return list_coverage(lens)[find_side(mount.yaw_deg)]


def apply_glass(
    light: Float32Array,
    exposure: CameraExposure,
    kind: str,
    coverage: float,
    rng: np.random.Generator,
) -> Float32Array:
    """Cover a fraction of the glass in front of an image (h, w, 3) in cd/m² by spots of a kind.

    The blur of spots follows from focal length and aperture. The same state of `rng` gives the same
    spots; coverage 0 leaves the image unchanged.
    """
    if coverage == 0.0:
        return light
    height, width = light.shape[:2]
    middle, radius_px = _draw_spots(exposure, kind, coverage, rng)
    mask = np.zeros((height, width), np.float32)
    shift = np.zeros((height, width, 2), np.float32)
    for at, radius in zip(middle, radius_px, strict=True):
        _stamp_spot(mask, shift, at, radius)
    blur_px = max(exposure.aperture_m * exposure.focal_px / GLASS_DISTANCE_M, 1.0)
    mask = cv2.GaussianBlur(mask, (0, 0), blur_px / 4.0)[..., None]
    mean = light.mean(axis=(0, 1))
    if kind == "water":
        down, across = np.mgrid[:height, :width].astype(np.float32)
        blurred = cv2.GaussianBlur(light, (0, 0), blur_px)
        at = across + shift[..., 0], down + shift[..., 1]
        behind = cv2.remap(blurred, *at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101)
        spot = (behind + mean) / 2.0
    else:
        spot = mean * (GLASS_DUST_ALBEDO if kind == "dust" else SNOWFLAKE_ALBEDO)
    return (light * (1.0 - mask) + spot * mask).astype(np.float32)


def _draw_spots(
    exposure: CameraExposure, kind: str, coverage: float, rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Draw columns and rows (n, 2) and radii (n,) in pixels of spots on the glass."""
    height, width = exposure.view.height_px, exposure.view.width_px
    scale = exposure.focal_px / GLASS_DISTANCE_M
    median_px = SPOT_MM[kind] * 1e-3 * scale
    mean_area = math.pi / 4.0 * median_px**2 * math.exp(2.0 * SPOT_SIZE_DEVIATION**2)
    # Spots overlap at random, so the uncovered fraction is exp(-number times mean area).
    count = rng.poisson(-math.log1p(-min(coverage, 0.95)) * height * width / mean_area)
    diameter = SPOT_MM[kind] * 1e-3 * np.exp(SPOT_SIZE_DEVIATION * rng.standard_normal(count))
    return rng.random((count, 2)) * [width, height], diameter * scale / 2.0


def _stamp_spot(
    mask: Float32Array, shift: Float32Array, at: NDArray[np.float64], radius: float
) -> None:
    """Mark the pixels of a spot, and the shift (h, w, 2) to the pixels shown in it."""
    pixels, off = _pixels_around(at, radius, mask.shape)
    inside = np.hypot(off[..., 0], off[..., 1]) < radius
    mask[pixels][inside] = 1.0
    shift[pixels][inside] = ((DROP_MAGNIFICATION - 1.0) * off[inside]).astype(np.float32)


def _pixels_around(
    at: NDArray[np.float64], radius: float, shape: tuple[int, ...]
) -> tuple[tuple[slice, slice], NDArray[np.float64]]:
    """Find the pixels around a disc, and the offsets (r, c, 2) of their centres from its centre.

    Both are empty if the disc is outside the image.
    """
    height, width = shape[:2]
    left, right = max(0, math.floor(at[0] - radius)), min(width, math.ceil(at[0] + radius))
    top, bottom = max(0, math.floor(at[1] - radius)), min(height, math.ceil(at[1] + radius))
    pixels = slice(top, max(top, bottom)), slice(left, max(left, right))
    row, column = np.mgrid[pixels] + 0.5
    return pixels, np.stack([column - at[0], row - at[1]], axis=-1)


def add_stray_light(
    radiance: Float32Array, *, horizontal_fov_rad: float, fraction: float
) -> Float32Array:
    """Compute the radiance (h, w, 3) behind a lens with a fraction e of scattered light.

    The point-spread function is (1 - e) delta + e C / (theta² + theta_0²)^1.5. The veil is computed
    on a small copy of the image with the kernel of its centre and equally bright surroundings.
    """
    height, width = radiance.shape[:2]
    scale = min(1.0, VEIL_WIDTH_PX / width)
    small_size = max(1, round(width * scale)), max(1, round(height * scale))
    # INTER_AREA keeps the mean, so lamps of few pixels are not lost.
    small = cv2.resize(radiance, small_size, interpolation=cv2.INTER_AREA)
    focal_px = small_size[0] / (2.0 * math.tan(horizontal_fov_rad / 2.0))
    veil = _compute_veil(small.astype(np.float32), focal_px)
    spread = cv2.resize(veil, (width, height), interpolation=cv2.INTER_LINEAR)
    return cv2.addWeighted(radiance, 1.0 - fraction, spread, fraction, 0.0).astype(np.float32)


def _compute_veil(image: Float32Array, focal_px: float) -> Float32Array:
    """Convolve an image (h, w, 3) with the scattering kernel, normalised at the edges."""
    height, width = image.shape[:2]
    spectrum, within = _kernel_spectrum(height, width, focal_px)
    spread = [_convolve_channel(channel, spectrum) / within for channel in cv2.split(image)]
    return np.maximum(np.stack(spread, axis=-1), 0.0).astype(np.float32)


def _convolve_channel(channel: OpenCvArray, spectrum: OpenCvArray) -> OpenCvArray:
    height, width = channel.shape
    padded = np.zeros(spectrum.shape)
    padded[:height, :width] = channel
    product = cv2.mulSpectrums(cv2.dft(padded, nonzeroRows=height), spectrum, 0)
    return cv2.idft(product, flags=cv2.DFT_SCALE, nonzeroRows=height)[:height, :width]


@lru_cache(maxsize=16)
def _kernel_spectrum(height: int, width: int, focal_px: float) -> tuple[OpenCvArray, OpenCvArray]:
    """Compute the kernel's spectrum for images of a size, and its weight within them (h, w)."""
    # Twice the size, so the cyclic convolution does not wrap around the image.
    spectrum = cv2.dft(_scattering_kernel((2 * height, 2 * width), focal_px))
    return spectrum, _convolve_channel(np.ones((height, width)), spectrum)


def _scattering_kernel(shape: tuple[int, int], focal_px: float) -> NDArray[np.float64]:
    """Compute the kernel of sum 1 around the optical axis, centred on [0, 0] and wrapped around."""
    rows, columns = (np.fft.fftfreq(count, 1.0 / count) for count in shape)
    angle = np.arctan(np.hypot(rows[:, None], columns[None, :]) / focal_px)
    kernel = np.where(
        angle < STRAY_LIGHT_CUTOFF_RAD, (angle**2 + STRAY_LIGHT_CORE_RAD**2) ** -1.5, 0.0
    )
    return kernel / kernel.sum()


def add_lens_ghosts(
    light: NDArray[np.float32],
    capture: CameraCapture,
    exposure: CameraExposure,
    atmosphere: Atmosphere,
) -> NDArray[np.float32]:
    """Add the ghosts of the sun and of lamps in view to an image (h, w, 3) in cd/m²."""
    strength = exposure.camera.flare
    if strength == 0.0:
        return light
    found = light.copy()
    middle = np.array([exposure.view.width_px, exposure.view.height_px]) / 2.0
    for column, row, lux in _find_ghost_sources(capture, exposure, atmosphere):
        for place, radius_deg, tint in LENS_GHOSTS:
            at = middle + place * (middle - [column, row])
            radius = math.radians(radius_deg)
            luminance = strength * GHOST_REFLECTANCE / (math.pi * radius**2) * lux * np.array(tint)
            _add_disc(found, at, radius * exposure.focal_px, luminance)
    return found


def _find_ghost_sources(
    capture: CameraCapture, exposure: CameraExposure, atmosphere: Atmosphere
) -> Iterator[tuple[float, float, Float64Array]]:
    """Yield column, row and illuminance (3,) of the lens in lx for every visible bright lamp."""
    if atmosphere.sun_lx > 0.0:
        place = _locate_in_image(exposure, atmosphere.sun_direction, math.inf, capture)
        if place is not None:
            yield (*place, atmosphere.sun_lx * np.asarray(atmosphere.sun_colour))
    if not exposure.light_sources:
        return
    direction = np.array([lamp.position for lamp in exposure.light_sources]) - exposure.position
    distance = np.linalg.norm(direction, axis=1)
    towards = -(direction / distance[:, None])[:, None]
    lux = intensity_towards(exposure.light_sources, towards)[:, 0] / distance**2
    lux *= np.exp(-atmosphere.extinction.at_550nm * distance)
    for index in np.flatnonzero(lux > MIN_GHOST_LX).tolist():
        place = _locate_in_image(exposure, direction[index], float(distance[index]), capture)
        if place is not None:
            yield (*place, lux[index] * np.asarray(exposure.light_sources[index].colour))


def _locate_in_image(
    exposure: CameraExposure, direction: Float64Array, distance_m: float, capture: CameraCapture
) -> tuple[float, float] | None:
    """Find column and row of a lamp; None if it is hidden or outside the image."""
    point = exposure.to_camera_axes(direction[None, :])
    if point[0, 0] <= 0.0:
        return None
    column, row = (float(item[0]) for item in exposure.project_points(point))
    height, width = capture.depth.shape
    if not (0.0 <= column < width and 0.0 <= row < height):
        return None
    background_m = float(capture.depth[int(row), int(column)])
    along = distance_m * float(point[0, 0]) / float(np.linalg.norm(direction))
    return (column, row) if background_m >= along - LAMP_HOUSING_M else None


def _add_disc(
    image: NDArray[np.float32], at: Float64Array, radius_px: float, luminance: Float64Array
) -> None:
    pixels, off = _pixels_around(at, radius_px, image.shape)
    from_edge = 1.0 - np.hypot(off[..., 0], off[..., 1]) / radius_px
    disc = np.clip(from_edge / GHOST_EDGE_FRACTION, 0.0, 1.0)
    image[pixels] += (disc[..., None] * luminance).astype(np.float32)


def apply_vignetting(
    light: NDArray[np.float32], focal_px: float, exponent: float
) -> NDArray[np.float32]:
    """Darken an image (h, w, 3) by cos^exponent of the angle off the optical axis.

    4 is a simple lens without vignetting of its own, 0 a fully corrected one.
    """
    if exponent == 0.0:
        return light
    return light * _vignetting_factor(*light.shape[:2], focal_px, exponent)


@lru_cache(maxsize=4)
def _vignetting_factor(
    height: int, width: int, focal_px: float, exponent: float
) -> NDArray[np.float32]:
    """Compute the transmittance (h, w, 1) of each pixel."""
    down = (np.arange(height, dtype=np.float32) + 0.5 - height / 2.0) / focal_px
    right = (np.arange(width, dtype=np.float32) + 0.5 - width / 2.0) / focal_px
    cosine = 1.0 / np.sqrt(1.0 + down[:, None] ** 2 + right[None, :] ** 2)
    return (cosine**exponent)[..., None].astype(np.float32)
