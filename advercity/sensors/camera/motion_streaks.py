"""Drops and flakes as the shutter smears them over a picture.

While the shutter is open a particle of s pixels covers (pi / 4) s² pixels of light; the faster it
moves and the nearer it is to the lens, the thinner that is spread.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from advercity.geometry.arrays import FloatArray
from advercity.physics.lamp_beams import LightSource
from advercity.rendering.backend import CameraCapture
from advercity.sensors.camera.exposure import CameraExposure
from advercity.sensors.camera.falling_particles import FallingParticles, ParticleBlock
from advercity.sensors.camera.scene_light import (
    DROP_LUMINANCE_PER_LX,
    FLAKE_LUMINANCE_PER_LX,
    AmbientLight,
    lamp_luminance,
)

MIN_DEPTH_M, MAX_DEPTH_M = 0.25, 20.0
MIN_OPACITY = 0.01
"""Share of the light behind that a particle must take to be drawn; fainter ones are air."""
MIN_OPACITY_SHUTTER_S = 0.005
"""A shutter that is open for longer spreads the same particles thinner, and hides none of them."""
LIGHT_GRID = (16, 9)
"""Points across and down at which light from far away is worked out; it is smooth."""
LIGHT_GRID_DEPTH_M = 3.0
DOT_COUNT_ROUNDING = 8
"""Dots from which on their number is rounded up, by an eighth at most."""
NEAR_LAMPS_M, FAR_LAMPS_M = 8.0, 60.0
"""Lamps nearer than the first light each particle its own way; farther than the second, none."""


@dataclass(frozen=True, eq=False)
class MotionStreaks:
    """Traces (n,) of particles in a picture, and what they are.

    Attributes:
        begin: (n, 2) column and row when the shutter opens, pixels.
        end: (n, 2) when it closes.
        depth_m: (n,) in the middle.
        width_px: (n,) of the particle's own image, sharp.
        blur_px: (n,) of the disc that the lens makes of a point so near.
        position: (n, 3) in the middle, metres from the eye, world axes.
        glint: (n,) how much more each shows than its size says; 1 in the mean.
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
        """How far each moves."""
        return np.hypot(*(self.end - self.begin).T)

    @property
    def covered_area_px(self) -> FloatArray:
        """Area that each covers in the mean over the exposure, pixels."""
        return math.pi / 4.0 * self.width_px**2

    @property
    def blurred_width_px(self) -> FloatArray:
        """Width of each trace, blurred and never less than a pixel."""
        return np.maximum(np.hypot(self.width_px, self.blur_px), 1.0)

    @property
    def opacity(self) -> FloatArray:
        """Share of the light behind that a pixel in the middle of each trace loses."""
        broad = self.blurred_width_px
        return self.covered_area_px / (broad * (self.length_px + broad))

    def select(self, where: NDArray[Any]) -> "MotionStreaks":
        """Those alone."""
        return MotionStreaks(
            self.begin[where],
            self.end[where],
            self.depth_m[where],
            self.width_px[where],
            self.blur_px[where],
            self.position[where],
            self.glint[where],
        )


def add_falling_particles(
    capture: CameraCapture,
    shot: CameraExposure,
    blocks: Sequence[ParticleBlock],
    ambience: AmbientLight,
    *,
    extinction: float,
) -> CameraCapture:
    """The capture with the drops and flakes that fly between camera and scene.

    Args:
        capture: What is behind.
        shot: Where from, and how long the shutter is open.
        blocks: All that falls.
        ambience: Light around.
        extinction: Of the air, 1/m; it takes contrast from what is far.
    """
    for kind in ("rain", "snow"):
        falling = [block for block in blocks if block.kind == kind]
        seen = project_streaks(find_visible_particles(shot, falling), shot)
        if len(seen.depth_m):
            capture = _draw_streaks(capture, shot, seen, ambience, kind, extinction)
    return capture


