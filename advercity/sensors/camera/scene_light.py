"""Light that small things in the air send to a camera: drops, flakes and spray.

A drop refracts light from far around into the eye, so its brightness hardly depends on what is
behind it (Garg and Nayar 2007); a flake is a white ball.

The sun's disc, which is too bright and too small for a cubemap.
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

AMBIENT_SKY_SIZE = 8
"""Texels along an edge of the sky that is averaged; it is smooth."""
DROP_HALF_VIEW_RAD = math.radians(165.0 / 2.0)
"""Half of what a drop lets one see."""
DROP_WEIGHT = 0.94
"""Of what lies within that, against everything around."""
FLAKE_ALBEDO = 0.9
DROP_LUMINANCE_PER_LX = 0.1 / math.pi
"""Luminance of a drop by the illuminance of a lamp, seen from aside."""
FLAKE_LUMINANCE_PER_LX = FLAKE_ALBEDO / (4.0 * math.pi)
"""The same of a flake, whichever side of it is lit."""
FORWARD_BOOST, FORWARD_BOOST_RAD = 10.0, math.radians(20.0)
"""How much brighter a drop is right before a lamp, and how far from it that ends."""
MIN_LAMP_DISTANCE_M = 0.7
"""The two lamps of a vehicle stand apart; nearer than this they are no point."""
PAIRS_PER_BATCH = 2**14
"""Pairs of lamp and point that are worked out together."""


@dataclass(frozen=True, eq=False)
class AmbientLight:
    """Sky, ground and sun as seen from one place.

    Attributes:
        directions: (n, 3) unit.
        luminance: (n, 3) of the sky and the ground there, cd/m², linear sRGB.
        solid_angle_fraction: (n,) of the sphere that each stands for; their sum is 1.
        sun: (3,) towards it.
        sun_lx: (3,) of its direct light.
    """

    directions: Float64Array
    luminance: Float64Array
    solid_angle_fraction: Float64Array
    sun: Float64Array
    sun_lx: Float64Array

    @staticmethod
    def from_atmosphere(atmosphere: Atmosphere) -> "AmbientLight":
        """Of an atmosphere."""
        fine = atmosphere.sky.shape[1]
        block = max(1, fine // AMBIENT_SKY_SIZE)
        size = fine // block
        coarse = atmosphere.sky.astype(np.float64).reshape(6, size, block, size, block, 3)
        share = np.tile(cubemap_solid_angles(size).ravel(), 6)
        return AmbientLight(
            directions=cubemap_directions(size).reshape(-1, 3),
            luminance=coarse.mean(axis=(2, 4)).reshape(-1, 3),
            solid_angle_fraction=share / share.sum(),
            sun=atmosphere.sun_direction,
            sun_lx=atmosphere.sun_lx * np.asarray(atmosphere.sun_colour),
        )

    @property
    def mean_luminance(self) -> Float64Array:
        """Mean luminance (3,) of everything around, the sun left out."""
        return self.solid_angle_fraction @ self.luminance

    def drop_luminance(self, rays: Float64Array) -> Float64Array:
        """Luminance (n, 3) of drops seen along unit rays (n, 3)."""
        within = (
            rays @ self.directions.T > math.cos(DROP_HALF_VIEW_RAD)
        ) * self.solid_angle_fraction
        wide = within @ self.luminance / within.sum(axis=1, keepdims=True)
        sun = DROP_LUMINANCE_PER_LX * forward_boost(rays @ self.sun)[:, None] * self.sun_lx
        return DROP_WEIGHT * wide + (1.0 - DROP_WEIGHT) * self.mean_luminance + sun

    def flake_luminance(self, rays: Float64Array) -> Float64Array:
        """Luminance (n, 3) of flakes, the same whichever way one looks."""
        around = FLAKE_ALBEDO * self.mean_luminance + FLAKE_LUMINANCE_PER_LX * self.sun_lx
        return np.broadcast_to(around, rays.shape)


def forward_boost(cosine: FloatArray) -> FloatArray:
    """How much brighter a drop (...) is by the cosine between view ray and the way to the lamp."""
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
    """Luminance (n, 3) that lamps give to drops or flakes at points (n, 3).

    Args:
        lamps: Nothing is taken to stand between them and the points.
        points: Metres from the eye, axes of the world.
        eye: (3,) from where they are seen.
        per_lx: Luminance by illuminance, from aside.
        forward_scattering: Whether they are brighter before a lamp, as drops are.
    """
    near = points.astype(np.float32)
    seen = near / np.maximum(np.linalg.norm(near, axis=1, keepdims=True), 1e-6)
    sum_ = np.zeros_like(near)
    at_once = max(1, PAIRS_PER_BATCH // max(1, len(near)))
    for some in (lamps[first : first + at_once] for first in range(0, len(lamps), at_once)):
        position = np.array([lamp.position for lamp in some]) - eye
        away = near - position[:, None].astype(np.float32)
        distance = np.maximum(np.linalg.norm(away, axis=2), MIN_LAMP_DISTANCE_M)
        away /= distance[..., None]
        light = per_lx * intensity_towards(some, away) / distance**2
        if forward_scattering:
            light *= forward_boost(-np.einsum("mni,ni->mn", away, seen))
        sum_ += light.T @ np.array([lamp.colour for lamp in some], np.float32)
    return sum_


SUN_RADIUS_RAD = math.radians(0.533 / 2.0)
"""Half the sun's angular diameter."""

