"""Shards for training, as the webdataset library loads them."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from advercity_exports import webdataset_shards
from numpy.testing import assert_allclose, assert_array_equal

from advercity.dataset.reader import open_dataset
from advercity.exports.exporting import export_dataset
from advercity.geometry import poses
from tests.requirements import require

pytestmark = pytest.mark.filterwarnings(
    "ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning"
)
"""The loader closes shards only when they are collected."""


def load_samples(folder: Path) -> list[dict[str, Any]]:
    library = require("webdataset")
    shards = sorted(map(str, (folder / "shards").glob("*.tar")))
    found = library.WebDataset(shards, shardshuffle=False, empty_check=False)
    return list(found.decode("rgb8"))


@pytest.fixture(scope="module")
def exported(two_roads: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return export_dataset("webdataset", two_roads, tmp_path_factory.mktemp("web") / "out").output


def test_the_loader_gives_images_clouds_and_boxes(exported: Path, two_roads: Path) -> None:
    samples = load_samples(exported)
    frames = list(open_dataset(two_roads))
    views = [(frame, view) for frame in frames for view in frame.views.values()]
    assert len(samples) == len(views) == 30
    for sample, (frame, view) in zip(samples, views, strict=True):
        assert sample["__key__"] == f"{frame.scenario.path.name}-{frame.name}-{view.agent.id}"
        for camera in range(4):
            assert_array_equal(sample[f"camera{camera}.png"], view.image(camera))
        assert_array_equal(sample["lidar.npy"][:, :3], view.points)
        boxes, calib = sample["boxes.json"], sample["calib.json"]
        assert boxes["ids"] == view.boxes.ids.tolist()
        assert_array_equal(calib["world_from_lidar"][0], view.world_from_lidar)
        # A box in the LiDAR's frame, as detectors take it, has the points of its object.
        x, y, z, length, width, height, yaw = np.transpose(boxes["boxes"])
        for row, number in enumerate(boxes["ids"]):
            of_object = view.points[view.cloud["object_id"] == number]
            along, left = of_object[:, 0] - x[row], of_object[:, 1] - y[row]
            ahead = along * math.cos(yaw[row]) + left * math.sin(yaw[row])
            aside = left * math.cos(yaw[row]) - along * math.sin(yaw[row])
            inside = (np.abs(ahead) < 0.55 * length[row]) & (np.abs(aside) < 0.55 * width[row])
            inside &= np.abs(of_object[:, 2] - z[row]) < 0.6 * height[row] + 0.05 * length[row]
            assert inside.mean() > 0.8


def test_calibration_projects_points_to_pixels(exported: Path, two_roads: Path) -> None:
    sample, view = load_samples(exported)[3], open_dataset(two_roads)[0]["rsu1"]
    calib = sample["calib.json"]
    world = poses.transform_points(np.array(calib["world_from_lidar"][0]), view.points)
    for camera in range(4):
        optical = poses.invert_pose(np.array(calib["world_from_camera"][camera]))
        columns, rows, depths = (
            np.array(calib["intrinsic"][camera]) @ poses.transform_points(optical, world).T
        )
        expected = view.pixels(camera, world)
        ahead = depths > 0.5
        assert_allclose(columns[ahead] / depths[ahead], expected[ahead, 0], rtol=1e-6)
        assert_allclose(rows[ahead] / depths[ahead], expected[ahead, 1], rtol=1e-6)


def test_ids_and_radars_are_in_shards_where_the_dataset_has_them(
    masked_dataset: Path, radar_dataset: Path, tmp_path: Path
) -> None:
    masked = load_samples(export_dataset("webdataset", masked_dataset, tmp_path / "a").output)
    ids = masked[0]["instance0.png"].astype(np.int32) @ (1, 256, 65536)
    assert_array_equal(ids, open_dataset(masked_dataset)[0]["cav1"].instance(0))
    radars = load_samples(export_dataset("webdataset", radar_dataset, tmp_path / "b").output)
    assert_allclose(radars[0]["radar0.npy"][0, :3], [20.0, 15.0, 0.0], atol=1e-5)
    assert radars[1]["radar0.npy"].shape == (0, 6)
    assert "radar0.npy" not in radars[3]


def test_long_scenarios_have_several_shards_and_equal_data_equal_bytes(
    two_roads: Path, tmp_path: Path, exported: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    again = export_dataset("webdataset", two_roads, tmp_path / "again").output
    for path in exported.rglob("*.tar"):
        assert path.read_bytes() == (again / path.relative_to(exported)).read_bytes()
    monkeypatch.setattr(webdataset_shards, "FRAMES_PER_SHARD", 2)
    cut = export_dataset("webdataset", two_roads, tmp_path / "cut").output
    index = json.loads((cut / "index.json").read_text())["shardlist"]
    assert [row["nsamples"] for row in index] == [10, 5, 10, 5]
    keys = [sample["__key__"] for sample in load_samples(cut)]
    assert keys == [sample["__key__"] for sample in load_samples(exported)]
