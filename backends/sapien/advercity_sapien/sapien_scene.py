"""Meshes of the world as SAPIEN's render shapes, shared wherever they can be.

The bodies of a scene: what stands still, signals, and actors with their stand-ins.
"""

from collections import defaultdict
from collections.abc import Generator, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import sapien
from numpy.typing import NDArray

from advercity.assets.body_pose import BodyShape, compute_body_pose, compute_wheel_pose
from advercity.frames import ActorState, Frame, Lamp, Signal
from advercity.geometry.mesh import Mesh, Wheel
from advercity.geometry.poses import Matrix, pose_matrix
from advercity.materials import MATERIALS
from advercity.rendering.light_sources import signal_lens_position
from advercity.semantics import Semantic
from advercity.world import SignalLamp, World
from advercity_sapien.culling import FrustumCuller
from advercity_sapien.shader_bindings import ShaderBindings

PAINT_MATERIAL = "paint"
"""Material of parts that take the actor's own."""
TWO_SIDED_CLASSES = frozenset({Semantic.VEGETATION})
"""Classes whose surfaces have two sides; SAPIEN draws only one."""
BACK_NORMAL_FACTORS = np.array([-1.0, -1.0, 1.0], dtype=np.float32)
"""Of the normal on the other side: light from above shines through leaves."""
LENS_KINDS = {
    "lamp_white": 1,
    "lamp_red": 2,
    "signal_red": 3,
    "signal_yellow": 4,
    "signal_green": 5,
    "lamp_amber_left": 6,
    "lamp_amber_right": 7,
}
"""Kinds of lens in `lenses.glsl`; like textures they travel in the materials' emission."""
SNOWLESS_MATERIALS = frozenset({"glass", "rubber", "skin", *LENS_KINDS})
"""What falling snow does not stay on; cloth, too, by its name."""
MESH_TILE_M = 80.0
LENS_RADIUS_M, LENS_CORNERS = 0.13, 16


class RenderShapeCache:
    """Makes shapes of meshes; copies of one mesh share its vertices on the device."""

    def __init__(self) -> None:
        self._materials: dict[str, sapien.render.RenderMaterial] = {}
        self._shapes: dict[tuple[int, str], sapien.render.RenderShape] = {}
        self._kept: list[Mesh] = []

    def create_shape(self, mesh: Mesh, paint: str = "") -> sapien.render.RenderShape:
        """A new shape of a mesh, of the material `paint` if it is a painted part."""
        material = paint if mesh.material == PAINT_MATERIAL else mesh.material
        key = id(mesh), material
        if key not in self._shapes:
            self._shapes[key] = self._build_shape(mesh, material)
            self._kept.append(mesh)
        return self._shapes[key].clone()

    def _build_shape(self, mesh: Mesh, material: str) -> sapien.render.RenderShapeTriangleMesh:
        vertices, triangles, normals = _with_normals(mesh)
        if mesh.semantic in TWO_SIDED_CLASSES:
            triangles = np.concatenate([triangles, triangles[:, ::-1] + len(vertices)])
            vertices = np.concatenate([vertices, vertices])
            normals = np.concatenate([normals, normals * BACK_NORMAL_FACTORS])
        return sapien.render.RenderShapeTriangleMesh(
            vertices=vertices,
            triangles=triangles.astype(np.uint32),
            normals=normals,
            uvs=np.zeros((len(vertices), 2), dtype=np.float32),
            material=self._get_material(material),
        )

    def _get_material(self, name: str) -> sapien.render.RenderMaterial:
        if name not in self._materials:
            known = MATERIALS[name]
            snowless = name in SNOWLESS_MATERIALS or name.startswith("cloth_")
            self._materials[name] = sapien.render.RenderMaterial(
                emission=[float(LENS_KINDS.get(name, 0)), known.texture, snowless, 0.0],
                base_color=[*known.albedo, 1.0],
                roughness=known.roughness,
                metallic=known.metallic,
            )
        return self._materials[name]


def split_into_tiles(mesh: Mesh) -> Iterator[Mesh]:
    """A large mesh cut along a grid: rays pass small meshes by, which halves a traced picture."""
    middles = mesh.vertices[mesh.triangles].mean(axis=1)[:, :2]
    _, tile = np.unique(np.floor(middles / MESH_TILE_M), axis=0, return_inverse=True)
    for number in range(int(tile.max(initial=-1)) + 1):
        used, triangles = np.unique(mesh.triangles[tile.ravel() == number], return_inverse=True)
        yield replace(
            mesh,
            vertices=mesh.vertices[used],
            triangles=triangles.reshape(-1, 3).astype(np.int32),
            normals=None if mesh.normals is None else mesh.normals[used],
        )


