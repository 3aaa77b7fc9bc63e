"""What people are made of, garment by garment, in the posture that a skeleton has.

Lengths are shares of the figure's height, those of the head shares of the head's height.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from advercity_dsl import Looks

from advercity.world.bodies.flesh import Cone, Flesh
from advercity.world.bodies.skeleton import Bone, Build, Joint, bone_of, sided
from advercity.world.materials import PAINT
from advercity.world.shapes import Floats, xyz

Chain = tuple[Cone, ...]
_COARSENESS = 1.3
"""Times the cells that a close-up would need."""
_SKIN = {"light": "skin", "brown": "skin_brown", "dark": "skin_dark"}


def garments(posture: Floats, build: Build, looks: Looks) -> list[tuple[Flesh, str]]:
    """Soft shapes of a figure that walks or stands, and their materials."""
    figure = Figure(posture, build)
    skin, bottom = _SKIN[looks.skin], f"cloth_{looks.bottom_colour}"
    worn = [
        (figure.top(looks.top), PAINT),
        (figure.legs(looks.bottom), skin if looks.bottom == "skirt" else bottom),
        (figure.head(), skin),
        (figure.hands(looks.top), skin),
        *((figure.shoe(left), "leather") for left in (1, -1)),
        *((flesh, material) for flesh, material in figure.hair(looks)),
    ]
    if looks.bottom == "skirt":
        worn.append((figure.skirt(), bottom))
    if looks.bottom == "shorts":
        worn.append((figure.calves(), skin))
    if looks.bag != "none":
        worn.append((figure.bag(looks.bag), f"cloth_{looks.bag_colour}"))
    return worn


class Section(NamedTuple):
    """An ellipse across the trunk, from the pelvis upward."""

    up: float
    fore: float
    deep: float
    """Half its depth."""
    wide: float


_TORSO = (
    Section(-0.062, -0.004, 0.062, 0.096),
    Section(-0.02, -0.004, 0.065, 0.098),
    Section(0.09, 0.003, 0.058, 0.086),
    Section(0.185, 0.003, 0.066, 0.096),
    Section(0.225, -0.002, 0.052, 0.090),
)
_SEAT = (Section(0.02, -0.004, 0.050, 0.080), Section(-0.035, -0.004, 0.054, 0.082))


@dataclass(frozen=True, eq=False)
class Figure:
    """Garments of one figure."""

    posture: Floats
    build: Build

    def top(self, top: str) -> Flesh:
        """Jacket, coat or shirt, down to the hips or knees."""
        girdle = tuple(
            self._cone(
                self._on_trunk(0, 0.03 * left, 0.256),
                self._on_trunk(0, 0.083 * left, 0.234),
                0.031,
                0.031,
                Bone.TRUNK,
            )
            for left in (1, -1)
        )
        collar = self._cone(
            self._on_trunk(-0.006, 0, 0.255),
            self._on_trunk(0.004, 0, 0.282),
            0.038,
            0.033,
            Bone.TRUNK,
        )
        torso = (*self._stacked(_TORSO), *girdle, collar)
        skirts = [self._coat_tail(left) for left in (1, -1)] if top == "coat" else []
        sleeves = [self._sleeve(left, short=top == "shirt") for left in (1, -1)]
        share = 0.7 if top == "coat" else -0.35
        hem = 0.97 * self._along(Joint.HIP, Joint.KNEE, 1, share)[2]
        chains = [torso, *skirts, *sleeves]
        hems = (hem,) * (1 + len(skirts)) + (-np.inf,) * len(sleeves)
        return self._flesh(chains, blend=0.022, cell=(0.035, 0.035, 0.052), hems=hems)

    def legs(self, bottom: str) -> Flesh:
        """Trousers, shorts, or bare legs under a skirt."""
        chains = [self._leg(left, bottom) for left in (1, -1)]
        if bottom != "skirt":
            chains.append(self._stacked(_SEAT))
        return self._flesh(chains, blend=0.012, cell=(0.035, 0.035, 0.06))

    def calves(self) -> Flesh:
        """Bare legs under shorts."""
        chains = [
            (self._limb(Joint.KNEE, Joint.ANKLE, left, 0.033, 0.024, Bone.SHIN),)
            for left in (1, -1)
        ]
        return self._flesh(chains, blend=0.001, cell=(0.024, 0.024, 0.05))

    def skirt(self) -> Flesh:
        """Down to the knees."""
        chains = [
            (
                self._cone(
                    self._along(Joint.HIP, Joint.KNEE, left, -0.1) * (1, 0.8, 1),
                    self._along(Joint.HIP, Joint.KNEE, left, 0.85),
                    0.066,
                    0.070,
                    bone_of(Bone.THIGH, left),
                ),
            )
            for left in (1, -1)
        ]
        hem = self._along(Joint.HIP, Joint.KNEE, 1, 0.85)[2]
        return self._flesh(chains, blend=0.06, cell=(0.035, 0.035, 0.055), hems=(hem, hem))

    def head(self) -> Flesh:
        """Head and neck."""
        unit = self.build.head_m
        skull = self._head((-0.09, 0, 0.09), (0.08, 0, 0.10), 0.345, 0.335)
        jaw = self._head((0.10, 0, -0.12), (0.19, 0, -0.36), 0.27, 0.115)
        nose = self._head((0.40, 0, 0.02), (0.455, 0, -0.10), 0.03, 0.055)
        ears = [self._head((0, y, 0.02), (-0.03, y, -0.1), 0.07, 0.05) for y in (0.345, -0.345)]
        neck = Cone(
            self.posture[Joint.NECK] - self._up() * 0.03 * self.build.height_m,
            self.posture[Joint.HEAD] - xyz(0.1 * unit, 0, 0.1 * unit),
            (0.036 * self.build.height_m, 0.030 * self.build.height_m),
            Bone.HEAD,
        )
        cell = (0.145 * unit, 0.145 * unit, 0.15 * unit)
        return Flesh(((skull, jaw, nose, *ears), (neck,)), 0.03, cell, 0.02)

    def hair(self, looks: Looks) -> list[tuple[Flesh, str]]:
        """Hair, a cap over it, or the hood of the top."""
        if looks.hair == "bald":
            return []
        if looks.hair == "hood":
            crown = self._head((-0.14, 0, 0.10), (0.06, 0, 0.15), 0.40, 0.36)
            nape = self._head((-0.16, 0, -0.1), (-0.12, 0, -0.62), 0.36, 0.32)
            return [(self._shell(crown, nape), PAINT)]
        crown = self._head((-0.13, 0, 0.12), (0.05, 0, 0.165), 0.365, 0.345)
        grown = [crown, self._head((-0.19, 0, 0.10), (-0.2, 0, -0.16), 0.29, 0.23)]
        if looks.hair == "long":
            grown += [
                self._head((-0.1, y, 0.1), (-0.14, 0.95 * y, -0.6), 0.2, 0.15) for y in (0.2, -0.2)
            ]
            grown.append(self._head((-0.24, 0, -0.1), (-0.27, 0, -0.75), 0.24, 0.18))
        if looks.hair == "bun":
            grown.append(self._head((-0.48, 0, 0.16), (-0.52, 0, 0.14), 0.15, 0.13))
        worn = [(self._shell(*grown), f"hair_{looks.hair_colour}")]
        if looks.hair == "hat":
            worn = [(self._shell(grown[1]), f"hair_{looks.hair_colour}")]
            cap = self._head((-0.12, 0, 0.15), (0.05, 0, 0.19), 0.385, 0.37)
            peak = self._head((0.40, 0, 0.15), (0.50, 0, 0.11), 0.06, 0.05)
            worn.append((self._shell(cap, peak), f"cloth_{looks.bag_colour}"))
        return worn

    def helmet(self) -> Flesh:
        """What covers the top of the head."""
        return self._shell(self._head((-0.16, 0, 0.14), (0.14, 0, 0.17), 0.43, 0.38))

    def chin_guard(self) -> Flesh:
        """What makes a helmet one of a motorcyclist."""
        nape = self._head((-0.16, 0, 0.10), (-0.12, 0, -0.22), 0.42, 0.36)
        cheeks = [
            self._head((-0.05, y, -0.2), (0.3, 0.7 * y, -0.3), 0.25, 0.18) for y in (0.2, -0.2)
        ]
        return self._shell(nape, *cheeks)

    def visor(self) -> Flesh:
        """Over the face, inside the rims of the helmet."""
        return self._shell(self._head((0.12, 0, 0.05), (0.2, 0, -0.05), 0.36, 0.30))

    def hands(self, top: str) -> Flesh:
        """Hands, with bare arms under short sleeves."""
        chains: list[Chain] = []
        for left in (1, -1):
            palm = self._along(Joint.ELBOW, Joint.HAND, left, 0.94)
            tip = self._along(Joint.ELBOW, Joint.HAND, left, 1.30)
            bone = bone_of(Bone.FOREARM, left)
            arm = self._cone(palm, tip, 0.021, 0.016, bone)
            chains.append((arm,))
            if top == "shirt":
                upper = self._along(Joint.SHOULDER, Joint.ELBOW, left, 0.5)
                elbow = self.posture[sided(Joint.ELBOW, left)]
                chains[-1] += (
                    self._cone(upper, elbow, 0.024, 0.022, bone_of(Bone.UPPER_ARM, left)),
                    self._cone(elbow, palm, 0.022, 0.018, bone),
                )
        cell = (0.026, 0.026, 0.045) if top == "shirt" else (0.022, 0.022, 0.026)
        return self._flesh(chains, blend=0.001, cell=cell)

    def shoe(self, left: int) -> Flesh:
        """The shoe of the left (1) or right (-1) foot."""
        h, bone = self.build.height_m, bone_of(Bone.FOOT, left)
        ankle, toe = (self.posture[sided(joint, left)] for joint in (Joint.ANKLE, Joint.TOE))
        fore = (toe - ankle) * (1, 1, 0)
        fore = fore / np.linalg.norm(fore)
        down = xyz(z=self.build.ankle_m)
        heel = ankle - down - 0.022 * h * fore + xyz(z=0.022 * h)
        ball = ankle - down + 0.070 * h * fore + xyz(z=0.021 * h)
        tip = ankle - down + 0.104 * h * fore + xyz(z=0.016 * h)
        cones = (
            self._cone(ankle, heel, 0.020, 0.022, bone),
            self._cone(heel, ball, 0.022, 0.021, bone),
            self._cone(ball, tip, 0.021, 0.016, bone),
        )
        return self._flesh([cones], blend=0.001, cell=(0.030, 0.025, 0.024))

    def _shell(self, *cones: Cone) -> Flesh:
        unit = self.build.head_m
        return Flesh((cones,), 0.01, (0.16 * unit, 0.16 * unit, 0.165 * unit), 0.02)

    def bag(self, bag: str) -> Flesh:
        """A backpack, a bag on a strap, or a case in the right hand."""
        if bag == "backpack":
            corners = self._trunk((-0.092, 0.030, 0.22), (-0.100, 0.034, 0.07), 0.042, 0.048)
            return self._flesh([corners], blend=0.01, cell=(0.038, 0.042, 0.056))
        if bag == "shoulder_bag":
            body = self._trunk((-0.03, -0.105, -0.02), (0.03, -0.105, -0.02), 0.035, 0.035)[1:]
            low = self._trunk((-0.03, -0.108, -0.06), (0.03, -0.108, -0.06), 0.035, 0.035)[1:]
            strap = self._trunk((0, -0.072, 0.262), (0, -0.102, 0.0), 0.012, 0.010)[1:]
            return self._flesh([(*body, *low, *strap)], blend=0.01, cell=(0.032, 0.026, 0.038))
        hand = self._along(Joint.ELBOW, Joint.HAND, -1, 1.3)
        h, bone = self.build.height_m, bone_of(Bone.FOREARM, -1)
        corners = (
            self._cone(
                hand + xyz(-0.045 * h, 0, z * h),
                hand + xyz(0.045 * h, 0, z * h),
                0.022,
                0.022,
                bone,
            )
            for z in (-0.035, -0.06, -0.085)
        )
        return self._flesh([tuple(corners)], blend=0.01, cell=(0.03, 0.02, 0.03))

    def _sleeve(self, left: int, *, short: bool) -> Chain:
        thick = 0.5 + 0.5 * self.build.stout
        if short:
            elbow = self._along(Joint.SHOULDER, Joint.ELBOW, left, 0.62)
            shoulder = self.posture[sided(Joint.SHOULDER, left)]
            arm = bone_of(Bone.UPPER_ARM, left)
            return (self._cone(shoulder, elbow, 0.033 * thick, 0.030 * thick, arm),)
        wrist = self._along(Joint.ELBOW, Joint.HAND, left, 0.9)
        return (
            self._limb(
                Joint.SHOULDER, Joint.ELBOW, left, 0.033 * thick, 0.028 * thick, Bone.UPPER_ARM
            ),
            self._cone(
                self.posture[sided(Joint.ELBOW, left)],
                wrist,
                0.028 * thick,
                0.023 * thick,
                bone_of(Bone.FOREARM, left),
            ),
        )

    def _leg(self, left: int, bottom: str) -> Chain:
        thick = 0.7 + 0.3 * self.build.stout
        if bottom == "skirt":
            hidden = self._along(Joint.HIP, Joint.KNEE, left, 0.5)
            knee = self.posture[sided(Joint.KNEE, left)]
            thigh = self._cone(hidden, knee, 0.040, 0.033, bone_of(Bone.THIGH, left))
            return (thigh, self._limb(Joint.KNEE, Joint.ANKLE, left, 0.033, 0.024, Bone.SHIN))
        thigh = self._limb(Joint.HIP, Joint.KNEE, left, 0.052 * thick, 0.038 * thick, Bone.THIGH)
        if bottom == "shorts":
            return (thigh,)
        return (thigh, self._limb(Joint.KNEE, Joint.ANKLE, left, 0.038 * thick, 0.031, Bone.SHIN))

    def _coat_tail(self, left: int) -> Chain:
        hip = self.posture[sided(Joint.HIP, left)] * (1, 0.8, 1)
        knee = self._along(Joint.HIP, Joint.KNEE, left, 0.8)
        return (self._cone(hip, knee, 0.064, 0.070, bone_of(Bone.THIGH, left)),)

    def _flesh(
        self,
        chains: list[Chain],
        *,
        blend: float,
        cell: tuple[float, float, float],
        hems: tuple[float, ...] = (),
    ) -> Flesh:
        """Cells shrink less than the figure does, or children would have the finest skin."""
        h = self.build.height_m
        scale = _COARSENESS * (0.5 + 0.5 * h / 1.75)
        x, y, z = (scale * edge for edge in cell)
        return Flesh(tuple(chains), blend * h, (x, y, z), 0.012 * h, hems)

    def _stacked(self, sections: tuple[Section, ...]) -> Chain:
        """Cones of the trunk from section to section."""
        stout = self.build.stout
        return tuple(
            Cone(
                self._on_trunk(low.fore, 0, low.up),
                self._on_trunk(high.fore, 0, high.up),
                (low.deep * stout * self.build.height_m, high.deep * stout * self.build.height_m),
                Bone.TRUNK,
                wide=(low.wide / low.deep + high.wide / high.deep) / 2,
            )
            for low, high in pairwise(sections)
        )

    def _trunk(
        self, start: tuple[float, float, float], end: tuple[float, float, float], *radii: float
    ) -> Chain:
        """A cone of the trunk and its mirror image; places are fore, left and up of the pelvis."""
        scale = self.build.height_m
        stout = self.build.stout
        thick = (radii[0] * scale * stout, radii[1] * scale * stout)
        return tuple(
            Cone(
                self._on_trunk(start[0], left * start[1], start[2]),
                self._on_trunk(end[0], left * end[1], end[2]),
                thick,
                Bone.TRUNK,
            )
            for left in (1, -1)
        )

    def _on_trunk(self, fore: float, aside: float, high: float) -> Floats:
        up = self._up()
        across = xyz(y=1.0)
        spine = np.linalg.norm(self.posture[Joint.NECK] - self.posture[Joint.PELVIS])
        scale = self.build.height_m
        away = scale * (fore * np.cross(across, up) + aside * across)
        return self.posture[Joint.PELVIS] + away + high / 0.27 * spine * up

    def _up(self) -> Floats:
        spine = self.posture[Joint.NECK] - self.posture[Joint.PELVIS]
        return spine / np.linalg.norm(spine)

    def _head(
        self, start: tuple[float, float, float], end: tuple[float, float, float], *radii: float
    ) -> Cone:
        unit = self.build.head_m
        middle = self.posture[Joint.HEAD]
        first, last = middle + unit * np.array(start), middle + unit * np.array(end)
        return Cone(first, last, (radii[0] * unit, radii[1] * unit), Bone.HEAD)

    def _limb(
        self, start: Joint, end: Joint, left: int, thick: float, thin: float, bone: Bone
    ) -> Cone:
        first, last = (self.posture[sided(joint, left)] for joint in (start, end))
        return self._cone(first, last, thick, thin, bone_of(bone, left))

    def _along(self, start: Joint, end: Joint, left: int, share: float) -> Floats:
        first, last = (self.posture[sided(joint, left)] for joint in (start, end))
        return first + share * (last - first)

    def _cone(self, start: Floats, end: Floats, thick: float, thin: float, bone: int) -> Cone:
        h = self.build.height_m
        return Cone(start, end, (thick * h, thin * h), bone)
