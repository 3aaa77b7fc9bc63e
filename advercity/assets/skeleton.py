"""Computes postures of people, standing and walking, and the transforms of their bones.

A posture is an array (joints, 3) in metres, in the body frame; right joints follow the left ones.

In a stride the foot on the ground keeps its place while the body passes over it: it rolls over the
heel, rests, then rolls over its tip. Legs follow by inverse kinematics, arms swing opposite to
them. Proportions and angles are from Perry and Burnfield, Gait Analysis, 2010.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from advercity.geometry.arrays import Float64Array


class Joint(IntEnum):
    """Rows of a posture; HEAD is the centre of the head, TOE gives the direction of the foot."""

    PELVIS = 0
    NECK = 1
    HEAD = 2
    SHOULDER = 3
    ELBOW = 4
    HAND = 5
    HIP = 6
    KNEE = 7
    ANKLE = 8
    TOE = 9


LEFT_TO_RIGHT_JOINT = len(Joint) - Joint.SHOULDER
"""Offset from the number of a left joint to the right one's."""
JOINT_COUNT = len(Joint) + LEFT_TO_RIGHT_JOINT


class Bone(IntEnum):
    """Rigid segments of the body; right bones follow the left ones."""

    TRUNK = 0
    HEAD = 1
    UPPER_ARM = 2
    FOREARM = 3
    THIGH = 4
    SHIN = 5
    FOOT = 6


LEFT_TO_RIGHT_BONE = len(Bone) - Bone.UPPER_ARM
BONE_SIDES = (0, 0, *(1,) * LEFT_TO_RIGHT_BONE, *(-1,) * LEFT_TO_RIGHT_BONE)
"""Side of each bone: left 1, right -1, middle 0."""
_LEFT_BONE_ENDS = (
    (Joint.PELVIS, Joint.NECK),
    (Joint.NECK, Joint.HEAD),
    (Joint.SHOULDER, Joint.ELBOW),
    (Joint.ELBOW, Joint.HAND),
    (Joint.HIP, Joint.KNEE),
    (Joint.KNEE, Joint.ANKLE),
    (Joint.ANKLE, Joint.TOE),
)
_BONE_ENDS = np.array(
    [
        *_LEFT_BONE_ENDS,
        *(
            (start + LEFT_TO_RIGHT_JOINT, end + LEFT_TO_RIGHT_JOINT)
            for start, end in _LEFT_BONE_ENDS[Bone.UPPER_ARM :]
        ),
    ]
)
"""Joints (bones, 2) at the ends of each bone; a bone turns about the first."""


@dataclass(frozen=True)
class BodyBuild:
    """Proportions of a figure; its thickness scales with `stoutness`, 1 for an average one."""

    height_m: float
    stoutness: float = 1.0

    @property
    def head_m(self) -> float:
        """Height of the head; children's heads are nearly as large as adults'."""
        return 0.225 * (0.45 + 0.55 * self.height_m / 1.75)

    @property
    def leg_m(self) -> float:
        """Length from hip to ankle, along thigh and shin of the same length."""
        return (0.488 if self.height_m > 1.45 else 0.47) * self.height_m

    @property
    def ankle_m(self) -> float:
        """Height of the ankle above the ground."""
        return 0.042 * self.height_m


@dataclass(frozen=True)
class MeasuredBuild(BodyBuild):
    """Proportions of a figure whose legs were measured."""

    measured_leg_m: float = 0.0
    measured_ankle_m: float = 0.0

    @property
    def leg_m(self) -> float:
        """Length from hip to ankle."""
        return self.measured_leg_m

    @property
    def ankle_m(self) -> float:
        """Height of the ankle above the ground."""
        return self.measured_ankle_m


def joint_on_side(joint: int, left: int) -> int:
    """Return the number of a joint on the left (1) or right (-1)."""
    return joint if left > 0 else joint + LEFT_TO_RIGHT_JOINT


def bone_on_side(bone: int, left: int) -> int:
    """Return the number of a bone on the left (1) or right (-1)."""
    return bone if left > 0 else bone + LEFT_TO_RIGHT_BONE


