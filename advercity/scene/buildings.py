"""Builds town blocks and houses on lots along streets and in areas."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import shapely
from advercity_dsl.units import Point2
from numpy.typing import ArrayLike

from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import MeshPart, TriangleSurface, join_surfaces, move_surface
from advercity.geometry.primitives import box, loft_rings, tube
from advercity.randomness import create_generator
from advercity.scene import vegetation
from advercity.scene.facades import FacadeStyle, Storey, SurfaceMaterials, build_facade
from advercity.scene.foliage import HEDGE_LEAF_M, build_foliage
from advercity.scene.roof_details import (
    ROOF_SLOPE,
    ROOF_THICKNESS_M,
    build_chimneys,
    build_dormers,
    build_gutters,
)
from advercity.scene.site import Rectangle, Site, StreetSide
from advercity.semantics import Semantic

FLOOR_M = 3.1
PLINTH_M = 0.35
"""Height of the foundation above the highest ground at a building."""
ROAD_CLEARANCE_M = 1.5
GARDEN_TREE_M = 5.5
MIN_ROW_M = 6.0
"""Least half width of buildings with two chimneys."""
TOWN_WALLS = ("plaster", "brick", "brick", "plaster_ochre", "plaster_white", "brick_yellow")
HOUSE_WALLS = (
    "plaster_white",
    "brick",
    "plaster",
    "plaster_ochre",
    "plaster_rose",
    "brick_yellow",
)
_TRIMS = ("enamel_white", "enamel_white", "plaster_grey", "black_plastic")
_ACCENTS = ("cloth_red", "cloth_green", "cloth_blue", "cloth_dark", "cloth_brown", "cloth_yellow")
ROOFS = ("roof_tile", "roof_tile", "roof_slate")


@dataclass(frozen=True)
class Lot:
    """Ground of one building: centre, yaw in radians and size; its front faces -y."""

    centre: Point2
    yaw: float
    width_m: float
    depth_m: float

    def to_world(self, x: ArrayLike, y: ArrayLike) -> Float64Array:
        """Transform coordinates (...) along the lot's own axes to points (..., 2)."""
        cosine, sine = np.cos(self.yaw), np.sin(self.yaw)
        local = np.stack(np.broadcast_arrays(x, y), axis=-1)
        return np.asarray(self.centre) + local @ np.array([[cosine, sine], [-sine, cosine]])

    def compute_corners(self) -> Float64Array:
        """Compute the corners (4, 2) of the footprint."""
        x, y = self.width_m / 2, self.depth_m / 2
        return self.to_world([-x, x, x, -x], [-y, -y, y, y])

    @property
    def outline(self) -> shapely.Polygon:
        """Footprint of the building."""
        return shapely.Polygon(self.compute_corners())


@dataclass(frozen=True)
class LotPattern:
    """Sizes and distances of buildings in a row."""

    width_range_m: tuple[float, float]
    depth_m: float
    gap_m: float


TOWN_LOTS = LotPattern((13.0, 22.0), 15.0, 1.0)
HOUSE_LOTS = LotPattern((8.5, 11.5), 8.5, 7.0)


def build_town_blocks(
    lots: Sequence[Lot], height_m: float | None, site: Site, key: str
) -> tuple[list[MeshPart], list[shapely.Polygon]]:
    """Build town blocks of two to six floors on lots, and return their footprints."""
    draw = create_generator("buildings", key)

    def draw_block(lot: Lot) -> Callable[[], SurfaceMaterials]:
        height = height_m or draw.uniform(6.5, 18.0)
        floors = max(2, round(height * draw.uniform(0.9, 1.1) / FLOOR_M))
        own = create_generator("facades", key, int(draw.integers(2**31)))
        return partial(_build_town_block, lot, floors, own)

    parts, built = _build_on_lots(lots, site, draw_block)
    return parts, [lot.outline for lot in built]


