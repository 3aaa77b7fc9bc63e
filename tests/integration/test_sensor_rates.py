"""Cameras, LiDARs and radars with rates of their own, from the declaration to readers."""

import json
import math
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from advercity_dsl import Spec

from advercity.compiler.crossing import compile_library
from advercity.dataset.reader import Scenario
from advercity.dataset.verification import verify_dataset
from advercity.errors import InputError
from advercity.exports.exporting import export_dataset
from advercity.geometry.poses import invert_pose
from advercity.pipeline import RunOptions, run_scenario
from advercity.pipeline.replay import write_recording
from advercity.testing import hash_tree
from tests.builders import write_small_library

pytestmark = pytest.mark.sumo

RIG = """
kind: rig
id: rated
vehicle:
  camera: {width_px: 16, height_px: 16, mounts: [{z_m: 2}]}
  more_cameras:
    slow: {width_px: 16, height_px: 16, mounts: [{x_m: 1, z_m: 2}], rate_hz: 5, offset_ms: 40}
  lidar: {mount: {z_m: 3}, channels: 4, azimuths: 64, range_m: 50, {lidar}}
  more_lidars:
    as_frames: {mount: {z_m: 3}, channels: 4, azimuths: 64, range_m: 50, rate_hz: 10}
  radar: {rays: 2000, mounts: [{x_m: 2.5, z_m: 0.6}], rate_hz: 20, offset_ms: 30}
  thermal: {width_px: 32, height_px: 24, mounts: [{x_m: 2.5, z_m: 0.6}], rate_hz: 5, jitter_ms: 5}
"""
SUITE = """
kind: suite
id: small
rig: one_camera
agents: {cav1: rated}
catalogue: one_car
looks: shaped
"""


def compile_with(folder: Path, lidar: str) -> Spec:
    rig = RIG.replace("{lidar}", lidar)
    (spec,) = compile_library(write_small_library(folder / "library", rated=rig, suite=SUITE))
    return spec


def make_options(root: Path) -> RunOptions:
    return RunOptions(output=root, backend="fake", profile="preview", frames=slice(0, 5))


@pytest.fixture(scope="module")
def spec(tmp_path_factory: pytest.TempPathFactory) -> Spec:
    return compile_with(tmp_path_factory.mktemp("rated"), "rate_hz: 5, offset_ms: 40")


