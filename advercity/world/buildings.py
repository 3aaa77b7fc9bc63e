"""Town blocks and houses."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import shapely
from advercity_dsl.base import Point2
from numpy.typing import ArrayLike

from advercity.randomness import generator
from advercity.semantics import Semantic
from advercity.world import trees
from advercity.world.beside import Side
from advercity.world.shapes import Floats, Piece, Surface, box, joined, loft, moved, panels, tube
from advercity.world.site import Site, rectangle

FLOOR_M = 3.1
ROAD_CLEARANCE_M = 1.5
GARDEN_TREE_M = 5.5
_WINDOW_M = (1.2, 1.5)
_BAY_M = 2.9
_TOWN_WALLS = ("plaster", "brick", "plaster_ochre", "plaster_white", "brick")
_HOUSE_WALLS = ("plaster_white", "brick", "plaster", "plaster_ochre")


@dataclass(frozen=True)
class Lot:
    """Where a building stands: its middle, heading of its front in radians, and its size."""

    centre: Point2
    yaw: float
    width_m: float
    depth_m: float

    def at(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """(..., 2) points given along the lot's own axes; its front looks along -y."""
        cosine, sine = np.cos(self.yaw), np.sin(self.yaw)
        local = np.stack(np.broadcast_arrays(x, y), axis=-1)
        return np.asarray(self.centre) + local @ np.array([[cosine, sine], [-sine, cosine]])

    def corners(self) -> Floats:
        """(4, 2) corners of the footprint."""
        x, y = self.width_m / 2, self.depth_m / 2
        return self.at([-x, x, x, -x], [-y, -y, y, y])

    @property
    def outline(self) -> shapely.Polygon:
        """The footprint."""
        return shapely.Polygon(self.corners())


@dataclass(frozen=True)
class Plots:
    """How buildings of a kind follow each other in a row."""

    widths_m: tuple[float, float]
    depth_m: float
    gap_m: float


TOWN = Plots((13.0, 22.0), 15.0, 1.0)
DETACHED = Plots((8.5, 11.5), 8.5, 7.0)


def buildings(
    lots: list[Lot], height_m: float | None, site: Site, key: str
) -> tuple[list[Piece], list[shapely.Polygon]]:
    """Town blocks of two to six floors on lots, and the ground that they take."""
    draw = generator("buildings", key)
    pieces: list[Piece] = []
    taken: list[shapely.Polygon] = []
    for lot in lots:
        height = height_m or draw.uniform(6.5, 18.0)
        floors = max(2, round(height * draw.uniform(0.9, 1.1) / FLOOR_M))
        wall = str(draw.choice(_TOWN_WALLS))
        pitched = bool(draw.random() < 0.4)
        if _is_buildable(lot, site, taken):
            pieces += _placed(_block(lot, floors, wall, pitched), lot, site)
            taken.append(lot.outline)
    return pieces, taken


def houses(
    lots: list[Lot], height_m: float | None, site: Site, key: str
) -> tuple[list[Piece], list[shapely.Polygon]]:
    """Detached houses with pitched roofs, hedges and a tree beside each, and the ground taken."""
    draw = generator("houses", key)
    pieces: list[Piece] = []
    taken: list[shapely.Polygon] = []
    gardens: list[Floats] = []
    for lot in lots:
        eaves = 0.62 * height_m if height_m else draw.uniform(3.0, 5.6)
        wall = str(draw.choice(_HOUSE_WALLS))
        if _is_buildable(lot, site, taken):
            pieces += [*_placed(_house(lot, eaves, wall), lot, site), *_hedges(lot, site)]
            taken.append(lot.outline)
            gardens.append(lot.at(lot.width_m / 2 + 1.0, lot.depth_m / 2 + 3.5))
    corners = np.reshape(gardens, (-1, 2))
    return pieces + trees.grown(corners, GARDEN_TREE_M, site.without(taken), key), taken


def lots_over(
    area: tuple[Point2, Point2], plots: Plots, spacing_m: float | None, key: str
) -> list[Lot]:
    """One row along the longer side of an area, or two back to back where it is deep enough."""
    low, high = rectangle(area)
    extent = high - low
    lengthways = int(np.argmax(extent))
    depth = float(min(plots.depth_m, extent[1 - lengthways]))
    edges = [low[1 - lengthways] + depth / 2, high[1 - lengthways] - depth / 2]
    rows = edges if extent[1 - lengthways] >= 2 * depth + 4 else edges[:1]
    draw = generator("lots", key)
    lots: list[Lot] = []
    for side, across in enumerate(rows):
        # The front looks out of the area: along -y of the lot's own axes.
        yaw = (np.pi * side) if lengthways == 0 else (-np.pi / 2 + np.pi * side)
        for middle, width in _row(float(extent[lengthways]), plots, spacing_m, draw):
            along = low[lengthways] + middle
            x, y = (along, across) if lengthways == 0 else (across, along)
            lots.append(Lot((float(x), float(y)), float(yaw), width, depth))
    return lots


