"""What people are made of, garment by garment, in the posture that a skeleton has.

Lengths are shares of the figure's height.
"""

import numpy as np
from advercity_dsl import Looks

from advercity.world.bodies.figure import Chain, Figure, Section
from advercity.world.bodies.flesh import Flesh
from advercity.world.bodies.headwear import hair, head
from advercity.world.bodies.skeleton import Bone, Build, Joint, bone_of, sided
from advercity.world.materials import PAINT
from advercity.world.shapes import Floats, xyz

_SKIN = {"light": "skin", "brown": "skin_brown", "dark": "skin_dark"}
_TORSO = (
    Section(-0.062, -0.004, 0.062, 0.096),
    Section(-0.02, -0.004, 0.065, 0.098),
    Section(0.09, 0.003, 0.058, 0.086),
    Section(0.185, 0.003, 0.066, 0.096),
    Section(0.225, -0.002, 0.052, 0.090),
)
_SEAT = (Section(0.02, -0.004, 0.050, 0.080), Section(-0.035, -0.004, 0.054, 0.082))


def garments(posture: Floats, build: Build, looks: Looks) -> list[tuple[Flesh, str]]:
    """Soft shapes of a figure that walks or stands, and their materials."""
    figure = Figure(posture, build)
    skin, bottom = _SKIN[looks.skin], f"cloth_{looks.bottom_colour}"
    worn = [
        (top(figure, looks.top), PAINT),
        (legs(figure, looks.bottom), skin if looks.bottom == "skirt" else bottom),
        (head(figure), skin),
        (hands(figure, looks.top), skin),
        *((shoe(figure, left), "leather") for left in (1, -1)),
        *hair(figure, looks),
    ]
    if looks.bottom == "skirt":
        worn.append((skirt(figure), bottom))
    if looks.bottom == "shorts":
        worn.append((calves(figure), skin))
    if looks.bag != "none":
        worn.append((bag(figure, looks.bag), f"cloth_{looks.bag_colour}"))
    return worn


def top(figure: Figure, kind: str) -> Flesh:
    """Jacket, coat or shirt, down to the hips or knees."""
    girdle = tuple(
        figure.cone(
            figure.on_trunk(0, 0.03 * left, 0.256),
            figure.on_trunk(0, 0.083 * left, 0.234),
            0.031,
            0.031,
            Bone.TRUNK,
        )
        for left in (1, -1)
    )
    collar = figure.cone(
        figure.on_trunk(-0.006, 0, 0.255),
        figure.on_trunk(0.004, 0, 0.282),
        0.038,
        0.033,
        Bone.TRUNK,
    )
    torso = (*figure.stacked(_TORSO), *girdle, collar)
    skirts = [_coat_tail(figure, left) for left in (1, -1)] if kind == "coat" else []
    sleeves = [_sleeve(figure, left, short=kind == "shirt") for left in (1, -1)]
    share = 0.7 if kind == "coat" else -0.35
    hem = 0.97 * figure.along(Joint.HIP, Joint.KNEE, 1, share)[2]
    chains = [torso, *skirts, *sleeves]
    hems = (hem,) * (1 + len(skirts)) + (-np.inf,) * len(sleeves)
    return figure.flesh(chains, blend=0.022, cell=(0.035, 0.035, 0.052), hems=hems)


def legs(figure: Figure, bottom: str) -> Flesh:
    """Trousers, shorts, or bare legs under a skirt."""
    chains = [_leg(figure, left, bottom) for left in (1, -1)]
    if bottom != "skirt":
        chains.append(figure.stacked(_SEAT))
    return figure.flesh(chains, blend=0.012, cell=(0.035, 0.035, 0.06))


def calves(figure: Figure) -> Flesh:
    """Bare legs under shorts."""
    chains = [
        (figure.limb(Joint.KNEE, Joint.ANKLE, left, 0.033, 0.024, Bone.SHIN),) for left in (1, -1)
    ]
    return figure.flesh(chains, blend=0.001, cell=(0.024, 0.024, 0.05))


def skirt(figure: Figure) -> Flesh:
    """Down to the knees."""
    chains = [
        (
            figure.cone(
                figure.along(Joint.HIP, Joint.KNEE, left, -0.1) * (1, 0.8, 1),
                figure.along(Joint.HIP, Joint.KNEE, left, 0.85),
                0.066,
                0.070,
                bone_of(Bone.THIGH, left),
            ),
        )
        for left in (1, -1)
    ]
    hem = figure.along(Joint.HIP, Joint.KNEE, 1, 0.85)[2]
    return figure.flesh(chains, blend=0.06, cell=(0.035, 0.035, 0.055), hems=(hem, hem))


def hands(figure: Figure, top: str) -> Flesh:
    """Hands, with bare arms under short sleeves."""
    chains: list[Chain] = []
    for left in (1, -1):
        palm = figure.along(Joint.ELBOW, Joint.HAND, left, 0.94)
        tip = figure.along(Joint.ELBOW, Joint.HAND, left, 1.30)
        bone = bone_of(Bone.FOREARM, left)
        arm = figure.cone(palm, tip, 0.021, 0.016, bone)
        chains.append((arm,))
        if top == "shirt":
            upper = figure.along(Joint.SHOULDER, Joint.ELBOW, left, 0.5)
            elbow = figure.posture[sided(Joint.ELBOW, left)]
            chains[-1] += (
                figure.cone(upper, elbow, 0.024, 0.022, bone_of(Bone.UPPER_ARM, left)),
                figure.cone(elbow, palm, 0.022, 0.018, bone),
            )
    cell = (0.026, 0.026, 0.045) if top == "shirt" else (0.022, 0.022, 0.026)
    return figure.flesh(chains, blend=0.001, cell=cell)


