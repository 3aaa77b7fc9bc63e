"""Builds buildings on footprints of any shape: façades along every side, and a roof."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import shapely
from advercity_dsl.road import BuildingUse, Roof, Surrounding
from shapely.geometry.base import BaseGeometry

from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import (
    MeshPart,
    TriangleSurface,
    build_ribbon,
    extract_polygons,
    join_surfaces,
    move_surface,
    triangulate_polygon,
)
from advercity.randomness import create_generator
from advercity.scene.buildings import (
    FLOOR_M,
    HOUSE_WALLS,
    ROOFS,
    TOWN_WALLS,
    build_pitched_roof,
    draw_style,
)
from advercity.scene.facades import FacadeStyle, Storey, SurfaceMaterials, build_storeys
from advercity.scene.roof_details import ROOF_SLOPE
from advercity.scene.rooms import SHOP_SILL_M, SILL_M
from advercity.scene.site import Site
from advercity.semantics import Semantic

HOUSE_AREA_M2, HOUSE_HEIGHT_M = 220.0, 9.0
"""Smaller and lower buildings without shops are houses."""
HOUSE_HEIGHT_RANGE_M, BLOCK_HEIGHT_RANGE_M = (5.5, 8.0), (6.5, 15.0)
"""Heights of buildings without one in the map."""
MIN_WINDOWED_M = 2.2
MAX_WINDOWED_DISTANCE_M = 45.0
MIN_STOREY_M = 2.0
"""Shorter and lower sides, and sides further from streets, have no windows."""
SIMPLIFY_M, MIN_AREA_M2 = 0.25, 4.0
HALL_WALLS = ("cladding", "plaster_grey", "concrete")
HALL_ROOFS, HALL_SLOPE = ("cladding",), 0.25
HALL_WINDOW_M, HALL_LINTEL_M = 1.2, 0.5
"""Height of the windows of a hall, and of the wall above them."""
HALL_GATE_M, HALL_PIER_M = 4.2, 0.4
"""Greatest height of the gate of a hall, and how much narrower than its bay it is."""
SHOP_WIDTH_M = 4.2
OVERHANG_M, PARAPET_M, PARAPET_WIDTH_M = 0.4, 0.45, 0.25
MAX_RUN_FRACTION = 0.95
"""Greatest reach of hips inwards, as a fraction of the way to the middle."""
FASCIA_M = 0.2
MAX_ROOF_FRACTION = 0.45
"""Greatest part of the roof in a building's height."""
MIN_EAVES_M = 2.3
ROOM_DEPTHS_M = (3.0, 1.0)
MIN_RECTANGULARITY = 0.92
"""Least ratio of a footprint with a gable to its smallest rectangle, by area."""


@dataclass(frozen=True)
class _BuildingType:
    """Common properties of the buildings of a use.

    Attributes:
        height_range_m: Height of buildings without one in the map.
        walls: Materials of which their walls are drawn.
        roofs: Materials of which their pitched roofs are drawn.
        slope: Rise over run of these, where the height of the building allows it.
        is_pitched: Whether their roofs are pitched unless the map says otherwise.
        has_shops: Whether there are shops on the ground floor at the street.
        has_balconies: Whether there are balconies above it.
        is_hall: Whether it has one storey of any height, with windows below the eaves.
    """

    height_range_m: tuple[float, float]
    walls: tuple[str, ...]
    roofs: tuple[str, ...] = ROOFS
    slope: float = ROOF_SLOPE
    is_pitched: bool = False
    has_shops: bool = False
    has_balconies: bool = False
    is_hall: bool = False


_HOUSE = _BuildingType(HOUSE_HEIGHT_RANGE_M, HOUSE_WALLS, is_pitched=True)
_BLOCK = _BuildingType(BLOCK_HEIGHT_RANGE_M, TOWN_WALLS)
_FLATS = _BuildingType(BLOCK_HEIGHT_RANGE_M, TOWN_WALLS, has_balconies=True)
_SHOPS = _BuildingType(BLOCK_HEIGHT_RANGE_M, TOWN_WALLS, has_shops=True)
_HALL = _BuildingType((5.0, 9.0), HALL_WALLS, HALL_ROOFS, HALL_SLOPE, is_hall=True)


