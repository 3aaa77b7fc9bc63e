"""Builds heads, hands and garments of people as soft shapes, in the posture of a figure.

Lengths are fractions of the figure's height, on the head fractions of the head's height.
"""

import numpy as np
from advercity_dsl import PedestrianAppearance

from advercity.assets.skeleton import BodyBuild, Bone, Joint, bone_on_side, joint_on_side
from advercity.assets.soft_shapes import Chain, Figure, RoundCone, SoftShape, TrunkSection
from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import xyz
from advercity.materials import ACTOR_PAINT


def build_head(figure: Figure) -> SoftShape:
    """Build head and neck."""
    unit = figure.build.head_m
    skull = figure.make_head_cone((-0.09, 0, 0.09), (0.08, 0, 0.10), 0.345, 0.335)
    jaw = figure.make_head_cone((0.10, 0, -0.12), (0.19, 0, -0.36), 0.27, 0.115)
    nose = figure.make_head_cone((0.40, 0, 0.02), (0.455, 0, -0.10), 0.03, 0.055)
    ears = [
        figure.make_head_cone((0, y, 0.02), (-0.03, y, -0.1), 0.07, 0.05) for y in (0.345, -0.345)
    ]
    neck = RoundCone(
        figure.posture[Joint.NECK] - figure.compute_up() * 0.03 * figure.build.height_m,
        figure.posture[Joint.HEAD] - xyz(0.1 * unit, 0, 0.1 * unit),
        (0.036 * figure.build.height_m, 0.030 * figure.build.height_m),
        Bone.HEAD,
    )
    cell = (0.145 * unit, 0.145 * unit, 0.15 * unit)
    return SoftShape(((skull, jaw, nose, *ears), (neck,)), 0.03, cell, 0.02)


def build_hair(figure: Figure, looks: PedestrianAppearance) -> list[tuple[SoftShape, str]]:
    """Build hair, a cap over it, or the hood of the top, with their materials."""
    if looks.hair == "bald":
        return []
    if looks.hair == "hood":
        crown = figure.make_head_cone((-0.14, 0, 0.10), (0.06, 0, 0.15), 0.40, 0.36)
        nape = figure.make_head_cone((-0.16, 0, -0.1), (-0.12, 0, -0.62), 0.36, 0.32)
        return [(figure.build_head_cover(crown, nape), ACTOR_PAINT)]
    crown = figure.make_head_cone((-0.13, 0, 0.12), (0.05, 0, 0.165), 0.365, 0.345)
    hair = [crown, figure.make_head_cone((-0.19, 0, 0.10), (-0.2, 0, -0.16), 0.29, 0.23)]
    if looks.hair == "long":
        hair += [
            figure.make_head_cone((-0.1, y, 0.1), (-0.14, 0.95 * y, -0.6), 0.2, 0.15)
            for y in (0.2, -0.2)
        ]
        hair.append(figure.make_head_cone((-0.24, 0, -0.1), (-0.27, 0, -0.75), 0.24, 0.18))
    if looks.hair == "bun":
        hair.append(figure.make_head_cone((-0.48, 0, 0.16), (-0.52, 0, 0.14), 0.15, 0.13))
    layers = [(figure.build_head_cover(*hair), f"hair_{looks.hair_colour}")]
    if looks.hair == "hat":
        layers = [(figure.build_head_cover(hair[1]), f"hair_{looks.hair_colour}")]
        cap = figure.make_head_cone((-0.12, 0, 0.15), (0.05, 0, 0.19), 0.385, 0.37)
        peak = figure.make_head_cone((0.40, 0, 0.15), (0.50, 0, 0.11), 0.06, 0.05)
        layers.append((figure.build_head_cover(cap, peak), f"cloth_{looks.bag_colour}"))
    return layers


def build_helmet(figure: Figure) -> SoftShape:
    """Build a helmet with an open face."""
    shell = figure.make_head_cone((-0.16, 0, 0.14), (0.14, 0, 0.17), 0.43, 0.38)
    return figure.build_head_cover(shell)


