"""Calibration of cameras in the forms of OpenCV and Kalibr.

    <scenario>/<agent>/camera0.yaml     for cv2.FileStorage, and camera_info_manager of ROS
    <scenario>/<agent>/camchain.yaml    of all cameras of the agent, for Kalibr and its readers

In both, the middle of the upper left pixel is (0, 0), half a pixel from its corner, which is (0, 0)
in the dataset. Cameras have optical axes: x right, y down, z ahead; carriers x forward, y left, z
up. Rows of a rolling shutter are exposed `line_delay` seconds one after the other, as in Kalibr,
the first `first_row_time` seconds after the frame's instant.
"""

import logging
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
import yaml
from advercity_dsl.lens import BrownConradyLens, KannalaBrandtLens

from advercity.dataset.agent_view import AgentView
from advercity.dataset.reader import Dataset, Scenario
from advercity.exports.pieces import Piece, PieceFiles
from advercity.exports.registry import Options
from advercity.geometry import poses
from advercity.geometry.poses import Matrix

_logger = logging.getLogger(__name__)

PIXEL_MIDDLE = 0.5
"""Place of the middle of the upper left pixel in the dataset, in pixels."""
MEMORY_YAML = cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY | cv2.FILE_STORAGE_FORMAT_YAML


def list_pieces(dataset: Dataset, options: Options) -> list[Piece]:
    """Make a piece of every scenario: rigs are rigid, so one frame suffices."""
    return [_build_piece(scenario) for scenario in dataset.scenarios if len(scenario)]


def _build_piece(scenario: Scenario) -> Piece:
    name = scenario.path.name

    def write(files: PieceFiles) -> None:
        for frame in files.track([scenario[0]]):
            for view in frame.views.values():
                _write_calibrations(view, f"{name}/{view.agent.id}", files)

    return Piece(name, "rig", name, 1, write)


def _write_calibrations(view: AgentView, folder: str, files: PieceFiles) -> None:
    cameras = range(view.cameras)
    carrier_from_cameras = [_find_optical_pose(view, camera) for camera in cameras]
    for camera, pose in zip(cameras, carrier_from_cameras, strict=True):
        files.write(f"{folder}/camera{camera}.yaml", _format_opencv(view, camera, pose))
    beyond = [camera for camera in cameras if _has_sixth_power(view, camera)]
    if beyond:
        _logger.warning(
            "%s: no camchain.yaml, since Kalibr's `radtan` has no k3, as the lens of camera%d has",
            folder,
            beyond[0],
        )
        return
    files.write(f"{folder}/camchain.yaml", _format_kalibr(view, carrier_from_cameras))


def _find_optical_pose(view: AgentView, camera: int) -> Matrix:
    """Find the pose (4, 4) of a camera's optical axes in its carrier's frame."""
    world_from_carrier = view.find_carrier_pose("camera", camera)
    carrier_from_body = poses.invert_pose(world_from_carrier) @ view.world_from_camera(camera)
    return carrier_from_body @ poses.invert_pose(poses.OPTICAL_FROM_BODY)


def _has_sixth_power(view: AgentView, camera: int) -> bool:
    lens = view.agent.sensors.cameras[camera].model.lens
    return isinstance(lens, BrownConradyLens) and lens.k3 != 0


def _format_opencv(view: AgentView, camera: int, carrier_from_camera: Matrix) -> str:
    model, lens = view.camera_model(camera), view.agent.sensors.cameras[camera].model.lens
    matrix = model.matrix
    matrix[:2, 2] -= PIXEL_MIDDLE
    is_fisheye = isinstance(lens, KannalaBrandtLens)
    coefficients = (0.0,) * 5 if lens is None else lens.coefficients
    storage = cv2.FileStorage(f"camera{camera}.yaml", MEMORY_YAML)
    storage.write("camera_name", f"{view.agent.id}/camera{camera}")
    storage.write("image_width", model.width_px)
    storage.write("image_height", model.height_px)
    storage.write("camera_matrix", matrix)
    storage.write("distortion_model", "equidistant" if is_fisheye else "plumb_bob")
    storage.write("distortion_coefficients", np.array([coefficients]))
    storage.write("carrier_from_camera", carrier_from_camera)
    if _is_rolling(view, camera):
        times_s = view.row_times(camera)
        storage.write("first_row_time", float(times_s[0]))
        storage.write("line_delay", float(times_s[1] - times_s[0]))
    return storage.releaseAndGetString()


def _format_kalibr(view: AgentView, carrier_from_cameras: Sequence[Matrix]) -> str:
    """Format the chain; each camera has its pose from the one before, and from the IMU if any."""
    chain: dict[str, Any] = {}
    for camera, carrier_from_camera in enumerate(carrier_from_cameras):
        camera_from_carrier = poses.invert_pose(carrier_from_camera)
        described = _describe_for_kalibr(view, camera)
        if camera:
            step = camera_from_carrier @ carrier_from_cameras[camera - 1]
            described["T_cn_cnm1"] = step.tolist()
        if view.agent.sensors.imu is not None:
            # The unit is at the origin of its carrier, and stamps are of the same clock; Kalibr
            # takes the stamp of an image for the time of its first row.
            shift_s = float(view.row_times(camera)[0])
            described |= {
                "T_cam_imu": camera_from_carrier.tolist(),
                "timeshift_cam_imu": shift_s,
            }
        chain[f"cam{camera}"] = described
    return yaml.safe_dump(chain, sort_keys=False, default_flow_style=None)


def _describe_for_kalibr(view: AgentView, camera: int) -> dict[str, Any]:
    model, lens = view.camera_model(camera), view.agent.sensors.cameras[camera].model.lens
    principal_point = model.principal_point - PIXEL_MIDDLE
    kind = "equidistant" if isinstance(lens, KannalaBrandtLens) else "radtan"
    return {
        "camera_model": "pinhole",
        "intrinsics": [*model.focal_lengths_px.tolist(), *principal_point.tolist()],
        "distortion_model": "none" if lens is None else kind,
        "distortion_coeffs": [] if lens is None else list(lens.coefficients[:4]),
        "resolution": [model.width_px, model.height_px],
        "rostopic": f"/{view.agent.id}/camera{camera}",
        **_describe_line_delay(view, camera),
    }


def _describe_line_delay(view: AgentView, camera: int) -> dict[str, float]:
    if not _is_rolling(view, camera):
        return {}
    first_s, second_s = view.row_times(camera)[:2].tolist()
    return {"line_delay": second_s - first_s}


def _is_rolling(view: AgentView, camera: int) -> bool:
    return view.agent.sensors.cameras[camera].model.is_rolling
