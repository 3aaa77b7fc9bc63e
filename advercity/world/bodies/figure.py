"""A figure in a posture: places on its skeleton, and the round cones that flesh is made of.

Lengths are shares of the figure's height, those of the head shares of the head's height.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from advercity.world.bodies.flesh import Cone, Flesh
from advercity.world.bodies.skeleton import Bone, Build, Joint, bone_of, sided
from advercity.world.shapes import Floats, xyz

Chain = tuple[Cone, ...]
_COARSENESS = 1.3
"""Times the cells that a close-up would need."""


class Section(NamedTuple):
    """An ellipse across the trunk, from the pelvis upward."""

    up: float
    fore: float
    deep: float
    """Half its depth."""
    wide: float


@dataclass(frozen=True, eq=False)
class Figure:
    """A posture and a build, on which garments are put.

    Attributes:
        posture: (joints, 3) where every joint is, metres.
        build: How tall and stout it is.
    """

    posture: Floats
    build: Build

    def flesh(
        self,
        chains: list[Chain],
        *,
        blend: float,
        cell: tuple[float, float, float],
        hems: tuple[float, ...] = (),
    ) -> Flesh:
        """Chains of cones with one skin, in shares of the height.

        Cells shrink less than the figure does, or children would have the finest skin.
        """
        h = self.build.height_m
        scale = _COARSENESS * (0.5 + 0.5 * h / 1.75)
        x, y, z = (scale * edge for edge in cell)
        return Flesh(tuple(chains), blend * h, (x, y, z), 0.012 * h, hems)

    def shell(self, *cones: Cone) -> Flesh:
        """What covers the head, in one piece."""
        unit = self.build.head_m
        return Flesh((cones,), 0.01, (0.16 * unit, 0.16 * unit, 0.165 * unit), 0.02)

    def cone(self, start: Floats, end: Floats, thick: float, thin: float, bone: int) -> Cone:
        """Between places (3,) in metres, so thick there; radii are shares of the height."""
        h = self.build.height_m
        return Cone(start, end, (thick * h, thin * h), bone)

    def limb(
        self, start: Joint, end: Joint, left: int, thick: float, thin: float, bone: Bone
    ) -> Cone:
        """From joint to joint on the left (1) or right (-1); radii are shares of the height."""
        first, last = (self.posture[sided(joint, left)] for joint in (start, end))
        return self.cone(first, last, thick, thin, bone_of(bone, left))

    def along(self, start: Joint, end: Joint, left: int, share: float) -> Floats:
        """The place (3,) at a share of the way between joints on the left (1) or right (-1)."""
        first, last = (self.posture[sided(joint, left)] for joint in (start, end))
        return first + share * (last - first)

    def up(self) -> Floats:
        """Unit vector (3,) along the spine."""
        spine = self.posture[Joint.NECK] - self.posture[Joint.PELVIS]
        return spine / np.linalg.norm(spine)

    def on_trunk(self, fore: float, aside: float, high: float) -> Floats:
        """The place (3,), in metres, so many heights fore, left and up of the pelvis."""
        up = self.up()
        across = xyz(y=1.0)
        spine = np.linalg.norm(self.posture[Joint.NECK] - self.posture[Joint.PELVIS])
        scale = self.build.height_m
        away = scale * (fore * np.cross(across, up) + aside * across)
        return self.posture[Joint.PELVIS] + away + high / 0.27 * spine * up

    def stacked(self, sections: tuple[Section, ...]) -> Chain:
        """Cones of the trunk from section to section."""
        stout = self.build.stout
        return tuple(
            Cone(
                self.on_trunk(low.fore, 0, low.up),
                self.on_trunk(high.fore, 0, high.up),
                (low.deep * stout * self.build.height_m, high.deep * stout * self.build.height_m),
                Bone.TRUNK,
                wide=(low.wide / low.deep + high.wide / high.deep) / 2,
            )
            for low, high in pairwise(sections)
        )

    def trunk(
        self, start: tuple[float, float, float], end: tuple[float, float, float], *radii: float
    ) -> Chain:
        """A cone of the trunk and its mirror image; places are fore, left and up of the pelvis."""
        scale = self.build.height_m
        stout = self.build.stout
        thick = (radii[0] * scale * stout, radii[1] * scale * stout)
        return tuple(
            Cone(
                self.on_trunk(start[0], left * start[1], start[2]),
                self.on_trunk(end[0], left * end[1], end[2]),
                thick,
                Bone.TRUNK,
            )
            for left in (1, -1)
        )

    def on_head(
        self, start: tuple[float, float, float], end: tuple[float, float, float], *radii: float
    ) -> Cone:
        """Between places fore, left and up of the head's middle, in heights of the head."""
        unit = self.build.head_m
        middle = self.posture[Joint.HEAD]
        first, last = middle + unit * np.array(start), middle + unit * np.array(end)
        return Cone(first, last, (radii[0] * unit, radii[1] * unit), Bone.HEAD)
