"""Paints façades: concrete, brick, render."""

import numpy as np

from advercity.assets.maps.surface import Rgb, Surface, mix
from advercity.assets.maps.tile import Tile, compute_length, ease


def paint_concrete(tile: Tile) -> Surface:
    """Paint concrete cast against smooth forms: clouds of cement, pores, faint runs of water."""
    cloud = tile.noise("cloud", 0.3, 0.04, slope=0.6)
    grit, fine = tile.noise("grit", 0.08, 0.008, slope=0.2), tile.noise("fine", 0.012, slope=0.0)
    runs = tile.noise("runs", 0.2, 0.01, stretch=(1.0, 8.0))
    pores = tile.scatter("pores", 128, (0.0006, 0.0035), present=0.12)
    tone = 1 + 0.035 * cloud + 0.05 * grit + 0.045 * fine - 0.06 * ease(0.3, 2.0, runs)
    colour = mix((1.0, 0.985, 0.95), (0.97, 0.97, 0.985), ease(-1, 2, cloud))
    colour *= tone - 0.45 * pores
    height = 0.00012 * fine + 0.0003 * grit - 0.002 * pores
    return Surface(colour, height, 1 + 0.04 * grit)


def paint_concrete_panels(tile: Tile) -> Surface:
    """Paint precast panels: open joints, four holes of form ties each, runs below the joints."""
    panels = tile.lay(2, 2, 0.015, corner_m=0.008, wobble_m=0.001 * tile.noise("edge", 0.1))
    base = paint_concrete(tile)
    joint = 1 - ease(-0.001, 0.004, panels.edge_m)
    half_m = np.float32(0.25 * tile.size_m)
    away_m = half_m * compute_length(np.abs(panels.x) - 0.5, np.abs(panels.y) - 0.5)
    holes = 1 - ease(0.010, 0.016, away_m)
    dirt = tile.noise("dirt", 0.2, 0.02, stretch=(1.0, 16.0))
    below = ease(0.5, 1.0, panels.y) * ease(-0.3, 1.5, dirt)
    tone = 0.95 + 0.10 * tile.draw("tone", panels) - 0.14 * below - 0.5 * holes
    colour = mix(base.colour * tone, (0.16, 0.155, 0.15), 0.85 * joint)
    return Surface(colour, base.height_m - 0.01 * joint - 0.006 * holes, base.roughness)


def paint_red_brick(tile: Tile) -> Surface:
    """Paint facing bricks fired red, some of them overburnt."""
    return _paint_brick(tile, (0.25, 0.085, 0.05), (0.42, 0.17, 0.10), (0.17, 0.065, 0.055))


def paint_yellow_brick(tile: Tile) -> Surface:
    """Paint buff facing bricks, some of them brown."""
    return _paint_brick(tile, (0.36, 0.25, 0.13), (0.54, 0.41, 0.24), (0.28, 0.18, 0.10))


def _paint_brick(tile: Tile, dark: Rgb, light: Rgb, burnt: Rgb) -> Surface:
    """Paint bricks of 240 x 71 mm in running bond, with sanded faces and mortar."""
    grain, edge = tile.noise("grain", 0.02, slope=0.3), tile.noise("edge", 0.04, slope=0.8)
    bricks = tile.lay(8, 24, 0.011, shift=0.5, corner_m=0.004, wobble_m=0.0011 * edge)
    face = ease(-0.0005, 0.0025, bricks.edge_m)
    patch = tile.noise("patch", 0.12, 0.015)
    colour = mix(dark, light, np.clip(tile.draw("tone", bricks) + 0.12 * patch, 0, 1))
    colour = mix(colour, burnt, 0.8 * ease(0.82, 0.95, tile.draw("burnt", bricks)))
    colour *= 1 + 0.12 * grain + 0.07 * patch
    bloom = ease(0.9, 2.2, tile.noise("bloom", 0.4, 0.02)) * ease(-1, 1, grain)
    colour = mix(colour, (0.55, 0.52, 0.48), 0.22 * bloom)
    sand = tile.noise("sand", 0.012, slope=0.0)
    mortar = mix((0.36, 0.34, 0.31), (0.50, 0.48, 0.44), ease(-2, 2, sand + 0.5 * patch))
    shadow = np.float32(0.75) + 0.25 * ease(-0.006, -0.001, -bricks.edge_m - 0.006)
    colour = mix(mortar * shadow, colour, face)
    lean = 0.0006 * (tile.draw("lean", bricks) - 0.5) * bricks.x
    height = 0.005 * face + 0.0004 * grain * face + 0.0004 * sand * (1 - face) + lean
    return Surface(colour, height, 0.94 + 0.06 * (1 - face))


def paint_plaster(tile: Tile) -> Surface:
    """Paint rendered walls: floated grain, streaks of rain, hair cracks, patches of repair."""
    grain = tile.noise("grain", 0.016, slope=0.0)
    floated = tile.noise("floated", 0.25, 0.02, slope=0.4)
    streaks = tile.noise("streaks", 0.2, 0.012, stretch=(1.0, 8.0))
    crazing = tile.pack("crazing", 8, jitter=1.0)
    is_cracked = ease(0.6, 1.4, tile.noise("cracked", 0.8, 0.1))
    wander = 0.006 * tile.noise("wander", 0.15, 0.01)
    crack = (1 - ease(0.0005, 0.0025, np.abs(crazing.edge_m + wander))) * is_cracked
    tone = 1 + 0.05 * grain + 0.025 * floated - 0.045 * ease(0.2, 2.6, streaks) - 0.22 * crack
    colour = mix((1.0, 1.0, 1.0), (0.95, 0.935, 0.905), ease(0.2, 2.6, streaks)) * tone
    height = 0.00045 * grain + 0.0005 * floated - 0.001 * crack
    return Surface(colour, height, 1 + 0.02 * grain)
