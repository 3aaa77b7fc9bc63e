"""Radar detections as PCD files, and cubes as compressed arrays.

In both layouts a radar's detections are `<frame>_radar<k>.pcd`, with left-handed `x y z` as in
point clouds. A cube is `<frame>_radar<k>.npz`; its axes are range, azimuth and elevation.
"""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from advercity.array_files import load_arrays
from advercity.dataset.cloud_files import encode_pcd_table
from advercity.errors import InputError, RunError
from advercity.run_options import CloudEncoding
from advercity.sensors.measurements import RadarCube, RadarDetections

RADAR_POINT = np.dtype(
    [
        ("x", "<f4"),
        ("y", "<f4"),
        ("z", "<f4"),
        ("velocity", "<f4"),
        ("rcs", "<f4"),
        ("snr", "<f4"),
        ("object_id", "<i4"),
        ("kind", "<u1"),
    ]
)
"""A detection as it is in the file: metres, m/s away from the radar, dB over 1 m², dB, id of the
actor, and `PointKind`."""
MAX_CUBE_BYTES = 10**9


def encode_detections(
    detections: RadarDetections, encoding: CloudEncoding = "binary_compressed"
) -> bytes:
    """Encode detections as PCD; the same ones give the same bytes."""
    table = np.empty(len(detections.points), RADAR_POINT)
    table["x"], table["y"], table["z"] = detections.points.T
    table["velocity"] = detections.velocity_m_s
    table["rcs"] = detections.rcs_dbsm
    table["snr"] = detections.snr_db
    table["object_id"] = detections.instance
    table["kind"] = detections.kind
    return encode_pcd_table(table, encoding)


def parse_detections(table: NDArray[np.void]) -> RadarDetections:
    """Convert a table (n,) of `RADAR_POINT` in right-handed axes to detections."""
    return RadarDetections(
        points=np.column_stack([table[axis] for axis in "xyz"]),
        velocity_m_s=table["velocity"],
        rcs_dbsm=table["rcs"],
        snr_db=table["snr"],
        instance=table["object_id"],
        kind=table["kind"],
    )


def encode_cube(cube: RadarCube) -> bytes:
    """Encode a cube as `.npz`; the same one gives the same bytes."""
    stream = io.BytesIO()
    np.savez_compressed(stream, power_db=cube.power_db, velocity_m_s=cube.velocity_m_s)
    return stream.getvalue()


def load_cube(path: Path) -> RadarCube:
    """Load a cube; InputError if the file is none."""
    try:
        arrays = load_arrays(path, max_bytes=MAX_CUBE_BYTES)
        return RadarCube(arrays["power_db"], arrays["velocity_m_s"])
    except RunError as error:
        raise InputError(str(error)) from error
    except KeyError as error:
        raise InputError(f"{path}: has no array {error}") from error
