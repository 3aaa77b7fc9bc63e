"""Foxglove's schemas in an MCAP recording."""

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

COLOURS = {
    "car": (0.2, 0.6, 1.0),
    "van": (0.2, 0.4, 1.0),
    "truck": (0.5, 0.3, 1.0),
    "bicycle": (0.2, 0.9, 0.4),
    "motorcycle": (0.6, 0.9, 0.2),
    "pedestrian": (1.0, 0.5, 0.1),
}
TYPES = {
    **{"uint8": 1, "int8": 2, "uint16": 3, "int16": 4},
    **{"uint32": 5, "int32": 6, "float32": 7, "float64": 8},
}
"""Foxglove's numbers of the types of columns."""
DISTORTION_MODELS = {"brown_conrady": "plumb_bob", "kannala_brandt": "kannala_brandt"}
"""Foxglove's names of lenses; coefficients are in OpenCV's order in both."""
VECTOR_SCHEMA = {"type": "object", "properties": {axis: {"type": "number"} for axis in "xyz"}}


class FoxgloveEncoder:
    """Foxglove's schemas as Protocol Buffers; IMU and weather, for which it has none, as JSON."""

    @staticmethod
    def load_libraries() -> None:
        """Load the libraries; InputError if one is not installed."""
        load_library("mcap.writer", "mcap")
        load_library("mcap_protobuf.schema", "mcap")
        load_library("foxglove_schemas_protobuf.PointCloud_pb2", "mcap")

    def __init__(self, stream: IO[bytes]) -> None:
        library = load_library("mcap.writer", "mcap")
        self._register_schema: Any = load_library("mcap_protobuf.schema", "mcap").register_schema
        self._writer = library.Writer(stream, compression=library.CompressionType.ZSTD)
        self._writer.start(profile="", library="advercity")
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}

    def finish(self) -> None:
        """Write the end of the recording."""
        self._writer.finish()

    def write_image(self, topic: str, stamp: Stamp, png: bytes) -> None:
        """Write an image."""
        self._write(topic, stamp, "CompressedImage", data=png, format="png")

    def write_calibration(self, topic: str, stamp: Stamp, view: AgentView, camera: int) -> None:
        """Write the calibration of a camera."""
        described = describe_camera(view, camera)
        model, coefficients = read_lens(view, camera, DISTORTION_MODELS)
        self._write(
            topic,
            stamp,
            "CameraCalibration",
            width=described["width"],
            height=described["height"],
            distortion_model=model,
            D=coefficients,
            K=described["k"],
            R=described["r"],
            P=described["p"],
        )

    def write_points(self, topic: str, stamp: Stamp, table: NDArray[np.void]) -> None:
        """Write a table (n,) of points."""
        fields = [
            {"name": name, "offset": offset, "type": TYPES[kind]}
            for name, offset, kind in list_fields(table)
        ]
        self._write(
            topic,
            stamp,
            "PointCloud",
            pose=format_pose(np.eye(4)),
            point_stride=table.dtype.itemsize,
            fields=fields,
            data=table.tobytes(),
        )

    def write_transforms(
        self, topic: str, stamp: Stamp, poses: Sequence[tuple[str, Matrix]]
    ) -> None:
        """Write poses (4, 4) in the stamp's frame."""
        transforms = [
            {
                "timestamp": self._build_time(stamp),
                "parent_frame_id": stamp.frame,
                "child_frame_id": name,
                "translation": format_vector(pose[:3, 3]),
                "rotation": format_quaternion(pose),
            }
            for name, pose in poses
        ]
        message = self._load("FrameTransforms")(transforms=transforms)
        self._add(topic, stamp, message)

    def write_objects(self, topic: str, stamp: Stamp, boxes: Boxes) -> None:
        """Write boxes in the world."""
        entities = [
            {
                "timestamp": self._build_time(stamp),
                "frame_id": stamp.frame,
                "id": str(number),
                "metadata": [
                    {"key": "class", "value": boxes.classes[row]},
                    {"key": "speed_m_s", "value": f"{boxes.speeds_m_s[row]:.6f}"},
                    {"key": "lidar_points", "value": str(boxes.lidar_points[row])},
                    {"key": "visible_fraction", "value": f"{boxes.visible_fraction[row]:.6f}"},
                ],
                "cubes": [
                    {
                        "pose": format_pose(boxes.world_from_box[row]),
                        "size": format_vector(boxes.sizes[row]),
                        "color": dict(
                            zip("rgba", (*COLOURS[boxes.classes[row]], 0.5), strict=True)
                        ),
                    }
                ],
            }
            for row, number in enumerate(boxes.ids.tolist())
        ]
        # Without the first, objects would stay in a viewer after they left the agent's view.
        deletions = [{"timestamp": self._build_time(stamp), "type": 1}]
        self._add(topic, stamp, self._load("SceneUpdate")(deletions=deletions, entities=entities))

    def write_fix(
        self, topic: str, stamp: Stamp, fix: GnssFix, covariance: PositionCovariance
    ) -> None:
        """Write a position on the globe."""
        self._write(
            topic,
            stamp,
            "LocationFix",
            latitude=fix.latitude_deg,
            longitude=fix.longitude_deg,
            altitude=fix.altitude_m,
            position_covariance=covariance.matrix,
            position_covariance_type=covariance.kind,
        )

    def write_imu(self, topic: str, stamp: Stamp, imu: ImuSample) -> None:
        """Write the measurement of an IMU."""
        measured = {
            "specific_force": format_vector(imu.specific_force),
            "angular_rate": format_vector(imu.angular_rate),
            "compass_rad": imu.compass_rad,
            "frame_id": stamp.frame,
        }
        properties: dict[str, Any] = dict.fromkeys(
            ("specific_force", "angular_rate"), VECTOR_SCHEMA
        )
        properties |= {"compass_rad": {"type": "number"}, "frame_id": {"type": "string"}}
        self._write_json(topic, stamp, "advercity.Imu", properties, measured)

    def write_weather(self, topic: str, stamp: Stamp, weather: Mapping[str, Any]) -> None:
        """Write the weather."""
        properties: dict[str, Any] = {name: {"type": "number"} for name in weather}
        properties |= {"id": {"type": "string"}, "time": {"type": "string"}}
        properties |= {"mor_m": {"type": ["number", "null"]}}
        self._write_json(topic, stamp, "advercity.Weather", properties, weather)

    def _load(self, name: str) -> Any:
        module = load_library(f"foxglove_schemas_protobuf.{name}_pb2", "mcap")
        return getattr(module, name)

    def _build_time(self, stamp: Stamp) -> dict[str, int]:
        seconds, nanos = divmod(stamp.time_ns, 1_000_000_000)
        return {"seconds": seconds, "nanos": nanos}

    def _write(self, topic: str, stamp: Stamp, name: str, **values: Any) -> None:
        message = self._load(name)(
            timestamp=self._build_time(stamp), frame_id=stamp.frame, **values
        )
        self._add(topic, stamp, message)

    def _add(self, topic: str, stamp: Stamp, message: Any) -> None:
        kind = type(message)
        if topic not in self._channels:
            name = kind.DESCRIPTOR.full_name
            if name not in self._schemas:
                self._schemas[name] = self._register_schema(self._writer, kind)
            self._channels[topic] = self._writer.register_channel(
                topic, "protobuf", self._schemas[name]
            )
        self._add_message(topic, stamp, message.SerializeToString(deterministic=True))

    def _write_json(
        self,
        topic: str,
        stamp: Stamp,
        name: str,
        properties: Mapping[str, Any],
        values: Mapping[str, Any],
    ) -> None:
        if topic not in self._channels:
            schema = {"type": "object", "title": name, "properties": properties}
            if name not in self._schemas:
                raw = json.dumps(schema).encode()
                self._schemas[name] = self._writer.register_schema(name, "jsonschema", raw)
            self._channels[topic] = self._writer.register_channel(
                topic, "json", self._schemas[name]
            )
        self._add_message(topic, stamp, json.dumps(values).encode())

    def _add_message(self, topic: str, stamp: Stamp, data: bytes) -> None:
        self._writer.add_message(self._channels[topic], stamp.time_ns, data, stamp.time_ns)
