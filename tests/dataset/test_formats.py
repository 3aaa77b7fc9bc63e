"""The original's layout, by its published description."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from advercity_dsl import Spec

from advercity.dataset.formats import find_format
from advercity.dataset.opv2v import encode_opv2v_frame
from advercity.dataset.verification import verify_scenario
from advercity.dataset.writer import ScenarioWriter
from advercity.errors import InputError, RunError
from tests.builders import SensorFramesOf, identify, write_scenario


@pytest.fixture(scope="module")
def scenario(
    tmp_path_factory: pytest.TempPathFactory, spec: Spec, sensor_frames_of: SensorFramesOf
) -> Path:
    root = tmp_path_factory.mktemp("original")
    write_scenario(root, spec, sensor_frames_of, format="adver_city")
    return root / spec.id


def test_folders_and_files_are_named_as_in_the_original(scenario: Path) -> None:
    folders = sorted(path.name for path in scenario.iterdir() if path.is_dir())
    assert folders == ["-1", "-2", "101", "102", "103"]
    images = {f"000060_{kind}{k}.png" for kind in ("camera", "semantic") for k in range(4)}
    both = {"000060.yaml", "000060_lidar.ply"} | images
    assert {path.name for path in (scenario / "-2").iterdir()} == both
    vehicle = both | {"000060_gnss_imu.yaml"}
    assert {path.name for path in (scenario / "101").iterdir()} == vehicle
    assert len(list(scenario.glob("*/*"))) == 53
    assert (scenario / "data_protocol.yaml").is_file()


def test_clouds_are_text_with_the_intensity_in_red(
    scenario: Path, sensor_frames_of: SensorFramesOf
) -> None:
    cloud = sensor_frames_of(0)[0].point_cloud
    header, _, body = (scenario / "101" / "000060_lidar.ply").read_text().partition("end_header\n")
    assert header.splitlines()[:3] == [
        "ply",
        "format ascii 1.0",
        f"element vertex {len(cloud.points)}",
    ]
    rows = np.array([line.split() for line in body.splitlines()], dtype=np.float64)
    np.testing.assert_allclose(rows[:, :3], cloud.points * (1, -1, 1), atol=1e-6)
    np.testing.assert_array_equal(rows[:, 3], np.rint(cloud.intensity * 255))
    assert not rows[:, 4:].any()


def test_both_layouts_have_the_same_description(
    scenario: Path, sensor_frames_of: SensorFramesOf
) -> None:
    files = encode_opv2v_frame(sensor_frames_of(0), (), name="000060")
    said = yaml.safe_load((scenario / "101" / "000060.yaml").read_text())
    assert said == yaml.safe_load(files["+101/000060.yaml"])


def test_the_original_layout_is_verified_too(scenario: Path) -> None:
    assert verify_scenario(scenario) == []


def test_one_scenario_has_one_layout(scenario: Path, spec: Spec) -> None:
    identity = identify(spec, format="opv2v")
    with (
        pytest.raises(RunError, match="format: adver_city, opv2v"),
        ScenarioWriter(scenario.parent, spec, identity, length=1),
    ):
        pass


def test_an_unknown_layout_is_refused() -> None:
    with pytest.raises(InputError, match="opv2v or adver_city"):
        find_format("kitti")
