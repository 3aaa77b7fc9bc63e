"""Rays of a camera, and the surfaces at the middles of its pixels."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from advercity.rendering.backend import CameraView
from advercity_mitsuba.hits import (
    FAR_M,
    Crossing,
    Scene,
    build_first_surface,
    fetch_hit,
    find_row,
    trace,
)
from advercity_mitsuba.light import compute_transmittance
from advercity_mitsuba.reflection import compute_specular_reflectance
from advercity_mitsuba.variant import dr, mi

BEYOND_M = 1e-4
"""How far behind a surface of a hidden actor a ray goes on, metres."""


@dataclass(frozen=True, eq=False)
class Camera:
    """Pose and lens: eye, axes ahead, left and up, and half the width and height at 1 m."""

    eye: Any
    ahead: Any
    left: Any
    up: Any
    half_width: Any
    half_height: Any
    width_px: Any
    height_px: Any


def build_camera(view: CameraView) -> Camera:
    """Copy the pose and lens of a view to the device, as no part of a kernel."""
    pose = view.world_from_camera
    half_width = float(np.tan(view.horizontal_fov_rad / 2.0))
    camera = Camera(
        eye=mi.Point3f(*map(float, pose[:3, 3])),
        ahead=mi.Vector3f(*map(float, pose[:3, 0])),
        left=mi.Vector3f(*map(float, pose[:3, 1])),
        up=mi.Vector3f(*map(float, pose[:3, 2])),
        half_width=mi.Float(half_width),
        half_height=mi.Float(half_width * view.height_px / view.width_px),
        width_px=mi.UInt32(view.width_px),
        height_px=mi.UInt32(view.height_px),
    )
    dr.make_opaque(*vars(camera).values())
    return camera


def build_camera_ray(camera: Camera, pixel: Any, offset: Any) -> tuple[Any, Any]:
    """Build the ray through a point of each pixel, and its length per metre of depth."""
    column, row = mi.Float(pixel % camera.width_px), mi.Float(pixel // camera.width_px)
    u = 2.0 * (column + offset.x) / mi.Float(camera.width_px) - 1.0
    v = 2.0 * (row + offset.y) / mi.Float(camera.height_px) - 1.0
    left, up = -u * camera.half_width, -v * camera.half_height
    ray = camera.ahead + left * camera.left + up * camera.up
    length = dr.norm(ray)
    return ray / length, length


def compute_pixel_angle(camera: Camera) -> Any:
    """Compute the width of a pixel at the middle of the image, per metre of distance."""
    return 2.0 * camera.half_width / mi.Float(camera.width_px)


def trace_visible(scene: Scene, eye: Any, ray: Any) -> Crossing:
    """Find the first hits of camera rays, which pass through hidden actors.

    A scene without the hidden actors would cost more: Mitsuba builds all bodies anew for each.
    """

    def is_hidden(crossing: Crossing) -> Any:
        hit = crossing.distance < FAR_M
        return hit & dr.gather(mi.Bool, scene.hidden, find_row(scene, crossing, hit), hit)

    def pass_through(crossing: Crossing) -> tuple[Crossing]:
        passed = crossing.distance + BEYOND_M
        found = trace(scene.placed.scene, eye + passed * ray, ray, mi.Bool(True), coherent=True)
        return (replace(found, distance=found.distance + passed),)

    first = trace(scene.placed.scene, eye, ray, mi.Bool(True), coherent=True)
    (seen,) = dr.while_loop((first,), is_hidden, pass_through, labels=("crossing",))
    return seen


@dataclass(frozen=True, eq=False)
class Guides:
    """Geometry at the middles of pixels, and the fraction of its light left by the air."""

    depth: Any
    clearness: Any
    normal: Any
    albedo: Any
    semantic: Any
    actor: Any


def trace_guides(scene: Scene, camera: Camera, pixel: Any) -> Guides:
    """Find the surfaces at the middles of pixels; depth and actor are 0 for the sky."""
    ray, length = build_camera_ray(camera, pixel, mi.Point2f(0.5))
    crossing = trace_visible(scene, camera.eye, ray)
    seen = crossing.distance < FAR_M
    hit = fetch_hit(scene, crossing, camera.eye, ray, seen)
    angle = compute_pixel_angle(camera)
    s = build_first_surface(scene, hit, ray, crossing.distance, angle, seen)
    shine = compute_specular_reflectance(s, dr.abs(dr.dot(ray, s.normal)))
    guides = Guides(
        depth=dr.select(seen, crossing.distance / length, 0.0),
        clearness=compute_transmittance(scene.light, crossing.distance),
        normal=dr.select(seen, hit.normal, 0.0),
        albedo=dr.select(seen, dr.minimum(s.albedo + shine, 1.0), 1.0),
        semantic=dr.select(seen, hit.semantic, 0),
        actor=dr.select(seen, hit.actor, 0),
    )
    # One kernel for all of them: fetched one by one, each would trace its own rays.
    dr.eval(*vars(guides).values())
    return guides
