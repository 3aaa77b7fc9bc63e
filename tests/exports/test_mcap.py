"""MCAP recordings: places by hand, and what readers of others make of both sets of schemas."""

import json
import math
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from advercity_dsl import Gnss
from advercity_exports.mcap_values import PositionCovariance
from advercity_exports.ros2_messages import DEFINITIONS, format_definition

from advercity.dataset.reader import FrameView, open_dataset
from advercity.errors import InputError
from advercity.exports.exporting import export_dataset
from advercity.sensors.measurements import GnssFix, GnssSolution, SolutionQuality
from tests.exports.readers import needs_readers, run_reader
from tests.exports.recorded_dataset import FIRST_FRAME, FRAMES
from tests.exports.recorded_dataset import recorded_dataset as recorded_dataset  # a fixture

NAME = "hill_fog_day_sparse.mcap"


@pytest.fixture(scope="module")
def frames(recorded_dataset: Path) -> list[FrameView]:
    return list(open_dataset(recorded_dataset))


@pytest.fixture(scope="module")
def foxglove(
    recorded_dataset: Path, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, list[Any]]:
    """The messages of a recording in Foxglove's schemas, by topic."""
    pytest.importorskip("foxglove_schemas_protobuf")
    reader = pytest.importorskip("mcap.reader")
    decoder = pytest.importorskip("mcap_protobuf.decoder")
    output = tmp_path_factory.mktemp("mcap") / "foxglove"
    path = export_dataset("mcap", recorded_dataset, output).output / NAME
    found: dict[str, list[Any]] = {}
    with path.open("rb") as stream:
        opened = reader.make_reader(stream, validate_crcs=True)
        assert {one.compression for one in opened.get_summary().chunk_indexes} == {"zstd"}
        for schema, channel, message in opened.iter_messages():
            decoded = json.loads(message.data) if schema.encoding == "jsonschema" else None
            if decoded is not None:
                jsonschema.validate(decoded, json.loads(schema.data))
            found.setdefault(channel.topic, []).append((schema.name, message.log_time, decoded))
    with path.open("rb") as stream:
        opened = reader.make_reader(stream, decoder_factories=[decoder.DecoderFactory()])
        topics = [name for name, messages in found.items() if messages[0][2] is None]
        seen = dict.fromkeys(topics, 0)
        for _, channel, message, decoded in opened.iter_decoded_messages(topics=topics):
            name, time_ns, _ = found[channel.topic][seen[channel.topic]]
            assert time_ns == message.log_time
            found[channel.topic][seen[channel.topic]] = (name, time_ns, decoded)
            seen[channel.topic] += 1
    return found


def test_every_sensor_has_a_topic_with_a_message_for_every_frame(
    foxglove: dict[str, list[Any]], frames: list[FrameView]
) -> None:
    expected = {"/tf": "foxglove.FrameTransforms", "/weather": "advercity.Weather"}
    for name, view in frames[0].views.items():
        expected |= {f"/{name}/objects": "foxglove.SceneUpdate"}
        expected |= {f"/{name}/gnss": "foxglove.LocationFix", f"/{name}/imu": "advercity.Imu"}
        for number in range(view.cameras):
            expected[f"/{name}/camera{number}/image"] = "foxglove.CompressedImage"
            expected[f"/{name}/camera{number}/calibration"] = "foxglove.CameraCalibration"
        for number in range(view.lidars):
            expected[f"/{name}/lidar{number}/points"] = "foxglove.PointCloud"
    assert {topic: messages[0][0] for topic, messages in foxglove.items()} == expected
    assert {len(messages) for messages in foxglove.values()} == {FRAMES}
    times = [time_ns for _, time_ns, _ in foxglove["/tf"]]
    assert times == [round(frame.time_s * 1e9) for frame in frames]


def test_the_other_car_is_where_it_is_by_hand(foxglove: dict[str, list[Any]]) -> None:
    """A second into the recording, it is at x = 152 and drives to the west, down a hill of 3 %."""
    _, _, scene = foxglove["/cav1/objects"][0]
    (car,) = [entity for entity in scene.entities if entity.id == "1001"]
    (cube,) = car.cubes
    assert car.frame_id == "world"
    assert (cube.pose.position.x, cube.pose.position.y) == pytest.approx((152, 1.75), abs=0.03)
    turn = cube.pose.orientation
    ahead_x = 1 - 2 * (turn.y**2 + turn.z**2)
    ahead_z = 2 * (turn.x * turn.z - turn.w * turn.y)
    assert (ahead_x, ahead_z) == pytest.approx((-math.cos(0.03), -math.sin(0.03)), abs=1e-3)
    facts = {item.key: item.value for item in car.metadata}
    assert facts["class"] == "car"
    assert float(facts["speed_m_s"]) == pytest.approx(8.0, abs=0.02)