def lots_beside(side: Side, plots: Plots, spacing_m: float | None, key: str) -> list[Lot]:
    """A row beside a street, its fronts at the band's offsets."""
    draw = generator("lots", key, side.sign)
    lots: list[Lot] = []
    for middle, width in _row(side.length_m, plots, spacing_m, draw):
        front = float(draw.uniform(side.near_m, side.far_m))
        x, y = side.at(middle, front + plots.depth_m / 2)
        lots.append(Lot((float(x), float(y)), side.yaw(middle), width, plots.depth_m))
    return lots


def _row(
    length_m: float, plots: Plots, spacing_m: float | None, draw: np.random.Generator
) -> Iterator[tuple[float, float]]:
    """Middles and widths of buildings one after the other."""
    start = 0.0
    while start + (width := float(draw.uniform(*plots.widths_m))) <= length_m:
        yield start + width / 2, width
        gap = plots.gap_m * float(draw.uniform(0.7, 1.5)) if spacing_m is None else spacing_m
        start += width + gap


def _is_buildable(lot: Lot, site: Site, taken: list[shapely.Polygon]) -> bool:
    away = shapely.distance(lot.outline, np.array([site.keep_off, *taken], dtype=object))
    return bool(away[0] >= ROAD_CLEARANCE_M and (away[1:] >= 0.5).all())


def _placed(parts: list[tuple[Surface, str]], lot: Lot, site: Site) -> list[Piece]:
    """A building moved to its lot, its floor at the highest ground."""
    ground = site.ground_height(lot.corners())
    offset = (*lot.centre, float(ground.max()))
    foundation = box(
        (-lot.width_m / 2, -lot.depth_m / 2, -float(np.ptp(ground)) - 0.5),
        (lot.width_m / 2, lot.depth_m / 2, 0.35),
    )
    return [
        Piece(moved(surface, offset, yaw=lot.yaw), material, Semantic.BUILDING)
        for surface, material in [(foundation, "concrete"), *parts]
    ]


def _block(lot: Lot, floors: int, wall: str, pitched: bool) -> list[tuple[Surface, str]]:
    x, y, top = lot.width_m / 2, lot.depth_m / 2, floors * FLOOR_M + 0.4
    # The walls stand a hand's breadth inside the foundation.
    x, y = x - 0.08, y - 0.08
    parts = [(box((-x, -y, 0), (x, y, top)), wall)]
    if pitched:
        parts += [(_gable_walls(x, y, top, 0.5), wall), (_gable(x, y, top, 0.5), "roof_tile")]
    else:
        parts += [
            (box((-x - 0.15, -y - 0.15, top), (x + 0.15, y + 0.15, top + 0.45)), "concrete"),
            (box((-1.8, -1.5, top + 0.4), (1.8, 1.5, top + 2.6)), "metal"),
        ]
    door = panels([(0, -y - 0.03, 1.5)], (0.9, 0, 0), (0, 0, 1.25))
    shop_front = _row_of_windows(x, y, 1.75, (2.1, 1.9), 3.4, skip_m=1.6)
    upper = [
        _windows(x, y, 1.75 + FLOOR_M * floor, _WINDOW_M, _BAY_M) for floor in range(1, floors)
    ]
    frames = [
        _windows(x, y, 1.75 + FLOOR_M * floor, (1.45, 1.75), _BAY_M, out_m=0.012)
        for floor in range(1, floors)
    ]
    return [
        *parts,
        (door, "wood"),
        (joined([shop_front, *upper]), "glass"),
        (joined(frames), "paint_white"),
    ]


