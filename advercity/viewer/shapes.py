"""What poses, points, boxes and roads are in Rerun."""

from collections.abc import Sequence

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from advercity import poses
from advercity.dataset.annotation import box_centre
from advercity.dataset.reading import Picture, Reading, intrinsic
from advercity.poses import Matrix
from advercity.semantics import ACTOR_COLOURS
from advercity.traffic.trace import ActorState
from advercity.viewer.clouds import CloudColour, colours
from advercity.world.scene import Lane

Colour = tuple[int, int, int]
IMAGE_PLANE_M = 1.5
POINT_PX = 1.5
CLASS_IDS = {name: index for index, name in enumerate(ACTOR_COLOURS, start=1)}
LANE_COLOURS = {"driving": (190, 190, 190), "sidewalk": (140, 110, 140), "crossing": (220, 200, 90)}
OTHER_LANE_COLOUR = (110, 110, 110)


def transform(parent_from_child: Matrix) -> rr.Transform3D:
    """Where a child stands in its parent."""
    return rr.Transform3D(translation=parent_from_child[:3, 3], mat3x3=parent_from_child[:3, :3])


def pinhole(picture: Picture, *, horizontal_fov_deg: float) -> rr.Pinhole:
    """Body axes are said to the viewer, so that poses need no turning."""
    height, width = picture.image.shape[:2]
    return rr.Pinhole(
        image_from_camera=intrinsic(picture, horizontal_fov_deg=horizontal_fov_deg),
        resolution=(width, height),
        camera_xyz=rr.ViewCoordinates.FLU,
        image_plane_distance=IMAGE_PLANE_M,
    )


def points(reading: Reading, by: CloudColour) -> rr.Points3D:
    """Points in the LiDAR's frame."""
    radii = rr.Radius.ui_points(POINT_PX)
    return rr.Points3D(reading.cloud.points, colors=colours(reading.cloud, by), radii=radii)


def boxes(states: Sequence[ActorState]) -> rr.Boxes3D:
    """Boxes of actors in the world, told by their classes."""
    return rr.Boxes3D(
        centers=np.reshape([box_centre(state) for state in states], (-1, 3)),
        half_sizes=np.reshape([state.actor.size for state in states], (-1, 3)) / 2,
        quaternions=[rr.Quaternion(xyzw=_quaternion(state.world_from_body)) for state in states],
        class_ids=[CLASS_IDS[state.actor.actor_class] for state in states],
        labels=[f"{state.actor.actor_class} {state.actor.id}" for state in states],
        show_labels=False,
    )


def _quaternion(matrix: Matrix) -> NDArray[np.float64]:
    """x, y, z, w of a pose: yaw, pitch and roll in halves (Diebel, Representing Attitude, 2006)."""
    yaw, pitch, roll = (angle / 2 for angle in poses.angles(matrix))
    cy, sy, cp, sp, cr, sr = (
        *(np.cos(yaw), np.sin(yaw)),
        *(np.cos(pitch), np.sin(pitch)),
        *(np.cos(roll), np.sin(roll)),
    )
    return np.array(
        [
            cy * cp * sr - sy * sp * cr,
            cy * sp * cr + sy * cp * sr,
            sy * cp * cr - cy * sp * sr,
            cy * cp * cr + sy * sp * sr,
        ]
    )


def class_names() -> rr.AnnotationContext:
    """Names and colours of the classes of `boxes`."""
    classes = [
        rr.AnnotationInfo(id=CLASS_IDS[name], label=name, color=colour)
        for name, colour in ACTOR_COLOURS.items()
    ]
    return rr.AnnotationContext(classes)


def line(points: Sequence[Sequence[float]], colour: Colour, width_px: float) -> rr.LineStrips3D:
    """A trajectory through points (n, 3) of the world."""
    strips = [points] if len(points) > 1 else []
    return rr.LineStrips3D(strips, colors=colour, radii=rr.Radius.ui_points(width_px))


def road(lanes: Sequence[Lane]) -> rr.LineStrips3D:
    """Both borders of every lane."""
    colours = [LANE_COLOURS.get(lane.kind, OTHER_LANE_COLOUR) for lane in lanes]
    return rr.LineStrips3D(
        [border for lane in lanes for border in (lane.left, lane.right)],
        colors=[colour for colour in colours for _ in range(2)],
        radii=rr.Radius.ui_points(1.0),
    )
