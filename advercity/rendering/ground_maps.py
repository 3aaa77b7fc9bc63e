"""Maps of the ground seen from above: wear of the carriageways, and shelter from snow."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from advercity.geometry.arrays import Float64Array
from advercity.physics.atmosphere import Atmosphere
from advercity.randomness import create_generator
from advercity.rendering.cover import MAX_HEIGHT_M, select_decks
from advercity.rendering.raycaster import Raycaster, Rays
from advercity.roads.lane_segments import LaneSegment
from advercity.semantics import Semantic
from advercity.world import World

WEAR_TEXEL_M, WEAR_MAX_TEXELS = 0.25, 4096
"""Size of a texel, and texels along a side; a larger site gets larger ones."""
WEAR_MARGIN_M = 2.0
WEAR_SAMPLE_STEP_M = 0.12
"""Less than half a texel, so every texel within a lane has a sample."""
TYRE_TRACK_M, TYRE_TRACK_SIGMA_M = 0.78, 0.28
"""Lateral distance from a lane's middle to the middle of a tyre's track, and its deviation."""
TYRE_DARKENING, OIL_DARKENING = 0.25, 0.20
"""Greatest reductions of the albedo by rubber and by oil."""
OIL_WIDTH_M, OIL_BEFORE_STOPS, STOP_RANGE_M = 0.30, 1.4, 14.0
"""Width of the line of oil in the middle of a lane, its increase where vehicles wait at the end of
a lane, and the length of this part."""
PAVING_TONE = 0.07
"""Greatest difference of the albedo of a paving pass, which is a lane, from the mean."""
JUNCTION_WEAR = 0.8
"""Wear by one path through a junction, over the wear of a lane, used by all vehicles."""
NEUTRAL_WEAR, WEAR_STEPS = 128, 127
"""Byte of unworn ground, and bytes from there to fully polished or stained."""
WEAR_TONE = 0.5
"""Change of the albedo by `WEAR_STEPS`."""

SHELTER_TEXEL_M, SHELTER_MAX_TEXELS = 0.5, 1536
FOLIAGE_SHELTER_FRACTION = 0.6
"""Fraction of falling snow kept off by leaves; everything else keeps off all."""
NO_SURFACE_M = -1e3
"""Height for places without a surface."""


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
        """Corner and inverse size, for finding a point on the map in shaders."""
        return (*self.corner, 1.0 / self.size[0], 1.0 / self.size[1])


NO_SHELTER = GroundMap(np.array([[[NO_SURFACE_M, 0.0, NO_SURFACE_M, 0.0]]], np.float32))


def build_wear_map(lanes: Sequence[LaneSegment]) -> GroundMap:
    """Map the wear of carriageways by traffic.

    Texels (h, w, 2) are uint8: how much tyres polish, and the tone, as changes of the albedo of
    which `WEAR_STEPS` are `WEAR_TONE`. The mean of the polish across a lane is neutral, and so is
    the mean tone over all lanes: wear does not change how bright roads are.
    """
    driven = [_sample_lane(lane) for lane in lanes if lane.kind == "driving"]
    if not driven:
        return GroundMap(np.full((1, 1, 2), NEUTRAL_WEAR, dtype=np.uint8))
    points = np.concatenate([samples[:, :2] for samples in driven])
    low, high = points.min(axis=0) - WEAR_MARGIN_M, points.max(axis=0) + WEAR_MARGIN_M
    texel = max(WEAR_TEXEL_M, float((high - low).max()) / WEAR_MAX_TEXELS)
    width, height = np.ceil((high - low) / texel).astype(int)
    size = width * height
    numbered = [_average_by_texel(samples, low, texel, width) for samples in driven]
    index, values = (np.concatenate(column) for column in zip(*numbered, strict=True))
    count = np.bincount(index, minlength=size)
    is_driven = count > 0
    # Where paths cross, the greatest wear shows.
    polish, tyres, oil = (_map_greatest(index, values[:, k], size) for k in range(3))
    paving = np.bincount(index, values[:, 3], minlength=size) / np.maximum(count, 1)
    tone = paving - TYRE_DARKENING * tyres - OIL_DARKENING * oil
    tone -= tone[is_driven].mean()
    texels = np.stack([polish, tone / WEAR_TONE], axis=-1) * is_driven[:, None]
    texels = np.round(NEUTRAL_WEAR + WEAR_STEPS * texels.clip(-1, 1)).astype(np.uint8)
    return _place_map(texels.reshape(height, width, 2), low, texel)


def needs_shelter_map(world: World, atmosphere: Atmosphere) -> bool:
    """Return whether snow lies, or a deck keeps rain off."""
    return atmosphere.snow_depth_m > 0.0 or bool(select_decks(world.static))


def build_shelter_map(world: World) -> GroundMap:
    """Map the uppermost surface of a world by casting rays straight down.

    Texels (h, w, 4) are float32: its height in metres, the fraction of snow kept off by it, the
    height below which a deck keeps off rain as well, and 0.
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
    covered = _find_undersides(world, origins)
    columns = [top, sheltered, covered, np.zeros_like(top)]
    texels = np.stack(columns, axis=-1).reshape(height, width, 4).astype(np.float32)
    return _place_map(texels, low, texel)


