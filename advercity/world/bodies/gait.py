"""How people walk: postures of one stride, from where the feet stand.

A foot on the ground stays where it is while the body passes over it: first it rolls over the heel,
then it stands, then it rolls over its tip. Legs follow by inverse kinematics, arms swing against
them. Proportions and angles are those of textbooks (Perry and Burnfield, Gait Analysis, 2010).
"""

import numpy as np

from advercity.world.bodies.skeleton import Build, Joint, bent, sided, standing
from advercity.world.shapes import Floats

STANCE_SHARE = 0.62
"""Of a stride that a foot is on the ground."""
AHEAD_SHARE = 0.225
"""Of a stride that the ankle is ahead of the hip when the heel strikes."""
_USUAL_STRIDE = 0.76
"""In heights of the figure."""
_STRIKE_RAD, _PUSH_RAD = np.radians(20.0), np.radians(-42.0)
_FLAT_FROM, _FLAT_TO = 0.11, 0.36
HEEL, TIP = (-0.022, 0.022), (0.104, 0.016)
"""Of the shoe: how far before the ankle, and radius, in heights of the figure."""


def walking(build: Build, stride_m: float, poses: int) -> Floats:
    """Postures (poses, joints, 3) of a stride; the left heel strikes first.

    In posture k the body has gone k / poses of the stride.
    """
    rest = standing(build)
    phase = np.arange(poses) / poses
    feet = {left: _foot(build, stride_m, (phase + (left < 0) / 2) % 1.0) for left in (1, -1)}
    hip_z = _hip_height(build, phase, [ankle for ankle, _ in feet.values()])
    postures = np.broadcast_to(rest, (poses, *rest.shape)).copy()
    sunk = hip_z - rest[Joint.HIP, 2]
    upper = [Joint.PELVIS, Joint.NECK, Joint.HEAD]
    upper += [sided(joint, left) for joint in (Joint.SHOULDER, Joint.HIP) for left in (1, -1)]
    postures[:, upper, 2] += sunk[:, None]
    for left, (ankle, pitch) in feet.items():
        _put_leg(postures, build, rest, left, ankle, pitch)
        vigour = stride_m / (_USUAL_STRIDE * build.height_m)
        _swing_arm(postures, rest, left, phase + (left < 0) / 2, vigour)
    return postures


def _foot(build: Build, stride_m: float, phase: Floats) -> tuple[Floats, Floats]:
    """Ankle (n, 2) as x and z, and pitch (n,) of a foot, toe up positive; heel strikes at 0."""
    stance, pitch = _on_ground(build, stride_m, np.minimum(phase, STANCE_SHARE))
    off, off_pitch = _on_ground(build, stride_m, np.array([STANCE_SHARE]))
    strike, strike_pitch = _on_ground(build, stride_m, np.array([0.0]))
    share = np.clip((phase - STANCE_SHARE) / (1.0 - STANCE_SHARE), 0.0, 1.0)
    eased = share**2 * (3.0 - 2.0 * share)
    swing = off + eased[:, None] * (strike - off)
    swing[:, 1] += 0.055 * build.height_m * np.sin(np.pi * share) ** 2
    swung_pitch = off_pitch + np.sqrt(eased) * (strike_pitch - off_pitch)
    swings = phase > STANCE_SHARE
    return np.where(swings[:, None], swing, stance), np.where(swings, swung_pitch, pitch)


def _on_ground(build: Build, stride_m: float, phase: Floats) -> tuple[Floats, Floats]:
    """Ankle and pitch of a foot on the ground, which rolls about heel and tip."""
    h = build.height_m
    flat = AHEAD_SHARE * stride_m - stride_m * phase
    strikes = np.clip(1.0 - phase / _FLAT_FROM, 0.0, 1.0)
    pushes = np.clip((phase - _FLAT_TO) / (STANCE_SHARE - _FLAT_TO), 0.0, 1.0) ** 1.5
    pitch = _STRIKE_RAD * strikes + _PUSH_RAD * pushes
    ahead, radius = np.where((pitch > 0)[:, None], HEEL, TIP).T * h
    x, z = -ahead, build.ankle_m - radius
    cosine, sine = np.cos(pitch), np.sin(pitch)
    ankle = np.stack([flat + ahead + cosine * x - sine * z, radius + sine * x + cosine * z], axis=1)
    return ankle, pitch


def _hip_height(build: Build, phase: Floats, ankles: list[Floats]) -> Floats:
    """Height (n,) of the hips, which rise and fall twice a stride, as far as the legs reach."""
    reach = 0.995 * build.leg_m
    allowed = np.min(
        [z + np.sqrt(np.maximum(reach**2 - x**2, 0.0)) for x, z in (a.T for a in ankles)], axis=0
    )
    fall = 1.0 - np.cos(4 * np.pi * (phase - 0.29))
    top = min(build.ankle_m + 0.992 * build.leg_m, float(allowed[fall < 0.3].min()))
    steep = fall > 0.3
    depth = max(float(np.max((top - allowed[steep]) / fall[steep])), 0.0)
    return top - depth * fall


def _put_leg(
    postures: Floats, build: Build, rest: Floats, left: int, ankle: Floats, pitch: Floats
) -> None:
    knee, foot, toe = (sided(joint, left) for joint in (Joint.KNEE, Joint.ANKLE, Joint.TOE))
    postures[:, foot, 0], postures[:, foot, 2] = ankle.T
    half = build.leg_m / 2
    hip = postures[:, sided(Joint.HIP, left)]
    ahead = np.broadcast_to([1.0, 0.0, 0.0], hip.shape)
    postures[:, knee] = bent(hip, postures[:, foot], half, half, ahead)
    x, y, z = rest[toe] - rest[foot]
    cosine, sine = np.cos(pitch), np.sin(pitch)
    turned = np.stack([cosine * x - sine * z, np.full(len(pitch), y), sine * x + cosine * z], 1)
    postures[:, toe] = postures[:, foot] + turned


def _swing_arm(postures: Floats, rest: Floats, left: int, phase: Floats, vigour: float) -> None:
    """Turn an arm about its shoulder, forward when the other leg is."""
    back = vigour * np.cos(2 * np.pi * (phase - 0.02))
    upper = np.radians(2.0) - np.radians(21.0) * back
    lower = upper + np.radians(12.0) - np.radians(9.0) * back
    shoulder, elbow, hand = (
        sided(joint, left) for joint in (Joint.SHOULDER, Joint.ELBOW, Joint.HAND)
    )
    postures[:, elbow] = postures[:, shoulder] + _swung(rest[elbow] - rest[shoulder], upper)
    postures[:, hand] = postures[:, elbow] + _swung(rest[hand] - rest[elbow], lower)


def _swung(limb: Floats, angle: Floats) -> Floats:
    """A hanging limb (3,) turned forward by angles (n,)."""
    x, y, z = limb
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.stack([cosine * x - sine * z, np.full(len(angle), y), sine * x + cosine * z], axis=1)


def holding(postures: Floats, build: Build) -> Floats:
    """Postures (..., joints, 3) with the right forearm held up before the shoulder."""
    h = build.height_m
    held = postures.copy()
    shoulder, elbow, hand = (
        sided(joint, -1) for joint in (Joint.SHOULDER, Joint.ELBOW, Joint.HAND)
    )
    held[..., elbow, :] = held[..., shoulder, :] + np.array([0.035, -0.020, -0.168]) * h
    held[..., hand, :] = held[..., elbow, :] + np.array([0.115, 0.020, 0.105]) * h
    return held
