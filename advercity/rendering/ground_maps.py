"""Maps of the ground seen from above: wear of the carriageways, and shelter from snow."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from advercity.geometry.arrays import Float64Array
from advercity.geometry.polyline import StationedPolyline, polyline_stations
from advercity.rendering.raycaster import Raycaster, Rays
from advercity.roads.lane_segments import LaneSegment
from advercity.semantics import Semantic
from advercity.world import World

WEAR_TEXEL_M, WEAR_MAX_TEXELS = 0.25, 4096
"""Size of a texel, and texels along a side; a larger site gets larger ones."""
WEAR_MARGIN_M = 2.0
WEAR_SAMPLE_STEP_M = 0.12
"""Less than half a texel, so that none within a lane stays without a sample."""
TYRE_TRACK_M, TYRE_TRACK_SIGMA_M = 0.78, 0.28
"""Lateral distance from a lane's middle to the middle of a tyre's track, and its deviation."""
STAIN_WIDTH_M, STAIN_STRENGTH = 0.35, 0.6
"""Width of the stains in the middle of a lane, and their weight against the polish of tyres."""
NEUTRAL_WEAR, WEAR_STEPS = 128, 127
"""Byte of unworn ground, and bytes from there to fully polished or stained."""

SHELTER_TEXEL_M, SHELTER_MAX_TEXELS = 0.5, 1536
FOLIAGE_SHELTER_FRACTION = 0.6
"""Fraction of falling snow that leaves keep off; everything else keeps off all."""
NO_SURFACE_M = -1e3
"""Height of the uppermost surface where there is none."""


@dataclass(frozen=True, eq=False)
class GroundMap:
    """A map over a rectangle along the world's axes.

    Attributes:
        texels: (h, w) or (h, w, channels), from south to north.
        corner: South-western corner (x, y), metres.
        size: Width and height, metres.
    """

    texels: NDArray[Any]
    corner: tuple[float, float] = (0.0, 0.0)
    size: tuple[float, float] = (1.0, 1.0)

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Corner and inverse size, by which shaders find a point on the map."""
        return (*self.corner, 1.0 / self.size[0], 1.0 / self.size[1])


NO_SHELTER = GroundMap(np.array([[[NO_SURFACE_M, 0.0]]], np.float32))


def build_wear_map(lanes: Sequence[LaneSegment]) -> GroundMap:
    """Map the polish of tyres and the stains between them in every driving lane.

    Texels (h, w) are uint8: above NEUTRAL_WEAR polished, below stained. The mean across a lane is
    neutral, so that wear does not change how bright a road is.
    """
    driven = [_sample_lane(lane) for lane in lanes if lane.kind == "driving"]
    if not driven:
        return GroundMap(np.full((1, 1), NEUTRAL_WEAR, dtype=np.uint8))
    points, wear = (np.concatenate(column) for column in zip(*driven, strict=True))
    low, high = points.min(axis=0) - WEAR_MARGIN_M, points.max(axis=0) + WEAR_MARGIN_M
    texel = max(WEAR_TEXEL_M, float((high - low).max()) / WEAR_MAX_TEXELS)
    width, height = np.ceil((high - low) / texel).astype(int)
    column, row = ((points - low) / texel).astype(int).T
    index = row * width + column
    count = np.bincount(index, minlength=width * height)
    total = np.bincount(index, wear, minlength=width * height)
    mean = (total / np.maximum(count, 1)).clip(-1, 1).reshape(height, width)
    return _place_map(np.round(NEUTRAL_WEAR + WEAR_STEPS * mean).astype(np.uint8), low, texel)


def build_shelter_map(world: World) -> GroundMap:
    """Map the uppermost surface of a world by casting rays straight down.

    Texels (h, w, 2) are float32: its height in metres, and the fraction of snow that it keeps off.
    """
    corners = [(mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)) for mesh in world.static]
    if not corners:
        return NO_SHELTER
    low = np.min([first for first, _ in corners], axis=0).astype(np.float64)
    high = np.max([last for _, last in corners], axis=0).astype(np.float64)
    texel = max(SHELTER_TEXEL_M, float((high - low)[:2].max()) / SHELTER_MAX_TEXELS)
    width, height = np.ceil((high - low)[:2] / texel).astype(int) + 1
    x = low[0] + (np.arange(width) + 0.5) * texel
    y = low[1] + (np.arange(height) + 0.5) * texel
    start = float(high[2]) + 1.0
    origins = np.stack([*np.meshgrid(x, y), np.full((height, width), start)], axis=-1)
    origins = origins.reshape(-1, 3).astype(np.float32)
    down = np.zeros_like(origins)
    down[:, 2] = -1.0
    hits = Raycaster(world).cast(Rays(origins, down), start - float(low[2]) + 1.0)
    top = np.where(np.isfinite(hits.range_m), start - hits.range_m, NO_SURFACE_M)
    sheltered = np.where(hits.semantic == Semantic.VEGETATION, FOLIAGE_SHELTER_FRACTION, 1.0)
    texels = np.stack([top, sheltered], axis=-1).reshape(height, width, 2).astype(np.float32)
    return _place_map(texels, low, texel)


def _place_map(texels: NDArray[Any], low: Float64Array, texel_m: float) -> GroundMap:
    height, width = texels.shape[:2]
    corner, size = (float(low[0]), float(low[1])), (width * texel_m, height * texel_m)
    return GroundMap(texels, corner, size)


def _sample_lane(lane: LaneSegment) -> tuple[Float64Array, Float64Array]:
    """Sample points (n, 2) all over a lane, and their wear (n,) in [-1, 1]."""
    left, right = lane.left[:, :2], lane.right[:, :2]
    middle = (left + right) / 2
    station = polyline_stations(middle)
    along = np.arange(0.0, station[-1], WEAR_SAMPLE_STEP_M)
    edges = [StationedPolyline(side, station).points_at(along) for side in (left, right)]
    width = float(np.linalg.norm(left - right, axis=1).mean())
    fraction = (np.arange(0.0, width, WEAR_SAMPLE_STEP_M) + WEAR_SAMPLE_STEP_M / 2) / width
    points = edges[0][:, None] * (1 - fraction[:, None]) + edges[1][:, None] * fraction[:, None]
    lateral = np.abs(fraction - 0.5) * width
    wear = np.exp(-(((lateral - TYRE_TRACK_M) / TYRE_TRACK_SIGMA_M) ** 2))
    wear -= STAIN_STRENGTH * np.exp(-((lateral / STAIN_WIDTH_M) ** 2))
    wear = np.broadcast_to(wear - wear.mean(), points.shape[:2])
    return points.reshape(-1, 2), wear.reshape(-1)
