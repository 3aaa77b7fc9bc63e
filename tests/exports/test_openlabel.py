"""OpenLABEL: boxes and frames by hand, and what VCD loads by the schema of the standard."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from advercity_dsl import Spec, Weather
from advercity_exports.openlabel import list_weather_tags

from advercity.dataset.reader import FrameView, open_dataset
from advercity.exports.exporting import export_dataset
from advercity.physics.extinction import compute_extinction
from advercity.pipeline import RunOptions, run_scenario
from tests.exports.readers import needs_readers, run_reader
from tests.exports.recorded_dataset import FIRST_FRAME, FRAMES
from tests.exports.recorded_dataset import recorded_dataset as recorded_dataset  # a fixture

NAME = "hill_fog_day_sparse"


@pytest.fixture(scope="module")
def exported(recorded_dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    output = tmp_path_factory.mktemp("openlabel") / "out"
    return export_dataset("openlabel", recorded_dataset, output).output / f"{NAME}.json"


@pytest.fixture(scope="module")
def label(exported: Path) -> dict[str, Any]:
    return json.loads(exported.read_text())["openlabel"]


@pytest.fixture(scope="module")
def frame(recorded_dataset: Path) -> FrameView:
    return open_dataset(recorded_dataset)[0]


def test_a_box_is_where_it_is_by_hand(label: dict[str, Any]) -> None:
    """At 1 s the other car is at x = 152, heads west and down a hill of 3 %."""
    data = label["frames"][str(FIRST_FRAME)]["objects"]["1001"]["object_data"]
    (cuboid,) = data["cuboid"]
    x, y, z, qx, qy, qz, qw, length, width, height = cuboid["val"]
    assert cuboid["coordinate_system"] == "world"
    assert (x, y) == pytest.approx((152, 1.75), abs=0.03)
    assert z == pytest.approx(0.03 * 152 + height / 2, abs=0.03)
    assert length > width > height
    ahead = [1 - 2 * (qy * qy + qz * qz), 2 * (qx * qy + qw * qz), 2 * (qx * qz - qw * qy)]
    assert ahead == pytest.approx([-math.cos(0.03), 0, -math.sin(0.03)], abs=1e-3)
    numbers = {item["name"]: item["val"] for item in data["num"]}
    assert numbers["speed_m_s"] == pytest.approx(8.0, abs=0.02)
    assert {"cav1/lidar_points", "cav2/lidar_points"} <= numbers.keys()


def test_intervals_end_where_a_frame_is_missing(
    recorded_dataset: Path, tmp_path: Path, label: dict[str, Any]
) -> None:
    """Of the frames 10 to 12, the middle one is not made."""
    assert label["frame_intervals"] == [{"frame_start": 10, "frame_end": 12}]
    spec = open_dataset(recorded_dataset).scenarios[0].spec
    for first in (FIRST_FRAME, FIRST_FRAME + 2):
        frames = slice(first, first + 1)
        options = RunOptions(
            output=tmp_path / "data", backend="fake", profile="preview", scale=0.05, frames=frames
        )
        run_scenario(spec, options)

    output = export_dataset("openlabel", tmp_path / "data", tmp_path / "out").output
    gapped = json.loads((output / f"{NAME}.json").read_text())["openlabel"]

    ends = [{"frame_start": 10, "frame_end": 10}, {"frame_start": 12, "frame_end": 12}]
    assert gapped["frame_intervals"] == gapped["objects"]["1001"]["frame_intervals"] == ends


def test_a_timestamp_is_seconds_as_text(label: dict[str, Any], frame: FrameView) -> None:
    properties = label["frames"][str(FIRST_FRAME)]["frame_properties"]
    assert properties["timestamp"] == f"{frame.time_s:.6f}"


def test_a_point_goes_from_the_world_into_a_picture_by_the_coordinate_systems(
    label: dict[str, Any], frame: FrameView
) -> None:
    """Through agent and camera, and the camera's matrix, a box is where the dataset shows it."""
    view = frame["cav1"]
    properties = label["frames"][str(FIRST_FRAME)]["frame_properties"]
    transform = properties["transforms"]["cav1_to_world"]
    assert (transform["src"], transform["dst"]) == ("cav1", "world")
    world_from_agent = np.reshape(transform["transform_src_to_dst"]["matrix4x4"], (4, 4))
    system = label["coordinate_systems"]["cav1/camera0"]
    assert system["parent"] == "cav1"
    agent_from_camera = np.reshape(system["pose_wrt_parent"]["matrix4x4"], (4, 4))
    intrinsics = label["streams"]["cav1/camera0"]["stream_properties"]["intrinsics_pinhole"]
    matrix = np.reshape(intrinsics["camera_matrix"], (3, 4))
    (cuboid,) = label["frames"][str(FIRST_FRAME)]["objects"]["1001"]["object_data"]["cuboid"]
    point = np.array([*cuboid["val"][:3], 1.0])

    column, row, depth = matrix @ np.linalg.inv(world_from_agent @ agent_from_camera) @ point

    expected = view.pixels(0, point[None, :3])[0]
    assert [column / depth, row / depth, depth] == pytest.approx(expected.tolist(), abs=1e-4)
    # From 60.5 to 152, less the half length and the camera's place in front of the middle.
    assert depth == pytest.approx(152 - 60.5 - 0.45, abs=0.1)
    height, width = view.image(0).shape[:2]
    assert (intrinsics["width_px"], intrinsics["height_px"]) == (width, height)


