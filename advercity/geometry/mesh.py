"""Triangle surfaces, and the meshes of worlds and bodies.

A `TriangleSurface` is bare geometry in double precision; a `MeshPart` adds its material. A `Mesh`
joins all parts of one material, semantic class and wheel, since every mesh costs a draw call.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any

import mapbox_earcut
import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from advercity.geometry.arrays import Float64Array
from advercity.geometry.polyline import Points, polyline_stations
from advercity.semantics import Semantic

Size = tuple[float, float, float]
"""Length, width and height of a box, metres."""

GRID_M = 0.001
"""Areas are computed on this grid, which keeps overlays free of slivers and reproducible."""


@dataclass(frozen=True, order=True)
class Wheel:
    """A wheel that rolls on the ground, or several on a common axle that does not steer."""

    hub: tuple[float, float, float]
    """Centre in the body frame, metres; its height is the radius."""
    is_steered: bool = False

    @property
    def radius_m(self) -> float:
        """Height of the hub above the ground."""
        return self.hub[2]


class MeshLayer(IntEnum):
    """Part of a body: images may leave out the details of distant bodies."""

    SHAPE = 0
    DETAIL = 1
    """Small, or behind windows."""
    OCCUPANT = 2
    """A detail, absent from parked vehicles."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles of one material and one semantic class; equal to itself alone.

    Attributes:
        name: Unique within its world or body.
        vertices: (n, 3) float32, metres.
        triangles: (m, 3) int32 into `vertices`, counter-clockwise seen from outside.
        material: Key of `advercity.materials.MATERIALS`.
        semantic: Semantic class in labels.
        normals: (n, 3) float32 for smooth shading, or None for flat faces.
        weights: (n, bones) float32 skinning weights, rows sum to 1; None for rigid meshes.
        wheel: Its wheel, if it turns with one, or None.
        uv: (n, 2) float32 metres to the right and up on the images of its material, or None: images
            then lie over a static mesh along the world's axes. Panes have codes of `scene.rooms`.
        layer: Its part of a body.
        maps: Name of images of its own, in place of the material's; empty for none.
        writing: First and last vertex, the latter excluded, of every line of writing on it.
    """

    name: str
    vertices: NDArray[np.float32]
    triangles: NDArray[np.int32]
    material: str
    semantic: Semantic
    normals: NDArray[np.float32] | None = None
    weights: NDArray[np.float32] | None = None
    wheel: Wheel | None = None
    uv: NDArray[np.float32] | None = None
    layer: MeshLayer = MeshLayer.SHAPE
    maps: str = ""
    writing: tuple[tuple[int, int], ...] = ()


@dataclass(frozen=True, eq=False)
class TriangleSurface:
    """Triangles, counter-clockwise seen from outside.

    Attributes:
        vertices: (n, 3) metres.
        triangles: (m, 3) rows of `vertices`.
        normals: (n, 3) unit vectors once shaded, else None.
        uv: (n, 2) metres on the images of its material, or None.
        is_writing: Whether it is a line of writing on a wall.
    """

    vertices: Float64Array
    triangles: NDArray[np.int64]
    normals: Float64Array | None = None
    uv: Float64Array | None = None
    is_writing: bool = False

    def to_mesh(
        self, name: str, material: str, semantic: Semantic, wheel: Wheel | None = None
    ) -> Mesh:
        """Convert to a mesh in single precision, as renderers and ray casters take it."""
        return Mesh(
            name=name,
            vertices=self.vertices.astype(np.float32),
            triangles=self.triangles.astype(np.int32),
            material=material,
            semantic=semantic,
            normals=None if self.normals is None else self.normals.astype(np.float32),
            wheel=wheel,
            uv=None if self.uv is None else self.uv.astype(np.float32),
        )


@dataclass(frozen=True, eq=False)
class MeshPart:
    """A surface with its material, semantic class, wheel and images, as a `Mesh` has them."""

    surface: TriangleSurface
    material: str
    semantic: Semantic
    wheel: Wheel | None = None
    layer: MeshLayer = MeshLayer.SHAPE
    maps: str = ""


def build_ribbon(left: Points, right: Points) -> TriangleSurface:
    """Build the surface between two lines (n, 3), visible from where `left` is on the left.

    Images of its material run along it, their upper edge on the left.
    """
    count = len(left)
    along = polyline_stations((left + right) / 2)
    across = np.linalg.norm(left - right, axis=1)
    uv = np.column_stack([np.tile(along, 2), np.concatenate([across, np.zeros(count)])])
    near = np.arange(count - 1)
    first = np.stack([near, near + count, near + count + 1], axis=1)
    second = np.stack([near, near + count + 1, near + 1], axis=1)
    return TriangleSurface(np.vstack([left, right]), np.vstack([first, second]), uv=uv)


def triangulate_polygon(polygon: shapely.Polygon) -> tuple[Points, NDArray[np.int64]]:
    """Triangulate a polygon: corners (n, 2), holes included, and triangles (m, 3), all upward."""
    rings = [np.asarray(ring.coords)[:-1] for ring in (polygon.exterior, *polygon.interiors)]
    corners = np.concatenate(rings)
    ends = np.cumsum([len(ring) for ring in rings]).astype(np.uint32)
    triangles = mapbox_earcut.triangulate_float64(corners, ends).reshape(-1, 3).astype(np.int64)
    a, b, c = (corners[triangles[:, i]] for i in range(3))
    area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    # Earcut keeps the winding of the cut ring, which shapely does not fix.
    triangles[area < 0] = triangles[area < 0][:, ::-1]
    return corners, triangles[np.abs(area) > 1e-9]


def extract_polygons(shape: shapely.Geometry) -> list[shapely.Polygon]:
    """List the polygons in a geometry; points and lines, which overlays leave, are dropped."""
    parts = [shape] if isinstance(shape, shapely.Polygon) else getattr(shape, "geoms", [])
    return [part for part in parts if isinstance(part, shapely.Polygon) and not part.is_empty]


def build_grid_cells(
    bounds: tuple[float, float, float, float], size_m: float
) -> NDArray[np.object_]:
    """Build squares of `size_m` over a box (west, south, east, north)."""
    x, y = (np.arange(bounds[axis], bounds[axis + 2], size_m)[:, None] for axis in (0, 1))
    west, south = (grid.ravel() for grid in np.meshgrid(x, y))
    return shapely.box(west, south, west + size_m, south + size_m)


CREASE_RAD = np.radians(38.0)
"""Faces whose normals differ by less are shaded as one curved surface."""


def xyz(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Float64Array:
    """Build a point or an offset (3,)."""
    return np.array([x, y, z], dtype=np.float64)


def signed_volume(surface: TriangleSurface) -> float:
    """Compute the volume of a closed surface in cubic metres; negative if it is inside out."""
    a, b, c = (surface.vertices[surface.triangles[:, corner]] for corner in range(3))
    return float(np.sum(a * np.cross(b, c)) / 6)


def orient_outward(surface: TriangleSurface) -> TriangleSurface:
    """Turn the faces of a closed surface outward."""
    if signed_volume(surface) >= 0:
        return surface
    return TriangleSurface(surface.vertices, surface.triangles[:, ::-1], surface.normals)


def join_surfaces(surfaces: Iterable[TriangleSurface]) -> TriangleSurface:
    """Join surfaces, one at least; the result has normals, or coordinates, if all of them have."""
    parts = list(surfaces)
    offsets = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    normals = [part.normals for part in parts if part.normals is not None]
    uv = [part.uv for part in parts if part.uv is not None]
    return TriangleSurface(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.triangles + o for part, o in zip(parts, offsets, strict=True)]),
        np.concatenate(normals) if len(normals) == len(parts) else None,
        np.concatenate(uv) if len(uv) == len(parts) else None,
    )


def merge_surfaces(
    surfaces: Mapping[str, Sequence[TriangleSurface]], kinds: Mapping[str, tuple[str, Semantic]]
) -> list[Mesh]:
    """Build a mesh of each name with surfaces; `kinds` are its material and class."""
    return [
        join_surfaces(found).to_mesh(name, *kinds[name])
        for name, found in surfaces.items()
        if found
    ]


def move_surface(
    surface: TriangleSurface, offset: ArrayLike, *, yaw: float = 0.0
) -> TriangleSurface:
    """Turn a surface about the z axis by `yaw` radians, then shift it by `offset` (3,)."""
    return repeat_surface(surface, np.atleast_2d(offset), yaw=np.array([yaw]))


def repeat_surface(
    surface: TriangleSurface, offsets: ArrayLike, *, yaw: ArrayLike = 0.0, scale: ArrayLike = 1.0
) -> TriangleSurface:
    """Copy a surface, each copy scaled, turned about z by `yaw` radians and shifted.

    Offsets are (k, 3) metres. Angles are (k,), scales (k, 3) along the surface's own axes, or one
    for all copies.
    """
    shift = np.asarray(offsets, dtype=np.float64)
    count = len(shift)
    factors = np.broadcast_to(np.asarray(scale, dtype=np.float64), (count, 3))
    turn = np.broadcast_to(np.asarray(yaw, dtype=np.float64), (count,))
    vertices = _rotate_about_z(surface.vertices * factors[:, None], turn) + shift[:, None]
    normals = None
    if surface.normals is not None:
        # Normals scale with the inverse transpose.
        turned = _rotate_about_z(surface.normals / factors[:, None], turn)
        normals = normalize(turned).reshape(-1, 3)
    step = len(surface.vertices) * np.arange(count)
    triangles = surface.triangles + step[:, None, None]
    uv = None if surface.uv is None else np.tile(surface.uv, (count, 1))
    return TriangleSurface(
        vertices.reshape(-1, 3),
        triangles.reshape(-1, 3),
        normals,
        uv,
        is_writing=surface.is_writing,
    )


def _rotate_about_z(points: Float64Array, yaw: Float64Array) -> Float64Array:
    cosine, sine = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
    x, y, z = np.moveaxis(points, -1, 0)
    return np.stack([x * cosine - y * sine, x * sine + y * cosine, z], axis=-1)


def mirror_surface(surface: TriangleSurface) -> TriangleSurface:
    """Mirror a surface across y = 0, faces still outward."""
    return TriangleSurface(surface.vertices * (1, -1, 1), surface.triangles[:, ::-1])


def add_mirror_image(surface: TriangleSurface) -> TriangleSurface:
    """Join a surface with its mirror image across y = 0."""
    return join_surfaces([surface, mirror_surface(surface)])


def keep_triangles(surface: TriangleSurface, mask: NDArray[np.bool_]) -> TriangleSurface:
    """Keep the triangles of a surface where `mask` (m,) holds, without normals."""
    return TriangleSurface(surface.vertices, surface.triangles[mask])


def shade_smooth(surface: TriangleSurface) -> TriangleSurface:
    """Add normals to a surface: smooth across shallow edges, split along creases.

    Triangles without area are dropped.
    """
    # Vertices equal to 10 µm are one, in however many parts of the surface.
    _, shared = number_rows(np.round(surface.vertices, 5))
    corner = shared[surface.triangles]
    edges = surface.vertices[surface.triangles]
    area = np.cross(edges[:, 1] - edges[:, 0], edges[:, 2] - edges[:, 0])
    # Caps of lofts over pointed rings have triangles without area, whose normals are undefined.
    solid = np.linalg.norm(area, axis=1) > 1e-10
    solid &= (corner != np.roll(corner, 1, axis=1)).all(axis=1)
    corner, area, kept = corner[solid], area[solid], surface.triangles[solid]
    normals = _crease_normals(corner, area)
    # A point is one vertex for all its corners whose normals and coordinates agree to 1e-4.
    uv = None if surface.uv is None else surface.uv[kept.reshape(-1)]
    steps = [np.round(normals * 1e4), *([] if uv is None else [np.round(uv * 1e4)])]
    keys = np.column_stack([corner.reshape(-1), *steps]).astype(np.int64)
    first, index = number_rows(keys)
    return TriangleSurface(
        surface.vertices[kept.reshape(-1)[first]],
        index.reshape(-1, 3),
        normals[first],
        None if uv is None else uv[first],
    )


def number_rows(rows: NDArray[Any]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Number the different rows of (n, k), sorted; several times as quick as `np.unique`.

    Returns:
        Where each is first (m,), and the number of each row (n,).
    """
    order = np.lexsort(rows.T[::-1])
    ordered = rows[order]
    begins = np.ones(len(rows), dtype=bool)
    begins[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    numbers = np.empty(len(rows), dtype=np.intp)
    numbers[order] = np.cumsum(begins) - 1
    return order[begins], numbers


def _crease_normals(corner: NDArray[np.int64], area: Float64Array) -> Float64Array:
    """Average normals (3 m, 3) of triangle corners over the faces that meet there smoothly.

    `corner` (m, 3) numbers the point at each corner; `area` (m, 3) are normals as long as twice the
    face's area: large faces count more.
    """
    point = corner.reshape(-1)
    face = np.repeat(np.arange(len(corner)), 3)
    order = np.argsort(point, kind="stable")
    size = np.bincount(point)
    start = np.cumsum(size) - size
    # All pairs (left, right) of corners at one point, without a loop over points.
    left = np.repeat(np.arange(len(point)), size[point])
    rank = np.arange(len(left)) - np.repeat(np.cumsum(size[point]) - size[point], size[point])
    right = order[start[point[left]] + rank]
    unit = normalize(area)
    smooth = np.sum(unit[face[left]] * unit[face[right]], axis=1) > np.cos(CREASE_RAD)
    left, right = left[smooth], right[smooth]
    total = [np.bincount(left, area[face[right], axis], len(point)) for axis in range(3)]
    return normalize(np.stack(total, axis=-1))


def normalize(vectors: ArrayLike) -> Float64Array:
    """Scale vectors (..., 3) to length 1."""
    directions = np.asarray(vectors, dtype=np.float64)
    return directions / np.linalg.norm(directions, axis=-1, keepdims=True)


def build_meshes(pieces: Sequence[MeshPart], prefix: str = "") -> list[Mesh]:
    """Build a mesh per material, semantic class and wheel, named after them, in stable order."""
    wheels = sorted({piece.wheel for piece in pieces if piece.wheel is not None})
    groups: dict[tuple[MeshLayer, int, str, Semantic, str], list[TriangleSurface]] = {}
    for piece in pieces:
        surface = (
            piece.surface if piece.surface.normals is not None else shade_smooth(piece.surface)
        )
        number = 0 if piece.wheel is None else 1 + wheels.index(piece.wheel)
        key = piece.layer, number, piece.material, piece.semantic, piece.maps
        groups.setdefault(key, []).append(surface)
    return [
        replace(
            join_surfaces(surfaces).to_mesh(
                f"{prefix}{semantic.name.lower()}_{material}"
                + f"_wheel_{number}" * (number > 0)
                + f"_{layer.name.lower()}" * (layer > 0)
                + "_with_image" * bool(maps),
                material,
                semantic,
                wheels[number - 1] if number else None,
            ),
            layer=layer,
            maps=maps,
            writing=_find_writing(surfaces),
        )
        for (layer, number, material, semantic, maps), surfaces in sorted(groups.items())
    ]


def _find_writing(surfaces: Sequence[TriangleSurface]) -> tuple[tuple[int, int], ...]:
    """Find the vertices of lines of writing among joined surfaces."""
    ends = np.cumsum([len(surface.vertices) for surface in surfaces]).tolist()
    return tuple(
        (end - len(surface.vertices), end)
        for surface, end in zip(surfaces, ends, strict=True)
        if surface.is_writing
    )