def compute_standing_posture(build: BodyBuild) -> Float64Array:
    """Compute the posture (joints, 3) of standing with hanging arms."""
    h, wide = build.height_m, 0.5 + 0.5 * build.stoutness
    hip = build.ankle_m + build.leg_m
    neck = h - 0.97 * build.head_m - 0.045 * h
    left = {
        Joint.SHOULDER: (0.0, 0.100 * wide * h, neck - 0.030 * h),
        Joint.ELBOW: (-0.012 * h, 0.128 * wide * h, neck - 0.200 * h),
        Joint.HAND: (0.018 * h, 0.140 * wide * h, neck - 0.360 * h),
        Joint.HIP: (0.0, 0.049 * wide * h, hip),
        Joint.KNEE: (0.006 * h, 0.050 * wide * h, (hip + build.ankle_m) / 2),
        Joint.ANKLE: (0.0, 0.051 * wide * h, build.ankle_m),
        Joint.TOE: (0.085 * h, 0.051 * wide * h + 0.009 * h, 0.6 * build.ankle_m),
    }
    middle = {
        Joint.PELVIS: (0.0, 0.0, hip + 0.02 * h),
        Joint.NECK: (-0.004 * h, 0.0, neck),
        Joint.HEAD: (0.012 * h, 0.0, h - 0.47 * build.head_m),
    }
    posture = np.zeros((JOINT_COUNT, 3))
    for joint, place in (middle | left).items():
        posture[joint] = place
    for joint, place in left.items():
        posture[joint + LEFT_TO_RIGHT_JOINT] = np.multiply(place, (1, -1, 1))
    return posture


def solve_middle_joint(
    start: ArrayLike, end: ArrayLike, upper_m: float, lower_m: float, towards: ArrayLike
) -> Float64Array:
    """Compute elbows or knees (..., 3) by two-bone inverse kinematics.

    A limb from `start` (..., 3), shoulder or hip, to `end`, hand or ankle, is stretched if it is
    too short. The joint bends `towards` (..., 3).
    """
    first, last = np.asarray(start, float), np.asarray(end, float)
    line = last - first
    distance = np.linalg.norm(line, axis=-1, keepdims=True)
    along = line / distance
    whole = upper_m + lower_m
    # The law of cosines gives where the joint's perpendicular meets the line between the ends.
    foot = (distance**2 + upper_m**2 - lower_m**2) / (2 * distance)
    foot = np.where(distance < whole, foot, distance * upper_m / whole)
    height = np.sqrt(np.maximum(upper_m**2 - foot**2, 0.0))
    bend = np.asarray(towards, float) - np.sum(towards * along, axis=-1, keepdims=True) * along
    bend = bend / np.linalg.norm(bend, axis=-1, keepdims=True)
    return first + foot * along + height * bend


def compute_bone_transforms(rest: Float64Array, postures: Float64Array) -> NDArray[np.float32]:
    """Compute the transforms of all bones from one posture (joints, 3) to others (n, joints, 3).

    The result is (n, bones, 3, 4) float32: a point x at rest moves to `transform[:, :3] @ x +
    transform[:, 3]`. Bones do not twist about their own axes.
    """
    return compute_segment_transforms(rest, postures, _BONE_ENDS)


def compute_segment_transforms(
    rest: Float64Array, postures: Float64Array, ends: NDArray[np.int64]
) -> NDArray[np.float32]:
    """Compute the transforms (n, bones, 3, 4) of bones with joints `ends` (bones, 2)."""
    before = rest[ends[:, 1]] - rest[ends[:, 0]]
    after = postures[:, ends[:, 1]] - postures[:, ends[:, 0]]
    turn = _compute_shortest_rotations(before, after)
    shift = postures[:, ends[:, 0]] - np.einsum("nbij,bj->nbi", turn, rest[ends[:, 0]])
    return np.concatenate([turn, shift[..., None]], axis=-1).astype(np.float32)


def _compute_shortest_rotations(before: Float64Array, after: Float64Array) -> Float64Array:
    """Compute the smallest rotations (..., 3, 3) from directions to directions (..., 3)."""
    a = before / np.linalg.norm(before, axis=-1, keepdims=True)
    b = after / np.linalg.norm(after, axis=-1, keepdims=True)
    a = np.broadcast_to(a, b.shape)
    x, y, z = np.moveaxis(np.cross(a, b), -1, 0)
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*x.shape, 3, 3)
    cosine = np.sum(a * b, axis=-1)[..., None, None]
    # Rodrigues' formula without angles; no limb turns by 180 degrees, where it divides by 0.
    return np.eye(3) + cross + cross @ cross / (1.0 + cosine)


STANCE_FRACTION = 0.62
"""Fraction of a stride during which a foot is on the ground."""
HEEL_STRIKE_FRACTION = 0.225
"""Distance of the ankle ahead of the hip at heel strike, as a fraction of the stride."""
_TYPICAL_STRIDE = 0.76
"""Length of a usual stride in heights of the figure, at which arms swing fully."""
_STRIKE_RAD, _PUSH_RAD = np.radians(20.0), np.radians(-42.0)
"""Pitch of the foot at heel strike and at push-off, toe up positive."""
_FLAT_START, _FLAT_END = 0.11, 0.36
"""Phases between which the foot is flat on the ground."""
HEEL_ROLL, TOE_ROLL = (-0.022, 0.022), (0.104, 0.016)
"""Rounded heel and tip of the shoe: distance ahead of the ankle and radius, in heights."""


