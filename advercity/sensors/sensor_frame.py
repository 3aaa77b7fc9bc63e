"""The measurements of all sensors of one agent in one frame."""

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from advercity_dsl import Agent, Weather
from advercity_dsl.sensor_kinds import load_sensor_kinds
from numpy.typing import NDArray

from advercity.conflicts.roles import ConflictRole, ConflictRoles
from advercity.frames import Frame
from advercity.geometry.poses import Matrix
from advercity.sensors.camera_model import CameraModel
from advercity.sensors.measurements import (
    CameraReadout,
    CanSample,
    GnssFix,
    ImuSample,
    OpticalFlow,
    PointCloud,
    RadarCube,
    RadarDetections,
)
from advercity.sensors.messages import SentMessages
from advercity.sensors.rolling_shutter import RollingCamera

PixelBox = tuple[float, float, float, float]
"""Left, top, right and bottom in pixels; pixel k extends from k to k + 1."""


@dataclass(frozen=True)
class ProjectedBox:
    """An actor in one camera image.

    Attributes:
        visible_px: Number of the actor's pixels.
        outline_px: Area of the actor's outline inside the image.
        truncation: Fraction of the outline outside the image.
        visible_box: Bounding box of the actor's pixels; None if there are none.
        outline_box: Bounding box of the outline inside the image.
    """

    visible_px: int
    outline_px: float
    truncation: float
    visible_box: PixelBox | None
    outline_box: PixelBox

    @property
    def occlusion(self) -> float:
        """Hidden fraction of the outline inside the image."""
        return 1.0 - min(1.0, self.visible_px / self.outline_px)

    @property
    def visible_fraction(self) -> float:
        """Visible fraction of the whole outline."""
        return (1.0 - self.occlusion) * (1.0 - self.truncation)


@dataclass(frozen=True, eq=False)
class CameraImage:
    """A camera's image, with semantics, depths and projected boxes of the same pixels.

    Attributes:
        world_from_camera: (4, 4), body axes: x along the view, y left, z up.
        image: (h, w, 3) uint8 RGB.
        semantic: (h, w) uint8 of `Semantic`.
        depth_cm: (h, w) uint16, centimetres along the optical axis; 65535 at and beyond 65535 cm.
        projected_boxes: Boxes by actor id, of the actors whose outline overlaps the image.
        instance: (h, w) int32 actor id, 0 for everything static; None if the rig does not ask.
        normal: (h, w, 3) float32, unit, x right, y down, z ahead, 0 for sky; None if not asked for.
        flow: Motion to the next image; None if the rig does not ask.
        hdr: (h, w, 3) uint16, linear; None if the rig does not ask.
        raw: (h, w) uint16, of the sensor's pixels; None if the rig does not ask.
        readout: Exposure, and scale of `hdr` and `raw`; None if the rig asks for neither.
        rolling: Poses during the readout; None if all rows are exposed at once.
        time_s: Time of the image, as in `LidarScan`.
    """

    world_from_camera: Matrix
    image: NDArray[np.uint8]
    semantic: NDArray[np.uint8]
    depth_cm: NDArray[np.uint16]
    projected_boxes: Mapping[int, ProjectedBox]
    instance: NDArray[np.int32] | None = None
    normal: NDArray[np.float32] | None = None
    flow: OpticalFlow | None = None
    hdr: NDArray[np.uint16] | None = None
    raw: NDArray[np.uint16] | None = None
    readout: CameraReadout | None = None
    rolling: RollingCamera | None = None
    time_s: float | None = None

    @property
    def seen_actors(self) -> frozenset[int]:
        """Ids of the actors with a pixel of the image."""
        return _find_visible(self.projected_boxes)


@dataclass(frozen=True, eq=False)
class LidarScan:
    """One scan of a LiDAR.

    Attributes:
        world_from_lidar: (4, 4) at the frame's instant.
        point_cloud: Points in the LiDAR's frame.
        hits: Number of the noise-free LiDAR's beams on each actor, by actor id.
        time_s: Time of the scan, as `Frame.time_s`; None for a sensor without its own rate.
    """

    world_from_lidar: Matrix
    point_cloud: PointCloud
    hits: Mapping[int, int]
    time_s: float | None = None


@dataclass(frozen=True, eq=False)
class ThermalImage:
    """An image of a thermal camera, with labels of the same pixels.

    Attributes:
        world_from_camera: (4, 4), body axes: x along the view, y left, z up.
        counts: (h, w) uint16, in steps of `KELVIN_PER_COUNT`.
        semantic: (h, w) uint8 of `Semantic`.
        instance: (h, w) int32 id of the actor; 0 for everything static.
        projected_boxes: Actors in the image, by their ids.
        time_s: Time of the image, as in `LidarScan`.
    """

    world_from_camera: Matrix
    counts: NDArray[np.uint16]
    semantic: NDArray[np.uint8]
    instance: NDArray[np.int32]
    projected_boxes: Mapping[int, ProjectedBox]
    time_s: float | None = None

    @property
    def seen_actors(self) -> frozenset[int]:
        """Ids of the actors with a pixel of the image."""
        return _find_visible(self.projected_boxes)


