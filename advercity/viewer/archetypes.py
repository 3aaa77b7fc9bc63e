"""What poses, points, boxes and roads are in Rerun.

Roads and receivers' fixes on a map of the Earth.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import rerun as rr
from advercity_dsl import Road
from numpy.typing import NDArray

from advercity.frames import ActorState
from advercity.geometry import poses
from advercity.geometry.geodesy import Geodetic, geodetic_from_enu
from advercity.geometry.poses import Matrix
from advercity.roads.lane_segments import LaneSegment
from advercity.semantics import ACTOR_COLOURS
from advercity.sensors.annotation import compute_box_centre
from advercity.sensors.sensor_frame import CameraImage, SensorFrame, compute_image_intrinsics
from advercity.viewer.cloud_colours import CloudColour, colour_points

RgbColour = tuple[int, int, int]
IMAGE_PLANE_M = 1.5
POINT_PX = 1.5
CLASS_IDS = {name: index for index, name in enumerate(ACTOR_COLOURS, start=1)}
LANE_COLOURS = {"driving": (190, 190, 190), "sidewalk": (140, 110, 140), "crossing": (220, 200, 90)}
OTHER_LANE_COLOUR = (110, 110, 110)


def to_transform3d(parent_from_child: Matrix) -> rr.Transform3D:
    """Where a child stands in its parent."""
    return rr.Transform3D(translation=parent_from_child[:3, 3], mat3x3=parent_from_child[:3, :3])


def to_pinhole(picture: CameraImage, *, horizontal_fov_deg: float) -> rr.Pinhole:
    """Body axes are said to the viewer, so that poses need no turning."""
    height, width = picture.image.shape[:2]
    return rr.Pinhole(
        image_from_camera=compute_image_intrinsics(picture, horizontal_fov_deg=horizontal_fov_deg),
        resolution=(width, height),
        camera_xyz=rr.ViewCoordinates.FLU,
        image_plane_distance=IMAGE_PLANE_M,
    )


def to_points3d(reading: SensorFrame, by: CloudColour) -> rr.Points3D:
    """Points in the LiDAR's frame."""
    radii = rr.Radius.ui_points(POINT_PX)
    return rr.Points3D(
        reading.point_cloud.points, colors=colour_points(reading.point_cloud, by), radii=radii
    )


def to_boxes3d(states: Sequence[ActorState]) -> rr.Boxes3D:
    """Boxes of actors in the world, told by their classes."""
    return rr.Boxes3D(
        centers=np.reshape([compute_box_centre(state) for state in states], (-1, 3)),
        half_sizes=np.reshape([state.actor.size for state in states], (-1, 3)) / 2,
        quaternions=[
            rr.Quaternion(xyzw=_to_quaternion_xyzw(state.world_from_body)) for state in states
        ],
        class_ids=[CLASS_IDS[state.actor.actor_class] for state in states],
        labels=[f"{state.actor.actor_class} {state.actor.id}" for state in states],
        show_labels=False,
    )


def _to_quaternion_xyzw(matrix: Matrix) -> NDArray[np.float64]:
    """x, y, z, w of a pose: yaw, pitch and roll in halves (Diebel, Representing Attitude, 2006)."""
    yaw, pitch, roll = (angle / 2 for angle in poses.to_yaw_pitch_roll(matrix))
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


def build_annotation_context() -> rr.AnnotationContext:
    """Names and colours of the classes of `boxes`."""
    classes = [
        rr.AnnotationInfo(id=CLASS_IDS[name], label=name, color=colour)
        for name, colour in ACTOR_COLOURS.items()
    ]
    return rr.AnnotationContext(classes)


def to_line_strip(
    points: Sequence[Sequence[float]], colour: RgbColour, width_px: float
) -> rr.LineStrips3D:
    """A trajectory through points (n, 3) of the world."""
    strips = [points] if len(points) > 1 else []
    return rr.LineStrips3D(strips, colors=colour, radii=rr.Radius.ui_points(width_px))


def to_lane_strips(lanes: Sequence[LaneSegment]) -> rr.LineStrips3D:
    """Both borders of every lane."""
    colours = [LANE_COLOURS.get(lane.kind, OTHER_LANE_COLOUR) for lane in lanes]
    return rr.LineStrips3D(
        [border for lane in lanes for border in (lane.left, lane.right)],
        colors=[colour for colour in colours for _ in range(2)],
        radii=rr.Radius.ui_points(1.0),
    )


AGENT_COLOURS: tuple[RgbColour, ...] = (
    (0, 200, 120),
    (255, 170, 0),
    (90, 140, 255),
    (230, 90, 200),
)
ROAD_COLOUR = (120, 120, 120)
FIX_PX, TRACK_PX, ROAD_PX = 6.0, 2.0, 1.0
LINEARISATION_SPAN_M = 1000.0


@dataclass
class AgentTrack:
    """Where a vehicle has been: places (x, y, z) in the world, and fixes in degrees."""

    colour: RgbColour
    driven: list[tuple[float, float, float]] = field(default_factory=list)
    fixes: list[tuple[float, float]] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class LocalGeoMap:
    """Latitude and longitude around a road's origin, to a decimetre within a kilometre.

    Attributes:
        origin_deg: (2,) latitude and longitude.
        degrees_per_m: (2, 2) of latitude and longitude by metre to the east and to the north.
    """

    origin_deg: NDArray[np.float64]
    degrees_per_m: NDArray[np.float64]

    @staticmethod
    def around_road(road: Road) -> "LocalGeoMap":
        """The map around a road."""
        origin = Geodetic(road.origin_lat_deg, road.origin_lon_deg)
        middle, east, north = (
            np.array([place.latitude_deg, place.longitude_deg])
            for place in (
                geodetic_from_enu(point, origin)
                for point in (
                    (0.0, 0.0, 0.0),
                    (LINEARISATION_SPAN_M, 0.0, 0.0),
                    (0.0, LINEARISATION_SPAN_M, 0.0),
                )
            )
        )
        return LocalGeoMap(
            middle, np.column_stack([east - middle, north - middle]) / LINEARISATION_SPAN_M
        )

    def to_degrees(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Latitudes and longitudes (n, 2) of points (n, 3) of the world."""
        return self.origin_deg + points[:, :2] @ self.degrees_per_m.T

    def to_lane_lines(self, lanes: Sequence[LaneSegment]) -> rr.GeoLineStrings:
        """Both borders of every lane; without the map's tiles there is still the road."""
        return rr.GeoLineStrings(
            lat_lon=[self.to_degrees(side) for lane in lanes for side in (lane.left, lane.right)],
            colors=ROAD_COLOUR,
            radii=rr.Radius.ui_points(ROAD_PX),
        )


def choose_agent_colour(index: int) -> RgbColour:
    """What a viewpoint is drawn in, in the scene and on the map."""
    return AGENT_COLOURS[index % len(AGENT_COLOURS)]


def to_geo_point(fix: tuple[float, float], colour: RgbColour) -> rr.GeoPoints:
    """Where a receiver says that it is."""
    return rr.GeoPoints(lat_lon=[fix], colors=colour, radii=rr.Radius.ui_points(FIX_PX))


def to_geo_line(fixes: Sequence[tuple[float, float]], colour: RgbColour) -> rr.GeoLineStrings:
    """Where it has said to be."""
    strips = [fixes] if len(fixes) > 1 else []
    return rr.GeoLineStrings(lat_lon=strips, colors=colour, radii=rr.Radius.ui_points(TRACK_PX))