def _house(lot: Lot, eaves: float, wall: str) -> list[tuple[Surface, str]]:
    x, y = lot.width_m / 2 - 0.08, lot.depth_m / 2 - 0.08
    floors = 2 if eaves > 4.4 else 1
    ridge = eaves + 0.75 * (y + 0.45)
    levels = [1.55 + (eaves / floors) * floor for floor in range(floors)]
    glass = [_windows(x, y, z, (1.3, 1.25), 3.2, skip_m=1.0 if z < 2 else 0.0) for z in levels]
    frames = [
        _windows(x, y, z, (1.5, 1.45), 3.2, skip_m=1.0 if z < 2 else 0.0, out_m=0.012)
        for z in levels
    ]
    return [
        (box((-x, -y, 0), (x, y, eaves)), wall),
        (_gable_walls(x, y, eaves, 0.45), wall),
        (_gable(x, y, eaves, 0.45), "roof_tile"),
        (box((0.4 * x, 0.5, ridge - 1.6), (0.4 * x + 0.7, 1.2, ridge + 0.7)), "brick"),
        (box((-0.75, -y - 0.9, 0), (0.75, -y, 0.3)), "concrete"),
        (panels([(0, -y - 0.03, 1.35)], (0.5, 0, 0), (0, 0, 1.05)), "wood"),
        (joined(glass), "glass"),
        (joined(frames), "paint_white"),
        (tube([(x - 0.1, -y - 0.08, 0), (x - 0.1, -y - 0.08, eaves)], 0.05, sides=5), "metal"),
    ]


def _hedges(lot: Lot, site: Site) -> list[Piece]:
    """Clipped hedges along the front garden, with a gap before the door, where there is room."""
    y = -lot.depth_m / 2 - 1.7
    ends = [(-lot.width_m / 2 - 1.5, -1.3), (1.3, lot.width_m / 2 + 1.5)]
    hedges: list[Piece] = []
    for start, end in ends:
        feet = lot.at([start, end], y)
        if not site.is_free(feet, ROAD_CLEARANCE_M).all():
            continue
        base = float(site.ground_height(feet).min()) - 0.3
        shape = box((start, y - 0.35, 0), (end, y + 0.35, 1.3))
        hedge = moved(shape, (*lot.centre, base), yaw=lot.yaw)
        hedges.append(Piece(hedge, "leaves", Semantic.VEGETATION))
    return hedges


def _gable(x: float, y: float, eaves: float, overhang: float) -> Surface:
    """A pitched roof with its ridge along x: a folded slab, drawn from gable to gable."""
    span = y + overhang
    rise, drop, thick = 0.75 * span, 0.75 * overhang, 0.22
    fold = [(-span, eaves - drop), (0.0, eaves - drop + rise), (span, eaves - drop)]
    outline = [*fold, *((b, z + thick) for b, z in fold[::-1])]
    ends = [[(end, b, z) for b, z in outline] for end in (-x - overhang, x + overhang)]
    return _folded(np.asarray(ends))


def _gable_walls(x: float, y: float, eaves: float, overhang: float) -> Surface:
    """The triangle of wall under a pitched roof, drawn through the building."""
    gable = [(-y, eaves), (y, eaves), (0.0, eaves + 0.75 * (y + overhang) - 0.75 * overhang)]
    return loft(np.stack([[(side, *point) for point in gable] for side in (-x, x)]))


def _folded(ends: Floats) -> Surface:
    """A skin between two six-cornered profiles that are not star-shaped: two slabs side by side."""
    left, right = ends[:, [0, 1, 4, 5]], ends[:, [1, 2, 3, 4]]
    return joined([loft(left), loft(right)])


def _windows(
    x: float,
    y: float,
    z: float,
    size: tuple[float, float],
    bay_m: float,
    *,
    skip_m: float = 0.0,
    out_m: float = 0.03,
) -> Surface:
    """A row of windows around a building at height `z`; none within `skip_m` of the door."""
    front = _row_of_windows(x, y, z, size, bay_m, skip_m=skip_m, out_m=out_m)
    back = moved(_row_of_windows(x, y, z, size, bay_m, out_m=out_m), (0, 0, 0), yaw=np.pi)
    side = _row_of_windows(y, x, z, size, bay_m, out_m=out_m)
    ends = [moved(side, (0, 0, 0), yaw=yaw) for yaw in (np.pi / 2, -np.pi / 2)]
    return joined([front, back, *ends])


def _row_of_windows(
    x: float,
    y: float,
    z: float,
    size: tuple[float, float],
    bay_m: float,
    *,
    skip_m: float = 0.0,
    out_m: float = 0.03,
) -> Surface:
    """Windows along the front, which looks along -y."""
    count = max(1, int((2 * x - 0.8) / bay_m))
    at = (np.arange(count) - (count - 1) / 2) * (2 * x - 0.8) / count
    at = at[np.abs(at) >= skip_m] if skip_m else at
    middles = np.column_stack([at, np.full(len(at), -y - out_m), np.full(len(at), z)])
    return panels(middles, (size[0] / 2, 0, 0), (0, 0, size[1] / 2))
