"""How much of every actor a picture shows: pixels, outlines, boxes in the picture.

An actor's outline is the convex hull of its body's vertices in the picture: what would be seen of
it, were nothing in front of it. A car fills its outline but for a few per cent; a bicycle, which
one sees through, leaves about half of it open, so its visible fraction stays low.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from advercity import poses
from advercity.poses import Matrix
from advercity.traffic.posture import Shape, posture
from advercity.traffic.trace import ActorState, Frame
from advercity.world.scene import Body

NEAR_M = 0.05
"""What lies nearer to the camera's plane, or behind it, has no place in a picture."""
DIRECTIONS = 256
BoxPx = tuple[float, float, float, float]
"""Left, top, right and bottom in pixels; pixel k reaches from k to k + 1."""
PointsOf = Callable[[ActorState], NDArray[np.float64]]
"""Points (n, 3) of an actor's body, in its frame, whose convex hull is the body's."""


@dataclass(frozen=True)
class Sighting:
    """An actor in one picture.

    Attributes:
        visible_px: Pixels that show it.
        outline_px: Area of its outline within the picture.
        truncation: Share of its outline that lies outside the picture.
        visible_box: Around the pixels that show it; None if there are none.
        outline_box: Around its outline within the picture.
    """

    visible_px: int
    outline_px: float
    truncation: float
    visible_box: BoxPx | None
    outline_box: BoxPx

    @property
    def occlusion(self) -> float:
        """Share of what the picture could show of it that something hides."""
        return 1.0 - min(1.0, self.visible_px / self.outline_px)

    @property
    def visible_fraction(self) -> float:
        """Share of its whole outline that the picture shows."""
        return (1.0 - self.occlusion) * (1.0 - self.truncation)


def points_of_bodies(bodies: Mapping[str, Body]) -> PointsOf:
    """Finds the points of an actor's body among those of a world."""

    @cache
    def points(shape: Shape) -> NDArray[np.float64]:
        vertices = np.concatenate([part.vertices for part in shape.meshes(bodies)])
        return extremes(vertices.astype(np.float64))

    def points_of(state: ActorState) -> NDArray[np.float64]:
        seen = posture(state, bodies)
        return poses.transform(seen.body_from_mesh, points(seen.shape))

    return points_of


def extremes(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of points (n, 3) those that lie farthest in one of many directions, evenly spread."""
    index = np.arange(DIRECTIONS) + 0.5
    azimuth = np.pi * (1.0 + np.sqrt(5.0)) * index
    height = 1.0 - 2.0 * index / DIRECTIONS
    level = np.sqrt(1.0 - height**2)
    directions = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), height])
    return points[np.unique(np.argmax(points @ directions, axis=0))]


def box_corners(size: tuple[float, float, float]) -> NDArray[np.float64]:
    """Corners (8, 3) of an actor's box in its body frame; corner k has bits x, y, z of k."""
    unit = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (0.0, 1.0)])
    return unit * size


BOX_EDGES = np.array(
    [(a, a | bit) for a in range(8) for bit in (1, 2, 4) if not a & bit], dtype=np.intp
)
"""Indices (12, 2) of corners that an edge joins."""


def sightings(
    instance: NDArray[np.int32],
    world_from_camera: Matrix,
    intrinsic: NDArray[np.float64],
    frame: Frame,
    points_of: PointsOf,
    *,
    hide: frozenset[int] = frozenset(),
) -> dict[int, Sighting]:
    """Every actor whose outline reaches into a picture, by its id.

    Args:
        instance: (h, w) id of the actor that each pixel shows; 0 for everything static.
        world_from_camera: (4, 4), body axes.
        intrinsic: (3, 3) pinhole matrix, optical axes.
        frame: Where everybody is.
        points_of: Tells their shapes.
        hide: Ids of actors that the camera does not see.
    """
    height, width = instance.shape
    seen = _visible(instance)
    camera_from_world = poses.inverse(world_from_camera)
    found: dict[int, Sighting] = {}
    for state in frame.states:
        if state.actor.id in hide:
            continue
        camera_from_body = camera_from_world @ state.world_from_body
        corners = poses.transform(camera_from_body, box_corners(state.actor.size))
        if corners[:, 0].max() <= NEAR_M:
            continue
        points = poses.transform(camera_from_body, points_of(state))
        outline = _outline(points, corners, intrinsic)
        sighting = _sighting(outline, seen.get(state.actor.id), width, height)
        if sighting is not None:
            found[state.actor.id] = sighting
    return found


def _visible(instance: NDArray[np.int32]) -> dict[int, tuple[int, BoxPx]]:
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
        int(number): (int(count), _box(edge))
        for number, count, edge in zip(numbers, counts, edges, strict=True)
    }


def _outline(
    points: NDArray[np.float64], corners: NDArray[np.float64], intrinsic: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Convex outline (n, 1, 2) in pixels of what is ahead of a camera, given in its body axes.

    Where the camera's plane cuts the body, its box is cut instead.
    """
    ahead = points[points[:, 0] > NEAR_M]
    before, behind = corners[BOX_EDGES[:, 0]], corners[BOX_EDGES[:, 1]]
    crossing = (before[:, 0] > NEAR_M) != (behind[:, 0] > NEAR_M)
    before, behind = before[crossing], behind[crossing]
    share = (NEAR_M - before[:, :1]) / (behind[:, :1] - before[:, :1])
    ahead = np.concatenate([ahead, before + share * (behind - before)])
    optical = np.stack([-ahead[:, 1], -ahead[:, 2], ahead[:, 0]])
    pixels = (intrinsic @ optical)[:2] / optical[2]
    return cv2.convexHull(pixels.T.astype(np.float32)).astype(np.float32)


def _sighting(
    outline: NDArray[np.float32], seen: tuple[int, BoxPx] | None, width: int, height: int
) -> Sighting | None:
    picture = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32)
    inside_px, inside = cv2.intersectConvexConvex(outline, picture)
    visible_px, visible_box = seen or (0, None)
    if inside_px <= 0:
        return None
    left, top = inside.reshape(-1, 2).min(axis=0)
    right, bottom = inside.reshape(-1, 2).max(axis=0)
    return Sighting(
        visible_px=visible_px,
        outline_px=float(inside_px),
        truncation=max(0.0, 1.0 - float(inside_px) / float(cv2.contourArea(outline))),
        visible_box=visible_box,
        outline_box=_box(np.array([left, top, right, bottom])),
    )


def _box(edges: NDArray[np.floating] | NDArray[np.integer]) -> BoxPx:
    left, top, right, bottom = (float(edge) for edge in edges)
    return left, top, right, bottom
