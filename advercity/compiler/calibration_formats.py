"""Formats of camera calibrations: ROS's camera_info, also as OpenCV stores it, and Kalibr's chains.

https://wiki.ros.org/camera_calibration_parsers
https://github.com/ethz-asl/kalibr/wiki/yaml-formats
"""

from typing import Annotated, Any, Literal, Self

from advercity_dsl.base import InvalidCombination, Items, Model
from advercity_dsl.lens import Coefficient, FocalLength, PrincipalPoint
from advercity_dsl.units import Count, Number
from pydantic import Field, model_validator

LENSES = {
    "plumb_bob": ("brown_conrady", ("k1", "k2", "p1", "p2", "k3")),
    "rational_polynomial": ("brown_conrady", ("k1", "k2", "p1", "p2", "k3")),
    "radtan": ("brown_conrady", ("k1", "k2", "p1", "p2")),
    "equidistant": ("kannala_brandt", ("k1", "k2", "k3", "k4")),
}
"""Model of a rig's lens, and the names of its coefficients, by the calibration's name for it."""
_POSE = "`mounts` of the rig place a camera"
_READOUT = "`shutter` of the rig says when rows are exposed"
LEFT_OUT = {
    **dict.fromkeys(("T_cam_imu", "T_cn_cnm1", "carrier_from_camera"), _POSE),
    **dict.fromkeys(("first_row_time", "line_delay", "timeshift_cam_imu"), _READOUT),
}
"""Keys without effect, and the rig's replacement for each."""
Coefficients = Annotated[Items[Coefficient], Field(max_length=14)]


class Matrix(Model):
    """A matrix, row by row."""

    rows: Count
    cols: Count
    dt: Literal["d", "f"] = "d"
    data: Annotated[Items[Number], Field(max_length=16)]


class CoefficientRow(Matrix):
    """Coefficients of a lens."""

    data: Coefficients


class CameraInfo(Model):
    """A camera as `camera_calibration` of ROS writes it."""

    image_width: Count
    image_height: Count
    camera_name: Any = None
    camera_matrix: Matrix
    distortion_model: Literal["plumb_bob", "rational_polynomial", "equidistant"]
    distortion_coefficients: CoefficientRow
    rectification_matrix: Any = None
    """Matrix of rectified images, as the next one."""
    projection_matrix: Any = None
    carrier_from_camera: Any = None
    first_row_time: Any = None
    line_delay: Any = None

    @model_validator(mode="after")
    def _check_matrix(self) -> Self:
        data = self.camera_matrix.data
        if len(data) != 9 or (*data[1:2], data[3], *data[6:]) != (0, 0, 0, 0, 1):
            message = "is not [fx, 0, cx, 0, fy, cy, 0, 0, 1]"
            raise InvalidCombination(("camera_matrix", "data"), message, "pixels have no skew here")
        return self

    @model_validator(mode="after")
    def _check_lens(self) -> Self:
        place = ("distortion_coefficients", "data")
        _check_coefficients(self.distortion_model, self.distortion_coefficients.data, place)
        return self

    def to_camera(self) -> dict[str, Any]:
        """Return the known data of a rig's camera."""
        across, _, column, _, down, row, *_ = self.camera_matrix.data
        size = (self.image_width, self.image_height)
        lens = _build_lens(self.distortion_model, self.distortion_coefficients.data)
        return _build_camera(size, (across, down, column, row), lens)


class KalibrCamera(Model):
    """A camera of a chain written by Kalibr."""

    camera_model: Literal["pinhole"]
    intrinsics: tuple[FocalLength, FocalLength, PrincipalPoint, PrincipalPoint]
    distortion_model: Literal["radtan", "equidistant", "none"]
    distortion_coeffs: Coefficients
    resolution: tuple[Count, Count]
    rostopic: Any = None
    cam_overlaps: Any = None
    T_cn_cnm1: Any = None
    T_cam_imu: Any = None
    timeshift_cam_imu: Any = None
    line_delay: Any = None

    @model_validator(mode="after")
    def _check_lens(self) -> Self:
        _check_coefficients(self.distortion_model, self.distortion_coeffs, ("distortion_coeffs",))
        return self

    def to_camera(self) -> dict[str, Any]:
        """Return the known data of a rig's camera."""
        lens = _build_lens(self.distortion_model, self.distortion_coeffs)
        return _build_camera(self.resolution, self.intrinsics, lens)


def _check_coefficients(model: str, values: tuple[float, ...], place: tuple[str, ...]) -> None:
    names = LENSES[model][1] if model in LENSES else ()
    if any(values[len(names) :]):
        message = f"has more than {', '.join(names)}" if names else "is not empty"
        hint = "calibrate without them, as a rig's lens has none"
        raise InvalidCombination(place, message, hint)


def _build_lens(model: str, values: tuple[float, ...]) -> dict[str, Any] | None:
    if model not in LENSES or (LENSES[model][0] == "brown_conrady" and not any(values)):
        return None
    name, coefficients = LENSES[model]
    # Files may have fewer: the others are 0.
    return {"model": name, **dict(zip(coefficients, values, strict=False))}


def _build_camera(
    size: tuple[int, int],
    intrinsics: tuple[float, float, float, float],
    lens: dict[str, Any] | None,
) -> dict[str, Any]:
    names = ("fx_px", "fy_px", "cx_px", "cy_px")
    camera = dict(zip(("width_px", "height_px"), size, strict=True))
    camera |= {"intrinsics": dict(zip(names, intrinsics, strict=True))}
    return camera if lens is None else camera | {"lens": lens}


Calibration = CameraInfo | KalibrCamera
