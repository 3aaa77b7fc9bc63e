"""Draws drops and flakes as streaks over the exposure time.

A particle of s pixels covers (pi / 4) s² pixels of light. This cover is spread over a larger area
the faster the particle moves and the closer it is to the lens.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from advercity.geometry.arrays import FloatArray
from advercity.physics.lamp_beams import LightSource
from advercity.rendering.backend import CameraCapture
from advercity.sensors.camera.exposure import CameraExposure
from advercity.sensors.camera.falling_particles import (
    FallingParticles,
    ParticleBlock,
)
from advercity.sensors.camera.scene_light import (
    DROP_LUMINANCE_PER_LX,
    FLAKE_LUMINANCE_PER_LX,
    AmbientLight,
    lamp_luminance,
)

MIN_DEPTH_M, MAX_DEPTH_M = 0.25, 20.0
MIN_OPACITY = 0.01
"""Least opacity of a drawn particle; fainter ones count as air."""
MIN_OPACITY_SHUTTER_S = 0.005
"""Shutter time above which MIN_OPACITY falls, so long exposures keep the same particles."""
LIGHT_GRID = (16, 9)
"""Columns and rows of points at which light from far away is computed; it is smooth."""
LIGHT_GRID_DEPTH_M = 3.0
DOT_COUNT_ROUNDING = 8
"""Number of dots above which it is rounded up, by an eighth at most, to few different numbers."""
NEAR_LAMPS_M, FAR_LAMPS_M = 8.0, 60.0
"""Lamps within the first distance light each particle separately; beyond the second, none."""


@dataclass(frozen=True, eq=False)
class MotionStreaks:
    """Streaks (n,) of particles in an image.

    Attributes:
        begin: (n, 2) column and row when the shutter opens, pixels.
        end: (n, 2) column and row when it closes.
        depth_m: (n,) depth halfway.
        width_px: (n,) width of the particle's sharp image.
        blur_px: (n,) diameter of the blur disc of a point at this depth.
        position: (n, 3) at the opening of the shutter, metres from the eye, world axes.
        glint: (n,) brightness relative to the mean of its size.
    """

    begin: FloatArray
    end: FloatArray
    depth_m: FloatArray
    width_px: FloatArray
    blur_px: FloatArray
    position: FloatArray
    glint: FloatArray

    @property
    def length_px(self) -> FloatArray:
        """Length of each streak."""
        return np.hypot(*(self.end - self.begin).T)

    @property
    def covered_area_px(self) -> FloatArray:
        """Area of each particle, pixels."""
        return math.pi / 4.0 * self.width_px**2

    @property
    def blurred_width_px(self) -> FloatArray:
        """Width of each streak, blurred and never less than a pixel."""
        return np.maximum(np.hypot(self.width_px, self.blur_px), 1.0)

    @property
    def opacity(self) -> FloatArray:
        """Fraction of the background hidden by each streak along its middle."""
        broad = self.blurred_width_px
        return self.covered_area_px / (broad * (self.length_px + broad))

    def select(self, where: NDArray[Any]) -> "MotionStreaks":
        """Select streaks by index or mask."""
        return MotionStreaks(*(column[where] for column in vars(self).values()))


def add_falling_particles(
    capture: CameraCapture,
    exposure: CameraExposure,
    blocks: Sequence[ParticleBlock],
    ambient_light: AmbientLight,
    *,
    extinction: float,
) -> CameraCapture:
    """Add the drops and flakes between camera and scene to a capture.

    `extinction` of the air, 1/m, reduces the contrast of far particles.
    """
    for kind in dict.fromkeys(block.kind for block in blocks):
        falling = [block for block in blocks if block.kind == kind]
        seen = project_streaks(find_visible_particles(exposure, falling), exposure)
        if len(seen.depth_m):
            capture = _draw_streaks(
                capture,
                exposure,
                seen,
                ambient_light,
                extinction,
                is_clear=falling[0].band.part.is_clear,
            )
    return capture


def find_visible_particles(
    exposure: CameraExposure, blocks: Sequence[ParticleBlock]
) -> FallingParticles:
    """Find the particles of blocks within the visible depth, in metres from the eye."""
    found: list[FallingParticles] = []
    eye, time_s = exposure.position, exposure.frame.time_s
    for block in blocks:
        max_depth_m = _max_visible_depth_m(block, exposure)
        if max_depth_m > MIN_DEPTH_M:
            planes, corners = exposure.frustum(MIN_DEPTH_M, max_depth_m)
            found.append(block.find_particles(planes, corners, eye, time_s))
    return FallingParticles.concatenate(found)


def project_streaks(particles: FallingParticles, exposure: CameraExposure) -> MotionStreaks:
    """Project particles to streaks, except particles under cover or below the least opacity."""
    open_s = exposure.camera.exposure.shutter_s
    camera_axes = exposure.view.world_from_camera[:3, :3].astype(np.float32)
    start = particles.position @ camera_axes
    relative = particles.velocity - exposure.velocity.astype(np.float32)
    path = relative @ camera_axes * np.float32(open_s)
    before = (start[:, 0] > MIN_DEPTH_M) & (start[:, 0] + path[:, 0] > MIN_DEPTH_M)
    start, path, diameter_m = start[before], path[before], particles.diameter_m[before]
    depth_m = start[:, 0] + path[:, 0] / 2.0
    found = MotionStreaks(
        begin=np.stack(exposure.project_points(start), axis=1),
        end=np.stack(exposure.project_points(start + path), axis=1),
        depth_m=depth_m,
        width_px=diameter_m * exposure.focal_px / depth_m,
        blur_px=exposure.aperture_m * exposure.focal_px / depth_m,
        position=particles.position[before],
        glint=particles.glint[before],
    )
    found = found.select(np.flatnonzero(found.opacity > _min_opacity(open_s)))
    if exposure.cover is None:
        return found
    return found.select(~exposure.cover.find_covered(exposure.position + found.position))


def _max_visible_depth_m(block: ParticleBlock, exposure: CameraExposure) -> float:
    """Compute the depth beyond which all particles of a block are below the least opacity."""
    open_s = exposure.camera.exposure.shutter_s
    path = block.fall_speed_m_s * open_s * exposure.focal_px
    cover = math.pi * (block.max_diameter_m * exposure.focal_px) ** 2 / _min_opacity(open_s)
    return min((math.sqrt(path**2 + cover) - path) / 2.0, MAX_DEPTH_M)


def _min_opacity(open_s: float) -> float:
    return MIN_OPACITY * min(1.0, MIN_OPACITY_SHUTTER_S / open_s)


def _draw_streaks(
    capture: CameraCapture,
    exposure: CameraExposure,
    streaks: MotionStreaks,
    ambient_light: AmbientLight,
    extinction: float,
    *,
    is_clear: bool,
) -> CameraCapture:
    """Draw streaks of particles, clear ones like drops or white ones like flakes, on a capture."""
    per_lx = DROP_LUMINANCE_PER_LX if is_clear else FLAKE_LUMINANCE_PER_LX
    near, far = _split_lamps_by_distance(exposure)
    lamp_light = partial(
        lamp_luminance, eye=exposure.position, per_lx=per_lx, forward_scattering=is_clear
    )
    ambient = ambient_light.drop_luminance if is_clear else ambient_light.flake_luminance
    rays = exposure.ray_grid(*LIGHT_GRID).reshape(-1, 3)
    far_light = ambient(rays) + lamp_light(far, LIGHT_GRID_DEPTH_M * rays)
    height, width = capture.depth.shape
    grid = far_light.reshape(LIGHT_GRID[1], LIGHT_GRID[0], 3).astype(np.float32)
    light = cv2.resize(grid, (width, height), interpolation=cv2.INTER_LINEAR)
    own_light = lamp_light(near, streaks.position) if near else None
    weight = streaks.covered_area_px * streaks.glint * np.exp(-extinction * streaks.depth_m)
    cover, glow = _splat_dots(streaks, weight, own_light, capture.depth)
    np.minimum(cover, 1.0, out=cover)
    # light = radiance + cover * (light - radiance), in place since images are large.
    light -= capture.radiance
    light *= cv2.merge([cover] * 3)
    light += capture.radiance
    if glow is not None:
        light += glow
    return replace(capture, radiance=light)


def _split_lamps_by_distance(
    exposure: CameraExposure,
) -> tuple[list[LightSource], list[LightSource]]:
    lamps = [
        (float(np.linalg.norm(np.subtract(lamp.position, exposure.position))), lamp)
        for lamp in exposure.light_sources
    ]
    near = [lamp for distance_m, lamp in lamps if distance_m < NEAR_LAMPS_M]
    return near, [lamp for distance_m, lamp in lamps if NEAR_LAMPS_M <= distance_m < FAR_LAMPS_M]


def _splat_dots(
    streaks: MotionStreaks,
    weight: FloatArray,
    own_light: FloatArray | None,
    depth: NDArray[np.float32],
) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
    """Sum the cover of streaks per pixel (h, w), and their own light (h, w, 3) if they have any."""
    height, width = depth.shape
    position, run, count = _place_dots(streaks)
    column, row = np.floor(position, out=position).astype(np.int32)
    # As unsigned numbers, negative indices are far beyond the other edge: one comparison for both.
    inside = column.view(np.uint32) < width
    inside &= row.view(np.uint32) < height
    visible = np.flatnonzero(inside)
    index, run = row[visible] * width + column[visible], run[visible]
    before = np.flatnonzero(depth.ravel()[index] > streaks.depth_m.astype(np.float32)[run])
    index, run = index[before], run[before]
    dot = (weight / count).astype(np.float32)[run]
    cover = np.bincount(index, dot, height * width).reshape(height, width).astype(np.float32)
    if own_light is None:
        return cover, None
    light = [np.bincount(index, dot * own_light[run, k], height * width) for k in range(3)]
    return cover, np.stack(light, axis=1).reshape(height, width, 3).astype(np.float32)


def _place_dots(streaks: MotionStreaks) -> tuple[FloatArray, NDArray[np.int32], NDArray[np.intp]]:
    """Place dots along n streaks: positions (2, m), streak of each dot (m,), dots per streak (n,).

    Each streak is a row of dots and, if it is broad, several rows. Streaks with equal numbers of
    dots are computed together.
    """
    begin, path = streaks.begin.astype(np.float32), (streaks.end - streaks.begin).astype(np.float32)
    along = _round_up_dot_count(streaks.length_px + 1.0)
    across = _round_up_dot_count(streaks.blurred_width_px)
    ratio = (streaks.blurred_width_px / np.maximum(streaks.length_px, 1e-6)).astype(np.float32)
    across_step = np.stack([-path[:, 1], path[:, 0]], axis=1) * ratio[:, None]
    pattern = along * (across.max() + 1) + across
    order = np.argsort(pattern, kind="stable")
    positions: list[FloatArray] = []
    for members in np.split(order, np.flatnonzero(np.diff(pattern[order])) + 1):
        along_count, lane_count = int(along[members[0]]), int(across[members[0]])
        fraction = ((np.arange(along_count) + 0.5) / along_count).astype(np.float32)
        position = begin[members].T[..., None] + path[members].T[..., None] * fraction
        if lane_count > 1:
            lanes = _lane_offsets(lane_count)
            position = position[..., None] + across_step[members].T[..., None, None] * lanes
        positions.append(position.reshape(2, -1))
    count = along * across
    return np.concatenate(positions, axis=1), np.repeat(order, count[order]).astype(np.int32), count


def _round_up_dot_count(size_px: FloatArray) -> NDArray[np.intp]:
    """Round sizes (n,) up to few different numbers of dots."""
    least = np.maximum(size_px, DOT_COUNT_ROUNDING)
    step = 2.0 ** np.floor(np.log2(least) - math.log2(DOT_COUNT_ROUNDING))
    return (np.ceil(size_px / step) * step).astype(np.intp)


def _lane_offsets(number: int) -> NDArray[np.float32]:
    """Compute offsets (number,) across a streak in its widths; discs are thicker in the middle."""
    off = (np.arange(number) + 0.5) / number - 0.5
    return (np.sign(off) * (1.0 - np.sqrt(1.0 - 2.0 * np.abs(off)))).astype(np.float32)
