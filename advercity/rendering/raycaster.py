"""Ray casting by Embree against the static world and the bodies moving in it.

The static world is one mesh, every rigid body another, built at first use. Meshes of people move
from pose to pose, and are freed when out of use. A frame is a scene of instances, which are
in motion if rays are cast between two frames. So little is built from frame to frame.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from itertools import chain
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from advercity.assets.body_pose import BodyShape, compute_body_pose
from advercity.frames import Frame
from advercity.geometry import poses
from advercity.geometry.arrays import FloatArray, IndexArray
from advercity.geometry.mesh import Mesh
from advercity.geometry.poses import Matrix
from advercity.materials import ACTOR_PAINT, MATERIALS
from advercity.rendering.cover import Cover
from advercity.rendering.embree import EmbreeMesh, EmbreeScene
from advercity.rendering.reflectors import find_reflector_boxes
from advercity.world import World

MATERIAL_NAMES = tuple(MATERIALS)
"""Name of a material by its index in `RayHits.material`."""
MATERIAL_INDEX = {name: index for index, name in enumerate(MATERIAL_NAMES)}
"""Index of a material in `MATERIAL_NAMES`."""
_ACTOR_PAINT = -1
_Value = TypeVar("_Value", bound="np.floating[Any]")


@dataclass(frozen=True, eq=False)
class RayHits:
    """First surfaces hit by n rays; a miss has range inf and zeros elsewhere.

    Attributes:
        range_m: (n,) float32 along the ray.
        normal: (n, 3) float32 geometric normal, unit, world frame, towards the ray's origin.
        cosine: (n,) float32 of the angle of incidence.
        material: (n,) int16 into `MATERIAL_NAMES`.
        semantic: (n,) uint8 of `Semantic`.
        instance: (n,) int32 id of the actor; 0 for everything static.
        is_covered: (n,) whether precipitation is kept off; None in a world without cover.
    """

    range_m: FloatArray
    normal: FloatArray
    cosine: FloatArray
    material: NDArray[np.int16]
    semantic: NDArray[np.uint8]
    instance: NDArray[np.int32]
    is_covered: NDArray[np.bool_] | None = None

    def select(self, rows: IndexArray) -> "RayHits":
        """Select hits by row numbers."""
        columns: list[Any] = [getattr(self, item.name) for item in fields(self)]
        selected: list[Any] = [None if column is None else column[rows] for column in columns]
        return RayHits(*selected)

    def keep_exposed(self, values: NDArray[_Value]) -> NDArray[_Value]:
        """Return values (n,) of precipitation on the surfaces, which are 0 under cover."""
        if self.is_covered is None:
            return values
        return np.where(self.is_covered, values.dtype.type(0), values)


@dataclass(frozen=True, eq=False)
class Rays:
    """n rays of the world.

    Attributes:
        origins: (n, 3) float32, metres.
        directions: (n, 3) float32, unit vectors.
        time_fraction: (n,) float32 time of each ray, from 0 at the previous frame to 1 at the
            current one; None for 1.
        rings: Number of rings. Successive rays belong to them in turn; successive rays of a ring
            have similar directions, which makes fast packets.
    """

    origins: FloatArray
    directions: FloatArray
    time_fraction: FloatArray | None = None
    rings: int = 1

    def __len__(self) -> int:
        return len(self.directions)

    def select(self, where: IndexArray) -> "Rays":
        """Select rays by row numbers, which then belong to no rings."""
        # Not `take`, which would copy a broadcast origin.
        return Rays(
            self.origins[where],
            self.directions[where],
            None if self.time_fraction is None else self.time_fraction[where],
        )


class Raycaster:
    """Casts rays into a world whose actors are placed frame by frame.

    Attributes:
        cover: Surfaces keeping precipitation off parts of the world; None without any.
        reflector_boxes: (n, 2, 3) lowest and highest corners of boxes around static thin things.
    """

    def __init__(self, world: World) -> None:
        self._bodies = world.bodies
        self.cover = Cover.from_meshes(world.static)
        self.reflector_boxes = find_reflector_boxes(world.static)
        self._triangles = _TriangleTable()
        self._world = self._register_meshes(world.static, is_shared=True)
        self._rigid: dict[BodyShape, _RegisteredMesh] = {}
        self._posed: dict[BodyShape, _RegisteredMesh] = {}
        self._frames: tuple[Frame | None, Frame | None] = (None, None)
        self._placed = self._build_placement(Frame(0, 0.0, (), {}), None)

    def place(
        self,
        frame: Frame,
        hide: frozenset[int] = frozenset(),
        *,
        previous_frame: Frame | None = None,
    ) -> None:
        """Place every actor as in `frame`; rays pass through actors in `hide`.

        With `previous_frame`, rays may be cast at any time between the two; actors missing in
        it do not move. Placing the same frames again costs next to nothing.
        """
        if self._frames[0] is not frame or self._frames[1] is not previous_frame:
            self._placed = self._build_placement(frame, previous_frame)
            self._frames = (frame, previous_frame)
        hidden = np.isin(self._placed.instance[:-1], list(hide))
        self._placed.scene.hide(np.flatnonzero(hidden).tolist())

    def cast(self, rays: Rays, max_range_m: float) -> RayHits:
        """Find the nearest hit of every ray within `max_range_m`."""
        placed, table = self._placed, self._triangles
        found = placed.scene.cast(
            rays.origins,
            rays.directions,
            max_range_m,
            time_fraction=rays.time_fraction,
            rings=rays.rings,
        )
        # A miss has -1 for instance and triangle, which wraps to the last row of each table.
        triangle = placed.first_triangle.take(found.instance, mode="wrap") + found.triangle
        found.range_m[triangle < 0] = np.inf
        normal = _normalise(found.normal.T)
        material = table.material.take(triangle, mode="wrap")
        # Instance 0 is the static world, whose normals are in the world frame already.
        moving = np.flatnonzero(found.instance > 0)
        mover = found.instance.take(moving)
        fraction = None if rays.time_fraction is None else rays.time_fraction.take(moving)
        normal[:, moving] = placed.rotate_normals(normal[:, moving], mover, fraction)
        painted = np.flatnonzero(material == _ACTOR_PAINT)
        material[painted] = placed.paint.take(found.instance.take(painted))
        along = _dot(normal, rays.directions.T)
        normal *= -np.sign(along)
        return RayHits(
            range_m=found.range_m,
            normal=normal.T,
            cosine=np.abs(along),
            material=material,
            semantic=table.semantic.take(triangle, mode="wrap"),
            instance=placed.instance.take(found.instance, mode="wrap"),
            is_covered=self._find_covered(rays, found.range_m),
        )

    def _find_covered(self, rays: Rays, range_m: FloatArray) -> NDArray[np.bool_] | None:
        """Find which hits of rays are under cover."""
        if self.cover is None:
            return None
        reach_m = np.where(np.isfinite(range_m), range_m, np.float32(0.0))
        covered = self.cover.find_covered(rays.origins + reach_m[:, None] * rays.directions)
        return covered & np.isfinite(range_m)

    def _build_placement(self, frame: Frame, previous_frame: Frame | None) -> "_PlacedFrame":
        states = frame.states
        bodies = [compute_body_pose(state, self._bodies) for state in states]
        shapes = [body.shape for body in bodies]
        self._pose_people({shape: None for shape in shapes if shape.pose_index is not None})
        meshes = [self._world, *map(self._get_shape_mesh, shapes)]
        body_from_mesh = np.array([np.eye(4), *(body.body_from_mesh for body in bodies)])
        current = [np.eye(4), *(state.world_from_body for state in states)] @ body_from_mesh
        previous = None
        if previous_frame is not None:
            by_id = {state.actor.id: state for state in previous_frame.states}
            earlier = [by_id.get(state.actor.id, state).world_from_body for state in states]
            previous = [np.eye(4), *earlier] @ body_from_mesh
        paints = [_find_material_index(state.actor.paint) for state in states]
        return _PlacedFrame(
            scene=EmbreeScene([item.mesh for item in meshes], current, previous),
            current=current,
            previous=previous,
            first_triangle=np.array([*(item.first_triangle for item in meshes), 0], np.int32),
            instance=np.array([0, *(state.actor.id for state in states), 0], np.int32),
            paint=np.array([0, *paints], np.int16),
        )

    def _get_shape_mesh(self, shape: BodyShape) -> "_RegisteredMesh":
        if shape.pose_index is not None:
            return self._posed[shape]
        if shape not in self._rigid:
            self._rigid[shape] = self._register_meshes(shape.build_meshes(self._bodies))
        return self._rigid[shape]

    def _pose_people(self, wanted: Mapping[BodyShape, None]) -> None:
        """Keep one mesh for each pose in a frame, in their order, and for no others.

        People have more poses than fit in memory, and most are in another in each frame: meshes
        move to the next pose of the same person, and meshes of absent people are freed.
        """
        before, self._posed = self._posed, {}
        spare: defaultdict[BodyShape, list[_RegisteredMesh]] = defaultdict(list)
        for shape, registered in before.items():
            if shape in wanted:
                self._posed[shape] = registered
            else:
                spare[shape.to_rest()].append(registered)
        for shape in wanted:
            if shape not in self._posed:
                rest = shape.to_rest()
                registered = spare[rest].pop() if spare[rest] else self._register_posed(rest)
                registered.mesh.move_vertices(shape.compute_vertices(self._bodies))
                self._posed[shape] = registered
        for registered in chain.from_iterable(spare.values()):
            self._triangles.remove(registered.first_triangle, registered.num_triangles)

    def _register_posed(self, rest: BodyShape) -> "_RegisteredMesh":
        return self._register_meshes(rest.build_meshes(self._bodies), is_posed=True)

    def _register_meshes(
        self, meshes: Sequence[Mesh], *, is_posed: bool = False, is_shared: bool = False
    ) -> "_RegisteredMesh":
        num_triangles = sum(len(mesh.triangles) for mesh in meshes)
        mesh = EmbreeMesh(meshes, is_posed=is_posed, is_shared=is_shared)
        return _RegisteredMesh(mesh, self._triangles.add(meshes), num_triangles)


@dataclass(frozen=True, eq=False)
class _RegisteredMesh:
    """A mesh in Embree, and the rows of its triangles in the triangle table."""

    mesh: EmbreeMesh
    first_triangle: int
    num_triangles: int


@dataclass(frozen=True, eq=False)
class _PlacedFrame:
    """The static world, which is instance 0, and k - 1 actors.

    Attributes:
        scene: Embree's scene of all.
        current: (k, 4, 4) `world_from_mesh`.
        previous: (k, 4, 4) at the previous frame; None if all rays are cast at the current one.
        first_triangle: (k + 1,) int32 row of each instance's first triangle; 0 for a miss.
        instance: (k + 1,) int32 ids of the actors, 0 for the world and for a miss.
        paint: (k,) int16 material of surfaces in the actor's paint.
    """

    scene: EmbreeScene
    current: Matrix
    previous: Matrix | None
    first_triangle: NDArray[np.int32]
    instance: NDArray[np.int32]
    paint: NDArray[np.int16]

    def rotate_normals(
        self, vectors: FloatArray, mover: NDArray[np.int32], time_fraction: FloatArray | None
    ) -> FloatArray:
        """Rotate vectors (3, n) from the meshes of movers (n,) to the world, at times (n,)."""
        if self.previous is None or time_fraction is None:
            rotations = self.current[:, :3, :3].astype(np.float32).transpose(1, 2, 0)
            rows = (np.ascontiguousarray(row).take(mover, axis=1) for row in rotations)
            return np.array([_dot(row, vectors) for row in rows])
        rotated = np.empty_like(vectors)
        for row in np.unique(mover).tolist():
            rays = np.flatnonzero(mover == row)
            first, second = self.previous[row], self.current[row]
            path = poses.interpolate_poses(first, second, time_fraction[rays])
            rotated[:, rays] = np.einsum("nij,jn->in", path[:, :3, :3], vectors[:, rays])
        return rotated


class _TriangleTable:
    """Material and semantic class of all triangles; the last row of each is for misses.

    Arrays have spare rows, because shapes are registered while frames are cast. Rows of removed
    triangles are used for the next of the same number: another pose of the same body.
    """

    def __init__(self) -> None:
        self._count = 0
        self._free_rows: defaultdict[int, list[int]] = defaultdict(list)
        self.material: NDArray[np.int16] = np.zeros(1, np.int16)
        self.semantic: NDArray[np.uint8] = np.zeros(1, np.uint8)

    def add(self, meshes: Sequence[Mesh]) -> int:
        """Add the triangles of some meshes; return the row of the first."""
        counts = [len(mesh.triangles) for mesh in meshes]
        num_triangles = sum(counts)
        first = self._take_rows(num_triangles)
        if meshes:
            new = slice(first, first + num_triangles)
            materials = [_find_material_index(mesh.material) for mesh in meshes]
            self.material[new] = np.repeat(materials, counts)
            self.semantic[new] = np.repeat([int(mesh.semantic) for mesh in meshes], counts)
        return first

    def remove(self, first: int, num_triangles: int) -> None:
        """Free the rows of triangles added together."""
        self._free_rows[num_triangles].append(first)

    def _take_rows(self, count: int) -> int:
        """Take free rows or append new ones; return the first."""
        if self._free_rows[count]:
            return self._free_rows[count].pop()
        first, self._count = self._count, self._count + count
        if self._count >= len(self.material):
            room = self._count + self._count // 2 + 1 - len(self.material)
            self.material = np.pad(self.material, (0, room))
            self.semantic = np.pad(self.semantic, (0, room))
        return first


def _normalise(vectors: FloatArray) -> FloatArray:
    """Scale vectors (3, n) to unit length; zeros stay. In float32: a scan has 120,000 of them."""
    length = np.sqrt(_dot(vectors, vectors))
    return vectors / np.where(length > 0.0, length, 1.0)


def _dot(first: FloatArray, second: FloatArray) -> FloatArray:
    """Compute the products (n,) of vectors (3, n): whole rows are faster than rows of three."""
    return first[0] * second[0] + first[1] * second[1] + first[2] * second[2]


def _find_material_index(material: str) -> int:
    """Look up the index of a material; -1 for surfaces in the actor's paint."""
    return _ACTOR_PAINT if material == ACTOR_PAINT else MATERIAL_INDEX[material]
