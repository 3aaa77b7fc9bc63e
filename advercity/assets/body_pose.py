"""In which pose an actor is seen, and where: everybody who draws it or casts at it asks here."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from advercity.assets.rigged_bodies import pose_body
from advercity.frames import ActorState
from advercity.geometry.mesh import Mesh, Wheel
from advercity.geometry.poses import Matrix, pose_matrix
from advercity.physics.constants import GOLDEN_FRACTION, MAX_STEERING_RAD
from advercity.world import Body

STATIONARY_POSE_M_S = 0.15
"""What wheel arches leave room for."""


@dataclass(frozen=True)
class BodyShape:
    """What an actor's body looks like at a moment; equal shapes are the same meshes."""

    blueprint: str
    has_umbrella: bool = False
    pose_index: int | None = None

    def build_meshes(self, bodies: Mapping[str, Body]) -> tuple[Mesh, ...]:
        """Its parts, in the frame of `Posture.world_from_mesh`."""
        return pose_body(self.select_body(bodies), self.pose_index)

    def select_body(self, bodies: Mapping[str, Body]) -> Body:
        """The body that it is a pose of."""
        body = bodies[self.blueprint]
        return body.with_umbrella if self.has_umbrella and body.with_umbrella else body


@dataclass(frozen=True, eq=False)
class BodyPose:
    """An actor's shape and where it is.

    A body has a few poses in a stride. One that stands on its feet is put up to half the way
    between two of them ahead or back, so that a foot on the ground stays where it is.
    """

    shape: BodyShape
    body_from_mesh: Matrix


def compute_body_pose(state: ActorState, bodies: Mapping[str, Body]) -> BodyPose:
    """The posture of an actor; bodies by blueprint."""
    actor = state.actor
    sheltered = state.umbrella and bodies[actor.blueprint].with_umbrella is not None
    gait = BodyShape(actor.blueprint, sheltered).select_body(bodies).gait
    if gait is None or (gait.returns_to_rest and state.speed_m_s < STATIONARY_POSE_M_S):
        return BodyPose(BodyShape(actor.blueprint, sheltered), np.eye(4))
    poses = len(gait.bone_transforms)
    turns = (state.travelled_m / gait.cycle_length_m + GOLDEN_FRACTION * actor.id) % 1.0
    pose = round(turns * poses)
    body_from_mesh = np.eye(4)
    if gait.returns_to_rest:
        body_from_mesh[0, 3] = (pose / poses - turns) * gait.cycle_length_m
    return BodyPose(BodyShape(actor.blueprint, sheltered, pose % poses), body_from_mesh)


def compute_wheel_pose(state: ActorState, wheel: Wheel) -> Matrix:
    """Where an actor's wheel (4, 4) is from where it is at rest, both in the body frame.

    It has rolled as far as the actor has gone, and steers if it is one that does.
    """
    steering = np.clip(state.steering_rad, -MAX_STEERING_RAD, MAX_STEERING_RAD)
    turn = pose_matrix(
        wheel.hub,
        yaw=float(steering) if wheel.is_steered else 0.0,
        pitch=state.travelled_m / wheel.radius_m % (2.0 * np.pi),
    )
    turn[:3, 3] -= turn[:3, :3] @ np.asarray(wheel.hub)
    return turn
