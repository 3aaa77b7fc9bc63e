"""Draw clouds, heaps or a closed deck, for images of the sky.

Light on the ground comes from `Atmosphere.sky`, whose smooth CIE distribution is the mean over all
skies of a cloud cover. The image is one such sky, scaled to light the ground as much.

Heaps are a height field above a flat base; rays march through it in steps. They are bright if
little cloud lies between them and the sun, and grey below.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import cv2
import numpy as np

from advercity.geometry.arrays import Float32Array, Float64Array
from advercity.physics import photometry, sky
from advercity.randomness import create_generator

CloudKind = Literal["cumulus", "stratocumulus", "stratus"]

EARTH_RADIUS_M = 6.371e6
TILE_TEXELS, TILE_M = 1024, 24_000.0
"""Fields repeat after a tile; haze hides the repetition."""
STEPS = 26
CLOUD_EXTINCTION_PER_M = 0.02
"""Minimum extinction of cumulus (20 to 60 /km), for soft edges."""
EDGE, BASE_EDGE = 0.12, 0.06
"""Depth of the thinning edges of heaps, as fractions of the layer's depth."""
SUNWARD_STEPS = (0.08, 0.2, 0.42, 0.8)
"""Heights above a point at which cloud towards the sun is sampled, likewise."""
MULTIPLE_SCATTERING = 0.35
"""Factor of optical depth towards the sun: most scattered light goes on forward."""
CLOUD_ALBEDO = 0.75
HAZE_SCALE_HEIGHT_M = 1200.0
"""Height over which the haze thins out to 1/e."""
CLUSTERED_FROM_COVER = 0.75
"""Cover at which heaps stand in clusters of kilometres; few heaps stand apart."""


@dataclass(frozen=True)
class CloudLayer:
    """Clouds of one kind, their light, and the air in front of them.

    Attributes:
        kind: Heaps (cumulus), or a deck with a lumpy (stratocumulus) or an even (stratus) base.
        cover: Hidden fraction of the sky.
        base_m: Height of the base above the ground.
        depth_m: Height of the highest top above the base.
        sun: Unit vector towards the sun.
        direct_lx: Direct normal illuminance by the sun.
        diffuse_lx: Horizontal illuminance by the sky.
        ground_lx: Illuminance of the base by the ground.
        turbidity: Of the sky between the clouds.
        haze_per_m: Extinction coefficient of the air at the ground.
    """

    kind: CloudKind
    cover: float
    base_m: float
    depth_m: float
    sun: tuple[float, float, float]
    direct_lx: float
    diffuse_lx: float
    ground_lx: float
    turbidity: float
    haze_per_m: float


def choose_cloud_kind(oktas: float, *, precipitating: bool) -> tuple[CloudKind, float, float]:
    """Choose kind, base and depth in metres of clouds: heaps up to 6 eighths, then a deck.

    Few heaps are fair-weather clouds (humilis), flatter than wide; more of them tower higher
    (mediocris): International Cloud Atlas, World Meteorological Organization 2017.
    """
    if oktas <= 6:
        return "cumulus", 1300.0, 300.0 + 100.0 * oktas
    return ("stratus", 600.0, 500.0) if precipitating else ("stratocumulus", 1000.0, 400.0)


def draw_cloudy_sky(layer: CloudLayer, smooth_sky: Float32Array, size: int) -> Float32Array:
    """Draw one sky with the clouds; `smooth_sky` is the mean of all such skies.

    Args:
        layer: The clouds.
        smooth_sky: (6, n, n, 3) cubemap in cd/m², as `Atmosphere.sky`.
        size: Texels along an edge of the result.

    Returns:
        (6, size, size, 3) cubemap in cd/m² with the same illuminance of level ground.
    """
    drawn = np.stack([cv2.resize(face, (size, size)) for face in smooth_sky])
    up = photometry.cubemap_directions(size)[..., 2] > 0.0
    if layer.kind == "cumulus":
        drawn[up] = _draw_heaps(layer, size)
        bordered = photometry.stack_cubemap(drawn).reshape(6, size + 2, size + 2, 3)
        smooth = np.stack([cv2.GaussianBlur(face, (3, 3), 0.0) for face in bordered])
        drawn[up] = smooth[:, 1:-1, 1:-1][up]
    else:
        drawn[up] *= _draw_deck(layer, size)[:, None]
    wanted = photometry.horizontal_illuminance(smooth_sky)
    drawn[up] *= np.float32(wanted / photometry.horizontal_illuminance(drawn))
    return drawn