def build_on_footprint(declared: Surrounding, site: Site, key: str) -> list[MeshPart]:
    """Build a building within its outline, except on reserved ground."""
    outline = shapely.make_valid(shapely.Polygon(declared.line_m))
    free = shapely.difference(outline, site.reserved_area)
    parts: list[MeshPart] = []
    for number, polygon in enumerate(extract_polygons(free)):
        plain = shapely.simplify(shapely.Polygon(polygon.exterior), SIMPLIFY_M)
        if plain.area > MIN_AREA_M2:
            footprint = shapely.orient_polygons(plain)
            parts += _build(footprint, declared, site, f"{key}/{number}")
    return parts


def _select_type(use: BuildingUse | None, area_m2: float, height_m: float | None) -> _BuildingType:
    if use == "industrial":
        return _HALL
    if use == "commercial":
        return _SHOPS
    is_house = area_m2 < HOUSE_AREA_M2 and (height_m or 0.0) <= HOUSE_HEIGHT_M
    return _HOUSE if is_house else _FLATS if use == "residential" else _BLOCK


def _build(
    footprint: shapely.Polygon, declared: Surrounding, site: Site, key: str
) -> list[MeshPart]:
    draw = create_generator("footprints", key)
    corners = shapely.get_coordinates(footprint.exterior)
    kind = _select_type(declared.use, footprint.area, declared.height_m)
    drawn_m = float(draw.uniform(*kind.height_range_m))
    total_m = declared.height_m or drawn_m
    drawn = draw_style(kind.walls, draw)
    style = replace(drawn, has_shutters=drawn.has_shutters and kind is _HOUSE)
    chosen = declared.roof or ("gabled" if kind.is_pitched else "flat")
    rise_m = 0.0 if chosen == "flat" else _compute_rise(footprint, kind.slope, total_m)
    tiles = str(draw.choice(kind.roofs))
    eaves_m = total_m - rise_m
    parts = [
        *_build_walls(corners, eaves_m, kind, style, site, draw),
        *_build_rooms(footprint, eaves_m),
        *_build_roof(chosen, footprint, eaves_m, rise_m, style.wall, tiles),
    ]
    ground = site.ground_height(corners)
    base = _build_band(corners, float(ground.min() - ground.max()) - 0.5, 0.0)
    return [
        MeshPart(move_surface(surface, (0, 0, float(ground.max()))), material, Semantic.BUILDING)
        for surface, material in ((base, "concrete"), *parts)
    ]


def _compute_rise(footprint: shapely.Polygon, slope: float, total_m: float) -> float:
    half_width = shapely.length(shapely.maximum_inscribed_circle(footprint, 0.1))
    limit_m = min(MAX_ROOF_FRACTION * total_m, total_m - MIN_EAVES_M)
    return max(min(slope * float(half_width), limit_m), 0.3)


