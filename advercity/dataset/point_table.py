"""Everything a LiDAR reports of a turn, as a table in NumPy's `.npz`.

Readers of `.pcd` take points at one instant; this has them as they were measured, too, with the
time of each. Unlike there, the frame is right-handed: x forward, y left, z up.
"""

import io
from dataclasses import fields
from pathlib import Path

import numpy as np

from advercity.errors import InputError
from advercity.sensors.lidar import PointCloud


def encode(cloud: PointCloud) -> bytes:
    """The file of a cloud: one array a field; the same cloud gives the same bytes."""
    stream = io.BytesIO()
    columns = {item.name: getattr(cloud, item.name) for item in fields(cloud)}
    np.savez(stream, allow_pickle=False, **columns)
    return stream.getvalue()


def read(path: Path) -> PointCloud:
    """The cloud of a file that `encode` made; InputError if it is something else."""
    try:
        with np.load(path, allow_pickle=False) as data:
            return PointCloud(*(data[item.name] for item in fields(PointCloud)))
    except (OSError, ValueError, KeyError) as error:
        raise InputError(f"{path}: not a point table: {error}") from error
