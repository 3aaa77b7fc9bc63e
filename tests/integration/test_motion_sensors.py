"""Receivers of satellites and inertial units with rates of their own, from a rig to the reader."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from advercity_dsl import Spec

from advercity.compiler.crossing import compile_library
from advercity.dataset.reader import Scenario
from advercity.dataset.verification import verify_dataset
from advercity.geometry.geodesy import Geodetic, enu_from_geodetic
from advercity.pipeline import RunOptions, run_scenario
from advercity.pipeline.replay import write_recording
from advercity.sensors.measurements import GnssSolution
from tests.builders import write_small_library

pytestmark = pytest.mark.sumo

RIG = """
kind: rig
id: one_camera
vehicle:
  camera: {width_px: 64, height_px: 32, mounts: [{z_m: 2}]}
  lidar: {mount: {z_m: 3}, channels: 2, azimuths: 32}
  gnss:
    mode: satellites
    rate_hz: 5
    receiver: {corrections: rtk, heading_baseline_m: 1, antenna_m: [0.5, 0, 1.8]}
  imu: {grade: consumer, rate_hz: 50, offset_ms: 3, vibration: {}}
  can: {rate_hz: 20}
roadside_unit:
  camera: {width_px: 64, height_px: 32, mounts: [{}]}
  lidar: {channels: 2, azimuths: 32}
  gnss: {mode: satellites, receiver: {constellations: [gps, galileo, beidou]}}
"""
SUITE = """
kind: suite
id: small
rig: one_camera
catalogue: one_car
looks: shaped
"""
FRAMES = 4


@pytest.fixture(scope="module")
def spec(tmp_path_factory: pytest.TempPathFactory) -> Spec:
    folder = tmp_path_factory.mktemp("motion") / "library"
    write_small_library(folder, rig=RIG, suite=SUITE)
    (compiled,) = compile_library(folder)
    return compiled


@pytest.fixture(scope="module")
def dataset(spec: Spec, tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("moving")
    options = RunOptions(output=root, backend="fake", profile="preview", frames=slice(0, FRAMES))
    run_scenario(spec, options)
    return root / spec.id


def test_fixes_come_at_the_rate_of_the_receiver_with_their_quality(dataset: Path) -> None:
    scenario = Scenario(dataset)
    origin = Geodetic(scenario.spec.road.origin_lat_deg, scenario.spec.road.origin_lon_deg)
    fixes = [scenario.frame(index)["cav1"].motion[0] for index in range(FRAMES)]
    assert [fix is not None for fix in fixes] == [True, False, True, False]
    first, view = fixes[0], scenario.frame(0)["cav1"]
    assert first is not None and first.quality is not None and first.heading_rad is not None
    assert first.time_s == scenario.frame(0).time_s
    assert first.quality.solution is GnssSolution.FIXED
    assert first.quality.satellites <= first.quality.visible
    place = Geodetic(first.latitude_deg, first.longitude_deg, first.altitude_m)
    error = enu_from_geodetic(place, origin) - view.world_from_agent[:3, 3]
    assert np.abs(error - [0, 0, scenario.spec.road.origin_alt_m]).max() < 0.1
    forward = view.world_from_agent[:2, 0]
    assert first.heading_rad == pytest.approx(np.arctan2(forward[0], forward[1]), abs=0.02)


def test_a_unit_at_rest_writes_its_fixes_too(dataset: Path) -> None:
    fix, imu = Scenario(dataset).frame(1)["rsu1"].motion
    assert imu is None
    assert fix is not None and fix.quality is not None
    assert fix.quality.solution is GnssSolution.SINGLE


def test_samples_have_their_own_times(dataset: Path) -> None:
    scenario = Scenario(dataset)
    _, imu = scenario.frame(2)["cav1"].motion
    assert imu is not None
    times = [one.time_s for one in (*imu.earlier, imu)]
    np.testing.assert_allclose(times, [-0.097, -0.077, -0.057, -0.037, -0.017], atol=1e-9)
    path = scenario.frame(2)["cav1"].path("_additional_gnss_imu.yaml")
    assert yaml.safe_load(path.read_text())["imu"]["time_offset"] == -0.017


def test_the_bus_says_what_the_vehicle_does(dataset: Path) -> None:
    view = Scenario(dataset).frame(3)["cav1"]
    signals = view.can
    assert signals is not None
    assert len(signals.earlier) == 1
    assert signals.speed_m_s == pytest.approx(view.speed_m_s, rel=0.03)
    assert signals.wheel_speeds_m_s.shape == (4,)
    assert Scenario(dataset).frame(3)["rsu1"].can is None


def test_all_samples_of_a_scenario_are_one_series(dataset: Path) -> None:
    scenario = Scenario(dataset)
    stamps = scenario.load_stamps("cav1")
    first_s = scenario.frame(0).time_s
    assert set(stamps) == {"camera0", "lidar0", "gnss", "imu", "can"}
    np.testing.assert_allclose(stamps["lidar0"], first_s + np.arange(FRAMES) * 0.1)
    np.testing.assert_allclose(stamps["gnss"], first_s + np.array([0, 0.2]), atol=1e-9)
    np.testing.assert_allclose(np.diff(stamps["imu"]), 0.02, atol=1e-9)
    np.testing.assert_allclose(np.diff(stamps["can"]), 0.05, atol=1e-9)
    series = scenario.load_samples("cav1", "can")
    halfway = series.interpolate(first_s + 0.125)["speed_m_s"][0]
    around = series.nearest([first_s + 0.1, first_s + 0.15])["speed_m_s"]
    assert halfway == pytest.approx(around.mean())


def test_such_a_dataset_verifies_and_replays(dataset: Path, tmp_path: Path) -> None:
    assert verify_dataset(dataset) == []
    write_recording(dataset, tmp_path / "again.rrd")
    assert (tmp_path / "again.rrd").stat().st_size > 0
