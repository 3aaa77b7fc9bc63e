"""Paints surfaces underfoot: asphalt, slabs, kerbs, gravel, soil, grass, crops."""

import numpy as np

from advercity.assets.maps.surface import Rgb, Surface, mix
from advercity.assets.maps.tile import Blades, Pieces, Tile, blur, ease
from advercity.geometry.arrays import FloatArray


def paint_worn_asphalt(tile: Tile) -> Surface:
    """Paint asphalt concrete under traffic: stones bare on top, binder and grit between them."""
    return _paint_asphalt(tile, bareness=0.75)


def paint_new_asphalt(tile: Tile) -> Surface:
    """Paint asphalt concrete as laid: binder still covers the stones."""
    return _paint_asphalt(tile, bareness=0.3)


def _paint_asphalt(tile: Tile, bareness: float) -> Surface:
    """Paint stone mastic asphalt 0/8, whose stones tyres have worn flush with the mastic."""
    coarse, fine = tile.pack("coarse", 128, jitter=0.95), tile.pack("fine", 256, jitter=1.0)
    rough = tile.noise("rough", 0.012, slope=0.3)
    worn = bareness * (1 + 0.2 * tile.noise("worn", 0.2, 0.03))
    is_stone = ease(0.25, 0.65, tile.draw("is_stone", coarse) + 0.08 * rough)
    top = is_stone * ease(0.0002, 0.0013, coarse.edge_m + np.float32(0.0003) * rough)
    grit = ease(0.0, 0.0008, fine.edge_m) * ease(0.5, 0.9, tile.draw("is_grit", fine))
    tone = tile.draw("tone", coarse)
    stone = mix((0.085, 0.084, 0.082), (0.155, 0.150, 0.144), tone**2)
    stone = mix(stone, (0.145, 0.125, 0.105), ease(0.9, 0.93, tile.draw("warm", coarse)))
    stone = mix(stone, (0.23, 0.225, 0.215), ease(0.975, 0.98, tile.draw("pale", coarse)))
    binder = mix((0.06, 0.06, 0.062), (0.10, 0.099, 0.098), grit * (0.3 + 0.7 * worn))
    colour = mix(binder, stone, top * worn)
    colour *= 1 + 0.07 * rough + 0.045 * tile.noise("stain", 0.25, 0.02, slope=0.5)
    height = 0.0004 * top + 0.0002 * grit + 0.0001 * rough
    return Surface(colour, height, 1 - 0.2 * top * worn)


def paint_paving(tile: Tile) -> Surface:
    """Paint concrete slabs of half a metre with sanded joints, worn edges, moss and gum."""
    slabs = tile.lay(4, 4, 0.006, corner_m=0.004, wobble_m=0.0008 * tile.noise("chips", 0.05))
    return _paint_slabs(tile, slabs)


def paint_kerb(tile: Tile) -> Surface:
    """Paint granite with a flamed face: feldspar, quartz and mica, grimy from the road."""
    grains, crystals = tile.pack("grains", 128, jitter=1.0), tile.pack("crystals", 256, jitter=1.0)
    kind, shade = tile.draw("kind", grains), tile.draw("shade", grains)
    flakes = ease(0.82, 0.86, tile.draw("mica", crystals)) * ease(0.0, 0.0005, crystals.edge_m)
    colour = mix((0.42, 0.41, 0.40), (0.58, 0.55, 0.51), shade)
    colour = mix(colour, (0.33, 0.34, 0.35), ease(0.7, 0.75, kind))
    colour = mix(colour, (0.07, 0.07, 0.075), 0.8 * flakes)
    grime, rough = tile.noise("grime", 0.3, 0.02), tile.noise("rough", 0.02, slope=0.5)
    colour *= 1 - 0.10 * ease(0.2, 1.8, grime) + 0.05 * rough
    return Surface(colour, 0.0004 * rough + 0.0002 * shade, 1 - 0.15 * flakes)


