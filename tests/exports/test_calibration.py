"""Calibration files as OpenCV and PyYAML read them: points land where the dataset shows them."""

import logging
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from advercity_dsl import Spec
from advercity_dsl.lens import BrownConradyLens, CameraLens, KannalaBrandtLens

from advercity.compiler import with_digest
from advercity.dataset.agent_view import AgentView
from advercity.dataset.reader import open_dataset
from advercity.exports.exporting import export_dataset
from advercity.geometry import poses
from advercity.geometry.arrays import Float64Array
from advercity.sensors.sensor_frame import SensorFrame
from tests.builders import frame_of, sensor_frame_of, write_scenario

LENSES: dict[str, CameraLens | None] = {
    "cav1": BrownConradyLens(model="brown_conrady", k1=-0.2, k2=0.03, p1=0.001, p2=-0.002),
    "cav2": KannalaBrandtLens(model="kannala_brandt", k1=-0.02, k2=0.003, k3=-0.001, k4=1e-4),
    "cav3": BrownConradyLens(model="brown_conrady", k1=-0.2, k2=0.03, k3=-0.001),
    "rsu1": None,
}
INTRINSICS = {
    "cav1": {"fx_px": 1300, "fy_px": 1150, "cx_px": 880.25, "cy_px": 601},
    "rsu1": {"fx_px": 900, "fy_px": 1000, "cx_px": 0, "cy_px": 1079},
}


@pytest.fixture(scope="module")
def lens_dataset(tmp_path_factory: pytest.TempPathFactory, spec: Spec) -> Path:
    """A frame of agents whose cameras have lenses."""
    document = spec.model_dump(mode="json")
    for agent in document["agents"]:
        lens = LENSES.get(agent["id"])
        if lens is not None:
            agent["sensors"]["camera"]["lens"] = lens.model_dump(mode="json")
        if agent["id"] in INTRINSICS:
            agent["sensors"]["camera"].pop("horizontal_fov_deg", None)
            agent["sensors"]["camera"]["intrinsics"] = INTRINSICS[agent["id"]]
    asking = with_digest(Spec.model_validate(document))

    def sensor_frames(index: int) -> tuple[SensorFrame, ...]:
        frame = frame_of(asking, index)
        return tuple(sensor_frame_of(agent, frame) for agent in asking.agents)

    root = tmp_path_factory.mktemp("lenses")
    write_scenario(root, asking, sensor_frames, frames=1)
    return root


@pytest.fixture(scope="module")
def exported(lens_dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    output = tmp_path_factory.mktemp("calibration") / "out"
    (folder,) = (
        path
        for path in export_dataset("calibration", lens_dataset, output).output.iterdir()
        if path.is_dir()
    )
    return folder


def view_of(dataset: Path, agent: str) -> AgentView:
    return open_dataset(dataset)[0][agent]


def list_seen_points(view: AgentView, camera: int) -> Float64Array:
    """Points (n, 3) of the world 3 to 30 m ahead that the camera shows all over its image."""
    model, rng = view.camera_model(camera), np.random.default_rng(camera)
    pixels = rng.random((200, 2)) * [model.width_px, model.height_px]
    plane = model.plane_from_pixels(model.undistort(pixels))
    rays = np.column_stack([np.ones(200), -plane])
    return poses.transform_points(
        view.world_from_camera(camera), rays * rng.uniform(3.0, 30.0, (200, 1))
    )


def project(points: Float64Array, model: str, matrix: Any, coefficients: Any) -> Float64Array:
    """Project points (n, 3) of a camera's optical axes with OpenCV."""
    still = np.zeros(3)
    function = cv2.fisheye.projectPoints if model == "equidistant" else cv2.projectPoints
    pixels, _ = function(points[:, None], still, still, np.array(matrix), np.array(coefficients))
    return pixels.reshape(-1, 2).astype(np.float64)


@pytest.mark.parametrize("agent", LENSES)
def test_opencv_projects_with_its_files_to_where_the_dataset_shows_a_point(
    agent: str, exported: Path, lens_dataset: Path
) -> None:
    view = view_of(lens_dataset, agent)
    for camera in range(view.cameras):
        path = exported / agent / f"camera{camera}.yaml"
        file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
        points = list_seen_points(view, camera)
        camera_from_world = poses.invert_pose(
            view.world_from_agent @ file.getNode("carrier_from_camera").mat()
        )
        found = project(
            poses.transform_points(camera_from_world, points),
            file.getNode("distortion_model").string(),
            file.getNode("camera_matrix").mat(),
            file.getNode("distortion_coefficients").mat(),
        )
        # OpenCV counts from the middle of the upper left pixel.
        np.testing.assert_allclose(found + 0.5, view.pixels(camera, points)[:, :2], atol=1e-3)
        height, width = view.image(camera).shape[:2]
        size = [file.getNode(f"image_{side}").real() for side in ("width", "height")]
        assert size == [width, height]


@pytest.mark.parametrize("agent", ["cav1", "cav2", "rsu1"])
def test_a_chain_for_kalibr_leads_from_camera_to_camera(
    agent: str, exported: Path, lens_dataset: Path
) -> None:
    view = view_of(lens_dataset, agent)
    chain: dict[str, Any] = yaml.safe_load((exported / agent / "camchain.yaml").read_text())
    assert list(chain) == [f"cam{camera}" for camera in range(view.cameras)]
    optical = poses.OPTICAL_FROM_BODY @ poses.invert_pose(view.world_from_camera(0))
    for camera, described in enumerate(chain.values()):
        if camera:
            optical = np.array(described["T_cn_cnm1"]) @ optical
        points = list_seen_points(view, camera)
        in_camera = poses.transform_points(optical, points)
        focal_x, focal_y, column, row = described["intrinsics"]
        matrix = [[focal_x, 0, column], [0, focal_y, row], [0, 0, 1]]
        # Kalibr's models are OpenCV's with four coefficients, or none.
        coefficients = described["distortion_coeffs"] or [0.0] * 4
        found = project(in_camera, described["distortion_model"], matrix, coefficients)
        np.testing.assert_allclose(found + 0.5, view.pixels(camera, points)[:, :2], atol=1e-3)
        if view.agent.sensors.imu is not None:
            carrier = poses.transform_points(poses.invert_pose(view.world_from_agent), points)
            by_imu = poses.transform_points(np.array(described["T_cam_imu"]), carrier)
            np.testing.assert_allclose(by_imu, in_camera, atol=1e-3)


def test_a_lens_that_kalibr_cannot_describe_has_no_chain(
    lens_dataset: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING):
        folder = export_dataset("calibration", lens_dataset, tmp_path / "out").output
    assert "cav3: no camchain.yaml, since Kalibr's `radtan` has no k3" in caplog.text
    assert not list(folder.glob("*/cav3/camchain.yaml"))
    assert list(folder.glob("*/cav3/camera0.yaml"))
