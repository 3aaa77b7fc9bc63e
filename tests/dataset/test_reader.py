import errno
import os
import pickle
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from advercity_dsl import Agent, Spec

import advercity
from advercity.dataset.reader import Dataset
from advercity.dataset.writer import ScenarioWriter
from advercity.errors import InputError, RunError
from advercity.geometry import poses
from advercity.sensors.annotation import annotate_actors
from advercity.sensors.measurements import PointCloud
from tests.builders import SensorFramesOf, identify, write_scenario

FRAMES = 2


@pytest.fixture(scope="module", params=["opv2v", "adver_city"])
def dataset(
    request: pytest.FixtureRequest,
    tmp_path_factory: pytest.TempPathFactory,
    spec: Spec,
    sensor_frames_of: SensorFramesOf,
) -> Dataset:
    root = tmp_path_factory.mktemp("dataset")
    write_scenario(root, spec, sensor_frames_of, frames=FRAMES, format=request.param)
    return advercity.open_dataset(root)


def test_frames_are_counted_and_found_by_position(dataset: Dataset) -> None:
    assert len(dataset) == FRAMES
    assert [frame.index for frame in dataset] == [0, 1]
    assert dataset[-1].name == "000061"
    assert dataset[1].time_s == pytest.approx(6.1)
    assert [frame.name for frame in dataset[:2]] == ["000060", "000061"]
    with pytest.raises(IndexError):
        dataset[FRAMES]


def test_poses_come_back(dataset: Dataset, sensor_frames_of: SensorFramesOf) -> None:
    for reading in sensor_frames_of(1):
        view = dataset[1][reading.agent.id]
        np.testing.assert_allclose(view.world_from_agent, reading.world_from_agent, atol=1e-7)
        np.testing.assert_allclose(view.world_from_lidar, reading.world_from_lidar, atol=1e-7)
        for index, image in enumerate(reading.camera_images):
            pose = view.world_from_camera(index)
            np.testing.assert_allclose(pose, image.world_from_camera, atol=1e-7)
        assert view.speed_m_s == pytest.approx(reading.speed_m_s)


def test_points_and_images_come_back(dataset: Dataset, sensor_frames_of: SensorFramesOf) -> None:
    for reading in sensor_frames_of(0):
        view = dataset[0][reading.agent.id]
        np.testing.assert_allclose(view.points, reading.point_cloud.points, atol=1e-5)
        intensity = view.cloud["intensity"]
        np.testing.assert_allclose(intensity, reading.point_cloud.intensity, atol=0.5 / 255 + 1e-6)
        for index, image in enumerate(reading.camera_images):
            np.testing.assert_array_equal(view.image(index), image.image)
            np.testing.assert_array_equal(view.semantic(index), image.semantic)


def test_points_without_motion_were_measured_where_they_are(dataset: Dataset) -> None:
    view = dataset[0]["cav1"]
    raw, time_s = view.measured
    np.testing.assert_array_equal(raw, view.points)
    assert not time_s.any()


def moved(cloud: PointCloud) -> PointCloud:
    times_s = np.linspace(-0.1, 0, len(cloud.points), dtype=np.float32)
    return replace(cloud, raw=cloud.points + np.float32(0.5), time_s=times_s)


def test_a_lidar_with_motion_keeps_where_and_when_it_measured(
    spec: Spec, sensor_frames_of: SensorFramesOf, tmp_path: Path
) -> None:
    turning = spec.model_copy(update={"agents": tuple(map(turned, spec.agents))})
    readings = [
        replace(reading, agent=turned(reading.agent)).with_readings(
            lidar=(replace(reading.lidar_scans[0], point_cloud=moved(reading.point_cloud)),)
        )
        for reading in sensor_frames_of(0)
    ]
    identity = identify(turning)
    with ScenarioWriter(tmp_path, turning, identity, length=1) as writer:
        writer.write_frame(0, readings)
        writer.finish()
    view = advercity.open_dataset(tmp_path)[0]["cav2"]
    raw, time_s = view.measured
    np.testing.assert_array_equal(raw, readings[1].point_cloud.raw)
    np.testing.assert_array_equal(time_s, readings[1].point_cloud.time_s)
    np.testing.assert_array_equal(view.cloud["time"], readings[1].point_cloud.time_s)
    np.testing.assert_array_equal(view.cloud["range"], readings[1].point_cloud.range_m)
    np.testing.assert_allclose(view.points, raw - 0.5, atol=1e-5)