def paint_gravel(tile: Tile) -> Surface:
    """Paint crushed stone of several sizes over fines."""
    fines = tile.noise("fines", 0.02, slope=0.2)
    height = 0.0006 * fines
    colour = mix((0.15, 0.135, 0.115), (0.24, 0.22, 0.19), ease(-2, 2, fines))
    for columns, size_m in ((128, 0.009), (64, 0.02), (32, 0.035)):
        stones = tile.pack(f"stones{columns}", columns, jitter=1.0)
        dome, here = _raise_stones(tile, stones, f"{columns}", size_m, present=0.45)
        top = _colour_stones(tile, stones, f"{columns}")
        is_above = here & (dome > height)
        colour[:, is_above], height = top[:, is_above], np.where(is_above, dome, height)
    colour *= (1 + 0.10 * fines) * _shade_hollows(height, 0.012)
    return Surface(colour, height, np.ones_like(height))


def paint_soil(tile: Tile) -> Surface:
    """Paint bare earth: crumbs, small stones, roots and straw."""
    crumbs, clods = tile.noise("crumbs", 0.06, slope=0.7), tile.noise("clods", 0.25, 0.03)
    height = 0.0016 * crumbs + 0.0025 * clods
    tone = ease(-2.5, 2.5, crumbs + 0.35 * clods)
    colour = mix((0.105, 0.068, 0.043), (0.225, 0.15, 0.10), tone)
    stones = tile.pack("stones", 64, jitter=1.0)
    dome, here = _raise_stones(tile, stones, "small", 0.012, present=0.10)
    stone = mix((0.13, 0.10, 0.075), (0.26, 0.215, 0.17), tile.draw("stone_tone", stones))
    is_above = here & (dome > height + 0.002)
    colour[:, is_above], height = stone[:, is_above], np.where(is_above, dome, height)
    straw = tile.strew("straw", 700, (0.02, 0.09), bend=0.3)
    is_straw = (straw.label >= 0) & (tile.noise("litter", 0.4, 0.04) > 0)
    colour[:, is_straw] = mix((0.22, 0.165, 0.10), (0.36, 0.29, 0.18), straw.along)[:, is_straw]
    colour *= _shade_hollows(height, 0.008)
    return Surface(colour, height + np.float32(0.001) * is_straw, np.ones_like(height))


def paint_grass(tile: Tile) -> Surface:
    """Paint a lawn from above: tufts of blades of many greens over dead ones and earth."""
    tufts = tile.noise("tufts", 0.30, 0.02, slope=0.3)
    gaps = ease(0.3, 1.6, -tile.noise("gaps", 0.25, 0.015, slope=0.2))
    dead = tile.strew("dead", 30_000, (0.02, 0.06), bend=0.5)
    colour = _colour_blades(tile, "dead", dead, (0.075, 0.062, 0.026), (0.20, 0.165, 0.075))
    colour[:, dead.label < 0] = np.array([[0.036], [0.033], [0.016]])
    height = np.where(dead.label < 0, 0, 0.002 + 0.001 * dead.along)
    for layer, level_m in enumerate((0.004, 0.009, 0.015)):
        blades = tile.strew(
            f"blades{layer}", 24_000, (0.025, 0.08), bend=0.45, width=1 + layer // 2
        )
        light = (0.45 + 0.3 * layer) * (0.45 + 0.55 * blades.along)
        green = _colour_blades(tile, f"{layer}", blades, (0.05, 0.085, 0.018), (0.17, 0.23, 0.06))
        yellow = ease(0.86, 0.95, tile.draw(f"yellow{layer}", blades))
        green = mix(green, (0.27, 0.24, 0.10), yellow) * light
        # The upper blades grow where tufts are, and stand in their own shade elsewhere.
        density = np.clip(0.8 + 0.06 * layer * tufts - 0.5 * gaps, 0.05, 1.0)
        is_there = (blades.label >= 0) & (tile.draw(f"grows{layer}", blades) < density)
        colour[:, is_there] = green[:, is_there]
        height = np.where(is_there, level_m * (0.6 + 0.4 * blades.along), height)
    colour *= np.clip(1 + 0.13 * tufts - 0.15 * gaps, 0.35, 1.8)
    height = height + 0.004 * tufts
    return Surface(colour, height.astype(np.float32), np.ones_like(height, np.float32))