def shoe(figure: Figure, left: int) -> Flesh:
    """The shoe of the left (1) or right (-1) foot."""
    h, bone = figure.build.height_m, bone_of(Bone.FOOT, left)
    ankle, toe = (figure.posture[sided(joint, left)] for joint in (Joint.ANKLE, Joint.TOE))
    fore = (toe - ankle) * (1, 1, 0)
    fore = fore / np.linalg.norm(fore)
    down = xyz(z=figure.build.ankle_m)
    heel = ankle - down - 0.022 * h * fore + xyz(z=0.022 * h)
    ball = ankle - down + 0.070 * h * fore + xyz(z=0.021 * h)
    tip = ankle - down + 0.104 * h * fore + xyz(z=0.016 * h)
    cones = (
        figure.cone(ankle, heel, 0.020, 0.022, bone),
        figure.cone(heel, ball, 0.022, 0.021, bone),
        figure.cone(ball, tip, 0.021, 0.016, bone),
    )
    return figure.flesh([cones], blend=0.001, cell=(0.030, 0.025, 0.024))


def bag(figure: Figure, kind: str) -> Flesh:
    """A backpack, a bag on a strap, or a case in the right hand."""
    if kind == "backpack":
        corners = figure.trunk((-0.092, 0.030, 0.22), (-0.100, 0.034, 0.07), 0.042, 0.048)
        return figure.flesh([corners], blend=0.01, cell=(0.038, 0.042, 0.056))
    if kind == "shoulder_bag":
        body = figure.trunk((-0.03, -0.105, -0.02), (0.03, -0.105, -0.02), 0.035, 0.035)[1:]
        low = figure.trunk((-0.03, -0.108, -0.06), (0.03, -0.108, -0.06), 0.035, 0.035)[1:]
        strap = figure.trunk((0, -0.072, 0.262), (0, -0.102, 0.0), 0.012, 0.010)[1:]
        return figure.flesh([(*body, *low, *strap)], blend=0.01, cell=(0.032, 0.026, 0.038))
    hand = figure.along(Joint.ELBOW, Joint.HAND, -1, 1.3)
    h, bone = figure.build.height_m, bone_of(Bone.FOREARM, -1)
    corners = (
        figure.cone(
            hand + xyz(-0.045 * h, 0, z * h),
            hand + xyz(0.045 * h, 0, z * h),
            0.022,
            0.022,
            bone,
        )
        for z in (-0.035, -0.06, -0.085)
    )
    return figure.flesh([tuple(corners)], blend=0.01, cell=(0.03, 0.02, 0.03))


def _sleeve(figure: Figure, left: int, *, short: bool) -> Chain:
    thick = 0.5 + 0.5 * figure.build.stout
    if short:
        elbow = figure.along(Joint.SHOULDER, Joint.ELBOW, left, 0.62)
        shoulder = figure.posture[sided(Joint.SHOULDER, left)]
        arm = bone_of(Bone.UPPER_ARM, left)
        return (figure.cone(shoulder, elbow, 0.033 * thick, 0.030 * thick, arm),)
    wrist = figure.along(Joint.ELBOW, Joint.HAND, left, 0.9)
    return (
        figure.limb(
            Joint.SHOULDER, Joint.ELBOW, left, 0.033 * thick, 0.028 * thick, Bone.UPPER_ARM
        ),
        figure.cone(
            figure.posture[sided(Joint.ELBOW, left)],
            wrist,
            0.028 * thick,
            0.023 * thick,
            bone_of(Bone.FOREARM, left),
        ),
    )


def _leg(figure: Figure, left: int, bottom: str) -> Chain:
    thick = 0.7 + 0.3 * figure.build.stout
    if bottom == "skirt":
        hidden = figure.along(Joint.HIP, Joint.KNEE, left, 0.5)
        knee = figure.posture[sided(Joint.KNEE, left)]
        thigh = figure.cone(hidden, knee, 0.040, 0.033, bone_of(Bone.THIGH, left))
        return (thigh, figure.limb(Joint.KNEE, Joint.ANKLE, left, 0.033, 0.024, Bone.SHIN))
    thigh = figure.limb(Joint.HIP, Joint.KNEE, left, 0.052 * thick, 0.038 * thick, Bone.THIGH)
    if bottom == "shorts":
        return (thigh,)
    return (thigh, figure.limb(Joint.KNEE, Joint.ANKLE, left, 0.038 * thick, 0.031, Bone.SHIN))


def _coat_tail(figure: Figure, left: int) -> Chain:
    hip = figure.posture[sided(Joint.HIP, left)] * (1, 0.8, 1)
    knee = figure.along(Joint.HIP, Joint.KNEE, left, 0.8)
    return (figure.cone(hip, knee, 0.064, 0.070, bone_of(Bone.THIGH, left)),)