def find_visible_particles(
    shot: CameraExposure, blocks: Sequence[ParticleBlock]
) -> FallingParticles:
    """Particles of blocks that may be seen, in metres from the eye."""
    found: list[FallingParticles] = []
    for block in blocks:
        reach_m = _max_visible_depth_m(block, shot)
        if reach_m > MIN_DEPTH_M:
            planes, corners = shot.frustum(MIN_DEPTH_M, reach_m)
            found.append(block.find_particles(planes, corners, shot.position, shot.frame.time_s))
    return FallingParticles.concatenate(found)


def project_streaks(particles: FallingParticles, shot: CameraExposure) -> MotionStreaks:
    """Traces of the particles that are seen well enough."""
    open_s = shot.camera.exposure.shutter_s
    turn = shot.view.world_from_camera[:3, :3].astype(np.float32)
    start = particles.position @ turn
    way = (particles.velocity - shot.velocity.astype(np.float32)) @ turn * np.float32(open_s)
    before = (start[:, 0] > MIN_DEPTH_M) & (start[:, 0] + way[:, 0] > MIN_DEPTH_M)
    start, way, diameter_m = start[before], way[before], particles.diameter_m[before]
    depth_m = start[:, 0] + way[:, 0] / 2.0
    found = MotionStreaks(
        begin=np.stack(shot.project_points(start), axis=1),
        end=np.stack(shot.project_points(start + way), axis=1),
        depth_m=depth_m,
        width_px=diameter_m * shot.focal_px / depth_m,
        blur_px=shot.aperture_m * shot.focal_px / depth_m,
        position=particles.position[before],
        glint=particles.glint[before],
    )
    return found.select(np.flatnonzero(found.opacity > _min_opacity(open_s)))


def _max_visible_depth_m(block: ParticleBlock, shot: CameraExposure) -> float:
    """Depth beyond which no particle of the block is seen well enough, however it flies."""
    open_s = shot.camera.exposure.shutter_s
    way = block.fall_speed_m_s * open_s * shot.focal_px
    cover = math.pi * (block.max_diameter_m * shot.focal_px) ** 2 / _min_opacity(open_s)
    return min((math.sqrt(way**2 + cover) - way) / 2.0, MAX_DEPTH_M)


def _min_opacity(open_s: float) -> float:
    return MIN_OPACITY * min(1.0, MIN_OPACITY_SHUTTER_S / open_s)


def _draw_streaks(
    capture: CameraCapture,
    shot: CameraExposure,
    streaks: MotionStreaks,
    ambience: AmbientLight,
    kind: str,
    extinction: float,
) -> CameraCapture:
    is_rain = kind == "rain"
    per_lx = DROP_LUMINANCE_PER_LX if is_rain else FLAKE_LUMINANCE_PER_LX
    near, far = _split_lamps_by_distance(shot)
    rays = shot.ray_grid(*LIGHT_GRID).reshape(-1, 3)
    far_light = ambience.drop_luminance(rays) if is_rain else ambience.flake_luminance(rays)
    middle = LIGHT_GRID_DEPTH_M * rays
    far_light = far_light + lamp_luminance(
        far, middle, shot.position, per_lx=per_lx, forward_scattering=is_rain
    )
    height, width = capture.depth.shape
    grid = far_light.reshape(LIGHT_GRID[1], LIGHT_GRID[0], 3).astype(np.float32)
    light = cv2.resize(grid, (width, height), interpolation=cv2.INTER_LINEAR)

    own = None
    if near:
        own = lamp_luminance(
            near, streaks.position, shot.position, per_lx=per_lx, forward_scattering=is_rain
        )
    weight = streaks.covered_area_px * streaks.glint * np.exp(-extinction * streaks.depth_m)
    cover, glow = _splat_dots(streaks, weight, own, capture.depth)
    np.minimum(cover, 1.0, out=cover)
    light -= capture.radiance
    light *= cv2.merge([cover] * 3)
    light += capture.radiance
    if glow is not None:
        light += glow
    return replace(capture, radiance=light)


