"""Where tyres have polished a roadway and dripped on it, as a map seen from above.

What keeps falling snow off the ground, as a map seen from above.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from advercity.rendering.raycaster import Raycaster, Rays
from advercity.roads.lane_segments import LaneSegment
from advercity.semantics import Semantic
from advercity.world import World

WEAR_TEXEL_M = 0.25
WEAR_MARGIN_M = 2.0
WEAR_SAMPLE_STEP_M = 0.12
WEAR_MAX_TEXELS = 4096
"""Texels along a side; a larger site gets larger ones."""
TYRE_TRACK_M, TYRE_TRACK_SIGMA_M = 0.78, 0.28
"""From a lane's middle to where tyres run, and the spread of it."""
NEUTRAL_WEAR = 128


@dataclass(frozen=True, eq=False)
class WearMap:
    """How worn the ground is.

    Attributes:
        texels: (h, w) uint8 from south to north: above 128 polished, below stained.
        corner: South-western corner (x, y), metres.
        size: Width and height, metres.
    """

    texels: NDArray[np.uint8]
    corner: tuple[float, float]
    size: tuple[float, float]


def build_wear_map(lanes: Sequence[LaneSegment]) -> WearMap:
    """Tracks of the tyres in every driving lane; across a lane, they are 0 in the mean."""
    driven = [_sample_lane(lane) for lane in lanes if lane.kind == "driving"]
    if not driven:
        return WearMap(np.full((1, 1), NEUTRAL_WEAR, dtype=np.uint8), (0.0, 0.0), (1.0, 1.0))
    points, wear = (np.concatenate(column) for column in zip(*driven, strict=True))
    low, high = points.min(axis=0) - WEAR_MARGIN_M, points.max(axis=0) + WEAR_MARGIN_M
    texel = max(WEAR_TEXEL_M, float((high - low).max()) / WEAR_MAX_TEXELS)
    width, height = np.ceil((high - low) / texel).astype(int)
    column, row = ((points - low) / texel).astype(int).T
    place = row * width + column
    count = np.bincount(place, minlength=width * height)
    total = np.bincount(place, wear, minlength=width * height)
    mean = total / np.maximum(count, 1)
    texels = np.round(NEUTRAL_WEAR + 127 * mean.clip(-1, 1)).astype(np.uint8).reshape(height, width)
    return WearMap(
        texels, (float(low[0]), float(low[1])), (float(width * texel), float(height * texel))
    )


def _sample_lane(lane: LaneSegment) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points (n, 2) all over a lane, and how worn they are (n,), in [-1, 1]."""
    left, right = lane.left[:, :2], lane.right[:, :2]
    middle = (left + right) / 2
    station = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(middle, axis=0), axis=1))])
    along = np.arange(0.0, station[-1], WEAR_SAMPLE_STEP_M)
    edges = [
        np.stack([np.interp(along, station, side[:, axis]) for axis in (0, 1)], axis=-1)
        for side in (left, right)
    ]
    width = float(np.linalg.norm(left - right, axis=1).mean())
    share = (np.arange(0.0, width, WEAR_SAMPLE_STEP_M) + WEAR_SAMPLE_STEP_M / 2) / width
    points = edges[0][:, None] * (1 - share[:, None]) + edges[1][:, None] * share[:, None]
    aside = np.abs(share - 0.5) * width
    wear = np.exp(-(((aside - TYRE_TRACK_M) / TYRE_TRACK_SIGMA_M) ** 2))
    wear -= 0.6 * np.exp(-((aside / 0.35) ** 2))
    wear = np.broadcast_to(wear - wear.mean(), points.shape[:2])
    return points.reshape(-1, 2), wear.reshape(-1)


SHELTER_TEXEL_M = 0.5
SHELTER_MAX_TEXELS = 1536
"""Texels along a side; a larger site gets larger ones."""
FOLIAGE_SHELTER_FRACTION = 0.6
"""Share of the snow that leaves keep; everything else keeps all."""
NO_SURFACE_M = -1e3


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


NO_SHELTER = ShelterMap(np.array([[[NO_SURFACE_M, 0.0]]], np.float32), (0.0, 0.0), (1.0, 1.0))


def build_shelter_map(world: World) -> ShelterMap:
    """What stands in a world, as rays that fall straight down meet it."""
    corners = [(mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)) for mesh in world.static]
    if not corners:
        return NO_SHELTER
    low = np.min([first for first, _ in corners], axis=0).astype(np.float64)
    high = np.max([last for _, last in corners], axis=0).astype(np.float64)
    texel = max(SHELTER_TEXEL_M, float((high - low)[:2].max()) / SHELTER_MAX_TEXELS)
    width, height = np.ceil((high - low)[:2] / texel).astype(int) + 1
    x = low[0] + (np.arange(width) + 0.5) * texel
    y = low[1] + (np.arange(height) + 0.5) * texel
    above = float(high[2]) + 1.0
    origins = np.stack([*np.meshgrid(x, y), np.full((height, width), above)], axis=-1)
    origins = origins.reshape(-1, 3).astype(np.float32)
    down = np.zeros_like(origins)
    down[:, 2] = -1.0
    hits = Raycaster(world).cast(Rays(origins, down), above - float(low[2]) + 1.0)
    met = np.isfinite(hits.range_m)
    top = np.where(met, above - hits.range_m, NO_SURFACE_M)
    kept = np.where(hits.semantic == Semantic.VEGETATION, FOLIAGE_SHELTER_FRACTION, 1.0)
    return ShelterMap(
        np.stack([top, kept], axis=-1).reshape(height, width, 2).astype(np.float32),
        (float(low[0]), float(low[1])),
        (float(width * texel), float(height * texel)),
    )
