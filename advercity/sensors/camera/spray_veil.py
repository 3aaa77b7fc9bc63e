"""Spray behind vehicles on a wet road: the plumes of the LiDAR, as veils in a camera's image."""

import math
from dataclasses import replace

import numpy as np

from advercity.frames import ActorState
from advercity.geometry.arrays import Float64Array
from advercity.rendering.backend import CameraCapture
from advercity.sensors.camera.exposure import CameraExposure
from advercity.sensors.camera.scene_light import DROP_LUMINANCE_PER_LX, AmbientLight, lamp_luminance
from advercity.sensors.spray_plumes import (
    MAX_PLUME_DISTANCE_M,
    PLUME_DECAY_M,
    SprayPlume,
    has_spray,
    intersect_box,
    iterate_spraying_states,
)

NUM_PLUME_STEPS = 6
"""Points along a ray at which the density of a plume is sampled."""
MEAN_PLUME_PROFILE = 4.0 / 9.0
"""Mean of the profile across a plume; dividing by it keeps the water equal to the LiDAR's plume."""


def add_spray(
    capture: CameraCapture,
    exposure: CameraExposure,
    ambient_light: AmbientLight,
    *,
    water_film_mm: float,
) -> CameraCapture:
    """Veil a capture by the plumes of all vehicles; without a wet road, return it unchanged."""
    if not has_spray(water_film_mm):
        return capture

    def distance_m(state: ActorState) -> float:
        return float(np.linalg.norm(state.world_from_body[:3, 3] - exposure.position))

    # The farthest plume first, so nearer plumes cover it.
    vehicles = iterate_spraying_states(exposure.frame.states)
    for state in sorted(vehicles, key=distance_m, reverse=True):
        if distance_m(state) < MAX_PLUME_DISTANCE_M:
            capture = _add_plume(capture, exposure, SprayPlume.from_state(state), ambient_light)
    return capture


def _add_plume(
    capture: CameraCapture, exposure: CameraExposure, plume: SprayPlume, ambient_light: AmbientLight
) -> CameraCapture:
    region = _image_region(exposure, plume)
    if region is None:
        return capture
    rays, distance_per_depth = _pixel_rays(exposure, region)
    max_m = capture.depth[region] * distance_per_depth
    transmittance = np.exp(-_optical_depth(exposure, plume, rays, max_m))[..., None]
    light = _spray_luminance(exposure, plume.world_from_plume[:3, 3], ambient_light)
    radiance = capture.radiance.copy()
    radiance[region] = radiance[region] * transmittance + light * (1.0 - transmittance)
    return replace(capture, radiance=radiance.astype(np.float32))


def _spray_luminance(
    exposure: CameraExposure, position: Float64Array, ambient_light: AmbientLight
) -> Float64Array:
    """Compute the luminance (3,) of dense spray in ambient light and the light of lamps."""
    lamps = lamp_luminance(
        exposure.light_sources,
        (position - exposure.position)[None, :],
        exposure.position,
        per_lx=DROP_LUMINANCE_PER_LX,
        forward_scattering=True,
    )
    return ambient_light.mean_luminance + ambient_light.sun_lx / (4.0 * math.pi) + lamps[0]


def _image_region(exposure: CameraExposure, plume: SprayPlume) -> tuple[slice, slice] | None:
    """Find the rows and columns around a plume; None if it is outside the image."""
    points = exposure.to_camera_axes(plume.corners - exposure.position)
    if (points[:, 0] <= 0.0).all():
        return None
    height, width = exposure.view.height_px, exposure.view.width_px
    # A corner next to or behind the camera has no useful projection.
    if (points[:, 0] < 0.2).any():
        return slice(0, height), slice(0, width)
    column, row = exposure.project_points(points)
    top, bottom = max(0, math.floor(row.min())), min(height, math.ceil(row.max()))
    left, right = max(0, math.floor(column.min())), min(width, math.ceil(column.max()))
    if top >= bottom or left >= right:
        return None
    return slice(top, bottom), slice(left, right)


def _pixel_rays(
    exposure: CameraExposure, region: tuple[slice, slice]
) -> tuple[Float64Array, Float64Array]:
    """Compute unit rays (r, c, 3) in the world, and ratios (r, c) of distance to depth."""
    rows, columns = (np.arange(item.start, item.stop) + 0.5 for item in region)
    right, down = np.meshgrid(
        (columns - exposure.view.width_px / 2.0) / exposure.focal_px,
        (rows - exposure.view.height_px / 2.0) / exposure.focal_px,
    )
    rays = np.stack([np.ones_like(right), -right, -down], axis=-1)
    distance_per_depth = np.linalg.norm(rays, axis=-1)
    world_from_camera = exposure.view.world_from_camera[:3, :3]
    return rays / distance_per_depth[..., None] @ world_from_camera.T, distance_per_depth


def _optical_depth(
    exposure: CameraExposure, plume: SprayPlume, rays: Float64Array, max_m: Float64Array
) -> Float64Array:
    """Integrate the optical depth (r, c) of a plume along rays up to the surfaces behind it."""
    half, rotation = plume.half_size_m, plume.world_from_plume[:3, :3]
    own = rays @ rotation
    start = (exposure.position - plume.world_from_plume[:3, 3]) @ rotation
    enter, leave = intersect_box(start, own, half, epsilon=1e-9)
    leave = np.minimum(leave, max_m)
    path_m = np.maximum(leave - enter, 0.0)
    peak = plume.peak_extinction_per_m
    total = np.zeros(path_m.shape)
    for step in range(NUM_PLUME_STEPS):
        point = start + own * (enter + path_m * (step + 0.5) / NUM_PLUME_STEPS)[..., None]
        side, up = point[..., 1] / half[1], point[..., 2] / half[2]
        profile = (1.0 - side**2) * (1.0 - ((up + 1.0) / 2.0) ** 2)
        # Points of rays past the plume may be anywhere, but their path in it is 0.
        behind_m = np.maximum(half[0] - point[..., 0], 0.0)
        total += np.exp(-behind_m / PLUME_DECAY_M) * np.maximum(profile, 0.0)
    return total * path_m * peak / (NUM_PLUME_STEPS * MEAN_PLUME_PROFILE)