def _split_lamps_by_distance(shot: CameraExposure) -> tuple[list[LightSource], list[LightSource]]:
    if not shot.light_sources:
        return [], []
    positions = np.array([lamp.position for lamp in shot.light_sources])
    away = np.linalg.norm(positions - shot.position, axis=1).tolist()
    near = [lamp for lamp, m in zip(shot.light_sources, away, strict=True) if m < NEAR_LAMPS_M]
    far = [
        lamp
        for lamp, m in zip(shot.light_sources, away, strict=True)
        if NEAR_LAMPS_M <= m < FAR_LAMPS_M
    ]
    return near, far


def _splat_dots(
    streaks: MotionStreaks, weight: FloatArray, own: FloatArray | None, depth: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
    """What traces cover of each pixel (h, w), and the light (h, w, 3) of their own they add."""
    height, width = depth.shape
    place, run, count = _place_dots(streaks)
    column, row = np.floor(place, out=place).astype(np.int32)
    # As unsigned numbers what is left of the picture or above it lies far beyond it.
    inside = column.view(np.uint32) < width
    inside &= row.view(np.uint32) < height
    kept = np.flatnonzero(inside)
    index, run = row[kept] * width + column[kept], run[kept]
    before = np.flatnonzero(depth.ravel()[index] > streaks.depth_m.astype(np.float32)[run])
    index, run = index[before], run[before]
    dot = (weight / count).astype(np.float32)[run]
    cover = np.bincount(index, dot, height * width).reshape(height, width).astype(np.float32)
    if own is None:
        return cover, None
    shine = [np.bincount(index, dot * own[run, channel], height * width) for channel in range(3)]
    return cover, np.stack(shine, axis=1).reshape(height, width, 3).astype(np.float32)


def _place_dots(streaks: MotionStreaks) -> tuple[FloatArray, NDArray[np.int32], NDArray[np.intp]]:
    """Places (2, m) of dots along n traces, whose each (m,) is, and how many dots each (n,) has.

    Each trace is a row of dots and, where it is broad, several across. Traces of as many dots are
    worked out together.
    """
    begin, way = streaks.begin.astype(np.float32), (streaks.end - streaks.begin).astype(np.float32)
    along = _round_up_dot_count(streaks.length_px + 1.0)
    across = _round_up_dot_count(streaks.blurred_width_px)
    aside = np.stack([-way[:, 1], way[:, 0]], axis=1)
    aside *= (streaks.blurred_width_px / np.maximum(streaks.length_px, 1e-6)).astype(np.float32)[
        :, None
    ]
    pattern = along * (across.max() + 1) + across
    order = np.argsort(pattern, kind="stable")
    places: list[FloatArray] = []
    for some in np.split(order, np.flatnonzero(np.diff(pattern[order])) + 1):
        lines, lanes = int(along[some[0]]), int(across[some[0]])
        share = ((np.arange(lines) + 0.5) / lines).astype(np.float32)
        place = begin[some].T[..., None] + way[some].T[..., None] * share
        if lanes > 1:
            place = place[..., None] + aside[some].T[..., None, None] * _lane_offsets(lanes)
        places.append(place.reshape(2, -1))
    count = along * across
    return np.concatenate(places, axis=1), np.repeat(order, count[order]).astype(np.int32), count


def _round_up_dot_count(size_px: FloatArray) -> NDArray[np.intp]:
    """Numbers of dots (n,) that are enough, of which there are few different ones."""
    step = 2.0 ** np.floor(
        np.log2(np.maximum(size_px, DOT_COUNT_ROUNDING)) - math.log2(DOT_COUNT_ROUNDING)
    )
    return (np.ceil(size_px / step) * step).astype(np.intp)


def _lane_offsets(number: int) -> NDArray[np.float32]:
    """Where (number,) dots lie across a trace, in widths of it; discs are thick in the middle."""
    off = (np.arange(number) + 0.5) / number - 0.5
    return (np.sign(off) * (1.0 - np.sqrt(1.0 - 2.0 * np.abs(off)))).astype(np.float32)