@dataclass(frozen=True, eq=False)
class RadarScan:
    """One measurement of a radar.

    Attributes:
        world_from_radar: (4, 4) at the frame's instant.
        detections: Detections in the radar's frame.
        cube: Powers of all cells; None if the radar reports detections only.
        time_s: Time of the measurement, as in `LidarScan`.
        seen_actors: Ids of the actors whose echo arrives in clear air, detected or not.
    """

    world_from_radar: Matrix
    detections: RadarDetections
    cube: RadarCube | None = None
    time_s: float | None = None
    seen_actors: frozenset[int] = frozenset()


def _find_visible(boxes: Mapping[int, ProjectedBox]) -> frozenset[int]:
    return frozenset(number for number, box in boxes.items() if box.visible_px > 0)


@dataclass(frozen=True, eq=False)
class SensorFrame:
    """Measurements of one agent at one tick, in the right-handed world and body frames.

    Attributes:
        agent: The agent.
        frame: True state of all actors at this tick.
        world_from_agent: (4, 4), the vehicle's origin on the ground or the roadside unit.
        estimated_world_from_agent: (4, 4), the same as estimated by the agent's localisation.
        readings: Measurements of its sensors, by the names of their kinds and then by their
            numbers; kinds without a measurement may be left out.
        seen_actors: Ids of the actors it sees, if known from files; None for its measurements to
            tell.
        min_points: Least number of points on an annotated actor.
        planned_trajectory: Next points of the agent's trajectory: x, y, speed in m/s.
        conflict_roles: Roles of all actors in staged conflicts.
        weather: Weather at this tick if it changes over time, else None.
        sent: Messages of the agent at this tick; None without a V2X channel.
    """

    agent: Agent
    frame: Frame
    world_from_agent: Matrix
    estimated_world_from_agent: Matrix
    readings: Mapping[str, Sequence[Any]]
    seen_actors: Collection[int] | None = None
    min_points: int = 0
    planned_trajectory: tuple[tuple[float, float, float], ...] = ()
    conflict_roles: ConflictRoles = field(default_factory=dict[int, Mapping[str, ConflictRole]])
    weather: Weather | None = None
    sent: SentMessages | None = None

    @property
    def speed_m_s(self) -> float:
        """Speed of the agent's vehicle; 0 for a roadside unit."""
        if self.agent.place.kind == "roadside_unit":
            return 0.0
        return self.frame.get_state(self.agent.number).speed_m_s

    def with_readings(self, **readings: Sequence[Any]) -> "SensorFrame":
        """Return the frame with other measurements of some kinds of sensors."""
        return replace(self, readings={**self.readings, **readings})

    @property
    def camera_images(self) -> Sequence[CameraImage]:
        """Images, by the numbers of the cameras."""
        return self.readings.get("camera", ())

    @property
    def lidar_scans(self) -> Sequence[LidarScan]:
        """Scans, by the numbers of the LiDARs."""
        return self.readings.get("lidar", ())

    @property
    def radar_scans(self) -> Sequence[RadarScan]:
        """Scans, by the numbers of the radars."""
        return self.readings.get("radar", ())

    @property
    def thermal_images(self) -> Sequence[ThermalImage]:
        """Images, by the numbers of the thermal cameras."""
        return self.readings.get("thermal", ())

    @property
    def gnss(self) -> GnssFix | None:
        """Fix of the receiver; None without a receiver or a fix."""
        return next(iter(self.readings.get("gnss", ())), None)

    @property
    def imu(self) -> ImuSample | None:
        """Sample of the inertial unit; None without one."""
        return next(iter(self.readings.get("imu", ())), None)

    @property
    def can(self) -> CanSample | None:
        """Signals of the vehicle's bus; None without one."""
        return next(iter(self.readings.get("can", ())), None)

    @property
    def stamps(self) -> dict[str, float]:
        """Times of measurements by sensors with their own rates, as `Frame.time_s`, by name."""
        return {
            f"{kind.name}{number}": item.time_s
            for kind in load_sensor_kinds().found.values()
            if kind.has_place
            for number, item in enumerate(self.readings.get(kind.name, ()))
            if item.time_s is not None
        }

    @property
    def world_from_lidar(self) -> Matrix:
        """Pose (4, 4) of the first LiDAR."""
        return self.lidar_scans[0].world_from_lidar

    @property
    def world_from_reference(self) -> Matrix:
        """Pose (4, 4) of the first LiDAR, or of the agent itself without one."""
        return self.world_from_lidar if self.lidar_scans else self.world_from_agent

    @property
    def point_cloud(self) -> PointCloud:
        """Points of the first LiDAR, in its frame."""
        return self.lidar_scans[0].point_cloud

    @property
    def lidar_hits(self) -> Mapping[int, int]:
        """Number of all noise-free LiDARs' beams on each actor, by actor id."""
        return sum((Counter(scan.hits) for scan in self.lidar_scans), Counter[int]())

    def build_thermal_model(self, camera: int) -> CameraModel:
        """Build the projection of a thermal camera in pixels of its image."""
        height, width = self.thermal_images[camera].counts.shape
        declared = self.agent.sensors.thermals[camera].model
        return CameraModel.build_pinhole(declared.horizontal_fov_deg, width, height)

    def build_camera_model(self, camera: int) -> CameraModel:
        """Build the projection of a camera in pixels of its image."""
        height, width = self.camera_images[camera].image.shape[:2]
        return CameraModel.build(self.agent.sensors.cameras[camera].model, width, height)
