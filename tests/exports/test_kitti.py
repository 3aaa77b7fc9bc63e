"""The KITTI layout: frames by hand, and what readers of others make of it."""

import csv
import hashlib
import json
import math
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from advercity_exports.kitti import TYPES
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from advercity.dataset.agent_view import AgentView
from advercity.dataset.reader import open_dataset
from advercity.errors import InputError
from advercity.exports.exporting import export_dataset
from advercity.geometry import poses
from tests.exports.readers import needs_readers, run_reader


@pytest.fixture(scope="module")
def exported(two_roads: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The frames of two scenarios, with cars on a slope, seen by vehicles and tilted cameras."""
    return export_dataset("kitti", two_roads, tmp_path_factory.mktemp("kitti") / "out").output


def views(dataset: Path) -> list[AgentView]:
    return [view for frame in open_dataset(dataset) for view in frame.views.values()]


def read_matrix(folder: Path, key: str, sample: str = "000000") -> NDArray[np.float64]:
    lines = (folder / f"training/calib/{sample}.txt").read_text().splitlines()
    numbers = dict(line.split(": ") for line in lines)[key].split()
    return np.reshape([float(number) for number in numbers], (3, -1))


def record_as_they_are(scenario: Path, paths: list[str]) -> None:
    """Write what these files are now into the manifest."""
    document = json.loads((scenario / "manifest.json").read_text())
    for path in paths:
        content = (scenario / path).read_bytes()
        record = {"size": len(content), "sha256": hashlib.sha256(content).hexdigest()}
        document["files"][path] |= record
    (scenario / "manifest.json").write_text(json.dumps(document))


def test_a_car_ahead_to_the_left_has_the_label_that_was_computed_by_hand(
    two_roads: Path, tmp_path: Path
) -> None:
    name = "rcnj_fog_day_sparse"
    scenario = shutil.copytree(two_roads / name, tmp_path / "dataset" / name)
    stem = scenario / "+101" / "000060"
    described = yaml.safe_load(stem.with_suffix(".yaml").read_text())
    car = described["vehicles"][201]
    # Left-handed: y to the right, yaw clockwise. The car faces left.
    car |= {"class": "car", "location": [10.45, -2.0, 0.0], "center": [0.0, 0.0, 0.75]}
    car |= {"angle": [0.0, -90.0, 0.0], "extent": [2.4, 1.0, 0.75]}
    described |= {"true_ego_pos": [0.0] * 6, "lidar_pose": [0.0, 0.0, 1.9, 0.0, 0.0, 0.0]}
    described["camera0"]["cords"] = [0.45, 0.0, 1.45, 0.0, 0.0, 0.0]
    described["camera0"]["intrinsic"] = [[100.0, 0, 48.0], [0, 100.0, 27.0], [0, 0, 1]]
    described |= {"vehicles": {201: car}, "walkers": {}}
    stem.with_suffix(".yaml").write_text(yaml.safe_dump(described))
    extras = json.loads(stem.with_name("000060_objects.json").read_text())
    extras["objects"]["201"]["cameras"]["camera0"] |= {
        "outline_box": [10.0, 20.0, 44.0, 40.5],
        "truncation": 0.125,
        "occlusion": 0.5,
    }
    stem.with_name("000060_objects.json").write_text(json.dumps(extras))
    record_as_they_are(scenario, ["+101/000060.yaml", "+101/000060_objects.json"])

    folder = export_dataset("kitti", scenario, tmp_path / "exports" / "kitti").output

    label = (folder / "training/label_2/000000.txt").read_text().split()
    assert label[:3] == ["Car", "0.1250", "1"]
    assert label[4:8] == ["10.00", "20.00", "44.00", "40.50"]
    # 10 m ahead of the camera, 2 m to its left, on the ground 1.45 m below it.
    assert_allclose([float(text) for text in label[8:14]], [1.5, 2.0, 4.8, -2.0, 1.45, 10.0])
    assert math.cos(float(label[14])) == pytest.approx(-1.0)
    assert float(label[3]) == pytest.approx(math.pi + math.atan(0.2) - 2 * math.pi, abs=1e-6)
    assert_allclose(read_matrix(folder, "R0_rect"), np.eye(3), atol=1e-12)
    middle_in_cam = read_matrix(folder, "Tr_velo_to_cam") @ (10.45, 2.0, -1.15, 1.0)
    assert_allclose(middle_in_cam, [-2.0, 0.7, 10.0], atol=1e-9)
    column, row, depth = read_matrix(folder, "P2") @ (*middle_in_cam, 1.0)
    assert_allclose([column / depth, row / depth], [28.0, 34.0])


def test_samples_are_numbered_through_all_scenarios_and_agents(
    exported: Path, two_roads: Path
) -> None:
    rows = list(csv.DictReader((exported / "training/samples.csv").read_text().splitlines()))
    assert [row["sample"] for row in rows] == [f"{number:06d}" for number in range(30)]
    assert (exported / "ImageSets/trainval.txt").read_text().split() == [
        row["sample"] for row in rows
    ]
    row = rows[23]
    assert (row["scenario"], row["agent"], row["frame"]) == ("ui_clear_night_dense", "rsu1", "1")
    view = open_dataset(two_roads).scenarios[1].frame(1)["rsu1"]
    image = (exported / "training/image_2/000023.png").read_bytes()
    assert image == view.path("_camera0.png").read_bytes()


def test_labels_give_the_boxes_back_to_a_micrometre(exported: Path, two_roads: Path) -> None:
    for number, view in enumerate(views(two_roads)):
        sample = f"{number:06d}"
        rect_from_cam = np.eye(4)
        rect_from_cam[:3, :3] = read_matrix(exported, "R0_rect", sample)
        cam_from_velo = np.vstack([read_matrix(exported, "Tr_velo_to_cam", sample), [0, 0, 0, 1]])
        world_from_rect = view.world_from_lidar @ poses.invert_pose(rect_from_cam @ cam_from_velo)
        boxes = view.boxes
        text = (exported / f"training/label_2/{sample}.txt").read_text()
        shown = [
            row
            for row, number in enumerate(boxes.ids)
            if "camera0" in view.extras["objects"][str(number)]["cameras"]
        ]
        assert len(text.splitlines()) == len(shown)
        for row, line in zip(shown, text.splitlines(), strict=True):
            kind, *numbers = line.split()
            height, width, length, x, y, z, angle = map(float, numbers[7:])
            assert kind == TYPES[boxes.classes[row]]
            assert_allclose((length, width, height), boxes.sizes[row], atol=1e-6)
            centre = poses.transform_points(world_from_rect, (x, y - height / 2, z))
            assert_allclose(centre, boxes.world_from_box[row, :3, 3], atol=2e-6)
            # The heading, seen along the LiDAR's axis.
            ahead = world_from_rect[:3, :3] @ (math.cos(angle), 0.0, -math.sin(angle))
            up = view.world_from_lidar[:3, 2]
            true_ahead = boxes.world_from_box[row, :3, 0]
            flat = true_ahead - (true_ahead @ up) * up
            assert_allclose(ahead, flat / np.linalg.norm(flat), atol=2e-6)


@needs_readers
def test_readers_find_the_points_of_every_box_and_their_pixels(
    exported: Path, two_roads: Path
) -> None:
    samples = run_reader("read_kitti.py", exported)
    assert len(samples) == 30
    boxes_read = 0
    roads = [one.spec.road for one in open_dataset(two_roads).scenarios for _ in range(15)]
    for sample, view, road in zip(samples, views(two_roads), roads, strict=True):
        table = view.cloud
        assert sample["points"] == len(table)
        world = poses.transform_points(view.world_from_lidar, view.points)
        expected = view.pixels(0, world)
        ahead = expected[:, 2] > 1.0
        assert_allclose(np.array(sample["pixels"])[ahead], expected[ahead], rtol=1e-4, atol=0.01)
        lidar_from_box = poses.invert_pose(view.world_from_lidar) @ view.boxes.world_from_box
        for box in sample["boxes"]:
            distances = np.linalg.norm(lidar_from_box[:, :3, 3] - box["centre"], axis=1)
            row = int(np.argmin(distances))
            assert distances[row] < 1e-4
            assert_allclose(box["wlh"], view.boxes.sizes[row][[1, 0, 2]], atol=1e-6)
            assert lidar_from_box[row, :3, 0] @ box["ahead"] > 0.99  # the slope is not in a label
            assert box["points"] >= 0.8 * (table["object_id"] == view.boxes.ids[row]).sum() > 30
            boxes_read += 1
        latitude, longitude, speed, up = sample["oxts"]
        assert latitude == pytest.approx(road.origin_lat_deg, abs=1e-3)
        assert longitude == pytest.approx(road.origin_lon_deg, abs=1e-3)
        _, pitch, _ = poses.to_yaw_pitch_roll(view.world_from_agent)
        assert speed == pytest.approx(view.speed_m_s * math.cos(pitch))  # over the ground
        is_vehicle = view.agent.place.kind == "vehicle"
        assert up == pytest.approx(9.81 if is_vehicle else 9.81 * view.world_from_agent[2, 2])
        assert_allclose(sample["rotation"], view.world_from_agent[:3, :3], atol=1e-9)
    assert boxes_read > 40


def test_points_of_an_object_are_projected_into_its_box_in_the_image(
    exported: Path, two_roads: Path
) -> None:
    inside = total = 0
    for number, view in enumerate(views(two_roads)):
        sample = f"{number:06d}"
        raw = np.fromfile(exported / f"training/velodyne/{sample}.bin", "<f4").reshape(-1, 4)
        velo = np.column_stack([raw[:, :3], np.ones(len(raw))])
        rect = read_matrix(exported, "R0_rect", sample) @ (
            read_matrix(exported, "Tr_velo_to_cam", sample) @ velo.T
        )
        columns, rows, depths = read_matrix(exported, "P2", sample) @ np.vstack(
            [rect, np.ones(len(raw))]
        )
        lines = (exported / f"training/label_2/{sample}.txt").read_text().splitlines()
        shown = [
            one
            for one in view.boxes.ids
            if "camera0" in view.extras["objects"][str(one)]["cameras"]
        ]
        image = cv2.imread(str(exported / f"training/image_2/{sample}.png"))
        assert image is not None
        height, width = image.shape[:2]
        for one, line in zip(shown, lines, strict=True):
            of_object = (view.cloud["object_id"] == one) & (depths > 0)
            u, v = columns[of_object] / depths[of_object], rows[of_object] / depths[of_object]
            in_image = (u >= 0) & (u < width) & (v >= 0) & (v < height)
            left, top, right, bottom = map(float, line.split()[4:8])
            held = (u >= left - 1) & (u <= right + 1) & (v >= top - 1) & (v <= bottom + 1)
            inside += int((held & in_image).sum())
            total += int(in_image.sum())
    assert total > 1000
    assert inside / total > 0.99


def test_a_camera_with_a_lens_is_refused(two_roads: Path, tmp_path: Path) -> None:
    scenario = shutil.copytree(two_roads / "ui_clear_night_dense", tmp_path / "dataset" / "lens")
    manifest = json.loads((scenario / "manifest.json").read_text())
    camera = manifest["spec"]["agents"][3]["sensors"]["camera"]
    camera["lens"] = {"model": "brown_conrady", "k1": -0.05}
    (scenario / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(InputError, match="camera0 of rsu1 has a lens"):
        export_dataset("kitti", scenario, tmp_path / "exports" / "kitti")
    assert not (tmp_path / "exports").exists()
