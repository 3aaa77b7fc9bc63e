"""Puts a world into a SAPIEN scene and moves it: static meshes, signals and actors."""

from collections import defaultdict
from collections.abc import Collection, Generator, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import Literal

import numpy as np
import sapien
from numpy.typing import NDArray

from advercity.assets.body_pose import BodyShape, compute_body_pose, compute_wheel_pose
from advercity.frames import ActorState, Frame, Lamp
from advercity.geometry.mesh import Mesh, MeshLayer, Wheel
from advercity.geometry.poses import Matrix, pose_matrix
from advercity.materials import MATERIALS
from advercity.rendering.lamp_lenses import LENS_KINDS, build_signal_lenses, is_snowless
from advercity.rendering.panes import PANE_MATERIALS, is_seen_through
from advercity.semantics import Semantic
from advercity.world import SignalLamp, World
from advercity_sapien.culling import ANY_PIXEL, FrustumCuller, PixelRange
from advercity_sapien.leaf_levels import LEAF_MATERIALS, list_levels, thin_out
from advercity_sapien.material_textures import MapAxes, MaterialTextures
from advercity_sapien.shader_bindings import RenderBody, ShaderBindings
from advercity_sapien.shader_constants import (
    FIRST_SIGNAL_BIT,
    LIGHT_RATIO_BIT,
    LIGHT_RATIO_STEPS,
)

PAINT_MATERIAL = "paint"
"""Material of the parts with their actor's paint."""
TWO_SIDED_CLASSES = frozenset({Semantic.VEGETATION})
"""Classes whose surfaces are seen from both sides; SAPIEN draws the front of triangles alone."""
MESH_TILE_M, LEAF_TILE_M = 80.0, 32.0
"""Size of the pieces of static meshes; pieces of leaves get coarser with their distance."""
MAX_TILE_ROWS = 2**20
"""More than any world has."""
PARKED_POSE = sapien.Pose([0.0, 0.0, -1e4])
"""Pose of spare bodies: far below anything visible."""

Piece = Wheel | Literal["details", "panes", "distant panes"] | None
"""Parts of an actor with a body of their own; None is its shape without wheels and panes."""
DETAIL_PIXEL_M = 0.15
"""Size of a pixel up to which raster images have details and windows to look through."""
PIECE_PIXELS_M: dict[Piece, PixelRange] = {
    "details": (0.0, DETAIL_PIXEL_M),
    "panes": (0.0, DETAIL_PIXEL_M),
    "distant panes": (DETAIL_PIXEL_M, np.inf),
}
GLASS_SHADING_MODE = 1
"""SAPIEN's number of the pass for panes, after everything behind them."""
GLASS_ALPHA = 0.5
"""Opacity marking transparent panes for ray-traced shaders."""
ActorBodies = dict[Piece, RenderBody]
Appearance = tuple[BodyShape, str]
"""A shape and its paint; actors of one appearance have the same meshes and materials."""


