"""Builds fields: crops and tilled earth as sheets in rows, with single plants at their edges.

The sheet shows plants from above. At its border they stand one by one before the shade
between them, and near streets their ears rise from it.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
import shapely
from numpy.typing import NDArray

from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import MeshPart, TriangleSurface, normalize, xyz
from advercity.geometry.primitives import grid_sheet
from advercity.randomness import create_generator
from advercity.scene.seasons import Crop, find_crop
from advercity.scene.site import Rectangle, Site, StreetSide
from advercity.semantics import Semantic

CROP_CLEARANCE_M = 0.8
EARS_MAX_DISTANCE_M, DENSE_FRINGE_M, FRINGE_MAX_DISTANCE_M = 26.0, 14.0, 34.0
"""Distances from street axes up to which ears rise from a field, its border has all its plants,
and it has some of them."""
SPARSE_RATIO = 0.35
EARS_PER_TOP = 30
"""Ears about every point of a ridge."""
FURROW_HEIGHT_M, FURROW_RATIO = 0.28, 0.45
"""Height of ridges of tilled earth, and height of the furrows over it."""
MAIZE_HEIGHT_M = 1.4
"""Crops from this height on have broad leaves and gaps between their rows."""
_ROW_SPACING_M, _ALONG_ROW_STEP_M = 1.3, 3.0
_TRAMLINE_PERIOD, _TRAMLINES = 36, (10, 13)
"""Points across a field from one pass of the tractor to the next, and points under its wheels."""
_TRACK_RATIO, _BORDER_RATIO, _TOP_RATIO = 0.25, 0.62, 0.84
"""Height of the sheet over the height of plants: in the tracks of wheels, next to its border, and
elsewhere. At the border single plants rise from it."""
_BORDER_M, _SINK_M = 0.3, 0.05
"""How far the border of a sheet goes outwards where it falls, and how far below the ground."""


@dataclass(frozen=True)
class _Plant:
    """Sizes of a plant in metres, its number of leaves, and plants per metre."""

    per_m: float
    stem_width: float
    leaves: int
    leaf_length: float
    leaf_width: float
    ear_length: float
    ear_width: float
    row_ratio: float


_CEREAL = _Plant(150.0, 0.010, 1, 0.3, 0.014, 0.09, 0.016, row_ratio=0.93)
_MAIZE = _Plant(14.0, 0.03, 8, 0.65, 0.075, 0.28, 0.035, row_ratio=0.6)


def sample_rows(band: StreetSide | Rectangle) -> Float64Array:
    """Sample the points (n, m, 2) of a field, n along its rows, with two rows of points a ridge."""
    return band.sample_grid(_ALONG_ROW_STEP_M, _ROW_SPACING_M / 2)


def build_crops(rows: Float64Array, height_m: float | None, site: Site, key: str) -> list[MeshPart]:
    """Build a field of plants; they have a usual height without one.

    Points are (n, m, 2), n along the rows and m across. The season decides their state.
    """
    crop = find_crop(site.season, height_m)
    plant = _MAIZE if crop.height_m >= MAIZE_HEIGHT_M else _CEREAL
    cells = _find_sheet_cells(rows, site)
    if not cells.any():
        return []
    inside = ~find_border_points(cells)
    draw = create_generator("crops", key)
    top_ratio = _TOP_RATIO if crop.has_ears else 1.0
    rise = crop.height_m * top_ratio * _draw_canopy(rows, plant.row_ratio, draw)
    is_track = np.isin(np.arange(rows.shape[1]) % _TRAMLINE_PERIOD, _TRAMLINES)
    rise[:, is_track] = _TRACK_RATIO * crop.height_m
    top = find_cells_inside(inside)
    is_outermost = inside & find_border_points(top)
    rise[is_outermost] = np.minimum(rise[is_outermost], _BORDER_RATIO * crop.height_m)
    points = _place_sheet(rows, inside, rise, site)
    canopy = find_cells_inside(inside & ~is_outermost)
    sheets = [(canopy, crop.material), (cells & ~canopy, crop.shade)]
    parts = [(grid_sheet(points, of), material) for of, material in sheets if of.any()]
    parts += _build_fringe(points[..., :2], cells & top, crop, plant, site, key)
    is_ridge = inside & ~is_outermost & (np.arange(rows.shape[1]) % 2 == 1) & ~is_track
    near = shapely.distance(site.street_axes, shapely.points(rows)) < EARS_MAX_DISTANCE_M
    ears = _build_ears(points[is_ridge & near], plant, crop, key)
    if len(ears.triangles):
        parts.append((ears, crop.ears))
    return [MeshPart(surface, material, Semantic.VEGETATION) for surface, material in parts]


def build_tilled_field(rows: Float64Array, site: Site, key: str) -> list[MeshPart]:
    """Build bare earth in furrows over points (n, m, 2), as in `build_crops`."""
    cells = _find_sheet_cells(rows, site)
    if not cells.any():
        return []
    draw = create_generator("field", key)
    ridge = np.where(np.arange(rows.shape[1]) % 2, 1.0, FURROW_RATIO)
    rise = FURROW_HEIGHT_M * ridge * draw.uniform(0.82, 1.1, rows.shape[:2])
    points = _place_sheet(rows, ~find_border_points(cells), rise, site, is_steep=False)
    return [MeshPart(grid_sheet(points, cells), "soil", Semantic.TERRAIN)]


def find_free_cells(rows: Float64Array, free: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Find the cells (n - 1, m - 1) with free corners and the orientation of most of the grid."""
    a, b = rows[1:, :-1] - rows[:-1, :-1], rows[:-1, 1:] - rows[:-1, :-1]
    area = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    unfolded = area * np.sign(np.median(area)) > 0.1 * np.median(np.abs(area))
    return unfolded & find_cells_inside(free)


