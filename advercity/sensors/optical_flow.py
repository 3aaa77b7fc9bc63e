"""Optical flow of a camera: the places of its pixels' points in its next image.

The depth of a pixel gives its point. Until the next frame the point moves with its actor; on people
and riders it moves with the nearest vertex of their bodies, on wheels with the car. A ray from the
next place of the camera finds whether the point is hidden there. Backends differ only by depths.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from advercity.assets.body_pose import BodyShape, compute_body_pose
from advercity.frames import ActorState, Frame
from advercity.geometry.arrays import Float32Array, Float64Array, FloatArray
from advercity.geometry.poses import Matrix, invert_pose, transform_points
from advercity.rendering.backend import CameraCapture
from advercity.rendering.raycaster import Raycaster, Rays
from advercity.sensors.annotation import NEAR_PLANE_M
from advercity.sensors.camera.lens_map import build_lens_map
from advercity.sensors.camera_model import CameraModel
from advercity.sensors.measurements import OpticalFlow
from advercity.world import Body

MAX_RANGE_M = 10_000.0
"""Range of rays, larger than any world."""
DEPTH_ERROR_M, DEPTH_ERROR_FRACTION = 0.05, 0.002
"""Distance of a surface in front of a point up to which it does not hide it: depths of renderers
and rays differ a little, and so do bodies between two poses."""
_KEPT_SHAPES = 256
_EXACT_TREE: dict[str, bool | int | float | str] = {"algorithm": 4}
"""FLANN's number of the exact index, which finds the nearest vertex."""

MovePoints = Callable[[Float64Array, ActorState, ActorState], Float64Array]
"""Moves points (n, 3) of an actor's surface in the world from one state to another."""


def build_point_mover(bodies: Mapping[str, Body]) -> MovePoints:
    """Build the function for moving points with actors; vertices are kept for each shape."""

    @lru_cache(maxsize=_KEPT_SHAPES)
    def index_vertices(shape: BodyShape) -> tuple[Float32Array, cv2.flann.Index]:
        vertices = np.concatenate([mesh.vertices for mesh in shape.build_meshes(bodies)])
        return vertices, cv2.flann.Index(vertices, _EXACT_TREE)

    def move_points(points: Float64Array, now: ActorState, then: ActorState) -> Float64Array:
        before, after = compute_body_pose(now, bodies), compute_body_pose(then, bodies)
        mesh_from_world = invert_pose(now.world_from_body @ before.body_from_mesh)
        local = transform_points(mesh_from_world, points)
        if before.shape != after.shape and _have_same_vertices(before.shape, after.shape):
            vertices, tree = index_vertices(before.shape)
            nearest = tree.knnSearch(local.astype(np.float32), 1)[0].ravel().astype(np.intp)
            local += (index_vertices(after.shape)[0] - vertices)[nearest]
        return transform_points(then.world_from_body @ after.body_from_mesh, local)

    return move_points


def _have_same_vertices(one: BodyShape, other: BodyShape) -> bool:
    """Return whether two shapes are poses of one body; they differ if one has an umbrella."""
    return replace(one, pose_index=None) == replace(other, pose_index=None)


@dataclass(frozen=True, eq=False)
class CameraMotion:
    """A camera and the scene around it in a frame and in the next one.

    Attributes:
        model: Projection of the camera.
        world_from_camera: Two poses (4, 4), body axes.
        frames: Both frames.
    """

    model: CameraModel
    world_from_camera: tuple[Matrix, Matrix]
    frames: tuple[Frame, Frame]


