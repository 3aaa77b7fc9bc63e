"""Paints planks and bark."""

import numpy as np

from advercity.assets.maps.surface import Surface, mix
from advercity.assets.maps.tile import Tile, ease

_BOARDS = 16


def paint_planks(tile: Tile) -> Surface:
    """Paint upright boards of softwood: growth rings cut lengthwise, knots, gaps, weathering."""
    boards = tile.lay(_BOARDS, 1, 0.004, corner_m=0.002)
    # A board is a slice of a tree; its rings are the heights of a landscape with knots for hills.
    bent = tile.noise("bent", 0.6, 0.03, slope=1.0, stretch=(1.0, 8.0))
    knots = tile.scatter("knots", 16, (0.006, 0.016), present=0.10, stretch=(1.0, 1.6))
    aside = _shift_boards(tile, bent + 1.4 * ease(0.0, 1.0, knots))
    width_m = tile.size_m / _BOARDS
    rings_m = 0.004 + 0.008 * tile.draw("rings", boards)
    middle = tile.draw("pith", boards) - 0.5
    distance_m = np.abs(boards.x * 0.5 - middle) * width_m + 0.006 * aside
    phase = distance_m / rings_m
    late = np.square(phase - np.floor(phase))
    late *= 1 - ease(0.9, 1.0, phase - np.floor(phase))
    fibre = _shift_boards(tile, tile.noise("fibre", 0.03, slope=0.3, stretch=(1.0, 30.0)))
    tone = 0.78 + 0.4 * tile.draw("tone", boards) - 0.22 * late + 0.07 * fibre
    colour = mix((0.36, 0.235, 0.135), (0.31, 0.25, 0.19), tile.draw("grey", boards))
    colour *= tone
    colour = mix(colour, (0.12, 0.065, 0.035), 0.7 * _shift_boards(tile, knots))
    gap = _shift_boards(tile, 1 - ease(-0.0005, 0.0015, boards.edge_m))
    colour = mix(colour, (0.03, 0.022, 0.016), gap)
    height = 0.0003 * late + 0.0001 * fibre - 0.006 * gap
    return Surface(colour, height.astype(np.float32), 1 - 0.06 * late)


def _shift_boards(tile: Tile, values: np.ndarray) -> np.ndarray:
    """Shift a pattern along each board, so it does not continue in the next board."""
    shifted, width = values.copy(), tile.pixels // _BOARDS
    for board, rows in enumerate(tile.generator("boards").integers(tile.pixels, size=_BOARDS)):
        columns = slice(board * width, (board + 1) * width)
        shifted[:, columns] = np.roll(values[:, columns], int(rows), axis=0)
    return shifted


def paint_bark(tile: Tile) -> Surface:
    """Paint the bark of an old broadleaf tree: long ridges parting and joining, fissured, mossy."""
    flow = tile.noise("flow", 0.12, 0.012, slope=0.8, stretch=(1.0, 4.5))
    other = tile.noise("other", 0.06, 0.008, slope=0.6, stretch=(1.0, 3.0))
    fine = tile.noise("fine", 0.015, slope=0.3, stretch=(1.0, 2.0))
    across = tile.noise("across", 0.05, 0.004, slope=0.5, stretch=(3.0, 1.0))
    ridge = 1 - np.minimum(np.abs(flow), 1.5) / 1.5
    fissure = ease(0.55, 1.0, ridge)
    plate = (1 - fissure) * (1 + 0.15 * other)
    cracks = ease(1.2, 2.0, across) * (1 - fissure)
    height = 0.006 * plate + 0.0008 * other + 0.0007 * fine - 0.003 * cracks
    colour = mix((0.045, 0.03, 0.022), (0.165, 0.125, 0.09), np.clip(plate, 0, 1))
    colour *= 1 + 0.12 * fine + 0.10 * other - 0.35 * cracks
    moss = ease(0.9, 2.0, tile.noise("moss", 0.35, 0.02)) * ease(-1, 1, other)
    colour = mix(colour, (0.095, 0.115, 0.04), 0.55 * moss)
    lichen = ease(1.5, 2.3, tile.noise("lichen", 0.1, 0.01)) * np.clip(plate, 0, 1)
    colour = mix(colour, (0.21, 0.215, 0.18), 0.5 * lichen)
    return Surface(np.clip(colour, 0.01, 1), height, 1 - 0.02 * fine)