def build_signal_lenses() -> tuple[Mesh, ...]:
    """The three lenses of a signal as discs that look along x; the yellow one is the origin."""
    turn = np.arange(LENS_CORNERS) / LENS_CORNERS * 2.0 * np.pi
    disc = LENS_RADIUS_M * np.stack([np.zeros_like(turn), np.cos(turn), np.sin(turn)], axis=1)
    corners = np.arange(1, LENS_CORNERS - 1)
    fan = np.stack([np.zeros_like(corners), corners, corners + 1], axis=1).astype(np.int32)
    return tuple(
        Mesh(
            name=f"lens_{signal.name.lower()}",
            vertices=np.add(disc, signal_lens_position(signal), dtype=np.float32),
            triangles=fan,
            material=f"signal_{signal.name.lower()}",
            semantic=Semantic.TRAFFIC_LIGHT,
        )
        for signal in Signal
    )


def _with_normals(
    mesh: Mesh,
) -> tuple[NDArray[np.float32], NDArray[np.integer], NDArray[np.float32]]:
    """Vertices, triangles and normals; flat faces get three vertices of their own."""
    if mesh.normals is not None:
        return mesh.vertices, mesh.triangles, mesh.normals
    corners = mesh.vertices[mesh.triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-20)
    count = len(mesh.triangles) * 3
    return (
        corners.reshape(count, 3).astype(np.float32),
        np.arange(count).reshape(-1, 3),
        np.repeat(normal, 3, axis=0).astype(np.float32),
    )


PARKED_POSE = sapien.Pose([0.0, 0.0, -1e4])
"""Where bodies wait while nobody needs them: far below anything visible."""
FIRST_SIGNAL_BIT = 32
"""Of a body's lit lamps: red, then yellow and green; below are those of `Lamp`."""

RenderBody = sapien.render.RenderBodyComponent
ActorBodies = dict[Wheel | None, RenderBody]
"""What an actor is made of: what does not turn, and each wheel."""
Appearance = tuple[BodyShape, str]
"""A shape and the paint on it; actors of one look are the same meshes of the same materials."""


