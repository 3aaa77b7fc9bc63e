"""nuScenes tables: frames by hand, and what nuScenes' own devkit makes of them."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from advercity_dsl import Mount, Spec
from advercity_exports.nuscenes_scene import list_channels
from numpy.testing import assert_allclose

from advercity.dataset.agent_view import AgentView
from advercity.dataset.reader import FrameView, open_dataset
from advercity.exports.exporting import export_dataset
from advercity.geometry import poses
from advercity.roads.road_network import build_road
from tests.exports.readers import needs_readers, run_reader


@pytest.fixture(scope="module")
def exported(two_roads: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return export_dataset("nuscenes", two_roads, tmp_path_factory.mktemp("nuscenes") / "out").output


@pytest.fixture(scope="module")
def read(exported: Path, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """What the devkit reads; once, since it takes seconds to load."""
    return run_reader("read_nuscenes.py", exported, tmp_path_factory.mktemp("devkit"))


def load_table(exported: Path, name: str) -> list[dict[str, Any]]:
    return json.loads((exported / "v1.0-trainval" / f"{name}.json").read_text())


def find_view(dataset: Path, sample: dict[str, Any]) -> tuple[FrameView, AgentView]:
    name, agent = sample["scene"].rsplit("-", 1)
    scenario = next(one for one in open_dataset(dataset).scenarios if one.path.name == name)
    frame = scenario[sample["frame"]]
    return frame, frame[agent]


def test_axes_are_those_of_nuscenes(exported: Path, two_roads: Path) -> None:
    """Of the ego: the LiDAR is 1.9 m up and 0.5 m behind the middle, the axle 0.3 lengths."""
    sensors = {row["token"]: row["channel"] for row in load_table(exported, "sensor")}
    rows = load_table(exported, "calibrated_sensor")
    ego = {sensors[row["sensor_token"]]: row for row in rows[:5]}
    assert set(ego) == {"CAM_FRONT", "CAM_RIGHT", "CAM_LEFT", "CAM_BACK", "LIDAR_TOP"}
    spec = open_dataset(two_roads).scenarios[0].spec
    assert spec.agents[0].blueprint is not None
    axle_m = 0.3 * spec.blueprints[spec.agents[0].blueprint].length_m
    assert_allclose(ego["LIDAR_TOP"]["translation"], [axle_m - 0.5, 0.0, 1.9], atol=1e-6)
    # A quarter turn to the right: what is ahead of the LiDAR, its y, is x of the ego.
    half = np.sqrt(0.5)
    assert_allclose(ego["LIDAR_TOP"]["rotation"], [half, 0.0, 0.0, -half], atol=1e-9)
    assert_allclose(ego["CAM_FRONT"]["translation"], [axle_m + 0.45, 0.0, 1.45], atol=1e-6)
    # As in nuScenes: x right is -y of the ego, y down -z, z ahead x.
    assert_allclose(np.abs(ego["CAM_FRONT"]["rotation"]), [0.5] * 4, atol=1e-9)
    w, x, y, z = ego["CAM_FRONT"]["rotation"]
    assert_allclose([x / w, y / w, z / w], [-1.0, 1.0, -1.0], atol=1e-9)


def test_scenes_of_a_scenario_are_linked(exported: Path) -> None:
    scenes = load_table(exported, "scene")
    assert len(scenes) == 10
    samples = {row["token"]: row for row in load_table(exported, "sample")}
    assert len(samples) == 30
    rows = load_table(exported, "cooperation")
    assert len(rows) == 6
    for row in rows:
        assert set(row["sample_tokens"]) == {"cav1", "cav2", "cav3", "rsu1", "rsu2"}
        times_us = [samples[token]["timestamp"] for token in row["sample_tokens"].values()]
        # The devkit sorts scenes by their starts, and cannot if two are equal.
        assert times_us == [row["timestamp"] + number for number in range(5)]
    starts = {samples[scene["first_sample_token"]]["timestamp"] for scene in scenes}
    assert len(starts) == len(scenes)
    instances = load_table(exported, "instance")
    by_object: dict[str, set[int]] = {}
    for row in instances:
        by_object.setdefault(row["object_token"], set()).add(row["object_id"])
    assert all(len(ids) == 1 for ids in by_object.values())
    assert len(by_object) < len(instances)


def test_chains_of_rows_lead_through_the_frames(exported: Path) -> None:
    annotations = {row["token"]: row for row in load_table(exported, "sample_annotation")}
    seen = 0
    for instance in load_table(exported, "instance"):
        token, steps = instance["first_annotation_token"], 0
        previous = ""
        while token:
            row = annotations[token]
            assert (row["instance_token"], row["prev"]) == (instance["token"], previous)
            previous, token, steps = token, row["next"], steps + 1
        assert previous == instance["last_annotation_token"]
        assert steps == instance["nbr_annotations"]
        seen += steps
    assert seen == len(annotations)


@needs_readers
def test_the_devkit_reads_the_boxes_as_they_are_and_the_points_in_them(
    read: Any, two_roads: Path
) -> None:
    assert len(read["samples"]) == 30
    assert read["picture_bytes"] > 10_000
    offsets: dict[str, set[tuple[float, ...]]] = {}
    boxes_read = 0
    for sample in read["samples"]:
        frame, view = find_view(two_roads, sample)
        boxes = view.load_steady_boxes()
        assert {box["object"] for box in sample["boxes"]} == set(boxes.ids.tolist())
        for box in sample["boxes"]:
            row = boxes.ids.tolist().index(box["object"])
            pose = boxes.world_from_box[row]
            shift = np.subtract(box["global"], pose[:3, 3])
            offsets.setdefault(frame.scenario.path.name, set()).add(tuple(np.round(shift, 9)))
            assert_allclose(box["rotation"], poses.to_quaternion(pose), atol=1e-12)
            assert_allclose(box["size"], boxes.sizes[row][[1, 0, 2]], atol=1e-12)
            in_cloud = int((view.cloud["object_id"] == box["object"]).sum())
            assert box["points"] == in_cloud > 30
            if np.isfinite(box["velocity"]).all():
                assert_allclose(box["velocity"], box["written_velocity"], atol=1e-6)
            boxes_read += 1
    # Every scenario is only shifted, by whole tens of metres, so that positions are positive.
    assert boxes_read > 100
    for shifts in offsets.values():
        ((x, y, z),) = shifts
        assert (x % 10, y % 10, z) == (0, 0, 0)


@needs_readers
def test_the_devkit_projects_points_to_the_pixels_where_they_are(
    read: Any, two_roads: Path
) -> None:
    channels = {0: "CAM_FRONT", 1: "CAM_RIGHT", 2: "CAM_LEFT", 3: "CAM_BACK"}
    compared = 0
    for sample in read["samples"]:
        _, view = find_view(two_roads, sample)
        world = poses.transform_points(view.world_from_lidar, view.points)
        for camera, channel in channels.items():
            columns, rows, depths = view.pixels(camera, world).T
            model = view.camera_model(camera)
            inside = (depths > 1.0) & (columns > 1) & (columns < model.width_px - 1)
            inside &= (rows > 1) & (rows < model.height_px - 1)
            assert len(sample["pixels"][channel]) == inside.sum()
            expected = np.column_stack([columns, rows])[inside]
            assert_allclose(np.reshape(sample["pixels"][channel], (-1, 2)), expected, atol=0.01)
            compared += int(inside.sum())
    assert compared > 1000


@needs_readers
def test_truth_as_prediction_is_perfect_to_the_devkit(read: Any) -> None:
    """Its means go over ten classes, five of which the data have not; those count as 0."""
    found = read["evaluation"]
    present = found["truth"]
    assert {"car", "bicycle", "pedestrian"} <= set(present) and sum(present.values()) > 40
    assert [found["ap"][name] for name in present] == pytest.approx([1.0] * len(present))
    assert found["map"] == pytest.approx(len(present) / 10)
    for name in present:
        errors = {key: value for key, value in found["errors"][name].items() if value == value}
        assert errors and max(errors.values()) < 1e-6


def test_lanes_are_on_the_mask_and_fields_are_not(exported: Path, two_roads: Path) -> None:
    for row, scenario in zip(
        load_table(exported, "map"), open_dataset(two_roads).scenarios, strict=True
    ):
        image = cv2.imread(str(exported / row["filename"]), cv2.IMREAD_UNCHANGED)
        assert image is not None
        assert set(np.unique(image)) == {0, 255}
        lanes = [one for one in build_road(scenario.spec.road).lanes if one.kind == "driving"]
        middles = np.array([(one.left[0] + one.right[0])[:2] / 2 for one in lanes])
        columns, rows = ((middles + row["world_offset"]) / 0.1).T
        assert (image[(len(image) - rows).astype(int), columns.astype(int)] == 255).mean() > 0.9
        assert not image[:400].any() and not image[:, :400].any()  # the margin around the road


def test_frames_between_key_frames_are_sweeps(two_roads: Path, tmp_path: Path) -> None:
    folder = export_dataset(
        "nuscenes", two_roads, tmp_path / "out", options={"key_frames": "2hz"}
    ).output
    samples = load_table(folder, "sample")
    assert len(samples) == 10
    readings = load_table(folder, "sample_data")
    assert [row["is_key_frame"] for row in readings[:25:5]] == [True] * 5
    sweeps = [row for row in readings if not row["is_key_frame"]]
    assert (len(readings), len(sweeps)) == (150, 100)
    assert all(row["filename"].startswith("sweeps/") for row in sweeps)
    assert all((folder / row["filename"]).is_file() for row in readings)
    keys = {row["sample_token"] for row in readings if row["is_key_frame"]}
    assert {row["sample_token"] for row in load_table(folder, "sample_annotation")} == keys
    assert [scene["nbr_samples"] for scene in load_table(folder, "scene")] == [1] * 10


@needs_readers
def test_the_devkit_reads_radars(radar_dataset: Path, tmp_path: Path) -> None:
    folder = export_dataset("nuscenes", radar_dataset, tmp_path / "out").output
    found = run_reader("read_nuscenes_radars.py", folder)
    seen = [one for one in found if one["points"]]
    assert len(found) == 6  # of three vehicles in two frames
    assert len(seen) == 2  # the ego alone has detections
    for one in seen:
        assert one["channel"] == "RADAR_FRONT"
        first, second = one["points"]
        assert_allclose([first[0], first[1], second[0], second[1]], [20.0, 15.0, 30.0, -4.0])
        # The ego drives at 10 m/s: what stands 0.8 ahead and 0.6 to the left comes at 8 m/s.
        assert_allclose(first[6:8], [-8.0 * 0.8, -8.0 * 0.6], atol=1e-5)
        assert_allclose(first[8:10], [0.0, 0.0], atol=1e-5)
        assert (first[3], first[5]) == (1.0, 12.0)
    (counts,) = {tuple(one["counts"].get("201", [])) for one in seen}
    assert counts == (1,)


def test_a_channel_is_named_by_where_its_sensor_looks(specs: dict[str, Spec]) -> None:
    agent = specs["ui_fog_day_sparse"].agents[0]
    mounts = tuple(Mount(yaw_deg=yaw) for yaw in (0, -55, 55, -110, 110, 180, 0))
    camera = agent.sensors.cameras[0].model.model_copy(update={"mounts": mounts})
    sensors = agent.sensors.model_copy(update={"camera": camera})
    names = [one.name for one in list_channels(agent.model_copy(update={"sensors": sensors}))]
    assert names == [
        "CAM_FRONT",
        "CAM_FRONT_RIGHT",
        "CAM_FRONT_LEFT",
        "CAM_BACK_RIGHT",
        "CAM_BACK_LEFT",
        "CAM_BACK",
        "CAM_FRONT_2",
        "LIDAR_TOP",
    ]
