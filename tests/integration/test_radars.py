"""Radars of a rig, from the declaration to files, readers, verification and repair."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from advercity_dsl import Mount, Radar, Spec

from advercity.compiler.crossing import compile_library
from advercity.dataset.facts import collect_dataset_facts
from advercity.dataset.reader import Scenario
from advercity.dataset.statistics import compute_tables
from advercity.dataset.verification import verify_dataset
from advercity.errors import InputError
from advercity.pipeline import RunOptions, repair_dataset, run_scenario
from advercity.pipeline.replay import write_recording
from advercity.sensors.measurements import RadarDetections
from advercity.sensors.sensor_frame import RadarScan
from advercity.testing import hash_tree
from advercity.viewer.radar_pictures import colour_velocities, draw_range_azimuth
from tests.builders import write_small_library

pytestmark = pytest.mark.sumo

RIG = """
kind: rig
id: radars
vehicle:
  camera: {width_px: 32, height_px: 16, mounts: [{z_m: 2}]}
  lidar: {mount: {z_m: 3}, channels: 4, azimuths: 64, range_m: 50}
  radar:
    range_m: 0.08 km
    rays: 4000
    output: cube
    mounts: [{x_m: 2.5, z_m: 0.6}, {x_m: -2.5, z_m: 0.6, yaw_deg: 180}]