def _list_rays(size: int) -> Float64Array:
    """List the directions (k, 3) above the horizon of a cubemap's texels."""
    directions = photometry.cubemap_directions(size)
    return directions[directions[..., 2] > 0.0]


@lru_cache(maxsize=2)
def _draw_heaps(layer: CloudLayer, size: int) -> Float32Array:
    """Draw the luminance (k, 3) of heaps before a clear sky; it takes seconds."""
    rays = _list_rays(size)
    heights = build_heap_heights(layer)
    opacity, luminance = march_heaps(heights, layer, rays)
    haze_depth = layer.haze_per_m * HAZE_SCALE_HEIGHT_M
    haze_depth *= -math.expm1(-layer.base_m / HAZE_SCALE_HEIGHT_M)
    through_haze = np.exp(
        -haze_depth * _distance_to_height(rays[:, 2], layer.base_m) / layer.base_m
    )
    clear = _draw_clear_sky(layer, rays)
    added, kept = through_haze * luminance, 1.0 - through_haze * opacity
    return (added[:, None] + kept[:, None] * clear).astype(np.float32)


def _draw_clear_sky(layer: CloudLayer, rays: Float64Array) -> Float64Array:
    """Draw the luminance (n, 3) of the sky between the clouds, as on a clear day."""
    sun = np.array(layer.sun)
    cie_type = sky.cie_sky_type(0, turbidity=layer.turbidity)
    coarse = sky.cie_relative_luminance(photometry.cubemap_directions(32), sun, cie_type)
    elevation_deg = math.degrees(math.asin(layer.sun[2]))
    scale = sky.clear_daylight(elevation_deg).diffuse_lx / photometry.horizontal_illuminance(
        coarse[..., None] * np.ones(3)
    )
    relative = sky.cie_relative_luminance(rays, sun, cie_type)[:, None]
    return scale * relative * sky.sky_colour(rays, sun, cloud_fraction=0.0)


@lru_cache(maxsize=2)
def _draw_deck(layer: CloudLayer, size: int) -> Float32Array:
    """Draw the brightness (k,) of a deck relative to its mean: thin cloud transmits more."""
    rays = _list_rays(size)
    rng = create_generator("clouds", layer.kind)
    if layer.kind == "stratocumulus":
        lumps, contrast = _build_noise(rng, first_cells=16, octaves=6, gain=0.6), 0.22
    else:
        lumps, contrast = _build_noise(rng, first_cells=10, octaves=7, gain=0.65), 0.07
    path_m = _distance_to_height(rays[:, 2], layer.base_m)
    tone = _sample_tile(lumps, rays[:, 0] * path_m, rays[:, 1] * path_m)
    # Towards the horizon lumps appear from the side and merge.
    return np.exp(contrast * tone * np.minimum(1.0, 4.0 * rays[:, 2])).astype(np.float32)


