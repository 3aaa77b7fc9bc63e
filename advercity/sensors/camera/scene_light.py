"""Luminance of drops and flakes in the air, and the sun's disc.

A drop refracts light from a wide field into the eye, so its brightness hardly depends on the
background (Garg and Nayar 2007); a flake is a white ball. The sun's disc is too bright and too
small for a cubemap, so it is drawn onto the image.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from advercity.geometry.arrays import Float64Array, FloatArray
from advercity.physics.atmosphere import Atmosphere
from advercity.physics.lamp_beams import LightSource, intensity_towards
from advercity.physics.photometry import cubemap_directions, cubemap_solid_angles
from advercity.rendering.backend import CameraCapture, CameraView
from advercity.sensors.camera.exposure import pixel_rays

AMBIENT_SKY_SIZE = 8
"""Texels along an edge of the averaged sky: enough for a smooth one."""
DROP_HALF_VIEW_RAD = math.radians(165.0 / 2.0)
"""Half of the field refracted into the eye by a drop."""
DROP_WEIGHT = 0.94
"""Weight of that field in a drop's luminance; the rest is the mean of all directions."""
FLAKE_ALBEDO = 0.9
DROP_LUMINANCE_PER_LX = 0.1 / math.pi
"""Luminance of a drop per illuminance by a lamp to the side."""
FLAKE_LUMINANCE_PER_LX = FLAKE_ALBEDO / (4.0 * math.pi)
"""Luminance of a flake per illuminance by a lamp in any direction."""
FORWARD_BOOST, FORWARD_BOOST_RAD = 10.0, math.radians(20.0)
"""Gain of a drop in front of a lamp, and the angle off the lamp at which the gain ends."""
MIN_LAMP_DISTANCE_M = 0.7
"""Distance within which a lamp is not a point: it represents the two lamps of a vehicle."""
PAIRS_PER_BATCH = 2**14
"""Pairs of lamp and point in one batch, which bounds memory."""
SUN_RADIUS_RAD = math.radians(0.533 / 2.0)
"""Half the sun's angular diameter."""
SUN_MARGIN = 0.1
"""Distance of the sun from the image, in focal lengths, beyond which its disc is outside."""