def build_houses(
    lots: Sequence[Lot], height_m: float | None, site: Site, key: str
) -> tuple[list[MeshPart], list[shapely.Polygon]]:
    """Build detached houses with hedges and a tree each, and return the houses' footprints."""
    draw = create_generator("houses", key)

    def draw_house(lot: Lot) -> Callable[[], SurfaceMaterials]:
        eaves = 0.62 * height_m if height_m else draw.uniform(3.0, 5.6)
        own = create_generator("facades", key, int(draw.integers(2**31)))
        return partial(_build_house, lot, eaves, own)

    parts, built = _build_on_lots(lots, site, draw_house)
    leaves = create_generator("garden hedges", key)
    hedges = [hedge for lot in built for hedge in _build_garden_hedges(lot, site, leaves)]
    footprints = [lot.outline for lot in built]
    corners = [lot.to_world(lot.width_m / 2 + 1.0, lot.depth_m / 2 + 3.5) for lot in built]
    places = np.reshape(corners, (-1, 2))
    trees = vegetation.build_trees(places, GARDEN_TREE_M, site.exclude(footprints), key)
    return [*parts, *hedges, *trees], footprints


def _build_on_lots(
    lots: Sequence[Lot], site: Site, draw_building: Callable[[Lot], Callable[[], SurfaceMaterials]]
) -> tuple[list[MeshPart], list[Lot]]:
    """Build on all free lots, and return these lots."""
    parts: list[MeshPart] = []
    built: list[Lot] = []
    for lot in lots:
        # Drawn for blocked lots, too: otherwise one of them would change the buildings after it.
        build = draw_building(lot)
        if _is_buildable(lot, site, built):
            parts += _place_on_lot(build(), lot, site)
            built.append(lot)
    return parts, built


def place_lots(
    band: StreetSide | Rectangle, pattern: LotPattern, spacing_m: float | None, key: str
) -> list[Lot]:
    """Place lots in a row along a street, or in one or two rows in a rectangle."""
    if isinstance(band, Rectangle):
        return _place_lots_in_area(band, pattern, spacing_m, key)
    return _place_lots_along_street(band, pattern, spacing_m, key)


def _place_lots_in_area(
    area: Rectangle, pattern: LotPattern, spacing_m: float | None, key: str
) -> list[Lot]:
    """Place one row along the longer side, or two back to back where the area is deep enough."""
    long, short = area.long_axis, 1 - area.long_axis
    depth = float(min(pattern.depth_m, area.extent[short]))
    edges = [area.low[short] + depth / 2, area.high[short] - depth / 2]
    rows = edges if area.extent[short] >= 2 * depth + 4 else edges[:1]
    draw = create_generator("lots", key)
    lots: list[Lot] = []
    for side, across in enumerate(rows):
        # Fronts face out of the area; they are on the -y side of a lot's own axes.
        yaw = (np.pi * side) if long == 0 else (-np.pi / 2 + np.pi * side)
        for middle, width in _generate_row(float(area.extent[long]), pattern, spacing_m, draw):
            along = area.low[long] + middle
            x, y = (along, across) if long == 0 else (across, along)
            lots.append(Lot((float(x), float(y)), float(yaw), width, depth))
    return lots


def _place_lots_along_street(
    side: StreetSide, pattern: LotPattern, spacing_m: float | None, key: str
) -> list[Lot]:
    draw = create_generator("lots", key, side.sign)
    lots: list[Lot] = []
    for middle, width in _generate_row(side.length_m, pattern, spacing_m, draw):
        front = float(draw.uniform(side.near_offset_m, side.far_offset_m))
        x, y = side.points_at(middle, front + pattern.depth_m / 2)
        lots.append(Lot((float(x), float(y)), side.yaw(middle), width, pattern.depth_m))
    return lots


def _generate_row(
    length_m: float, pattern: LotPattern, spacing_m: float | None, draw: np.random.Generator
) -> Iterator[tuple[float, float]]:
    start = 0.0
    while start + (width := float(draw.uniform(*pattern.width_range_m))) <= length_m:
        yield start + width / 2, width
        gap = pattern.gap_m * float(draw.uniform(0.7, 1.5)) if spacing_m is None else spacing_m
        start += width + gap


def _is_buildable(lot: Lot, site: Site, built: Sequence[Lot]) -> bool:
    others = np.array([site.reserved_area, *(other.outline for other in built)], dtype=object)
    distance = shapely.distance(lot.outline, others)
    return bool(distance[0] >= ROAD_CLEARANCE_M and (distance[1:] >= 0.5).all())


def _place_on_lot(parts: SurfaceMaterials, lot: Lot, site: Site) -> list[MeshPart]:
    """Move a building to its lot, with its floor at the highest ground, on a foundation."""
    ground = site.ground_height(lot.compute_corners())
    offset = (*lot.centre, float(ground.max()))
    x, y = lot.width_m / 2, lot.depth_m / 2
    foundation = box((-x, -y, -float(np.ptp(ground)) - 0.5), (x, y, PLINTH_M))
    return [
        MeshPart(move_surface(surface, offset, yaw=lot.yaw), material, Semantic.BUILDING)
        for surface, material in [(foundation, "concrete"), *parts]
    ]