def build_heap_heights(layer: CloudLayer) -> Float32Array:
    """Build the heights of heaps (n, n) as fractions of the layer's depth, 0 between them.

    The field is shifted to have a gap in front of the sun, and cut at the height at which heaps
    hide `layer.cover` of the sky above the horizon. The more they hide, the more they cluster.
    """
    rng = create_generator("clouds", layer.kind)
    billows = sum(
        weight * (1.0 - np.abs(_build_noise(rng, first_cells=cells, octaves=1)))
        for cells, weight in ((20, 1.0), (40, 0.5), (80, 0.28), (160, 0.16), (320, 0.09))
    )
    clusters = 0.55 * layer.cover / CLUSTERED_FROM_COVER
    field = clusters * _build_noise(rng, first_cells=6, octaves=2)
    field += 0.36 * _build_noise(rng, first_cells=16, octaves=6, gain=0.55) + 0.55 * billows
    field = _move_gap_to_sun(field.astype(np.float32), layer)
    rays = _spread_rays()
    low, high = float(field.min()), float(field.max())
    for _ in range(8):
        threshold = (low + high) / 2.0
        hidden = _march_opacity(_cut_heights(field, threshold), layer, rays).mean()
        low, high = (threshold, high) if hidden > layer.cover else (low, threshold)
    return _cut_heights(field, (low + high) / 2.0)


def _cut_heights(field: Float32Array, threshold: float) -> Float32Array:
    return np.clip((field - threshold) / (float(field.max()) - threshold), 0.0, 1.0) ** 0.75


def _move_gap_to_sun(field: Float32Array, layer: CloudLayer) -> Float32Array:
    """Shift a field so that its widest gap lies where the sun's rays cross the layer."""
    blocks, coarse = 32, TILE_TEXELS // 32
    means = field.reshape(blocks, coarse, blocks, coarse).mean(axis=(1, 3))
    around = [np.roll(means, (i, j), axis=(0, 1)) for i in (-1, 0, 1) for j in (-1, 0, 1)]
    row, column = np.unravel_index(np.argmin(np.sum(around, axis=0)), means.shape)
    path_m = _distance_to_height(np.array(layer.sun[2:]), layer.base_m + 0.5 * layer.depth_m)[0]
    x, y = (int(path_m * layer.sun[axis] / TILE_M * TILE_TEXELS) for axis in (0, 1))
    gap_y, gap_x = (int((cell + 0.5) * coarse) for cell in (row, column))
    return np.roll(field, (y - gap_y, x - gap_x), axis=(0, 1))


