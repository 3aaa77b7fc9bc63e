"""Converts poses, points, boxes, lanes and GNSS fixes to Rerun's archetypes."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import rerun as rr
from advercity_dsl import Road
from numpy.typing import NDArray

from advercity.dataset.image_codec import encode_jpeg, encode_label_png
from advercity.frames import ActorState
from advercity.geometry import poses
from advercity.geometry.geodesy import find_world_origin, geodetic_from_enu
from advercity.geometry.poses import Matrix
from advercity.roads.lane_segments import LaneSegment
from advercity.semantics import ACTOR_COLOURS
from advercity.sensors.camera_model import CameraModel
from advercity.viewer.shown import Picture, Points

RgbColour = tuple[int, int, int]
IMAGE_PLANE_M = 1.5
"""Distance from a camera at which the scene shows its image."""
FIX_PX, TRACK_PX, LANE_PX = 6.0, 2.0, 1.0
"""Sizes on the screen."""
CLASS_IDS = {name: index for index, name in enumerate(ACTOR_COLOURS, start=1)}
LANE_COLOURS = {"driving": (190, 190, 190), "sidewalk": (140, 110, 140), "crossing": (220, 200, 90)}
OTHER_LANE_COLOUR = (110, 110, 110)
ROAD_COLOUR = (120, 120, 120)
AGENT_COLOURS: tuple[RgbColour, ...] = (
    (0, 200, 120),
    (255, 170, 0),
    (90, 140, 255),
    (230, 90, 200),
)
SOUTH_UP = (1.0, -1.0)
"""Views in two dimensions have the second axis downwards."""
LINEARISATION_SPAN_M = 1000.0
"""Length over which a map's degrees per metre are measured."""


def to_transform3d(parent_from_child: Matrix) -> rr.Transform3D:
    """Convert the pose (4, 4) of a child in its parent."""
    return rr.Transform3D(translation=parent_from_child[:3, 3], mat3x3=parent_from_child[:3, :3])


def build_pinhole(model: CameraModel) -> rr.Pinhole:
    """Build the pinhole of a camera; its axes are declared, so its pose stays in body axes.

    Rerun has no lenses: its image plane is as for a pinhole of the same focal length.
    """
    return rr.Pinhole(
        image_from_camera=model.matrix,
        resolution=(model.width_px, model.height_px),
        camera_xyz=rr.ViewCoordinates.FLU,
        image_plane_distance=IMAGE_PLANE_M,
    )


def to_points3d(shown: Points) -> rr.Points3D:
    """Convert points in a sensor's frame."""
    # Rerun takes negative radii for sizes on the screen.
    return rr.Points3D(shown.points, colors=shown.colours, radii=-np.asarray(shown.sizes_px))


def to_encoded_image(picture: Picture) -> rr.EncodedImage:
    """Convert an image."""
    if picture.is_label:
        contents = encode_label_png(picture.pixels)
        return rr.EncodedImage(contents=contents, media_type="image/png")
    return rr.EncodedImage(contents=encode_jpeg(picture.pixels), media_type="image/jpeg")


def to_boxes3d(states: Sequence[ActorState]) -> rr.Boxes3D:
    """Convert the boxes of actors in the world, with their classes and ids."""
    # Rerun has the real part of a quaternion last.
    quaternions = [np.roll(poses.to_quaternion(state.world_from_body), -1) for state in states]
    return rr.Boxes3D(
        centers=np.reshape([state.box_centre for state in states], (-1, 3)),
        half_sizes=np.reshape([state.box.size for state in states], (-1, 3)) / 2,
        quaternions=[rr.Quaternion(xyzw=quaternion) for quaternion in quaternions],
        class_ids=[CLASS_IDS[state.actor.actor_class] for state in states],
        labels=[f"{state.actor.actor_class} {state.actor.id}" for state in states],
        show_labels=False,
    )


def build_annotation_context() -> rr.AnnotationContext:
    """Build the names and colours of the classes of `to_boxes3d`."""
    classes = [
        rr.AnnotationInfo(id=CLASS_IDS[name], label=name, color=colour)
        for name, colour in ACTOR_COLOURS.items()
    ]
    return rr.AnnotationContext(classes)


def to_line_strip(
    points: Sequence[Sequence[float]], colour: RgbColour, width_px: float
) -> rr.LineStrips3D:
    """Convert a trajectory through points (n, 3) of the world; one point gives no line."""
    strips = [points] if len(points) > 1 else []
    return rr.LineStrips3D(strips, colors=colour, radii=rr.Radius.ui_points(width_px))


def to_lane_strips(lanes: Sequence[LaneSegment]) -> rr.LineStrips3D:
    """Convert both borders of every lane."""
    colours = [LANE_COLOURS.get(lane.kind, OTHER_LANE_COLOUR) for lane in lanes]
    return rr.LineStrips3D(
        [border for lane in lanes for border in (lane.left, lane.right)],
        colors=[colour for colour in colours for _ in range(2)],
        radii=rr.Radius.ui_points(LANE_PX),
    )


