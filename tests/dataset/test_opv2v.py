"""A small dataset, read back by the rules of OpenCOOD, HEAL and CoBEVT as they are published."""

import json
import math
import struct
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from advercity_dsl import Spec
from numpy.typing import NDArray

from advercity.dataset.formats import format_opv2v_folder
from advercity.dataset.frame_documents import build_frame_description
from advercity.dataset.writer import ScenarioWriter
from advercity.semantics import PALETTE, Semantic
from advercity.sensors.annotation import annotate_actors
from tests.builders import SensorFramesOf, identify

FRAMES = 3
FOLDERS = ["+101", "-1", "-2", "102", "103"]
MAPS = ("dynamic", "static", "lane", "visibility", "visibility_corp")
Array = NDArray[np.floating]


@pytest.fixture(scope="module")
def scenario(
    tmp_path_factory: pytest.TempPathFactory, spec: Spec, sensor_frames_of: SensorFramesOf
) -> Path:
    root = tmp_path_factory.mktemp("dataset")
    identity = identify(spec, profile="preview")
    with ScenarioWriter(root, spec, identity, length=FRAMES) as writer:
        for index in range(FRAMES):
            writer.write_frame(index, sensor_frames_of(index))
        writer.finish()
    return root / spec.id


def agents_of(scenario: Path) -> list[Path]:
    """Folders in the loaders' order: as text, then the first moved behind if it is negative."""
    folders = sorted((path for path in scenario.iterdir() if path.is_dir()), key=lambda p: p.name)
    if int(folders[0].name) < 0:
        folders.append(folders.pop(0))
    return folders


def frames_of(agent: Path) -> list[str]:
    names = sorted(path.name for path in agent.iterdir())
    return [name[:-5] for name in names if name.endswith(".yaml") and "additional" not in name]


def load(path: Path) -> dict[str, Any]:
    return yaml.safe_load(path.read_text())


def world_from(pose: list[float]) -> Array:
    """Pose matrix of the left-handed world: T, then yaw, pitch, roll."""
    x, y, z, roll, yaw, pitch = pose
    cr, sr = math.cos(math.radians(roll)), math.sin(math.radians(roll))
    cy, sy = math.cos(math.radians(yaw)), math.sin(math.radians(yaw))
    cp, sp = math.cos(math.radians(pitch)), math.sin(math.radians(pitch))
    turn_yaw = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    turn_pitch = np.array([[cp, 0, -sp], [0, 1, 0], [sp, 0, cp]])
    turn_roll = np.array([[1, 0, 0], [0, cr, sr], [0, -sr, cr]])
    matrix = np.eye(4)
    matrix[:3, :3] = turn_yaw @ turn_pitch @ turn_roll
    matrix[:3, 3] = (x, y, z)
    return matrix


def move(matrix: Array, points: Array) -> Array:
    return points @ matrix[:3, :3].T + matrix[:3, 3]


@dataclass(frozen=True)
class Cloud:
    xyz: Array
    red: Array
    intensity: Array
    object_id: NDArray[np.int64]
    tag: NDArray[np.int64]


def read_cloud(path: Path) -> Cloud:
    """Point by point from what the header says."""
    header, _, body = path.read_bytes().partition(b"DATA binary\n")
    lines = [line.split() for line in header.decode().splitlines() if not line.startswith("#")]
    entries = {key: values for key, *values in lines}
    letters = {"F4": "f", "U4": "I", "I4": "i", "U2": "H", "U1": "B"}
    kinds = zip(entries["TYPE"], entries["SIZE"], strict=True)
    record = struct.Struct("<" + "".join(letters[kind + size] for kind, size in kinds))
    rows = list(record.iter_unpack(body))
    assert len(rows) == int(entries["POINTS"][0]) == int(entries["WIDTH"][0])
    columns = dict(zip(entries["FIELDS"], np.array(rows).T, strict=True))
    assert entries["FIELDS"][:4] == ["x", "y", "z", "rgb"]
    assert entries["TYPE"][:3] == ["F"] * 3
    return Cloud(
        xyz=np.stack([columns["x"], columns["y"], columns["z"]], axis=1),
        red=(columns["rgb"].astype(np.int64) >> 16 & 255) / 255,
        intensity=columns["intensity"],
        object_id=columns["object_id"].astype(np.int64),
        tag=columns["tag"].astype(np.int64),
    )


