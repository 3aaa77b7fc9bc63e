"""Things close above the ground, seen from above: little of the sky's light is left below.

Probes are too far apart for the dark under a car, and the image shows too little of it. From the
ground under an actor's box, or under static things such as parked cars and benches, a fraction of
the sky is hidden. It falls off at the outline: fast by the gap below, slowly by the sides.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from advercity.frames import Frame
from advercity.rendering.raycaster import Raycaster, Rays
from advercity.semantics import Semantic
from advercity.world import World
from advercity_sapien.light_probes import LightProbes
from advercity_sapien.probe_grid import GROUND_CLASSES, select_static

TEXEL_M, MAX_TEXELS = 0.2, 1536
CLEARANCE_M = 0.6
"""Largest gap below static things that still darken the ground."""
REACH_M = 2.0 * CLEARANCE_M
STANDING_M = 0.01
"""Greatest depth under the ground of a standing thing's lower face."""
PLANTS = (Semantic.VEGETATION,)
GAP_HIDES, GAP_BLUR_M = 0.92, 0.15
"""Fraction of the sky hidden by a body from the ground under it, and softness of its outline."""
SIDES_HIDE, SIDES_BLUR_M = 0.4, 0.9
"""The same for its sides and the ground around it."""


class ContactMap:
    """Fraction of the sky's light, 0 to 255, left on the ground by things on it.

    Attributes:
        texels: (h, w) uint8 over the extent of the probes, for the latest frame placed.
    """

    def __init__(self, world: World, probes: LightProbes) -> None:
        self._corner = np.array(probes.corner)
        width, height = probes.size
        self._texel_m = max(TEXEL_M, max(width, height) / MAX_TEXELS)
        columns, rows = (max(1, round(length / self._texel_m)) for length in (width, height))
        self._static = np.zeros((rows, columns), dtype=np.float32)
        if rows > 1:
            low = _find_low_things(world, probes, rows // 2, columns // 2)
            self._static = cv2.resize(low, (columns, rows))
        self.texels: NDArray[np.uint8] = np.full((rows, columns), 255, dtype=np.uint8)

    def place(self, frame: Frame) -> None:
        """Draw the actors of a frame."""
        if self.texels.size == 1:
            return
        covered = self._static.copy()
        for state in frame.states:
            # OpenCV fills all pixels touched by an outline.
            length, width = (max(0.0, size - self._texel_m) for size in state.actor.size[:2])
            corners = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) * (length / 2.0, width / 2.0)
            world = corners @ state.world_from_body[:2, :2].T + state.world_from_body[:2, 3]
            # OpenCV's shapes have coordinates in sixteenths of a pixel here, from pixels' middles.
            texels = (world - self._corner) / self._texel_m - 0.5
            points = np.round(texels * 16.0).astype(np.int32)
            cv2.fillConvexPoly(covered, points, 1.0, lineType=cv2.LINE_AA, shift=4)
        gap, sides = (
            cv2.GaussianBlur(covered, (0, 0), blur_m / self._texel_m)
            for blur_m in (GAP_BLUR_M, SIDES_BLUR_M)
        )
        left = (1.0 - GAP_HIDES * gap) * (1.0 - SIDES_HIDE * sides)
        self.texels = np.round(255.0 * left).astype(np.uint8)


def _find_low_things(
    world: World, probes: LightProbes, rows: int, columns: int
) -> NDArray[np.float32]:
    """Find where static things are close above the ground (rows, columns): 1, elsewhere 0."""
    x = probes.corner[0] + (np.arange(columns) + 0.5) * probes.size[0] / columns
    y = probes.corner[1] + (np.arange(rows) + 0.5) * probes.size[1] / rows
    height_m = cv2.resize(probes.ground, (columns, rows))
    origins = np.stack([*np.meshgrid(x, y), height_m + CLEARANCE_M], axis=-1)
    origins = origins.reshape(-1, 3).astype(np.float32)
    down = np.broadcast_to(np.array([0.0, 0.0, -1.0], np.float32), origins.shape)
    # Low plants cover whole fields, and are lit as ground is.
    things = Raycaster(select_static(world, *set(Semantic).difference(GROUND_CLASSES, PLANTS)))
    ground = Raycaster(select_static(world, *GROUND_CLASSES)).cast(Rays(origins, down), REACH_M)
    below, above = (things.cast(Rays(origins, way), REACH_M) for way in (down, -down))
    # A thing standing on the ground has a face in the ground's plane.
    is_low = np.isfinite(below.range_m) & (below.range_m < ground.range_m + STANDING_M)
    is_low |= (above.range_m < CLEARANCE_M) & (above.semantic == Semantic.VEHICLE)
    return is_low.reshape(rows, columns).astype(np.float32)
