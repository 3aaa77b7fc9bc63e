"""Rooms behind the panes of buildings: the code in their coordinates, and how light passes.

Cameras see a room behind each pane (interior mapping), without triangles; for all other
sensors a building ends at its panes and the walls behind these.
"""

import numpy as np
from numpy.typing import NDArray

from advercity.geometry.arrays import Float64Array

ROOM_NUMBERS = 64
"""Number of different rooms: the fewer, the finer the coordinates resolve a window in float32."""
WINDOW_TRANSMITTANCE = 0.64
"""Transmittance of double glazing, twice: into the room and out of it (0.8 each, EN 410)."""
BLIND_RATIO = 0.6
"""Light of a blind before a lit room relative to its walls': it transmits a quarter of 30 lx, walls
reflect half of it, and panes transmit 85 %."""
SHOP_DAY_RATIO = 0.02
"""Light of a shop's lamps by day relative to its pane's: 150 lx on shelves behind 7.5 klx."""
CURTAIN_FRACTION = 0.17
"""Part of a window's width covered by the curtain at either side."""
MEAN_CLOTH, MEAN_ROOM, MEAN_SHOP = 0.5, 0.43, 0.32
"""Mean albedo of covers; of rooms and shops, times the light of their lamps."""
COVER_DEPTH_M = 0.06
"""Depth of curtains and blinds behind the pane."""
SHOP_SILL_M, TALL_SILL_M, SILL_M = 0.5, 0.15, 0.9
"""Heights of windows above the floor: of shops, above `TALL_WINDOW_M` of height, of others."""
TALL_WINDOW_M = 2.0
ROOM_ASIDE_M, ROOM_ABOVE_M = 0.3, 0.4
"""Least margin of a room next to its window, up to 1 m more, and margin above it."""
ROOM_DEPTH_M, ROOM_DEPTH_SPREAD_M = 3.0, 3.0
"""Depth of the shallowest room, and how much deeper others are at most."""
BLIND_STEPS = 8
"""Heights at which blinds stop, including a whole window."""
NO_COVER, CURTAINS = 0, 1


def code_blinds(lowered: NDArray[np.integer]) -> NDArray[np.integer]:
    """Return the covers (n,) of blinds lowered by a number of steps (n,)."""
    return CURTAINS + lowered


def code_panes(numbers: NDArray[np.integer], covers: NDArray[np.integer]) -> Float64Array:
    """Code coordinates (4 n, 2) of panes with four corners, lower left first, counter-clockwise.

    Each spans the middle half of a unit of both coordinates, so no edge belongs to another.

    Args:
        numbers: (n,) of their rooms, below `ROOM_NUMBERS`.
        covers: (n,) their covers: `NO_COVER`, `CURTAINS` or one of `code_blinds`.
    """
    corners = np.array([(0.25, 0.25), (0.75, 0.25), (0.75, 0.75), (0.25, 0.75)])
    codes = np.column_stack([numbers, covers]).astype(np.float64)
    return (codes[:, None] + corners).reshape(-1, 2)


def mirror_panes(uv: NDArray[np.float32]) -> NDArray[np.float32]:
    """Mirror the coordinates (n, 2) of panes, which keep their rooms and covers."""
    number = np.floor(uv[:, 0])
    return np.column_stack([2 * number + 1 - uv[:, 0], uv[:, 1]])