def turned(agent: Agent) -> Agent:
    lidar = agent.sensors.lidars[0].model_copy(update={"motion_distortion": True})
    sensors = agent.sensors.model_copy(update={"lidar": lidar})
    return agent.model_copy(update={"sensors": sensors})


def test_boxes_come_back(dataset: Dataset, sensor_frames_of: SensorFramesOf) -> None:
    reading = sensor_frames_of(0)[0]
    boxes = dataset[0]["cav1"].boxes
    expected = {item.state.actor.id: item for item in annotate_actors(reading)}
    assert set(boxes.ids.tolist()) == set(expected)
    for row, number in enumerate(boxes.ids.tolist()):
        item = expected[number]
        np.testing.assert_allclose(boxes.world_from_box[row, :3, 3], item.state.box_centre)
        turn = item.state.world_from_body[:3, :3]
        np.testing.assert_allclose(boxes.world_from_box[row, :3, :3], turn, atol=1e-7)
        np.testing.assert_allclose(boxes.sizes[row], item.state.actor.size)
        assert boxes.classes[row] == item.state.actor.actor_class
        assert boxes.bearings_rad[row] == pytest.approx(item.bearing_rad)
        assert (boxes.lidar_points[row], boxes.is_parked[row]) == (item.lidar_points, False)
        assert boxes.visible_fraction[row] == pytest.approx(item.visible_fraction, abs=1e-4)
        assert boxes.speeds_m_s[row] == pytest.approx(item.state.speed_m_s)


def test_depths_are_in_metres_and_in_centimetres(dataset: Dataset) -> None:
    """Objects are 20.04 m away, and the sky is farther than either file holds."""
    view = dataset[0]["cav1"]
    if dataset.scenarios[0].format.name == "adver_city":
        with pytest.raises(InputError, match=r"_depth_cm0\.png"):
            view.depth_cm(0)
        return
    fine, coarse = view.depth_cm(0), view.depth(0)
    assert (fine.dtype, coarse.dtype) == (np.uint16, np.uint8)
    assert set(np.unique(fine).tolist()) == {2004, 65_535}
    np.testing.assert_array_equal(coarse, np.where(fine == 2004, 20, 255))


def test_boxes_are_selected_by_a_mask(dataset: Dataset) -> None:
    boxes = dataset[0]["cav1"].boxes
    near = boxes.select(boxes.distances_m < 15.0)
    assert near.ids.tolist() == [number for number in boxes.ids.tolist() if number in (201, 202)]
    assert near.world_from_box.shape == (2, 4, 4)


def test_points_project_into_images(dataset: Dataset) -> None:
    view = dataset[0]["cav1"]
    ahead = poses.transform_points(view.world_from_camera(0), [[10.0, 0.0, 0.0], [10.0, 1.0, 2.0]])
    height, width = view.image(0).shape[:2]
    focal_px = view.intrinsic(0)[0, 0]
    np.testing.assert_allclose(
        view.pixels(0, ahead),
        [
            [width / 2, height / 2, 10],
            [width / 2 - focal_px / 10, height / 2 - focal_px / 5, 10],
        ],
        atol=1e-5,
    )


def test_a_dataset_can_be_pickled(dataset: Dataset) -> None:
    copy = pickle.loads(pickle.dumps(dataset))
    np.testing.assert_array_equal(copy[1]["rsu1"].points, dataset[1]["rsu1"].points)


