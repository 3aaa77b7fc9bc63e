"""Builds buildings on footprints of any shape: façades along every side, and a roof."""

from collections.abc import Iterator, Sequence

import numpy as np
import shapely
from advercity_dsl.road import Roof
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
    ROOF_SLOPE,
    ROOFS,
    TOWN_WALLS,
    build_pitched_roof,
    draw_style,
)
from advercity.scene.facades import FacadeStyle, Storey, SurfaceMaterials, build_storeys
from advercity.scene.site import Site
from advercity.semantics import Semantic

HOUSE_AREA_M2, HOUSE_HEIGHT_M = 220.0, 9.0
"""Smaller and lower buildings are houses, with a pitched roof unless the map says otherwise."""
HOUSE_HEIGHT_RANGE_M, BLOCK_HEIGHT_RANGE_M = (5.5, 8.0), (6.5, 15.0)
"""Heights of buildings whose map has none."""
MIN_WINDOWED_M = 2.2
MAX_WINDOWED_DISTANCE_M = 45.0
MIN_STOREY_M = 2.0
"""Shorter and lower sides, and those that are further from streets, have no windows."""
SIMPLIFY_M, MIN_AREA_M2 = 0.25, 4.0
SILL_HEIGHT_M = 0.9
OVERHANG_M, PARAPET_M, PARAPET_WIDTH_M = 0.4, 0.45, 0.25
MAX_RUN_FRACTION = 0.95
"""How far hips reach inwards, of the way to the middle."""
FASCIA_M, RIDGE_TOLERANCE_M = 0.2, 0.3
MAX_ROOF_FRACTION = 0.45
"""Greatest part of a building's height that is roof."""
MIN_EAVES_M = 2.3
ROOM_DEPTHS_M = (3.0, 1.0)
MIN_RECTANGULARITY = 0.92
"""Fraction of its smallest rectangle that a footprint fills to have a gable."""


def build_on_footprint(
    outline: Sequence[tuple[float, float]],
    height_m: float | None,
    roof: Roof | None,
    site: Site,
    key: str,
) -> list[MeshPart]:
    """Build a building within an outline, without what overlaps reserved ground."""
    free = shapely.difference(shapely.make_valid(shapely.Polygon(outline)), site.reserved_area)
    parts: list[MeshPart] = []
    for number, polygon in enumerate(extract_polygons(free)):
        plain = shapely.simplify(shapely.Polygon(polygon.exterior), SIMPLIFY_M)
        if plain.area > MIN_AREA_M2:
            footprint = shapely.orient_polygons(plain)
            parts += _build(footprint, height_m, roof, site, f"{key}/{number}")
    return parts


def _build(
    footprint: shapely.Polygon, height_m: float | None, roof: Roof | None, site: Site, key: str
) -> list[MeshPart]:
    draw = create_generator("footprints", key)
    corners = shapely.get_coordinates(footprint.exterior)
    is_small = footprint.area < HOUSE_AREA_M2
    drawn_m = float(draw.uniform(*(HOUSE_HEIGHT_RANGE_M if is_small else BLOCK_HEIGHT_RANGE_M)))
    total_m = height_m or drawn_m
    is_house = is_small and total_m <= HOUSE_HEIGHT_M
    style = draw_style(HOUSE_WALLS if is_house else TOWN_WALLS, draw)
    chosen = roof or ("gabled" if is_house else "flat")
    rise_m = 0.0 if chosen == "flat" else _compute_rise(footprint, total_m)
    tiles = str(draw.choice(ROOFS))
    eaves_m = total_m - rise_m
    parts = [
        *_build_walls(corners, eaves_m, style, site, draw),
        *_build_rooms(footprint, eaves_m),
        *_build_roof(chosen, footprint, eaves_m, rise_m, style.wall, tiles),
    ]
    ground = site.ground_height(corners)
    base = _build_band(corners, float(ground.min() - ground.max()) - 0.5, 0.0)
    return [
        MeshPart(move_surface(surface, (0, 0, float(ground.max()))), material, Semantic.BUILDING)
        for surface, material in ((base, "concrete"), *parts)
    ]


def _compute_rise(footprint: shapely.Polygon, total_m: float) -> float:
    half_width = shapely.length(shapely.maximum_inscribed_circle(footprint, 0.1))
    limit_m = min(MAX_ROOF_FRACTION * total_m, total_m - MIN_EAVES_M)
    return max(min(ROOF_SLOPE * float(half_width), limit_m), 0.3)


def _build_walls(
    corners: Float64Array,
    eaves_m: float,
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
        storeys = _list_storeys(eaves_m, count, opening_m, count // 2 if index == front else None)
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
            sill_m=SILL_HEIGHT_M,
            opening_m=min(1.5, rise_m - SILL_HEIGHT_M - 0.3),
            door_at=door_at if floor == 0 else None,
        )
        for floor in range(floors)
    ]


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
        corners = _exterior(rectangle)
        half_width_m = float(np.hypot(*np.diff(corners[:3], axis=0).T).min()) / 2
        fills = footprint.area > MIN_RECTANGULARITY * rectangle.area
        if roof == "gabled" and fills and rise_m > ROOF_SLOPE * half_width_m - RIDGE_TOLERANCE_M:
            return _build_gables(corners, eaves_m, wall, tiles)
    return _build_hips(footprint, eaves_m, rise_m, tiles)


def _build_flat_roof(footprint: shapely.Polygon, eaves_m: float) -> SurfaceMaterials:
    """Build a flat roof with a parapet."""
    inside = shapely.buffer(footprint, -PARAPET_WIDTH_M, join_style="mitre")
    top_m = eaves_m + PARAPET_M
    parts = [_build_band(_exterior(footprint), eaves_m, top_m), *_build_deck(footprint, eaves_m)]
    parts += _build_deck(shapely.difference(footprint, inside), top_m)
    parts += [
        _build_band(_exterior(polygon)[::-1], eaves_m, top_m)
        for polygon in extract_polygons(inside)
    ]
    return [(join_surfaces(parts), "concrete")]


def _build_gables(corners: Float64Array, eaves_m: float, wall: str, tiles: str) -> SurfaceMaterials:
    """Build a roof with its ridge along the longer side of a rectangle (5, 2)."""
    sides = np.diff(corners[:3], axis=0)
    lengths = np.hypot(*sides.T)
    along = int(np.argmax(lengths))
    yaw = float(np.arctan2(sides[along, 1], sides[along, 0]))
    middle = (*corners[:4].mean(axis=0), 0.0)
    half = lengths[along] / 2, lengths[1 - along] / 2
    parts = build_pitched_roof(*half, eaves_m, OVERHANG_M, wall, tiles)
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
    """Build level areas that are seen from above."""
    found = [triangulate_polygon(polygon) for polygon in extract_polygons(area)]
    return [
        TriangleSurface(np.column_stack([corners, np.full(len(corners), z_m)]), triangles)
        for corners, triangles in found
    ]


def _build_band(line: Float64Array, bottom_m: float, top_m: float) -> TriangleSurface:
    """Build an upright band along a line (n, 2) that is seen from its right."""
    low, high = (np.column_stack([line, np.full(len(line), z)]) for z in (bottom_m, top_m))
    return build_ribbon(high, low)
