"""Mesh primitives: boxes, tubes, ellipsoids and other closed surfaces, wound outward.

Vertices come ring by ring. `trimesh.creation` has most of these shapes, but in another order of
vertices, and every body and every house would change in each dataset written so far.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import TriangleSurface, normalize, orient_outward


def loft_rings(rings: ArrayLike) -> TriangleSurface:
    """Build a closed skin over cross-sections (k, n, 3) in one sense of rotation, ends capped.

    The quad between rings i and i + 1 and points j and j + 1 is triangles `2 (i n + j)` and
    `2 (i n + j) + 1`; the caps come last.
    """
    grid = np.asarray(rings, dtype=np.float64)
    count, points, _ = grid.shape
    first, second = grid[0].mean(axis=0), grid[-1].mean(axis=0)
    vertices = np.concatenate([grid.reshape(-1, 3), [first, second]])
    here = np.arange(points)
    after = np.roll(here, -1)
    row = points * np.arange(count - 1)[:, None]
    a, b, c, d = row + here, row + after, row + points + after, row + points + here
    quads = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    end = points * (count - 1)
    front = np.stack([after, here, np.full(points, count * points)], axis=-1)
    back = np.stack([end + here, end + after, np.full(points, count * points + 1)], axis=-1)
    return orient_outward(TriangleSurface(vertices, np.concatenate([quads, front, back])))


def box(low: ArrayLike, high: ArrayLike) -> TriangleSurface:
    """Build an upright box between two opposite corners (3,)."""
    (x0, y0, z0), (x1, y1, z1) = np.asarray(low, float), np.asarray(high, float)
    outline = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    return prism(outline, z0, z1)


def prism(outline: ArrayLike, bottom_m: float, top_m: float) -> TriangleSurface:
    """Build an upright prism over a star-shaped outline (n, 2)."""
    flat = np.asarray(outline, dtype=np.float64)
    rings = [np.column_stack([flat, np.full(len(flat), z)]) for z in (bottom_m, top_m)]
    return loft_rings(np.stack(rings))


def plate(corners: ArrayLike, thickness_m: float) -> TriangleSurface:
    """Build a flat plate; `corners` (n, 3) are its face, counter-clockwise from in front."""
    face = np.asarray(corners, dtype=np.float64)
    normal = normalize(np.cross(face[1] - face[0], face[2] - face[1]))
    return loft_rings(np.stack([face, face - thickness_m * normal]))


def rectangles(centres: ArrayLike, across: ArrayLike, upward: ArrayLike) -> TriangleSurface:
    """Build flat rectangles, visible from one side, with normals.

    `across` and `upward` (k, 3) lead from the centres (k, 3) to the right edge, as seen from in
    front, and to the upper edge.
    """
    middle = np.asarray(centres, dtype=np.float64)
    right = np.broadcast_to(np.asarray(across, dtype=np.float64), middle.shape)
    rise = np.broadcast_to(np.asarray(upward, dtype=np.float64), middle.shape)
    corners = [middle - right - rise, middle + right - rise]
    corners += [middle + right + rise, middle - right + rise]
    first = 4 * np.arange(len(middle))[:, None]
    triangles = (first[:, None] + np.array([(0, 1, 2), (0, 2, 3)])).reshape(-1, 3)
    normals = np.repeat(normalize(np.cross(right, rise)), 4, axis=0)
    return TriangleSurface(np.stack(corners, axis=1).reshape(-1, 3), triangles, normals)


def grid_sheet(points: Float64Array, cells: NDArray[np.bool_] | None = None) -> TriangleSurface:
    """Build a sheet over points (n, m, 3) in rows, seen from above; of some cells, or of all."""
    columns = points.shape[1]
    built = np.ones((len(points) - 1, columns - 1), dtype=bool) if cells is None else cells
    i, j = np.nonzero(built)
    a, b = i * columns + j, (i + 1) * columns + j
    quads = np.stack([a, b, b + 1, a, b + 1, a + 1], axis=-1).reshape(-1, 3)
    flat = points.reshape(-1, 3)
    corner = flat[quads[0]]
    up = np.cross(corner[1] - corner[0], corner[2] - corner[0])[2]
    return TriangleSurface(flat, quads if up > 0 else quads[:, ::-1])


def tube(
    points: ArrayLike, radii: ArrayLike, *, sides: int = 8, rounded: bool = False
) -> TriangleSurface:
    """Build a round tube along points (k, 3), with radii (k,) or one.

    Rounded ends are domes, which add a radius to the length.
    """
    axis = np.asarray(points, dtype=np.float64)
    radius = np.broadcast_to(np.asarray(radii, dtype=np.float64), (len(axis),))
    if rounded:
        axis, radius = _add_domes(axis, radius)
    along = normalize(axis[1:] - axis[:-1])
    along = normalize(np.concatenate([along[:1], along[:-1] + along[1:], along[-1:]]))
    # The axis least along the tube is across it everywhere.
    reference = np.eye(3)[np.argmin(np.abs(along).mean(axis=0))]
    across = normalize(np.cross(along, reference))
    upward = np.cross(along, across)
    angle = 2 * np.pi * np.arange(sides) / sides
    circle = np.cos(angle)[:, None] * across[:, None] + np.sin(angle)[:, None] * upward[:, None]
    return loft_rings(axis[:, None] + radius[:, None, None] * circle)


def _add_domes(axis: Float64Array, radius: Float64Array) -> tuple[Float64Array, Float64Array]:
    first, last = normalize(axis[0] - axis[1]), normalize(axis[-1] - axis[-2])
    extent, shrink = np.array([0.98, 0.75]), np.array([0.25, 0.7])
    head = axis[0] + first * (radius[0] * extent)[:, None]
    tail = axis[-1] + last * (radius[-1] * extent[::-1])[:, None]
    return (
        np.concatenate([head, axis, tail]),
        np.concatenate([radius[0] * shrink, radius, radius[-1] * shrink[::-1]]),
    )


def ellipsoid(
    centre: ArrayLike, radii: ArrayLike, *, sides: int = 10, bands: int = 6
) -> TriangleSurface:
    """Build an ellipsoid with its axes along x, y and z."""
    # The caps begin off the poles, where a ring would be a point.
    polar = np.linspace(0.08, np.pi - 0.08, bands + 1)
    angle = 2 * np.pi * np.arange(sides) / sides
    level, upright = np.sin(polar)[:, None], np.cos(polar)[:, None]
    upright = np.broadcast_to(upright, (bands + 1, sides))
    rings = np.stack([level * np.cos(angle), level * np.sin(angle), upright], axis=-1)
    scaled = rings * np.asarray(radii, dtype=np.float64)
    return loft_rings(np.asarray(centre, dtype=np.float64) + scaled)


def revolve_profile(profile: ArrayLike, centre: ArrayLike, *, sides: int = 16) -> TriangleSurface:
    """Revolve (radius, y) pairs (k, 2) about the y axis through `centre` (3,); ends are capped."""
    rings = _revolve(profile, sides)
    return loft_rings(np.asarray(centre, dtype=np.float64) + rings)


def revolve_closed_profile(
    profile: ArrayLike, centre: ArrayLike, *, sides: int = 16
) -> TriangleSurface:
    """Revolve a closed profile of (radius, y) pairs (k, 2) to a ring with a hole."""
    rings = _revolve(profile, sides).swapaxes(0, 1) + np.asarray(centre, dtype=np.float64)
    points = rings.shape[1]
    here, row = np.arange(points), points * np.arange(sides)[:, None]
    after, beyond = np.roll(here, -1), np.roll(row, -1, axis=0)
    a, b, c, d = row + here, row + after, beyond + after, beyond + here
    quads = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    return orient_outward(TriangleSurface(rings.reshape(-1, 3), quads))


def _revolve(profile: ArrayLike, sides: int) -> Float64Array:
    radius, y = np.asarray(profile, dtype=np.float64).T
    angle = 2 * np.pi * np.arange(sides) / sides
    level = np.broadcast_to(y[:, None], (len(y), sides))
    return np.stack([radius[:, None] * np.cos(angle), level, radius[:, None] * np.sin(angle)], -1)