def _build_walls(
    corners: Float64Array,
    eaves_m: float,
    kind: _BuildingType,
    style: FacadeStyle,
    site: Site,
    draw: np.random.Generator,
) -> Iterator[tuple[TriangleSurface, str]]:
    """Build façades along a counter-clockwise ring (n, 2); a long side near a street has a door."""
    middles, steps = (corners[:-1] + corners[1:]) / 2, np.diff(corners, axis=0)
    lengths = np.hypot(*steps.T)
    away_m = np.array(shapely.distance(site.street_axes, shapely.points(middles)))
    front = int(np.argmax(lengths - away_m))
    bay_m, width_m = float(draw.uniform(2.6, 3.6)), float(draw.uniform(1.0, 1.5))
    for index, (middle, step, length) in enumerate(zip(middles, steps, lengths, strict=True)):
        has_windows = length > MIN_WINDOWED_M and away_m[index] < MAX_WINDOWED_DISTANCE_M
        if not has_windows or eaves_m < MIN_STOREY_M:
            yield _build_band(corners[index : index + 2], 0.0, eaves_m), style.wall
            continue
        count = max(1, int(length / bay_m))
        opening_m = min(width_m, length / count - 0.6)
        door_at = count // 2 if index == front else None
        if kind.is_hall:
            storeys = [_build_hall_storey(eaves_m, count, length / count, opening_m, door_at)]
        else:
            storeys = _list_storeys(eaves_m, count, opening_m, door_at)
        if index == front:
            storeys = _furnish_front(storeys, kind, float(length))
        yaw = float(np.arctan2(step[1], step[0]))
        for surface, material in build_storeys(float(length), storeys, style, draw):
            yield move_surface(surface, (*middle, 0.0), yaw=yaw), material


def _list_storeys(
    eaves_m: float, openings: int, opening_m: float, door_at: int | None
) -> list[Storey]:
    floors = max(1, round(eaves_m / FLOOR_M))
    rise_m = eaves_m / floors
    return [
        Storey(
            bottom_m=rise_m * floor,
            height_m=rise_m,
            openings=openings,
            width_m=opening_m,
            sill_m=SILL_M,
            opening_m=min(1.5, rise_m - SILL_M - 0.3),
            door_at=door_at if floor == 0 else None,
        )
        for floor in range(floors)
    ]


def _build_hall_storey(
    eaves_m: float, openings: int, bay_m: float, opening_m: float, door_at: int | None
) -> Storey:
    height_m = min(HALL_WINDOW_M, eaves_m / 3)
    sill_m = eaves_m - height_m - HALL_LINTEL_M
    gate_m = bay_m - HALL_PIER_M, min(HALL_GATE_M, eaves_m - HALL_LINTEL_M)
    return Storey(0.0, eaves_m, openings, opening_m, sill_m, height_m, door_at, gate_m=gate_m)


def _furnish_front(storeys: list[Storey], kind: _BuildingType, length_m: float) -> list[Storey]:
    """Add the shops and balconies of a building type to the side at the street."""
    ground, *upper = storeys
    if kind.has_shops:
        ground = _add_shops(ground, length_m)
    if kind.has_balconies:
        upper = [
            replace(item, sill_m=0.15, opening_m=item.height_m - 0.8, has_balconies=True)
            for item in upper
        ]
    return [ground, *upper]


def _add_shops(storey: Storey, length_m: float) -> Storey:
    """Replace the windows of a ground floor by panes of shops, with a door in the middle."""
    count = max(1, int(length_m / SHOP_WIDTH_M)) | 1
    return replace(
        storey,
        openings=count,
        width_m=length_m / count - 0.7,
        sill_m=SHOP_SILL_M,
        opening_m=min(2.2, storey.height_m - SHOP_SILL_M - 0.3),
        door_at=count // 2,
        is_shop=True,
    )


def _build_rooms(footprint: shapely.Polygon, top_m: float) -> Iterator[tuple[TriangleSurface, str]]:
    """Build the far walls of rooms, where laser beams through windows end."""
    for depth_m in ROOM_DEPTHS_M:
        inside = extract_polygons(shapely.buffer(footprint, -depth_m, join_style="mitre"))
        for polygon in inside:
            yield _build_band(_exterior(polygon), 0.0, top_m), "plaster"
        if inside:
            return


def _build_roof(
    roof: Roof, footprint: shapely.Polygon, eaves_m: float, rise_m: float, wall: str, tiles: str
) -> SurfaceMaterials:
    if roof == "flat":
        return _build_flat_roof(footprint, eaves_m)
    for rectangle in extract_polygons(shapely.minimum_rotated_rectangle(footprint)):
        fills = footprint.area > MIN_RECTANGULARITY * rectangle.area
        if roof == "gabled" and fills:
            return _build_gables(_exterior(rectangle), eaves_m, rise_m, wall, tiles)
    return _build_hips(footprint, eaves_m, rise_m, tiles)