def share_inside(thing: dict[str, Any], points: Array) -> Array:
    """Points (n, 3) of the world in half sizes from the middle of an object's box."""
    centre = [a + b for a, b in zip(thing["location"], thing["center"], strict=True)]
    box = world_from([*centre, *thing["angle"]])
    return move(np.linalg.inv(box), points) / thing["extent"]


def objects_of(description: dict[str, Any]) -> dict[int, dict[str, Any]]:
    return description["vehicles"] | description["walkers"]


EVERY_AGENT = pytest.mark.parametrize("agent", FOLDERS)


def test_the_ego_comes_first_and_both_roadside_units_stay_negative(scenario: Path) -> None:
    assert [path.name for path in agents_of(scenario)] == FOLDERS
    assert [int(name) for name in FOLDERS] == [101, -1, -2, 102, 103]


def test_only_the_ego_is_written_with_a_plus(spec: Spec) -> None:
    assert sorted(format_opv2v_folder(agent) for agent in spec.agents) == FOLDERS


def test_the_scenario_has_no_other_folder(scenario: Path) -> None:
    assert [path.name for path in scenario.parent.iterdir()] == [scenario.name]


@EVERY_AGENT
def test_frames_are_numbered_as_in_the_original(scenario: Path, agent: str) -> None:
    assert frames_of(scenario / agent) == ["000060", "000061", "000062"]


@EVERY_AGENT
def test_each_frame_has_all_its_files(scenario: Path, agent: str) -> None:
    images = [
        f"_{kind}{k}.png" for kind in ("camera", "semantic", "depth", "depth_cm") for k in range(4)
    ]
    images += [f"_bev_{kind}.png" for kind in MAPS]
    motion = [] if agent.startswith("-") else ["_additional_gnss_imu.yaml"]
    expected = {f"000061{end}" for end in [".yaml", ".pcd", "_objects.json", *images, *motion]}
    assert {path.name for path in (scenario / agent).glob("000061*")} == expected


@EVERY_AGENT
def test_every_field_exists_and_is_plain(scenario: Path, agent: str) -> None:
    description = load(scenario / agent / "000060.yaml")
    assert set(description) == {
        *("RSU", "ego_speed", "true_ego_pos", "predicted_ego_pos", "lidar_pose"),
        *("camera0", "camera1", "camera2", "camera3"),
        *("plan_trajectory", "vehicles", "walkers"),
    }
    for key in ("true_ego_pos", "predicted_ego_pos", "lidar_pose"):
        assert len(description[key]) == 6
        assert all(isinstance(value, float) and math.isfinite(value) for value in description[key])
    assert all(type(number) is int for number in objects_of(description))
    assert description["RSU"] is agent.startswith("-")


def test_object_fields_have_the_units_of_the_format(scenario: Path) -> None:
    van = load(scenario / "+101" / "000060.yaml")["vehicles"][201]
    assert van["class"] == "van"
    assert van["bp_id"] == "sprinter"
    assert van["extent"] == [2.95, 1.0, 1.275]
    assert van["speed"] == 18.0
    assert van["dist"] == pytest.approx(13.0)
    # Bearings are horizontal, and the street climbs by 4 degrees.
    ahead = 12 * math.cos(math.radians(4))
    assert van["bearing"] == pytest.approx(math.degrees(math.atan2(-5, ahead)))
    # The scan has 40 points of the van, 5 of which are ghosts.
    assert (van["lidar_hits"], van["lidar_points"], van["parked"]) == (40, 35, False)
    extras = json.loads((scenario / "+101" / "000060_objects.json").read_text())["objects"]["201"]
    assert (extras["lidar_points"], extras["lidar_ghosts"]) == (35, 5)
    assert extras["lamps"] == ["low_beam"]
    shown = [camera["visible_fraction"] for camera in extras["cameras"].values()]
    assert van["visible_fraction"] == max(shown) > 0.5
    assert all(0 <= int(part) <= 255 for part in van["color"].split(", "))


def test_a_walker_is_described_like_a_vehicle(scenario: Path) -> None:
    description = load(scenario / "+101" / "000060.yaml")
    walker = description["walkers"][203]
    assert {*walker, "parked"} == {*description["vehicles"][201], "umbrella"}
    assert walker["class"] == "walker"


