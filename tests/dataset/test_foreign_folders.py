import pickle
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from advercity_dsl import Spec

import advercity
from advercity.dataset.facts import collect_dataset_facts
from advercity.dataset.reader import Dataset
from advercity.dataset.statistics import compute_tables
from advercity.errors import InputError
from advercity.foreign.ledger import describe_left_out
from advercity.geometry import poses
from tests.builders import SensorFramesOf, write_scenario
from tests.dataset.foreign_folder import describe_opv2v, describe_v2v4real, write_frame


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A split with a scenario of two vehicles and a roadside unit, which have two frames."""
    scenario = tmp_path / "test" / "2021_08_16_22_26_54"
    for agent in ("650", "641", "-1"):
        for name in ("000068", "000070"):
            # The car is 20 m ahead and 10 m to the left: its own frame begins in the middle of it.
            write_frame(
                *(scenario / agent, name, describe_opv2v()),
                points=((20.0, -10.0, -1.15), (21.0, -10.0, -1.15), (20.0, -10.0, 0.0)),
            )
    image = np.full((600, 800, 3), (10, 20, 30), np.uint8)
    cv2.imwrite(str(scenario / "641" / "000068_camera0.png"), image)
    return scenario.parent


def open_first(folder: Path) -> Dataset:
    return advercity.open_dataset(folder, layout="opv2v")


def test_agents_and_frames_are_found_by_their_names(folder: Path) -> None:
    dataset = open_first(folder)
    assert len(dataset) == 2
    assert dataset.scenarios[0].agents == ("641", "650", "-1")
    assert dataset.scenarios[0].ego == "641"
    assert [frame.name for frame in dataset] == ["000068", "000070"]
    assert [frame.time_s for frame in dataset] == [0.0, pytest.approx(0.1)]
    units = {view.id: view.is_roadside_unit for view in dataset[0].views.values()}
    assert units == {"641": False, "650": False, "-1": True}


def test_boxes_are_where_opencood_places_them(folder: Path) -> None:
    view = open_first(folder)[0]["641"]
    pose = poses.invert_pose(view.world_from_lidar) @ view.boxes.world_from_box[0]
    # OpenCOOD: centre (20, -10, -1.15), yaw -0.785398 in the left-handed frame.
    np.testing.assert_allclose(pose[:3, 3], [20.0, 10.0, -1.15], atol=1e-9)
    assert poses.to_yaw_pitch_roll(pose)[0] == pytest.approx(0.785398, abs=1e-6)
    np.testing.assert_allclose(view.boxes.sizes, [[4.8, 2.0, 1.5]])
    assert view.boxes.ids.tolist() == [7]
    assert view.boxes.classes.tolist() == ["vehicle"]
    assert view.boxes.speeds_m_s.tolist() == [pytest.approx(10.0)]
    assert view.speed_m_s == pytest.approx(5.0)
    # From (100, 49.5, 0): 20.5 m ahead and 10 m to the left.
    assert view.boxes.distances_m.tolist() == [pytest.approx(np.hypot(20.5, 10.0))]
    assert view.boxes.bearings_rad.tolist() == [pytest.approx(np.arctan2(10.0, 20.5))]


def test_what_the_folder_does_not_say_is_unknown(folder: Path) -> None:
    dataset = open_first(folder)
    scenario, view = dataset.scenarios[0], dataset[0]["641"]
    assert view.boxes.lidar_hits.tolist() == [-1]
    assert np.isnan(view.boxes.visible_fraction).all()
    assert (view.radars, view.thermals, view.can, view.motion) == (0, 0, None, (None, None))
    assert not scenario.labels
    with pytest.raises(InputError, match="does not say: road, weather, visibility"):
        _ = scenario.spec
    with pytest.raises(InputError, match="641: its files do not describe the agent's rig"):
        _ = view.agent
    with pytest.raises(InputError, match=r"semantic0\.png: is missing; take it again"):
        view.semantic(0)
    with pytest.raises(InputError, match="641 has no radar"):
        _ = view.radar


def test_points_come_with_the_intensity_of_the_red_channel(folder: Path) -> None:
    view = open_first(folder)[0]["641"]
    np.testing.assert_allclose(view.points[0], [20.0, 10.0, -1.15], atol=1e-6)
    np.testing.assert_allclose(view.cloud["intensity"], 0.4, atol=1e-6)
    # Of three points, one is 1.15 m above the middle of a box of 1.5 m.
    assert view.boxes.lidar_points.tolist() == [2]


def test_a_point_is_in_the_pixel_where_opencood_shows_it(folder: Path) -> None:
    view = open_first(folder)[0]["641"]
    middle = view.boxes.world_from_box[:, :3, 3]
    # OpenCOOD: optical (-10, 0.25, 17.5), pixel (208.2058, 304.7949).
    np.testing.assert_allclose(view.pixels(0, middle), [[208.2058, 304.7949, 17.5]], atol=1e-3)
    np.testing.assert_array_equal(view.image(0)[5, 7], [30, 20, 10])
    assert view.cameras == 1


def test_focal_lengths_and_principal_point_are_those_of_the_file(folder: Path) -> None:
    matrix = [[335.0, 0.0, 410.0], [0.0, 300.0, 280.0], [0.0, 0.0, 1.0]]
    camera = {**describe_opv2v()["camera0"], "intrinsic": matrix}
    path = folder / "2021_08_16_22_26_54" / "641"
    write_frame(path, "000068", describe_opv2v(camera0=camera))
    view = open_first(folder)[0]["641"]
    model = view.camera_model(0)
    np.testing.assert_allclose(model.matrix, matrix)
    assert (model.width_px, model.height_px) == (800, 600)
    # Optical (-10, 0.25, 17.5), as above.
    pixel = (410 - 335 * 10 / 17.5, 280 + 300 * 0.25 / 17.5, 17.5)
    np.testing.assert_allclose(view.pixels(0, view.boxes.world_from_box[:, :3, 3]), [pixel])


def test_cameras_with_a_lens_or_skewed_pixels_are_refused(folder: Path) -> None:
    path = folder / "2021_08_16_22_26_54" / "641"
    camera = describe_opv2v()["camera0"]
    for name, value in {
        "intrinsic": [[335.0, 2.0, 400.0], [0.0, 335.0, 300.0], [0.0, 0.0, 1.0]],
        "distortion_model": "plumb_bob",
    }.items():
        write_frame(path, "000068", describe_opv2v(camera0={**camera, name: value}))
        view = open_first(folder)[0]["641"]
        assert view.intrinsic(0).shape == (3, 3)
        with pytest.raises(InputError, match="camera0 is no pinhole with rectangular pixels"):
            view.camera_model(0)


def test_keys_that_are_not_read_are_listed_once(folder: Path) -> None:
    scenario = folder / "2021_08_16_22_26_54"
    vehicles = {1: {**describe_opv2v()["vehicles"][7], "mood": 3, "bp_id": "vehicle.tesla"}}
    changed = describe_opv2v(vehicles=vehicles, cafe=[1], camera3={"shade": 1, "cords": [0] * 6})
    write_frame(scenario / "650", "000068", changed)
    text = describe_left_out(open_first(folder).scenarios[0].left_out)
    for part in (
        *("1 frame key cafe", "1 camera key shade", "1 object key mood"),
        *("1 blueprint of an object", "3 planned trajectories"),
    ):
        assert part in text


def test_a_frame_that_one_agent_lacks_is_left_out(folder: Path) -> None:
    (folder / "2021_08_16_22_26_54" / "650" / "000068.yaml").unlink()
    dataset = open_first(folder)
    assert [frame.name for frame in dataset] == ["000070"]
    text = describe_left_out(dataset.scenarios[0].left_out)
    assert "1 frame missing at some agents" in text


def test_v2v4real_is_right_handed_with_objects_in_the_lidars_frame(tmp_path: Path) -> None:
    for agent in ("0", "1"):
        points = ((10.0, 3.0, -1.2), (11.0, 3.0, -1.2))
        write_frame(tmp_path / "drive" / agent, "000000", describe_v2v4real(), points)
    view = open_first(tmp_path)[0]["1"]
    np.testing.assert_allclose(view.world_from_lidar[:3, 3], [5.0, 6.0, 2.0])
    np.testing.assert_allclose(view.points[0], [10.0, 3.0, -1.2], atol=1e-6)
    # 10 m along y of the map, and 3 m to the left of that: towards negative x.
    np.testing.assert_allclose(view.boxes.world_from_box[0, :3, 3], [2.0, 16.0, 0.8], atol=1e-9)
    yaw_rad, _, _ = poses.to_yaw_pitch_roll(view.boxes.world_from_box[0])
    assert np.degrees(yaw_rad) == pytest.approx(120.0)
    # One id of all agents, or that of the object from 100 times the agent's number.
    assert view.boxes.ids.tolist() == [12, 109]
    assert view.boxes.classes.tolist() == ["truck", "car"]
    assert view.boxes.lidar_points.tolist() == [2, 2]
    assert np.isnan(view.speed_m_s)
    assert view.cameras == 0


def test_a_dataset_of_advercity_without_its_manifest_reads_the_same(
    tmp_path: Path, spec: Spec, sensor_frames_of: SensorFramesOf
) -> None:
    write_scenario(tmp_path, spec, sensor_frames_of, frames=1)
    own = advercity.open_dataset(tmp_path)
    bare = shutil.copytree(tmp_path, tmp_path.with_name("bare"))
    next(bare.glob("*/manifest.json")).unlink()
    foreign = advercity.open_dataset(bare, layout="opv2v")
    numbers = {view.number: view for view in foreign[0].views.values()}
    assert foreign.scenarios[0].ego == str(spec.ego.number)
    for view in own[0].views.values():
        other = numbers[view.number]
        for name in ("ids", "classes", "world_from_box", "sizes", "lidar_hits", "lidar_points"):
            expected = getattr(view.boxes, name)
            np.testing.assert_array_equal(getattr(other.boxes, name), expected, err_msg=name)
        np.testing.assert_array_equal(other.points, view.points)
        np.testing.assert_array_equal(other.cloud["intensity"], view.cloud["intensity"])
        np.testing.assert_array_equal(other.image(0), view.image(0))
        np.testing.assert_array_equal(other.semantic(0), view.semantic(0))
        np.testing.assert_array_equal(other.world_from_camera(0), view.world_from_camera(0))
        np.testing.assert_array_equal(other.intrinsic(0), view.intrinsic(0))
        assert (other.cameras, other.lidars) == (view.cameras, view.lidars)


def test_a_foreign_dataset_can_be_pickled_for_workers(folder: Path) -> None:
    again = pickle.loads(pickle.dumps(open_first(folder)))
    assert again[1]["650"].boxes.ids.tolist() == [7]


def test_statistics_have_no_tables_of_what_is_unknown(folder: Path) -> None:
    tables = compute_tables(collect_dataset_facts(folder, "opv2v"))
    found = {one.name: one.columns for one in tables}
    assert found["class_histogram"] == {"class": ["vehicle"], "annotations": [2]}
    assert found["stats"]["frames"] == [2, 2]
    assert found["stats"]["traffic_speed_km_h_mean"] == [pytest.approx(36.0)] * 2
    assert not {"weather", "time_of_day", "visibility_by_weather", "messages"}.intersection(found)


def test_speeds_that_are_not_in_the_files_do_not_count(tmp_path: Path) -> None:
    write_frame(tmp_path / "drive" / "0", "000000", describe_v2v4real())
    tables = compute_tables(collect_dataset_facts(tmp_path, "opv2v"))
    found = {one.name: one.columns for one in tables}
    assert np.isnan(found["stats"]["cav_speed_km_h_mean"]).all()
    assert found["num_frames_per_ego_speed"]["frames"] == [0]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("[]", "000068.yaml: is damaged"),
        ("lidar_pose: [1, 2]", "000068.yaml: is damaged"),
        ("vehicles: {}", "000068.yaml: is damaged"),
        ("lidar_pose: [[1, 0], [0, 1]]", "000068.yaml: is damaged"),
        ("lidar_pose: [0, 0, 0, 0, 0, 0]\nvehicles: {1: {location: [1]}}", "is damaged"),
        ("lidar_pose: !!python/object:os.system [1]", "000068.yaml:1:13"),
    ],
)
def test_damaged_descriptions_are_refused_by_file(folder: Path, content: str, message: str) -> None:
    (folder / "2021_08_16_22_26_54" / "641" / "000068.yaml").write_text(content)
    with pytest.raises(InputError, match=message):
        view = open_first(folder)[0]["641"]
        _ = view.boxes, view.points, view.world_from_lidar


def test_keys_that_are_no_texts_do_not_matter(folder: Path) -> None:
    path = folder / "2021_08_16_22_26_54" / "641"
    file = path / "000068.yaml"
    file.write_text(f"3: 1.0\n{file.read_text()}")
    view = open_first(folder)[0]["641"]
    assert (view.cameras, view.lidars) == (1, 1)


def test_folders_without_agents_say_what_is_missing(tmp_path: Path, folder: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="not in the layout opv2v: no scenario with agents"):
        open_first(tmp_path / "empty")
    with pytest.raises(InputError, match="nowhere: no such folder"):
        open_first(tmp_path / "nowhere")
    with pytest.raises(InputError, match="`layout` kitti: no such layout; opv2v or adver_city"):
        advercity.open_dataset(folder, layout="kitti")
    with pytest.raises(InputError, match="for a foreign folder give `layout`"):
        advercity.open_dataset(folder)


def test_two_folders_of_one_number_are_refused(folder: Path) -> None:
    scenario = folder / "2021_08_16_22_26_54"
    shutil.copytree(scenario / "641", scenario / "+641")
    with pytest.raises(InputError, match="two folders of agents have one number"):
        open_first(folder)