class RenderShapeCache:
    """Makes render shapes of meshes; copies of one mesh use the same vertices on the device."""

    def __init__(self, textures: MaterialTextures) -> None:
        self._textures = textures
        self._materials: dict[
            tuple[str, str, MapAxes | None, bool], sapien.render.RenderMaterial
        ] = {}
        self._shapes: dict[Mesh, dict[tuple[str, bool], sapien.render.RenderShape]] = {}

    def create_shape(
        self, mesh: Mesh, paint: str = "", *, is_closed: bool = False
    ) -> sapien.render.RenderShape:
        """Create a shape of a mesh shared with other bodies; closed panes are opaque."""
        known = self._shapes.setdefault(mesh, {})
        key = paint if mesh.material == PAINT_MATERIAL else mesh.material, is_closed
        if key not in known:
            is_pane = not is_closed and is_seen_through(mesh, is_static=False)
            known[key] = self._create_shape(mesh, paint, None, is_pane=is_pane)
        return known[key].clone()

    def keep_only(self, meshes: Collection[Mesh]) -> None:
        """Free the shapes of all but some meshes; bodies keep theirs."""
        self._shapes = {mesh: made for mesh, made in self._shapes.items() if mesh in meshes}

    def create_static_shape(self, mesh: Mesh) -> sapien.render.RenderShape:
        """Create a shape of a static mesh, which is not kept."""
        is_pane = is_seen_through(mesh, is_static=True)
        return self._create_shape(mesh, "", MapAxes.WORLD, is_pane=is_pane)

    def _create_shape(
        self, mesh: Mesh, paint: str, axes: MapAxes | None, *, is_pane: bool
    ) -> sapien.render.RenderShape:
        """Create a shape; a painted part gets the material `paint`."""
        own_axes = axes if mesh.uv is None else MapAxes.MESH
        name = paint if mesh.material == PAINT_MATERIAL else mesh.material
        material = self._get_material(name, mesh.maps, own_axes, is_pane=is_pane)
        vertices, triangles, normals, uv = _with_normals(mesh)
        if mesh.semantic in TWO_SIDED_CLASSES or mesh.material in LEAF_MATERIALS:
            triangles = np.concatenate([triangles, triangles[:, ::-1]])
        return sapien.render.RenderShapeTriangleMesh(
            vertices=vertices,
            triangles=triangles.astype(np.uint32),
            normals=normals,
            uvs=uv,
            material=material,
        )

    def _get_material(
        self, name: str, own_maps: str, axes: MapAxes | None, *, is_pane: bool
    ) -> sapien.render.RenderMaterial:
        key = name, own_maps, axes, is_pane
        if key not in self._materials:
            known = MATERIALS[name]
            # Emission is free to carry data for the shaders, which compute it from lens and lamps.
            material = sapien.render.RenderMaterial(
                emission=[float(LENS_KINDS.get(name, 0)), known.texture, is_snowless(name), 0.0],
                base_color=[*known.albedo, GLASS_ALPHA if is_pane else 1.0],
                roughness=known.roughness,
                metallic=known.metallic,
            )
            if axes is not None:
                self._textures.apply(own_maps or known.maps, material, axes)
            self._materials[key] = material
        return self._materials[key]


def split_into_tiles(mesh: Mesh) -> Iterator[NDArray[np.int32] | None]:
    """Cut a mesh along a grid: rays skip small meshes, which halves the time of tracing.

    Yields:
        Rows of the triangles of each tile; None if all are in one.
    """
    size_m = LEAF_TILE_M if mesh.material in LEAF_MATERIALS else MESH_TILE_M
    middles = mesh.vertices[mesh.triangles].mean(axis=1)[:, :2]
    column, row = np.floor(middles / size_m).astype(np.int64).T
    tile = column * MAX_TILE_ROWS + row
    if len(tile) > 0 and (tile == tile[0]).all():
        yield None
        return
    order = np.argsort(tile, kind="stable").astype(np.int32)
    # Copies, or one kept tile would keep the rows of all.
    parts = np.split(order, np.flatnonzero(np.diff(tile[order])) + 1)
    yield from (part.copy() for part in parts if len(part))


def cut_tile(mesh: Mesh, rows: NDArray[np.int32] | None) -> Mesh:
    """Cut the triangles of a tile out of a mesh."""
    if rows is None:
        return mesh
    used, triangles = np.unique(mesh.triangles[rows], return_inverse=True)
    return replace(
        mesh,
        vertices=mesh.vertices[used],
        triangles=triangles.reshape(-1, 3).astype(np.int32),
        normals=None if mesh.normals is None else mesh.normals[used],
        uv=None if mesh.uv is None else mesh.uv[used],
    )


