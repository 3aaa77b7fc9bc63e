"""How much of every actor a picture shows: pixels, outlines, boxes in the picture.

An actor's outline is the convex hull of its body's vertices in the picture: what would be seen of
it, were nothing in front of it. A car fills its outline but for a few per cent; a bicycle, which
one sees through, leaves about half of it open, so its visible fraction stays low.

Which actors a viewpoint annotates, and what it says of them.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from advercity_dsl import Lidar
from numpy.typing import NDArray

from advercity.assets.body_pose import BodyShape, compute_body_pose
from advercity.frames import ActorState, Frame
from advercity.geometry import poses
from advercity.geometry.boxes import BOX_EDGES, compute_box_corners
from advercity.geometry.directions import spread_directions
from advercity.geometry.poses import Matrix
from advercity.sensors.lidar.scan import ScanHits
from advercity.sensors.sensor_frame import PixelBox, ProjectedBox, SensorFrame
from advercity.world import Body


def count_lidar_hits(scan: ScanHits, lidar: Lidar) -> dict[int, int]:
    """Beams that meet each actor first, by its id: the original's test of who is annotated."""
    instance = scan.hits.instance[:: lidar.sub_rays]
    actors, counts = np.unique(instance[instance > 0], return_counts=True)
    return dict(zip(actors.tolist(), counts.tolist(), strict=True))


NEAR_PLANE_M = 0.05
"""What lies nearer to the camera's plane, or behind it, has no place in a picture."""
NUM_HULL_DIRECTIONS = 256
HullPointLookup = Callable[[ActorState], NDArray[np.float64]]
"""Points (n, 3) of an actor's body, in its frame, whose convex hull is the body's."""


def build_hull_point_lookup(bodies: Mapping[str, Body]) -> HullPointLookup:
    """Finds the points of an actor's body among those of a world."""

    @cache
    def points(shape: BodyShape) -> NDArray[np.float64]:
        vertices = np.concatenate([part.vertices for part in shape.build_meshes(bodies)])
        return select_extreme_points(vertices.astype(np.float64))

    def points_of(state: ActorState) -> NDArray[np.float64]:
        seen = compute_body_pose(state, bodies)
        return poses.transform_points(seen.body_from_mesh, points(seen.shape))

    return points_of


def select_extreme_points(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of points (n, 3) those that lie farthest in one of many directions, evenly spread."""
    directions = np.ascontiguousarray(spread_directions(NUM_HULL_DIRECTIONS).T)
    return points[np.unique(np.argmax(points @ directions, axis=0))]


def project_boxes(
    instance: NDArray[np.int32],
    world_from_camera: Matrix,
    intrinsic: NDArray[np.float64],
    frame: Frame,
    find_hull_points: HullPointLookup,
    *,
    hide: frozenset[int] = frozenset(),
) -> dict[int, ProjectedBox]:
    """Every actor whose outline reaches into a picture, by its id.

    Args:
        instance: (h, w) id of the actor that each pixel shows; 0 for everything static.
        world_from_camera: (4, 4), body axes.
        intrinsic: (3, 3) pinhole matrix, optical axes.
        frame: Where everybody is.
        find_hull_points: Returns points whose convex hull is the actor's.
        hide: Ids of actors that the camera does not see.
    """
    height, width = instance.shape
    seen = _measure_visible_pixels(instance)
    camera_from_world = poses.invert_pose(world_from_camera)
    found: dict[int, ProjectedBox] = {}
    for state in frame.states:
        if state.actor.id in hide:
            continue
        camera_from_body = camera_from_world @ state.world_from_body
        corners = poses.transform_points(camera_from_body, compute_box_corners(state.actor.size))
        if corners[:, 0].max() <= NEAR_PLANE_M:
            continue
        points = poses.transform_points(camera_from_body, find_hull_points(state))
        outline = _project_outline(points, corners, intrinsic)
        sighting = _clip_to_image(outline, seen.get(state.actor.id), width, height)
        if sighting is not None:
            found[state.actor.id] = sighting
    return found


def _measure_visible_pixels(instance: NDArray[np.int32]) -> dict[int, tuple[int, PixelBox]]:
    """Number of pixels and the box around them, by id."""
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
    points: NDArray[np.float64], corners: NDArray[np.float64], intrinsic: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Convex outline (n, 1, 2) in pixels of what is ahead of a camera, given in its body axes.

    Where the camera's plane cuts the body, its box is cut instead.
    """
    ahead = points[points[:, 0] > NEAR_PLANE_M]
    before, behind = corners[BOX_EDGES[:, 0]], corners[BOX_EDGES[:, 1]]
    crossing = (before[:, 0] > NEAR_PLANE_M) != (behind[:, 0] > NEAR_PLANE_M)
    before, behind = before[crossing], behind[crossing]
    share = (NEAR_PLANE_M - before[:, :1]) / (behind[:, :1] - before[:, :1])
    ahead = np.concatenate([ahead, before + share * (behind - before)])
    optical = np.stack([-ahead[:, 1], -ahead[:, 2], ahead[:, 0]])
    pixels = (intrinsic @ optical)[:2] / optical[2]
    return cv2.convexHull(pixels.T.astype(np.float32)).astype(np.float32)


def _clip_to_image(
    outline: NDArray[np.float32], seen: tuple[int, PixelBox] | None, width: int, height: int
) -> ProjectedBox | None:
    picture = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32)
    inside_px, inside = cv2.intersectConvexConvex(outline, picture)
    visible_px, visible_box = seen or (0, None)
    if inside_px <= 0:
        return None
    left, top = inside.reshape(-1, 2).min(axis=0)
    right, bottom = inside.reshape(-1, 2).max(axis=0)
    return ProjectedBox(
        visible_px=visible_px,
        outline_px=float(inside_px),
        truncation=max(0.0, 1.0 - float(inside_px) / float(cv2.contourArea(outline))),
        visible_box=visible_box,
        outline_box=_to_pixel_box(np.array([left, top, right, bottom])),
    )


