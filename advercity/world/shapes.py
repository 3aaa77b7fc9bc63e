"""Mesh primitives: closed surfaces wound outward, and how they become meshes.

A `Surface` is bare geometry; a `Piece` also says what it is made of. `meshes` joins all pieces of
one material, semantic class and wheel, since every mesh costs a draw call.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from advercity.semantics import Semantic
from advercity.world.scene import Mesh, Wheel

Floats = NDArray[np.float64]

CREASE_RAD = np.radians(38.0)
"""Faces that meet at less than this are shaded as one curved surface."""


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles, counter-clockwise seen from outside.

    Attributes:
        vertices: (n, 3) metres.
        triangles: (m, 3) into `vertices`.
        normals: (n, 3) unit vectors once shaded, else None.
    """

    vertices: Floats
    triangles: NDArray[np.int64]
    normals: Floats | None = None


@dataclass(frozen=True, eq=False)
class Piece:
    """A surface and what it is."""

    surface: Surface
    material: str
    semantic: Semantic
    wheel: Wheel | None = None


def xyz(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Floats:
    """A point or an offset (3,)."""
    return np.array([x, y, z], dtype=np.float64)


def signed_volume(surface: Surface) -> float:
    """Volume in cubic metres enclosed by a closed surface; negative if it is inside out."""
    a, b, c = (surface.vertices[surface.triangles[:, corner]] for corner in range(3))
    return float(np.sum(a * np.cross(b, c)) / 6)


def outward(surface: Surface) -> Surface:
    """A closed surface, turned so that its faces look outward."""
    if signed_volume(surface) >= 0:
        return surface
    return Surface(surface.vertices, surface.triangles[:, ::-1], surface.normals)


def joined(surfaces: Iterable[Surface]) -> Surface:
    """One surface of several; shaded if all of them are."""
    parts = list(surfaces)
    offsets = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    normals = [part.normals for part in parts if part.normals is not None]
    return Surface(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.triangles + o for part, o in zip(parts, offsets, strict=True)]),
        np.concatenate(normals) if len(normals) == len(parts) else None,
    )


def moved(surface: Surface, offset: ArrayLike, *, yaw: float = 0.0) -> Surface:
    """A surface turned about the z axis by `yaw` radians, then shifted by `offset` (3,)."""
    return repeated(surface, np.atleast_2d(offset), yaw=np.array([yaw]))


def repeated(
    surface: Surface,
    offsets: ArrayLike,
    *,
    yaw: ArrayLike = 0.0,
    scale: ArrayLike = 1.0,
) -> Surface:
    """Copies of a surface, each scaled, turned about z and shifted.

    Args:
        surface: What to copy.
        offsets: (k, 3) metres.
        yaw: (k,) radians, or one for all.
        scale: (k, 3) factors along x, y, z of the surface's own axes, or broadcastable to it.
    """
    shift = np.asarray(offsets, dtype=np.float64)
    count = len(shift)
    factors = np.broadcast_to(np.asarray(scale, dtype=np.float64), (count, 3))
    turn = np.broadcast_to(np.asarray(yaw, dtype=np.float64), (count,))
    vertices = _turned(surface.vertices * factors[:, None], turn) + shift[:, None]
    normals = None
    if surface.normals is not None:
        normals = _unit(_turned(surface.normals / factors[:, None], turn)).reshape(-1, 3)
    step = len(surface.vertices) * np.arange(count)
    triangles = surface.triangles + step[:, None, None]
    return Surface(vertices.reshape(-1, 3), triangles.reshape(-1, 3), normals)


def _turned(points: Floats, yaw: Floats) -> Floats:
    cosine, sine = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
    x, y, z = np.moveaxis(points, -1, 0)
    return np.stack([x * cosine - y * sine, x * sine + y * cosine, z], axis=-1)


def mirrored(surface: Surface) -> Surface:
    """The other side: y becomes -y."""
    return Surface(surface.vertices * (1, -1, 1), surface.triangles[:, ::-1])


def both_sides(surface: Surface) -> Surface:
    """A surface and its mirror image across y = 0."""
    return joined([surface, mirrored(surface)])


def split(surface: Surface, mask: NDArray[np.bool_]) -> tuple[Surface, Surface]:
    """The triangles where `mask` (m,) holds, and the rest."""
    return (
        Surface(surface.vertices, surface.triangles[mask]),
        Surface(surface.vertices, surface.triangles[~mask]),
    )


