"""Spray behind vehicles on a wet road: the plumes that a LiDAR meets, as a camera sees them."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from advercity.frames import ActorState
from advercity.geometry import poses
from advercity.geometry.arrays import Float64Array
from advercity.geometry.poses import Matrix
from advercity.rendering.backend import CameraCapture
from advercity.sensors.camera.exposure import CameraExposure
from advercity.sensors.camera.scene_light import DROP_LUMINANCE_PER_LX, AmbientLight, lamp_luminance
from advercity.sensors.spray_plumes import (
    MAX_PLUME_DISTANCE_M,
    MIN_SPRAY_SPEED_M_S,
    PLUME_DECAY_M,
    PLUME_HEIGHT_M,
    PLUME_LENGTH_M,
    SPRAY_EXTINCTION_PER_G_M3,
    SPRAY_REFERENCE_SPEED_M_S,
    SPRAY_WATER_G_M3,
    SPRAYING_CLASSES,
    has_spray,
)

NUM_PLUME_STEPS = 6
"""Points along a ray at which the thickness of a plume is taken."""
MEAN_PLUME_PROFILE = 4.0 / 9.0
"""Of what thins a plume towards its sides and its top, so that its water is the LiDAR's."""


def add_spray(
    capture: CameraCapture,
    shot: CameraExposure,
    ambience: AmbientLight,
    *,
    water_film_mm: float,
) -> CameraCapture:
    """The capture through the plumes that wheels throw up; itself where no road is so wet."""
    if not has_spray(water_film_mm):
        return capture
    for state in _find_spraying_vehicles(shot):
        capture = _add_plume(capture, shot, state, ambience)
    return capture


def _find_spraying_vehicles(shot: CameraExposure) -> Sequence[ActorState]:
    """Those that spray, the farthest first, so that nearer plumes lie before theirs."""
    found = [
        state
        for state in shot.frame.states
        if state.speed_m_s >= MIN_SPRAY_SPEED_M_S
        and state.actor.actor_class in SPRAYING_CLASSES
        and _distance_m(state, shot) < MAX_PLUME_DISTANCE_M
    ]
    return sorted(found, key=lambda state: -_distance_m(state, shot))


def _distance_m(state: ActorState, shot: CameraExposure) -> float:
    return float(np.linalg.norm(state.world_from_body[:3, 3] - shot.position))


def _add_plume(
    capture: CameraCapture, shot: CameraExposure, state: ActorState, ambience: AmbientLight
) -> CameraCapture:
    length, width, _ = state.actor.size
    middle = np.array([-(length + PLUME_LENGTH_M) / 2.0, 0.0, PLUME_HEIGHT_M / 2.0])
    world_from_plume = state.world_from_body @ poses.pose_matrix(middle)
    half = np.array([PLUME_LENGTH_M, width, PLUME_HEIGHT_M]) / 2.0
    window = _image_region(shot, world_from_plume, half)
    if window is None:
        return capture
    depth = capture.depth[window]
    rays, stretch = _pixel_rays(shot, window)
    tau = _optical_depth(shot, world_from_plume, half, rays, depth * stretch, state.speed_m_s)
    left = np.exp(-tau)[..., None]
    light = _spray_luminance(shot, world_from_plume[:3, 3], ambience)
    radiance = capture.radiance.copy()
    radiance[window] = radiance[window] * left + light * (1.0 - left)
    return replace(capture, radiance=radiance.astype(np.float32))


def _spray_luminance(
    shot: CameraExposure, place: Float64Array, ambience: AmbientLight
) -> Float64Array:
    """Luminance (3,) of dense spray: it sends on what comes from all around, and from lamps."""
    there = (place - shot.position)[None, :]
    lamps = lamp_luminance(
        shot.light_sources,
        there,
        shot.position,
        per_lx=DROP_LUMINANCE_PER_LX,
        forward_scattering=True,
    )
    return ambience.mean_luminance + ambience.sun_lx / (4.0 * math.pi) + lamps[0]


def _image_region(
    shot: CameraExposure, world_from_plume: Matrix, half: Float64Array
) -> tuple[slice, slice] | None:
    """Rows and columns that a plume may reach into; None if it is out of sight."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    corners = poses.transform_points(world_from_plume, signs * half)
    points = shot.to_camera_axes(corners - shot.position)
    if (points[:, 0] <= 0.0).all():
        return None
    height, width = shot.view.height_px, shot.view.width_px
    if (points[:, 0] < 0.2).any():
        return slice(0, height), slice(0, width)
    column, row = shot.project_points(points)
    top, bottom = max(0, math.floor(row.min())), min(height, math.ceil(row.max()))
    left, right = max(0, math.floor(column.min())), min(width, math.ceil(column.max()))
    if top >= bottom or left >= right:
        return None
    return slice(top, bottom), slice(left, right)


def _pixel_rays(
    shot: CameraExposure, window: tuple[slice, slice]
) -> tuple[Float64Array, Float64Array]:
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
    shot: CameraExposure,
    world_from_plume: Matrix,
    half: Float64Array,
    rays: Float64Array,
    until_m: Float64Array,
    speed_m_s: float,
) -> Float64Array:
    """Optical depth (r, c) of a plume along rays, as far as the surfaces behind."""
    own = rays @ world_from_plume[:3, :3]
    start = (shot.position - world_from_plume[:3, 3]) @ world_from_plume[:3, :3]
    slope = 1.0 / np.where(np.abs(own) < 1e-9, 1e-9, own)
    one, other = (-half - start) * slope, (half - start) * slope
    enter = np.minimum(one, other).max(axis=-1).clip(0.0)
    leave = np.minimum(np.maximum(one, other).min(axis=-1), until_m)
    through = np.maximum(leave - enter, 0.0)
    peak = (
        SPRAY_EXTINCTION_PER_G_M3 * SPRAY_WATER_G_M3 * (speed_m_s / SPRAY_REFERENCE_SPEED_M_S) ** 2
    )
    total = np.zeros(through.shape)
    for step in range(NUM_PLUME_STEPS):
        place = start + own * (enter + through * (step + 0.5) / NUM_PLUME_STEPS)[..., None]
        side, up = place[..., 1] / half[1], place[..., 2] / half[2]
        profile = (1.0 - side**2) * (1.0 - ((up + 1.0) / 2.0) ** 2)
        # Rays that pass the plume by may be anywhere; they go through nothing of it.
        behind_m = np.maximum(half[0] - place[..., 0], 0.0)
        total += np.exp(-behind_m / PLUME_DECAY_M) * np.maximum(profile, 0.0)
    return total * through * peak / (NUM_PLUME_STEPS * MEAN_PLUME_PROFILE)