def build_chin_guard(figure: Figure) -> SoftShape:
    """Build the part of a motorcyclist's helmet over nape, cheeks and chin."""
    nape = figure.make_head_cone((-0.16, 0, 0.10), (-0.12, 0, -0.22), 0.42, 0.36)
    cheeks = [
        figure.make_head_cone((-0.05, y, -0.2), (0.3, 0.7 * y, -0.3), 0.25, 0.18)
        for y in (0.2, -0.2)
    ]
    return figure.build_head_cover(nape, *cheeks)


def build_visor(figure: Figure) -> SoftShape:
    """Build the visor of a motorcyclist's helmet."""
    pane = figure.make_head_cone((0.12, 0, 0.05), (0.2, 0, -0.05), 0.36, 0.30)
    return figure.build_head_cover(pane)


_SKIN_MATERIALS = {"light": "skin", "brown": "skin_brown", "dark": "skin_dark"}
_TORSO_SECTIONS = (
    TrunkSection(-0.062, -0.004, 0.062, 0.096),
    TrunkSection(-0.02, -0.004, 0.065, 0.098),
    TrunkSection(0.09, 0.003, 0.058, 0.086),
    TrunkSection(0.185, 0.003, 0.066, 0.096),
    TrunkSection(0.225, -0.002, 0.052, 0.090),
)
_SEAT_SECTIONS = (
    TrunkSection(0.02, -0.004, 0.050, 0.080),
    TrunkSection(-0.035, -0.004, 0.054, 0.082),
)


def build_garments(
    posture: Float64Array, build: BodyBuild, looks: PedestrianAppearance
) -> list[tuple[SoftShape, str]]:
    """Build all visible parts of a person, with materials; the top has the actor's paint."""
    figure = Figure(posture, build)
    skin, bottom = _SKIN_MATERIALS[looks.skin], f"cloth_{looks.bottom_colour}"
    garments = [
        (build_top(figure, looks.top), ACTOR_PAINT),
        (build_legs(figure, looks.bottom), skin if looks.bottom == "skirt" else bottom),
        (build_head(figure), skin),
        (build_hands(figure, looks.top), skin),
        *((build_shoe(figure, left), "leather") for left in (1, -1)),
        *build_hair(figure, looks),
    ]
    if looks.bottom == "skirt":
        garments.append((build_skirt_garment(figure), bottom))
    if looks.bottom == "shorts":
        garments.append((build_calves(figure), skin))
    if looks.bag != "none":
        garments.append((build_bag(figure, looks.bag), f"cloth_{looks.bag_colour}"))
    return garments


def build_top(figure: Figure, kind: str) -> SoftShape:
    """Build a jacket, a coat down to the knees, or a shirt."""
    point, bone = figure.compute_trunk_point, Bone.TRUNK
    girdle: list[RoundCone] = []
    for left in (1, -1):
        neck, shoulder = point(0, 0.03 * left, 0.256), point(0, 0.083 * left, 0.234)
        girdle.append(figure.make_cone(neck, shoulder, 0.031, 0.031, bone))
    nape, throat = point(-0.006, 0, 0.255), point(0.004, 0, 0.282)
    collar = figure.make_cone(nape, throat, 0.038, 0.033, bone)
    torso = (*figure.stack_trunk_sections(_TORSO_SECTIONS), *girdle, collar)
    skirts = [_build_coat_tail(figure, left) for left in (1, -1)] if kind == "coat" else []
    sleeves = [_build_sleeve(figure, left, short=kind == "shirt") for left in (1, -1)]
    hem_at = 0.7 if kind == "coat" else -0.35
    hem = 0.97 * figure.interpolate_joints(Joint.HIP, Joint.KNEE, 1, hem_at)[2]
    chains = [torso, *skirts, *sleeves]
    hems = (hem,) * (1 + len(skirts)) + (-np.inf,) * len(sleeves)
    return figure.build_soft_shape(chains, blend=0.022, cell=(0.035, 0.035, 0.052), hems=hems)