def _to_pixel_box(edges: NDArray[np.floating] | NDArray[np.integer]) -> PixelBox:
    left, top, right, bottom = (float(edge) for edge in edges)
    return left, top, right, bottom


@dataclass(frozen=True, eq=False)
class Annotation:
    """An actor as one viewpoint has it, in the right-handed world frame.

    Attributes:
        state: Who it is and where.
        location: (3,) where the original puts it: on the ground under a vehicle, in the middle
            of a pedestrian's body.
        centre: (3,) middle of its box.
        distance_m: From the viewpoint's origin to `location`.
        bearing_rad: Direction in which the viewpoint sees it; 0 ahead, positive to the left.
        relative_yaw_rad: Its heading less the viewpoint's, in (-pi, pi].
        lidar_hits: Rays of the noise-free LiDAR that met it.
    """

    state: ActorState
    location: NDArray[np.float64]
    centre: NDArray[np.float64]
    distance_m: float
    bearing_rad: float
    relative_yaw_rad: float
    lidar_hits: int


def annotate_actors(sensor_frame: SensorFrame) -> tuple[Annotation, ...]:
    """Everybody but the viewpoint itself within LiDAR range whom its noise-free LiDAR hits.

    Weather and noise play no part in it, so the annotations of a scenario are the same under
    every weather. Distances count from the true viewpoint, not from the estimated one.
    """
    own, visible = sensor_frame.agent.number, sensor_frame.lidar_hits
    seen = [
        state
        for state in sensor_frame.frame.states
        if state.actor.id != own and visible.get(state.actor.id, 0) > 0
    ]
    if not seen:
        return ()
    world_from_object = np.stack([state.world_from_body for state in seen])
    heights = np.array([state.actor.size[2] for state in seen])
    on_foot = np.array([state.actor.actor_class == "pedestrian" for state in seen])
    grounds = world_from_object[:, :3, 3]
    centres = grounds + world_from_object[:, :3, 2] * (heights[:, None] / 2)
    locations = np.where(on_foot[:, None], centres, grounds)
    places = poses.transform_points(poses.invert_pose(sensor_frame.world_from_agent), locations)
    yaws = np.arctan2(world_from_object[:, 1, 0], world_from_object[:, 0, 0])
    turned = yaws - poses.to_yaw_pitch_roll(sensor_frame.world_from_agent)[0]
    rows = zip(
        seen,
        locations,
        centres,
        np.linalg.norm(locations - sensor_frame.world_from_agent[:3, 3], axis=1).tolist(),
        np.arctan2(places[:, 1], places[:, 0]).tolist(),
        (np.pi - (np.pi - turned) % (2 * np.pi)).tolist(),
        (visible[state.actor.id] for state in seen),
        strict=True,
    )
    range_m = sensor_frame.agent.sensors.lidar.range_m
    return tuple(Annotation(*row) for row in rows if row[3] < range_m)


def compute_box_centre(state: ActorState) -> NDArray[np.float64]:
    """Middle (3,) of an actor's box, which stands upright on its origin in its body frame."""
    return poses.transform_points(state.world_from_body, (0.0, 0.0, state.actor.size[2] / 2))