def _with_normals(
    mesh: Mesh,
) -> tuple[NDArray[np.float32], NDArray[np.integer], NDArray[np.float32], NDArray[np.float32]]:
    """Get vertices, triangles, normals and texture coordinates, 0 where the mesh has none.

    Flat faces get three vertices of their own.
    """
    uv = np.zeros((len(mesh.vertices), 2), np.float32) if mesh.uv is None else mesh.uv
    if mesh.normals is not None:
        return mesh.vertices, mesh.triangles, mesh.normals, uv
    corners = mesh.vertices[mesh.triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-20)
    count = len(mesh.triangles) * 3
    return (
        corners.reshape(count, 3).astype(np.float32),
        np.arange(count).reshape(-1, 3),
        np.repeat(normal, 3, axis=0).astype(np.float32),
        uv[mesh.triangles].reshape(count, 2),
    )


class SapienScene:
    """The bodies of a world in a SAPIEN scene.

    Bodies of departed actors are used for the next of their appearance: adding bodies to a
    ray-traced scene rebuilds its pipelines, and it has room for a limited number. In a raster scene
    unused poses are freed: people have more than fit in memory, and seldom return to one soon.

    Attributes:
        segmentation: Classes and actors by SAPIEN's shape ids.
        culler: Bounding boxes of all bodies.

    Args:
        finest_m: Width of the finest visible detail on a surface.
    """

    def __init__(
        self,
        world: World,
        scene: sapien.Scene,
        bindings: ShaderBindings,
        *,
        night: bool,
        finest_m: float = 0.0,
        has_distant_pieces: bool = True,
        frees_poses: bool = True,
    ) -> None:
        self.segmentation = SegmentationTable()
        self.culler = FrustumCuller()
        self._world = world
        self._scene = scene
        self._bindings = bindings
        self._has_distant_pieces, self._frees_poses = has_distant_pieces, frees_poses
        self._shapes = RenderShapeCache(MaterialTextures(world.material_maps, finest_m))
        self._actors: dict[int, tuple[Appearance, ActorBodies]] = {}
        self._spare_bodies: defaultdict[Appearance, list[ActorBodies]] = defaultdict(list)
        self._meshes: dict[BodyShape, dict[Piece, list[Mesh]]] = {}
        lit = int(Lamp.LOW_BEAM) if night else 0
        for number, mesh in enumerate(world.static, start=1):
            for rows in split_into_tiles(mesh):
                self._add_tile(number, mesh, rows, lit)
        self._signals = [(lamp.id, self._add_signal(lamp)) for lamp in world.signal_lamps]

    def place_actors(self, frame: Frame) -> None:
        """Move every actor to its pose in `frame`, and switch lamps and signals."""
        poses = {
            state.actor.id: compute_body_pose(state, self._world.bodies) for state in frame.states
        }
        appearances = {s.actor.id: (poses[s.actor.id].shape, s.actor.paint) for s in frame.states}
        for actor_id, (appearance, bodies) in list(self._actors.items()):
            if appearances.get(actor_id) != appearance:
                del self._actors[actor_id]
                for body in bodies.values():
                    self._set_pose(body, PARKED_POSE)
                self._spare_bodies[appearance].append(bodies)
        for state in frame.states:
            bodies = self._acquire_bodies(state.actor.id, appearances[state.actor.id])
            world_from_mesh = state.world_from_body @ poses[state.actor.id].body_from_mesh
            self._move_bodies(bodies, state, world_from_mesh)
            lit = int(state.lamps) | _pack_light_ratio(state.tail_light_ratio)
            for body in bodies.values():
                self._bindings.set_lit_lamps(body, lit)
        if self._frees_poses:
            self._free_spare_poses()
        for name, body in self._signals:
            ratio = frame.signal_light_ratios.get(name, 1.0)
            lit = FIRST_SIGNAL_BIT << frame.signals[name] | _pack_light_ratio(ratio)
            self._bindings.set_lit_lamps(body, lit)

    def _free_spare_poses(self) -> None:
        for appearance in [item for item in self._spare_bodies if item[0].pose_index is not None]:
            for bodies in self._spare_bodies.pop(appearance):
                for body in bodies.values():
                    self.culler.remove_body(body)
                    self._scene.remove_entity(body.entity)
        shown = {shape for (shape, _), _ in self._actors.values()}
        self._meshes = {
            shape: pieces
            for shape, pieces in self._meshes.items()
            if shape.pose_index is None or shape in shown
        }
        groups = [meshes for pieces in self._meshes.values() for meshes in pieces.values()]
        self._shapes.keep_only({mesh for meshes in groups for mesh in meshes})

    @contextmanager
    def hide_actors(self, actor_ids: Iterable[int]) -> Generator[None, None, None]:
        """Hide actors from cameras for the time of a block; they still cast shadows."""
        present = [self._actors[number][1] for number in actor_ids if number in self._actors]
        hidden = [body for bodies in present for body in bodies.values()]
        for body in hidden:
            self._bindings.set_hidden(body, hidden=True)
        try:
            yield
        finally:
            for body in hidden:
                self._bindings.set_hidden(body, hidden=False)

    def _move_bodies(self, bodies: ActorBodies, state: ActorState, world_from_mesh: Matrix) -> None:
        for piece, body in bodies.items():
            moved = world_from_mesh
            if isinstance(piece, Wheel):
                moved = world_from_mesh @ compute_wheel_pose(state, piece)
            self._set_pose(body, sapien.Pose(moved))

    def _acquire_bodies(self, actor_id: int, appearance: Appearance) -> ActorBodies:
        if actor_id not in self._actors:
            meshes, spare = self._group_meshes(appearance[0]), self._spare_bodies[appearance]
            bodies: ActorBodies = (
                spare.pop()
                if spare
                else {key: self._add_piece(key, own, appearance[1]) for key, own in meshes.items()}
            )
            for piece, body in bodies.items():
                self._label_shapes(body, meshes[piece], actor_id)
            self._actors[actor_id] = appearance, bodies
        return self._actors[actor_id][1]

    def _group_meshes(self, shape: BodyShape) -> dict[Piece, list[Mesh]]:
        """Group the meshes of a shape by piece; always the same objects, as the cache needs."""
        if shape not in self._meshes:
            parts: defaultdict[Piece, list[Mesh]] = defaultdict(list)
            for mesh in shape.build_meshes(self._world.bodies):
                for piece in self._list_pieces(mesh):
                    parts[piece].append(mesh)
            self._meshes[shape] = dict(parts)
        return self._meshes[shape]

    def _list_pieces(self, mesh: Mesh) -> tuple[Piece, ...]:
        if mesh.material in PANE_MATERIALS:
            return ("panes", "distant panes") if self._has_distant_pieces else ("panes",)
        return ("details",) if mesh.layer is not MeshLayer.SHAPE else (mesh.wheel,)

    def _set_pose(self, body: RenderBody, pose: sapien.Pose) -> None:
        body.entity.set_pose(pose)
        self.culler.move_body(body, pose.p)

    def _add_tile(self, number: int, mesh: Mesh, rows: NDArray[np.int32] | None, lit: int) -> None:
        """Add a tile of a static mesh; levels of detail are cut out once they are seen."""
        tile = cut_tile(mesh, rows)
        low, high = tile.vertices.min(axis=0), tile.vertices.max(axis=0)
        levels = list_levels(tile) if self._has_distant_pieces else [(1, ANY_PIXEL)]
        for keep_one_of, pixel_m in levels:
            if pixel_m == ANY_PIXEL:
                self.culler.add_body(self._add_static(number, tile, lit), low, high)
            else:
                make = partial(self._add_level, number, mesh, rows, lit, keep_one_of)
                self.culler.add_later(make, low, high, pixel_m=pixel_m)

    def _add_level(
        self, number: int, mesh: Mesh, rows: NDArray[np.int32] | None, lit: int, keep_one_of: int
    ) -> RenderBody:
        return self._add_static(number, thin_out(cut_tile(mesh, rows), keep_one_of), lit)

    def _add_static(self, number: int, mesh: Mesh, lit: int) -> RenderBody:
        body = self._add([self._shapes.create_static_shape(mesh)])
        if is_seen_through(mesh, is_static=True):
            body.shading_mode = GLASS_SHADING_MODE
        self._bindings.set_static_mesh(body, number)
        self._label_shapes(body, [mesh], 0)
        self._bindings.set_lit_lamps(body, lit)
        return body

    def _add_piece(self, piece: Piece, meshes: Sequence[Mesh], paint: str) -> RenderBody:
        is_closed = piece == "distant panes"
        body = self._add(
            [self._shapes.create_shape(mesh, paint, is_closed=is_closed) for mesh in meshes]
        )
        if piece == "panes":
            body.shading_mode = GLASS_SHADING_MODE
        # A cube around the sphere of all vertices fits in any orientation.
        radius = max(float(np.linalg.norm(mesh.vertices, axis=1).max()) for mesh in meshes)
        pixel_m = PIECE_PIXELS_M.get(piece, ANY_PIXEL)
        self.culler.add_body(body, np.full(3, -radius), np.full(3, radius), pixel_m=pixel_m)
        return body

    def _add_signal(self, lamp: SignalLamp) -> RenderBody:
        meshes = build_signal_lenses(lamp.governs)
        body = self._add([self._shapes.create_shape(mesh) for mesh in meshes])
        self._label_shapes(body, meshes, 0)
        yaw = float(np.arctan2(lamp.facing[1], lamp.facing[0]))
        body.entity.set_pose(sapien.Pose(pose_matrix(lamp.position, yaw=yaw)))
        return body

    def _add(self, shapes: Iterable[sapien.render.RenderShape]) -> RenderBody:
        body = RenderBody()
        for shape in shapes:
            body.attach(shape)
        entity = sapien.Entity()
        entity.add_component(body)
        self._scene.add_entity(entity)
        # SAPIEN leaves unset properties uninitialised.
        self._bindings.set_hidden(body, hidden=False)
        self._bindings.set_static_mesh(body, 0)
        return body

    def _label_shapes(self, body: RenderBody, meshes: Iterable[Mesh], actor_id: int) -> None:
        for shape, mesh in zip(body.render_shapes, meshes, strict=True):
            self.segmentation.assign(shape.per_scene_id, mesh.semantic, actor_id)


