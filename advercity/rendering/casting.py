"""Rays against the world's own meshes and the bodies that move on it, by Embree.

Embree works in float32: hits are good to a tenth of a millimetre within a kilometre of the
world's origin.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from advercity.poses import transform
from advercity.traffic.trace import ActorState, Frame
from advercity.world.materials import MATERIALS, PAINT
from advercity.world.scene import Mesh, World

MATERIAL_NAMES = tuple(MATERIALS)
"""Name of a material by its index in `Hits.material`."""
_STEP_PAST_M = 1e-3
_MATERIAL_INDEX = {name: index for index, name in enumerate(MATERIAL_NAMES)}


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

    range_m: NDArray[np.float32]
    normal: NDArray[np.float32]
    cosine: NDArray[np.float32]
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

    def put(self, where: NDArray[np.intp], other: "Hits") -> None:
        """Write the rows of `other` over the rows `where`."""
        for item in fields(self):
            getattr(self, item.name)[where] = getattr(other, item.name)


class Caster:
    """Casts rays into a world; its static part is built once, its movers once per frame."""

    def __init__(self, world: World) -> None:
        self._bodies = {name: _Soup.of_meshes(body.parts) for name, body in world.bodies.items()}
        self._static = _Scene(_Soup.of_meshes(world.static))
        self._movers = _Scene(_Soup.of_meshes(()))
        self._frame: Frame | None = None
        self._hide = np.empty(0, np.int32)

    def place(self, frame: Frame, hide: frozenset[int] = frozenset()) -> None:
        """Move every actor to where it is in `frame`; rays pass through those in `hide`.

        Placing the same frame again with others to hide costs nothing.
        """
        if frame is not self._frame:
            self._movers = _Scene(_Soup.joined(self._mover(state) for state in frame.states))
            self._frame = frame
        self._hide = np.array(sorted(hide), np.int32)

    def cast(
        self,
        origins: NDArray[np.float64],
        directions: NDArray[np.float64],
        max_range_m: float,
    ) -> Hits:
        """The nearest hit of every ray.

        Args:
            origins: (n, 3) world frame, metres.
            directions: (n, 3) unit vectors, world frame.
            max_range_m: Surfaces beyond are missed.
        """
        limits = np.full(len(origins), max_range_m, np.float32)
        hits = self._static.cast(origins, directions, limits)
        limits = np.minimum(hits.range_m, limits)
        nearer = self._cast_movers(origins, directions, limits)
        where = np.flatnonzero(nearer.range_m < limits)
        hits.put(where, _rows(nearer, where))
        return hits

    def _cast_movers(
        self,
        origins: NDArray[np.float64],
        directions: NDArray[np.float64],
        limits: NDArray[np.float32],
    ) -> Hits:
        """First hit of a mover that is not hidden: behind a hidden surface the ray goes on."""
        hits = self._movers.cast(origins, directions, limits)
        hidden = np.flatnonzero(np.isin(hits.instance, self._hide))
        while len(hidden):
            passed = hits.range_m[hidden] + np.float32(_STEP_PAST_M)
            onward = self._movers.cast(
                origins[hidden] + passed[:, None] * directions[hidden],
                directions[hidden],
                np.maximum(limits[hidden] - passed, 0.0),
            )
            onward.range_m[:] += passed
            hits.put(hidden, onward)
            hidden = hidden[np.isin(onward.instance, self._hide)]
        return hits

    def _mover(self, state: ActorState) -> "_Soup":
        body = self._bodies[state.actor.blueprint]
        return _Soup(
            vertices=transform(state.world_from_body, body.vertices).astype(np.float32),
            triangles=body.triangles,
            material=np.where(body.material < 0, _index_of(state.actor.paint), body.material),
            semantic=body.semantic,
            instance=np.full(len(body.triangles), state.actor.id, np.int32),
        )


@dataclass(frozen=True, eq=False)
class _Soup:
    """Triangles with what they are: material, semantic and instance per triangle."""

    vertices: NDArray[np.float32]
    triangles: NDArray[np.int32]
    material: NDArray[np.int16]
    semantic: NDArray[np.uint8]
    instance: NDArray[np.int32]

    @staticmethod
    def of_meshes(meshes: Sequence[Mesh]) -> "_Soup":
        return _Soup.joined(
            _Soup(
                vertices=mesh.vertices,
                triangles=mesh.triangles,
                material=np.full(len(mesh.triangles), _index_of(mesh.material), np.int16),
                semantic=np.full(len(mesh.triangles), mesh.semantic, np.uint8),
                instance=np.zeros(len(mesh.triangles), np.int32),
            )
            for mesh in meshes
        )

    @staticmethod
    def joined(soups: "Iterable[_Soup]") -> "_Soup":
        parts = [_NOTHING, *soups]
        firsts = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
        return _Soup(
            vertices=np.concatenate([part.vertices for part in parts]),
            triangles=np.concatenate(
                [
                    part.triangles + np.int32(first)
                    for part, first in zip(parts, firsts, strict=True)
                ]
            ),
            material=np.concatenate([part.material for part in parts]),
            semantic=np.concatenate([part.semantic for part in parts]),
            instance=np.concatenate([part.instance for part in parts]),
        )


_NOTHING = _Soup(
    vertices=np.empty((0, 3), np.float32),
    triangles=np.empty((0, 3), np.int32),
    material=np.empty(0, np.int16),
    semantic=np.empty(0, np.uint8),
    instance=np.empty(0, np.int32),
)


class _Scene:
    """A soup in Embree's hands."""

    def __init__(self, soup: _Soup) -> None:
        self._soup = soup
        self._scene: Any = EmbreeScene(robust=True)
        if len(soup.triangles):
            TriangleMesh(self._scene, soup.vertices, soup.triangles)

    def cast(
        self,
        origins: NDArray[np.float64],
        directions: NDArray[np.float64],
        limits: NDArray[np.float32],
    ) -> Hits:
        hits = Hits.misses(len(origins))
        if not len(self._soup.triangles) or not len(origins):
            return hits
        rays = np.ascontiguousarray(directions, np.float32)
        found: dict[str, NDArray[Any]] = self._scene.run(
            np.ascontiguousarray(origins, np.float32),
            rays,
            limits.copy(),  # Embree writes what it found over it
            output=True,
        )
        hit = np.flatnonzero(found["primID"] >= 0)
        triangle = found["primID"][hit]
        normal = found["Ng"][hit]
        normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
        cosine = -np.einsum("ij,ij->i", normal, rays[hit])
        hits.put(
            hit,
            Hits(
                range_m=found["tfar"][hit],
                normal=normal * np.sign(cosine)[:, None],
                cosine=np.abs(cosine),
                material=self._soup.material[triangle],
                semantic=self._soup.semantic[triangle],
                instance=self._soup.instance[triangle],
            ),
        )
        return hits


def _rows(hits: Hits, where: NDArray[np.intp]) -> Hits:
    return Hits(*(getattr(hits, item.name)[where] for item in fields(hits)))


def _index_of(material: str) -> int:
    """Index of a material; -1 for what takes its actor's paint."""
    return -1 if material == PAINT else _MATERIAL_INDEX[material]
