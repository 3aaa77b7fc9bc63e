"""What keeps falling snow off the ground, as a map seen from above."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from advercity.rendering.casting import Caster, Rays
from advercity.semantics import Semantic
from advercity.world.scene import World

TEXEL_M = 0.5
LARGEST = 1536
"""Texels along a side; a larger site gets larger ones."""
LEAVES_SHELTER = 0.6
"""Share of the snow that leaves keep; everything else keeps all."""
DEEP_M = -1e3


@dataclass(frozen=True, eq=False)
class ShelterMap:
    """How high the uppermost surface is, and how well it shelters what lies below.

    Attributes:
        texels: (h, w, 2) float32 from south to north: height in metres, share of snow kept off.
        corner: South-western corner (x, y), metres.
        size: Width and height, metres.
    """

    texels: NDArray[np.float32]
    corner: tuple[float, float]
    size: tuple[float, float]


NO_SHELTER = ShelterMap(np.array([[[DEEP_M, 0.0]]], np.float32), (0.0, 0.0), (1.0, 1.0))


def shelter_map(world: World) -> ShelterMap:
    """What stands in a world, as rays that fall straight down meet it."""
    corners = [(mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)) for mesh in world.static]
    if not corners:
        return NO_SHELTER
    low = np.min([first for first, _ in corners], axis=0).astype(np.float64)
    high = np.max([last for _, last in corners], axis=0).astype(np.float64)
    texel = max(TEXEL_M, float((high - low)[:2].max()) / LARGEST)
    width, height = np.ceil((high - low)[:2] / texel).astype(int) + 1
    x = low[0] + (np.arange(width) + 0.5) * texel
    y = low[1] + (np.arange(height) + 0.5) * texel
    above = float(high[2]) + 1.0
    origins = np.stack([*np.meshgrid(x, y), np.full((height, width), above)], axis=-1)
    origins = origins.reshape(-1, 3).astype(np.float32)
    down = np.zeros_like(origins)
    down[:, 2] = -1.0
    hits = Caster(world).cast(Rays(origins, down), above - float(low[2]) + 1.0)
    met = np.isfinite(hits.range_m)
    top = np.where(met, above - hits.range_m, DEEP_M)
    kept = np.where(hits.semantic == Semantic.VEGETATION, LEAVES_SHELTER, 1.0)
    return ShelterMap(
        np.stack([top, kept], axis=-1).reshape(height, width, 2).astype(np.float32),
        (float(low[0]), float(low[1])),
        (float(width * texel), float(height * texel)),
    )
