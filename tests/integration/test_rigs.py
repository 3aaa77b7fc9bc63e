"""Several kinds of cameras and several LiDARs on a carrier; rigs and bodies of single agents."""

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from advercity_dsl import Spec

from advercity.compiler.crossing import compile_library
from advercity.compiler.explain import explain_spec
from advercity.compiler.library import load_library
from advercity.dataset.overview_images import (
    name_contact_cells,
    write_contact_sheet,
    write_videos,
)
from advercity.dataset.reader import Scenario
from advercity.dataset.verification import verify_dataset
from advercity.errors import InputError
from advercity.geometry import poses
from advercity.pipeline import RunOptions, repair_dataset, run_scenario
from advercity.pipeline.replay import write_recording
from advercity.testing import with_small_sensors
from tests.builders import write_small_library

pytestmark = pytest.mark.sumo

RIG = """
kind: rig
id: two_kinds
vehicle:
  camera: {width_px: 320, height_px: 160, horizontal_fov_deg: 70, mounts: [{z_m: 2}, {yaw_deg: 90}]}
  more_cameras:
    rear:
      width_px: 200
      height_px: 200
      horizontal_fov_deg: 90
      lens: {model: kannala_brandt, k1: -0.02, k2: 0.004}
      mounts: [{yaw_deg: 180}]
  lidar: {mount: {z_m: 3}, channels: 4, azimuths: 64, range_m: 50}
  more_lidars:
    bumper: {mount: {x_m: 2, z_m: 0.5}, channels: 2, azimuths: 32, upper_deg: 5, lower_deg: -5}
"""
SUITE = """
kind: suite
id: small
rig: one_camera
agents: {cav1: two_kinds}
catalogue: one_car
bodies: {cav1: lorry}
looks: shaped
"""


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small library with a lorry, and a rig of two kinds of cameras and two LiDARs."""
    folder = tmp_path_factory.mktemp("rigs") / "library"
    write_small_library(folder, two_kinds=RIG, suite=SUITE)
    with (folder / "catalogue.yaml").open("a") as file:
        file.write("  lorry: {actor_class: truck, length_m: 8, width_m: 2.5, height_m: 3.2}\n")
        file.write(
            "  walker: {actor_class: pedestrian, length_m: 0.4, width_m: 0.6, height_m: 1.7}\n"
        )
    return folder


@pytest.fixture(scope="module")
def spec(library: Path) -> Spec:
    (compiled,) = compile_library(library)
    return compiled


@pytest.fixture(scope="module")
def dataset(spec: Spec, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two frames of the lorry's scenario and a recording of them."""
    root = tmp_path_factory.mktemp("rigged")
    options = RunOptions(
        output=root,
        backend="fake",
        profile="preview",
        scale=0.2,
        frames=slice(0, 2),
        rrd=root / "live.rrd",
    )
    run_scenario(spec, options)
    return root / spec.id


def test_one_agent_has_a_rig_and_a_body_of_its_own(spec: Spec, library: Path) -> None:
    ego, unit = spec.agents
    fields_of_view = [item.model.horizontal_fov_deg for item in ego.sensors.cameras]
    assert fields_of_view == [70, 70, 90]
    assert [lidar.channels for lidar in ego.sensors.lidars] == [4, 2]
    assert (ego.blueprint, len(unit.sensors.cameras), len(unit.sensors.lidars)) == ("lorry", 1, 1)
    origins = {item.path: item.text for item in explain_spec(spec, load_library(library))}
    assert origins["agents.0.sensors.more_lidars.bumper.channels"].startswith(
        f"{library}/two_kinds.yaml:15:"
    )
    assert origins["agents.0.blueprint"].startswith(f"{library}/suite.yaml:7:")


@pytest.mark.parametrize(
    ("written", "message"),
    [
        ("agents: {cav2: two_kinds}", "agents.cav2: no road of the suite has this agent; did you"),
        (
            "agents: {rsu1: two_kinds}",
            "'two_kinds' has no sensors of a roadside_unit, which 'rsu1'",
        ),
        ("agents: {cav1: two_kind}", "agents.cav1: unknown rig 'two_kind'; did you mean 'two_ki"),
        ("bodies: {cav1: lory}", "bodies.cav1: unknown blueprint 'lory'; did you mean 'lorry'?"),
        ("bodies: {rsu1: lorry}", "bodies.rsu1: is a roadside unit of 'lane', which has no body"),
        ("bodies: {cav1: walker}", "is a pedestrian; connected vehicles are cars, vans or trucks"),
    ],
)
def test_rigs_and_bodies_that_do_not_fit_are_refused(
    library: Path, tmp_path: Path, written: str, message: str
) -> None:
    changed = tmp_path / "library"
    shutil.copytree(library, changed)
    suite = f"kind: suite\nid: small\nrig: one_camera\ncatalogue: one_car\n{written}\n"
    (changed / "suite.yaml").write_text(suite)
    with pytest.raises(InputError) as caught:
        compile_library(changed)
    assert message in str(caught.value)


