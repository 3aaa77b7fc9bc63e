"""Messages of ROS 2 in an MCAP recording."""

import json
from collections.abc import Mapping, Sequence
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from advercity.dataset.agent_view import AgentView
from advercity.dataset.boxes import Boxes
from advercity.geometry.poses import Matrix
from advercity.sensors.measurements import GnssFix, ImuSample
from advercity_exports.libraries import load_library
from advercity_exports.mcap_values import (
    PositionCovariance,
    Stamp,
    describe_camera,
    format_pose,
    format_quaternion,
    format_vector,
    list_fields,
    read_lens,
)
from advercity_exports.ros2_messages import format_definition

TYPES = {
    **{"int8": 1, "uint8": 2, "int16": 3, "uint16": 4},
    **{"int32": 5, "uint32": 6, "float32": 7, "float64": 8},
}
"""Numbers of the types of columns in `sensor_msgs/PointField`."""
DISTORTION_MODELS = {"brown_conrady": "plumb_bob", "kannala_brandt": "equidistant"}
"""ROS's names of lenses; coefficients are in OpenCV's order in both."""


class Ros2Encoder:
    """Messages of ROS 2: sensor_msgs, tf2_msgs, vision_msgs; the weather as JSON in a String."""

    @staticmethod
    def load_libraries() -> None:
        """Load the library; InputError if it is not installed."""
        load_library("mcap_ros2.writer", "mcap")

    def __init__(self, stream: IO[bytes]) -> None:
        self._writer = load_library("mcap_ros2.writer", "mcap").Writer(stream)
        self._schemas: dict[str, Any] = {}

    def finish(self) -> None:
        """Write the end of the recording."""
        self._writer.finish()

    def write_image(self, topic: str, stamp: Stamp, png: bytes) -> None:
        """Write an image."""
        self._write(topic, stamp, "sensor_msgs/CompressedImage", {"format": "png", "data": png})

    def write_calibration(self, topic: str, stamp: Stamp, view: AgentView, camera: int) -> None:
        """Write the calibration of a camera."""
        model, coefficients = read_lens(view, camera, DISTORTION_MODELS)
        described = describe_camera(view, camera)
        region = {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False}
        described |= {"distortion_model": model, "d": coefficients}
        described |= {"binning_x": 0, "binning_y": 0, "roi": region}
        self._write(topic, stamp, "sensor_msgs/CameraInfo", described)

    def write_points(self, topic: str, stamp: Stamp, table: NDArray[np.void]) -> None:
        """Write a table (n,) of points."""
        fields = [
            {"name": name, "offset": offset, "datatype": TYPES[kind], "count": 1}
            for name, offset, kind in list_fields(table)
        ]
        step = table.dtype.itemsize
        cloud = {"height": 1, "width": len(table), "fields": fields, "is_bigendian": False}
        cloud |= {"point_step": step, "row_step": step * len(table)}
        cloud |= {"data": table.tobytes(), "is_dense": True}
        self._write(topic, stamp, "sensor_msgs/PointCloud2", cloud)

    def write_transforms(
        self, topic: str, stamp: Stamp, poses: Sequence[tuple[str, Matrix]]
    ) -> None:
        """Write poses (4, 4) in the stamp's frame."""
        transforms = [
            {
                "header": _format_header(stamp),
                "child_frame_id": name,
                "transform": {
                    "translation": format_vector(pose[:3, 3]),
                    "rotation": format_quaternion(pose),
                },
            }
            for name, pose in poses
        ]
        self._add(topic, stamp, "tf2_msgs/TFMessage", {"transforms": transforms})

    def write_objects(self, topic: str, stamp: Stamp, boxes: Boxes) -> None:
        """Write boxes in the world."""
        detections = [
            {
                "header": _format_header(stamp),
                "results": [_format_hypothesis(boxes.classes[row], boxes.world_from_box[row])],
                "bbox": {
                    "center": format_pose(boxes.world_from_box[row]),
                    "size": format_vector(boxes.sizes[row]),
                },
                "id": str(number),
            }
            for row, number in enumerate(boxes.ids.tolist())
        ]
        self._write(topic, stamp, "vision_msgs/Detection3DArray", {"detections": detections})

    def write_fix(
        self, topic: str, stamp: Stamp, fix: GnssFix, covariance: PositionCovariance
    ) -> None:
        """Write a position on the globe."""
        values = {
            "status": {"status": 0, "service": 1},  # a fix, by GPS
            "latitude": fix.latitude_deg,
            "longitude": fix.longitude_deg,
            "altitude": fix.altitude_m,
            "position_covariance": covariance.matrix,
            "position_covariance_type": covariance.kind,
        }
        self._write(topic, stamp, "sensor_msgs/NavSatFix", values)

    def write_imu(self, topic: str, stamp: Stamp, imu: ImuSample) -> None:
        """Write the measurement of an IMU."""
        unknown = [0.0] * 9
        values = {
            # An IMU without orientation has -1 first in its covariance.
            "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
            "orientation_covariance": [-1.0, *unknown[1:]],
            "angular_velocity": format_vector(imu.angular_rate),
            "angular_velocity_covariance": unknown,
            "linear_acceleration": format_vector(imu.specific_force),
            "linear_acceleration_covariance": unknown,
        }
        self._write(topic, stamp, "sensor_msgs/Imu", values)

    def write_weather(self, topic: str, stamp: Stamp, weather: Mapping[str, Any]) -> None:
        """Write the weather."""
        self._add(topic, stamp, "std_msgs/String", {"data": json.dumps(weather)})

    def _write(self, topic: str, stamp: Stamp, name: str, values: dict[str, Any]) -> None:
        self._add(topic, stamp, name, {"header": _format_header(stamp), **values})

    def _add(self, topic: str, stamp: Stamp, name: str, values: dict[str, Any]) -> None:
        if name not in self._schemas:
            package, _, kind = name.partition("/")
            full_name = f"{package}/msg/{kind}"
            self._schemas[name] = self._writer.register_msgdef(full_name, format_definition(name))
        self._writer.write_message(topic, self._schemas[name], values, stamp.time_ns, stamp.time_ns)


def _format_header(stamp: Stamp) -> dict[str, Any]:
    seconds, nanos = divmod(stamp.time_ns, 1_000_000_000)
    return {"stamp": {"sec": seconds, "nanosec": nanos}, "frame_id": stamp.frame}


def _format_hypothesis(name: str, pose: Matrix) -> dict[str, Any]:
    known = {"pose": format_pose(pose), "covariance": [0.0] * 36}
    return {"hypothesis": {"class_id": name, "score": 1.0}, "pose": known}