def build_legs(figure: Figure, bottom: str) -> SoftShape:
    """Build trousers, shorts, or bare legs under a skirt."""
    chains = [_build_leg(figure, left, bottom) for left in (1, -1)]
    if bottom != "skirt":
        chains.append(figure.stack_trunk_sections(_SEAT_SECTIONS))
    return figure.build_soft_shape(chains, blend=0.012, cell=(0.035, 0.035, 0.06))


def build_calves(figure: Figure) -> SoftShape:
    """Build bare lower legs, for shorts."""
    chains = [
        (figure.make_limb_cone(Joint.KNEE, Joint.ANKLE, left, 0.033, 0.024, Bone.SHIN),)
        for left in (1, -1)
    ]
    return figure.build_soft_shape(chains, blend=0.001, cell=(0.024, 0.024, 0.05))


def build_skirt_garment(figure: Figure) -> SoftShape:
    """Build a skirt down to the knees."""
    chains: list[Chain] = []
    for left in (1, -1):
        hip = figure.interpolate_joints(Joint.HIP, Joint.KNEE, left, -0.1) * (1, 0.8, 1)
        knee = figure.interpolate_joints(Joint.HIP, Joint.KNEE, left, 0.85)
        bone = bone_on_side(Bone.THIGH, left)
        chains.append((figure.make_cone(hip, knee, 0.066, 0.070, bone),))
    hem = figure.interpolate_joints(Joint.HIP, Joint.KNEE, 1, 0.85)[2]
    return figure.build_soft_shape(chains, blend=0.06, cell=(0.035, 0.035, 0.055), hems=(hem, hem))


def build_hands(figure: Figure, top: str) -> SoftShape:
    """Build the hands, with bare arms under short sleeves."""
    chains: list[Chain] = []
    for left in (1, -1):
        palm = figure.interpolate_joints(Joint.ELBOW, Joint.HAND, left, 0.94)
        tip = figure.interpolate_joints(Joint.ELBOW, Joint.HAND, left, 1.30)
        bone = bone_on_side(Bone.FOREARM, left)
        arm = figure.make_cone(palm, tip, 0.021, 0.016, bone)
        chains.append((arm,))
        if top == "shirt":
            upper = figure.interpolate_joints(Joint.SHOULDER, Joint.ELBOW, left, 0.5)
            elbow = figure.posture[joint_on_side(Joint.ELBOW, left)]
            chains[-1] += (
                figure.make_cone(upper, elbow, 0.024, 0.022, bone_on_side(Bone.UPPER_ARM, left)),
                figure.make_cone(elbow, palm, 0.022, 0.018, bone),
            )
    cell = (0.026, 0.026, 0.045) if top == "shirt" else (0.022, 0.022, 0.026)
    return figure.build_soft_shape(chains, blend=0.001, cell=cell)


def build_shoe(figure: Figure, left: int) -> SoftShape:
    """Build the shoe of the left (1) or right (-1) foot."""
    h, bone = figure.build.height_m, bone_on_side(Bone.FOOT, left)
    ankle, toe = (figure.posture[joint_on_side(joint, left)] for joint in (Joint.ANKLE, Joint.TOE))
    fore = (toe - ankle) * (1, 1, 0)
    fore = fore / np.linalg.norm(fore)
    down = xyz(z=figure.build.ankle_m)
    heel = ankle - down - 0.022 * h * fore + xyz(z=0.022 * h)
    ball = ankle - down + 0.070 * h * fore + xyz(z=0.021 * h)
    tip = ankle - down + 0.104 * h * fore + xyz(z=0.016 * h)
    cones = (
        figure.make_cone(ankle, heel, 0.020, 0.022, bone),
        figure.make_cone(heel, ball, 0.022, 0.021, bone),
        figure.make_cone(ball, tip, 0.021, 0.016, bone),
    )
    return figure.build_soft_shape([cones], blend=0.001, cell=(0.030, 0.025, 0.024))


