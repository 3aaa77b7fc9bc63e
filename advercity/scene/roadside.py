"""Builds roadside objects: walls, fences, hedges, shelters, towers, poles, driveways."""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
import shapely
from advercity_dsl.road import StripKind
from advercity_dsl.units import Point2
from shapely.geometry.base import BaseGeometry

from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import (
    MeshPart,
    TriangleSurface,
    build_grid_cells,
    extract_polygons,
    join_surfaces,
    move_surface,
    repeat_surface,
    shade_smooth,
    triangulate_polygon,
    xyz,
)
from advercity.geometry.primitives import (
    box,
    grid_sheet,
    loft_rings,
    plate,
    tube,
)
from advercity.randomness import create_generator
from advercity.roads.road_meshes import KERB_HEIGHT_M
from advercity.scene.foliage import HEDGE_LEAF_M, build_foliage
from advercity.scene.site import Site, StreetSide, sample_ground_line
from advercity.semantics import Semantic

WALL_HEIGHT_M, WALL_THICKNESS_M = 2.0, 0.4
FENCE_HEIGHT_M, HEDGE_HEIGHT_M = 1.2, 1.4
POLE_HEIGHT_M, TOWER_HEIGHT_M = 5.0, 12.0
LAMP_SPACING_M = 30.0
_DRIVEWAY_STEP_M, _KERB_RAMP_M = 1.0, 0.7
_WALL_PIECE_M, _FENCE_BAY_M, _HEDGE_STEP_M = 8.0, 2.6, 1.6
_WATER_STEP_M, _WATER_RISE_M = 8.0, 0.08
_PAVED_STEP_M, _PAVED_RISE_M, _PAVED_OVERLAP_M = 6.0, 0.015, 0.15
_SPIKE_M = 0.3
"""Height of the top of a tower: thin, so it does not block the view of its sensors."""


def build_wall(line: Sequence[Point2], height_m: float | None, site: Site) -> list[MeshPart]:
    """Build a wall along a line: brick if low, concrete with coping and pilasters if it retains."""
    foot = sample_ground_line(line, _WALL_PIECE_M, site)
    height = height_m or WALL_HEIGHT_M
    retaining = height > 3.0
    body: list[TriangleSurface] = []
    trim: list[TriangleSurface] = []
    for start, end in pairwise(foot):
        low = min(start[2], end[2])
        top = low + height
        body.append(_build_slab(start, end, low - 0.6, top - 0.2, WALL_THICKNESS_M))
        trim.append(_build_slab(start, end, top - 0.2, top, WALL_THICKNESS_M + 0.12))
        if retaining:
            trim.append(_build_pilaster(start, end, low, height))
    material = "concrete" if retaining else "brick"
    return [
        MeshPart(join_surfaces(map(shade_smooth, body)), material, Semantic.WALL),
        MeshPart(join_surfaces(map(shade_smooth, trim)), "kerb", Semantic.WALL),
    ]


def build_fence(line: Sequence[Point2], height_m: float | None, site: Site) -> list[MeshPart]:
    """Build a fence along a line, of posts and three rails."""
    height = height_m or FENCE_HEIGHT_M
    foot = sample_ground_line(line, _FENCE_BAY_M, site)
    post = shade_smooth(box((-0.05, -0.05, -0.3), (0.05, 0.05, height)))
    rails = [
        shade_smooth(tube(foot + xyz(z=fraction * height), 0.045, sides=4))
        for fraction in (0.35, 0.65, 0.93)
    ]
    return [MeshPart(join_surfaces([repeat_surface(post, foot), *rails]), "wood", Semantic.FENCE)]


def build_hedge(
    line: Sequence[Point2], height_m: float | None, site: Site, key: str
) -> list[MeshPart]:
    """Build a clipped hedge along a line."""
    height = height_m or HEDGE_HEIGHT_M
    foot = sample_ground_line(line, _HEDGE_STEP_M, site)
    run = np.gradient(foot[:, :2], axis=0)
    lateral = np.column_stack([-run[:, 1], run[:, 0]])
    lateral /= np.linalg.norm(lateral, axis=1, keepdims=True)
    across = np.array([0.34, 0.40, 0.38, 0.24, -0.24, -0.38, -0.40, -0.34])
    rise = np.array([-0.3, 0.15, 0.8, 1.0, 1.0, 0.8, 0.15, -0.3]) * height
    draw = create_generator("hedge", key)
    rough = draw.uniform(0.9, 1.08, (2, len(foot), len(across)))
    rings = np.empty((len(foot), len(across), 3))
    rings[..., :2] = foot[:, None, :2] + (across * rough[0])[..., None] * lateral[:, None]
    rings[..., 2] = foot[:, None, 2] + rise * rough[1]
    return build_foliage(loft_rings(rings), HEDGE_LEAF_M, draw)


