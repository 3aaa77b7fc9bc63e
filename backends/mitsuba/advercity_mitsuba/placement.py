"""The actors of a frame as instances of bodies."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from advercity.assets.body_pose import BodyShape, compute_body_pose, compute_wheel_pose
from advercity.frames import ActorState, Frame, Lamp
from advercity.geometry.mesh import Mesh, Wheel
from advercity.geometry.poses import Matrix, pose_matrix
from advercity.rendering.lamp_lenses import build_signal_lenses, compute_lens_luminances
from advercity.signal_heads import SIGNAL_HEADS
from advercity.world import World
from advercity_mitsuba.geometry import GeometryStore, RegisteredBody
from advercity_mitsuba.surfaces import get_paint_row
from advercity_mitsuba.variant import dr, mi


@dataclass(frozen=True, eq=False)
class _Instance:
    body: RegisteredBody
    pose: Matrix
    actor_id: int
    paint_row: int
    luminances: Sequence[float]


@dataclass(frozen=True, eq=False)
class PlacedFrame:
    """Instances of a frame, and the kernels' tables of them by their row.

    Attributes:
        scene: All instances.
        rows: Row of an instance by Mitsuba's number of its shape.
        poses: 12 floats each: the world from the body.
        words: 4 integers each: first triangle, actor, row of its paint, 0.
        luminances: Luminance of each kind of lens, kcd/m² per albedo.
    """

    scene: Any
    rows: Any
    poses: Any
    words: Any
    luminances: Any
    instances: Sequence[_Instance]

    def find_hidden(self, hide: frozenset[int]) -> Any:
        """Find which instances belong to actors in `hide`, by row."""
        hidden = mi.Bool([item.actor_id in hide for item in self.instances])
        dr.make_opaque(hidden)
        return hidden


class FramePlacer:
    """Builds the instances of frames; shapes of bodies are kept."""

    def __init__(self, world: World, store: GeometryStore) -> None:
        self._world, self._store = world, store
        self._static = store.add(world.static, is_static=True) if world.static else None
        self._lenses = {
            governs: store.add(build_signal_lenses(governs))
            for governs in SIGNAL_HEADS
            if any(lamp.governs == governs for lamp in world.signal_lamps)
        }
        self._bodies: dict[BodyShape, dict[Wheel | None, RegisteredBody]] = {}

    def place(self, frame: Frame, *, night: bool) -> PlacedFrame:
        """Build the scene of a frame."""
        instances = [*self._list_static(frame, night=night)]
        for state in frame.states:
            instances += self._list_actor(state)
        shapes = [_create_instance(item) for item in instances]
        numbers = [int(_get_shape_number(shape)) for shape in shapes]
        rows = np.zeros(max(numbers, default=0) + 1, np.uint32)
        rows[numbers] = np.arange(len(numbers))
        words = [(i.body.first_triangle, i.actor_id, i.paint_row, 0) for i in instances]
        poses = [item.pose[:3].ravel() for item in instances]
        tables = (
            mi.UInt32(rows),
            mi.Float(np.array(poses, np.float32).ravel()),
            mi.UInt32(np.array(words, np.uint32).ravel()),
            mi.Float(np.array([item.luminances for item in instances], np.float32).ravel()),
        )
        dr.make_opaque(*tables)
        return PlacedFrame(_build_scene(instances, shapes), *tables, instances)

    def _list_static(self, frame: Frame, *, night: bool) -> list[_Instance]:
        found: list[_Instance] = []
        if self._static is not None:
            lit = compute_lens_luminances(Lamp.LOW_BEAM if night else Lamp(0))
            found.append(_Instance(self._static, np.eye(4), 0, 0, lit))
        for lamp in self._world.signal_lamps:
            yaw = float(np.arctan2(lamp.facing[1], lamp.facing[0]))
            light_ratio = frame.signal_light_ratios.get(lamp.id, 1.0)
            lit = compute_lens_luminances(Lamp(0), frame.signals[lamp.id], light_ratio)
            pose = pose_matrix(lamp.position, yaw=yaw)
            found.append(_Instance(self._lenses[lamp.governs], pose, 0, 0, lit))
        return found

    def _list_actor(self, state: ActorState) -> list[_Instance]:
        found = compute_body_pose(state, self._world.bodies)
        world_from_mesh = state.world_from_body @ found.body_from_mesh
        lit = compute_lens_luminances(state.lamps, light_ratio=state.tail_light_ratio)
        paint = get_paint_row(state.actor.paint)
        return [
            _Instance(
                body,
                world_from_mesh
                if wheel is None
                else world_from_mesh @ compute_wheel_pose(state, wheel),
                state.actor.id,
                paint,
                lit,
            )
            for wheel, body in self._get_bodies(found.shape).items()
        ]

    def _get_bodies(self, shape: BodyShape) -> dict[Wheel | None, RegisteredBody]:
        if shape not in self._bodies:
            parts: defaultdict[Wheel | None, list[Mesh]] = defaultdict(list)
            for mesh in shape.build_meshes(self._world.bodies):
                if len(mesh.triangles):
                    parts[mesh.wheel].append(mesh)
            self._bodies[shape] = {
                wheel: self._store.add(meshes) for wheel, meshes in parts.items()
            }
        return self._bodies[shape]


def _create_instance(item: _Instance) -> Any:
    pose = mi.ScalarTransform4f(item.pose.astype(np.float64).tolist())
    description = {"type": "instance", "to_world": pose, "group": item.body.group}
    return mi.load_dict(description, optimize=False)


def _get_shape_number(shape: Any) -> int:
    return dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape))[0]


def _build_scene(instances: Sequence[_Instance], shapes: Sequence[Any]) -> Any:
    groups = {id(item.body.group): item.body.group for item in instances}
    parts = {f"group_{number}": group for number, group in enumerate(groups.values())}
    parts |= {f"instance_{number}": shape for number, shape in enumerate(shapes)}
    return mi.load_dict({"type": "scene", **parts}, optimize=False)
