"""Paints roofing in overlapping courses."""

import numpy as np

from advercity.assets.maps.surface import Surface, mix
from advercity.assets.maps.tile import Tile, ease


def paint_clay_tiles(tile: Tile) -> Surface:
    """Paint pantiles: a roll and a pan each, fired in several reds, with lichen and soot."""
    grain, patch = tile.noise("grain", 0.02, slope=0.3), tile.noise("patch", 0.25, 0.02)
    tiles = tile.lay(8, 6, 0.0, wobble_m=0.001 * tile.noise("edge", 0.05))
    # From the left: the edge of the neighbour's roll, a flat pan, the own roll.
    roll = np.sqrt(np.clip(1 - np.square((tiles.x - np.float32(0.62)) / np.float32(0.38)), 0, 1))
    pan = np.square(tiles.x + np.float32(0.38)) * (tiles.x < 0.24)
    lip = ease(-1.0, -0.95, tiles.y)
    height = 0.030 * roll + 0.008 * pan - 0.012 * tiles.y + 0.003 * lip
    tone = np.clip(tile.draw("tone", tiles) + 0.1 * patch, 0, 1)
    colour = mix((0.17, 0.058, 0.035), (0.32, 0.125, 0.075), tone)
    colour = mix(colour, (0.10, 0.065, 0.055), 0.35 * ease(0.8, 0.95, tile.draw("sooty", tiles)))
    lichen = tile.scatter("lichen", 64, (0.003, 0.014), present=0.10) * ease(-0.2, 0.8, patch)
    colour = mix(colour, (0.24, 0.23, 0.17), 0.65 * lichen)
    shelter = (
        ease(0.82, 1.0, tiles.y)
        + 0.7 * ease(-0.75, -1.0, tiles.x)
        + 0.4 * ease(0.1, 0.25, tiles.x) * ease(0.5, 0.25, tiles.x)
    )
    shade = (
        (0.85 + 0.15 * roll)
        * (1 - 0.6 * np.minimum(shelter, 1))
        * (1 + 0.10 * grain + 0.06 * patch)
    )
    height += 0.0004 * grain
    return Surface(colour * shade, height.astype(np.float32), 1 - 0.04 * tone)


def paint_slates(tile: Tile) -> Surface:
    """Paint split slates of 250 x 200 mm in view, blue, green and purple greys."""
    cleft, edge = tile.noise("cleft", 0.15, 0.006, slope=0.9), tile.noise("edge", 0.03, slope=0.7)
    slates = tile.lay(8, 10, 0.004, shift=0.5, wobble_m=0.0014 * edge)
    hue, tone = tile.draw("hue", slates), tile.draw("tone", slates)
    colour = mix((0.080, 0.086, 0.096), (0.087, 0.086, 0.090), ease(0.35, 0.7, hue))
    colour = mix(colour, (0.084, 0.089, 0.086), ease(0.8, 0.85, hue))
    colour *= 0.80 + 0.32 * tone + 0.10 * cleft
    face = ease(-0.0005, 0.001, slates.edge_m)
    lichen = tile.scatter("lichen", 64, (0.002, 0.010), present=0.08)
    colour = mix(colour, (0.20, 0.20, 0.17), 0.6 * lichen)
    covered = ease(0.9, 1.0, slates.y)
    colour *= (0.35 + 0.65 * face) * (1 - 0.45 * covered)
    lift = 0.003 * (tile.draw("lift", slates) - 0.5)
    height = 0.0005 * cleft + 0.004 * face - (0.004 + lift) * slates.y
    return Surface(colour, height.astype(np.float32), 1 + 0.06 * cleft)
