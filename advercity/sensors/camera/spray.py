"""Spray behind vehicles on a wet road: the plumes that a LiDAR meets, as a camera sees them."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from advercity_dsl import Weather
from numpy.typing import NDArray

from advercity import poses
from advercity.poses import Matrix
from advercity.rendering.backend import CameraCapture
from advercity.sensors.camera.ambience import DROP_OF_LAMP, Ambience, by_lamps
from advercity.sensors.camera.shot import Shot
from advercity.sensors.lidar.spray import (
    EXTINCTION_PER_G_M3,
    FADING_M,
    FARTHEST_M,
    HEIGHT_M,
    LEAST_FILM_MM,
    LEAST_SPEED_M_S,
    LENGTH_M,
    REFERENCE_SPEED_M_S,
    WATER_G_M3,
    WHEELED,
)
from advercity.traffic.trace import ActorState

Array = NDArray[np.float64]
STEPS = 6
"""Points along a ray at which the thickness of a plume is taken."""
MEAN_OF_PROFILE = 4.0 / 9.0
"""Of what thins a plume towards its sides and its top, so that its water is the LiDAR's."""


def with_spray(
    capture: CameraCapture, shot: Shot, weather: Weather, ambience: Ambience
) -> CameraCapture:
    """The capture through the plumes that wheels throw up; itself where no road is so wet."""
    if weather.surface.film_mm <= LEAST_FILM_MM:
        return capture
    for state in _spraying(shot):
        capture = _behind_plume(capture, shot, state, ambience)
    return capture


def _spraying(shot: Shot) -> Sequence[ActorState]:
    """Those that spray, the farthest first, so that nearer plumes lie before theirs."""
    found = [
        state
        for state in shot.frame.states
        if state.speed_m_s >= LEAST_SPEED_M_S
        and state.actor.actor_class in WHEELED
        and _away_m(state, shot) < FARTHEST_M
    ]
    return sorted(found, key=lambda state: -_away_m(state, shot))


def _away_m(state: ActorState, shot: Shot) -> float:
    return float(np.linalg.norm(state.world_from_body[:3, 3] - shot.eye))


def _behind_plume(
    capture: CameraCapture, shot: Shot, state: ActorState, ambience: Ambience
) -> CameraCapture:
    length, width, _ = state.actor.size
    middle = np.array([-(length + LENGTH_M) / 2.0, 0.0, HEIGHT_M / 2.0])
    world_from_plume = state.world_from_body @ poses.pose(middle)
    half = np.array([LENGTH_M, width, HEIGHT_M]) / 2.0
    window = _window(shot, world_from_plume, half)
    if window is None:
        return capture
    depth = capture.depth[window]
    rays, stretch = _rays(shot, window)
    tau = _optical_depth(shot, world_from_plume, half, rays, depth * stretch, state.speed_m_s)
    left = np.exp(-tau)[..., None]
    light = _light(shot, world_from_plume[:3, 3], ambience)
    radiance = capture.radiance.copy()
    radiance[window] = radiance[window] * left + light * (1.0 - left)
    return replace(capture, radiance=radiance.astype(np.float32))


def _light(shot: Shot, place: Array, ambience: Ambience) -> Array:
    """Luminance (3,) of dense spray: it sends on what comes from all around, and from lamps."""
    there = (place - shot.eye)[None, :]
    lamps = by_lamps(shot.lamps, there, shot.eye, per_lx=DROP_OF_LAMP, boosted=True)
    return ambience.mean + ambience.sun_lx / (4.0 * math.pi) + lamps[0]


def _window(shot: Shot, world_from_plume: Matrix, half: Array) -> tuple[slice, slice] | None:
    """Rows and columns that a plume may reach into; None if it is out of sight."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    corners = poses.transform(world_from_plume, signs * half)
    points = shot.in_camera(corners - shot.eye)
    if (points[:, 0] <= 0.0).all():
        return None
    height, width = shot.view.height_px, shot.view.width_px
    if (points[:, 0] < 0.2).any():
        return slice(0, height), slice(0, width)
    column, row = shot.pixels(points)
    top, bottom = max(0, math.floor(row.min())), min(height, math.ceil(row.max()))
    left, right = max(0, math.floor(column.min())), min(width, math.ceil(column.max()))
    if top >= bottom or left >= right:
        return None
    return slice(top, bottom), slice(left, right)


def _rays(shot: Shot, window: tuple[slice, slice]) -> tuple[Array, Array]:
    """Unit rays (r, c, 3) of the world through pixels, and their lengths (r, c) by depth."""
    rows, columns = (np.arange(item.start, item.stop) + 0.5 for item in window)
    right, down = np.meshgrid(
        (columns - shot.view.width_px / 2.0) / shot.focal_px,
        (rows - shot.view.height_px / 2.0) / shot.focal_px,
    )
    rays = np.stack([np.ones_like(right), -right, -down], axis=-1)
    stretch = np.linalg.norm(rays, axis=-1)
    return rays / stretch[..., None] @ shot.view.world_from_camera[:3, :3].T, stretch


def _optical_depth(
    shot: Shot,
    world_from_plume: Matrix,
    half: Array,
    rays: Array,
    until_m: Array,
    speed_m_s: float,
) -> Array:
    """Optical depth (r, c) of a plume along rays, as far as the surfaces behind."""
    own = rays @ world_from_plume[:3, :3]
    start = (shot.eye - world_from_plume[:3, 3]) @ world_from_plume[:3, :3]
    slope = 1.0 / np.where(np.abs(own) < 1e-9, 1e-9, own)
    one, other = (-half - start) * slope, (half - start) * slope
    enter = np.minimum(one, other).max(axis=-1).clip(0.0)
    leave = np.minimum(np.maximum(one, other).min(axis=-1), until_m)
    through = np.maximum(leave - enter, 0.0)
    peak = EXTINCTION_PER_G_M3 * WATER_G_M3 * (speed_m_s / REFERENCE_SPEED_M_S) ** 2
    total = np.zeros(through.shape)
    for step in range(STEPS):
        place = start + own * (enter + through * (step + 0.5) / STEPS)[..., None]
        side, up = place[..., 1] / half[1], place[..., 2] / half[2]
        profile = (1.0 - side**2) * (1.0 - ((up + 1.0) / 2.0) ** 2)
        # Rays that pass the plume by may be anywhere; they go through nothing of it.
        behind_m = np.maximum(half[0] - place[..., 0], 0.0)
        total += np.exp(-behind_m / FADING_M) * np.maximum(profile, 0.0)
    return total * through * peak / (STEPS * MEAN_OF_PROFILE)