def test_walkers_are_an_empty_map_where_there_are_none(sensor_frames_of: SensorFramesOf) -> None:
    first = sensor_frames_of(0)[0]
    reading = first.with_readings(lidar=(replace(first.lidar_scans[0], hits={}),))
    description = build_frame_description(reading, annotate_actors(reading))
    assert (description["vehicles"], description["walkers"]) == ({}, {})


@EVERY_AGENT
def test_speed_is_in_km_h_and_agrees_with_the_path(scenario: Path, agent: str) -> None:
    first, second = (load(scenario / agent / f"{name}.yaml") for name in ("000060", "000061"))
    way_m = math.dist(first["true_ego_pos"][:3], second["true_ego_pos"][:3])
    assert way_m == pytest.approx(first["ego_speed"] / 3.6 * 0.1, abs=1e-6)


def test_the_plan_is_mirrored_and_in_km_h(scenario: Path) -> None:
    vehicle, unit = (load(scenario / name / "000060.yaml") for name in ("+101", "-1"))
    assert vehicle["plan_trajectory"] == [[1.0, -2.0, 36.0], [3.0, -4.0, 18.0]]
    assert unit["plan_trajectory"] == []


def test_a_roadside_unit_has_its_orientation(scenario: Path) -> None:
    unit = load(scenario / "-1" / "000060.yaml")
    assert unit["true_ego_pos"] == unit["camera0"]["cords"]
    assert unit["lidar_pose"][3:] == [0.0, 0.0, 0.0]
    drift = np.subtract(unit["predicted_ego_pos"], unit["true_ego_pos"])
    np.testing.assert_allclose(drift, [0.3, 0.2, 0.05, 0, 0, 0], atol=1e-8)


@EVERY_AGENT
def test_extrinsics_map_the_lidar_to_the_camera(scenario: Path, agent: str) -> None:
    description = load(scenario / agent / "000060.yaml")
    world_from_lidar = world_from(description["lidar_pose"])
    for index in range(4):
        camera = description[f"camera{index}"]
        expected = np.linalg.inv(world_from(camera["cords"])) @ world_from_lidar
        np.testing.assert_allclose(camera["extrinsic"], expected, atol=1e-7)


def test_the_front_camera_sits_where_the_original_has_it(scenario: Path) -> None:
    extrinsic = load(scenario / "+101" / "000060.yaml")["camera0"]["extrinsic"]
    expected = [[1, 0, 0, -0.95], [0, 1, 0, 0], [0, 0, 1, 0.45], [0, 0, 0, 1]]
    np.testing.assert_allclose(extrinsic, expected, atol=1e-9)


def test_the_right_camera_looks_right(scenario: Path) -> None:
    extrinsic = np.array(load(scenario / "+101" / "000060.yaml")["camera1"]["extrinsic"])
    right_of_lidar = extrinsic[:3, :3] @ (0.0, 1.0, 0.0)
    assert right_of_lidar[0] == pytest.approx(math.cos(math.radians(10)))


@EVERY_AGENT
def test_points_are_in_the_box_of_the_object_they_hit(scenario: Path, agent: str) -> None:
    description = load(scenario / agent / "000061.yaml")
    cloud = read_cloud(scenario / agent / "000061.pcd")
    points = move(world_from(description["lidar_pose"]), cloud.xyz)
    for number, thing in objects_of(description).items():
        share = share_inside(thing, points[cloud.object_id == number])
        assert len(share) == 40
        assert np.abs(share).max() <= 1 + 1e-3
        assert np.abs(share).max(axis=0).min() > 0.6


def test_every_agent_puts_the_same_box_in_the_same_place(scenario: Path) -> None:
    descriptions = [load(path / "000062.yaml") for path in agents_of(scenario)]
    boxes = [objects_of(description)[201] for description in descriptions]
    for key in ("location", "center", "angle", "extent"):
        assert all(box[key] == boxes[0][key] for box in boxes)


def test_the_ground_is_at_the_same_height_for_all_agents(scenario: Path) -> None:
    heights: list[Array] = []
    for path in agents_of(scenario):
        cloud = read_cloud(path / "000060.pcd")
        ground = cloud.xyz[cloud.tag == Semantic.ROAD]
        heights.append(move(world_from(load(path / "000060.yaml")["lidar_pose"]), ground))
    for place in heights[1:]:
        np.testing.assert_allclose(place, heights[0], atol=1e-4)