class SapienScene:
    """Puts a world on SAPIEN's stage and moves it.

    Pieces that nobody uses stand in for the next actor of their shape and paint: adding some to
    a ray-traced scene rebuilds its pipelines, and a long scenario would never stop growing.
    """

    def __init__(
        self, world: World, scene: sapien.Scene, bindings: ShaderBindings, *, night: bool
    ) -> None:
        self.segmentation = SegmentationTable()
        self._world = world
        self._scene = scene
        self._bindings = bindings
        self._shapes = RenderShapeCache()
        self._actors: dict[int, tuple[Appearance, ActorBodies]] = {}
        self._lamp_bits: dict[int, int] = {}
        self._spare_bodies: defaultdict[Appearance, list[ActorBodies]] = defaultdict(list)
        self._meshes: dict[BodyShape, dict[Wheel | None, list[Mesh]]] = {}
        self.culler = FrustumCuller()
        for tile in (tile for mesh in world.static for tile in split_into_tiles(mesh)):
            self._add_static(tile, int(Lamp.LOW_BEAM) if night else 0)
        self._signals = {lamp.id: self._add_signal(lamp) for lamp in world.signal_lamps}

    def place_actors(self, frame: Frame) -> None:
        """Move every actor to where it is in `frame`, and switch lamps and signals."""
        seen = {
            state.actor.id: compute_body_pose(state, self._world.bodies) for state in frame.states
        }
        looks = {s.actor.id: (seen[s.actor.id].shape, s.actor.paint) for s in frame.states}
        for actor_id in [i for i, (look, _) in self._actors.items() if looks.get(i) != look]:
            look, pieces = self._actors.pop(actor_id)
            for body in pieces.values():
                self._set_pose(body, PARKED_POSE)
            self._spare_bodies[look].append(pieces)
        for state in frame.states:
            pieces = self._acquire_bodies(state.actor.id, looks[state.actor.id])
            self._move_bodies(
                pieces, state, state.world_from_body @ seen[state.actor.id].body_from_mesh
            )
            self._lamp_bits[state.actor.id] = int(state.lamps)
            self._set_state(state.actor.id, hidden=False)
        for name, body in self._signals.items():
            self._bindings.set_body_state(
                body, FIRST_SIGNAL_BIT << frame.signals[name], hidden=False
            )

    @contextmanager
    def hide_actors(self, actor_ids: Iterable[int]) -> Generator[None, None, None]:
        """Hide actors from cameras; they still cast their shadows."""
        hidden = [actor_id for actor_id in actor_ids if actor_id in self._actors]
        for actor_id in hidden:
            self._set_state(actor_id, hidden=True)
        try:
            yield
        finally:
            for actor_id in hidden:
                self._set_state(actor_id, hidden=False)

    def _move_bodies(self, pieces: ActorBodies, state: ActorState, world_from_mesh: Matrix) -> None:
        for wheel, body in pieces.items():
            moved = (
                world_from_mesh
                if wheel is None
                else world_from_mesh @ compute_wheel_pose(state, wheel)
            )
            self._set_pose(body, sapien.Pose(moved))

    def _set_state(self, actor_id: int, *, hidden: bool) -> None:
        for body in self._actors[actor_id][1].values():
            self._bindings.set_body_state(body, self._lamp_bits[actor_id], hidden=hidden)

    def _acquire_bodies(self, actor_id: int, look: Appearance) -> ActorBodies:
        if actor_id not in self._actors:
            meshes, idle = self._group_meshes(look[0]), self._spare_bodies[look]
            pieces = (
                idle.pop()
                if idle
                else {key: self._add_moving(own, look[1]) for key, own in meshes.items()}
            )
            for wheel, body in pieces.items():
                self._label_shapes(body, meshes[wheel], actor_id)
            self._actors[actor_id] = look, pieces
        return self._actors[actor_id][1]

    def _group_meshes(self, shape: BodyShape) -> dict[Wheel | None, list[Mesh]]:
        """The meshes of a shape, always the same ones: copies on the device are found by them."""
        if shape not in self._meshes:
            parts: defaultdict[Wheel | None, list[Mesh]] = defaultdict(list)
            for mesh in shape.build_meshes(self._world.bodies):
                parts[mesh.wheel].append(mesh)
            self._meshes[shape] = dict(parts)
        return self._meshes[shape]

    def _set_pose(self, body: RenderBody, pose: sapien.Pose) -> None:
        body.entity.set_pose(pose)
        self.culler.move_body(body, pose.p)

    def _add_static(self, mesh: Mesh, lit: int) -> None:
        body = self._add([mesh])
        self._label_shapes(body, [mesh], 0)
        self._bindings.set_body_state(body, lit, hidden=False)
        self.culler.add_body(body, mesh.vertices.min(axis=0), mesh.vertices.max(axis=0))

    def _add_moving(self, meshes: Sequence[Mesh], paint: str) -> RenderBody:
        body = self._add(meshes, paint)
        reach_m = max(float(np.linalg.norm(mesh.vertices, axis=1).max()) for mesh in meshes)
        self.culler.add_body(body, np.full(3, -reach_m), np.full(3, reach_m))
        return body

    def _add_signal(self, lamp: SignalLamp) -> RenderBody:
        meshes = build_signal_lenses()
        body = self._add(meshes)
        self._label_shapes(body, meshes, 0)
        body.entity.set_pose(sapien.Pose(_signal_pose(lamp)))
        return body

    def _add(self, meshes: Iterable[Mesh], paint: str = "") -> RenderBody:
        body = RenderBody()
        for mesh in meshes:
            body.attach(self._shapes.create_shape(mesh, paint))
        entity = sapien.Entity()
        entity.add_component(body)
        self._scene.add_entity(entity)
        return body

    def _label_shapes(self, body: RenderBody, meshes: Iterable[Mesh], actor_id: int) -> None:
        for shape, mesh in zip(body.render_shapes, meshes, strict=True):
            self.segmentation.assign(shape.per_scene_id, mesh.semantic, actor_id)


class SegmentationTable:
    """What each of SAPIEN's shape ids stands for; id 0 is the sky."""

    def __init__(self) -> None:
        self._semantic = np.full(64, Semantic.SKY, dtype=np.uint8)
        self._actor = np.zeros(64, dtype=np.int32)

    def assign(self, shape_id: int, semantic: Semantic, actor_id: int) -> None:
        """Remember a shape, or whom it belongs to now."""
        if shape_id >= len(self._actor):
            room = (0, max(shape_id + 1 - len(self._actor), len(self._actor)))
            self._semantic, self._actor = np.pad(self._semantic, room), np.pad(self._actor, room)
        self._semantic[shape_id] = semantic
        self._actor[shape_id] = actor_id

    def look_up(self, ids: NDArray[np.uint32]) -> tuple[NDArray[np.uint8], NDArray[np.int32]]:
        """Semantic class and actor of each pixel of a picture (h, w) of shape ids."""
        return self._semantic[ids], self._actor[ids]


def _signal_pose(lamp: SignalLamp) -> Matrix:
    return pose_matrix(lamp.position, yaw=float(np.arctan2(lamp.facing[1], lamp.facing[0])))