@pytest.fixture(scope="module")
def dataset(spec: Spec, tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("stamped")
    run_scenario(spec, make_options(root))
    return root / spec.id


def test_stamps_say_when_the_newest_samples_were_taken(dataset: Path) -> None:
    scenario = Scenario(dataset)
    stamps = scenario.load_stamps("cav1")
    frames = np.array([frame.time_s for frame in scenario])
    np.testing.assert_array_equal(stamps["camera0"], frames)
    # Five a second and 40 ms late, of frames at multiples of 0.1 s. There is none until the first.
    lidar_ms = np.round((stamps["lidar0"] - frames) * 1000).tolist()
    assert lidar_ms == [0, -60, -160, -60, -160]
    np.testing.assert_allclose(stamps["lidar1"], frames)
    # Twenty a second and 30 ms late: 20 ms before each frame, the one before that is not kept.
    np.testing.assert_allclose(stamps["radar0"][1:], frames[1:] - 0.02)
    late_s = frames - stamps["thermal0"]
    assert late_s.min() >= 0
    assert late_s.max() < 0.2 + 5 * 0.005
    taken = np.unique(stamps["thermal0"][1:])
    assert len(taken) > 1
    np.testing.assert_allclose(taken, np.round(taken / 0.2) * 0.2, atol=5 * 0.005)


def test_a_frame_without_a_new_scan_has_the_last_one(dataset: Path) -> None:
    scenario = Scenario(dataset)
    stamps = scenario.load_stamps("cav1")["lidar0"]
    views = [frame["cav1"] for frame in scenario]
    clouds = [view.path(".pcd").read_bytes() for view in views]
    pairs = list(zip(range(4), range(1, 5), strict=True))
    same = [clouds[a] == clouds[b] for a, b in pairs]
    assert same == [stamps[a] == stamps[b] for a, b in pairs]
    assert any(same)
    poses = [view.world_from_lidar for view in views]
    for row, view in enumerate(views):
        # The pose is that of the sample: as far behind as the vehicle has come since.
        behind = np.linalg.norm(view.world_from_agent[:2, 3] - poses[row][:2, 3])
        late_s = scenario[row].time_s - stamps[row]
        assert behind == pytest.approx(view.speed_m_s * late_s, abs=0.05)


def test_a_slow_camera_repeats_its_image_every_second_frame(dataset: Path) -> None:
    scenario = Scenario(dataset)
    stamps = scenario.load_stamps("cav1")
    np.testing.assert_array_equal(stamps["camera1"], stamps["lidar0"])
    views = [frame["cav1"] for frame in scenario]
    for camera, kept in ((0, [False] * 4), (1, [False, True, False, True])):
        # Noise of the sensor is all that an even scene shows.
        images = [view.path(f"_camera{camera}.png").read_bytes() for view in views]
        assert [images[a] == images[a + 1] for a in range(4)] == kept, camera
        places = [view.world_from_camera(camera)[0, 3] for view in views]
        assert [places[a] == places[a + 1] for a in range(4)] == kept


def test_exports_have_the_times_of_samples_and_the_mounts_of_sensors(
    dataset: Path, tmp_path: Path
) -> None:
    scenario = Scenario(dataset)
    view, late_s = scenario[4]["cav1"], 0.16
    behind = invert_pose(view.world_from_agent) @ view.world_from_camera(1)
    assert behind[0, 3] == pytest.approx(1 - late_s * view.speed_m_s, abs=0.05)
    output = export_dataset("nuscenes", dataset.parent, tmp_path / "nuscenes").output
    rows = {
        name: json.loads((output / "v1.0-trainval" / f"{name}.json").read_text())
        for name in ("sample_data", "ego_pose", "calibrated_sensor", "sensor", "cooperation")
    }
    by_token = {row["token"]: row for table in rows.values() for row in table}
    (sensor,) = (one["token"] for one in rows["sensor"] if one["channel"] == "CAM_FRONT_2")
    (mounted,) = (one for one in rows["calibrated_sensor"] if one["sensor_token"] == sensor)
    # The ego frame is at the rear axle.
    ahead_m, left_m, up_m = mounted["translation"]
    assert ahead_m > 2
    np.testing.assert_allclose((left_m, up_m), (0, 2), atol=1e-6)
    taken = [
        one for one in rows["sample_data"] if one["calibrated_sensor_token"] == mounted["token"]
    ]
    stamps_us = np.round(scenario.load_stamps("cav1")["camera1"] * 1e6)
    begins_us = rows["cooperation"][0]["timestamp"] - round(scenario[0].time_s * 1e6)
    assert [one["timestamp"] - begins_us for one in taken] == stamps_us.tolist()
    poses_us = [by_token[one["ego_pose_token"]]["timestamp"] - begins_us for one in taken]
    assert poses_us == stamps_us.tolist()
    ego = by_token[taken[4]["ego_pose_token"]]["translation"]
    now = next(
        one
        for one in rows["ego_pose"]
        if one["timestamp"] - begins_us == round(scenario[4].time_s * 1e6)
        and math.dist(one["translation"], ego) < 10
    )
    assert math.dist(now["translation"], ego) == pytest.approx(late_s * view.speed_m_s, abs=0.05)
    output = export_dataset("coco", dataset.parent, tmp_path / "coco").output
    images = json.loads((output / "annotations" / "instances.json").read_text())["images"]
    own = [one for one in images if (one["agent"], one["camera"]) == ("cav1", 1)]
    assert [round(one["time_s"] * 1e6) for one in own] == stamps_us.tolist()


def test_recordings_have_each_sample_once_at_its_time(dataset: Path, tmp_path: Path) -> None:
    reader = pytest.importorskip("mcap.reader")
    output = export_dataset("mcap", dataset.parent, tmp_path / "mcap").output
    with next(output.glob("*.mcap")).open("rb") as stream:
        opened = reader.make_reader(stream)
        found = [
            message.log_time
            for _, _, message in opened.iter_messages(topics=["/cav1/camera1/image"])
        ]
    stamps = Scenario(dataset).load_stamps("cav1")["camera1"]
    assert found == np.unique(np.round(stamps * 1e9).astype(np.int64)).tolist()


def test_the_nearest_scan_is_found_by_time(dataset: Path) -> None:
    scenario = Scenario(dataset)
    stamps = scenario.load_stamps("cav1")["lidar0"]
    (found,) = scenario.find_nearest("cav1", "lidar0", stamps[-1] + 0.01)
    assert stamps[found] == stamps[-1]
    with pytest.raises(InputError, match="cav1 has no sensor 'lidar7' with"):
        scenario.find_nearest("cav1", "lidar7", 0)


def test_a_rate_of_the_frames_changes_no_scan(dataset: Path) -> None:
    view = Scenario(dataset)[2]["cav1"]
    assert view.stamps["lidar1"] == Scenario(dataset)[2].time_s
    np.testing.assert_allclose(
        view.load_lidar_pose(1)[:3, 3], view.world_from_agent[:3, 3] + [0, 0, 3], atol=0.01
    )


def test_sensors_without_rates_are_as_before_and_mention_no_stamps(
    spec: Spec, dataset: Path, tmp_path: Path
) -> None:
    plain = compile_with(tmp_path, "rate_hz: 10")
    run_scenario(plain, make_options(tmp_path))
    rsu = {name: value for name, value in hash_tree(dataset).items() if name.startswith("-1/")}
    again = hash_tree(tmp_path / plain.id)
    assert rsu
    assert all(again[name] == value for name, value in rsu.items())
    assert "stamps" not in (dataset / "-1" / "000060.yaml").read_text()
    assert "rate_hz" not in spec.agents[1].sensors.model_dump_json()


def test_any_order_of_frames_gives_the_same_bytes(
    dataset: Path, spec: Spec, tmp_path: Path
) -> None:
    for frames in (slice(3, 5), slice(0, 3)):
        run_scenario(spec, replace(make_options(tmp_path), frames=frames))
    first, again = (
        {name: value for name, value in hash_tree(folder).items() if name.startswith("+101/")}
        for folder in (dataset, tmp_path / spec.id)
    )
    assert first == again
    assert verify_dataset(dataset.parent) == []
    write_recording(dataset, tmp_path / "again.rrd")


@pytest.mark.parametrize("stamps", ["stamps: []", "stamps: {lidar0: soon}", "stamps: 3"])
def test_damaged_stamps_give_a_message(dataset: Path, tmp_path: Path, stamps: str) -> None:
    copy = shutil.copytree(dataset, tmp_path / dataset.name)
    path = copy / "+101" / "000060.yaml"
    path.write_text(f"{path.read_text().partition('stamps:')[0]}{stamps}\n")
    with pytest.raises(InputError, match=r"000060\.yaml"):
        _ = Scenario(copy)[0]["cav1"].stamps


HEADS = "".join(
    f"    at_{rate}: {{mount: {{z_m: 3}}, channels: 4, azimuths: 64, range_m: 50,"
    f" motion_distortion: true, rate_hz: {rate}}}\n"
    for rate in (5, 10, 20, "null")
)
MOVING_RIG = RIG.partition("  more_lidars")[0].replace("{lidar}", "") + f"  more_lidars:\n{HEADS}"


def test_a_scan_takes_the_period_of_its_rate(tmp_path: Path) -> None:
    library = write_small_library(tmp_path / "library", rated=MOVING_RIG, suite=SUITE)
    (spec,) = compile_library(library)
    run_scenario(spec, replace(make_options(tmp_path), frames=slice(0, 3)))
    # At 5 Hz, the scan of frame 2 begins with frame 0; before that, motion goes back.
    for frame in (0, 2):
        view = Scenario(tmp_path / spec.id)[frame]["cav1"]
        for lidar, period_s in enumerate((0.2, 0.1, 0.05, 0.1), start=1):
            cloud = view.load_cloud(lidar)
            # Sixty-four columns, of which the first is fired a period ago.
            columns = np.round((cloud["time"] / period_s + 1) * 64)
            np.testing.assert_allclose(cloud["time"], (columns / 64 - 1) * period_s, atol=1e-6)
            assert columns.min() < 8 < 56 < columns.max()
            first = cloud[columns == columns.min()]
            moved_m = float((first["x"] - first["raw_x"]).mean())
            came_m = float(view.speed_m_s * first["time"][0])
            assert came_m < -0.2
            assert moved_m == pytest.approx(came_m, rel=0.05, abs=0.01)