SITTING_LEAN_RAD = np.radians(8.0)
"""Lean of the back in a wheelchair."""


def compute_walking_postures(
    build: BodyBuild, rest: Float64Array, stride_m: float, poses: int
) -> Float64Array:
    """Compute the postures (poses, joints, 3) of a stride, from the strike of the left heel.

    In posture k the body has travelled k / poses of the stride. `rest` (joints, 3) is standing.
    """
    phase = np.arange(poses) / poses
    feet = {
        left: _compute_foot_path(build, stride_m, (phase + (left < 0) / 2) % 1.0)
        for left in (1, -1)
    }
    hip_z = _compute_hip_height(build, phase, [ankle for ankle, _ in feet.values()])
    postures = np.broadcast_to(rest, (poses, *rest.shape)).copy()
    upper = [Joint.PELVIS, Joint.NECK, Joint.HEAD]
    upper += [
        joint_on_side(joint, left) for joint in (Joint.SHOULDER, Joint.HIP) for left in (1, -1)
    ]
    postures[:, upper, 2] += (hip_z - rest[Joint.HIP, 2])[:, None]
    for left, (ankle, pitch) in feet.items():
        _set_leg(postures, build, rest, left, ankle, pitch)
        amplitude = stride_m / (_TYPICAL_STRIDE * build.height_m)
        _set_arm_swing(postures, rest, left, phase + (left < 0) / 2, amplitude)
    return postures