def test_an_outline_is_given_by_its_middle_and_size(
    label: dict[str, Any], frame: FrameView
) -> None:
    facts = frame["cav1"].extras["objects"]["1001"]["cameras"]["camera0"]
    left, top, right, bottom = facts["outline_box"]
    data = label["frames"][str(FIRST_FRAME)]["objects"]["1001"]["object_data"]
    (outline,) = [item for item in data["bbox"] if item["name"] == "cav1/camera0"]
    middle = [(left + right) / 2, (top + bottom) / 2, right - left, bottom - top]
    assert outline["val"] == pytest.approx(middle)
    found = {item["name"]: item["val"] for item in outline["attributes"]["num"]}
    assert found == {key: facts[key] for key in ("visible_fraction", "occlusion", "truncation")}


def test_files_of_sensors_are_found_from_the_folder_of_the_dataset(
    label: dict[str, Any], recorded_dataset: Path
) -> None:
    for index in range(FIRST_FRAME, FIRST_FRAME + FRAMES):
        streams = label["frames"][str(index)]["frame_properties"]["streams"]
        assert {*streams} == {*label["streams"]}
        for stream in streams.values():
            assert (recorded_dataset / stream["uri"]).is_file()


def test_weather_has_tags_in_the_units_of_the_ontology(
    label: dict[str, Any], specs: dict[str, Spec]
) -> None:
    def read(tags: Any) -> dict[str, float | None]:
        return {
            tag["type"]: tag["tag_data"]["num"][0]["val"] if "tag_data" in tag else None
            for tag in tags
        }

    found = read(label["tags"].values())
    assert found["ParticulatesWater"] == 75
    assert "WeatherRain" not in found
    assert found["HorizontalStraights"] is None
    rain = specs["ui_heavy_rain_night_sparse"].weather
    night = read(list_weather_tags(rain))
    assert night["WeatherRain"] == rain.rain.rate_mm_h > 0
    assert night["WeatherWind"] == rain.wind.speed_m_s
    assert night["LowLightNight"] is night["SurfaceConditionWet"] is None
    assert "DaySunElevation" not in night
    # The ontology has visibility in snow in km and in fog in m, wind in m/s and clouds in oktas.
    weather = {"id": "w", "time": "day", "sun": {"elevation_deg": 12}, "wind": {"speed_m_s": 7}}
    snow = Weather.model_validate(
        {**weather, "temperature_c": -2, "snow": {"rate_mm_h": 2}, "fog": {"mor_m": 400}}
    )
    tags = read(list_weather_tags(snow))
    assert tags["WeatherSnow"] == pytest.approx(compute_extinction(snow).mor_m / 1000, abs=5e-5)
    assert (tags["ParticulatesWater"], tags["WeatherWind"]) == (400, 7)
    assert tags["DaySunElevation"] == 12


@needs_readers
def test_a_reader_that_knows_the_schema_loads_it(exported: Path, frame: FrameView) -> None:
    found = run_reader("read_openlabel.py", exported, str(FIRST_FRAME))
    assert found["version"] == "1.0.0"
    assert float(found["timestamp"]) == pytest.approx(frame.time_s)
    assert found["frames"] == [[FIRST_FRAME, FIRST_FRAME + FRAMES - 1]]
    assert found["objects"] == ["1001", "101", "102", "5001"]
    assert found["cars"] == ["1001", "101"]
    assert found["streams"]["cav2/lidar0"] == "lidar"
    assert {"world", "cav1", "cav2", "cav1/camera3"} <= {*found["systems"]}
    for view in frame.views.values():
        boxes = view.load_steady_boxes()
        for row, number in enumerate(boxes.ids.tolist()):
            val = found["boxes"][str(number)]
            assert val[:3] == pytest.approx(boxes.world_from_box[row, :3, 3].tolist())
            assert val[7:] == pytest.approx(boxes.sizes[row].tolist())
