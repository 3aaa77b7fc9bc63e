"""The data of one agent in one frame, read from its files.

All values are in advercity's right-handed frames, whatever the layout of the files: world x east,
y north, z up; bodies x forward, y left, z up; metres and radians.
"""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from advercity.dataset.boxes import Boxes, parse_boxes, to_m_s
from advercity.dataset.carla_frame import (
    matrix_from_carla_pose,
    mirror_columns,
    mirror_points,
)
from advercity.dataset.cloud_files import read_pcd
from advercity.dataset.formats import DatasetFormat
from advercity.dataset.image_codec import (
    from_flow_colours,
    from_instance_colours,
    from_normal_colours,
    from_semantic_colours,
)
from advercity.dataset.motion_files import parse_can, parse_gnss, parse_imu
from advercity.dataset.radar_codec import RADAR_POINT, load_cube
from advercity.dataset.sensor_files import SensorFiles, load_all_files
from advercity.documents import MAX_JSON_BYTES, MAX_YAML_BYTES, parse_json, parse_yaml, read_bytes
from advercity.errors import InputError, RunError, describe_cause
from advercity.geometry import poses
from advercity.geometry.poses import Matrix
from advercity.image_files import decode_image
from advercity.sensors.camera_model import CameraModel
from advercity.sensors.measurements import (
    KELVIN_PER_COUNT,
    CameraReadout,
    CanSample,
    GnssFix,
    ImuSample,
    OpticalFlow,
    RadarCube,
)
from advercity.sensors.mounts import carrier_from_sensor
from advercity.sensors.rolling_shutter import RollingCamera, compute_row_times

if TYPE_CHECKING:
    from advercity_dsl import Agent

MAX_IMAGE_BYTES = 10**9
"""Far above any image without compression."""
REPAIR_HINT = "`advercity verify` lists all such files, `advercity repair` restores them"


@contextmanager
def report_read_errors(path: Path, hint: str = REPAIR_HINT) -> Generator[None]:
    """Name the file in any error raised by reading or parsing it.

    Args:
        path: The file.
        hint: How to get a whole one.

    Raises:
        InputError: It is missing or damaged.
        RunError: The system refuses to read it.
    """
    try:
        yield
    except FileNotFoundError as error:
        raise InputError(f"{path}: is missing; {hint}") from error
    except OSError as error:
        raise RunError(f"{path}: cannot be read: {describe_cause(error)}") from error
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        raise InputError(f"{path}: is damaged; {hint}") from error


