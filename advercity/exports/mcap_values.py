"""What messages of MCAP recordings have in common, whichever their schemas are."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from advercity.dataset.agent_view import AgentView
from advercity.geometry.poses import Matrix, to_quaternion


@dataclass(frozen=True)
class Stamp:
    """When and in which frame something was measured."""

    time_ns: int
    frame: str


def list_fields(table: NDArray[np.void]) -> Iterator[tuple[str, int, str]]:
    """List name, offset and type of the columns of a point table."""
    for name in table.dtype.names or ():
        fields: Any = table.dtype.fields
        dtype, offset = fields[name][:2]
        yield name, offset, dtype.name


def read_lens(view: AgentView, camera: int, names: Mapping[str, str]) -> tuple[str, list[float]]:
    """Return the name of a camera's distortion and its coefficients; none of a pinhole."""
    lens = view.agent.sensors.cameras[camera].camera.lens
    return ("", []) if lens is None else (names[lens.model], list(lens.coefficients))


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
