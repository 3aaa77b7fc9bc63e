"""Lamps as a row of the shaders' table.

A lamp is three texels: position and kind, direction, peak intensity in kcd.
"""

import numpy as np
from numpy.typing import NDArray

from advercity.poses import transform
from advercity.rendering.backend import CameraView
from advercity.rendering.lamps import LitLamp
from advercity_sapien.tables import COLUMNS, KILO

MOST_LAMPS = 32
"""In one picture: those nearest to what the camera looks at."""
LOOKED_AT_M = 20.0


def lamp_row(lamps: list[LitLamp], view: CameraView) -> NDArray[np.float32]:
    """The table's second row, (COLUMNS, 4), with the lamps that matter to a camera."""
    row = np.zeros((COLUMNS, 4), dtype=np.float32)
    if not lamps:
        return row
    looked_at = transform(view.world_from_camera, [LOOKED_AT_M, 0.0, 0.0])
    away_m = np.linalg.norm(np.array([lamp.position for lamp in lamps]) - looked_at, axis=1)
    order = np.argsort(away_m, kind="stable")[:MOST_LAMPS]
    row[0, 0] = len(order)
    for column, index in zip(range(1, COLUMNS, 3), order, strict=False):
        lamp = lamps[index]
        row[column] = *lamp.position, lamp.kind
        row[column + 1, :3] = lamp.facing
        row[column + 2, :3] = np.multiply(lamp.colour, lamp.intensity_cd * KILO)
    return row