"""
SUITE = """
kind: suite
id: small
rig: one_camera
agents: {cav1: radars}
catalogue: one_car
looks: shaped
"""


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("radars") / "library"
    return write_small_library(folder, radars=RIG, suite=SUITE)


@pytest.fixture(scope="module")
def spec(library: Path) -> Spec:
    (compiled,) = compile_library(library)
    return compiled


def make_options(root: Path) -> RunOptions:
    return RunOptions(output=root, backend="fake", profile="preview", frames=slice(0, 2))


@pytest.fixture(scope="module")
def dataset(spec: Spec, tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("detected")
    run_scenario(spec, replace(make_options(root), rrd=root / "live.rrd"))
    return root / spec.id


def test_a_spec_without_radars_does_not_mention_them(spec: Spec) -> None:
    ego, unit = spec.agents
    assert len(ego.sensors.radars) == 2
    assert ego.sensors.radars[0].model.range_m == 80
    assert "radar" not in unit.sensors.model_dump(mode="json")


@pytest.mark.parametrize(
    ("written", "message"),
    [
        (
            "range_m: 3",
            "radars.yaml:8:14: vehicle.radar.range_m: 3 m is outside the range of 5 to 500 m",
        ),
        ("bandwidth_mhz: 1 m", "'m' is a unit of length; units of frequency: Hz, kHz, MHz, GHz"),
        ("bounces: 4", "vehicle.radar.bounces"),
    ],
)
def test_what_no_radar_has_is_refused(
    library: Path, tmp_path: Path, written: str, message: str
) -> None:
    changed = tmp_path / "library"
    shutil.copytree(library, changed)
    (changed / "radars.yaml").write_text(RIG.replace("range_m: 0.08 km", written))
    with pytest.raises(InputError) as caught:
        compile_library(changed)
    assert message in str(caught.value)


def test_every_radar_has_its_files_and_is_read_by_its_number(dataset: Path) -> None:
    names = {path.name for path in (dataset / "+101").glob("000060_radar*")}
    assert names == {f"000060_radar{k}.{kind}" for k in (0, 1) for kind in ("pcd", "npz")}
    view = Scenario(dataset)[0]["cav1"]
    table = view.load_radar(0)
    assert len(table) > 5
    # The road ahead comes closer.
    surfaces = table[table["kind"] == 0]
    ahead = surfaces[np.abs(surfaces["y"]) < surfaces["x"] / 4]
    assert np.median(ahead["velocity"]) == pytest.approx(-view.speed_m_s, rel=0.1)
    assert view.load_radar_cube(1).power_db.shape[1:] == (80, 15)
    pose = np.linalg.inv(view.world_from_agent) @ view.load_radar_pose(0)
    np.testing.assert_allclose(pose[:3, 3], (2.5, 0, 0.6), atol=1e-6)
    with pytest.raises(InputError, match="cav1 has radars 0 to 1; there is no radar 2"):
        view.load_radar(2)
    with pytest.raises(InputError, match="rsu1 has no radar"):
        _ = Scenario(dataset)[0]["rsu1"].radar


def test_loaders_of_opv2v_find_every_other_file_as_without_radars(
    dataset: Path, library: Path, tmp_path: Path
) -> None:
    plain = shutil.copytree(library, tmp_path / "library")
    (plain / "radars.yaml").write_text(RIG.partition("  radar:")[0])
    (spec,) = compile_library(plain)
    run_scenario(spec, make_options(tmp_path))
    found, expected = (
        {path.relative_to(folder).as_posix(): path for path in folder.glob("*/*")}
        for folder in (dataset, tmp_path / spec.id)
    )
    assert all("_radar" in name for name in found.keys() - expected.keys())
    assert "+101/000061.pcd" in expected
    for name, path in expected.items():
        if name in ("+101/000060.yaml", "+101/000061.yaml"):
            said = yaml.safe_load(found[name].read_text())
            poses = [said.pop(f"radar{k}_pose") for k in (0, 1)]
            assert all(len(pose) == 6 for pose in poses)
            assert said == yaml.safe_load(path.read_text())
        else:
            assert found[name].read_bytes() == path.read_bytes()


def test_statistics_count_what_every_radar_detected(dataset: Path) -> None:
    views = [frame["cav1"] for frame in Scenario(dataset)]
    tables = [view.load_radar(number) for view in views for number in (0, 1)]
    surfaces = np.mean([(table["kind"] == 0).sum() for table in tables])
    statistics = compute_tables(collect_dataset_facts(dataset.parent))
    (kinds,) = (dict(table.columns) for table in statistics if table.name == "radar_by_kind")
    assert list(kinds["surface"]) == pytest.approx([surfaces])


def test_the_picture_of_a_radar_has_its_targets_where_they_are() -> None:
    radar = Radar(mounts=(Mount(),))
    number = np.zeros(1, np.float32)
    detections = RadarDetections(
        points=np.array([[75.0, 0, 0]], np.float32),
        velocity_m_s=number,
        rcs_dbsm=number,
        snr_db=number + 50,
        instance=np.zeros(1, np.int32),
        kind=np.zeros(1, np.uint8),
    )
    picture = draw_range_azimuth(radar, RadarScan(np.eye(4), detections)).sum(axis=2)
    row, column = np.unravel_index(picture.argmax(), picture.shape)
    assert row / picture.shape[0] == pytest.approx(0.5, abs=0.02)
    assert column / picture.shape[1] == pytest.approx(0.5, abs=0.02)
    red, _, blue = colour_velocities(np.array([-15.0, 15.0], np.float32)).T.astype(int)
    assert blue[0] > red[0]
    assert red[1] > blue[1]


def test_any_order_of_frames_gives_the_same_bytes(
    dataset: Path, spec: Spec, tmp_path: Path
) -> None:
    for frames in (slice(1, 2), slice(0, 1)):
        run_scenario(spec, replace(make_options(tmp_path), frames=frames))
    first, again = (
        {name: value for name, value in hash_tree(folder).items() if "_radar" in name}
        for folder in (dataset, tmp_path / spec.id)
    )
    assert first == again
    assert len(first) == 8


def test_a_scan_is_read_as_it_was_measured(dataset: Path) -> None:
    view = Scenario(dataset)[1]["cav1"]
    scan, table = view.read("radar", 1), view.load_radar(1)
    assert view.count("radar") == 2
    np.testing.assert_array_equal(scan.detections.points[:, 1], table["y"])
    np.testing.assert_array_equal(scan.cube.power_db, view.load_radar_cube(1).power_db)
    np.testing.assert_array_equal(scan.world_from_radar, view.load_pose("radar", 1))
    assert len(view.read("lidar").point_cloud.points) == len(view.cloud)


@pytest.mark.parametrize(
    ("kind", "number", "message"),
    [
        ("sonar", 0, "there is no kind of sensor 'sonar'; there are camera, lidar, radar"),
        ("radar", 2, "cav1 has radars 0 to 1; there is no radar 2"),
        ("thermal", 0, "cav1 has no thermal"),
        ("gnss", 0, "sensors of kind 'gnss' have no pose of their own"),
    ],
)
def test_sensors_that_are_not_there_have_no_pose(
    dataset: Path, kind: str, number: int, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        Scenario(dataset)[0]["cav1"].load_pose(kind, number)


def test_radar_files_are_verified_repaired_and_replayed(dataset: Path, tmp_path: Path) -> None:
    assert verify_dataset(dataset.parent) == []
    write_recording(dataset, tmp_path / "again.rrd")
    for name in ("000060_radar1.pcd", "000061_radar0.npz"):
        lost = dataset / "+101" / name
        content = lost.read_bytes()
        lost.write_bytes(content[:-9])
        assert [problem.path for problem in verify_dataset(dataset.parent)] == [f"+101/{name}"]
        with pytest.raises(InputError, match=name):
            view = Scenario(dataset)[int(name[5])]["cav1"]
            _ = view.load_radar_cube(0) if name.endswith("npz") else view.load_radar(1)
        lost.unlink()
        assert repair_dataset(dataset) == []
        assert lost.read_bytes() == content