def test_every_camera_and_lidar_has_its_files(dataset: Path) -> None:
    names = {path.name for path in (dataset / "+101").glob("000060*")}
    cameras = {name.partition("_camera")[2] for name in names if "_camera" in name}
    assert cameras == {"0.png", "1.png", "2.png"}
    assert {name for name in names if name.endswith(".pcd")} == {"000060.pcd", "000060_lidar1.pcd"}
    unit = [path.name for path in (dataset / "-1").glob("000060*.pcd")]
    assert unit == ["000060.pcd"]


def test_cameras_and_lidars_are_read_by_their_numbers(dataset: Path, spec: Spec) -> None:
    view = Scenario(dataset)[0]["cav1"]
    assert view.image(0).shape == (32, 64, 3)
    assert view.image(2).shape == (40, 40, 3)
    # Half the width in focal lengths: of a pinhole the tangent, of the fisheye its polynomial.
    off = np.pi / 4
    for camera, half in ((0, np.tan(np.deg2rad(35))), (2, off - 0.02 * off**3 + 0.004 * off**5)):
        matrix = view.intrinsic(camera)
        assert matrix[0, 2] / matrix[0, 0] == pytest.approx(half)
    agent_from_world = np.linalg.inv(view.world_from_agent)
    bumper = (agent_from_world @ view.load_lidar_pose(1))[:3, 3]
    np.testing.assert_allclose(bumper, (2, 0, 0.5), atol=1e-6)
    # At a height over a level road, the lowest beam meets it after the height over its tangent.
    for number, (lidar, height_m) in enumerate(zip(spec.ego.sensors.lidars, (3, 0.5), strict=True)):
        low = view.load_cloud(number)
        low = low[low["ring"] == 0]
        expected_m = height_m / np.tan(np.deg2rad(-lidar.lower_deg))
        distance_m = np.hypot(low["x"], low["y"])
        assert np.median(distance_m) == pytest.approx(expected_m, rel=0.05)
    with pytest.raises(InputError, match="cav1 has LiDARs 0 to 1; there is no LiDAR 2"):
        view.load_cloud(2)


def test_frames_describe_lenses_as_opencv_takes_them(dataset: Path) -> None:
    view = Scenario(dataset)[0]["cav1"]
    front, rear = view.description["camera0"], view.description["camera2"]
    assert "distortion_model" not in front
    assert rear["distortion_model"] == "kannala_brandt"
    points_camera = np.array([(5.0, 2.0, 1.0), (8.0, -5.0, -0.5), (3.0, 0.0, 2.0)])
    points = poses.transform_points(view.world_from_camera(2), points_camera)
    optical = np.stack([-points_camera[:, 1], -points_camera[:, 2], points_camera[:, 0]], axis=1)
    matrix, coefficients = np.array(rear["intrinsic"]), np.array(rear["distortion_coefficients"])
    still = np.zeros(3)
    expected, _ = cv2.fisheye.projectPoints(optical[:, None], still, still, matrix, coefficients)
    found = view.pixels(2, points)
    np.testing.assert_allclose(found[:, :2], expected.reshape(-1, 2), atol=1e-3)
    np.testing.assert_allclose(found[:, 2], points_camera[:, 0], atol=1e-6)


def test_tools_work_with_such_a_rig(dataset: Path, tmp_path: Path) -> None:
    assert verify_dataset(dataset.parent) == []
    write_contact_sheet(dataset, tmp_path / "sheet.png")
    cells = name_contact_cells(Scenario(dataset)[0]["cav1"])
    assert cells == ["left", "front", "rear rear", "semantic front", "LiDAR", "LiDAR bumper"]
    assert len(write_videos(dataset, tmp_path)) == 5
    write_recording(dataset, tmp_path / "again.rrd")
    lost = dataset / "+101" / "000060_lidar1.pcd"
    content = lost.read_bytes()
    lost.unlink()
    assert [problem.path for problem in verify_dataset(dataset.parent)] != []
    assert repair_dataset(dataset) == []
    assert lost.read_bytes() == content


def test_small_sensors_shrink_all_of_them(spec: Spec) -> None:
    sensors = with_small_sensors(spec).agents[0].sensors
    assert {item.model.width_px for item in sensors.cameras} == {16}
    assert {lidar.azimuths for lidar in sensors.lidars} == {16}
