"""Cameras of rigs by calibration files of ROS and Kalibr."""

import logging
from pathlib import Path

import cv2
import numpy as np
import pytest
from advercity_dsl import Camera, Rig

from advercity.compiler import load_library
from advercity.compiler.library import load_declaration
from advercity.errors import InputError

ROS = """\
image_width: 640
image_height: 480
camera_name: front
camera_matrix:
  rows: 3
  cols: 3
  data: [430.5, 0.0, 306.5, 0.0, 450.25, 227.0, 0.0, 0.0, 1.0]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.3, 0.1, 0.001, -0.002, 0.01]
rectification_matrix: {rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}
projection_matrix: {rows: 3, cols: 4, data: [400, 0, 300, 0, 0, 400, 220, 0, 0, 0, 1, 0]}
"""
KALIBR = """\
cam0:
  camera_model: pinhole
  intrinsics: [461.6, 460.1, 362.7, 246.0]
  distortion_model: radtan
  distortion_coeffs: [-0.27, 0.067, 0.0008, 0.0001]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
cam1:
  camera_model: pinhole
  intrinsics: [400.3, 410.1, 373.4, 253.9]
  distortion_model: equidistant
  distortion_coeffs: [-0.0135, 0.0206, -0.0092, 0.00053]
  T_cn_cnm1: [[1, 0, 0, -0.11], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
  timeshift_cam_imu: 0.003
  resolution: [752, 481]
  rostopic: /cam1/image_raw
"""


def load_camera(folder: Path, text: str, more: str = "") -> Camera:
    """Load the camera of a rig that names a calibration with a text."""
    (folder / "calibrations").mkdir(exist_ok=True)
    (folder / "calibrations" / "front.yaml").write_text(text)
    camera = f"{{calibration: calibrations/front.yaml, mounts: [{{z_m: 1.5}}]{more}}}"
    rig = folder / "rig.yaml"
    rig.write_text(f"kind: rig\nid: calibrated\nvehicle:\n  camera: {camera}\n  lidar: {{}}\n")
    declared = load_declaration(rig).declaration
    assert isinstance(declared, Rig)
    assert declared.vehicle is not None
    assert declared.vehicle.camera is not None
    return declared.vehicle.camera


def dump(camera: Camera) -> dict[str, object]:
    assert camera.intrinsics is not None
    return camera.model_dump(include={"width_px", "height_px", "intrinsics", "lens"})


def test_a_camera_has_the_figures_of_a_camera_info_of_ros(tmp_path: Path) -> None:
    camera = load_camera(tmp_path, ROS)
    assert dump(camera) == {
        "width_px": 640,
        "height_px": 480,
        "intrinsics": {"fx_px": 430.5, "fy_px": 450.25, "cx_px": 306.5, "cy_px": 227},
        "lens": {
            "model": "brown_conrady",
            "k1": -0.3,
            "k2": 0.1,
            "p1": 0.001,
            "p2": -0.002,
            "k3": 0.01,
        },
    }
    # Pixels are counted from their middles there, from the corner of the first one here.
    assert camera.centre_px == (307, 227.5)
    # A compiled camera is read again as it is.
    assert Camera.model_validate(camera.model_dump(mode="json")) == camera