def march_heaps(
    heights: Float32Array, layer: CloudLayer, rays: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """March through heaps from below.

    Args:
        heights: (n, n) from `build_heap_heights`.
        layer: The clouds.
        rays: (k, 3) upward unit vectors.

    Returns:
        Opacity (k,), and luminance (k,) in cd/m² at their base.
    """
    cosine = np.clip(rays @ np.array(layer.sun), -1.0, 1.0)
    towards_sun = 0.9 + 0.6 * np.exp(-3.0 * np.arccos(cosine))
    opacity, luminance = np.zeros(len(rays)), np.zeros(len(rays))
    for height, step_m, position in _iterate_steps(layer, rays):
        own = _compute_step_opacity(_sample_tile(heights, *position), height, step_m)
        inside = np.flatnonzero(own)
        if not len(inside):
            continue
        own, height = own[inside], height[inside]
        at = position[0][inside], position[1][inside]
        glow = _compute_sunlight(heights, layer, at, height) * towards_sun[inside]
        glow += layer.diffuse_lx * (0.25 + 0.75 * height) + layer.ground_lx * (1.0 - height)
        own *= 1.0 - opacity[inside]
        luminance[inside] += own * glow * CLOUD_ALBEDO / math.pi
        opacity[inside] += own
    return opacity, luminance


def _march_opacity(heights: Float32Array, layer: CloudLayer, rays: Float64Array) -> Float64Array:
    """March for the opacity (k,) alone."""
    clear = np.ones(len(rays))
    for height, step_m, position in _iterate_steps(layer, rays):
        clear *= 1.0 - _compute_step_opacity(_sample_tile(heights, *position), height, step_m)
    return 1.0 - clear


def _iterate_steps(
    layer: CloudLayer, rays: Float64Array
) -> Iterator[tuple[Float64Array, Float64Array, tuple[Float64Array, Float64Array]]]:
    """Iterate over heights as fractions of the depth, step lengths and positions x, y, all (k,).

    Each ray has its own heights in each step, as common ones would show as strata.
    """
    offset = create_generator("clouds", "steps").random(len(rays))
    near = _distance_to_height(rays[:, 2], layer.base_m)
    far = _distance_to_height(rays[:, 2], layer.base_m + layer.depth_m)
    for step in range(STEPS):
        height = (step + offset) / STEPS
        path_m = near + (far - near) * height
        yield height, (far - near) / STEPS, (path_m * rays[:, 0], path_m * rays[:, 1])


def _compute_step_opacity(
    heights: Float64Array, height: Float64Array, step_m: Float64Array
) -> Float64Array:
    density = np.clip((heights - height) / EDGE, 0.0, 1.0) * np.minimum(1.0, height / BASE_EDGE)
    return -np.expm1(-CLOUD_EXTINCTION_PER_M * density * step_m)


def _compute_sunlight(
    heights: Float32Array,
    layer: CloudLayer,
    at: tuple[Float64Array, Float64Array],
    height: Float64Array,
) -> Float64Array:
    """Compute the illuminance (k,) by the sun of points in heaps at a height."""
    depth = np.zeros(len(at[0]))
    slant = 1.0 / max(float(layer.sun[2]), 0.1)
    for above in SUNWARD_STEPS:
        x, y = (at[axis] + layer.sun[axis] * slant * above * layer.depth_m for axis in (0, 1))
        covered = np.clip((_sample_tile(heights, x, y) - height - above) / EDGE, 0.0, 1.0)
        depth += covered * above
    depth *= MULTIPLE_SCATTERING * CLOUD_EXTINCTION_PER_M * layer.depth_m * slant
    # Two decays: for light scattered once and for light scattered many times.
    return layer.direct_lx * (0.75 * np.exp(-depth) + 0.25 * np.exp(-0.25 * depth))


def _distance_to_height(sines: Float64Array, height_m: float) -> Float64Array:
    """Compute the length of a ray at a sine of elevation to a height above the round earth."""
    down = EARTH_RADIUS_M * sines
    return np.sqrt(down**2 + 2.0 * EARTH_RADIUS_M * height_m) - down


def _spread_rays() -> Float64Array:
    """Spread rays (k, 3) evenly over the whole dome, which observers divide into eighths."""
    count = 4000
    sine = (np.arange(count) + 0.5) / count
    azimuth = np.arange(count) * math.pi * (3.0 - math.sqrt(5.0))
    level = np.sqrt(1.0 - sine**2)
    return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), sine], axis=1)


def _build_noise(
    rng: np.random.Generator, *, first_cells: int, octaves: int, gain: float = 0.5
) -> Float32Array:
    """Build periodic value noise (n, n) of mean 0 and variance 1."""
    noise = np.zeros((TILE_TEXELS, TILE_TEXELS), dtype=np.float32)
    for octave in range(octaves):
        cells = first_cells << octave
        at = np.arange(TILE_TEXELS) * (cells / TILE_TEXELS)
        low = at.astype(int)
        part = (at - low).astype(np.float32)
        part = part * part * (3.0 - 2.0 * part)
        lattice = rng.standard_normal((cells, cells)).astype(np.float32)
        high = (low + 1) % cells
        rows = lattice[low] * (1.0 - part)[:, None] + lattice[high] * part[:, None]
        noise += gain**octave * (rows[:, low] * (1.0 - part) + rows[:, high] * part)
    noise -= noise.mean()
    return noise / noise.std()


def _sample_tile(tile: Float32Array, x: Float64Array, y: Float64Array) -> Float64Array:
    """Sample a tile (n, n) bilinearly at positions (k,) in metres."""
    column, row = (np.mod(axis * (TILE_TEXELS / TILE_M), TILE_TEXELS) for axis in (x, y))
    # OpenCV's images have less than 32768 columns.
    width = 4096
    room = -len(column) % width
    columns, rows = (
        np.pad(axis, (0, room)).astype(np.float32).reshape(-1, width) for axis in (column, row)
    )
    sampled = cv2.remap(tile, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    return sampled.ravel()[: len(column)].astype(np.float64)