SUN_MARGIN = 0.1
"""How far outside the picture, in focal lengths, the disc may stand and still reach into it."""


def add_sun_disc(capture: CameraCapture, view: CameraView, atmosphere: Atmosphere) -> CameraCapture:
    """The capture with the sun's disc where the picture shows open sky.

    Spread over its pixels the disc gives exactly the sun's illuminance, however coarse they are.
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
    reach = math.ceil(focal_px * SUN_RADIUS_RAD / sun[0] ** 2) + 2
    rows = np.arange(math.floor(row) - reach, math.floor(row) + reach + 1)
    columns = np.arange(math.floor(column) - reach, math.floor(column) + reach + 1)

    rays, solid_angle = _pixel_rays(
        rows + 0.5 - height / 2.0, columns + 0.5 - width / 2.0, focal_px
    )
    off_centre = np.linalg.norm(np.cross(rays, sun), axis=-1)
    coverage = np.clip(0.5 + (SUN_RADIUS_RAD - off_centre) / np.sqrt(solid_angle), 0.0, 1.0)
    if not coverage.any():  # between four pixels that are much larger than the disc
        coverage.flat[off_centre.argmin()] = 1.0
    luminance = atmosphere.sun_lx * coverage / np.sum(coverage * solid_angle)
    disc = luminance[..., None] * np.asarray(atmosphere.sun_colour)

    seen_rows = np.flatnonzero((rows >= 0) & (rows < height))
    seen_columns = np.flatnonzero((columns >= 0) & (columns < width))
    place = np.ix_(rows[seen_rows], columns[seen_columns])
    sky = np.isinf(capture.depth[place])[..., None]
    radiance = capture.radiance.copy()
    radiance[place] += (disc[np.ix_(seen_rows, seen_columns)] * sky).astype(np.float32)
    return replace(capture, radiance=radiance)


def _pixel_rays(
    down: Float64Array, right: Float64Array, focal_px: float
) -> tuple[Float64Array, Float64Array]:
    """Unit rays (r, c, 3) in the camera's frame and solid angles (r, c) of pixels."""
    grid_down, grid_right = np.meshgrid(down, right, indexing="ij")
    rays = np.stack([np.full_like(grid_down, focal_px), -grid_right, -grid_down], axis=-1)
    distance = np.linalg.norm(rays, axis=-1)
    return rays / distance[..., None], focal_px / distance**3
