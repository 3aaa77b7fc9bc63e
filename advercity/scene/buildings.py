"""Town blocks and houses."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import shapely
from advercity_dsl.units import Point2
from numpy.typing import ArrayLike

from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import MeshPart, TriangleSurface, join_surfaces, move_surface
from advercity.geometry.primitives import box, loft_rings, rectangles, tube
from advercity.randomness import create_generator
from advercity.scene import vegetation
from advercity.scene.site import Site, StreetSide, rectangle_corners
from advercity.semantics import Semantic

FLOOR_M = 3.1
ROAD_CLEARANCE_M = 1.5
GARDEN_TREE_M = 5.5
_WINDOW_M = (1.2, 1.5)
_BAY_M = 2.9
_TOWN_WALL_MATERIALS = ("plaster", "brick", "plaster_ochre", "plaster_white", "brick")
_HOUSE_WALL_MATERIALS = ("plaster_white", "brick", "plaster", "plaster_ochre")


@dataclass(frozen=True)
class Lot:
    """Where a building stands: its middle, heading of its front in radians, and its size."""

    centre: Point2
    yaw: float
    width_m: float
    depth_m: float

    def to_world(self, x: ArrayLike, y: ArrayLike) -> Float64Array:
        """(..., 2) points given along the lot's own axes; its front looks along -y."""
        cosine, sine = np.cos(self.yaw), np.sin(self.yaw)
        local = np.stack(np.broadcast_arrays(x, y), axis=-1)
        return np.asarray(self.centre) + local @ np.array([[cosine, sine], [-sine, cosine]])

    def compute_corners(self) -> Float64Array:
        """(4, 2) corners of the footprint."""
        x, y = self.width_m / 2, self.depth_m / 2
        return self.to_world([-x, x, x, -x], [-y, -y, y, y])

    @property
    def outline(self) -> shapely.Polygon:
        """The footprint."""
        return shapely.Polygon(self.compute_corners())


@dataclass(frozen=True)
class LotPattern:
    """How buildings of a kind follow each other in a row."""

    width_range_m: tuple[float, float]
    depth_m: float
    gap_m: float


TOWN_LOTS = LotPattern((13.0, 22.0), 15.0, 1.0)
HOUSE_LOTS = LotPattern((8.5, 11.5), 8.5, 7.0)


def build_town_blocks(
    lots: list[Lot], height_m: float | None, site: Site, key: str
) -> tuple[list[MeshPart], list[shapely.Polygon]]:
    """Town blocks of two to six floors on lots, and the ground that they take."""
    draw = create_generator("buildings", key)
    pieces: list[MeshPart] = []
    taken: list[shapely.Polygon] = []
    for lot in lots:
        height = height_m or draw.uniform(6.5, 18.0)
        floors = max(2, round(height * draw.uniform(0.9, 1.1) / FLOOR_M))
        wall = str(draw.choice(_TOWN_WALL_MATERIALS))
        pitched = bool(draw.random() < 0.4)
        if _is_buildable(lot, site, taken):
            pieces += _place_on_lot(_build_town_block(lot, floors, wall, pitched), lot, site)
            taken.append(lot.outline)
    return pieces, taken


def build_houses(
    lots: list[Lot], height_m: float | None, site: Site, key: str
) -> tuple[list[MeshPart], list[shapely.Polygon]]:
    """Detached houses with pitched roofs, hedges and a tree beside each, and the ground taken."""
    draw = create_generator("houses", key)
    pieces: list[MeshPart] = []
    taken: list[shapely.Polygon] = []
    gardens: list[Float64Array] = []
    for lot in lots:
        eaves = 0.62 * height_m if height_m else draw.uniform(3.0, 5.6)
        wall = str(draw.choice(_HOUSE_WALL_MATERIALS))
        if _is_buildable(lot, site, taken):
            pieces += [
                *_place_on_lot(_build_house(lot, eaves, wall), lot, site),
                *_build_garden_hedges(lot, site),
            ]
            taken.append(lot.outline)
            gardens.append(lot.to_world(lot.width_m / 2 + 1.0, lot.depth_m / 2 + 3.5))
    corners = np.reshape(gardens, (-1, 2))
    return pieces + vegetation.build_trees(corners, GARDEN_TREE_M, site.exclude(taken), key), taken


def place_lots_in_area(
    area: tuple[Point2, Point2], plots: LotPattern, spacing_m: float | None, key: str
) -> list[Lot]:
    """One row along the longer side of an area, or two back to back where it is deep enough."""
    low, high = rectangle_corners(area)
    extent = high - low
    lengthways = int(np.argmax(extent))
    depth = float(min(plots.depth_m, extent[1 - lengthways]))
    edges = [low[1 - lengthways] + depth / 2, high[1 - lengthways] - depth / 2]
    rows = edges if extent[1 - lengthways] >= 2 * depth + 4 else edges[:1]
    draw = create_generator("lots", key)
    lots: list[Lot] = []
    for side, across in enumerate(rows):
        # The front looks out of the area: along -y of the lot's own axes.
        yaw = (np.pi * side) if lengthways == 0 else (-np.pi / 2 + np.pi * side)
        for middle, width in _generate_row(float(extent[lengthways]), plots, spacing_m, draw):
            along = low[lengthways] + middle
            x, y = (along, across) if lengthways == 0 else (across, along)
            lots.append(Lot((float(x), float(y)), float(yaw), width, depth))
    return lots