@dataclass(frozen=True, eq=False)
class AmbientLight:
    """Light from sky, ground and sun at a point in the open.

    Attributes:
        directions: (n, 3) unit.
        luminance: (n, 3) of sky and ground in these directions, cd/m², linear sRGB.
        solid_angle_fraction: (n,) fraction of the sphere for each direction; the sum is 1.
        sun: Unit vector (3,) towards the sun.
        sun_lx: (3,) illuminance by direct sunlight, linear sRGB.
    """

    directions: Float64Array
    luminance: Float64Array
    solid_angle_fraction: Float64Array
    sun: Float64Array
    sun_lx: Float64Array

    @staticmethod
    def from_atmosphere(atmosphere: Atmosphere) -> "AmbientLight":
        """Average the sky of an atmosphere to few directions."""
        fine = atmosphere.sky.shape[1]
        block = max(1, fine // AMBIENT_SKY_SIZE)
        size = fine // block
        coarse = atmosphere.sky.astype(np.float64).reshape(6, size, block, size, block, 3)
        solid_angle = np.tile(cubemap_solid_angles(size).ravel(), 6)
        return AmbientLight(
            directions=cubemap_directions(size).reshape(-1, 3),
            luminance=coarse.mean(axis=(2, 4)).reshape(-1, 3),
            solid_angle_fraction=solid_angle / solid_angle.sum(),
            sun=atmosphere.sun_direction,
            sun_lx=atmosphere.sun_lx * np.asarray(atmosphere.sun_colour),
        )

    @property
    def mean_luminance(self) -> Float64Array:
        """Mean luminance (3,) of all directions, without the sun."""
        # No matrix product: OpenBLAS sums in another order for every number of threads.
        return np.einsum("n,nj->j", self.solid_angle_fraction, self.luminance)

    def drop_luminance(self, rays: Float64Array) -> Float64Array:
        """Compute the luminance (n, 3) of drops along unit view rays (n, 3)."""
        refracted = rays @ self.directions.T > math.cos(DROP_HALF_VIEW_RAD)
        within = refracted * self.solid_angle_fraction
        wide = within @ self.luminance / within.sum(axis=1, keepdims=True)
        sun = DROP_LUMINANCE_PER_LX * forward_boost(rays @ self.sun)[:, None] * self.sun_lx
        return DROP_WEIGHT * wide + (1.0 - DROP_WEIGHT) * self.mean_luminance + sun

    def flake_luminance(self, rays: Float64Array) -> Float64Array:
        """Compute the luminance (n, 3) of flakes, the same along all unit rays (n, 3)."""
        around = FLAKE_ALBEDO * self.mean_luminance + FLAKE_LUMINANCE_PER_LX * self.sun_lx
        return np.broadcast_to(around, rays.shape)


def forward_boost(cosine: FloatArray) -> FloatArray:
    """Compute a drop's gain (...) from the cosine (...) between view ray and lamp."""
    boost = np.ones_like(cosine)
    before = np.nonzero(cosine > math.cos(FORWARD_BOOST_RAD))
    nearness = 1.0 - np.arccos(np.minimum(cosine[before], 1.0)) / FORWARD_BOOST_RAD
    boost[before] += (FORWARD_BOOST - 1.0) * nearness**2 * (3.0 - 2.0 * nearness)
    return boost


def lamp_luminance(
    lamps: Sequence[LightSource],
    points: FloatArray,
    eye: Float64Array,
    *,
    per_lx: float,
    forward_scattering: bool,
) -> NDArray[np.float32]:
    """Compute the luminance (n, 3) of drops or flakes at points (n, 3) by lamps.

    Points are in metres from the `eye` (3,), in the world's axes; occlusion of lamps is ignored.
    `per_lx` is luminance per illuminance by a lamp to the side; with `forward_scattering` particles
    are brighter in front of a lamp, as drops are.
    """
    near = points.astype(np.float32)
    view_rays = near / np.maximum(np.linalg.norm(near, axis=1, keepdims=True), 1e-6)
    total = np.zeros_like(near)
    batch = max(1, PAIRS_PER_BATCH // max(1, len(near)))
    for batch_lamps in (lamps[first : first + batch] for first in range(0, len(lamps), batch)):
        position = np.array([lamp.position for lamp in batch_lamps]) - eye
        rays = near - position[:, None].astype(np.float32)
        distance = np.maximum(np.linalg.norm(rays, axis=2), MIN_LAMP_DISTANCE_M)
        rays /= distance[..., None]
        light = per_lx * intensity_towards(batch_lamps, rays) / distance**2
        if forward_scattering:
            light *= forward_boost(-np.einsum("mni,ni->mn", rays, view_rays))
        total += light.T @ np.array([lamp.colour for lamp in batch_lamps], np.float32)
    return total


def add_sun_disc(capture: CameraCapture, view: CameraView, atmosphere: Atmosphere) -> CameraCapture:
    """Add the sun's disc to a capture where it shows open sky.

    The disc's luminance over its pixels gives the sun's illuminance at any size of pixels.
    """
    sun = view.world_from_camera[:3, :3].T @ atmosphere.sun_direction
    if atmosphere.sun_lx <= 0.0 or sun[0] <= math.sin(SUN_RADIUS_RAD):
        return capture
    height, width = capture.depth.shape
    focal_px = width / (2.0 * math.tan(view.horizontal_fov_rad / 2.0))
    corner_px = math.hypot(width, height) / 2.0
    if focal_px * math.hypot(sun[1], sun[2]) > (corner_px + SUN_MARGIN * focal_px) * sun[0]:
        return capture
    column = width / 2.0 - focal_px * sun[1] / sun[0]
    row = height / 2.0 - focal_px * sun[2] / sun[0]
    margin = math.ceil(focal_px * SUN_RADIUS_RAD / sun[0] ** 2) + 2
    rows = np.arange(math.floor(row) - margin, math.floor(row) + margin + 1)
    columns = np.arange(math.floor(column) - margin, math.floor(column) + margin + 1)

    rays, length = pixel_rays(rows + 0.5 - height / 2.0, columns + 0.5 - width / 2.0, focal_px)
    solid_angle = focal_px / length**3
    off_centre = np.linalg.norm(np.cross(rays, sun), axis=-1)
    coverage = np.clip(0.5 + (SUN_RADIUS_RAD - off_centre) / np.sqrt(solid_angle), 0.0, 1.0)
    # The disc may fall between the centres of four much larger pixels.
    if not coverage.any():
        coverage.flat[off_centre.argmin()] = 1.0
    luminance = atmosphere.sun_lx * coverage / np.sum(coverage * solid_angle)
    disc = luminance[..., None] * np.asarray(atmosphere.sun_colour)

    visible_rows = np.flatnonzero((rows >= 0) & (rows < height))
    visible_columns = np.flatnonzero((columns >= 0) & (columns < width))
    pixels = np.ix_(rows[visible_rows], columns[visible_columns])
    sky = np.isinf(capture.depth[pixels])[..., None]
    radiance = capture.radiance.copy()
    radiance[pixels] += (disc[np.ix_(visible_rows, visible_columns)] * sky).astype(np.float32)
    return replace(capture, radiance=radiance)
