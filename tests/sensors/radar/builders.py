"""Radars, targets and scenes for tests."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np
from advercity_dsl import Mount, Radar
from numpy.typing import NDArray

from advercity.frames import Frame
from advercity.geometry.mesh import Mesh
from advercity.geometry.poses import Matrix, pose_matrix
from advercity.randomness import create_generator
from advercity.rendering.raycaster import Raycaster
from advercity.semantics import Semantic
from advercity.sensors.measurements import PointKind, RadarDetections
from advercity.sensors.radar import PlacedRadar, RadarConditions, SceneMotion, scan_radar
from advercity.sensors.radar.scan import RadarMeasurement
from advercity.testing import make_frame
from advercity.world import Body, World

WIDE = Radar(mounts=(Mount(),))
NARROW = Radar(
    azimuth_fov_deg=3,
    azimuth_cell_deg=3,
    elevation_fov_deg=3,
    elevation_cell_deg=3,
    mounts=(Mount(),),
)
"""One beam, so that its rays are a hundredth of a degree apart."""
AT_REST = np.zeros(3)
CLEAR = RadarConditions()


def vary(radar: Radar, **fields: object) -> Radar:
    return Radar.model_validate(radar.model_dump() | fields)


def place(radar: Radar, pose: Matrix, velocity: Sequence[float] = (0, 0, 0)) -> PlacedRadar:
    return PlacedRadar(radar, radar.mounts[0], pose, np.array(velocity, float))


def triangles(vertices: object, rows: object, material: str = "sign_blue") -> Mesh:
    points, corners = np.array(vertices, np.float32), np.array(rows, np.int32)
    return Mesh("target", points, corners, material, Semantic.STATIC)


def plate(edge_m: float, range_m: float, tilt_rad: float = 0.0) -> Mesh:
    """A square of metal ahead, turned about the vertical."""
    half = edge_m / 2
    corners = [
        [range_m + math.sin(tilt_rad) * y, math.cos(tilt_rad) * y, z]
        for y in (-half, half)
        for z in (-half, half)
    ]
    return triangles(corners, [[0, 2, 1], [1, 2, 3]])


def trihedral(edge_m: float, range_m: float, left_m: float = 0.0) -> Mesh:
    """Three right triangles of metal that meet in a corner, which opens towards the radar."""
    opening, ahead = np.ones(3) / math.sqrt(3), np.array([-1.0, 0.0, 0.0])
    x, y, z = np.cross(opening, ahead)
    turn = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    rotation = np.eye(3) + turn + turn @ turn / (1 + opening @ ahead)
    edges = np.vstack([np.zeros(3), edge_m * np.eye(3)]) @ rotation.T
    return triangles(edges + np.array([range_m, left_m, 0]), [[0, 1, 2], [0, 2, 3], [0, 3, 1]])


def sphere(radius_m: float, range_m: float, material: str, opening_rad: float) -> Mesh:
    """The cap of a sphere that faces the radar, up to an angle from its middle."""
    rows, columns = 100, 400
    polar, around = np.meshgrid(
        np.linspace(1e-4, opening_rad, rows + 1),
        np.arange(columns) * 2 * math.pi / columns,
        indexing="ij",
    )
    across = np.sin(polar)
    unit = np.stack([-np.cos(polar), across * np.cos(around), across * np.sin(around)], axis=-1)
    row, column = np.divmod(np.arange(rows * columns), columns)
    first, second = row * columns + column, row * columns + (column + 1) % columns
    inner, outer = (first, first + columns, second), (second, first + columns, second + columns)
    faces = np.concatenate([np.stack(item, axis=1) for item in (inner, outer)])
    return triangles(radius_m * unit.reshape(-1, 3) + np.array([range_m, 0, 0]), faces, material)


def scan(
    radar: Radar,
    *meshes: Mesh,
    frame: Frame | None = None,
    bodies: Mapping[str, Body] = MappingProxyType({}),
    air: RadarConditions = CLEAR,
    pose: Matrix | None = None,
    velocity: Sequence[float] = (0, 0, 0),
    others: Sequence[PlacedRadar] = (),
    key: int = 0,
) -> RadarMeasurement:
    """Measure meshes and actors with a radar, at the origin if no pose is given."""
    caster = Raycaster(World("test", meshes, bodies, lanes=(), network=Path("none")))
    at = frame or make_frame()
    caster.place(at)
    placed = place(radar, pose_matrix((0, 0, 0)) if pose is None else pose, velocity)
    rng = create_generator("test", key)
    return scan_radar(placed, others, caster, SceneMotion(at, bodies), air, rng)


def strongest_dbsm(found: RadarDetections) -> float:
    """Cross-section of the detection with the strongest echo of a surface."""
    surfaces = np.flatnonzero(found.kind == PointKind.SURFACE)
    return float(found.rcs_dbsm[surfaces[found.snr_db[surfaces].argmax()]])


def rows_of(found: RadarDetections, actor: int) -> NDArray[np.intp]:
    """Detections of an actor's surface."""
    return np.flatnonzero((found.instance == actor) & (found.kind == PointKind.SURFACE))
