"""What the sensors of one viewpoint report in one frame."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from advercity_dsl import Agent
from numpy.typing import NDArray

from advercity.dataset.roles import Role, Roles
from advercity.dataset.sightings import Sighting
from advercity.poses import Matrix
from advercity.sensors.gnss import GnssFix
from advercity.sensors.imu import ImuSample
from advercity.sensors.lidar import PointCloud
from advercity.traffic.trace import Frame


@dataclass(frozen=True, eq=False)
class Picture:
    """A camera's image, its semantic and depth twins, and how much of whom it shows.

    Attributes:
        world_from_camera: (4, 4), body axes: x along the view, y left, z up.
        image: (h, w, 3) uint8 RGB.
        semantic: (h, w) uint8 of `Semantic`.
        depth: (h, w) uint8, whole metres along the optical axis, 255 for that and all beyond.
        sightings: By id of the actor, for all whose outlines reach into the picture.
    """

    world_from_camera: Matrix
    image: NDArray[np.uint8]
    semantic: NDArray[np.uint8]
    depth: NDArray[np.uint8]
    sightings: Mapping[int, Sighting]


@dataclass(frozen=True, eq=False)
class Reading:
    """One viewpoint at one tick; everything is in the right-handed world and body frames.

    Attributes:
        agent: Whose sensors these are.
        frame: The truth at this tick.
        world_from_agent: (4, 4), the vehicle's origin on the ground or the roadside unit.
        estimated_world_from_agent: The same as the agent's localisation believes it to be.
        world_from_lidar: (4, 4).
        pictures: In the order of the rig's mounts.
        cloud: Points in the LiDAR's frame.
        visible: Rays of the noise-free LiDAR that met an actor, by actor id.
        gnss: None where there is no receiver to report.
        imu: None where there is none.
        roles: Who of all actors takes part in staged conflicts, and as what.
        planned: Points that the agent is about to drive through: x, y, speed in m/s.
    """

    agent: Agent
    frame: Frame
    world_from_agent: Matrix
    estimated_world_from_agent: Matrix
    world_from_lidar: Matrix
    pictures: tuple[Picture, ...]
    cloud: PointCloud
    visible: Mapping[int, int]
    gnss: GnssFix | None = None
    imu: ImuSample | None = None
    planned: tuple[tuple[float, float, float], ...] = ()
    roles: Roles = field(default_factory=dict[int, Mapping[str, Role]])

    @property
    def speed_m_s(self) -> float:
        """Of the agent's vehicle; 0 for a roadside unit."""
        if self.agent.place.kind == "roadside_unit":
            return 0.0
        return self.frame.of(self.agent.number).speed_m_s


def intrinsic(picture: Picture, *, horizontal_fov_deg: float) -> NDArray[np.float64]:
    """Pinhole matrix (3, 3) in pixels of a picture as large as it is."""
    height, width = picture.image.shape[:2]
    return pinhole(width, height, horizontal_fov_deg=horizontal_fov_deg)


def pinhole(width: int, height: int, *, horizontal_fov_deg: float) -> NDArray[np.float64]:
    """Pinhole matrix (3, 3) in pixels.

    Optical axes: x right, y down, z along the view; no distortion.
    """
    focal_px = width / (2 * np.tan(np.deg2rad(horizontal_fov_deg) / 2))
    return np.array([[focal_px, 0, width / 2], [0, focal_px, height / 2], [0, 0, 1]])