@EVERY_AGENT
def test_intensity_is_in_the_red_channel(
    scenario: Path, agent: str, sensor_frames_of: SensorFramesOf
) -> None:
    (reading,) = (one for one in sensor_frames_of(1) if format_opv2v_folder(one.agent) == agent)
    cloud = read_cloud(scenario / agent / "000061.pcd")
    np.testing.assert_array_equal(cloud.intensity, reading.point_cloud.intensity)
    assert np.abs(cloud.red - reading.point_cloud.intensity).max() <= 0.5 / 255 + 1e-7


@EVERY_AGENT
def test_object_points_land_on_object_pixels_in_every_camera(scenario: Path, agent: str) -> None:
    """Or on the pixel beside, as outlines are drawn to whole pixels."""
    description = load(scenario / agent / "000060.yaml")
    cloud = read_cloud(scenario / agent / "000060.pcd")
    seen = 0
    for index in range(4):
        camera = description[f"camera{index}"]
        image = cv2.imread(str(scenario / agent / f"000060_semantic{index}.png"))
        assert image is not None
        sky = (image[..., ::-1] == PALETTE[Semantic.SKY]).all(axis=-1)
        is_sky = cv2.erode(sky.astype(np.uint8), np.ones((3, 3))) > 0
        whole = np.isin(cloud.object_id, list(wholly_ahead(description, camera)))
        x, y, z = move(np.array(camera["extrinsic"]), cloud.xyz[whole]).T
        pixels = np.array(camera["intrinsic"]) @ np.stack([y, -z, x]) / x
        column, row = np.rint(pixels[:2]).astype(int)
        height, width = is_sky.shape
        inside = (column > 0) & (column < width - 1) & (row > 0) & (row < height - 1)
        assert not is_sky[row[inside], column[inside]].any()
        seen += int(inside.sum())
    assert seen > 20


def wholly_ahead(description: dict[str, Any], camera: dict[str, Any]) -> list[int]:
    """Objects with every corner in front of the camera, which the images show."""
    unit = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    camera_from_world = np.linalg.inv(world_from(camera["cords"]))
    ahead: list[int] = []
    for number, thing in objects_of(description).items():
        centre = np.add(thing["location"], thing["center"])
        box = world_from([*centre, *thing["angle"]])
        corners = move(camera_from_world @ box, unit * thing["extent"])
        if corners[:, 0].min() >= 0.1:
            ahead.append(number)
    return ahead


def test_images_are_eight_bit_rgb_without_alpha(
    scenario: Path, sensor_frames_of: SensorFramesOf
) -> None:
    stored = cv2.imread(str(scenario / "+101" / "000060_camera2.png"), cv2.IMREAD_UNCHANGED)
    assert stored is not None
    np.testing.assert_array_equal(stored[..., ::-1], sensor_frames_of(0)[0].camera_images[2].image)


def test_semantic_images_have_palette_colours_only(
    scenario: Path, sensor_frames_of: SensorFramesOf
) -> None:
    stored = cv2.imread(str(scenario / "-1" / "000060_semantic0.png"), cv2.IMREAD_UNCHANGED)
    assert stored is not None
    (unit,) = (one for one in sensor_frames_of(0) if one.agent.number == -1)
    np.testing.assert_array_equal(stored[..., ::-1], PALETTE[unit.camera_images[0].semantic])


def test_motion_is_in_the_left_handed_body_frame(scenario: Path) -> None:
    motion = load(scenario / "+101" / "000061_additional_gnss_imu.yaml")
    assert motion["gnss"] == {"lat": 49.000001, "lon": 8.0, "alt": 120.5, "timestamp": 6.1}
    assert motion["imu"]["accelerometer"] == {"x": 0.5, "y": -0.25, "z": 9.81}
    assert motion["imu"]["gyroscope"] == {"x": -0.01, "y": 0.02, "z": -0.03}
    assert motion["imu"]["compass"] == 1.25


def test_the_protocol_is_the_spec(scenario: Path, spec: Spec) -> None:
    assert Spec.model_validate(load(scenario / "data_protocol.yaml")) == spec


def test_annotations_fit_in_the_arrays_of_the_loaders(scenario: Path) -> None:
    for path in agents_of(scenario):
        for name in frames_of(path):
            assert len(load(path / f"{name}.yaml")["vehicles"]) < 100
