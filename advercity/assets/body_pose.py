"""Computes the visible pose of an actor, the same for renderers, ray casting and labels."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from advercity.assets.rigged_bodies import pose_body, pose_vertices
from advercity.frames import ActorState, Frame
from advercity.geometry.arrays import Float32Array, Float64Array, IndexArray
from advercity.geometry.boxes import Box
from advercity.geometry.mesh import Mesh, MeshLayer, Wheel
from advercity.geometry.poses import Matrix, pose_matrix
from advercity.physics.constants import GOLDEN_FRACTION, MAX_STEERING_RAD
from advercity.world import Body

CLOTH_MATERIALS = (
    "cloth_dark",
    "cloth_denim",
    "cloth_grey",
    "cloth_brown",
    "cloth_black",
    "cloth_blue",
    "cloth_light",
    "cloth_white",
)
"""Colours of clothes by which people with a common body differ."""
STATIONARY_POSE_M_S = 0.15
"""Speed below which people stand: slower steps would look like slow motion."""


@dataclass(frozen=True)
class BodyShape:
    """Shape of an actor's body in a frame; equal shapes have equal meshes, so it can be a key."""

    blueprint: str
    has_umbrella: bool = False
    pose_index: int | None = None
    figure: int = 0
    is_parked: bool = False

    def build_meshes(self, bodies: Mapping[str, Body]) -> tuple[Mesh, ...]:
        """Build the parts, in the mesh frame of `BodyPose.body_from_mesh`."""
        meshes = pose_body(self.select_body(bodies), self.pose_index)
        if self.is_parked:
            meshes = tuple(mesh for mesh in meshes if mesh.layer != MeshLayer.OCCUPANT)
        others = len(bodies[self.blueprint].others)
        rounds = self.figure // (1 + others) if others else 0
        return tuple(_recolour_clothes(mesh, rounds) for mesh in meshes) if rounds else meshes

    def compute_vertices(self, bodies: Mapping[str, Body]) -> Float32Array:
        """Compute the vertices (n, 3) of all parts of `build_meshes` in sequence."""
        if self.is_parked:
            return np.concatenate([mesh.vertices for mesh in self.build_meshes(bodies)])
        return pose_vertices(self.select_body(bodies), self.pose_index)

    def to_rest(self) -> "BodyShape":
        """Return the shape of the same body in no pose of its gait."""
        return replace(self, pose_index=None)

    def select_body(self, bodies: Mapping[str, Body]) -> Body:
        """Select the body of the figure, with or without umbrella."""
        people = (bodies[self.blueprint], *bodies[self.blueprint].others)
        body = people[self.figure % len(people)]
        return body.with_umbrella if self.has_umbrella and body.with_umbrella else body


@dataclass(frozen=True, eq=False)
class BodyPose:
    """Shape of an actor, and the transform of its meshes to the body frame.

    Gaits have few poses. People are shifted ahead or back by up to half the distance between two
    poses, so a foot on the ground does not slide.
    """

    shape: BodyShape
    body_from_mesh: Matrix


def compute_body_pose(state: ActorState, bodies: Mapping[str, Body]) -> BodyPose:
    """Compute the pose of an actor from its travelled distance; bodies by blueprint."""
    actor = state.actor
    shape = BodyShape(actor.blueprint, figure=state.figure, is_parked=state.is_parked)
    if state.umbrella and shape.select_body(bodies).with_umbrella is not None:
        shape = replace(shape, has_umbrella=True)
    gait = shape.select_body(bodies).gait
    if gait is None or (gait.returns_to_rest and state.speed_m_s < STATIONARY_POSE_M_S):
        return BodyPose(shape, np.eye(4))
    poses = len(gait.bone_transforms)
    # Actors walk out of phase: successive ids are a golden fraction of a cycle apart.
    turns = (state.travelled_m / gait.cycle_length_m + GOLDEN_FRACTION * actor.id) % 1.0
    pose = round(turns * poses)
    body_from_mesh = np.eye(4)
    if gait.returns_to_rest:
        body_from_mesh[0, 3] = (pose / poses - turns) * gait.cycle_length_m
    return BodyPose(replace(shape, pose_index=pose % poses), body_from_mesh)


def _recolour_clothes(mesh: Mesh, rounds: int) -> Mesh:
    """Give a mesh of cloth another colour, `rounds` further in the list of colours."""
    if mesh.material not in CLOTH_MATERIALS:
        return mesh
    place = CLOTH_MATERIALS.index(mesh.material) + rounds
    return replace(mesh, material=CLOTH_MATERIALS[place % len(CLOTH_MATERIALS)])


def build_pose_box_fitter(bodies: Mapping[str, Body]) -> Callable[[Frame], Frame]:
    """Build a function giving each pedestrian of a frame the box of its drawn body.

    The box excludes an umbrella and the arm holding it: it is the same as without an umbrella.
    """

    @cache
    def find_used_vertices(rest: BodyShape) -> IndexArray:
        meshes = rest.build_meshes(bodies)
        starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes[:-1])])
        used = [np.unique(mesh.triangles) for mesh in meshes]
        return np.concatenate([rows + start for rows, start in zip(used, starts, strict=True)])

    @cache
    def measure_extent(shape: BodyShape) -> tuple[Float64Array, Float64Array]:
        vertices = shape.compute_vertices(bodies)[find_used_vertices(shape.to_rest())]
        return vertices.min(axis=0).astype(np.float64), vertices.max(axis=0).astype(np.float64)

    def fit_state(state: ActorState) -> ActorState:
        if state.actor.actor_class != "pedestrian":
            return state
        pose = compute_body_pose(replace(state, umbrella=False), bodies)
        low, high = (corner + pose.body_from_mesh[:3, 3] for corner in measure_extent(pose.shape))
        box = Box(tuple((high - low).tolist()), tuple(((low + high) / 2).tolist()))
        return replace(state, pose_box=box)

    return lambda frame: replace(frame, states=tuple(map(fit_state, frame.states)))


def compute_wheel_pose(state: ActorState, wheel: Wheel) -> Matrix:
    """Compute the transform (4, 4) of a wheel from rest, in the body frame.

    It has rolled by the travelled distance, and is turned by the steering angle if it is steered.
    """
    steering = np.clip(state.steering_rad, -MAX_STEERING_RAD, MAX_STEERING_RAD)
    turn = pose_matrix(
        wheel.hub,
        yaw=float(steering) if wheel.is_steered else 0.0,
        pitch=state.travelled_m / wheel.radius_m % (2.0 * np.pi),
    )
    turn[:3, 3] -= turn[:3, :3] @ np.asarray(wheel.hub)
    return turn