def measure_optical_flow(
    seen: CameraCapture, motion: CameraMotion, raycaster: Raycaster, move_points: MovePoints
) -> OpticalFlow:
    """Measure the flow of an image to the next one.

    Args:
        seen: Depths and actors of the image's pixels.
        motion: The camera and the scene.
        raycaster: Raycaster at the next frame, without the actors hidden from the camera.
        move_points: Function of `build_point_mover`.
    """
    shape, model = seen.depth.shape, motion.model
    start = _locate_pixels(model)
    offsets, distance_m = _find_next_offsets(seen, start, motion, move_points)
    points_camera = offsets @ motion.world_from_camera[1][:3, :3]
    points_camera[~(points_camera[:, 0] > NEAR_PLANE_M)] = np.nan
    end = model.distort(model.project_pinhole(points_camera))
    inside = (end >= 0) & (end < (model.width_px, model.height_px))
    is_shown = np.logical_and(inside[:, 0], inside[:, 1])
    rows = np.flatnonzero(is_shown)
    eye = motion.world_from_camera[1][:3, 3]
    is_shown[rows] = _is_visible(eye, offsets[rows], distance_m[rows], raycaster)
    shift = (end - model.distort(start)).reshape(*shape, 2)
    return OpticalFlow(shift.astype(np.float32), ~is_shown.reshape(shape))


def _locate_pixels(model: CameraModel) -> Float64Array:
    """Locate the centres (n, 2) of the image's pixels, in pixels of the pinhole.

    With a lens map, these are centres of the rendered plane's pixels, as selected for the image.
    """
    lens_map = build_lens_map(model)
    if lens_map is None:
        row, column = np.indices((model.height_px, model.width_px)).reshape(2, -1)
        return np.stack([column, row], axis=1).astype(np.float64) + 0.5
    width, height = model.rendered_size
    nearest = lens_map.find_nearest((height, width)).reshape(-1, 2).astype(np.float64)
    return model.from_rendered(nearest + 0.5)


def _find_next_offsets(
    seen: CameraCapture, start: Float64Array, motion: CameraMotion, move_points: MovePoints
) -> tuple[Float64Array, FloatArray]:
    """Find the next places of points: offsets (n, 3) from the camera in the world, distances (n,).

    Offsets of infinitely far points are directions only; points of vanished actors are NaN.
    """
    now, then = motion.world_from_camera
    right, down = motion.model.plane_from_pixels(start).T
    rays = np.stack([np.ones_like(right), -right, -down], axis=1) @ now[:3, :3].T
    depth_m = seen.depth.reshape(-1, 1).astype(np.float64)
    is_far = ~np.isfinite(depth_m)
    points = now[:3, 3] + rays * np.where(is_far, 0.0, depth_m)
    moved = _move_actors(points, seen.instance.ravel(), motion.frames, move_points)
    offsets = np.where(is_far, rays, moved - then[:3, 3])
    distance_m = np.sqrt(np.square(offsets).sum(axis=1))
    return offsets, np.where(is_far[:, 0], np.inf, distance_m)


def _move_actors(
    points: Float64Array,
    instance: NDArray[np.int32],
    frames: tuple[Frame, Frame],
    move_points: MovePoints,
) -> Float64Array:
    """Move the points (n, 3) of actors (n,) to the next frame."""
    now, then = ({state.actor.id: state for state in frame.states} for frame in frames)
    moved, shown = points.copy(), np.flatnonzero(instance)
    for number in np.unique(instance[shown]).tolist():
        rows = shown[instance[shown] == number]
        gone = number not in then
        moved[rows] = np.nan if gone else move_points(points[rows], now[number], then[number])
    return moved


def _is_visible(
    eye: Float64Array, offsets: Float64Array, distance_m: FloatArray, raycaster: Raycaster
) -> NDArray[np.bool_]:
    """Return whether the path from the eye (3,) to each point (n,) is free."""
    directions = (offsets / np.linalg.norm(offsets, axis=1, keepdims=True)).astype(np.float32)
    origins = np.tile(eye.astype(np.float32), (len(directions), 1))
    found = raycaster.cast(Rays(origins, directions), MAX_RANGE_M)
    return ~(found.range_m < distance_m * (1 - DEPTH_ERROR_FRACTION) - DEPTH_ERROR_M)
