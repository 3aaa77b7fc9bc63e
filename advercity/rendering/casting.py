"""Rays against the world's own meshes and the bodies that move on it, by Embree.

Two levels: the static world is one scene, every blueprint another, each built once. A mover is an
instance of its blueprint's scene: rays that may meet it are brought into its body frame, at the
moment of each ray if a frame is a stretch of time. So nothing is built while frames pass.

Embree works in float32: hits are good to a tenth of a millimetre within a kilometre of the
world's origin.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Any

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from advercity import poses
from advercity.poses import Matrix
from advercity.traffic.trace import ActorState, Frame
from advercity.world.materials import MATERIALS, PAINT
from advercity.world.scene import Mesh, World

Array = NDArray[np.float64]
Floats = NDArray[np.floating[Any]]
Rows = NDArray[np.intp]

MATERIAL_NAMES = tuple(MATERIALS)
"""Name of a material by its index in `Hits.material`."""
_MATERIAL_INDEX = {name: index for index, name in enumerate(MATERIAL_NAMES)}
_PAINTED = -1
_STATIC = -1


@dataclass(frozen=True, eq=False)
class Hits:
    """The first surface that each of n rays met; a miss has range inf and zeros elsewhere.

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

    def put(self, where: Rows, other: "Hits") -> None:
        """Write the rows of `other` over the rows `where`."""
        for item in fields(self):
            getattr(self, item.name)[where] = getattr(other, item.name)

    def rows(self, where: Rows) -> "Hits":
        """Those rows alone."""
        return Hits(*(getattr(self, item.name)[where] for item in fields(self)))