def _build_flat_roof(footprint: shapely.Polygon, eaves_m: float) -> SurfaceMaterials:
    inside = shapely.buffer(footprint, -PARAPET_WIDTH_M, join_style="mitre")
    top_m = eaves_m + PARAPET_M
    parts = [_build_band(_exterior(footprint), eaves_m, top_m), *_build_deck(footprint, eaves_m)]
    parts += _build_deck(shapely.difference(footprint, inside), top_m)
    parts += [
        _build_band(_exterior(polygon)[::-1], eaves_m, top_m)
        for polygon in extract_polygons(inside)
    ]
    return [(join_surfaces(parts), "concrete")]


def _build_gables(
    corners: Float64Array, eaves_m: float, rise_m: float, wall: str, tiles: str
) -> SurfaceMaterials:
    """Build a roof with its ridge along the longer side of a rectangle (5, 2)."""
    sides = np.diff(corners[:3], axis=0)
    lengths = np.hypot(*sides.T)
    along = int(np.argmax(lengths))
    yaw = float(np.arctan2(sides[along, 1], sides[along, 0]))
    middle = (*corners[:4].mean(axis=0), 0.0)
    half = lengths[along] / 2, lengths[1 - along] / 2
    parts = build_pitched_roof(*half, eaves_m, OVERHANG_M, wall, tiles, rise_m / half[1])
    return [(move_surface(surface, middle, yaw=yaw), material) for surface, material in parts]


def _build_hips(
    footprint: shapely.Polygon, eaves_m: float, rise_m: float, tiles: str
) -> SurfaceMaterials:
    """Build slopes from every side up to a flat top, which a narrow building hardly has."""
    eaves = shapely.buffer(footprint, OVERHANG_M, join_style="mitre", mitre_limit=2.0)
    run_m = MAX_RUN_FRACTION * shapely.length(shapely.maximum_inscribed_circle(eaves, 0.1))
    top = shapely.buffer(eaves, -run_m, join_style="mitre")
    shapely.prepare(eaves)
    border = shapely.boundary(eaves)
    parts = _build_deck(top, eaves_m + rise_m)
    for polygon in extract_polygons(shapely.difference(eaves, top)):
        corners, triangles = triangulate_polygon(polygon)
        is_top = shapely.distance(border, shapely.points(corners)) > run_m / 2
        slopes = np.column_stack([corners, eaves_m + rise_m * is_top])
        parts.append(TriangleSurface(slopes, triangles))
    for polygon in extract_polygons(eaves):
        parts.append(_build_band(_exterior(polygon), eaves_m - FASCIA_M, eaves_m))
    for soffit in _build_deck(eaves, eaves_m - FASCIA_M):
        parts.append(TriangleSurface(soffit.vertices, soffit.triangles[:, ::-1]))
    return [(join_surfaces(parts), tiles)]


def _exterior(polygon: shapely.Polygon) -> Float64Array:
    """List the corners (n, 2) of a polygon counter-clockwise; the last is the first again."""
    return shapely.get_coordinates(shapely.orient_polygons(polygon).exterior)


def _build_deck(area: BaseGeometry, z_m: float) -> list[TriangleSurface]:
    found = [triangulate_polygon(polygon) for polygon in extract_polygons(area)]
    return [
        TriangleSurface(np.column_stack([corners, np.full(len(corners), z_m)]), triangles)
        for corners, triangles in found
    ]


def _build_band(line: Float64Array, bottom_m: float, top_m: float) -> TriangleSurface:
    """Build an upright band along a line (n, 2), visible from its right."""
    low, high = (np.column_stack([line, np.full(len(line), z)]) for z in (bottom_m, top_m))
    return build_ribbon(high, low)