def _compute_foot_path(
    build: BodyBuild, stride_m: float, phase: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Compute the ankle (n, 2), x and z, and pitch (n,) of a foot whose heel strikes at phase 0."""
    stance, pitch = _compute_stance(build, stride_m, np.minimum(phase, STANCE_FRACTION))
    off, off_pitch = _compute_stance(build, stride_m, np.array([STANCE_FRACTION]))
    strike, strike_pitch = _compute_stance(build, stride_m, np.array([0.0]))
    fraction = np.clip((phase - STANCE_FRACTION) / (1.0 - STANCE_FRACTION), 0.0, 1.0)
    eased = fraction**2 * (3.0 - 2.0 * fraction)
    swing = off + eased[:, None] * (strike - off)
    swing[:, 1] += 0.055 * build.height_m * np.sin(np.pi * fraction) ** 2
    swung_pitch = off_pitch + np.sqrt(eased) * (strike_pitch - off_pitch)
    swings = phase > STANCE_FRACTION
    return np.where(swings[:, None], swing, stance), np.where(swings, swung_pitch, pitch)


def _compute_stance(
    build: BodyBuild, stride_m: float, phase: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Compute ankle (n, 2) and pitch (n,) of a foot on the ground, rolling over heel and tip."""
    h = build.height_m
    flat = HEEL_STRIKE_FRACTION * stride_m - stride_m * phase
    strikes = np.clip(1.0 - phase / _FLAT_START, 0.0, 1.0)
    pushes = np.clip((phase - _FLAT_END) / (STANCE_FRACTION - _FLAT_END), 0.0, 1.0) ** 1.5
    pitch = _STRIKE_RAD * strikes + _PUSH_RAD * pushes
    ahead, radius = np.where((pitch > 0)[:, None], HEEL_ROLL, TOE_ROLL).T * h
    x, z = -ahead, build.ankle_m - radius
    cosine, sine = np.cos(pitch), np.sin(pitch)
    ankle = np.stack([flat + ahead + cosine * x - sine * z, radius + sine * x + cosine * z], axis=1)
    return ankle, pitch


def _compute_hip_height(
    build: BodyBuild, phase: Float64Array, ankles: list[Float64Array]
) -> Float64Array:
    """Compute the height (n,) of the hips: two falls a stride, as deep as leg length requires."""
    # Legs are never quite straight: a stretched knee would jump between poses.
    leg_m = 0.995 * build.leg_m
    allowed = np.min(
        [z + np.sqrt(np.maximum(leg_m**2 - x**2, 0.0)) for x, z in (a.T for a in ankles)], axis=0
    )
    fall = 1.0 - np.cos(4 * np.pi * (phase - 0.29))
    top = min(build.ankle_m + 0.992 * build.leg_m, float(allowed[fall < 0.3].min()))
    steep = fall > 0.3
    depth = max(float(np.max((top - allowed[steep]) / fall[steep])), 0.0)
    return top - depth * fall


def _set_leg(
    postures: Float64Array,
    build: BodyBuild,
    rest: Float64Array,
    left: int,
    ankle: Float64Array,
    pitch: Float64Array,
) -> None:
    knee, foot, toe = (joint_on_side(joint, left) for joint in (Joint.KNEE, Joint.ANKLE, Joint.TOE))
    postures[:, foot, 0], postures[:, foot, 2] = ankle.T
    half = build.leg_m / 2
    hip = postures[:, joint_on_side(Joint.HIP, left)]
    ahead = np.broadcast_to([1.0, 0.0, 0.0], hip.shape)
    postures[:, knee] = solve_middle_joint(hip, postures[:, foot], half, half, ahead)
    postures[:, toe] = postures[:, foot] + _pitch_limb(rest[toe] - rest[foot], pitch)


def _set_arm_swing(
    postures: Float64Array, rest: Float64Array, left: int, phase: Float64Array, amplitude: float
) -> None:
    """Swing an arm about its shoulder: forward while the other leg is forward."""
    back = amplitude * np.cos(2 * np.pi * (phase - 0.02))
    upper = np.radians(2.0) - np.radians(21.0) * back
    lower = upper + np.radians(12.0) - np.radians(9.0) * back
    shoulder, elbow, hand = (
        joint_on_side(joint, left) for joint in (Joint.SHOULDER, Joint.ELBOW, Joint.HAND)
    )
    postures[:, elbow] = postures[:, shoulder] + _pitch_limb(rest[elbow] - rest[shoulder], upper)
    postures[:, hand] = postures[:, elbow] + _pitch_limb(rest[hand] - rest[elbow], lower)


def _pitch_limb(limb: Float64Array, angle: Float64Array) -> Float64Array:
    """Rotate a limb (3,) about the y axis, its front end up, by angles (n,) into (n, 3)."""
    x, y, z = limb
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.stack([cosine * x - sine * z, np.full(len(angle), y), sine * x + cosine * z], axis=1)


def raise_right_forearm(postures: Float64Array, build: BodyBuild) -> Float64Array:
    """Raise the right forearm of postures (..., joints, 3), as if it held an umbrella."""
    h = build.height_m
    raised = postures.copy()
    shoulder, elbow, hand = (
        joint_on_side(joint, -1) for joint in (Joint.SHOULDER, Joint.ELBOW, Joint.HAND)
    )
    raised[..., elbow, :] = raised[..., shoulder, :] + np.array([0.035, -0.020, -0.168]) * h
    raised[..., hand, :] = raised[..., elbow, :] + np.array([0.115, 0.020, 0.105]) * h
    return raised


def move_hands(
    postures: Float64Array, rest: Float64Array, hands: Mapping[int, Float64Array]
) -> Float64Array:
    """Move hands of postures (..., joints, 3) to places (..., 3), by side, left 1 and right -1.

    Arms have the lengths of `rest` (joints, 3); elbows bend down and outwards.
    """
    moved = postures.copy()
    for left, place in hands.items():
        shoulder, elbow, hand = (
            joint_on_side(joint, left) for joint in (Joint.SHOULDER, Joint.ELBOW, Joint.HAND)
        )
        upper = float(np.linalg.norm(rest[elbow] - rest[shoulder]))
        fore = float(np.linalg.norm(rest[hand] - rest[elbow]))
        start = moved[..., shoulder, :]
        end = np.broadcast_to(place, start.shape)
        bend = (-0.6, 0.35 * left, -0.7)
        moved[..., elbow, :] = solve_middle_joint(start, end, upper, fore, bend)
        moved[..., hand, :] = end
    return moved


def compute_sitting_posture(
    rest: Float64Array, build: BodyBuild, pelvis: Float64Array, sole_z_m: float
) -> Float64Array:
    """Compute the sitting posture (joints, 3) from the standing one.

    The back leans by `SITTING_LEAN_RAD`, thighs are level, and soles are at a height.

    Args:
        rest: Posture (joints, 3) of standing.
        build: Proportions of the figure.
        pelvis: (3,) its place.
        sole_z_m: Height of the soles.
    """
    posture = rest.copy()
    upper = posture - rest[Joint.PELVIS]
    cosine, sine = np.cos(SITTING_LEAN_RAD), np.sin(SITTING_LEAN_RAD)
    posture[:, 0] = pelvis[0] + cosine * upper[:, 0] - sine * upper[:, 2]
    posture[:, 2] = pelvis[2] + sine * upper[:, 0] + cosine * upper[:, 2]
    half = build.leg_m / 2
    for left in (1, -1):
        hip, knee, ankle, toe = (
            joint_on_side(joint, left) for joint in (Joint.HIP, Joint.KNEE, Joint.ANKLE, Joint.TOE)
        )
        thigh = np.array([0.99, 0.07 * left, 0.1])
        posture[knee] = posture[hip] + half * thigh / np.linalg.norm(thigh)
        drop = posture[knee, 2] - sole_z_m - build.ankle_m
        ahead = np.sqrt(max(half**2 - drop**2, 0.0))
        posture[ankle] = posture[knee] + (ahead, 0.0, -drop)
        posture[toe] = posture[ankle] + rest[toe] - rest[ankle]
    return posture