def test_a_storage_of_opencv_is_read_as_well(tmp_path: Path) -> None:
    storage = cv2.FileStorage("x.yaml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    storage.write("image_width", 320)
    storage.write("image_height", 200)
    storage.write("camera_matrix", np.array([[210.125, 0, 150], [0, 205, 101], [0, 0, 1.0]]))
    storage.write("distortion_model", "equidistant")
    storage.write("distortion_coefficients", np.array([[0.01, -0.02, 0.003, 0.0]]))
    camera = load_camera(tmp_path, storage.releaseAndGetString())
    assert dump(camera) == {
        "width_px": 320,
        "height_px": 200,
        "intrinsics": {"fx_px": 210.125, "fy_px": 205, "cx_px": 150, "cy_px": 101},
        "lens": {"model": "kannala_brandt", "k1": 0.01, "k2": -0.02, "k3": 0.003},
    }


def test_a_camera_has_the_figures_of_one_of_a_chain_by_kalibr(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING):
        camera = load_camera(tmp_path, KALIBR, ", calibrated_camera: cam1")
    assert dump(camera) == {
        "width_px": 752,
        "height_px": 481,
        "intrinsics": {"fx_px": 400.3, "fy_px": 410.1, "cx_px": 373.4, "cy_px": 253.9},
        "lens": {
            "model": "kannala_brandt",
            "k1": -0.0135,
            "k2": 0.0206,
            "k3": -0.0092,
            "k4": 0.00053,
        },
    }
    # Poses and times are listed by name and line, what has no effect on images is not.
    assert [record.getMessage().partition("yaml:")[2] for record in caplog.records] == [
        "13: left out: T_cn_cnm1; `mounts` of the rig place a camera",
        "14: left out: timeshift_cam_imu; `shutter` of the rig says when rows are exposed",
    ]


@pytest.mark.parametrize(
    ("text", "more", "message"),
    [
        (ROS + "binning_x: 2\n", "", r"front.yaml:15:1: binning_x: no such field"),
        (ROS.replace("image_width", "width"), "", r"front.yaml:1:1"),
        (ROS.replace("plumb_bob", "mei"), "", r"front.yaml:8:19: .*'mei' is not allowed here"),
        (ROS.replace("430.5, 0.0", "430.5, 0.1"), "", r"front.yaml:7:9: .*pixels have no skew"),
        (ROS.replace("0.01]", "0.01, 0, 0.2, 0]"), "", r"front.yaml:12:9: .*more than k1, k2"),
        (ROS.replace("-0.3,", "-30,"), "", r"front.yaml:12:10: .*-30 is outside the range"),
        (ROS.replace("640", "10000"), "", r"rig.yaml:4"),
        (ROS, ", calibrated_camera: cam0", r"rig.yaml:4:.*no camera 'cam0'"),
        (ROS, ", width_px: 640", r"rig.yaml:4:.*width_px: is given by `calibration`, too"),
        (ROS, ", lens: {model: brown_conrady}", r"lens: is given by `calibration`, too"),
        (KALIBR, "", r"rig.yaml:4:.*has 2 cameras; choose one, as `calibrated_camera: cam0`"),
        (KALIBR, ", calibrated_camera: cam2", r"no camera 'cam2'; did you mean 'cam"),
        (
            KALIBR.replace("camera_model: pinhole", "camera_model: omni", 1),
            ", calibrated_camera: cam0",
            r"front.yaml:2:17: .*'omni' is not allowed here",
        ),
        ("- 1\n", "", r"front.yaml:1:1"),
        ("x: &a [1]\ny: !!python/object:os.system 1\n", "", r"front.yaml:2"),
        ("#" * 100_001, "", r"rig.yaml:4:.*is larger than 0.1 MB"),
    ],
)
def test_calibrations_that_are_not_understood_are_refused_by_name(
    tmp_path: Path, text: str, more: str, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        load_camera(tmp_path, text, more)


@pytest.mark.parametrize("file", ["../front.yaml", "/etc/hostname", "calibrations/../../x.yaml"])
def test_calibrations_elsewhere_than_below_the_rig_are_refused(tmp_path: Path, file: str) -> None:
    rig = tmp_path / "rig.yaml"
    camera = f"{{calibration: {file}, mounts: [{{}}]}}"
    rig.write_text(f"kind: rig\nid: away\nvehicle: {{camera: {camera}, lidar: {{}}}}\n")
    with pytest.raises(InputError, match=r"rig.yaml:3:.* is not in the folder of the rig"):
        load_declaration(rig)


def test_calibrations_of_a_library_are_no_declarations(tmp_path: Path) -> None:
    load_camera(tmp_path, ROS)
    rigs = load_library(tmp_path).get_declarations(Rig)
    assert list(rigs) == ["calibrated"]