def _build_slab(
    start: Float64Array, end: Float64Array, bottom: float, top: float, thickness: float
) -> TriangleSurface:
    direction = (end - start)[:2] / np.linalg.norm((end - start)[:2])
    side = thickness / 2 * np.array([-direction[1], direction[0]])
    outline = [start[:2] - side, end[:2] - side, end[:2] + side, start[:2] + side]
    rings = [np.column_stack([outline, np.full(4, z)]) for z in (bottom, top)]
    return loft_rings(np.stack(rings))


def _build_pilaster(
    start: Float64Array, end: Float64Array, low: float, height: float
) -> TriangleSurface:
    along = (end - start) / np.linalg.norm((end - start)[:2])
    half = min(0.3, np.linalg.norm((end - start)[:2]) / 2)
    middle = (start + end) / 2
    a, b = middle - half * along, middle + half * along
    return _build_slab(a, b, low - 0.6, low + height - 0.2, WALL_THICKNESS_M + 0.25)


def build_water(outline: Sequence[Point2], site: Site) -> list[MeshPart]:
    """Build still water within an outline: a film over the ground, which has no hollow for it."""
    area = shapely.difference(shapely.make_valid(shapely.Polygon(outline)), site.reserved_area)
    return [
        MeshPart(film, "water", Semantic.WATER)
        for film in _build_films(area, _WATER_STEP_M, _WATER_RISE_M, site)
    ]


def build_paved_band(side: StreetSide, site: Site) -> list[MeshPart]:
    """Build slabs over the ground of a band, as before the shops of a town."""
    near_m = side.near_offset_m - _PAVED_OVERLAP_M
    lines = [side.offset_line(at) for at in (near_m, side.far_offset_m)]
    outline = shapely.make_valid(shapely.Polygon(np.concatenate([lines[0], lines[1][::-1]])))
    # Over the edge of the sidewalk, or grass would show below the film's own edge.
    area = shapely.difference(outline, shapely.buffer(site.paved_area, -_PAVED_OVERLAP_M))
    return [
        MeshPart(film, "pavement", Semantic.SIDEWALK)
        for film in _build_films(area, _PAVED_STEP_M, _PAVED_RISE_M, site)
    ]


def _build_films(
    area: BaseGeometry, step_m: float, rise_m: float, site: Site
) -> Iterator[TriangleSurface]:
    """Build films over the ground of an area, in cells of a step; none of an empty area."""
    if area.is_empty:
        return
    cells = shapely.intersection(build_grid_cells(area.bounds, step_m), area)
    for polygon in (part for cell in cells for part in extract_polygons(cell)):
        corners, triangles = triangulate_polygon(polygon)
        yield TriangleSurface(site.project_to_ground(corners) + xyz(z=rise_m), triangles)


def build_bus_stop(at: Point2, site: Site) -> list[MeshPart]:
    """Build a glazed shelter, open to the nearest street, with a bench and a sign on a mast."""
    frame = [
        box((x - 0.04, y - 0.04, 0), (x + 0.04, y + 0.04, 2.4))
        for x, y in ((-1.9, -0.65), (1.9, -0.65), (-1.9, 0.65), (1.9, 0.65), (0, 0.65))
    ]
    frame.append(box((-2.15, -1.0, 2.4), (2.15, 0.85, 2.52)))
    glazing = [
        box((-1.85, 0.63, 0.35), (-0.05, 0.66, 2.25)),
        box((0.05, 0.63, 0.35), (1.85, 0.66, 2.25)),
        box((-1.92, -0.6, 0.35), (-1.89, 0.6, 2.25)),
        box((1.89, -0.6, 0.35), (1.92, 0.6, 2.25)),
    ]
    bench = [box((-1.2, 0.15, 0.42), (1.2, 0.52, 0.48)), box((-0.9, 0.25, 0), (0.9, 0.4, 0.42))]
    sign = plate(
        [(2.62, -0.55, 2.3), (3.02, -0.55, 2.3), (3.02, -0.55, 2.9), (2.62, -0.55, 2.9)], 0.03
    )
    parts = [
        (join_surfaces(frame), "metal", Semantic.STATIC),
        (join_surfaces(glazing), "glass", Semantic.STATIC),
        (join_surfaces(bench), "wood", Semantic.STATIC),
        (tube([(2.6, -0.55, 0), (2.6, -0.55, 2.95)], 0.04), "metal", Semantic.POLE),
        (sign, "sign_yellow", Semantic.TRAFFIC_SIGN),
    ]
    # The shelter is open along -y of its own axes.
    return _place_on_ground(parts, at, site, turn=np.pi / 2)


