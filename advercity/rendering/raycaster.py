"""Rays against the world's own meshes and the bodies that move on it, by Embree.

The static world is one solid, every shape that a body takes on another, built when it is first
met. A frame is a scene of them: where they stand, or where they go if a frame is a stretch of time.
So next to nothing is built while frames pass.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from advercity.assets.body_pose import BodyShape, compute_body_pose
from advercity.frames import Frame
from advercity.geometry import poses
from advercity.geometry.arrays import FloatArray, IndexArray
from advercity.geometry.mesh import Mesh
from advercity.geometry.poses import Matrix
from advercity.materials import ACTOR_PAINT, MATERIALS
from advercity.rendering.embree import EmbreeMesh, EmbreeScene
from advercity.world import World

MATERIAL_NAMES = tuple(MATERIALS)
"""Name of a material by its index in `Hits.material`."""
_MATERIAL_INDEX = {name: index for index, name in enumerate(MATERIAL_NAMES)}
_ACTOR_PAINT = -1


@dataclass(frozen=True, eq=False)
class RayHits:
    """The first surface that each of n rays met; a miss has range inf and zeros elsewhere.

    Attributes:
        range_m: (n,) float32 along the ray.
        normal: (n, 3) float32 of the flat triangle, unit, world frame, towards the ray's origin.
        cosine: (n,) float32 of the angle of incidence.
        material: (n,) int16 into `MATERIAL_NAMES`.
        semantic: (n,) uint8 of `Semantic`.
        instance: (n,) int32 id of the actor; 0 for everything static.
    """

    range_m: FloatArray
    normal: FloatArray
    cosine: FloatArray
    material: NDArray[np.int16]
    semantic: NDArray[np.uint8]
    instance: NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class Rays:
    """n rays of the world.

    Attributes:
        origins: (n, 3) float32, metres.
        directions: (n, 3) float32, unit vectors.
        time_fraction: (n,) float32 of the time from the frame before to this one that has gone by
            when
            each ray is cast; None if all are cast at this frame.
        ring: (n,) uint16; rays of a ring, one after the other, go much the same way. None if all
            rays do.
    """

    origins: FloatArray
    directions: FloatArray
    time_fraction: FloatArray | None = None
    ring: NDArray[np.uint16] | None = None

    def __len__(self) -> int:
        return len(self.directions)

    def select(self, where: IndexArray) -> "Rays":
        """Those rays alone."""
        return Rays(
            self.origins.take(where, axis=0),
            self.directions.take(where, axis=0),
            None if self.time_fraction is None else self.time_fraction.take(where),
            None if self.ring is None else self.ring.take(where),
        )


class Raycaster:
    """Casts rays into a world; movers go where `place` puts them."""

    def __init__(self, world: World) -> None:
        self._bodies = world.bodies
        self._triangles = _TriangleTable()
        self._world = self._register_meshes(world.static)
        self._shapes: dict[BodyShape, _RegisteredMesh] = {}
        self._frames: tuple[Frame | None, Frame | None] = (None, None)
        self._placed = self._build_placement(Frame(0, 0.0, (), {}), None)

    def place(
        self,
        frame: Frame,
        hide: frozenset[int] = frozenset(),
        *,
        previous_frame: Frame | None = None,
    ) -> None:
        """Move every actor to where it is in `frame`; rays pass through those in `hide`.

        With the frame `before`, rays may be cast at any moment between the two. An actor that was
        not there yet stays where it is. Placing the same frames again costs next to nothing.
        """
        if self._frames[0] is not frame or self._frames[1] is not previous_frame:
            self._placed = self._build_placement(frame, previous_frame)
            self._frames = (frame, previous_frame)
        hidden = np.isin(self._placed.instance[:-1], list(hide))
        self._placed.scene.hide(np.flatnonzero(hidden).tolist())

    def cast(self, rays: Rays, max_range_m: float) -> RayHits:
        """The nearest hit of every ray; surfaces beyond `max_range_m` are missed."""
        placed, known = self._placed, self._triangles
        met = placed.scene.cast(
            rays.origins,
            rays.directions,
            max_range_m,
            time_fraction=rays.time_fraction,
            ray_order=None if rays.ring is None else np.argsort(rays.ring, kind="stable"),
        )
        # What met nothing has -1 for both, which finds the last row of each table.
        triangle = placed.first.take(met.instance, mode="wrap") + met.triangle
        met.range_m[triangle < 0] = np.inf
        normal = known.normal.take(triangle, axis=0, mode="wrap")
        material = known.material.take(triangle, mode="wrap")
        moved = np.flatnonzero(met.instance > 0)
        mover = met.instance.take(moved)
        share = None if rays.time_fraction is None else rays.time_fraction.take(moved)
        normal[moved] = placed.rotate_normals(normal.take(moved, axis=0), mover, share)
        painted = np.flatnonzero(material == _ACTOR_PAINT)
        material[painted] = placed.paint.take(met.instance.take(painted))
        return RayHits(
            range_m=met.range_m,
            **_orient_normals(normal, rays.directions),
            material=material,
            semantic=known.semantic.take(triangle, mode="wrap"),
            instance=placed.instance.take(met.instance, mode="wrap"),
        )

    def _build_placement(self, frame: Frame, before: Frame | None) -> "_PlacedFrame":
        states = frame.states
        seen = [compute_body_pose(state, self._bodies) for state in states]
        held = [self._world, *(self._get_shape_mesh(one.shape) for one in seen)]
        own = [np.eye(4), *(one.body_from_mesh for one in seen)]
        now = [np.eye(4), *(state.world_from_body for state in states)] @ np.array(own)
        then = None
        if before is not None:
            earlier = {state.actor.id: state for state in before.states}
            stood = [earlier.get(state.actor.id, state).world_from_body for state in states]
            then = [np.eye(4), *stood] @ np.array(own)
        return _PlacedFrame(
            scene=EmbreeScene([one.solid for one in held], now, then),
            now=now,
            before=then,
            first=np.array([*(one.first for one in held), 0], np.int32),
            instance=np.array([0, *(state.actor.id for state in states), 0], np.int32),
            paint=np.array(
                [0, *(_find_material_index(state.actor.paint) for state in states)], np.int16
            ),
        )

    def _get_shape_mesh(self, shape: BodyShape) -> "_RegisteredMesh":
        if shape not in self._shapes:
            self._shapes[shape] = self._register_meshes(shape.build_meshes(self._bodies))
        return self._shapes[shape]

    def _register_meshes(self, meshes: Sequence[Mesh]) -> "_RegisteredMesh":
        return _RegisteredMesh(EmbreeMesh(meshes), self._triangles.add(meshes))


@dataclass(frozen=True, eq=False)
class _RegisteredMesh:
    """A solid, and the row of the first of its triangles among those of all."""

    solid: EmbreeMesh
    first: int


@dataclass(frozen=True, eq=False)
class _PlacedFrame:
    """A frame: the static world, which comes first, and k - 1 movers.

    Attributes:
        scene: Of them all.
        now: (k, 4, 4) `world_from_mesh`.
        before: (k, 4, 4) at the frame before; None if all rays are cast now.
        first: (k + 1,) int32 row of each one's first triangle, and 0 for a miss.
        instance: (k + 1,) int32 ids of the actors, 0 for the world and for a miss.
        paint: (k,) int16 material of what is painted.
    """

    scene: EmbreeScene
    now: Matrix
    before: Matrix | None
    first: NDArray[np.int32]
    instance: NDArray[np.int32]
    paint: NDArray[np.int16]

    def rotate_normals(
        self, vectors: FloatArray, mover: NDArray[np.int32], share: FloatArray | None
    ) -> FloatArray:
        """Vectors (n, 3) of movers (n,) in the world, at shares (n,) of the tick."""
        if self.before is None or share is None:
            turns = self.now[:, :3, :3].astype(np.float32).take(mover, axis=0)
            return np.einsum("nij,nj->ni", turns, vectors)
        turned = np.empty_like(vectors)
        for one in np.unique(mover).tolist():
            own = np.flatnonzero(mover == one)
            turns = poses.interpolate_poses(self.before[one], self.now[one], share[own])[:, :3, :3]
            turned[own] = np.einsum("nij,nj->ni", turns, vectors[own])
        return turned


class _TriangleTable:
    """What triangles are; the last row of each table stands for a miss, where -1 finds it.

    Tables have room to grow, since shapes come as they are met.
    """

    def __init__(self) -> None:
        self._count = 0
        self.normal: FloatArray = np.zeros((1, 3), np.float32)
        self.material: NDArray[np.int16] = np.zeros(1, np.int16)
        self.semantic: NDArray[np.uint8] = np.zeros(1, np.uint8)

    def add(self, meshes: Sequence[Mesh]) -> int:
        """Take in the triangles of some meshes; the row of the first."""
        counts = [len(mesh.triangles) for mesh in meshes]
        first, self._count = self._count, self._count + sum(counts)
        if self._count >= len(self.material):
            room = self._count + self._count // 2 + 1 - len(self.material)
            self.normal = np.pad(self.normal, ((0, room), (0, 0)))
            self.material = np.pad(self.material, (0, room))
            self.semantic = np.pad(self.semantic, (0, room))
        if meshes:
            new = slice(first, self._count)
            self.normal[new] = np.concatenate([_triangle_normals(mesh) for mesh in meshes])
            self.material[new] = np.repeat(
                [_find_material_index(mesh.material) for mesh in meshes], counts
            )
            self.semantic[new] = np.repeat([int(mesh.semantic) for mesh in meshes], counts)
        return first


def _orient_normals(normal: FloatArray, directions: FloatArray) -> dict[str, FloatArray]:
    """Normals (n, 3) turned towards where rays came from, and the cosine (n,) of incidence."""
    x, y, z = normal.T
    along = x * directions[:, 0] + y * directions[:, 1] + z * directions[:, 2]
    return {"normal": normal * -np.sign(along)[:, None], "cosine": np.abs(along)}


def _triangle_normals(mesh: Mesh) -> FloatArray:
    """Unit normals (m, 3)."""
    a, b, c = (mesh.vertices[mesh.triangles[:, corner]].astype(np.float64) for corner in range(3))
    across = np.cross(b - a, c - a)
    length = np.linalg.norm(across, axis=1, keepdims=True)
    return (across / np.where(length > 0.0, length, 1.0)).astype(np.float32)


def _find_material_index(material: str) -> int:
    """Index of a material; -1 for what takes its actor's paint."""
    return _ACTOR_PAINT if material == ACTOR_PAINT else _MATERIAL_INDEX[material]