def place_lots_along_street(
    side: StreetSide, plots: LotPattern, spacing_m: float | None, key: str
) -> list[Lot]:
    """A row beside a street, its fronts at the band's offsets."""
    draw = create_generator("lots", key, side.sign)
    lots: list[Lot] = []
    for middle, width in _generate_row(side.length_m, plots, spacing_m, draw):
        front = float(draw.uniform(side.near_offset_m, side.far_offset_m))
        x, y = side.points_at(middle, front + plots.depth_m / 2)
        lots.append(Lot((float(x), float(y)), side.yaw(middle), width, plots.depth_m))
    return lots


def _generate_row(
    length_m: float, plots: LotPattern, spacing_m: float | None, draw: np.random.Generator
) -> Iterator[tuple[float, float]]:
    """Middles and widths of buildings one after the other."""
    start = 0.0
    while start + (width := float(draw.uniform(*plots.width_range_m))) <= length_m:
        yield start + width / 2, width
        gap = plots.gap_m * float(draw.uniform(0.7, 1.5)) if spacing_m is None else spacing_m
        start += width + gap


def _is_buildable(lot: Lot, site: Site, taken: list[shapely.Polygon]) -> bool:
    away = shapely.distance(lot.outline, np.array([site.reserved_area, *taken], dtype=object))
    return bool(away[0] >= ROAD_CLEARANCE_M and (away[1:] >= 0.5).all())


def _place_on_lot(parts: list[tuple[TriangleSurface, str]], lot: Lot, site: Site) -> list[MeshPart]:
    """A building moved to its lot, its floor at the highest ground."""
    ground = site.ground_height(lot.compute_corners())
    offset = (*lot.centre, float(ground.max()))
    foundation = box(
        (-lot.width_m / 2, -lot.depth_m / 2, -float(np.ptp(ground)) - 0.5),
        (lot.width_m / 2, lot.depth_m / 2, 0.35),
    )
    return [
        MeshPart(move_surface(surface, offset, yaw=lot.yaw), material, Semantic.BUILDING)
        for surface, material in [(foundation, "concrete"), *parts]
    ]


def _build_town_block(
    lot: Lot, floors: int, wall: str, pitched: bool
) -> list[tuple[TriangleSurface, str]]:
    x, y, top = lot.width_m / 2, lot.depth_m / 2, floors * FLOOR_M + 0.4
    # The walls stand a hand's breadth inside the foundation.
    x, y = x - 0.08, y - 0.08
    parts = [(box((-x, -y, 0), (x, y, top)), wall)]
    if pitched:
        parts += [
            (_build_gable_walls(x, y, top, 0.5), wall),
            (_build_gable_roof(x, y, top, 0.5), "roof_tile"),
        ]
    else:
        parts += [
            (box((-x - 0.15, -y - 0.15, top), (x + 0.15, y + 0.15, top + 0.45)), "concrete"),
            (box((-1.8, -1.5, top + 0.4), (1.8, 1.5, top + 2.6)), "metal"),
        ]
    door = rectangles([(0, -y - 0.03, 1.5)], (0.9, 0, 0), (0, 0, 1.25))
    shop_front = _build_window_row(x, y, 1.75, (2.1, 1.9), 3.4, skip_m=1.6)
    upper = [
        _build_windows(x, y, 1.75 + FLOOR_M * floor, _WINDOW_M, _BAY_M)
        for floor in range(1, floors)
    ]
    frames = [
        _build_windows(x, y, 1.75 + FLOOR_M * floor, (1.45, 1.75), _BAY_M, out_m=0.012)
        for floor in range(1, floors)
    ]
    return [
        *parts,
        (door, "wood"),
        (join_surfaces([shop_front, *upper]), "glass"),
        (join_surfaces(frames), "paint_white"),
    ]