def build_tower(at: Point2, height_m: float | None, site: Site) -> list[MeshPart]:
    """Build a wind pump facing the street: a lattice tower with a wheel below its top."""
    top = height_m or TOWER_HEIGHT_M
    steel = [
        *_build_lattice(top - _SPIKE_M),
        tube([(0, 0, top - 2 * _SPIKE_M), (0, 0, top)], 0.04, sides=6),
    ]
    parts = [(join_surfaces(map(shade_smooth, steel)), "metal", Semantic.STATIC)]
    parts += [(part, "enamel_white", Semantic.STATIC) for part in _build_wind_wheel(top)]
    return _place_on_ground(parts, at, site)


def _build_lattice(top: float) -> list[TriangleSurface]:
    """Build four converging legs with rings and crossed braces."""
    signs = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)])
    levels = np.linspace(0, 1, 6)
    half_width = 0.13 * top * (1 - levels) + 0.09 * levels
    corners = np.empty((6, 4, 3))
    corners[..., :2] = half_width[:, None, None] * signs
    corners[..., 2] = (top * levels)[:, None]
    following = np.roll(corners, -1, axis=1)
    legs = [tube([corners[0, k] - xyz(z=0.3), corners[-1, k]], 0.055, sides=5) for k in range(4)]
    ends = [
        *zip(corners[:-1], following[1:], strict=True),
        *zip(following[:-1], corners[1:], strict=True),
    ]
    braces = [tube([a[k], b[k]], 0.025, sides=4) for a, b in ends for k in range(4)]
    rings = [
        tube([a[k], b[k]], 0.03, sides=4)
        for a, b in zip(corners[1:], following[1:], strict=True)
        for k in range(4)
    ]
    return [*legs, *braces, *rings]


def _build_wind_wheel(top: float) -> list[TriangleSurface]:
    """Build blades and tail, low and narrow enough to leave the view from the top free."""
    hub, radius, ahead = 0.78 * top, 0.14 * top, 0.06 * top
    blades: list[TriangleSurface] = []
    for angle in 2 * np.pi * np.arange(12) / 12:
        out = np.array([0.0, np.cos(angle), np.sin(angle)])
        side = np.array([0.25, -np.sin(angle), np.cos(angle)])
        middle = np.array([ahead, 0.0, hub])
        inner, outer = middle + 0.3 * radius * out, middle + radius * out
        narrow, wide = 0.06 * radius * side, 0.17 * radius * side
        blades.append(plate([inner - narrow, outer - wide, outer + wide, inner + narrow], 0.015))
    axle = tube([(ahead + 0.05, 0, hub), (-1.6 * radius, 0, hub)], 0.04, sides=6)
    tail = plate(
        [
            (-1.5 * radius, 0.01, hub - 0.3 * radius),
            (-0.9 * radius, 0.01, hub - 0.1 * radius),
            (-0.9 * radius, 0.01, hub + 0.1 * radius),
            (-1.5 * radius, 0.01, hub + 0.3 * radius),
        ],
        0.02,
    )
    return [*blades, axle, tail]


def build_pole(at: Point2, height_m: float | None, site: Site) -> list[MeshPart]:
    """Build a plain mast."""
    top = height_m or POLE_HEIGHT_M
    mast = tube([(0, 0, -0.3), (0, 0, top)], [0.09, 0.06])
    return _place_on_ground([(mast, "metal", Semantic.POLE)], at, site)


def build_driveway(side: StreetSide, site: Site) -> list[MeshPart]:
    """Build a paved band from a street's paving outwards, and its ramp over the kerb."""
    along = np.linspace(0.0, side.length_m, 2 + int(side.length_m / _DRIVEWAY_STEP_M))
    plane = side.sample_grid(_DRIVEWAY_STEP_M, _DRIVEWAY_STEP_M)
    paved = site.project_to_ground(plane.reshape(-1, 2)).reshape(*plane.shape[:2], 3) + xyz(z=0.015)
    pieces = [MeshPart(grid_sheet(paved), "asphalt", Semantic.ROAD)]
    walk = next((band for band in side.strips if band.kind is StripKind.SIDEWALK), None)
    if walk is not None:
        kerb = side.sign * abs(walk.inner_t)
        station = side.start_m + along
        top = side.street.points_at(station, kerb) + xyz(z=KERB_HEIGHT_M + 0.004)
        foot = side.street.points_at(station, kerb - side.sign * _KERB_RAMP_M) + xyz(z=0.004)
        pieces.append(MeshPart(grid_sheet(np.stack([foot, top])), "concrete", Semantic.SIDEWALK))
    return pieces


def _place_on_ground(
    parts: list[tuple[TriangleSurface, str, Semantic]], at: Point2, site: Site, *, turn: float = 0.0
) -> list[MeshPart]:
    """Move parts from the origin onto the ground, with their x axis towards the nearest street."""
    yaw = site.yaw_to_street(at) + turn
    foot = site.project_to_ground([at])[0]
    return [
        MeshPart(move_surface(surface, foot, yaw=yaw), material, semantic)
        for surface, material, semantic in parts
    ]