def _find_undersides(world: World, places: NDArray[np.float32]) -> NDArray[np.float32]:
    """Find the heights (n,) of the lowest deck over places (n, 3)."""
    decks = select_decks(world.static)
    if not decks:
        return np.full(len(places), NO_SURFACE_M, np.float32)
    low = min(float(mesh.vertices[:, 2].min()) for mesh in decks) - 1.0
    origins = np.column_stack([places[:, :2], np.full(len(places), low)]).astype(np.float32)
    up = np.tile(np.array([0.0, 0.0, 1.0], np.float32), (len(places), 1))
    only = World(world.id, tuple(decks), {}, (), world.network)
    reach_m = Raycaster(only).cast(Rays(origins, up), MAX_HEIGHT_M).range_m
    return np.where(np.isfinite(reach_m), low + reach_m, NO_SURFACE_M).astype(np.float32)


def _place_map(texels: NDArray[Any], low: Float64Array, texel_m: float) -> GroundMap:
    height, width = texels.shape[:2]
    corner, size = (float(low[0]), float(low[1])), (width * texel_m, height * texel_m)
    return GroundMap(texels, corner, size)


def _average_by_texel(
    samples: Float64Array, low: Float64Array, texel_m: float, width: int
) -> tuple[NDArray[np.int64], Float64Array]:
    """Average samples of a lane: the numbers of their texels (n,), and means (n, 4)."""
    column, row = ((samples[:, :2] - low) / texel_m).astype(np.int64).T
    index, inverse, count = np.unique(row * width + column, return_inverse=True, return_counts=True)
    sums = [np.bincount(inverse.ravel(), value) for value in samples[:, 2:].T]
    return index, np.stack(sums, axis=-1) / count[:, None]


def _map_greatest(index: NDArray[np.int64], values: Float64Array, size: int) -> Float64Array:
    """Map the greatest of the values (n,) of each texel (size,); 0 in texels without values."""
    order = np.lexsort((values, index))
    last = np.append(np.flatnonzero(np.diff(index[order])), len(order) - 1)
    greatest = np.zeros(size)
    greatest[index[order[last]]] = values[order[last]]
    return greatest


def _sample_lane(lane: LaneSegment) -> Float64Array:
    """Sample points all over a lane.

    Rows (n, 6) are x, y, polish by tyres less its mean, polish, oil, and tone of the paving.
    """
    width, step = lane.width_m, WEAR_SAMPLE_STEP_M
    along = np.arange(0.0, lane.length_m, step)
    fraction = (np.arange(0.0, width, step) + step / 2) / width
    points = lane.points_at(along[:, None], fraction)[..., :2]
    lateral = np.abs(fraction - 0.5) * width
    tyres = np.exp(-(((lateral - TYRE_TRACK_M) / TYRE_TRACK_SIGMA_M) ** 2))
    oil = np.exp(-((lateral / OIL_WIDTH_M) ** 2))
    waiting = 1 + OIL_BEFORE_STOPS * np.exp(-(lane.length_m - along) / STOP_RANGE_M)
    paving = 0.0 if lane.in_junction else create_generator("paving", lane.id).uniform(-1, 1)
    dripped = 0.0 if lane.in_junction else waiting
    columns = (
        *np.moveaxis(points, -1, 0),
        tyres - tyres.mean(),
        tyres * (JUNCTION_WEAR if lane.in_junction else 1.0),
        np.multiply.outer(dripped * np.ones(len(along)), oil),
        PAVING_TONE * paving,
    )
    return np.stack([np.broadcast_to(c, points.shape[:2]) for c in columns], axis=-1).reshape(-1, 6)
