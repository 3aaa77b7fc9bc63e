"""The bodies of a scene: what stands still, signals, and actors with their stand-ins."""

from collections import defaultdict
from collections.abc import Generator, Iterable, Sequence
from contextlib import contextmanager

import numpy as np
import sapien
from numpy.typing import NDArray

from advercity.poses import Matrix, pose
from advercity.semantics import Semantic
from advercity.traffic.posture import Shape, posture, rolled
from advercity.traffic.trace import ActorState, Frame, Lamp
from advercity.world.scene import Mesh, SignalLamp, Wheel, World
from advercity_sapien.bindings import Bindings
from advercity_sapien.culling import Culling
from advercity_sapien.shapes import ShapeLibrary, lenses, tiles

PARKED = sapien.Pose([0.0, 0.0, -1e4])
"""Where bodies wait while nobody needs them: far below anything visible."""
FIRST_SIGNAL_BIT = 32
"""Of a body's lit lamps: red, then yellow and green; below are those of `Lamp`."""

Body = sapien.render.RenderBodyComponent
Pieces = dict[Wheel | None, Body]
"""What an actor is made of: what does not turn, and each wheel."""
Look = tuple[Shape, str]
"""A shape and the paint on it; actors of one look are the same meshes of the same materials."""


class Stage:
    """Puts a world on SAPIEN's stage and moves it.

    Pieces that nobody uses stand in for the next actor of their shape and paint: adding some to
    a ray-traced scene rebuilds its pipelines, and a long scenario would never stop growing.
    """

    def __init__(
        self, world: World, scene: sapien.Scene, bindings: Bindings, *, night: bool
    ) -> None:
        self.identities = Identities()
        self._world = world
        self._scene = scene
        self._bindings = bindings
        self._shapes = ShapeLibrary()
        self._actors: dict[int, tuple[Look, Pieces]] = {}
        self._lit: dict[int, int] = {}
        self._idle: defaultdict[Look, list[Pieces]] = defaultdict(list)
        self._meshes: dict[Shape, dict[Wheel | None, list[Mesh]]] = {}
        self.culling = Culling()
        for tile in (tile for mesh in world.static for tile in tiles(mesh)):
            self._add_static(tile, int(Lamp.LOW_BEAM) if night else 0)
        self._signals = {lamp.id: self._add_signal(lamp) for lamp in world.signal_lamps}

    def place(self, frame: Frame) -> None:
        """Move every actor to where it is in `frame`, and switch lamps and signals."""
        seen = {state.actor.id: posture(state, self._world.bodies) for state in frame.states}
        looks = {s.actor.id: (seen[s.actor.id].shape, s.actor.paint) for s in frame.states}
        for actor_id in [i for i, (look, _) in self._actors.items() if looks.get(i) != look]:
            look, pieces = self._actors.pop(actor_id)
            for body in pieces.values():
                self._put(body, PARKED)
            self._idle[look].append(pieces)
        for state in frame.states:
            pieces = self._pieces_of(state.actor.id, looks[state.actor.id])
            self._move(pieces, state, state.world_from_body @ seen[state.actor.id].body_from_mesh)
            self._lit[state.actor.id] = int(state.lamps)
            self._mark(state.actor.id, hidden=False)
        for name, body in self._signals.items():
            self._bindings.mark(body, FIRST_SIGNAL_BIT << frame.signals[name], hidden=False)

    @contextmanager
    def without(self, actor_ids: Iterable[int]) -> Generator[None, None, None]:
        """Hide actors from cameras; they still cast their shadows."""
        hidden = [actor_id for actor_id in actor_ids if actor_id in self._actors]
        for actor_id in hidden:
            self._mark(actor_id, hidden=True)
        try:
            yield
        finally:
            for actor_id in hidden:
                self._mark(actor_id, hidden=False)

    def _move(self, pieces: Pieces, state: ActorState, world_from_mesh: Matrix) -> None:
        for wheel, body in pieces.items():
            moved = world_from_mesh if wheel is None else world_from_mesh @ rolled(state, wheel)
            self._put(body, sapien.Pose(moved))

    def _mark(self, actor_id: int, *, hidden: bool) -> None:
        for body in self._actors[actor_id][1].values():
            self._bindings.mark(body, self._lit[actor_id], hidden=hidden)

    def _pieces_of(self, actor_id: int, look: Look) -> Pieces:
        if actor_id not in self._actors:
            meshes, idle = self._parts(look[0]), self._idle[look]
            pieces = (
                idle.pop()
                if idle
                else {key: self._add_moving(own, look[1]) for key, own in meshes.items()}
            )
            for wheel, body in pieces.items():
                self._identify(body, meshes[wheel], actor_id)
            self._actors[actor_id] = look, pieces
        return self._actors[actor_id][1]

    def _parts(self, shape: Shape) -> dict[Wheel | None, list[Mesh]]:
        """The meshes of a shape, always the same ones: copies on the device are found by them."""
        if shape not in self._meshes:
            parts: defaultdict[Wheel | None, list[Mesh]] = defaultdict(list)
            for mesh in shape.meshes(self._world.bodies):
                parts[mesh.wheel].append(mesh)
            self._meshes[shape] = dict(parts)
        return self._meshes[shape]

    def _put(self, body: Body, pose: sapien.Pose) -> None:
        body.entity.set_pose(pose)
        self.culling.move(body, pose.p)

    def _add_static(self, mesh: Mesh, lit: int) -> None:
        body = self._add([mesh])
        self._identify(body, [mesh], 0)
        self._bindings.mark(body, lit, hidden=False)
        self.culling.add(body, mesh.vertices.min(axis=0), mesh.vertices.max(axis=0))

    def _add_moving(self, meshes: Sequence[Mesh], paint: str) -> Body:
        body = self._add(meshes, paint)
        reach_m = max(float(np.linalg.norm(mesh.vertices, axis=1).max()) for mesh in meshes)
        self.culling.add(body, np.full(3, -reach_m), np.full(3, reach_m))
        return body

    def _add_signal(self, lamp: SignalLamp) -> Body:
        meshes = lenses()
        body = self._add(meshes)
        self._identify(body, meshes, 0)
        body.entity.set_pose(sapien.Pose(_pose_of(lamp)))
        return body

    def _add(self, meshes: Iterable[Mesh], paint: str = "") -> Body:
        body = Body()
        for mesh in meshes:
            body.attach(self._shapes.of_mesh(mesh, paint))
        entity = sapien.Entity()
        entity.add_component(body)
        self._scene.add_entity(entity)
        return body

    def _identify(self, body: Body, meshes: Iterable[Mesh], actor_id: int) -> None:
        for shape, mesh in zip(body.render_shapes, meshes, strict=True):
            self.identities.learn(shape.per_scene_id, mesh.semantic, actor_id)


class Identities:
    """What each of SAPIEN's shape ids stands for; id 0 is the sky."""

    def __init__(self) -> None:
        self._semantic = np.full(64, Semantic.SKY, dtype=np.uint8)
        self._actor = np.zeros(64, dtype=np.int32)

    def learn(self, shape_id: int, semantic: Semantic, actor_id: int) -> None:
        """Remember a shape, or whom it belongs to now."""
        if shape_id >= len(self._actor):
            room = (0, max(shape_id + 1 - len(self._actor), len(self._actor)))
            self._semantic, self._actor = np.pad(self._semantic, room), np.pad(self._actor, room)
        self._semantic[shape_id] = semantic
        self._actor[shape_id] = actor_id

    def read(self, ids: NDArray[np.uint32]) -> tuple[NDArray[np.uint8], NDArray[np.int32]]:
        """Semantic class and actor of each pixel of a picture (h, w) of shape ids."""
        return self._semantic[ids], self._actor[ids]


def _pose_of(lamp: SignalLamp) -> Matrix:
    return pose(lamp.position, yaw=float(np.arctan2(lamp.facing[1], lamp.facing[0])))
