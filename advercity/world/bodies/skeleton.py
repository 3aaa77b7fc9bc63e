"""Joints and bones of people, and how bones carry what is fixed to them.

A posture is an array (joints, 3) in metres, in the body frame. Right joints follow the left ones.
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from advercity.world.shapes import Floats


class Joint(IntEnum):
    """Rows of a posture; the head is its middle, the toe is where a foot points."""

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


SIDED = len(Joint) - Joint.SHOULDER
"""Right joints have numbers this much higher than left ones."""
JOINTS = len(Joint) + SIDED


class Bone(IntEnum):
    """What moves as one; right bones follow the left ones."""

    TRUNK = 0
    HEAD = 1
    UPPER_ARM = 2
    FOREARM = 3
    THIGH = 4
    SHIN = 5
    FOOT = 6


SIDED_BONES = len(Bone) - Bone.UPPER_ARM
SIDES = (0, 0, *(1,) * SIDED_BONES, *(-1,) * SIDED_BONES)
"""Of each bone: left 1, right -1, middle 0."""
_LEFT_ENDS = (
    (Joint.PELVIS, Joint.NECK),
    (Joint.NECK, Joint.HEAD),
    (Joint.SHOULDER, Joint.ELBOW),
    (Joint.ELBOW, Joint.HAND),
    (Joint.HIP, Joint.KNEE),
    (Joint.KNEE, Joint.ANKLE),
    (Joint.ANKLE, Joint.TOE),
)
_ENDS = np.array(
    [*_LEFT_ENDS, *((start + SIDED, end + SIDED) for start, end in _LEFT_ENDS[Bone.UPPER_ARM :])]
)
"""Joints (bones, 2) between which each bone lies."""


@dataclass(frozen=True)
class Build:
    """Proportions of a figure in metres; thickness goes with `stout`, 1 for an average one."""

    height_m: float
    stout: float = 1.0

    @property
    def head_m(self) -> float:
        """Height of the head; children have nearly as large ones as adults."""
        return 0.225 * (0.45 + 0.55 * self.height_m / 1.75)

    @property
    def leg_m(self) -> float:
        """From hip to ankle, along thigh and shin of the same length."""
        return (0.488 if self.height_m > 1.45 else 0.47) * self.height_m

    @property
    def ankle_m(self) -> float:
        """Height of the ankle above the ground."""
        return 0.042 * self.height_m


def sided(joint: int, left: int) -> int:
    """Number of a joint of the left (1) or right (-1) side."""
    return joint if left > 0 else joint + SIDED


def bone_of(bone: int, left: int) -> int:
    """Number of a bone of the left (1) or right (-1) side."""
    return bone if left > 0 else bone + SIDED_BONES


def standing(build: Build) -> Floats:
    """Posture of somebody who stands with hanging arms."""
    h, wide = build.height_m, 0.5 + 0.5 * build.stout
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
    posture = np.zeros((JOINTS, 3))
    for joint, place in (middle | left).items():
        posture[joint] = place
    for joint, place in left.items():
        posture[joint + SIDED] = np.multiply(place, (1, -1, 1))
    return posture


def bent(start: ArrayLike, end: ArrayLike, upper_m: float, lower_m: float, to: ArrayLike) -> Floats:
    """The elbows or knees (..., 3) between two joints, on the side that `to` points at.

    Limbs that are too short to reach are stretched.
    """
    first, last = np.asarray(start, float), np.asarray(end, float)
    line = last - first
    distance = np.linalg.norm(line, axis=-1, keepdims=True)
    along = line / distance
    whole = upper_m + lower_m
    lawful = (distance**2 + upper_m**2 - lower_m**2) / (2 * distance)
    reach = np.where(distance < whole, lawful, distance * upper_m / whole)
    height = np.sqrt(np.maximum(upper_m**2 - reach**2, 0.0))
    aside = np.asarray(to, float) - np.sum(to * along, axis=-1, keepdims=True) * along
    aside = aside / np.linalg.norm(aside, axis=-1, keepdims=True)
    return first + reach * along + height * aside


def moves(rest: Floats, postures: Floats) -> NDArray[np.float32]:
    """How every bone carries points from one posture (joints, 3) to others (n, joints, 3).

    Returns:
        (n, bones, 3, 4) float32: a point x at rest comes to `move[:, :3] @ x + move[:, 3]`.
        Bones turn the shortest way.
    """
    before = rest[_ENDS[:, 1]] - rest[_ENDS[:, 0]]
    after = postures[:, _ENDS[:, 1]] - postures[:, _ENDS[:, 0]]
    turn = _turns(before, after)
    shift = postures[:, _ENDS[:, 0]] - np.einsum("nbij,bj->nbi", turn, rest[_ENDS[:, 0]])
    return np.concatenate([turn, shift[..., None]], axis=-1).astype(np.float32)


def _turns(before: Floats, after: Floats) -> Floats:
    """Shortest rotations (..., 3, 3) between directions (..., 3)."""
    a = before / np.linalg.norm(before, axis=-1, keepdims=True)
    b = after / np.linalg.norm(after, axis=-1, keepdims=True)
    a = np.broadcast_to(a, b.shape)
    x, y, z = np.moveaxis(np.cross(a, b), -1, 0)
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*x.shape, 3, 3)
    cosine = np.sum(a * b, axis=-1)[..., None, None]
    return np.eye(3) + cross + cross @ cross / (1.0 + cosine)
