"""Rays against the world's own meshes and the bodies that move on it, by Embree.

The static world is one scene, the blueprints that keep their shape, side by side, are another; the
poses of each that walks or pedals are one more, built when it is first met. Rays that may meet a
mover are brought into its frame, at the moment of each ray if a frame is a stretch of time, and
cast at its shape. So next to nothing is built while frames pass.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from advercity.rendering.embree import Shapes
from advercity.rendering.fan import Fan
from advercity.rendering.movers import Aim, Movers
from advercity.traffic.posture import Shape, posture
from advercity.traffic.trace import Frame
from advercity.world.materials import MATERIALS, PAINT
from advercity.world.scene import Mesh, World

Floats = NDArray[np.floating[Any]]
Rows = NDArray[np.intp]

MATERIAL_NAMES = tuple(MATERIALS)
"""Name of a material by its index in `Hits.material`."""
_MATERIAL_INDEX = {name: index for index, name in enumerate(MATERIAL_NAMES)}
_PAINTED = -1


@dataclass(frozen=True, eq=False)
class Hits:
    """The first surface that each of n rays met; a miss has range inf and zeros elsewhere.

    Rays that are cast again may share their hits, so nobody writes into them.

    Attributes:
        range_m: (n,) float32 along the ray.
        normal: (n, 3) float32 of the flat triangle, unit, world frame, towards the ray's origin.
        cosine: (n,) float32 of the angle of incidence.
        material: (n,) int16 into `MATERIAL_NAMES`.
        semantic: (n,) uint8 of `Semantic`.
        instance: (n,) int32 id of the actor; 0 for everything static.
    """

    range_m: Floats
    normal: Floats
    cosine: Floats
    material: NDArray[np.int16]
    semantic: NDArray[np.uint8]
    instance: NDArray[np.int32]

    @staticmethod
    def misses(count: int) -> "Hits":
        """That many rays that met nothing."""
        return Hits(
            range_m=np.full(count, np.inf, np.float32),
            normal=np.zeros((count, 3), np.float32),
            cosine=np.zeros(count, np.float32),
            material=np.zeros(count, np.int16),
            semantic=np.zeros(count, np.uint8),
            instance=np.zeros(count, np.int32),
        )

    def with_rows(self, where: Rows, other: "Hits") -> "Hits":
        """A copy with the rows of `other` over the rows `where`."""
        copies = {item.name: getattr(self, item.name).copy() for item in fields(self)}
        for name, column in copies.items():
            column[where] = getattr(other, name)
        return Hits(**copies)

    def rows(self, where: Rows) -> "Hits":
        """Those rows alone."""
        return Hits(*(getattr(self, item.name).take(where, axis=0) for item in fields(self)))


@dataclass(frozen=True, eq=False)
class Rays:
    """n rays of the world.

    Attributes:
        origins: (n, 3) float32, metres.
        directions: (n, 3) float32, unit vectors.
        share: (n,) float32 of the time from the frame before to this one that has gone by when
            each ray is cast; None if all are cast at this frame.
        fan: How they spread, if they do.
    """

    origins: Floats
    directions: Floats
    share: Floats | None = None
    fan: Fan | None = None

    def __len__(self) -> int:
        return len(self.directions)

    def rows(self, where: Rows) -> "Rays":
        """Those rays alone; `where` ascends."""
        return Rays(
            self.origins.take(where, axis=0),
            self.directions.take(where, axis=0),
            None if self.share is None else self.share[where],
            None if self.fan is None else self.fan.rows(where),
        )


class Caster:
    """Casts rays into a world; movers go where `place` puts them.

    What the world shows to rays is remembered for as long as those `Rays` are kept, so a sensor
    that stands still pays for it once.
    """

    def __init__(self, world: World) -> None:
        self._bodies = world.bodies
        self._triangles = _Triangles()
        self._world = Shapes([world.static], first=self._triangles.add(world.static))
        self._scenes: list[Shapes] = []
        self._places: dict[Shape, tuple[int, int]] = {}
        self._hold([Shape(name) for name, body in world.bodies.items() if body.gait is None])
        self._frames: tuple[Frame | None, Frame | None] = (None, None)
        self._all_movers = self._movers = self._movers_of(Frame(0, 0.0, (), {}), None)
        self._seen: WeakKeyDictionary[Rays, tuple[float, Hits]] = WeakKeyDictionary()

    def place(
        self, frame: Frame, hide: frozenset[int] = frozenset(), *, before: Frame | None = None
    ) -> None:
        """Move every actor to where it is in `frame`; rays pass through those in `hide`.

        With the frame `before`, rays may be cast at any moment between the two. An actor that was
        not there yet stays where it is. Placing the same frames again costs next to nothing.
        """
        if self._frames[0] is not frame or self._frames[1] is not before:
            self._all_movers = self._movers_of(frame, before)
            self._frames = (frame, before)
        self._movers = self._all_movers.without(hide)

    def cast(self, rays: Rays, max_range_m: float) -> Hits:
        """The nearest hit of every ray; surfaces beyond `max_range_m` are missed."""
        fixed = self._cast_at_world(rays, max_range_m)
        limits = np.minimum(fixed.range_m, np.float32(max_range_m))
        ray, mover = self._aimed(rays)
        if not len(ray):
            return fixed
        aim = self._movers.aim(
            rays.origins.take(ray, axis=0),
            rays.directions.take(ray, axis=0),
            None if rays.share is None else rays.share.take(ray),
            mover,
            limits.take(ray),
        )
        triangle, past_m = self._run(mover.take(aim.pair), aim)
        met = np.flatnonzero(triangle >= 0)
        range_m = aim.start_m[met] + past_m[met]
        pair = aim.pair[met]
        np.minimum.at(limits, ray[pair], range_m)
        first = np.flatnonzero(range_m == limits[ray[pair]])
        if not len(first):
            return fixed
        pair = pair[first]
        nearest = self._of_movers(
            rays, ray[pair], mover[pair], triangle[met[first]], range_m[first]
        )
        return fixed.with_rows(ray[pair], nearest)

    def _cast_at_world(self, rays: Rays, max_range_m: float) -> Hits:
        """What is met of all that does not move."""
        known = self._seen.get(rays)
        if known is not None and known[0] == max_range_m:
            return known[1]
        limits = np.full(len(rays), max_range_m, np.float32)
        triangle, range_m = self._world.run(0, rays.origins, rays.directions, limits)
        range_m[triangle < 0] = np.inf
        hits = Hits(
            range_m=range_m,
            **_facing(self._triangles.normal.take(triangle, axis=0, mode="wrap"), rays.directions),
            material=self._triangles.material.take(triangle, mode="wrap"),
            semantic=self._triangles.semantic.take(triangle, mode="wrap"),
            instance=np.zeros(len(rays), np.int32),
        )
        self._seen[rays] = max_range_m, hits
        return hits

    def _aimed(self, rays: Rays) -> tuple[Rows, Rows]:
        """Pairs of a ray and a mover that it may meet, mover by mover."""
        if rays.fan is not None:
            return rays.fan.towards(self._movers.corners)
        count = len(self._movers)
        return np.tile(np.arange(len(rays)), count), np.repeat(np.arange(count), len(rays))

    def _of_movers(
        self, rays: Rays, ray: Rows, mover: Rows, triangle: NDArray[np.int32], range_m: Floats
    ) -> Hits:
        """Hits (k,) of movers' triangles."""
        share = None if rays.share is None else rays.share.take(ray)
        turns, _ = self._movers.poses_at(share, mover)
        normal = np.einsum("ijn,nj->ni", turns, self._triangles.normal.take(triangle, axis=0))
        material = self._triangles.material.take(triangle)
        painted = np.flatnonzero(material == _PAINTED)
        material[painted] = self._movers.paint.take(mover[painted])
        return Hits(
            range_m=range_m,
            **_facing(normal, rays.directions.take(ray, axis=0)),
            material=material,
            semantic=self._triangles.semantic.take(triangle),
            instance=self._movers.id.take(mover),
        )

    def _run(self, mover: Rows, aim: Aim) -> tuple[NDArray[np.int32], Floats]:
        """Triangle and range (p,) of the nearest hit of rays aimed at movers (p,)."""
        scene, row = self._movers.scene.take(mover), self._movers.body.take(mover)
        triangle, range_m = np.full(len(mover), -1, np.int32), aim.length_m.copy()
        for number in np.unique(scene).tolist():
            own = np.flatnonzero(scene == number)
            triangle[own], range_m[own] = self._scenes[number].run(
                row[own], aim.origins[own], aim.directions[own], aim.length_m[own]
            )
        return triangle, range_m

    def _movers_of(self, frame: Frame, before: Frame | None) -> Movers:
        seen = [posture(state, self._bodies) for state in frame.states]
        for one in seen:
            if one.shape not in self._places:
                self._hold(one.shape.siblings(self._bodies))
        places = [self._places[one.shape] for one in seen]
        corners = [(self._scenes[n].low[row], self._scenes[n].high[row]) for n, row in places]
        low, high = np.array(corners).reshape(-1, 2, 3).swapaxes(0, 1)
        return Movers.of(
            frame,
            before,
            paint=[_index_of(state.actor.paint) for state in frame.states],
            shape=places,
            body_from_mesh=[one.body_from_mesh for one in seen],
            low=low,
            high=high,
        )

    def _hold(self, shapes: Sequence[Shape]) -> None:
        """Put some shapes into a scene of their own."""
        groups = [shape.meshes(self._bodies) for shape in shapes]
        first = self._triangles.add([mesh for group in groups for mesh in group])
        self._places |= {shape: (len(self._scenes), row) for row, shape in enumerate(shapes)}
        self._scenes.append(Shapes(groups, first=first))