def _pack_light_ratio(ratio: float) -> int:
    """Pack the light of flickering lamps, relative to its mean, for `set_lit_lamps`."""
    return 0 if ratio == 1.0 else 1 + round(LIGHT_RATIO_STEPS * ratio) << LIGHT_RATIO_BIT


class SegmentationTable:
    """Semantic class and actor of each of SAPIEN's shape ids; id 0 is the sky."""

    def __init__(self) -> None:
        self._semantic = np.full(64, Semantic.SKY, dtype=np.uint8)
        self._actor = np.zeros(64, dtype=np.int32)

    def assign(self, shape_id: int, semantic: Semantic, actor_id: int) -> None:
        """Set the class of a shape and its present actor, 0 for none."""
        if shape_id >= len(self._actor):
            room = (0, max(shape_id + 1 - len(self._actor), len(self._actor)))
            self._semantic, self._actor = np.pad(self._semantic, room), np.pad(self._actor, room)
        self._semantic[shape_id] = semantic
        self._actor[shape_id] = actor_id

    def look_up(self, ids: NDArray[np.uint32]) -> tuple[NDArray[np.uint8], NDArray[np.int32]]:
        """Look up the semantic class and the actor of each pixel (h, w) of shape ids."""
        return self._semantic[ids], self._actor[ids]