def find_border_points(cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Find the grid points not surrounded by cells of the field."""
    padded = np.pad(cells, 1)
    return ~(padded[:-1, :-1] & padded[1:, :-1] & padded[:-1, 1:] & padded[1:, 1:])


def find_cells_inside(points: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Find the cells of a grid whose four corners are among some points."""
    return points[:-1, :-1] & points[1:, :-1] & points[:-1, 1:] & points[1:, 1:]


def _find_sheet_cells(rows: Float64Array, site: Site) -> NDArray[np.bool_]:
    free = site.is_free(rows.reshape(-1, 2), CROP_CLEARANCE_M).reshape(rows.shape[:2])
    return find_free_cells(rows, free)


def _draw_canopy(rows: Float64Array, row_ratio: float, draw: np.random.Generator) -> Float64Array:
    """Draw the height (n, m) of a canopy around 1: rows, and effects of wind and soil."""
    x, y = np.moveaxis(rows, -1, 0)
    waves = np.sin(x / 5.3 + 1.7 * np.sin(y / 11.0)) + np.sin(y / 3.9 + 1.3 * np.sin(x / 8.0))
    ridge = np.where(np.arange(rows.shape[1]) % 2, 1.0, row_ratio)
    return ridge * (1.0 + 0.05 * waves) * draw.uniform(0.95, 1.05, rows.shape[:2])


def _place_sheet(
    rows: Float64Array,
    inside: NDArray[np.bool_],
    rise: Float64Array,
    site: Site,
    *,
    is_steep: bool = True,
) -> Float64Array:
    """Raise the points (n, m, 3) of a sheet from the ground, and sink its border below it.

    Without an open edge no gap shows below the sheet. A steep border follows the plants, not the
    last points of the grid.
    """
    plane = _draw_in_border(rows, inside) if is_steep else rows
    points = site.project_to_ground(plane.reshape(-1, 2)).reshape(*inside.shape, 3)
    points[..., 2] += np.where(inside, rise, -_SINK_M)
    return points


def _draw_in_border(rows: Float64Array, inside: NDArray[np.bool_]) -> Float64Array:
    """Move the points around the inner ones to within `_BORDER_M` of them."""
    padded, known = np.pad(rows, ((1, 1), (1, 1), (0, 0))), np.pad(inside, 1)
    total, count = np.zeros_like(rows), np.zeros(inside.shape)
    for i, j in product(range(3), range(3)):
        here = known[i : i + inside.shape[0], j : j + inside.shape[1]]
        total += here[..., None] * padded[i : i + inside.shape[0], j : j + inside.shape[1]]
        count += here
    is_moved = ~inside & (count > 0)
    inner = total[is_moved] / count[is_moved][:, None]
    away = rows[is_moved] - inner
    length = np.linalg.norm(away, axis=1, keepdims=True)
    moved = rows.copy()
    moved[is_moved] = inner + away * np.minimum(1.0, _BORDER_M / np.maximum(length, 1e-9))
    return moved


def _list_edges(
    plane: Float64Array, cells: NDArray[np.bool_]
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """List the sides between cells and others: starts, steps and outward normals (n, 2) of each."""
    starts, steps, outward = [], [], []
    padded = np.pad(cells, 1)
    middle = 0.25 * (plane[:-1, :-1] + plane[1:, :-1] + plane[:-1, 1:] + plane[1:, 1:])
    middles = np.pad(middle, ((1, 1), (1, 1), (0, 0)))
    for ends, first, second in (
        ((plane[:-1], plane[1:]), np.s_[1:-1, :-1], np.s_[1:-1, 1:]),
        ((plane[:, :-1], plane[:, 1:]), np.s_[:-1, 1:-1], np.s_[1:, 1:-1]),
    ):
        is_edge = padded[first] != padded[second]
        core = np.where(padded[first][..., None], middles[first], middles[second])[is_edge]
        a, b = (points[is_edge] for points in ends)
        across = (b - a)[:, ::-1] * (1.0, -1.0)
        across *= -np.sign(np.sum(across * (core - a), axis=1, keepdims=True))
        starts.append(a)
        steps.append(b - a)
        outward.append(across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9))
    return np.concatenate(starts), np.concatenate(steps), np.concatenate(outward)


def _build_fringe(
    plane: Float64Array,
    cells: NDArray[np.bool_],
    crop: Crop,
    plant: _Plant,
    site: Site,
    key: str,
) -> list[tuple[TriangleSurface, str]]:
    """Build the plants along the border of cells over points (n, m, 2)."""
    starts, steps, outward = _list_edges(plane, cells)
    middles = shapely.points(starts + steps / 2)
    away_m = shapely.distance(site.street_axes, middles)
    density = np.where(away_m < DENSE_FRINGE_M, plant.per_m, SPARSE_RATIO * plant.per_m)
    density[away_m > FRINGE_MAX_DISTANCE_M] = 0.0
    draw = create_generator("fringe", key)
    number = draw.poisson(density * np.linalg.norm(steps, axis=1))
    row = np.repeat(np.arange(len(number)), number)
    along, away = draw.uniform(size=(2, len(row), 1))
    # Thinner outwards, where single plants stand in the grass.
    feet = (
        starts[row]
        + along * steps[row]
        + np.where(draw.uniform(size=away.shape) < 0.6, 0.5 * away - 0.12, -0.7 * away)
        * outward[row]
    )
    feet = feet[site.is_free(feet, CROP_CLEARANCE_M - 0.1)]
    if not len(feet):
        return []
    return _build_plants(site.project_to_ground(feet), crop, plant, draw)


def _build_plants(
    feet: Float64Array, crop: Crop, plant: _Plant, draw: np.random.Generator
) -> list[tuple[TriangleSurface, str]]:
    """Build plants at points (n, 3) with their materials: a stem, its leaves and an ear each."""
    count = len(feet)
    height = crop.height_m * draw.uniform(0.78, 1.08, (count, 1))
    lean = np.concatenate([draw.normal(scale=0.06, size=(count, 2)), np.ones((count, 1))], axis=1)
    tips = feet + lean * height
    stems = [_build_blades(feet - xyz(z=0.03), tips, plant.stem_width, draw)]
    for number in range(plant.leaves if crop.has_ears else 0):
        at = (number + draw.uniform(0.3, 0.9, (count, 1))) / plant.leaves
        root = feet + 0.85 * at * (tips - feet)
        yaw = draw.uniform(0.0, 2.0 * np.pi, count)
        reach = np.column_stack([np.cos(yaw), np.sin(yaw), draw.uniform(0.1, 1.3, count)])
        leaf = plant.leaf_length * normalize(reach) * draw.uniform(0.6, 1.1, (count, 1))
        stems.append(_build_blades(root, root + leaf, plant.leaf_width, draw))
    parts = [(_join_blades(stems), crop.stalks)]
    if crop.has_ears:
        nod = draw.normal(scale=0.35, size=(count, 3)) + xyz(z=1.0)
        ear = plant.ear_length * normalize(nod) * draw.uniform(0.8, 1.2, (count, 1))
        parts.append(
            (_build_blades(tips - 0.3 * ear, tips + ear, plant.ear_width, draw), crop.ears)
        )
    return parts


def _build_ears(tops: Float64Array, plant: _Plant, crop: Crop, key: str) -> TriangleSurface:
    """Build the ears, or the tips, of plants about points (n, 3) of a sheet."""
    draw = create_generator("ears", key)
    foot = np.repeat(tops, EARS_PER_TOP, axis=0)
    foot += draw.uniform(-1, 1, foot.shape) * (0.5, 0.5, 0.0) * _ALONG_ROW_STEP_M
    # Out of the sheet, whose furrows are lower than its ridges.
    sunk = 0.15 * crop.height_m
    above = (1.0 - _TOP_RATIO) * crop.height_m * draw.uniform(0.1, 1.3, (len(foot), 1))
    lean = draw.normal(scale=0.12, size=(len(foot), 3)) * (1, 1, 0) + xyz(z=1.0)
    length = sunk + above
    width = min(plant.ear_width, 0.1 * crop.height_m)
    foot -= xyz(z=sunk)
    return _build_blades(foot, foot + lean * length, width, draw)


def _build_blades(
    roots: Float64Array, tips: Float64Array, width_m: float, draw: np.random.Generator
) -> TriangleSurface:
    """Build a triangle from each root (n, 3) to its tip, with normals near the vertical."""
    yaw = draw.uniform(0.0, 2.0 * np.pi, len(roots))
    side = 0.5 * width_m * np.column_stack([np.cos(yaw), np.sin(yaw), np.zeros(len(roots))])
    corners = np.stack([roots - side, roots + side, tips], axis=1).reshape(-1, 3)
    normals = normalize(xyz(z=1.0) + draw.normal(scale=0.4, size=roots.shape))
    triangles = np.arange(len(corners)).reshape(-1, 3)
    return TriangleSurface(corners, triangles, np.repeat(normals, 3, axis=0))


def _join_blades(parts: list[TriangleSurface]) -> TriangleSurface:
    """Join blades plant by plant, so thinning out is even."""
    corners, normals = (
        np.stack([values.reshape(-1, 3, 3) for values in group], axis=1).reshape(-1, 3)
        for group in (
            [part.vertices for part in parts],
            [part.normals for part in parts if part.normals is not None],
        )
    )
    return TriangleSurface(corners, np.arange(len(corners)).reshape(-1, 3), normals)