class AgentView:
    """The data of one agent in one frame.

    The properties `cloud`, `points`, `radar`, `measured` and `extras` read their file at every use:
    keep the result, not the view. The frame's YAML, needed by all others, is read only once.

    Args:
        agent: The agent with its sensor rig; None where only its files are known.
        index: Number of the frame, counted from the first kept one.
        layout: Layout of the files.
        stem: Beginning of the paths of all its files.
    """

    hint = REPAIR_HINT
    """How to get whole files in place of damaged ones."""

    def __init__(self, agent: Agent | None, index: int, layout: DatasetFormat, stem: Path) -> None:
        self._agent = agent
        self.index = index
        self._format = layout
        self._stem = stem

    @property
    def agent(self) -> Agent:
        """The agent with its sensor rig; InputError where only its files are known."""
        if self._agent is None:
            raise InputError(f"{self._stem.parent}: its files do not describe the agent's rig")
        return self._agent

    @property
    def id(self) -> str:
        """Id of the agent."""
        return self.agent.id

    @property
    def number(self) -> int:
        """Id of the agent in annotations; negative for roadside units."""
        return self.agent.number

    @property
    def is_ego(self) -> bool:
        """Whether the agent is the ego."""
        return self.agent.is_ego

    @property
    def is_roadside_unit(self) -> bool:
        """Whether the agent is a roadside unit, else a vehicle."""
        return self.agent.place.kind == "roadside_unit"

    def count(self, kind: str) -> int:
        """Count the agent's sensors of a kind, such as `radar`."""
        return len(self.agent.sensors.list_sensors(kind))

    def read(self, kind: str, number: int = 0) -> Any:
        """Read the measurement of a sensor as its driver returned it during the run.

        InputError if the agent has no such sensor; None if a receiver, unit or bus sent no report.
        """
        return self._find_files(kind, number).read(self, number)

    def load_pose(self, kind: str, number: int = 0) -> Matrix:
        """Load the pose (4, 4) of a sensor of a kind; InputError if it has none."""
        locate = self._find_files(kind, number).locate
        if locate is None:
            raise InputError(f"sensors of kind '{kind}' have no pose of their own")
        return locate(self, number)

    def _find_files(self, kind: str, number: int) -> SensorFiles:
        kinds = load_all_files()
        if kind not in kinds:
            raise InputError(f"there is no kind of sensor '{kind}'; there are {', '.join(kinds)}")
        _check_number(kind, number, self.count(kind), self.id)
        return kinds[kind]

    @property
    def cameras(self) -> int:
        """Number of the agent's cameras."""
        return self.count("camera")

    @property
    def lidars(self) -> int:
        """Number of the agent's LiDARs."""
        return self.count("lidar")

    def image(self, camera: int) -> NDArray[np.uint8]:
        """Read the RGB image (h, w, 3) of a camera."""
        return self._read_camera("camera", camera, cv2.IMREAD_COLOR_RGB)

    def semantic(self, camera: int) -> NDArray[np.uint8]:
        """Read the tags (h, w) of `Semantic` of a camera's pixels."""
        return from_semantic_colours(self._read_camera("semantic", camera, cv2.IMREAD_COLOR_RGB))

    def instance(self, camera: int) -> NDArray[np.int32]:
        """Read the ids (h, w) of the actors in a camera's pixels, 0 for everything static.

        Ids are as in `boxes.ids`; actors without an annotation by this agent appear, too.
        InputError if the rig does not ask for `truth: [instance]`.
        """
        self._check_truth("instance", camera)
        return from_instance_colours(self._read_camera("instance", camera, cv2.IMREAD_COLOR_RGB))

    def normal(self, camera: int) -> NDArray[np.float32]:
        """Read the normals (h, w, 3) of surfaces: x right, y down, z along the view; 0 for sky.

        InputError if the rig does not ask for `truth: [normal]`.
        """
        self._check_truth("normal", camera)
        return from_normal_colours(self._read_camera("normal", camera, cv2.IMREAD_COLOR_RGB))

    def flow(self, camera: int) -> OpticalFlow:
        """Read the motion of each of a camera's pixels to the next image.

        It is unknown in a scenario's last frame. InputError unless the rig has `truth: [flow]`.
        """
        self._check_truth("flow", camera)
        mode = cv2.IMREAD_COLOR_RGB | cv2.IMREAD_ANYDEPTH
        colours: Any = self._read_camera("flow", camera, mode)
        occlusion = self._read_camera("occlusion", camera, cv2.IMREAD_UNCHANGED)
        return OpticalFlow(from_flow_colours(colours), occlusion > 0)

    def hdr(self, camera: int) -> NDArray[np.float32]:
        """Read the light (h, w, 3) on a camera's sensor in cd/m² of red, green and blue.

        Values are before white balance and tone curve: with noise, and clipped to the range of the
        sensor. InputError if the rig does not ask for `hdr: true`.
        """
        self._check_asked("hdr", camera, "hdr: true")
        mode = cv2.IMREAD_COLOR_RGB | cv2.IMREAD_ANYDEPTH
        values: Any = self._read_camera("hdr", camera, mode)
        return self.load_readout(camera).scale_hdr(values)

    def raw(self, camera: int) -> NDArray[np.uint16]:
        """Read the values (h, w) of a camera's pixels behind filters of one colour each.

        `load_readout(camera).count_electrons` makes electrons of them. InputError without `raw`.
        """
        self._check_asked("raw", camera, "raw: {}")
        values: Any = self._read_camera("raw", camera, cv2.IMREAD_UNCHANGED)
        return values

    def load_readout(self, camera: int) -> CameraReadout:
        """Load the meaning of the values of a camera's linear and raw images in this frame."""
        _check_number("camera", camera, self.cameras, self.id)
        with report_read_errors(self.path("_objects.json"), self.hint):
            found: dict[str, Any] = dict(self.extras["readouts"][f"camera{camera}"])
            found["white_point"] = tuple(found["white_point"])
            return CameraReadout(**found)

    def has_truth(self, kind: str, camera: int) -> bool:
        """Return whether a camera has images of truth of a kind: `instance`, `normal`, `flow`."""
        return f"_{kind}{camera}.png" in self._format.list_suffixes(self.agent)

    def _check_truth(self, kind: str, camera: int) -> None:
        self._check_asked(kind, camera, f"truth: [{kind}]")

    def _check_asked(self, kind: str, camera: int, declaration: str) -> None:
        _check_number("camera", camera, self.cameras, self.id)
        if not self.has_truth(kind, camera):
            raise InputError(
                f"camera{camera} of {self.id} has no images of kind {kind}; ask for them with"
                f" `{declaration}` in the camera of its rig"
            )

    def depth(self, camera: int) -> NDArray[np.uint8]:
        """Read the depths (h, w) in whole metres along a camera's optical axis; at most 255."""
        return self._read_camera("depth", camera, cv2.IMREAD_UNCHANGED)

    def depth_cm(self, camera: int) -> NDArray[np.uint16]:
        """Read the depths (h, w) in centimetres along a camera's optical axis; at most 65535."""
        image: Any = self._read_camera("depth_cm", camera, cv2.IMREAD_UNCHANGED)
        return image

    def bird_view(self, kind: str) -> NDArray[np.uint8]:
        """Read a map (256, 256): dynamic, static, lane, visibility or visibility_corp."""
        return self._read_image(f"_bev_{kind}.png", cv2.IMREAD_GRAYSCALE)

    @property
    def cloud(self) -> NDArray[np.void]:
        """The point table (n,) of the first LiDAR, read from its file at every use."""
        return self.load_cloud(0)

    def load_cloud(self, lidar: int) -> NDArray[np.void]:
        """Load the point table (n,) of a LiDAR.

        Its fields are `x`, `y`, `z` in the LiDAR's frame and `intensity`; in the OPV2V layout also
        `range` in metres, `time` in seconds relative to the frame's, `ring`, `tag` of `Semantic`,
        `object_id`, `kind` of `PointKind`, and `raw_x`, `raw_y`, `raw_z` if the sensor rig has
        `motion_distortion`.
        """
        _check_number("LiDAR", lidar, self.lidars, self.id)
        # A copy, because an array over the bytes of a file is read-only.
        path = self.path(self._format.format_cloud_suffix(lidar))
        table = self._format.read_cloud(path).copy()
        mirror_columns(table)
        return table

    @property
    def radars(self) -> int:
        """Number of the agent's radars."""
        return self.count("radar")

    @property
    def radar(self) -> NDArray[np.void]:
        """The detections (n,) of the first radar, read from their file at every use."""
        return self.load_radar(0)

    def load_radar(self, radar: int) -> NDArray[np.void]:
        """Load the detections (n,) of a radar.

        Fields: `x`, `y`, `z` in the radar's frame; `velocity` in m/s, positive for receding
        objects; `rcs` in dB over 1 m²; `snr` in dB; `object_id`; `kind` of `PointKind`.
        """
        _check_number("radar", radar, self.radars, self.id)
        table = read_pcd(self.path(self._format.format_radar_suffix(radar)), RADAR_POINT).copy()
        mirror_columns(table)
        return table

    def load_radar_cube(self, radar: int) -> RadarCube:
        """Load the powers of all cells of a radar whose rig has `output: cube`."""
        _check_number("radar", radar, self.radars, self.id)
        return load_cube(self.path(self._format.format_cube_suffix(radar)))

    def load_radar_pose(self, radar: int) -> Matrix:
        """Load the pose (4, 4) of a radar: x forward, y left, z up."""
        _check_number("radar", radar, self.radars, self.id)
        return self.parse_pose(f"radar{radar}_pose")

    @property
    def thermals(self) -> int:
        """Number of the agent's thermal cameras."""
        return self.count("thermal")

    def thermal(self, camera: int) -> NDArray[np.float32]:
        """Read the temperatures (h, w) in kelvin of black bodies with the pixels' radiance."""
        return self.thermal_counts(camera) * np.float32(KELVIN_PER_COUNT)

    def thermal_counts(self, camera: int) -> NDArray[np.uint16]:
        """Read the values (h, w) of a thermal camera, 14 bits in steps of `KELVIN_PER_COUNT`."""
        values: Any = self._read_thermal("thermal", camera, cv2.IMREAD_UNCHANGED)
        return values

    def thermal_semantic(self, camera: int) -> NDArray[np.uint8]:
        """Read the tags (h, w) of `Semantic` of a thermal camera's pixels."""
        colours = self._read_thermal("thermal_semantic", camera, cv2.IMREAD_COLOR_RGB)
        return from_semantic_colours(colours)

    def thermal_instance(self, camera: int) -> NDArray[np.int32]:
        """Read the ids (h, w) of the actors in a thermal camera's pixels, 0 for no actor."""
        colours = self._read_thermal("thermal_instance", camera, cv2.IMREAD_COLOR_RGB)
        return from_instance_colours(colours)

    def load_thermal_pose(self, camera: int) -> Matrix:
        """Load the pose (4, 4) of a thermal camera in body axes, as `world_from_camera`."""
        _check_number("thermal camera", camera, self.thermals, self.id)
        return self.parse_pose(f"thermal{camera}", "cords")

    def load_thermal_model(self, camera: int) -> CameraModel:
        """Load the projection of a thermal camera."""
        _check_number("thermal camera", camera, self.thermals, self.id)
        matrix = self._load_matrix(f"thermal{camera}")
        width, height = np.rint(2 * matrix[:2, 2]).astype(int).tolist()
        return CameraModel(width, height, float(matrix[0, 0]))

    def _read_thermal(self, kind: str, camera: int, mode: int) -> NDArray[np.uint8]:
        _check_number("thermal camera", camera, self.thermals, self.id)
        suffix = f"_{kind}{camera}.png"
        if suffix not in self._format.list_suffixes(self.agent):
            raise InputError(
                f"{self.path(suffix)}: the layout {self._format.name} has no such image"
            )
        return self._read_image(suffix, mode)

    @property
    def points(self) -> NDArray[np.float32]:
        """Points (n, 3) in the LiDAR's frame, read from the file of `cloud` at every use."""
        return _stack_columns(self.cloud, "x", "y", "z")

    @property
    def measured(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Points (n, 3) as the moving LiDAR measured them, and the time (n,) of each in seconds.

        They are in the order of `points`. Without `motion_distortion` the points equal `points`,
        all at time 0. The file of `cloud` is read at every use.
        """
        return extract_measured(self.cloud)

    @cached_property
    def description(self) -> dict[str, Any]:
        """The frame's YAML as it is in the file: left-handed, degrees, km/h; read once."""
        return self._load_description()

    def _load_description(self) -> dict[str, Any]:
        path = self.path(".yaml")
        with report_read_errors(path, self.hint):
            return parse_yaml(read_bytes(path, max_bytes=MAX_YAML_BYTES), path, hint=self.hint)

    @property
    def extras(self) -> dict[str, Any]:
        """The content of `_objects.json`, left-handed as in the file; read at every use."""
        return self.load_json("_objects.json")

    @property
    def motion(self) -> tuple[GnssFix | None, ImuSample | None]:
        """The reports of receiver and inertial unit, each None if absent; read at every use."""
        document = self._load_motion()
        with report_read_errors(self.path(self._format.motion_suffix), self.hint):
            gnss, imu = document.get("gnss"), document.get("imu")
            return gnss and parse_gnss(gnss), imu and parse_imu(imu)

    @property
    def can(self) -> CanSample | None:
        """Signals of the vehicle's bus, where its rig has them; read at every use."""
        document = self._load_motion()
        with report_read_errors(self.path(self._format.motion_suffix), self.hint):
            signals = document.get("can")
            return signals and parse_can(signals)

    def _load_motion(self) -> dict[str, Any]:
        """Load the reports of receiver, inertial unit and bus; empty for agents without them."""
        if not self._has_motion_file():
            return {}
        path = self.path(self._format.motion_suffix)
        with report_read_errors(path, self.hint):
            raw = read_bytes(path, max_bytes=MAX_YAML_BYTES)
            return parse_yaml(raw, path, hint=self.hint) or {}

    def _has_motion_file(self) -> bool:
        return self._format.motion_suffix in self._format.list_suffixes(self.agent)

    @property
    def messages_suffix(self) -> str:
        """End of the name of the file with this agent's V2X messages."""
        return self._format.messages_suffix

    def load_messages_document(self) -> dict[str, Any]:
        """Load the content of that file, still left-handed; read at every use."""
        return self.load_json(self.messages_suffix)

    def load_json(self, suffix: str) -> dict[str, Any]:
        """Load the JSON document with this suffix of this agent and frame."""
        path = self.path(suffix)
        with report_read_errors(path, self.hint):
            return parse_json(read_bytes(path, max_bytes=MAX_JSON_BYTES), path, hint=self.hint)

    @property
    def world_from_agent(self) -> Matrix:
        """Pose (4, 4) of the vehicle's origin on the ground, or of the roadside unit."""
        return self.parse_pose("true_ego_pos")

    @property
    def world_from_lidar(self) -> Matrix:
        """Pose (4, 4) of the first LiDAR: x forward, y left, z up."""
        return self.load_lidar_pose(0)

    def load_lidar_pose(self, lidar: int) -> Matrix:
        """Load the pose (4, 4) of a LiDAR."""
        _check_number("LiDAR", lidar, self.lidars, self.id)
        return self.parse_pose(f"lidar{lidar or ''}_pose")

    def world_from_camera(self, camera: int) -> Matrix:
        """Return the pose (4, 4) of a camera in body axes: x along the view, y left, z up."""
        return self.parse_pose(f"camera{camera}", "cords")

    def intrinsic(self, camera: int) -> NDArray[np.float64]:
        """Return the pinhole matrix (3, 3) in pixels; optical axes x right, y down, z ahead."""
        return self._load_matrix(f"camera{camera}")

    def _load_matrix(self, name: str) -> NDArray[np.float64]:
        with report_read_errors(self.path(".yaml"), self.hint):
            return np.reshape(self._get_described(name, "intrinsic"), (3, 3)).astype(np.float64)

    def pixels(self, camera: int, points_world: NDArray[np.float64]) -> NDArray[np.float64]:
        """Project points (n, 3) of the world into an image: column, row, depth in metres (n, 3).

        Points in the camera's plane give inf or NaN: drop points by their depth if they are not
        ahead. With a rolling shutter, the points rest while the camera moves.
        """
        model, rolling = self.camera_model(camera), self.rolling_camera(camera)
        if rolling is None:
            camera_from_world = poses.invert_pose(self.world_from_camera(camera))
            points = poses.transform_points(camera_from_world, points_world)
        else:
            points = rolling.place_points(points_world, model)
        return np.column_stack([model.pixels_from_camera(points), points[:, 0]])

    def rolling_camera(self, camera: int) -> RollingCamera | None:
        """Return the poses of a camera while its rows are exposed; None if all are at once."""
        name = f"camera{camera}"
        if "readout" not in self._get_described(name):
            return None
        with report_read_errors(self.path(".yaml"), self.hint):
            return RollingCamera(
                readout_s=float(self._get_described(name, "readout")),
                upper=self.parse_pose(name, "cords_upper_edge"),
                lower=self.parse_pose(name, "cords_lower_edge"),
            )

    def row_times(self, camera: int) -> NDArray[np.float64]:
        """Return when rows (h,) of an image are exposed, in seconds from the image's time.

        The image's time is the frame's, or the one in `stamps`.
        """
        height_px = self.camera_model(camera).height_px
        kind = self.agent.sensors.cameras[camera].model
        return compute_row_times(np.arange(height_px) + 0.5, kind, height_px)

    def camera_model(self, camera: int) -> CameraModel:
        """Return the projection of a camera, with the distortion by its lens."""
        matrix, kind = self.intrinsic(camera), self.agent.sensors.cameras[camera].model
        # The principal point is where the authored one is, of an image of another scale.
        scale = matrix[:2, 2] / kind.centre_px
        width, height = np.rint(scale * (kind.width_px, kind.height_px)).astype(int).tolist()
        return replace(CameraModel.build(kind, width, height), focal_px=float(matrix[0, 0]))

    @property
    def stamps(self) -> dict[str, float]:
        """When sensors with rates of their own measured, as `frame.time_s`: `lidar0`, `radar0`.

        All others measured at the frame's time.
        """
        with report_read_errors(self.path(".yaml"), self.hint):
            found: dict[str, Any] = self.description.get("stamps", {})
            return {name: float(time_s) for name, time_s in found.items()}

    def find_carrier_pose(self, kind: str, number: int) -> Matrix:
        """Find the pose (4, 4) of the agent when one of its sensors measured.

        It is `world_from_agent` unless the sensor has a rate of its own.
        """
        if f"{kind}{number}" not in self.stamps or self.is_roadside_unit:
            return self.world_from_agent
        mount = self.agent.sensors.list_sensors(kind)[number].mount
        return self.load_pose(kind, number) @ poses.invert_pose(carrier_from_sensor(mount))

    @property
    def speed_m_s(self) -> float:
        """Speed of the vehicle; 0 for a roadside unit."""
        with report_read_errors(self.path(".yaml"), self.hint):
            return to_m_s(float(self._get_described("ego_speed")))

    @property
    def boxes(self) -> Boxes:
        """The annotated objects: vehicles first, then pedestrians."""
        with report_read_errors(self.path(".yaml"), self.hint):
            return parse_boxes(self._get_described("vehicles") | self._get_described("walkers"))

    def load_steady_boxes(self) -> Boxes:
        """Load the annotated objects with boxes of constant size.

        The box of a pedestrian holds all poses of the gait, for formats with one pose per object.
        """
        objects = self.extras["objects"]
        with report_read_errors(self.path("_objects.json")):
            sizes = {int(key): one["size_m"] for key, one in objects.items() if "size_m" in one}
            return self.boxes.steady(sizes)

    def load_velocities(self) -> NDArray[np.float64]:
        """Load the velocities (n, 3) of the objects of `boxes` in the world, m/s."""
        objects, ids = self.extras["objects"], self.boxes.ids.tolist()
        with report_read_errors(self.path("_objects.json"), self.hint):
            found = [objects[str(number)]["velocity_m_s"] for number in ids]
            return mirror_points(np.reshape(found, (-1, 3)))

    def path(self, suffix: str) -> Path:
        """Return the path of this agent's file in this frame with a suffix, such as `.pcd`."""
        return self._stem.with_name(self._stem.name + suffix)

    def parse_pose(self, *keys: str) -> Matrix:
        """Parse the pose (4, 4) under some keys of `description`, such as `radar0_pose`."""
        with report_read_errors(self.path(".yaml"), self.hint):
            return matrix_from_carla_pose(self._get_described(*keys))

    def _get_described(self, *keys: str) -> Any:
        value: Any = self.description
        try:
            for key in keys:
                value = value[key]
        except (LookupError, TypeError) as error:
            path = self.path(".yaml")
            raise InputError(f"{path}: has no field {'.'.join(keys)}") from error
        return value

    def _read_camera(self, kind: str, camera: int, mode: int) -> NDArray[np.uint8]:
        _check_number("camera", camera, self.cameras, self.id)
        return self._read_image(f"_{kind}{camera}.png", mode)

    def _read_image(self, suffix: str, mode: int) -> NDArray[np.uint8]:
        path = self.path(suffix)
        try:
            return decode_image(read_bytes(path, max_bytes=MAX_IMAGE_BYTES), mode)
        except PermissionError as error:
            raise RunError(f"{path}: cannot be read: {describe_cause(error)}") from error
        except OSError as error:
            raise InputError(f"{path}: is missing; {self.hint}") from error
        except ValueError as error:
            raise InputError(f"{path}: is damaged, {error}; {self.hint}") from error


def extract_measured(
    table: NDArray[np.void],
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Extract points (n, 3) as a moving LiDAR measured them, and their times (n,), of its table."""
    if "raw_x" in (table.dtype.names or ()):
        return _stack_columns(table, "raw_x", "raw_y", "raw_z"), table["time"]
    return _stack_columns(table, "x", "y", "z"), np.zeros(len(table), np.float32)


def _check_number(what: str, number: int, count: int, agent: str) -> None:
    if not count:
        raise InputError(f"{agent} has no {what}")
    if not 0 <= number < count:
        found = f"one {what}, 0" if count == 1 else f"{what}s 0 to {count - 1}"
        raise InputError(f"{agent} has {found}; there is no {what} {number}")


def _stack_columns(table: NDArray[np.void], *names: str) -> NDArray[np.float32]:
    return np.column_stack([table[name] for name in names])
