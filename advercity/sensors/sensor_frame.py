"""What the sensors of one viewpoint report in one frame."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from advercity_dsl import Agent
from numpy.typing import NDArray

from advercity.conflicts.roles import ConflictRole, ConflictRoles
from advercity.frames import Frame
from advercity.geometry.poses import Matrix
from advercity.sensors.measurements import GnssFix, ImuSample, PointCloud

PixelBox = tuple[float, float, float, float]
"""Left, top, right and bottom in pixels; pixel k reaches from k to k + 1."""


@dataclass(frozen=True)
class ProjectedBox:
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
    visible_box: PixelBox | None
    outline_box: PixelBox

    @property
    def occlusion(self) -> float:
        """Share of what the picture could show of it that something hides."""
        return 1.0 - min(1.0, self.visible_px / self.outline_px)

    @property
    def visible_fraction(self) -> float:
        """Share of its whole outline that the picture shows."""
        return (1.0 - self.occlusion) * (1.0 - self.truncation)


@dataclass(frozen=True, eq=False)
class CameraImage:
    """A camera's image, its semantic and depth twins, and how much of whom it shows.

    Attributes:
        world_from_camera: (4, 4), body axes: x along the view, y left, z up.
        image: (h, w, 3) uint8 RGB.
        semantic: (h, w) uint8 of `Semantic`.
        depth: (h, w) uint8, whole metres along the optical axis, 255 for that and all beyond.
        projected_boxes: By id of the actor, for all whose outlines reach into the picture.
    """

    world_from_camera: Matrix
    image: NDArray[np.uint8]
    semantic: NDArray[np.uint8]
    depth: NDArray[np.uint8]
    projected_boxes: Mapping[int, ProjectedBox]


@dataclass(frozen=True, eq=False)
class SensorFrame:
    """One viewpoint at one tick; everything is in the right-handed world and body frames.

    Attributes:
        agent: Whose sensors these are.
        frame: The truth at this tick.
        world_from_agent: (4, 4), the vehicle's origin on the ground or the roadside unit.
        estimated_world_from_agent: The same as the agent's localisation believes it to be.
        world_from_lidar: (4, 4).
        camera_images: In the order of the rig's mounts.
        point_cloud: Points in the LiDAR's frame.
        lidar_hits: Rays of the noise-free LiDAR that met an actor, by actor id.
        gnss: None where there is no receiver to report.
        imu: None where there is none.
        conflict_roles: Who of all actors takes part in staged conflicts, and as what.
        planned_trajectory: Points that the agent is about to drive through: x, y, speed in m/s.
    """

    agent: Agent
    frame: Frame
    world_from_agent: Matrix
    estimated_world_from_agent: Matrix
    world_from_lidar: Matrix
    camera_images: tuple[CameraImage, ...]
    point_cloud: PointCloud
    lidar_hits: Mapping[int, int]
    gnss: GnssFix | None = None
    imu: ImuSample | None = None
    planned_trajectory: tuple[tuple[float, float, float], ...] = ()
    conflict_roles: ConflictRoles = field(default_factory=dict[int, Mapping[str, ConflictRole]])

    @property
    def speed_m_s(self) -> float:
        """Of the agent's vehicle; 0 for a roadside unit."""
        if self.agent.place.kind == "roadside_unit":
            return 0.0
        return self.frame.get_state(self.agent.number).speed_m_s


def compute_image_intrinsics(
    picture: CameraImage, *, horizontal_fov_deg: float
) -> NDArray[np.float64]:
    """Pinhole matrix (3, 3) in pixels of a picture as large as it is."""
    height, width = picture.image.shape[:2]
    return compute_pinhole_matrix(width, height, horizontal_fov_deg=horizontal_fov_deg)


def compute_pinhole_matrix(
    width: int, height: int, *, horizontal_fov_deg: float
) -> NDArray[np.float64]:
    """Pinhole matrix (3, 3) in pixels.

    Optical axes: x right, y down, z along the view; no distortion.
    """
    focal_px = width / (2 * np.tan(np.deg2rad(horizontal_fov_deg) / 2))
    return np.array([[focal_px, 0, width / 2], [0, focal_px, height / 2], [0, 0, 1]])
