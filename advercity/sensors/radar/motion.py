"""Velocities of hit points: bodies, their turning wheels and swinging limbs."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from advercity.assets.body_pose import BodyShape, compute_body_pose
from advercity.frames import ActorState, Frame
from advercity.geometry import poses
from advercity.geometry.arrays import Float64Array
from advercity.rendering.raycaster import MATERIAL_NAMES
from advercity.world import Body

_RUBBER = MATERIAL_NAMES.index("rubber")


@dataclass(frozen=True, eq=False)
class SceneMotion:
    """Motion of the actors of a frame, with their bodies by blueprint; for all radars."""

    frame: Frame
    bodies: Mapping[str, Body]
    _limbs: dict[BodyShape, "LimbMotion"] = field(default_factory=dict[BodyShape, "LimbMotion"])

    def compute_velocities(
        self, points: Float64Array, instance: NDArray[np.int32], material: NDArray[np.int16]
    ) -> Float64Array:
        """Compute the velocities (n, 3) in the world of hit points (n, 3), m/s."""
        velocities = np.zeros_like(points)
        present = {*np.unique(instance).tolist()}
        for state in self.frame.states:
            if state.actor.id in present:
                rows = np.flatnonzero(instance == state.actor.id)
                velocities[rows] = self._compute_of_actor(state, points[rows], material[rows])
        return velocities

    def _compute_of_actor(
        self, state: ActorState, points: Float64Array, material: NDArray[np.int16]
    ) -> Float64Array:
        rotation = state.world_from_body[:3, :3]
        own = poses.transform_points(poses.invert_pose(state.world_from_body), points)
        moved = np.cross(np.broadcast_to(state.motion.angular_rate, own.shape), own)
        if state.speed_m_s > 0.0:
            pose = compute_body_pose(state, self.bodies)
            if pose.shape.pose_index is not None:
                limbs = self._get_limbs(pose.shape)
                moved += state.speed_m_s * limbs.find_steps(own - pose.body_from_mesh[:3, 3])
            tyres = np.flatnonzero(material == _RUBBER)
            moved[tyres] += _compute_wheels(own[tyres], state, pose.shape.select_body(self.bodies))
        return state.motion.velocity + moved @ rotation.T

    def _get_limbs(self, shape: BodyShape) -> "LimbMotion":
        if shape not in self._limbs:
            self._limbs[shape] = LimbMotion.from_shape(shape, self.bodies)
        return self._limbs[shape]


def _compute_wheels(own: Float64Array, state: ActorState, body: Body) -> Float64Array:
    """Compute the velocities (n, 3) by the turning of the nearest wheel, in the body frame."""
    hubs = np.array([part.wheel.hub for part in body.parts if part.wheel is not None])
    if not len(hubs) or not len(own):
        return np.zeros_like(own)
    away = own[:, None, :] - hubs
    nearest = np.linalg.norm(away[..., [0, 2]], axis=2).argmin(axis=1)
    spoke, radius = away[np.arange(len(own)), nearest], hubs[nearest, 2]
    turn = state.speed_m_s / radius
    return np.stack([turn * spoke[:, 2], np.zeros_like(turn), -turn * spoke[:, 0]], axis=1)


@dataclass(frozen=True, eq=False)
class LimbMotion:
    """Motion of limbs in a pose of a gait, relative to the body.

    Attributes:
        vertices: The n vertices of the body in the pose.
        steps: (n, 3) movement of each vertex per metre of the body's way.
    """

    vertices: KDTree
    steps: Float64Array

    @staticmethod
    def from_shape(shape: BodyShape, bodies: Mapping[str, Body]) -> "LimbMotion":
        """Take the difference between the previous and the next pose of the gait."""
        gait, index = shape.select_body(bodies).gait, shape.pose_index
        assert gait is not None and index is not None, "a pose without a gait"
        count = len(gait.bone_transforms)
        before, now, after = (
            _list_vertices(replace(shape, pose_index=(index + step) % count), bodies)
            for step in (-1, 0, 1)
        )
        return LimbMotion(KDTree(now), (after - before) * count / (2.0 * gait.cycle_length_m))

    def find_steps(self, points: Float64Array) -> Float64Array:
        """Find the steps (n, 3) of the vertices nearest to points (n, 3)."""
        return self.steps[self.vertices.query(points)[1]]


def _list_vertices(shape: BodyShape, bodies: Mapping[str, Body]) -> Float64Array:
    return np.concatenate([mesh.vertices for mesh in shape.build_meshes(bodies)]).astype(np.float64)
