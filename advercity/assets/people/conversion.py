"""Converts a person to a rigged model: shaped, dressed, upright with hanging arms."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from advercity_dsl import PedestrianAppearance
from advercity_dsl.catalogue import PersonShape

from advercity.assets.people.base_mesh import BaseMesh
from advercity.assets.people.shapes import shape_person
from advercity.assets.people.shells import SNAP_DECIMALS, Shell
from advercity.assets.people.wardrobe import (
    SHOE_MATERIAL,
    SKIN_MATERIALS,
    Measures,
    Wardrobe,
)
from advercity.assets.skeleton import (
    HEEL_ROLL,
    JOINT_COUNT,
    LEFT_TO_RIGHT_JOINT,
    TOE_ROLL,
    Bone,
    Joint,
    MeasuredBuild,
    bone_on_side,
    compute_bone_transforms,
    joint_on_side,
    solve_middle_joint,
)
from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import xyz

PEOPLE_VERSION = 2
"""Part of the key of converted files; raise it when conversion changes."""
_JOINTS = {
    Joint.PELVIS: "pelvis",
    Joint.NECK: "neck",
    Joint.SHOULDER: "shoulder",
    Joint.ELBOW: "elbow",
    Joint.HAND: "hand",
    Joint.HIP: "upper-leg",
    Joint.KNEE: "knee",
    Joint.ANKLE: "ankle",
    Joint.TOE: "foot-2",
}
"""Joints of the base mesh, on the left with the prefix `l-`, by joint of the gait."""

_STRETCH = 0.998
"""Distance from hip to ankle in standing, as a fraction of the leg."""
_SOLE_FRACTION = 0.012
"""Thickness of soles in heights of the figure."""


@dataclass(frozen=True, eq=False)
class RiggedPerson:
    """A dressed person, standing.

    Attributes:
        shells: Surfaces with materials, skinned to the bones of the gait.
        posture: (joints, 3) of standing, in metres.
        build: Measures of the legs.
        umbrella: Colour of an umbrella, or none.
    """

    shells: list[tuple[Shell, str]]
    posture: Float64Array
    build: MeasuredBuild
    umbrella: str | None


def convert_person(
    base: BaseMesh, person: PersonShape, looks: PedestrianAppearance, height_m: float
) -> RiggedPerson:
    """Convert a person of about a height; the same inputs give the same bytes."""
    vertices = _scale_to_height(base, shape_person(base, person), height_m)
    spread = _find_posture(base, vertices)
    worn = Wardrobe(base, vertices, _measure(base, vertices, height_m)).dress(looks)
    standing = _stand(spread, ankle_m=0.042 * height_m)
    shells = [
        (_finish_limbs(shell, material, standing, height_m), material)
        for shell, material in pose_shells(worn, spread, standing)
    ]
    leg_m = _length(standing[Joint.HIP] - standing[Joint.ANKLE]) / _STRETCH
    build = MeasuredBuild(height_m, 1.0, leg_m, float(standing[Joint.ANKLE, 2]))
    return RiggedPerson(shells, np.round(standing, SNAP_DECIMALS), build, looks.umbrella)


def pose_shells(
    shells: Iterable[tuple[Shell, str]], before: Float64Array, after: Float64Array
) -> list[tuple[Shell, str]]:
    """Move shells from a posture (joints, 3) to another one."""
    transforms = compute_bone_transforms(before, after[None])[0].astype(np.float64)
    return [(_pose(shell, transforms), material) for shell, material in shells]


def _scale_to_height(base: BaseMesh, vertices: Float64Array, height_m: float) -> Float64Array:
    body = vertices[np.unique(base.groups["body"])]
    low, high = body[:, 2].min(), body[:, 2].max()
    return (vertices - (0, 0, low)) * (height_m / (high - low))


def _find_posture(base: BaseMesh, vertices: Float64Array) -> Float64Array:
    posture = np.zeros((JOINT_COUNT, 3))
    for joint, name in _JOINTS.items():
        if joint < Joint.SHOULDER:
            posture[joint] = base.compute_joint(vertices, name)
            continue
        posture[joint] = base.compute_joint(vertices, f"l-{name}")
        posture[joint + LEFT_TO_RIGHT_JOINT] = base.compute_joint(vertices, f"r-{name}")
    ends = [base.compute_joint(vertices, name) for name in ("head", "head-2")]
    posture[Joint.HEAD] = (ends[0] + ends[1]) / 2
    return posture


def _measure(base: BaseMesh, vertices: Float64Array, height_m: float) -> Measures:
    joints = {
        name: base.compute_joint(vertices, name) for name in ("pelvis", "neck", "mouth", "head")
    }
    left = ("shoulder", "elbow", "hand", "upper-leg", "knee", "ankle", "eye")
    joints |= {name: base.compute_joint(vertices, f"l-{name}") for name in left}
    crown = float(vertices[np.unique(base.groups["body"]), 2].max())
    mouth = float(joints["mouth"][2])
    # The joint of the mouth is a third of the head above the chin.
    return Measures(height_m, joints, crown, mouth - 0.5 * (crown - mouth))


def _stand(spread: Float64Array, ankle_m: float) -> Float64Array:
    """Compute the standing posture (joints, 3) from the base mesh's, with limbs as long.

    Ankles are `ankle_m` above the ground.
    """
    posture = spread.copy()
    for start in (0, LEFT_TO_RIGHT_JOINT):
        left = 1 if start == 0 else -1
        shoulder, elbow, hand, hip, knee, ankle, toe = (
            spread[joint + start] for joint in range(Joint.SHOULDER, Joint.TOE + 1)
        )
        upper, fore = _length(elbow - shoulder), _length(hand - elbow)
        leg = _length(knee - hip) + _length(ankle - knee)
        posture[Joint.ELBOW + start] = shoulder + upper * _unit(-0.05, 0.17 * left, -1.0)
        posture[Joint.HAND + start] = posture[Joint.ELBOW + start] + fore * _unit(
            0.16, 0.06 * left, -1.0
        )
        moved = hip * (1.0, 0.9, 1.0) - leg * _STRETCH * _unit(0, 0, 1.0)
        posture[Joint.ANKLE + start] = moved
        posture[Joint.KNEE + start] = solve_middle_joint(hip, moved, leg / 2, leg / 2, (1, 0, 0))
        foot = toe - ankle
        flat = np.sqrt(foot[0] ** 2 + foot[1] ** 2)
        posture[Joint.TOE + start] = moved + xyz(0.992 * flat, 0.124 * flat * left, foot[2])
    return posture - (0.0, 0.0, posture[Joint.ANKLE, 2] - ankle_m)


def _length(vector: Float64Array) -> float:
    return float(np.sqrt((vector**2).sum()))


def _unit(x: float, y: float, z: float) -> Float64Array:
    vector = np.array([x, y, z])
    return vector / _length(vector)


def _pose(shell: Shell, transforms: Float64Array) -> Shell:
    """Move a surface by transforms (bones, 3, 4), summed bone by bone in one order."""
    moved = np.zeros_like(shell.vertices)
    x, y, z = shell.vertices.T[:, :, None]
    for weight, turn in zip(shell.weights.T, transforms, strict=True):
        at = x * turn[:, 0] + y * turn[:, 1] + z * turn[:, 2] + turn[:, 3]
        moved += weight[:, None] * at
    return Shell(np.round(moved, SNAP_DECIMALS), shell.triangles, shell.weights)


def _finish_limbs(shell: Shell, material: str, posture: Float64Array, height_m: float) -> Shell:
    """Shape shoes to the ground, and relax hands."""
    if material == SHOE_MATERIAL:
        return _shape_shoes(shell, posture, height_m)
    return _relax_hands(shell, posture, height_m) if material in SKIN_MATERIALS.values() else shell


def _relax_hands(skin: Shell, posture: Float64Array, height_m: float) -> Shell:
    """Bend the fingers of hanging hands towards the palms, and put them together."""
    vertices = skin.vertices.copy()
    for left in (1, -1):
        wrist = posture[joint_on_side(Joint.HAND, left)]
        is_hand = skin.weights[:, bone_on_side(Bone.FOREARM, left)] > 0.5
        x, y, z = (vertices[is_hand] - wrist).T
        knuckle, finger = 0.05 * height_m, 0.055 * height_m
        beyond = np.maximum(-z - knuckle, 0.0)
        ahead = 0.3 * knuckle + 0.1 * beyond
        x = x + (0.35 * np.clip(beyond / finger, 0.0, 1.0)) * (ahead - x)
        # A bend of constant curvature: 50 degrees over the length of a finger.
        turn = np.minimum(beyond / finger, 1.0) * np.radians(50.0)
        curve = finger / np.radians(50.0)
        y = y - left * curve * (1.0 - np.cos(turn))
        z = np.where(beyond > 0.0, -knuckle - curve * np.sin(turn), z)
        vertices[is_hand] = wrist + np.stack([x, y, z], axis=1)
    return replace(skin, vertices=np.round(vertices, SNAP_DECIMALS))


def _shape_shoes(shoes: Shell, posture: Float64Array, height_m: float) -> Shell:
    """Fit shoes to the rounded sole on which the gait rolls: heel, flat, tip.

    They are stretched to its length, and their lowest part is flattened to it.
    """
    vertices, weights = shoes.vertices.copy(), shoes.weights.copy()
    for left in (1, -1):
        ankle = posture[joint_on_side(Joint.ANKLE, left)]
        # Weights of the base mesh have traces of the other foot, which would pull at this one.
        is_here = left * shoes.vertices[:, 1] > 0.0
        weight = np.where(is_here, shoes.weights[:, bone_on_side(Bone.FOOT, left)], 0.0)
        ahead, z = vertices[:, 0] - ankle[0], vertices[:, 2]
        ahead = _fit_ahead(ahead, ahead[weight > 0.5], height_m)
        low, top = z[weight > 0.5].min(), ankle[2] + 0.02 * height_m
        z = z - low * np.clip((top - z) / (top - low), 0.0, 1.0)
        sole = _compute_sole(ahead, height_m)
        z = np.where(z < _SOLE_FRACTION * height_m, sole, np.maximum(z, sole))
        vertices[:, 0] += weight * (ankle[0] + ahead - vertices[:, 0])
        vertices[:, 2] += weight * (z - vertices[:, 2])
        # The part on the ground must not follow the shin.
        solid = (weight > 0.0) * np.clip((top - vertices[:, 2]) / (0.02 * height_m), 0.0, 1.0)
        weights *= 1.0 - solid[:, None]
        weights[:, bone_on_side(Bone.FOOT, left)] += solid
    return replace(shoes, vertices=np.round(vertices, SNAP_DECIMALS), weights=weights)


def _fit_ahead(ahead: Float64Array, foot: Float64Array, height_m: float) -> Float64Array:
    """Stretch distances (n,) ahead of the ankle until a foot's distances fit the sole."""
    (heel, heel_radius), (tip, tip_radius) = np.multiply((HEEL_ROLL, TOE_ROLL), height_m)
    back, front = (heel - heel_radius) / foot.min(), (tip + tip_radius) / foot.max()
    return np.where(ahead < 0.0, ahead * back, ahead * front)


def _compute_sole(ahead: Float64Array, height_m: float) -> Float64Array:
    """Compute the height (n,) of the sole at distances ahead of the ankle: flat, rounded ends."""
    (heel, heel_radius), (tip, tip_radius) = np.multiply((HEEL_ROLL, TOE_ROLL), height_m)
    behind, beyond = np.clip(heel - ahead, 0, heel_radius), np.clip(ahead - tip, 0, tip_radius)
    rounded = heel_radius - np.sqrt(heel_radius**2 - behind**2)
    return rounded + tip_radius - np.sqrt(tip_radius**2 - beyond**2)