class _Triangles:
    """What triangles are; the last row of each table stands for a miss, where -1 finds it.

    Tables have room to grow, since shapes come as they are met.
    """

    def __init__(self) -> None:
        self._count = 0
        self.normal: Floats = np.zeros((1, 3), np.float32)
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
            self.normal[new] = np.concatenate([_normals(mesh) for mesh in meshes])
            self.material[new] = np.repeat([_index_of(mesh.material) for mesh in meshes], counts)
            self.semantic[new] = np.repeat([int(mesh.semantic) for mesh in meshes], counts)
        return first


def _facing(normal: Floats, directions: Floats) -> dict[str, Floats]:
    """Normals (n, 3) turned towards where rays came from, and the cosine (n,) of incidence."""
    x, y, z = normal.T
    along = x * directions[:, 0] + y * directions[:, 1] + z * directions[:, 2]
    return {"normal": normal * -np.sign(along)[:, None], "cosine": np.abs(along)}


def _normals(mesh: Mesh) -> Floats:
    """Unit normals (m, 3)."""
    a, b, c = (mesh.vertices[mesh.triangles[:, corner]].astype(np.float64) for corner in range(3))
    across = np.cross(b - a, c - a)
    length = np.linalg.norm(across, axis=1, keepdims=True)
    return (across / np.where(length > 0.0, length, 1.0)).astype(np.float32)


def _index_of(material: str) -> int:
    """Index of a material; -1 for what takes its actor's paint."""
    return _PAINTED if material == PAINT else _MATERIAL_INDEX[material]