@dataclass(frozen=True, eq=False)
class Fan:
    """How rays spread around a viewpoint, which tells for most of them what they cannot meet.

    Rays need not start at the viewpoint, but end within the range that is cast from there.

    Attributes:
        world_from_fan: (4, 4); bearings turn about its z axis.
        bearing_rad: (m,) float32 of every column of rays, ascending, from 0 to 2 pi.
        elevation_rad: (c,) of the rays of each column, ascending; None if a column is one ray of
            any elevation.
        spread_rad: How far a ray may stray from its bearing and elevation.
        reach_m: How far from the fan's origin a ray may start.
    """

    world_from_fan: Matrix
    bearing_rad: Floats
    elevation_rad: Floats | None = None
    spread_rad: float = 0.0
    reach_m: float = 0.0

    def rows(self, where: Rows) -> "Fan":
        """The fan of those rays alone; `where` ascends."""
        width = 1 if self.elevation_rad is None else len(self.elevation_rad)
        bearing_rad = self.bearing_rad[where // width]
        return Fan(self.world_from_fan, bearing_rad, None, self.spread_rad, self.reach_m)

    def towards(
        self, centres: NDArray[np.float64], radii_m: NDArray[np.float64]
    ) -> tuple[Rows, Rows]:
        """Pairs of a ray and a ball of the world that it may pass through: ray, ball (p,) each.

        They come ball by ball.

        Args:
            centres: (k, 3) of the balls, metres.
            radii_m: (k,).
        """
        own = (centres - self.world_from_fan[:3, 3]) @ self.world_from_fan[:3, :3]
        level = np.hypot(own[:, 0], own[:, 1])
        within = radii_m + self.reach_m
        half = np.arcsin(np.minimum(within / np.maximum(level, within), 1.0)) + self.spread_rad
        half[(level <= within) | (half > np.pi)] = np.pi
        first = np.mod(np.arctan2(own[:, 1], own[:, 0]) - half, 2.0 * np.pi)
        low, high = self._channels(np.hypot(level, own[:, 2]), np.arctan2(own[:, 2], level), within)
        # A run that begins before the seam goes on behind it.
        begins = np.stack([first - 2.0 * np.pi, first], axis=1).ravel()
        ends = begins + 2.0 * np.repeat(half, 2)
        start = self.bearing_rad.searchsorted(begins.astype(np.float32))
        stop = self.bearing_rad.searchsorted(ends.astype(np.float32))
        start[1::2] = np.maximum(start[1::2], stop[::2])
        return self._pairs(start, stop, np.repeat(low, 2), np.repeat(high, 2))

    def _channels(self, away: Array, elevation: Array, within: Array) -> tuple[Rows, Rows]:
        """First and last but one place (k,) in a column that may look at each ball."""
        if self.elevation_rad is None:
            return np.zeros(len(away), np.intp), np.ones(len(away), np.intp)
        half = np.arcsin(np.minimum(within / np.maximum(away, within), 1.0)) + self.spread_rad
        half[away <= within] = np.pi
        return (
            self.elevation_rad.searchsorted((elevation - half).astype(np.float32)),
            self.elevation_rad.searchsorted((elevation + half).astype(np.float32)),
        )

    def _pairs(self, start: Rows, stop: Rows, low: Rows, high: Rows) -> tuple[Rows, Rows]:
        """Rays of columns `start` to `stop` and places `low` to `high`, two runs (2k,) a ball."""
        width = 1 if self.elevation_rad is None else len(self.elevation_rad)
        high = np.maximum(high, low)
        count = np.maximum(stop - start, 0) * (high - low)
        run = np.repeat(np.arange(len(count)), count)
        step = np.arange(len(run)) - np.repeat(np.cumsum(count) - count, count)
        across = (high - low)[run]
        column = step // np.maximum(across, 1)
        return (start[run] + column) * width + low[run] + step - column * across, run // 2


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
    """Casts rays into a world; movers go where `place` puts them."""

    def __init__(self, world: World) -> None:
        groups = {"": world.static} | {name: body.parts for name, body in world.bodies.items()}
        firsts = np.cumsum([0, *(_triangle_count(group) for group in groups.values())]).tolist()
        shapes = [
            _Shape(group, first) for group, first in zip(groups.values(), firsts, strict=False)
        ]
        self._static, *bodies = shapes
        self._bodies = dict(zip(world.bodies, bodies, strict=True))
        self._triangles = _Triangles.of([mesh for group in groups.values() for mesh in group])
        self._frames: tuple[Frame | None, Frame | None] = (None, None)
        self._all_movers: tuple[_Mover, ...] = ()
        self._movers: tuple[_Mover, ...] = ()

    def place(
        self, frame: Frame, hide: frozenset[int] = frozenset(), *, before: Frame | None = None
    ) -> None:
        """Move every actor to where it is in `frame`; rays pass through those in `hide`.

        With the frame `before`, rays may be cast at any moment between the two. An actor that was
        not there yet stays where it is. Placing the same frames again costs next to nothing.
        """
        if self._frames[0] is not frame or self._frames[1] is not before:
            earlier = {} if before is None else {state.actor.id: state for state in before.states}
            self._all_movers = tuple(
                _Mover.of(state, earlier.get(state.actor.id, state), self._bodies)
                for state in frame.states
            )
            self._frames = (frame, before)
        self._movers = tuple(mover for mover in self._all_movers if mover.id not in hide)

    def cast(self, rays: Rays, max_range_m: float) -> Hits:
        """The nearest hit of every ray; surfaces beyond `max_range_m` are missed."""
        reached = _Reached.nothing(len(rays), max_range_m)
        triangle, range_m = self._static.run(rays.origins, rays.directions, reached.range_m)
        met = np.flatnonzero(triangle >= 0)
        if len(met) == len(triangle):
            reached.triangle[:], reached.range_m[:] = triangle, range_m
        else:
            reached.put(met, triangle[met], range_m[met], _STATIC)
        self._cast_movers(rays, max_range_m, reached)
        return self._hits(rays, reached)

    def _cast_movers(self, rays: Rays, max_range_m: float, reached: "_Reached") -> None:
        """Put hits of movers where they are nearer than what is there."""
        ray, mover = self._near(rays, max_range_m, reached)
        bounds = np.flatnonzero(np.diff(mover, prepend=-1, append=-1))
        for first, last in pairwise(bounds.tolist()):
            self._movers[mover[first]].cast(rays, ray[first:last], int(mover[first]), reached)

    def _near(self, rays: Rays, max_range_m: float, reached: "_Reached") -> tuple[Rows, Rows]:
        """Pairs of a ray and a mover whose ball it passes through before it ends."""
        nothing = np.empty(0, np.intp)
        if not self._movers or not len(rays):
            return nothing, nothing
        centres = np.array([mover.centre for mover in self._movers])
        radii_m = np.array([mover.radius_m for mover in self._movers])
        fan = rays.fan
        if fan is None:
            ray = np.tile(np.arange(len(rays)), len(centres))
            mover = np.repeat(np.arange(len(centres)), len(rays))
        else:
            away_m = np.linalg.norm(centres - fan.world_from_fan[:3, 3], axis=1)
            near = np.flatnonzero(away_m < max_range_m + fan.reach_m + radii_m)
            ray, ball = fan.towards(centres[near], radii_m[near])
            mover = near[ball]
        return _through(rays, ray, mover, centres, radii_m, reached.range_m)

    def _hits(self, rays: Rays, reached: "_Reached") -> Hits:
        """What the triangles that were reached are."""
        triangle = reached.triangle
        material = self._triangles.material.take(triangle, mode="wrap")
        normal = self._triangles.normal.take(triangle, axis=0, mode="wrap")
        instance = np.zeros(len(rays), np.int32)
        moving = np.flatnonzero(reached.mover != _STATIC)
        if len(moving):
            mover = reached.mover[moving]
            instance[moving] = np.array([one.id for one in self._movers], np.int32)[mover]
            paint = np.array([one.paint for one in self._movers], np.int16)[mover]
            painted = material[moving] == _PAINTED
            material[moving[painted]] = paint[painted]
            normal[moving] = self._turned(normal[moving], mover, rays, moving)
        x, y, z = normal.T
        along = rays.directions
        cosine = x * along[:, 0] + y * along[:, 1] + z * along[:, 2]
        normal *= -np.sign(cosine)[:, None]
        return Hits(
            range_m=np.where(triangle >= 0, reached.range_m, np.float32(np.inf)),
            normal=normal,
            cosine=np.abs(cosine),
            material=material,
            semantic=self._triangles.semantic.take(triangle, mode="wrap"),
            instance=instance,
        )

    def _turned(self, normal: Floats, mover: NDArray[np.int16], rays: Rays, where: Rows) -> Floats:
        """Normals (k, 3) of bodies as their movers (k,) have turned when rays `where` meet them."""
        if rays.share is None:
            turns = np.array([one.turn for one in self._movers])[mover]
        else:
            turns = np.empty((len(where), 3, 3), np.float32)
            for number in np.unique(mover):
                own = np.flatnonzero(mover == number)
                turns[own] = self._movers[number].pose_at(rays.share[where[own]])[:, :3, :3]
        return np.einsum("nij,nj->ni", turns, normal)


@dataclass(frozen=True, eq=False)
class _Reached:
    """How far n rays have got: triangle of all shapes' or -1, range, and whose triangle it is."""

    triangle: NDArray[np.int32]
    range_m: Floats
    mover: NDArray[np.int16]

    @staticmethod
    def nothing(count: int, max_range_m: float) -> "_Reached":
        return _Reached(
            triangle=np.full(count, -1, np.int32),
            range_m=np.full(count, max_range_m, np.float32),
            mover=np.full(count, _STATIC, np.int16),
        )

    def put(self, rows: Rows, triangle: NDArray[np.int32], range_m: Floats, mover: int) -> None:
        self.triangle[rows] = triangle
        self.range_m[rows] = range_m
        self.mover[rows] = mover


@dataclass(frozen=True, eq=False)
class _Triangles:
    """What triangles are; the last row of each table stands for a miss, where -1 finds it."""

    normal: Floats
    material: NDArray[np.int16]
    semantic: NDArray[np.uint8]

    @staticmethod
    def of(meshes: Sequence[Mesh]) -> "_Triangles":
        counts = [*(len(mesh.triangles) for mesh in meshes), 1]
        materials = [*(_index_of(mesh.material) for mesh in meshes), 0]
        semantics = [*(mesh.semantic for mesh in meshes), 0]
        return _Triangles(
            normal=np.concatenate([*map(_normals, meshes), np.zeros((1, 3), np.float32)]),
            material=np.repeat(np.array(materials, np.int16), counts),
            semantic=np.repeat(np.array(semantics, np.uint8), counts),
        )


class _Shape:
    """Meshes in Embree's hands.

    Args:
        meshes: Its parts.
        first: Row of its first triangle in `_Triangles`.
    """

    def __init__(self, meshes: Sequence[Mesh], first: int) -> None:
        self.centre = np.zeros(3)
        self.radius_m = 0.0
        self._first = np.int32(first)
        self._scene: Any = None
        if not _triangle_count(meshes):
            return
        starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)]).astype(np.int32)
        vertices = np.concatenate([mesh.vertices for mesh in meshes])
        triangles = np.concatenate(
            [mesh.triangles + start for mesh, start in zip(meshes, starts, strict=False)]
        )
        self.centre = (vertices.min(axis=0) + vertices.max(axis=0)).astype(np.float64) / 2.0
        self.radius_m = float(np.linalg.norm(vertices - self.centre, axis=1).max())
        self._scene = EmbreeScene(robust=True)
        TriangleMesh(self._scene, vertices, triangles)

    def run(
        self, origins: Floats, directions: Floats, limits: Floats
    ) -> tuple[NDArray[np.int32], Floats]:
        """Triangle (n,), -1 for none, and range (n,) of the nearest hit of rays in its frame."""
        if self._scene is None or not len(origins):
            return np.full(len(origins), -1, np.int32), limits
        # Embree writes what it found over the limits.
        found: dict[str, NDArray[Any]] = self._scene.run(
            origins, directions, limits.copy(), output=True
        )
        triangle = found["primID"]
        triangle += self._first * (triangle >= 0)
        return triangle, found["tfar"]


