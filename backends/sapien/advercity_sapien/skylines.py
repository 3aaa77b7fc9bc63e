"""Obstacles before the sky around probes, for reflections from beyond the image.

Panes, car paint and wet roads mirror directions outside any image. Around every probe there is, by
azimuth, the elevation up to which houses and trees hide the sky, how near they are and their
reflected light. With their distance, points above the probe look over more of them.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from advercity.geometry.arrays import Float64Array, FloatArray
from advercity.rendering.raycaster import Raycaster, RayHits, Rays
from advercity_sapien.probe_grid import LEVEL_HEIGHTS_M, ProbeGrid
from advercity_sapien.shader_table import KILO

SKYLINE_LEVEL = 1
"""Level of the probes whose surroundings these are."""
AZIMUTHS, ELEVATIONS = 16, 8
"""Directions around a probe, the first to the east, and rays of each."""
TOP_RAD = np.deg2rad(72.0)
"""Highest elevation of rays."""
TURNS = np.array([(-0.375, 0.125), (-0.125, -0.375), (0.125, 0.375), (0.375, -0.125)])
"""Fractions of a step by which the rays of the four probes of a square are turned and raised."""
MAX_RANGE_M = 200.0
NEAREST_M = 2.0
"""Least distance; nearer obstacles count as this far."""
PRIOR_COUNT = 0.1
"""Weight of the mean of all light, in rays: a skyline of no height has a light, too."""

Shade = Callable[[FloatArray, RayHits], Float64Array]
"""Computes the radiance (n, 3) in cd/m² reflected by surfaces at points (n, 3) of hits."""


@dataclass(frozen=True, eq=False)
class Skylines:
    """Skylines around the probes of a grid (h, w), azimuth upon azimuth.

    Attributes:
        light: (AZIMUTHS h, w, 4) float32: mean radiance in cd/m², tangent of the top's elevation.
        nearness: (AZIMUTHS h, w) uint8, `NEAREST_M` over its horizontal distance, of 255.
    """

    light: NDArray[np.float32]
    nearness: NDArray[np.uint8]


NO_SKYLINES = Skylines(
    np.zeros((AZIMUTHS, 1, 4), np.float32), np.zeros((AZIMUTHS, 1), dtype=np.uint8)
)


def bake_skylines(
    raycaster: Raycaster, grid: ProbeGrid, is_buried: NDArray[np.bool_], shade: Shade
) -> Skylines:
    """Bake the skylines of a grid; buried probes (n,) get the nearest other one's."""
    origins = grid.list_points(LEVEL_HEIGHTS_M[SKYLINE_LEVEL])
    found = [
        grid.smooth(_look_towards(raycaster, origins, grid.turns, azimuth, shade), is_buried)
        for azimuth in range(AZIMUTHS)
    ]
    sums = np.concatenate(found)
    count, nearness, light = sums[..., 0], sums[..., 1], sums[..., 2:]
    mean = light.sum(axis=(0, 1)) / max(count.sum(), 1.0)
    light = (light + PRIOR_COUNT * mean) / (count + PRIOR_COUNT)[..., None]
    top = np.tan(count * TOP_RAD / ELEVATIONS)
    near = np.minimum(NEAREST_M * nearness / np.maximum(count, PRIOR_COUNT), 1.0)
    return Skylines(
        np.concatenate([light, top[..., None]], axis=-1).astype(np.float32),
        np.round(255.0 * near).astype(np.uint8),
    )


def _look_towards(
    raycaster: Raycaster, origins: FloatArray, turns: NDArray[np.uint16], azimuth: int, shade: Shade
) -> Float64Array:
    """Sum the hits towards one azimuth: number (n,), nearness in 1/m, and radiance (n, 3)."""
    sums = np.zeros((len(origins), 5))
    turned, raised = TURNS.T[:, turns]
    around = 2.0 * np.pi / AZIMUTHS * (azimuth + turned)
    for step in range(ELEVATIONS):
        above = TOP_RAD / ELEVATIONS * (step + 0.5 + raised)
        level = np.cos(above)
        directions = np.column_stack(
            [level * np.cos(around), level * np.sin(around), np.sin(above)]
        )
        hits = raycaster.cast(Rays(origins, directions.astype(np.float32)), MAX_RANGE_M)
        seeing = np.flatnonzero(np.isfinite(hits.range_m))
        seen = hits.select(seeing)
        points = origins[seeing] + directions[seeing] * seen.range_m[:, None]
        nearness = 1.0 / (seen.range_m * level[seeing] + 1e-3)
        sums[seeing] += np.column_stack([np.ones(len(seeing)), nearness, shade(points, seen)])
    return sums


def build_skyline_texture(skylines: Skylines) -> NDArray[np.float16]:
    """Build the texture (AZIMUTHS h, w, 4) of light in kcd/m² and of tangents."""
    return (skylines.light * (KILO, KILO, KILO, 1.0)).astype(np.float16)