def draw_style(walls: Sequence[str], draw: np.random.Generator) -> FacadeStyle:
    """Draw the materials and ornaments of a building."""
    return FacadeStyle(
        wall=str(draw.choice(walls)),
        trim=str(draw.choice(_TRIMS)),
        accent=str(draw.choice(_ACCENTS)),
        blind_fraction=float(draw.uniform(0.1, 0.6)),
        has_string_courses=bool(draw.random() < 0.5),
        has_shutters=bool(draw.random() < 0.4),
    )


def _build_town_block(lot: Lot, floors: int, draw: np.random.Generator) -> SurfaceMaterials:
    """Build a block: shops or flats below, equal floors above, a flat or a pitched roof."""
    x, y, top = _inset(lot.width_m), _inset(lot.depth_m), floors * FLOOR_M + 0.4
    style = replace(draw_style(TOWN_WALLS, draw), has_shutters=False, plinth_m=PLINTH_M)
    bay, window = float(draw.uniform(2.4, 3.4)), (float(draw.uniform(1.0, 1.7)), 1.6)
    has_shops, has_balconies = draw.random() < 0.5, draw.random() < 0.35

    def list_storeys(width_m: float, *, is_front: bool) -> list[Storey]:
        count = max(1, int(width_m / bay))
        if is_front and has_shops:
            shops = max(3, int(width_m / 4.2)) | 1
            ground = Storey(
                0.0, FLOOR_M + 0.4, shops, width_m / shops - 0.7, 0.5, 2.2, shops // 2, is_shop=True
            )
        else:
            door = count // 2 if is_front else None
            ground = Storey(0.0, FLOOR_M + 0.4, count, window[0], 1.1, window[1], door)
        is_loggia = is_front and has_balconies
        sill, opening = (0.15, 2.2) if is_loggia else (0.9, window[1])
        upper = [
            Storey(0.4 + FLOOR_M * floor, FLOOR_M, count, window[0], sill, opening)
            for floor in range(1, floors)
        ]
        return [ground, *(replace(storey, has_balconies=is_loggia) for storey in upper)]

    parts = _build_walls(x, y, list_storeys, style, draw)
    if draw.random() < 0.4:
        roof = str(draw.choice(ROOFS))
        pitched = build_pitched_roof(x, y, top, 0.5, style.wall, roof)
        attic = _build_attic(x, y, top, 0.6, style, roof, draw)
        return [*parts, *pitched, *attic, (_build_downpipes(x, y, top), "metal")]
    parapet = box((-x - 0.15, -y - 0.15, top), (x + 0.15, y + 0.15, top + 0.45))
    stairs = box((-1.8, -1.5, top + 0.4), (1.8, 1.5, top + 2.6))
    vents = [
        box((at - 0.4, 1.0, top + 0.4), (at + 0.4, 1.9, top + 1.2))
        for at in draw.uniform(-0.8 * x, 0.8 * x, 2)
    ]
    return [*parts, (parapet, "concrete"), (stairs, "metal"), (join_surfaces(vents), "metal")]