@dataclass(frozen=True, eq=False)
class _Mover:
    """An instance of a shape, from one frame to the next.

    Attributes:
        centre: (3,) of a sphere of the world that holds it all the while.
        radius_m: Of that sphere.
        place: (3,) at the frame.
        turn: (3, 3) rotation at the frame.
    """

    id: int
    paint: int
    shape: _Shape
    before: Matrix
    now: Matrix
    centre: NDArray[np.float64]
    radius_m: float
    place: Floats
    turn: Floats

    @staticmethod
    def of(state: ActorState, before: ActorState, shapes: dict[str, _Shape]) -> "_Mover":
        shape = shapes[state.actor.blueprint]
        pose = state.world_from_body
        first = poses.transform(before.world_from_body, shape.centre)
        last = poses.transform(pose, shape.centre)
        return _Mover(
            id=state.actor.id,
            paint=_index_of(state.actor.paint),
            shape=shape,
            before=before.world_from_body,
            now=pose,
            centre=(first + last) / 2.0,
            radius_m=shape.radius_m + math.dist(first, last) / 2.0,
            place=pose[:3, 3].astype(np.float32),
            turn=pose[:3, :3].astype(np.float32),
        )

    def pose_at(self, share: Floats) -> Matrix:
        """World from body (n, 4, 4) at moments (n,)."""
        return poses.between(self.before, self.now, share)

    def cast(self, rays: Rays, rows: Rows, number: int, reached: _Reached) -> None:
        """Put hits of those rays where they are nearer than what is there."""
        origins, directions = rays.origins.take(rows, axis=0), rays.directions.take(rows, axis=0)
        if rays.share is None:
            origins, directions = (origins - self.place) @ self.turn, directions @ self.turn
        else:
            pose = self.pose_at(rays.share[rows]).astype(np.float32)
            origins = np.einsum("nji,nj->ni", pose[:, :3, :3], origins - pose[:, :3, 3])
            directions = np.einsum("nji,nj->ni", pose[:, :3, :3], directions)
        triangle, range_m = self.shape.run(origins, directions, reached.range_m[rows])
        met = (triangle >= 0).nonzero()[0]
        if len(met):
            reached.put(rows[met], triangle[met], range_m[met], number)