def paint_crops(tile: Tile) -> Surface:
    """Paint ripening cereals from above: ears over leaves."""
    leaves = tile.strew("leaves", 20_000, (0.06, 0.16), bend=0.6, width=2)
    colour = _colour_blades(tile, "leaves", leaves, (0.10, 0.13, 0.03), (0.24, 0.26, 0.07))
    colour *= 0.4 + 0.45 * leaves.along
    height = 0.006 * leaves.along
    thick = tile.noise("thick", 0.25, 0.03)
    for layer in range(2):
        ears = tile.strew(f"ears{layer}", 9_000, (0.05, 0.10), bend=0.3, width=3)
        is_ear = (ears.label >= 0) & (tile.draw(f"grows{layer}", ears) < 0.7 + 0.07 * thick)
        ripe = _colour_blades(tile, f"ears{layer}", ears, (0.22, 0.22, 0.06), (0.46, 0.42, 0.15))
        ripe *= (0.65 + 0.35 * ears.along) * np.float32(0.75 + 0.25 * layer)
        colour[:, is_ear] = ripe[:, is_ear]
        height = np.where(is_ear, 0.008 + 0.004 * layer, height)
    return Surface(colour, height.astype(np.float32), np.ones_like(height))


def _paint_slabs(tile: Tile, slabs: Pieces) -> Surface:
    fine, cloud = tile.noise("fine", 0.02, slope=0.1), tile.noise("cloud", 0.5, 0.04)
    grains = tile.pack("grains", 256, jitter=1.0)
    speckle = tile.draw("speckle", grains) - 0.5
    tone = 0.86 + 0.24 * tile.draw("tone", slabs) + 0.05 * fine + 0.16 * speckle + 0.035 * cloud
    colour = mix((1.0, 0.985, 0.945), (0.96, 0.965, 0.97), tile.draw("hue", slabs))
    colour *= tone
    dirt = (1 - ease(0.0, 0.035, slabs.edge_m + 0.012 * cloud)) * 0.22
    colour = mix(colour, (0.42, 0.39, 0.34), dirt)
    joint = 1 - ease(-0.0015, 0.0025, slabs.edge_m)
    moss = ease(0.2, 1.0, tile.noise("moss", 0.3, 0.02))
    sand = mix((0.34, 0.30, 0.25), (0.17, 0.19, 0.10), moss) * (1 + 0.2 * fine)
    colour = mix(colour, sand, joint)
    gum = tile.scatter("gum", 16, (0.008, 0.018), present=0.25)
    colour = mix(colour, (0.40, 0.39, 0.38), 0.6 * gum)
    height = (
        -0.005 * joint + 0.00025 * fine + 0.003 * (tile.draw("step", slabs) - 0.5) * (1 - joint)
    )
    return Surface(colour, height, 1 - 0.06 * gum)


def _raise_stones(
    tile: Tile, stones: Pieces, key: str, size_m: float, present: float
) -> tuple[FloatArray, np.ndarray]:
    """Raise some cells to stones with flat tops; their heights, and where they are."""
    lift = tile.draw(f"lift{key}", stones)
    faces = stones.x * (tile.draw(f"tilt_x{key}", stones) - 0.5)
    faces = faces + stones.y * (tile.draw(f"tilt_y{key}", stones) - 0.5)
    dome = np.float32(size_m) * (0.5 * ease(0.0, 0.3 * size_m, stones.edge_m) + 0.4 * lift)
    dome = dome + np.float32(0.35 * size_m) * faces
    here = (tile.draw(f"here{key}", stones) < present) & (stones.edge_m > 0.04 * size_m)
    return dome.astype(np.float32), here


def _colour_stones(tile: Tile, stones: Pieces, key: str) -> FloatArray:
    kind, tone = tile.draw(f"kind{key}", stones), tile.draw(f"tone{key}", stones)
    colour = mix((0.20, 0.195, 0.185), (0.38, 0.37, 0.35), tone)
    colour = mix(colour, (0.36, 0.28, 0.20), ease(0.7, 0.72, kind) * 0.8)
    return mix(colour, (0.55, 0.53, 0.49), ease(0.94, 0.95, kind))


def _colour_blades(tile: Tile, key: str, blades: Blades, dark: Rgb, light: Rgb) -> FloatArray:
    return mix(dark, light, tile.draw(f"tone_{key}", blades))


def _shade_hollows(height: FloatArray, depth_m: float) -> FloatArray:
    """Darken points below their surroundings: they see less of the sky."""
    return np.clip(1 + (height - blur(height, 12)) / np.float32(depth_m), 0.45, 1.2)
