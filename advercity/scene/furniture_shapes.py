"""Shapes of street furniture: around the origin on level ground, x towards the street."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from advercity.assets.lettering import WritingPlane, fit_height, write_text
from advercity.assets.two_wheelers import build_parked_bicycle
from advercity.geometry.mesh import TriangleSurface, join_surfaces, move_surface, repeat_surface
from advercity.geometry.primitives import box, ellipsoid, loft_rings, rectangles, tube
from advercity.scene.foliage import build_foliage
from advercity.semantics import Semantic

Parts = list[tuple[TriangleSurface, str, Semantic]]
"""Surfaces with their material and class."""

_STATIC, _POLE = Semantic.STATIC, Semantic.POLE
_BICYCLE_SIZES_M = (1.84, 0.66, 1.78), (1.66, 0.58, 1.62)
"""Sizes with a rider, as bodies of bicycles are declared: a city bicycle and a sporty one."""
_BICYCLE_PAINTS = ("car_paint_black", "car_paint_blue", "car_paint_red")
STAND_OCCUPANCY = 0.6
"""Fraction of the hoops of a stand with a bicycle; an assumption."""
_HOOPS_Y_M = np.linspace(-1.6, 1.6, 5)
_LEAN_M = 0.12
"""Distance of a bicycle from its hoop."""
_BOARD_M, _FIELD_M, _BOARD_HALF_M = 0.25, 0.5, 0.012
"""Height of the boards of a barrier, length of their red and white fields, half their thickness."""
_WORDS = (
    "BIG SALE",
    "COFFEE",
    "NEW FLATS",
    "JAZZ NIGHT",
    "CIRCUS",
    "RIPE PLUMS",
    "GOLF",
    "OFFICES",
)


@dataclass(frozen=True)
class FurnitureShape:
    """A kind of street furniture.

    Attributes:
        build: Builds a piece; draws of the generator vary it.
        half_m: Half its extent towards the street and along it.
        blocks_sight: Whether it is high and wide enough to hide a pedestrian.
    """

    build: Callable[[np.random.Generator], Parts]
    half_m: tuple[float, float]
    blocks_sight: bool = False


def _build_bench(_: np.random.Generator) -> Parts:
    seat = [box((x, -0.9, 0.42), (x + 0.11, 0.9, 0.46)) for x in (-0.2, -0.06, 0.08)]
    back = [box((-0.27, -0.9, z), (-0.24, 0.9, z + 0.11)) for z in (0.56, 0.72)]
    legs = [
        box((x, y - 0.03, -0.2), (x + 0.05, y + 0.03, top))
        for y in (-0.7, 0.7)
        for x, top in ((-0.3, 0.85), (0.13, 0.42))
    ]
    return [
        (join_surfaces([*seat, *back]), "wood", _STATIC),
        (join_surfaces(legs), "black_plastic", _STATIC),
    ]


def _build_bin(_: np.random.Generator) -> Parts:
    drum = tube([(0, 0, 0.35), (0, 0, 0.95)], 0.2, sides=10)
    lid = tube([(0, 0, 1.05), (0, 0, 1.1)], [0.22, 0.16], sides=10)
    post = tube([(-0.12, 0, -0.3), (-0.12, 0, 1.08)], 0.03, sides=6)
    return [
        (drum, "car_paint_green", _STATIC),
        (join_surfaces([lid, post]), "metal", _STATIC),
    ]


def _build_post_box(_: np.random.Generator) -> Parts:
    case = box((-0.2, -0.25, 0.55), (0.2, 0.25, 1.4))
    roof = box((-0.23, -0.28, 1.4), (0.23, 0.28, 1.45))
    slot = rectangles([(0.205, 0, 1.22)], (0, 0.17, 0), (0, 0, 0.018))
    plaque = rectangles([(0.205, 0, 0.95)], (0, 0.12, 0), (0, 0, 0.1))
    foot = box((-0.06, -0.06, -0.3), (0.06, 0.06, 0.55))
    return [
        (join_surfaces([case, roof]), "car_paint_yellow", _STATIC),
        (slot, "black_plastic", _STATIC),
        (plaque, "car_paint_white", _STATIC),
        (foot, "metal", _STATIC),
    ]


def _build_hydrant(_: np.random.Generator) -> Parts:
    barrel = tube([(0, 0, -0.2), (0, 0, 0.06), (0, 0, 0.07), (0, 0, 0.6)], [0.15, 0.15, 0.1, 0.1])
    dome = ellipsoid((0, 0, 0.6), (0.12, 0.12, 0.13), sides=8, bands=4)
    outlets = [
        tube([(0, -0.18, 0.45), (0, 0.18, 0.45)], 0.05, sides=7),
        tube([(0, 0, 0.4), (0.17, 0, 0.4)], 0.06, sides=7),
    ]
    return [(join_surfaces([barrel, dome, *outlets]), "car_paint_yellow", _STATIC)]


def _build_cabinet(draw: np.random.Generator) -> Parts:
    half, height = draw.uniform(0.4, 0.75), draw.uniform(0.95, 1.35)
    case = box((-0.17, -half, 0.06), (0.17, half, height))
    seam = rectangles([(0.172, 0, height / 2)], (0, 0.008, 0), (0, 0, height / 2 - 0.12))
    foot = box((-0.15, -half + 0.03, -0.3), (0.15, half - 0.03, 0.06))
    return [
        (case, "plaster_grey", _STATIC),
        (seam, "black_plastic", _STATIC),
        (foot, "concrete", _STATIC),
    ]


def _build_bicycle_stand(draw: np.random.Generator) -> Parts:
    bend = [(-0.35, 0, -0.2), (-0.35, 0, 0.7), (-0.25, 0, 0.8)]
    hoop = tube([*bend, *((-x, y, z) for x, y, z in bend[::-1])], 0.025, sides=5)
    hoops = repeat_surface(hoop, [(0.0, y, 0.0) for y in _HOOPS_Y_M])
    taken = _HOOPS_Y_M[draw.random(len(_HOOPS_Y_M)) < STAND_OCCUPANCY]
    bicycles = [part for y in taken for part in _park_bicycle(float(y), draw)]
    return [(hoops, "metal", _STATIC), *bicycles]


def _park_bicycle(hoop_y_m: float, draw: np.random.Generator) -> Parts:
    """Build a bicycle at a hoop, nose to the street or away from it."""
    size_m = _BICYCLE_SIZES_M[int(draw.integers(len(_BICYCLE_SIZES_M)))]
    paint = str(draw.choice(_BICYCLE_PAINTS))
    place = np.array([draw.uniform(-0.08, 0.08), hoop_y_m + _LEAN_M, 0.015])
    yaw = draw.choice((0.0, np.pi)) + draw.uniform(-0.06, 0.06)
    return [
        (move_surface(part.surface, place, yaw=yaw), part.material, part.semantic)
        for part in build_parked_bicycle(size_m, paint)
    ]


def _build_works(draw: np.random.Generator) -> Parts:
    """Build an open trench with its earth, a barrier around it and cones before its corners."""
    trench = box((-0.3, -1.5, -0.2), (0.2, 0.4, 0.03))
    heap = ellipsoid((-0.05, 1.0, 0.0), (0.38, 0.6, draw.uniform(0.28, 0.42)), sides=12, bands=6)
    sides = [
        ((0.42, -1.75), (0.42, 1.75)),
        ((-0.48, -1.75), (-0.48, 1.75)),
        ((-0.48, -1.75), (0.42, -1.75)),
        ((-0.48, 1.75), (0.42, 1.75)),
    ]
    red, white, feet = (
        join_surfaces(surfaces)
        for surfaces in zip(*(_build_barrier(*side) for side in sides), strict=True)
    )
    cones = [(0.55, y, 0.015) for y in (-2.15, -0.7, 0.7, 2.15)]
    return [
        (join_surfaces([trench, heap]), "soil", Semantic.TERRAIN),
        (red, "sign_red", Semantic.DYNAMIC),
        (white, "sign_white", Semantic.DYNAMIC),
        (feet, "black_plastic", Semantic.DYNAMIC),
        *((repeat_surface(part, cones), name, Semantic.DYNAMIC) for part, name in _build_cone()),
    ]


def _build_barrier(
    start: tuple[float, float], end: tuple[float, float]
) -> tuple[TriangleSurface, TriangleSurface, TriangleSurface]:
    """Build the red and the white fields of a board between two points, and its feet."""
    length_m = float(np.hypot(*np.subtract(end, start)))
    # An odd number of fields: both ends are red.
    count = 2 * round(length_m / _FIELD_M / 2) + 1
    places = np.linspace(start, end, count + 1)
    along = np.subtract(end, start) / length_m
    half = _BOARD_HALF_M * np.abs(along[::-1])
    fields = [
        box((*(np.minimum(a, b) - half), 0.78), (*(np.maximum(a, b) + half), 0.78 + _BOARD_M))
        for a, b in pairwise(places)
    ]
    feet = [
        surface
        for x, y in (places[0], places[-1])
        for surface in (
            box((x - 0.13, y - 0.13, 0.0), (x + 0.13, y + 0.13, 0.1)),
            box((x - 0.02, y - 0.02, 0.1), (x + 0.02, y + 0.02, 0.8 + _BOARD_M)),
        )
    ]
    return join_surfaces(fields[::2]), join_surfaces(fields[1::2]), join_surfaces(feet)


def _build_cone() -> list[tuple[TriangleSurface, str]]:
    heights = np.array([0.03, 0.30, 0.42, 0.54, 0.62, 0.75])
    radii = 0.15 - 0.16 * heights
    pieces = [
        tube([(0, 0, z) for z in heights[i : i + 2]], radii[i : i + 2], sides=12) for i in range(5)
    ]
    foot = box((-0.18, -0.18, 0.0), (0.18, 0.18, 0.035))
    return [
        (join_surfaces([foot, *pieces[::2]]), "plastic_orange"),
        (join_surfaces(pieces[1::2]), "sign_white"),
    ]


def _build_planter(draw: np.random.Generator) -> Parts:
    angle = 2 * np.pi * np.arange(8) / 8
    ring = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(8)])
    tub = loft_rings([0.38 * ring + (0, 0, -0.1), 0.5 * ring + (0, 0, 0.5)])
    shrub = ellipsoid((0, 0, 0.66), (0.45, 0.45, 0.32), sides=9, bands=5)
    rough = draw.uniform(0.85, 1.15, (len(shrub.vertices), 1))
    vertices = (shrub.vertices - (0, 0, 0.66)) * rough + (0, 0, 0.66)
    foliage = build_foliage(TriangleSurface(vertices, shrub.triangles), 0.14, draw)
    return [(tub, "concrete", _STATIC), *((p.surface, p.material, p.semantic) for p in foliage)]


def _build_hoarding(draw: np.random.Generator) -> Parts:
    word = str(draw.choice(_WORDS))
    split = draw.uniform(-0.3, 0.3)
    board = box((-0.06, -1.35, 0.9), (0.0, 1.35, 2.7))
    poster = rectangles([(0.004, 0, 1.8)], (0, 1.28, 0), (0, 0, 0.83))
    field = rectangles(
        [(0.008, 0, (split + 0.97 + 1.8) / 2)], (0, 1.28, 0), (0, 0, (1.8 - 0.97 - split) / 2)
    )
    height_m = fit_height(word, 0.5, 2.2)
    text = write_text(word, WritingPlane((0.01, 0, 2.15), (0, 1, 0)), height_m)
    posts = [box((-0.12, y - 0.05, -0.4), (-0.06, y + 0.05, 2.6)) for y in (-1.0, 1.0)]
    return [
        (board, "metal", _STATIC),
        (poster, "car_paint_white", _STATIC),
        (field, "cloth_blue", _STATIC),
        (text, "black_plastic", _STATIC),
        (join_surfaces(posts), "metal", _POLE),
    ]


SHAPES: dict[str, FurnitureShape] = {
    "bench": FurnitureShape(_build_bench, (0.3, 0.9)),
    "bin": FurnitureShape(_build_bin, (0.22, 0.22)),
    "post_box": FurnitureShape(_build_post_box, (0.23, 0.28), blocks_sight=True),
    "hydrant": FurnitureShape(_build_hydrant, (0.17, 0.18)),
    "cabinet": FurnitureShape(_build_cabinet, (0.17, 0.75), blocks_sight=True),
    "bicycle_stand": FurnitureShape(_build_bicycle_stand, (1.05, 2.1)),
    "planter": FurnitureShape(_build_planter, (0.52, 0.52), blocks_sight=True),
    "hoarding": FurnitureShape(_build_hoarding, (0.12, 1.35), blocks_sight=True),
    "works": FurnitureShape(_build_works, (0.75, 2.35), blocks_sight=True),
}
"""Shapes by the name of their density in a declaration."""


def build_footing(shape: FurnitureShape, offset_m: float) -> Parts:
    """Build the slabs under a piece whose middle is at an offset from paving, up to the paving."""
    x, y = shape.half_m
    slab = box((-x - 0.1, -y - 0.1, -0.25), (offset_m + 0.02, y + 0.1, 0.015))
    return [(slab, "pavement", Semantic.SIDEWALK)]
