"""Paints galvanised steel."""

import numpy as np

from advercity.assets.maps.surface import Surface, mix
from advercity.assets.maps.tile import Tile, compute_length, ease


def paint_zinc(tile: Tile) -> Surface:
    """Paint hot-dip galvanised steel: spangle, dull patches, runs, a little rust."""
    spangle = tile.pack("spangle", 64, jitter=1.0)
    dull, runs = tile.noise("dull", 0.3, 0.02), tile.noise("runs", 0.2, 0.01, stretch=(1.0, 10.0))
    fine = tile.noise("fine", 0.01, slope=0.0)
    facet = tile.draw("facet", spangle) - 0.5
    tone = 1 + 0.12 * facet + 0.05 * dull + 0.02 * fine - 0.10 * ease(0.8, 2.2, runs)
    colour = mix((1.0, 1.0, 1.01), (0.93, 0.92, 0.90), ease(0.0, 2.0, dull)) * tone
    rust = ease(2.8, 3.4, tile.noise("rust", 0.12, 0.006))
    colour = mix(colour, (0.35, 0.17, 0.08), 0.6 * rust)
    roughness = 1 + 0.22 * dull + 0.18 * facet + 0.05 * fine + 1.0 * rust
    height = 0.00003 * fine + 0.00008 * dull
    return Surface(colour, height, np.clip(roughness, 0.3, None))


def paint_corrugated_sheet(tile: Tile) -> Surface:
    """Paint trapezoidal wall sheets with upright ribs, screws and streaks of dirt below them."""
    base = paint_zinc(tile)
    ribs = tile.lay(8, 4, 0.0)
    profile = ease(0.35, 0.5, 1 - np.abs(ribs.x)) * np.ones_like(ribs.y)
    screws = 1 - ease(
        0.006, 0.009, compute_length(ribs.x * tile.size_m / 16, ribs.y * tile.size_m / 8)
    )
    below = ease(-1.0, 0.0, ribs.y) * (ribs.y < 0) * (1 - ease(0.05, 0.15, np.abs(ribs.x)))
    dirt = 0.35 * below * ease(-0.5, 1.0, tile.noise("dirt", 0.05, stretch=(1.0, 10.0)))
    tone = (0.86 + 0.14 * profile) * (1 - dirt - 0.45 * screws)
    height = base.height_m + 0.025 * profile + 0.003 * screws
    return Surface(base.colour * tone, height, base.roughness * (1 + 0.6 * dirt))
