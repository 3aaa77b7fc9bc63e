"""Annotations: which actors an agent annotates, and their visible pixels and boxes in images.

An actor's outline in an image is the convex hull of its body's projected vertices, whether or not
other objects hide it. A car fills its outline except for a few per cent. A bicycle is see-through
and leaves about half of it open, so its visible fraction stays low.
"""

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from itertools import chain

import cv2
import numpy as np
import shapely
from advercity_dsl import Lidar
from numpy.typing import NDArray

from advercity.assets.body_pose import BodyShape, compute_body_pose
from advercity.frames import ActorState, Frame
from advercity.geometry import poses
from advercity.geometry.arrays import Float64Array
from advercity.geometry.boxes import BOX_EDGES
from advercity.geometry.directions import spread_directions
from advercity.geometry.poses import Matrix
from advercity.sensors.camera_model import CameraModel
from advercity.sensors.lidar.scan import ScanHits
from advercity.sensors.measurements import PointKind
from advercity.sensors.rolling_shutter import RollingCamera
from advercity.sensors.sensor_frame import PixelBox, ProjectedBox, SensorFrame
from advercity.world import Body


def count_lidar_hits(scan: ScanHits, lidar: Lidar) -> dict[int, int]:
    """Count the beams that reach each actor, in the open or through window panes, by its id.

    Adver-City annotates the actors with at least one; its windows are opaque.
    """
    rays = [np.arange(len(scan.hits.range_m)), *(item.ray for item in scan.behind_glass)]
    hits = [scan.hits, *(item.hits for item in scan.behind_glass)]
    ray, actor = np.concatenate(rays), np.concatenate([item.instance for item in hits])
    in_range = np.isfinite(np.concatenate([item.range_m for item in hits]))
    # The first sub-ray of a beam is its axis, so a finer LiDAR gives the same annotations.
    counted = (actor > 0) & in_range & (ray % lidar.sub_rays == 0)
    # A beam that passes a window of a car may hit its other side: it counts once.
    pairs = np.unique(actor[counted].astype(np.int64) * len(rays[0]) + ray[counted])
    actors, counts = np.unique(pairs // len(rays[0]), return_counts=True)
    return dict(zip(actors.tolist(), counts.tolist(), strict=True))


NEAR_PLANE_M = 0.05
"""Least projected depth; nearer points and points behind the camera have no pixel."""
CHORD_PX = 8.0
"""Length of the chords in place of a straight line, which the lens bends."""
NUM_HULL_DIRECTIONS, HULL_BATCHES = 256, 16
"""Directions searched for the farthest points, and the batches of the search, which bound memory
for models with many vertices."""
HullPointLookup = Callable[[ActorState], NDArray[np.float64]]
"""Returns points (n, 3) of an actor's body, in its frame, whose convex hull is the body's."""


def build_hull_point_lookup(bodies: Mapping[str, Body]) -> HullPointLookup:
    """Build the lookup for the actors of a world; points are kept for each shape of a body."""

    @cache
    def select_points(shape: BodyShape) -> NDArray[np.float64]:
        vertices = np.concatenate([part.vertices for part in shape.build_meshes(bodies)])
        return select_extreme_points(vertices.astype(np.float64))

    def find_hull_points(state: ActorState) -> NDArray[np.float64]:
        pose = compute_body_pose(state, bodies)
        return poses.transform_points(pose.body_from_mesh, select_points(pose.shape))

    return find_hull_points


def select_extreme_points(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Select the points (n, 3) farthest in at least one of many evenly spread directions."""
    # A Fibonacci lattice: directions at golden-ratio azimuths and equal steps of height.
    directions = np.split(spread_directions(NUM_HULL_DIRECTIONS), HULL_BATCHES)
    return points[np.unique([np.argmax(some @ points.T, axis=1) for some in directions])]


def project_boxes(
    instance: NDArray[np.int32],
    world_from_camera: Matrix,
    camera: CameraModel,
    frame: Frame,
    find_hull_points: HullPointLookup,
    *,
    hide: frozenset[int] = frozenset(),
    rolling: RollingCamera | None = None,
) -> dict[int, ProjectedBox]:
    """Project every actor whose outline overlaps an image, by its id.

    Args:
        instance: (h, w) id of the actor in each pixel; 0 for everything static.
        world_from_camera: (4, 4), body axes.
        camera: Projection to the image.
        frame: States of all actors.
        find_hull_points: Returns points whose convex hull is the actor's.
        hide: Ids of actors hidden from the camera, such as its own vehicle.
        rolling: Times and poses of the image's rows; None if all are exposed at once.
    """
    visible = _measure_visible_pixels(instance)
    camera_from_world = poses.invert_pose(world_from_camera)

    def place_points(state: ActorState, points: Float64Array) -> Float64Array:
        if rolling is not None:
            return rolling.place_moving_points(state, points, camera)
        return poses.transform_points(camera_from_world @ state.world_from_body, points)

    found: dict[int, ProjectedBox] = {}
    for state in frame.states:
        if state.actor.id in hide:
            continue
        corners = place_points(state, state.box.corners)
        if corners[:, 0].max() <= NEAR_PLANE_M:
            continue
        points = place_points(state, find_hull_points(state))
        outline = _project_outline(points, corners, camera)
        box = _clip_to_image(outline, visible.get(state.actor.id), camera)
        if box is not None:
            found[state.actor.id] = box
    return found


def _measure_visible_pixels(instance: NDArray[np.int32]) -> dict[int, tuple[int, PixelBox]]:
    """Measure the number of pixels of each actor and the box around them, by id."""
    # Sorting the few actor pixels once is faster than a mask of the image for every actor.
    row, column = np.nonzero(instance)
    ids = instance[row, column]
    order = np.argsort(ids, kind="stable")
    row, column = row[order], column[order]
    numbers, first, counts = np.unique(ids[order], return_index=True, return_counts=True)
    if not len(numbers):
        return {}
    edges = np.stack(
        [
            np.minimum.reduceat(column, first),
            np.minimum.reduceat(row, first),
            np.maximum.reduceat(column, first) + 1,
            np.maximum.reduceat(row, first) + 1,
        ],
        axis=1,
    )
    return {
        int(number): (int(count), _to_pixel_box(edge))
        for number, count, edge in zip(numbers, counts, edges, strict=True)
    }


def _project_outline(
    points: NDArray[np.float64], corners: NDArray[np.float64], camera: CameraModel
) -> NDArray[np.float32]:
    """Project points (n, 3) in a camera's body axes to a convex outline (n, 1, 2) without lens."""
    ahead = points[points[:, 0] > NEAR_PLANE_M]
    # Where the near plane cuts the body, the cut of its box closes the outline, as only the
    # vertices of the body are known.
    before, behind = corners[BOX_EDGES[:, 0]], corners[BOX_EDGES[:, 1]]
    crossing = (before[:, 0] > NEAR_PLANE_M) != (behind[:, 0] > NEAR_PLANE_M)
    before, behind = before[crossing], behind[crossing]
    fraction = (NEAR_PLANE_M - before[:, :1]) / (behind[:, :1] - before[:, :1])
    ahead = np.concatenate([ahead, before + fraction * (behind - before)])
    return cv2.convexHull(camera.project_pinhole(ahead).astype(np.float32)).astype(np.float32)


def _clip_to_image(
    outline: NDArray[np.float32], visible: tuple[int, PixelBox] | None, camera: CameraModel
) -> ProjectedBox | None:
    inside_px, seen_px, corners = _cut_outline(outline, camera)
    visible_px, visible_box = visible or (0, None)
    if seen_px <= 0:
        return None
    edges = np.concatenate([corners.min(axis=0), corners.max(axis=0)])
    return ProjectedBox(
        visible_px=visible_px,
        outline_px=seen_px,
        truncation=max(0.0, 1.0 - inside_px / float(cv2.contourArea(outline))),
        visible_box=visible_box,
        outline_box=_to_pixel_box(edges),
    )


def _cut_outline(
    outline: NDArray[np.float32], camera: CameraModel
) -> tuple[float, float, NDArray[np.float64]]:
    """Cut an outline at the image's edge: its area before and behind the lens, its corners."""
    width, height = camera.width_px, camera.height_px
    if camera.distortion is None:
        image = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32)
        inside_px, inside = cv2.intersectConvexConvex(outline, image)
        found = np.zeros((0, 2)) if inside_px <= 0 else inside.reshape(-1, 2).astype(np.float64)
        return float(inside_px), float(inside_px), found
    # Straight lines are curved by the lens, so the cut is made before it.
    inside = _build_edge(camera) & shapely.MultiPoint(outline[:, 0]).convex_hull
    seen = shapely.transform(inside.segmentize(CHORD_PX), camera.distort)
    corners = np.clip(shapely.get_coordinates(seen), 0, (width, height))
    return inside.area, seen.area, corners


@lru_cache(maxsize=8)
def _build_edge(camera: CameraModel) -> shapely.Polygon:
    return shapely.Polygon(camera.trace_edge())


def _to_pixel_box(edges: NDArray[np.floating] | NDArray[np.integer]) -> PixelBox:
    left, top, right, bottom = (float(edge) for edge in edges)
    return left, top, right, bottom


@dataclass(frozen=True, eq=False)
class Annotation:
    """An actor as one agent annotates it, in the right-handed world frame.

    Attributes:
        state: State of the actor.
        location: (3,) point as in CARLA: the ground under a vehicle, a pedestrian's middle.
        centre: (3,) middle of its box.
        distance_m: From the agent's origin to `location`.
        bearing_rad: Horizontal direction from the agent to `location`, independent of the agent's
            pitch and roll; 0 ahead, positive to the left, in (-pi, pi].
        relative_yaw_rad: Heading relative to the agent's, in (-pi, pi].
        lidar_hits: Number of noise-free LiDAR beams on it.
        lidar_points: Number of its points in the agent's LiDAR scans in this weather, without its
            mirror images in puddles.
        lidar_ghosts: Number of points of its mirror images.
        visible_fraction: Largest visible fraction of its outline in one of the agent's cameras.
    """

    state: ActorState
    location: NDArray[np.float64]
    centre: NDArray[np.float64]
    distance_m: float
    bearing_rad: float
    relative_yaw_rad: float
    lidar_hits: int
    lidar_points: int
    lidar_ghosts: int
    visible_fraction: float


def annotate_actors(sensor_frame: SensorFrame) -> tuple[Annotation, ...]:
    """Annotate the other actors that an agent's sensors see in clear air.

    With `min_points` 0, weathers differ by umbrellas alone: they take and hide beams. Distances
    are from the agent's true pose, not from the estimated one.
    """
    own, hits = sensor_frame.agent.number, sensor_frame.lidar_hits
    seen = find_seen_actors(sensor_frame)
    ghosts = _count_points(sensor_frame, PointKind.GHOST)
    points = _count_points(sensor_frame, PointKind.SURFACE)
    states = [
        state
        for state in sensor_frame.frame.states
        if state.actor.id != own
        and state.actor.id in seen
        and points.get(state.actor.id, 0) >= sensor_frame.min_points
    ]
    if not states:
        return ()
    world_from_object = np.stack([state.world_from_body for state in states])
    on_foot = np.array([state.actor.actor_class == "pedestrian" for state in states])
    grounds = world_from_object[:, :3, 3]
    offsets_body = np.array([state.box.centre for state in states])
    centres = grounds + np.einsum("nij,nj->ni", world_from_object[:, :3, :3], offsets_body)
    # A box follows the stride; the middle of a person's steady box moves as the body does.
    half_heights = np.array([state.steady_box.centre[2] for state in states])
    middles = grounds + half_heights[:, None] * world_from_object[:, :3, 2]
    locations = np.where(on_foot[:, None], middles, grounds)
    # One pass of arrays over all actors: a frame may have several hundred, five times over.
    offsets = locations - sensor_frame.world_from_agent[:3, 3]
    agent_yaw = poses.to_yaw_pitch_roll(sensor_frame.world_from_agent)[0]
    yaws = np.arctan2(world_from_object[:, 1, 0], world_from_object[:, 0, 0])
    rows = zip(
        states,
        locations,
        centres,
        np.linalg.norm(offsets, axis=1).tolist(),
        _wrap_angles(np.arctan2(offsets[:, 1], offsets[:, 0]) - agent_yaw).tolist(),
        _wrap_angles(yaws - agent_yaw).tolist(),
        (hits.get(state.actor.id, 0) for state in states),
        (points.get(state.actor.id, 0) for state in states),
        (ghosts.get(state.actor.id, 0) for state in states),
        (_find_visible_fraction(sensor_frame, state.actor.id) for state in states),
        strict=True,
    )
    ranges_m = (lidar.range_m for lidar in sensor_frame.agent.sensors.lidars)
    range_m = max(ranges_m, default=math.inf)
    return tuple(Annotation(*row) for row in rows if row[3] < range_m)


def find_seen_actors(sensor_frame: SensorFrame) -> Collection[int]:
    """Find the actors that an agent sees, by id.

    A LiDAR's beam hits them. An agent without a LiDAR sees the `seen_actors` of the measurements
    of all its sensors.
    """
    if sensor_frame.seen_actors is not None:
        return sensor_frame.seen_actors
    if sensor_frame.lidar_scans:
        return {number for number, count in sensor_frame.lidar_hits.items() if count > 0}
    measured = chain.from_iterable(sensor_frame.readings.values())
    return frozenset[int]().union(*(getattr(one, "seen_actors", ()) for one in measured))


def _count_points(sensor_frame: SensorFrame, kind: PointKind) -> dict[int, int]:
    """Count each actor's points of a kind in the scans of all LiDARs, by its id."""
    clouds = [scan.point_cloud for scan in sensor_frame.lidar_scans]
    found = [cloud.instance[cloud.kind == kind] for cloud in clouds]
    instance = np.concatenate([np.empty(0, np.int32), *found])
    actors, counts = np.unique(instance, return_counts=True)
    return dict(zip(actors.tolist(), counts.tolist(), strict=True))


def _find_visible_fraction(sensor_frame: SensorFrame, actor_id: int) -> float:
    boxes = (image.projected_boxes.get(actor_id) for image in sensor_frame.camera_images)
    return max((box.visible_fraction for box in boxes if box), default=0.0)


def _wrap_angles(angles_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """Wrap angles (n,) to (-pi, pi]."""
    return np.pi - (np.pi - angles_rad) % (2 * np.pi)