def test_extras_describe_every_object(dataset: Dataset, sensor_frames_of: SensorFramesOf) -> None:
    if dataset.scenarios[0].format.name == "adver_city":
        with pytest.raises(InputError, match=r"_objects\.json"):
            _ = dataset[0]["cav1"].extras
        return
    objects = dataset[0]["cav1"].extras["objects"]
    assert set(objects) == {"102", "103", "201", "202", "203"}
    van = objects["201"]
    assert (van["class"], van["roles"]) == ("van", {})
    assert (van["lidar_hits"], van["lidar_points"]) == (40, 35)
    velocity = sensor_frames_of(0)[0].frame.get_state(201).world_from_body[:3, 0] * 5.0
    np.testing.assert_allclose(van["velocity_m_s"], velocity * (1, -1, 1), atol=1e-6)
    shown = van["cameras"]["camera0"]
    assert shown["visible_px"] > 0
    assert 0.5 < shown["visible_fraction"] <= 1
    assert shown["truncation"] == pytest.approx(0, abs=1e-4)


READ_EVERYTHING = """
import sys
import advercity
dataset = advercity.open_dataset(sys.argv[1])
assert len(dataset) == 2
print(*sys.modules)
for view in dataset[0].views.values():
    view.boxes, view.points, view.measured, view.description, view.image(0), view.semantic(0)
dataset.scenarios[0].roles
print(*sys.modules)
"""
ENGINES = {"trimesh", "networkx", "shapely", "scipy", "libsumo", "sumolib", "sapien", "embreex"}
OTHERS = {"PIL", "av", "fsspec", "matplotlib", "ray", "rerun", "typer"}


def test_reading_loads_no_engine_and_opening_no_models(dataset: Dataset) -> None:
    folder = dataset.scenarios[0].path
    command = [sys.executable, "-c", READ_EVERYTHING, str(folder)]
    child = subprocess.run(command, capture_output=True, text=True, check=True)
    opening, reading = (
        {name.split(".")[0] for name in line.split()} for line in child.stdout.splitlines()
    )
    assert not opening & (ENGINES | OTHERS | {"pydantic", "advercity_dsl"})
    assert not reading & (ENGINES | OTHERS)


def test_a_folder_without_scenarios_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="not a dataset"):
        advercity.open_dataset(tmp_path)


def test_a_camera_that_the_rig_lacks_is_reported(dataset: Dataset) -> None:
    with pytest.raises(InputError, match="cav1 has cameras 0 to 3; there is no camera 7"):
        dataset[0]["cav1"].image(7)


def test_an_image_that_may_not_be_read_is_not_called_missing(
    dataset: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(path: Path, **_: int) -> bytes:
        raise PermissionError(errno.EACCES, "Permission denied", str(path))

    monkeypatch.setattr("advercity.dataset.agent_view.read_bytes", refuse)
    with pytest.raises(RunError, match="cannot be read: Permission denied"):
        dataset[1]["cav2"].image(1)


def test_a_missing_image_is_reported(dataset: Dataset) -> None:
    view = dataset[1]["cav2"]
    path = view.path("_camera1.png")
    path.rename(path.with_suffix(".moved"))
    with pytest.raises(InputError, match=f"{path}: is missing"):
        view.image(1)
    path.with_suffix(".moved").rename(path)


@pytest.mark.parametrize("kind", ["image", "cloud"])
def test_what_is_no_file_in_place_of_one_is_not_opened(dataset: Dataset, kind: str) -> None:
    """A pipe would wait for its writer, and a device has no end."""
    view = dataset[1]["cav2"]
    clouds = (path for path in (view.path(".pcd"), view.path("_lidar.ply")) if path.exists())
    path = view.path("_camera1.png") if kind == "image" else next(clouds)
    read = {"image": lambda: view.image(1), "cloud": lambda: view.cloud}[kind]
    aside = path.rename(path.with_suffix(".moved"))
    for place in ("pipe", "device"):
        if place == "pipe":
            os.mkfifo(path)
        else:
            path.symlink_to("/dev/zero")
        with pytest.raises(InputError, match=re.escape(str(path))):
            read()
        path.unlink()
    aside.rename(path)