def loft(rings: ArrayLike) -> Surface:
    """A closed skin over cross-sections, with both ends capped.

    The triangles of the quad between rings i and i + 1 and points j and j + 1 stand at
    `2 (i n + j)` and the one after; the caps come last.

    Args:
        rings: (k, n, 3) cross-sections of n points each, all in the same sense.
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
    return outward(Surface(vertices, np.concatenate([quads, front, back])))


def box(low: ArrayLike, high: ArrayLike) -> Surface:
    """An upright box between two opposite corners (3,)."""
    (x0, y0, z0), (x1, y1, z1) = np.asarray(low, float), np.asarray(high, float)
    outline = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    return prism(outline, z0, z1)


def prism(outline: ArrayLike, bottom_m: float, top_m: float) -> Surface:
    """An upright prism over a star-shaped outline (n, 2)."""
    flat = np.asarray(outline, dtype=np.float64)
    rings = [np.column_stack([flat, np.full(len(flat), z)]) for z in (bottom_m, top_m)]
    return loft(np.stack(rings))


def plate(corners: ArrayLike, thickness_m: float) -> Surface:
    """A flat plate; `corners` (n, 3) is its face, counter-clockwise seen from in front."""
    face = np.asarray(corners, dtype=np.float64)
    normal = _unit(np.cross(face[1] - face[0], face[2] - face[1]))
    return loft(np.stack([face, face - thickness_m * normal]))


def panels(centres: ArrayLike, across: ArrayLike, upward: ArrayLike) -> Surface:
    """Flat rectangles seen from one side, shaded.

    Args:
        centres: (k, 3) middles.
        across: (k, 3) from the middle to the right edge, as seen from in front.
        upward: (k, 3) from the middle to the upper edge.
    """
    middle = np.asarray(centres, dtype=np.float64)
    right = np.broadcast_to(np.asarray(across, dtype=np.float64), middle.shape)
    rise = np.broadcast_to(np.asarray(upward, dtype=np.float64), middle.shape)
    corners = [middle - right - rise, middle + right - rise]
    corners += [middle + right + rise, middle - right + rise]
    first = 4 * np.arange(len(middle))[:, None]
    triangles = (first[:, None] + np.array([(0, 1, 2), (0, 2, 3)])).reshape(-1, 3)
    normals = np.repeat(_unit(np.cross(right, rise)), 4, axis=0)
    return Surface(np.stack(corners, axis=1).reshape(-1, 3), triangles, normals)


def grid(points: Floats, cells: NDArray[np.bool_] | None = None) -> Surface:
    """A sheet over points (n, m, 3) in rows, seen from above.

    Args:
        points: Corners of its cells.
        cells: (n - 1, m - 1) which of them there are; all of them without it.
    """
    columns = points.shape[1]
    there = np.ones((len(points) - 1, columns - 1), dtype=bool) if cells is None else cells
    i, j = np.nonzero(there)
    a, b = i * columns + j, (i + 1) * columns + j
    quads = np.stack([a, b, b + 1, a, b + 1, a + 1], axis=-1).reshape(-1, 3)
    flat = points.reshape(-1, 3)
    corner = flat[quads[0]]
    up = np.cross(corner[1] - corner[0], corner[2] - corner[0])[2]
    return Surface(flat, quads if up > 0 else quads[:, ::-1])


def tube(points: ArrayLike, radii: ArrayLike, *, sides: int = 8, rounded: bool = False) -> Surface:
    """A round tube along points.

    Args:
        points: (k, 3) its axis.
        radii: (k,) or one for all, metres.
        sides: Number of sides.
        rounded: Whether the ends are domes that reach a radius further, or flat.
    """
    axis = np.asarray(points, dtype=np.float64)
    radius = np.broadcast_to(np.asarray(radii, dtype=np.float64), (len(axis),))
    if rounded:
        axis, radius = _domed(axis, radius)
    along = _unit(axis[1:] - axis[:-1])
    along = _unit(np.concatenate([along[:1], along[:-1] + along[1:], along[-1:]]))
    reference = np.eye(3)[np.argmin(np.abs(along).mean(axis=0))]
    across = _unit(np.cross(along, reference))
    upward = np.cross(along, across)
    angle = 2 * np.pi * np.arange(sides) / sides
    circle = np.cos(angle)[:, None] * across[:, None] + np.sin(angle)[:, None] * upward[:, None]
    return loft(axis[:, None] + radius[:, None, None] * circle)


def _domed(axis: Floats, radius: Floats) -> tuple[Floats, Floats]:
    first, last = _unit(axis[0] - axis[1]), _unit(axis[-1] - axis[-2])
    reach, shrink = np.array([0.98, 0.75]), np.array([0.25, 0.7])
    head = axis[0] + first * (radius[0] * reach)[:, None]
    tail = axis[-1] + last * (radius[-1] * reach[::-1])[:, None]
    return (
        np.concatenate([head, axis, tail]),
        np.concatenate([radius[0] * shrink, radius, radius[-1] * shrink[::-1]]),
    )


def ellipsoid(centre: ArrayLike, radii: ArrayLike, *, sides: int = 10, bands: int = 6) -> Surface:
    """An ellipsoid with its axes along x, y and z."""
    polar = np.linspace(0.08, np.pi - 0.08, bands + 1)
    angle = 2 * np.pi * np.arange(sides) / sides
    rings = np.stack(
        [
            np.sin(polar)[:, None] * np.cos(angle),
            np.sin(polar)[:, None] * np.sin(angle),
            np.broadcast_to(np.cos(polar)[:, None], (bands + 1, sides)),
        ],
        axis=-1,
    )
    return loft(np.asarray(centre, dtype=np.float64) + rings * np.asarray(radii, dtype=np.float64))


def turned_about_y(profile: ArrayLike, centre: ArrayLike, *, sides: int = 16) -> Surface:
    """A profile of (radius, y) pairs (k, 2) revolved about the y axis through `centre`, capped."""
    rings = _revolved(profile, sides)
    return loft(np.asarray(centre, dtype=np.float64) + rings)


def hoop(profile: ArrayLike, centre: ArrayLike, *, sides: int = 16) -> Surface:
    """A closed profile (k, 2), as of `turned_about_y`, revolved to a ring with a hole."""
    rings = _revolved(profile, sides).swapaxes(0, 1) + np.asarray(centre, dtype=np.float64)
    points = rings.shape[1]
    here, row = np.arange(points), points * np.arange(sides)[:, None]
    after, beyond = np.roll(here, -1), np.roll(row, -1, axis=0)
    a, b, c, d = row + here, row + after, beyond + after, beyond + here
    quads = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    return outward(Surface(rings.reshape(-1, 3), quads))


def _revolved(profile: ArrayLike, sides: int) -> Floats:
    radius, y = np.asarray(profile, dtype=np.float64).T
    angle = 2 * np.pi * np.arange(sides) / sides
    return np.stack(
        [
            radius[:, None] * np.cos(angle),
            np.broadcast_to(y[:, None], (len(y), sides)),
            radius[:, None] * np.sin(angle),
        ],
        axis=-1,
    )


def shaded(surface: Surface) -> Surface:
    """The surface with normals: smooth across shallow edges, split along creases."""
    _, shared = np.unique(np.round(surface.vertices, 5), axis=0, return_inverse=True)
    corner = shared.reshape(-1)[surface.triangles]
    edges = surface.vertices[surface.triangles]
    area = np.cross(edges[:, 1] - edges[:, 0], edges[:, 2] - edges[:, 0])
    solid = np.linalg.norm(area, axis=1) > 1e-10
    solid &= (corner != np.roll(corner, 1, axis=1)).all(axis=1)
    corner, area, kept = corner[solid], area[solid], surface.triangles[solid]
    normals = _crease_normals(corner, area)
    keys = np.column_stack([corner.reshape(-1), np.round(normals * 1e4)]).astype(np.int64)
    _, first, index = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    return Surface(surface.vertices[kept.reshape(-1)[first]], index.reshape(-1, 3), normals[first])


def _crease_normals(corner: NDArray[np.int64], area: Floats) -> Floats:
    """Normals (3 m, 3) of triangle corners, averaged over the faces that meet there smoothly."""
    point = corner.reshape(-1)
    face = np.repeat(np.arange(len(corner)), 3)
    order = np.argsort(point, kind="stable")
    size = np.bincount(point)
    start = np.cumsum(size) - size
    left = np.repeat(np.arange(len(point)), size[point])
    rank = np.arange(len(left)) - np.repeat(np.cumsum(size[point]) - size[point], size[point])
    right = order[start[point[left]] + rank]
    unit = _unit(area)
    smooth = np.sum(unit[face[left]] * unit[face[right]], axis=1) > np.cos(CREASE_RAD)
    left, right = left[smooth], right[smooth]
    total = [np.bincount(left, area[face[right], axis], len(point)) for axis in range(3)]
    return _unit(np.stack(total, axis=-1))


def _unit(vectors: ArrayLike) -> Floats:
    directions = np.asarray(vectors, dtype=np.float64)
    return directions / np.linalg.norm(directions, axis=-1, keepdims=True)


def meshes(pieces: Sequence[Piece], prefix: str = "") -> list[Mesh]:
    """One mesh per material, semantic class and wheel, named after them, in a stable order."""
    wheels = sorted({piece.wheel for piece in pieces if piece.wheel is not None})
    groups: dict[tuple[int, str, Semantic], list[Surface]] = {}
    for piece in pieces:
        surface = piece.surface if piece.surface.normals is not None else shaded(piece.surface)
        number = 0 if piece.wheel is None else 1 + wheels.index(piece.wheel)
        groups.setdefault((number, piece.material, piece.semantic), []).append(surface)
    return [
        Mesh(
            name=f"{prefix}{semantic.name.lower()}_{material}" + f"_wheel_{number}" * (number > 0),
            vertices=(surface := joined(parts)).vertices.astype(np.float32),
            triangles=surface.triangles.astype(np.int32),
            material=material,
            semantic=semantic,
            normals=None if surface.normals is None else surface.normals.astype(np.float32),
            wheel=wheels[number - 1] if number else None,
        )
        for (number, material, semantic), parts in sorted(groups.items())
    ]