def build_bag(figure: Figure, kind: str) -> SoftShape:
    """Build a backpack, a bag on a strap, or a case in the right hand."""
    if kind == "backpack":
        pair = figure.make_trunk_cones((-0.092, 0.030, 0.22), (-0.100, 0.034, 0.07), 0.042, 0.048)
        return figure.build_soft_shape([pair], blend=0.01, cell=(0.038, 0.042, 0.056))
    if kind == "shoulder_bag":
        # One cone of each mirrored pair: the bag hangs on the left.
        _, upper = figure.make_trunk_cones(
            (-0.03, -0.105, -0.02), (0.03, -0.105, -0.02), 0.035, 0.035
        )
        _, lower = figure.make_trunk_cones(
            (-0.03, -0.108, -0.06), (0.03, -0.108, -0.06), 0.035, 0.035
        )
        _, strap = figure.make_trunk_cones((0, -0.072, 0.262), (0, -0.102, 0.0), 0.012, 0.010)
        return figure.build_soft_shape(
            [(upper, lower, strap)], blend=0.01, cell=(0.032, 0.026, 0.038)
        )
    hand = figure.interpolate_joints(Joint.ELBOW, Joint.HAND, -1, 1.3)
    h, bone = figure.build.height_m, bone_on_side(Bone.FOREARM, -1)
    half = xyz(0.045 * h)
    case = tuple(
        figure.make_cone(hand + xyz(z=z * h) - half, hand + xyz(z=z * h) + half, 0.022, 0.022, bone)
        for z in (-0.035, -0.06, -0.085)
    )
    return figure.build_soft_shape([case], blend=0.01, cell=(0.03, 0.02, 0.03))


def _build_sleeve(figure: Figure, left: int, *, short: bool) -> Chain:
    thick = 0.5 + 0.5 * figure.build.stoutness
    if short:
        elbow = figure.interpolate_joints(Joint.SHOULDER, Joint.ELBOW, left, 0.62)
        shoulder = figure.posture[joint_on_side(Joint.SHOULDER, left)]
        arm = bone_on_side(Bone.UPPER_ARM, left)
        return (figure.make_cone(shoulder, elbow, 0.033 * thick, 0.030 * thick, arm),)
    wrist = figure.interpolate_joints(Joint.ELBOW, Joint.HAND, left, 0.9)
    upper = figure.make_limb_cone(
        Joint.SHOULDER, Joint.ELBOW, left, 0.033 * thick, 0.028 * thick, Bone.UPPER_ARM
    )
    elbow, bone = figure.posture[joint_on_side(Joint.ELBOW, left)], bone_on_side(Bone.FOREARM, left)
    return upper, figure.make_cone(elbow, wrist, 0.028 * thick, 0.023 * thick, bone)


def _build_leg(figure: Figure, left: int, bottom: str) -> Chain:
    thick = 0.7 + 0.3 * figure.build.stoutness
    if bottom == "skirt":
        hidden = figure.interpolate_joints(Joint.HIP, Joint.KNEE, left, 0.5)
        knee = figure.posture[joint_on_side(Joint.KNEE, left)]
        thigh = figure.make_cone(hidden, knee, 0.040, 0.033, bone_on_side(Bone.THIGH, left))
        return (
            thigh,
            figure.make_limb_cone(Joint.KNEE, Joint.ANKLE, left, 0.033, 0.024, Bone.SHIN),
        )
    thigh = figure.make_limb_cone(
        Joint.HIP, Joint.KNEE, left, 0.052 * thick, 0.038 * thick, Bone.THIGH
    )
    if bottom == "shorts":
        return (thigh,)
    return (
        thigh,
        figure.make_limb_cone(Joint.KNEE, Joint.ANKLE, left, 0.038 * thick, 0.031, Bone.SHIN),
    )


def _build_coat_tail(figure: Figure, left: int) -> Chain:
    hip = figure.posture[joint_on_side(Joint.HIP, left)] * (1, 0.8, 1)
    knee = figure.interpolate_joints(Joint.HIP, Joint.KNEE, left, 0.8)
    return (figure.make_cone(hip, knee, 0.064, 0.070, bone_on_side(Bone.THIGH, left)),)