@dataclass
class AgentTrack:
    """Past of a vehicle: positions (x, y, z) in the world, and GNSS fixes in degrees."""

    colour: RgbColour
    driven: list[tuple[float, float, float]] = field(default_factory=list)
    fixes: list[tuple[float, float]] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class LocalGeoMap:
    """Linear map from metres to degrees around a road's origin: 0.1 m of error within 1 km.

    Attributes:
        origin_deg: (2,) latitude and longitude.
        degrees_per_m: (2, 2) change of latitude and longitude (rows) per metre east and north.
    """

    origin_deg: NDArray[np.float64]
    degrees_per_m: NDArray[np.float64]

    @staticmethod
    def around_road(road: Road) -> "LocalGeoMap":
        """Build the map around a road."""
        origin = find_world_origin(road)
        span = LINEARISATION_SPAN_M
        points = ((0.0, 0.0, 0.0), (span, 0.0, 0.0), (0.0, span, 0.0))
        fixes = [geodetic_from_enu(point, origin) for point in points]
        middle, east, north = (np.array([fix.latitude_deg, fix.longitude_deg]) for fix in fixes)
        return LocalGeoMap(middle, np.column_stack([east - middle, north - middle]) / span)

    def to_degrees(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Convert points (n, 3) of the world to latitudes and longitudes (n, 2)."""
        return self.origin_deg + points[:, :2] @ self.degrees_per_m.T

    def to_metres(self, fixes: Sequence[tuple[float, float]]) -> NDArray[np.float64]:
        """Convert latitudes and longitudes (n, 2) to metres east and north of the origin (n, 2)."""
        offsets = np.reshape(fixes, (-1, 2)) - self.origin_deg
        return offsets @ np.linalg.inv(self.degrees_per_m).T


def choose_agent_colour(index: int) -> RgbColour:
    """Choose the colour of an agent in the scene and on the map."""
    return AGENT_COLOURS[index % len(AGENT_COLOURS)]


class TileMap:
    """Shows receivers and lanes by their degrees, on a map whose tiles come from the Internet."""

    def __init__(self, around: LocalGeoMap) -> None:
        self._around = around

    def to_lane_lines(self, lanes: Sequence[LaneSegment]) -> rr.GeoLineStrings:
        """Convert both borders of every lane."""
        borders = [self._around.to_degrees(side) for lane in lanes for side in lane_borders(lane)]
        radii = rr.Radius.ui_points(LANE_PX)
        return rr.GeoLineStrings(lat_lon=borders, colors=ROAD_COLOUR, radii=radii)

    def to_point(self, fix: tuple[float, float], colour: RgbColour) -> rr.GeoPoints:
        """Convert the latest fix (latitude, longitude) of a receiver."""
        return rr.GeoPoints(lat_lon=[fix], colors=colour, radii=rr.Radius.ui_points(FIX_PX))

    def to_line(self, fixes: Sequence[tuple[float, float]], colour: RgbColour) -> rr.GeoLineStrings:
        """Convert all fixes (latitude, longitude) of a receiver; one fix gives no line."""
        strips = [fixes] if len(fixes) > 1 else []
        radii = rr.Radius.ui_points(TRACK_PX)
        return rr.GeoLineStrings(lat_lon=strips, colors=colour, radii=radii)


class PlaneMap:
    """Shows receivers and lanes in metres east and south of the road's origin, without a map."""

    def __init__(self, around: LocalGeoMap) -> None:
        self._around = around

    def to_lane_lines(self, lanes: Sequence[LaneSegment]) -> rr.LineStrips2D:
        """Convert both borders of every lane."""
        borders = [side[:, :2] * SOUTH_UP for lane in lanes for side in lane_borders(lane)]
        return rr.LineStrips2D(borders, colors=ROAD_COLOUR, radii=rr.Radius.ui_points(LANE_PX))

    def to_point(self, fix: tuple[float, float], colour: RgbColour) -> rr.Points2D:
        """Convert the latest fix (latitude, longitude) of a receiver."""
        points = self._around.to_metres([fix]) * SOUTH_UP
        return rr.Points2D(points, colors=colour, radii=rr.Radius.ui_points(FIX_PX))

    def to_line(self, fixes: Sequence[tuple[float, float]], colour: RgbColour) -> rr.LineStrips2D:
        """Convert all fixes (latitude, longitude) of a receiver; one fix gives no line."""
        strips = [self._around.to_metres(fixes) * SOUTH_UP] if len(fixes) > 1 else []
        return rr.LineStrips2D(strips, colors=colour, radii=rr.Radius.ui_points(TRACK_PX))


def lane_borders(lane: LaneSegment) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return both borders (n, 3) of a lane."""
    return lane.left, lane.right
