"""Values common to the messages of MCAP recordings in all schemas."""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from advercity_dsl import Gnss
from numpy.typing import NDArray

from advercity.dataset.agent_view import AgentView
from advercity.geometry.geodesy import SEMI_MAJOR_M
from advercity.geometry.poses import Matrix, to_quaternion
from advercity.sensors.measurements import GnssFix, GnssSolution


@dataclass(frozen=True)
class Stamp:
    """Time and frame of a measurement."""

    time_ns: int
    frame: str


def list_fields(table: NDArray[np.void]) -> Iterator[tuple[str, int, str]]:
    """List name, offset and type of the columns of a point table."""
    for name in table.dtype.names or ():
        fields: Any = table.dtype.fields
        dtype, offset = fields[name][:2]
        yield name, offset, dtype.name


def read_lens(view: AgentView, camera: int, names: Mapping[str, str]) -> tuple[str, list[float]]:
    """Return the name of a camera's distortion and its coefficients, zeros of a pinhole."""
    lens = view.agent.sensors.cameras[camera].model.lens
    if lens is None:
        return names["brown_conrady"], [0.0] * 5
    return names[lens.model], list(lens.coefficients)


@dataclass(frozen=True)
class PositionCovariance:
    """Uncertainty of a fix.

    Attributes:
        matrix: (9,) of east, north and up, in m².
        kind: Source of the covariance, numbered as in ROS and Foxglove: 0 unknown, 1 approximated,
            2 known on the diagonal.
    """

    matrix: list[float]
    kind: int

    @staticmethod
    def of_fix(receiver: Gnss, fix: GnssFix) -> "PositionCovariance":
        """Compute the covariance by the receiver's noise.

        For a fix by satellites it is approximated, as in drivers, by the dilution of precision and
        the error of a range at the zenith. For carrier phases it is unknown.
        """
        m_per_deg, quality = math.radians(SEMI_MAJOR_M), fix.quality
        if receiver.mode == "carla":
            east_m = (
                receiver.longitude_noise_deg * m_per_deg * math.cos(math.radians(fix.latitude_deg))
            )
            north_m = receiver.latitude_noise_deg * m_per_deg
            return _to_covariance(east_m, north_m, receiver.altitude_noise_m, kind=2)
        if receiver.mode == "realistic":
            level_m = math.hypot(receiver.white_noise_m, receiver.wander_m)
            return _to_covariance(level_m, level_m, receiver.vertical_factor * level_m, kind=2)
        if quality is None or quality.solution != GnssSolution.SINGLE:
            return _to_covariance(0.0, 0.0, 0.0, kind=0)
        range_m = math.hypot(receiver.receiver.signal_error_m, receiver.receiver.atmosphere_m)
        level_m = quality.hdop * range_m / math.sqrt(2)
        return _to_covariance(level_m, level_m, quality.vdop * range_m, kind=1)


def _to_covariance(east_m: float, north_m: float, up_m: float, *, kind: int) -> PositionCovariance:
    return PositionCovariance(np.diag([east_m**2, north_m**2, up_m**2]).ravel().tolist(), kind)


def describe_camera(view: AgentView, camera: int) -> dict[str, Any]:
    """Describe size, matrix (9,), rectification (9,) and projection (12,) of a camera."""
    matrix = view.intrinsic(camera)
    projection = np.column_stack([matrix, np.zeros(3)])
    model = view.camera_model(camera)
    return {
        "width": model.width_px,
        "height": model.height_px,
        "k": matrix.ravel().tolist(),
        "r": np.eye(3).ravel().tolist(),
        "p": projection.ravel().tolist(),
    }


def format_pose(pose: Matrix) -> dict[str, dict[str, float]]:
    """Format a pose (4, 4) as position and orientation."""
    return {"position": format_vector(pose[:3, 3]), "orientation": format_quaternion(pose)}


def format_quaternion(pose: Matrix) -> dict[str, float]:
    """Format the rotation of a pose (4, 4)."""
    return dict(zip("wxyz", to_quaternion(pose).tolist(), strict=True))


def format_vector(vector: Iterable[float]) -> dict[str, float]:
    """Format a vector (3,)."""
    return {axis: float(value) for axis, value in zip("xyz", vector, strict=True)}