def test_a_camera_looks_along_its_z_axis(foxglove: dict[str, list[Any]]) -> None:
    _, _, message = foxglove["/tf"][0]
    (front,) = [one for one in message.transforms if one.child_frame_id == "cav1/camera0"]
    w, x, y, z = (getattr(front.rotation, axis) for axis in "wxyz")
    # Columns of the rotation: what x (right), y (down) and z (along the view) are in the world.
    right = [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)]
    down = [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)]
    view = [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)]
    # The ego drives to the east, so that south is on its right.
    assert view == pytest.approx([1, 0, 0.03], abs=2e-3)
    assert right == pytest.approx([0, -1, 0], abs=2e-3)
    assert down == pytest.approx([0.03, 0, -1], abs=2e-3)


def test_a_decoded_cloud_is_that_of_the_dataset(
    foxglove: dict[str, list[Any]], frames: list[FrameView]
) -> None:
    for frame, (_, _, cloud) in zip(frames, foxglove["/cav1/lidar0/points"], strict=True):
        table = frame["cav1"].cloud
        types = {7: "<f4", 5: "<u4", 6: "<i4", 3: "<u2", 1: "u1"}
        dtype = np.dtype(
            {
                "names": [field.name for field in cloud.fields],
                "formats": [types[field.type] for field in cloud.fields],
                "offsets": [field.offset for field in cloud.fields],
                "itemsize": cloud.point_stride,
            }
        )
        decoded = np.frombuffer(cloud.data, dtype)
        assert len(decoded) == len(table) > 0
        for name in table.dtype.names or ():
            np.testing.assert_array_equal(decoded[name], table[name])
        assert cloud.frame_id == "cav1/lidar0"


def test_images_weather_and_motion_are_those_of_the_dataset(
    foxglove: dict[str, list[Any]], frames: list[FrameView]
) -> None:
    view = frames[0]["cav1"]
    _, _, image = foxglove["/cav1/camera0/image"][0]
    assert image.data == view.path("_camera0.png").read_bytes()
    _, _, calibration = foxglove["/cav1/camera0/calibration"][0]
    assert list(calibration.K) == pytest.approx(view.intrinsic(0).ravel().tolist())
    assert (calibration.height, calibration.width) == view.image(0).shape[:2]
    gnss, imu = view.motion
    assert gnss is not None and imu is not None
    _, _, fix = foxglove["/cav1/gnss"][0]
    assert (fix.latitude, fix.longitude) == (gnss.latitude_deg, gnss.longitude_deg)
    assert len(fix.position_covariance) == 9
    assert fix.position_covariance_type == 2
    _, _, measured = foxglove["/cav1/imu"][0]
    force = [measured["specific_force"][axis] for axis in "xyz"]
    assert force == pytest.approx(imu.specific_force.tolist())
    _, _, weather = foxglove["/weather"][0]
    assert weather["id"] == "fog_day"
    assert weather["mor_m"] == pytest.approx(75, rel=0.02)


def test_a_pinhole_is_plumb_bob_with_five_zeros(foxglove: dict[str, list[Any]]) -> None:
    _, _, calibration = foxglove["/cav1/camera0/calibration"][0]
    assert calibration.distortion_model == "plumb_bob"
    assert list(calibration.D) == [0.0] * 5


def fix_at(latitude_deg: float, quality: SolutionQuality | None = None) -> GnssFix:
    return GnssFix(latitude_deg, 8.0, 100.0, 0.0, quality=quality)


def quality_of(solution: GnssSolution) -> SolutionQuality:
    return SolutionQuality(solution, satellites=8, visible=9, pdop=2.5, hdop=1.5, vdop=2.0)