def _through(
    rays: Rays, ray: Rows, mover: Rows, centres: Array, radii_m: Array, limits: Floats
) -> tuple[Rows, Rows]:
    """Of pairs of rays and balls, those that meet before the ray ends."""
    to_centre = centres.astype(np.float32)[mover] - rays.origins.take(ray, axis=0)
    ahead = rays.directions.take(ray, axis=0)
    along = np.einsum("ij,ij->i", to_centre, ahead)
    off_2 = np.einsum("ij,ij->i", to_centre, to_centre) - along * along
    reach = radii_m.astype(np.float32)[mover]
    meets = (off_2 < reach * reach) & (along > -reach) & (along - reach < limits.take(ray))
    kept = np.flatnonzero(meets)
    return ray[kept], mover[kept]


def _triangle_count(meshes: Sequence[Mesh]) -> int:
    return sum(len(mesh.triangles) for mesh in meshes)


def _normals(mesh: Mesh) -> Floats:
    """Unit normals (m, 3)."""
    a, b, c = (mesh.vertices[mesh.triangles[:, corner]].astype(np.float64) for corner in range(3))
    across = np.cross(b - a, c - a)
    length = np.linalg.norm(across, axis=1, keepdims=True)
    return (across / np.where(length > 0.0, length, 1.0)).astype(np.float32)


def _index_of(material: str) -> int:
    """Index of a material; -1 for what takes its actor's paint."""
    return _PAINTED if material == PAINT else _MATERIAL_INDEX[material]
