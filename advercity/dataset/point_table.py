"""Points as a turning LiDAR measured them, in NumPy's `.npz`; only where the rig lets it turn.

Readers of `.pcd` take points at one instant, so that is what they get. This has the same points, in
the same order, each where the moving sensor saw it and when. Unlike there, the frame is
right-handed: x forward, y left, z up.
"""

import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from advercity.errors import InputError
from advercity.sensors.lidar import PointCloud


def encode(cloud: PointCloud) -> bytes:
    """The file of a cloud; the same cloud gives the same bytes."""
    stream = io.BytesIO()
    np.savez(stream, allow_pickle=False, raw=cloud.raw, time_s=cloud.time_s)
    return stream.getvalue()


def read(path: Path) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Points (n, 3) as measured, and the time (n,) of each against the frame's, in seconds.

    Raises:
        InputError: The file is not one that `encode` made.
    """
    try:
        with np.load(path, allow_pickle=False) as data:
            return data["raw"], data["time_s"]
    except (OSError, ValueError, KeyError) as error:
        raise InputError(f"{path}: not a point table: {error}") from error
