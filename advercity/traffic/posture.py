"""In which pose an actor is seen, and where: everybody who draws it or casts at it asks here."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from advercity.poses import Matrix, pose
from advercity.traffic.trace import ActorState
from advercity.world.bodies import posed
from advercity.world.scene import Body, Mesh, Wheel

STANDING_M_S = 0.15
_GOLDEN = 0.618034
_MOST_STEERING_RAD = np.radians(40.0)
"""What wheel arches leave room for."""


@dataclass(frozen=True)
class Shape:
    """What an actor's body looks like at a moment; equal shapes are the same meshes."""

    blueprint: str
    sheltered: bool = False
    pose: int | None = None

    def meshes(self, bodies: Mapping[str, Body]) -> tuple[Mesh, ...]:
        """Its parts, in the frame of `Posture.world_from_mesh`."""
        return posed(self.body(bodies), self.pose)

    def body(self, bodies: Mapping[str, Body]) -> Body:
        """The body that it is a pose of."""
        body = bodies[self.blueprint]
        return body.sheltered if self.sheltered and body.sheltered else body


@dataclass(frozen=True, eq=False)
class Posture:
    """An actor's shape and where it is.

    A body has a few poses in a stride. One that stands on its feet is put up to half the way
    between two of them ahead or back, so that a foot on the ground stays where it is.
    """

    shape: Shape
    body_from_mesh: Matrix


def posture(state: ActorState, bodies: Mapping[str, Body]) -> Posture:
    """The posture of an actor; bodies by blueprint."""
    actor = state.actor
    sheltered = state.umbrella and bodies[actor.blueprint].sheltered is not None
    gait = Shape(actor.blueprint, sheltered).body(bodies).gait
    if gait is None or (gait.rests and state.speed_m_s < STANDING_M_S):
        return Posture(Shape(actor.blueprint, sheltered), np.eye(4))
    poses = len(gait.moves)
    turns = (state.travelled_m / gait.cycle_m + _GOLDEN * actor.id) % 1.0
    pose = round(turns * poses)
    body_from_mesh = np.eye(4)
    if gait.rests:
        body_from_mesh[0, 3] = (pose / poses - turns) * gait.cycle_m
    return Posture(Shape(actor.blueprint, sheltered, pose % poses), body_from_mesh)


def rolled(state: ActorState, wheel: Wheel) -> Matrix:
    """Where an actor's wheel (4, 4) is from where it is at rest, both in the body frame.

    It has rolled as far as the actor has gone, and steers if it is one that does.
    """
    steering = np.clip(state.steering_rad, -_MOST_STEERING_RAD, _MOST_STEERING_RAD)
    turn = pose(
        wheel.hub,
        yaw=float(steering) if wheel.steers else 0.0,
        pitch=state.travelled_m / wheel.radius_m % (2.0 * np.pi),
    )
    turn[:3, 3] -= turn[:3, :3] @ np.asarray(wheel.hub)
    return turn