@pytest.mark.parametrize(
    ("noise", "fix", "deviations_m", "kind"),
    [
        # A degree of latitude is 111.3 km, at 60 degrees one of longitude half of it.
        (
            {"latitude_noise_deg": 1e-5, "longitude_noise_deg": 1e-5, "altitude_noise_m": 3},
            *(fix_at(60.0), (0.5566, 1.1132, 3.0), 2),
        ),
        (
            {"mode": "realistic", "white_noise_m": 0.3, "wander_m": 0.4, "vertical_factor": 2},
            *(fix_at(0.0), (0.5, 0.5, 1.0), 2),
        ),
        # 0.6 and 0.8 m are 1 m of range; half of the square of HDOP is in each direction.
        (
            {"mode": "satellites", "receiver": {"signal_error_m": 0.6, "atmosphere_m": 0.8}},
            *(fix_at(0.0, quality_of(GnssSolution.SINGLE)), (1.06066, 1.06066, 2.0), 1),
        ),
        ({"mode": "satellites"}, fix_at(0.0, quality_of(GnssSolution.FIXED)), (0, 0, 0), 0),
    ],
)
def test_the_covariance_of_a_fix_is_that_of_the_noise(
    noise: dict[str, Any], fix: GnssFix, deviations_m: tuple[float, ...], kind: int
) -> None:
    found = PositionCovariance.of_fix(Gnss.model_validate(noise), fix)
    assert np.sqrt(np.diag(np.reshape(found.matrix, (3, 3)))) == pytest.approx(
        deviations_m, rel=1e-3
    )
    assert found.kind == kind


@needs_readers
def test_a_reader_of_ros_2_finds_the_same(
    recorded_dataset: Path, frames: list[FrameView], tmp_path: Path
) -> None:
    pytest.importorskip("mcap_ros2")
    options = {"schemas": "ros2"}
    output = export_dataset("mcap", recorded_dataset, tmp_path / "out", options=options).output
    found = run_reader("read_rosbag.py", output / NAME)

    types = {topic: kind for topic, (kind, _) in found["topics"].items()}
    assert {count for _, count in found["topics"].values()} == {FRAMES}
    assert types["/tf"] == "tf2_msgs/msg/TFMessage"
    assert types["/cav1/objects"] == "vision_msgs/msg/Detection3DArray"
    assert types["/cav1/camera0/image"] == "sensor_msgs/msg/CompressedImage"
    assert types["/cav1/camera0/calibration"] == "sensor_msgs/msg/CameraInfo"
    assert types["/cav1/gnss"] == "sensor_msgs/msg/NavSatFix"
    assert types["/cav1/imu"] == "sensor_msgs/msg/Imu"
    assert found["calibrations"]["/cav1/camera0/calibration"] == ["plumb_bob", [0.0] * 5]
    assert found["fixes"]["/cav1/gnss"][0] == 2
    for frame in frames:
        time = str(round(frame.time_s * 1e9))
        points, view = frame["cav1"].points, frame["cav1"]
        count, total, place = found["clouds"]["/cav1/lidar0/points"][time]
        assert (count, place) == (len(points), "cav1/lidar0")
        assert total == pytest.approx(points.astype(float).sum(axis=0).tolist())
        numbers = found["transforms"]["cav1/lidar0"][time]
        assert numbers[:3] == pytest.approx(view.world_from_lidar[:3, 3].tolist())
        boxes = view.load_steady_boxes()
        for row, number in enumerate(boxes.ids.tolist()):
            kind, *place = found["objects"][str(number)][time]
            assert kind == boxes.classes[row]
            centre = boxes.world_from_box[row, :3, 3]
            assert place == pytest.approx([*centre, *boxes.sizes[row]])
    # At 1 s, as by hand.
    first = found["objects"]["1001"][str(round(frames[0].time_s * 1e9))]
    assert first[:3] == ["car", pytest.approx(152, abs=0.03), pytest.approx(1.75, abs=0.01)]
    assert frames[0].index == FIRST_FRAME


@pytest.mark.parametrize("name", DEFINITIONS)
def test_a_definition_has_all_that_it_is_made_of(name: str) -> None:
    parts = format_definition(name).split("=" * 80)
    known = {part.split()[1] for part in parts[1:]}
    for line in (line for part in parts for line in part.splitlines()):
        kind = line.split(" ")[0].split("[")[0]
        if "/" in kind:
            assert kind in known
    assert len(known) == len(parts) - 1  # each once


def test_schemas_that_do_not_exist_are_bad_input(recorded_dataset: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="`schemas` ros: foxglove or ros2"):
        export_dataset("mcap", recorded_dataset, tmp_path / "out", options={"schemas": "ros"})