def _build_house(lot: Lot, eaves: float, draw: np.random.Generator) -> SurfaceMaterials:
    """Build a house with a door in the middle, a pitched roof and a chimney."""
    x, y = _inset(lot.width_m), _inset(lot.depth_m)
    floors = 2 if eaves > 4.4 else 1
    style = replace(draw_style(HOUSE_WALLS, draw), has_string_courses=False, plinth_m=PLINTH_M)
    width, bay = float(draw.uniform(1.0, 1.5)), float(draw.uniform(2.6, 3.4))

    def list_storeys(width_m: float, *, is_front: bool) -> list[Storey]:
        count = max(1, int(width_m / bay)) | int(is_front)
        rise = eaves / floors
        storeys = [
            Storey(rise * floor, rise, count, width, 0.95, min(1.35, rise - 1.2))
            for floor in range(floors)
        ]
        if is_front:
            storeys[0] = replace(storeys[0], door_at=count // 2)
        return storeys

    roof = str(draw.choice(ROOFS))
    return [
        *_build_walls(x, y, list_storeys, style, draw),
        *build_pitched_roof(x, y, eaves, 0.45, style.wall, roof),
        *_build_attic(x, y, eaves, 0.35, style, roof, draw),
        (_build_downpipes(x, y, eaves), "metal"),
    ]


def _build_downpipes(x: float, y: float, eaves: float) -> TriangleSurface:
    """Build a downpipe at either end of the front, from the ground to the gutter."""
    pipes = [
        tube([(at, -y - 0.14, -0.3), (at, -y - 0.14, eaves)], 0.05, sides=5)
        for at in (0.15 - x, x - 0.15)
    ]
    return join_surfaces(pipes)


def _build_attic(
    x: float,
    y: float,
    eaves: float,
    dormer_fraction: float,
    style: FacadeStyle,
    roof: str,
    draw: np.random.Generator,
) -> SurfaceMaterials:
    """Build chimneys on a pitched roof, and on some a row of dormers towards the street."""
    chimneys = [0.6 * x] if x < MIN_ROW_M else [-0.5 * x, 0.5 * x]
    parts: SurfaceMaterials = [(build_chimneys(chimneys, eaves + ROOF_SLOPE * y), "brick")]
    if draw.random() < dormer_fraction:
        places = np.linspace(-0.55 * x, 0.55 * x, max(2, int(x / 2.2)))
        parts += build_dormers([float(at) for at in places], y, eaves, style.wall, roof, style.trim)
    return parts


def _inset(length_m: float) -> float:
    """Half the length of walls: a little inside the foundation, or both would flicker."""
    return length_m / 2 - 0.08


def _build_walls(
    x: float,
    y: float,
    list_storeys: Callable[..., list[Storey]],
    style: FacadeStyle,
    draw: np.random.Generator,
) -> SurfaceMaterials:
    """Build the façades of a building of half the size (x, y); its front faces -y."""
    parts: SurfaceMaterials = []
    for number, (width, away) in enumerate(((x, y), (y, x), (x, y), (y, x))):
        yaw = number * np.pi / 2
        offset = (away * np.sin(yaw), -away * np.cos(yaw), 0.0)
        storeys = list_storeys(2 * width, is_front=number == 0)
        parts += [
            (move_surface(surface, offset, yaw=yaw), material)
            for surface, material in build_facade(2 * width, storeys, style, draw)
        ]
    return parts


def build_pitched_roof(
    x: float,
    y: float,
    eaves: float,
    overhang: float,
    wall: str,
    roof: str,
    slope: float = ROOF_SLOPE,
) -> SurfaceMaterials:
    """Build a roof with gables over walls of half the size (x, y), rising by `slope` over run."""
    return [
        (_build_gable_walls(x, y, eaves, slope), wall),
        (_build_gable_roof(x, y, eaves, overhang, slope), roof),
        (build_gutters(x, y, eaves, overhang, slope), "metal"),
    ]


def _build_garden_hedges(lot: Lot, site: Site, draw: np.random.Generator) -> list[MeshPart]:
    """Build hedges along the front garden, with a gap at the door, where the ground is free."""
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
        hedges += build_foliage(hedge, HEDGE_LEAF_M, draw)
    return hedges


def _build_gable_roof(
    x: float, y: float, eaves: float, overhang: float, slope: float
) -> TriangleSurface:
    """Build a pitched roof with its ridge along x: a folded slab from gable to gable."""
    span = y + overhang
    rise, drop, thick = slope * span, slope * overhang, ROOF_THICKNESS_M
    fold = [(-span, eaves - drop), (0.0, eaves - drop + rise), (span, eaves - drop)]
    outline = [*fold, *((b, z + thick) for b, z in fold[::-1])]
    ends = [[(end, b, z) for b, z in outline] for end in (-x - overhang, x + overhang)]
    # The folded profile is not star-shaped, as caps must be, so each half is lofted by itself.
    profile = np.asarray(ends)
    halves = profile[:, [0, 1, 4, 5]], profile[:, [1, 2, 3, 4]]
    return join_surfaces([loft_rings(half) for half in halves])


def _build_gable_walls(x: float, y: float, eaves: float, slope: float) -> TriangleSurface:
    """Build the triangular walls under a pitched roof, as a prism through the building."""
    gable = [(-y, eaves), (y, eaves), (0.0, eaves + slope * y)]
    return loft_rings(np.stack([[(side, *point) for point in gable] for side in (-x, x)]))