def _build_house(lot: Lot, eaves: float, wall: str) -> list[tuple[TriangleSurface, str]]:
    x, y = lot.width_m / 2 - 0.08, lot.depth_m / 2 - 0.08
    floors = 2 if eaves > 4.4 else 1
    ridge = eaves + 0.75 * (y + 0.45)
    levels = [1.55 + (eaves / floors) * floor for floor in range(floors)]
    glass = [
        _build_windows(x, y, z, (1.3, 1.25), 3.2, skip_m=1.0 if z < 2 else 0.0) for z in levels
    ]
    frames = [
        _build_windows(x, y, z, (1.5, 1.45), 3.2, skip_m=1.0 if z < 2 else 0.0, out_m=0.012)
        for z in levels
    ]
    return [
        (box((-x, -y, 0), (x, y, eaves)), wall),
        (_build_gable_walls(x, y, eaves, 0.45), wall),
        (_build_gable_roof(x, y, eaves, 0.45), "roof_tile"),
        (box((0.4 * x, 0.5, ridge - 1.6), (0.4 * x + 0.7, 1.2, ridge + 0.7)), "brick"),
        (box((-0.75, -y - 0.9, 0), (0.75, -y, 0.3)), "concrete"),
        (rectangles([(0, -y - 0.03, 1.35)], (0.5, 0, 0), (0, 0, 1.05)), "wood"),
        (join_surfaces(glass), "glass"),
        (join_surfaces(frames), "paint_white"),
        (tube([(x - 0.1, -y - 0.08, 0), (x - 0.1, -y - 0.08, eaves)], 0.05, sides=5), "metal"),
    ]


def _build_garden_hedges(lot: Lot, site: Site) -> list[MeshPart]:
    """Clipped hedges along the front garden, with a gap before the door, where there is room."""
    y = -lot.depth_m / 2 - 1.7
    ends = [(-lot.width_m / 2 - 1.5, -1.3), (1.3, lot.width_m / 2 + 1.5)]
    hedges: list[MeshPart] = []
    for start, end in ends:
        feet = lot.to_world([start, end], y)
        if not site.is_free(feet, ROAD_CLEARANCE_M).all():
            continue
        base = float(site.ground_height(feet).min()) - 0.3
        shape = box((start, y - 0.35, 0), (end, y + 0.35, 1.3))
        hedge = move_surface(shape, (*lot.centre, base), yaw=lot.yaw)
        hedges.append(MeshPart(hedge, "leaves", Semantic.VEGETATION))
    return hedges


def _build_gable_roof(x: float, y: float, eaves: float, overhang: float) -> TriangleSurface:
    """A pitched roof with its ridge along x: a folded slab, drawn from gable to gable."""
    span = y + overhang
    rise, drop, thick = 0.75 * span, 0.75 * overhang, 0.22
    fold = [(-span, eaves - drop), (0.0, eaves - drop + rise), (span, eaves - drop)]
    outline = [*fold, *((b, z + thick) for b, z in fold[::-1])]
    ends = [[(end, b, z) for b, z in outline] for end in (-x - overhang, x + overhang)]
    return _loft_folded_profile(np.asarray(ends))


def _build_gable_walls(x: float, y: float, eaves: float, overhang: float) -> TriangleSurface:
    """The triangle of wall under a pitched roof, drawn through the building."""
    gable = [(-y, eaves), (y, eaves), (0.0, eaves + 0.75 * (y + overhang) - 0.75 * overhang)]
    return loft_rings(np.stack([[(side, *point) for point in gable] for side in (-x, x)]))


def _loft_folded_profile(ends: Float64Array) -> TriangleSurface:
    """A skin between two six-cornered profiles that are not star-shaped: two slabs side by side."""
    left, right = ends[:, [0, 1, 4, 5]], ends[:, [1, 2, 3, 4]]
    return join_surfaces([loft_rings(left), loft_rings(right)])


def _build_windows(
    x: float,
    y: float,
    z: float,
    size: tuple[float, float],
    bay_m: float,
    *,
    skip_m: float = 0.0,
    out_m: float = 0.03,
) -> TriangleSurface:
    """A row of windows around a building at height `z`; none within `skip_m` of the door."""
    front = _build_window_row(x, y, z, size, bay_m, skip_m=skip_m, out_m=out_m)
    back = move_surface(_build_window_row(x, y, z, size, bay_m, out_m=out_m), (0, 0, 0), yaw=np.pi)
    side = _build_window_row(y, x, z, size, bay_m, out_m=out_m)
    ends = [move_surface(side, (0, 0, 0), yaw=yaw) for yaw in (np.pi / 2, -np.pi / 2)]
    return join_surfaces([front, back, *ends])


def _build_window_row(
    x: float,
    y: float,
    z: float,
    size: tuple[float, float],
    bay_m: float,
    *,
    skip_m: float = 0.0,
    out_m: float = 0.03,
) -> TriangleSurface:
    """Windows along the front, which looks along -y."""
    count = max(1, int((2 * x - 0.8) / bay_m))
    at = (np.arange(count) - (count - 1) / 2) * (2 * x - 0.8) / count
    at = at[np.abs(at) >= skip_m] if skip_m else at
    middles = np.column_stack([at, np.full(len(at), -y - out_m), np.full(len(at), z)])
    return rectangles(middles, (size[0] / 2, 0, 0), (0, 0, size[1] / 2))
