"""Those who sit on bicycles and motorcycles: hands on the bars, feet on pedals or pegs."""

from dataclasses import dataclass

import numpy as np
from advercity_dsl import Looks

from advercity.randomness import generator
from advercity.world.bodies import headwear
from advercity.world.bodies.clothes import garments
from advercity.world.bodies.figure import Figure
from advercity.world.bodies.puppets import Limb, fleshed
from advercity.world.bodies.skeleton import JOINTS, Build, Joint, bent, sided
from advercity.world.materials import PAINT
from advercity.world.shapes import Floats, xyz

_TRUNK, _NECK = 0.27, 0.045
_ARM = 0.172, 0.166
"""Lengths in heights of the figure, as in a standing one."""
_HELMET = 0.08
"""How far it rises above the head, in heights of the head."""
_REACHED, _MOST_LEAN = 0.94, np.radians(50.0)
_COATS = ("cloth_red", "cloth_light", "cloth_blue", "cloth_dark", "cloth_yellow", "cloth_green")


@dataclass(frozen=True, eq=False)
class Seat:
    """What a rider sits on and holds on to.

    Attributes:
        pelvis: (3,) over the saddle.
        grip: (3,) the left one, metres.
        top_m: Height of the rider's helmet.
        lean_rad: Of the trunk, forward; more if the hands do not reach the grips.
    """

    pelvis: Floats
    grip: Floats
    top_m: float
    lean_rad: float


@dataclass(frozen=True, eq=False)
class Rider:
    """A figure that fits its seat.

    Attributes:
        build: Its helmet is where it has to be.
        trunk: (2, 3) pelvis and neck.
        grip: (3,) the left one.
    """

    build: Build
    trunk: Floats
    grip: Floats

    @staticmethod
    def on(seat: Seat) -> "Rider":
        """The rider of a seat."""
        leans = np.arange(seat.lean_rad, _MOST_LEAN, np.radians(1.0))
        riders = [Rider.leaning(seat, float(lean_rad)) for lean_rad in leans]
        return next((rider for rider in riders if rider.holds_on()), riders[-1])

    @staticmethod
    def leaning(seat: Seat, lean_rad: float) -> "Rider":
        """The rider of a seat who leans so far, whether the hands reach or not."""
        build = _build(seat, lean_rad)
        up = xyz(np.sin(lean_rad), 0, np.cos(lean_rad))
        neck = seat.pelvis + _TRUNK * build.height_m * up
        return Rider(build, np.stack([seat.pelvis, neck]), seat.grip)

    def holds_on(self) -> bool:
        """Whether the hands reach the grips."""
        reach = float(np.linalg.norm(self.shoulder(1) - self.grip))
        return reach < _REACHED * sum(_ARM) * self.build.height_m

    def shoulder(self, left: int) -> Floats:
        """The left (1) or right (-1) shoulder (3,)."""
        return self.trunk[1] + self.build.height_m * xyz(-0.005, 0.098 * left, -0.028)


def _build(seat: Seat, lean_rad: float) -> Build:
    """The figure whose helmet is where it has to be."""
    height_m = 1.7
    for _ in range(4):
        head = (0.97 + _HELMET) * Build(height_m).head_m / height_m
        height_m = (seat.top_m - seat.pelvis[2]) / (_TRUNK * np.cos(lean_rad) + _NECK + head)
    return Build(float(height_m))


def riding(rider: Rider, soles: Floats) -> Floats:
    """Postures (n, joints, 3) of a rider.

    Args:
        rider: Who sits there.
        soles: (n, 2, 3) what the balls of the left and right foot rest on.
    """
    build = rider.build
    h = build.height_m
    pelvis, neck = rider.trunk
    postures = np.zeros((len(soles), JOINTS, 3))
    postures[:, Joint.PELVIS], postures[:, Joint.NECK] = pelvis, neck
    postures[:, Joint.HEAD] = neck + xyz(0.03 * h, 0, _NECK * h + 0.5 * build.head_m)
    for row, left in enumerate((1, -1)):
        shoulder = rider.shoulder(left)
        hand = rider.grip * (1, left, 1)
        elbow = bent(shoulder, hand, _ARM[0] * h, _ARM[1] * h, (-0.3, 0.5 * left, -0.8))
        hip = pelvis + h * xyz(0, 0.05 * left, -0.02)
        ankle = soles[:, row] + h * xyz(-0.072, 0, 0.046)
        half = build.leg_m / 2
        knee = bent(np.broadcast_to(hip, ankle.shape), ankle, half, half, (1.0, 0.25 * left, 0.4))
        toe = soles[:, row] + h * xyz(0.012, 0.004 * left, 0.02)
        places = (shoulder, elbow, hand, hip, knee, ankle, toe)
        for joint, place in zip(list(Joint)[Joint.SHOULDER :], places, strict=True):
            postures[:, sided(joint, left)] = place
    return postures


def dressed(
    posture: Floats, build: Build, looks: Looks, helmet: str, *, key: str, visor: bool = False
) -> list[Limb]:
    """A rider in some posture.

    Args:
        posture: Of the joints.
        build: Of the figure.
        looks: What they wear, but for the colour of the top.
        helmet: Material of the helmet.
        key: What the colour of the top is drawn for.
        visor: Whether the helmet is one for motorcycles.
    """
    figure = Figure(posture, build)
    coat = str(generator("rider", key).choice(_COATS))
    worn = [
        (flesh, coat if material == PAINT else material)
        for flesh, material in garments(posture, build, looks)
    ]
    worn.append((headwear.helmet(figure), helmet))
    if visor:
        worn += [(headwear.chin_guard(figure), helmet), (headwear.visor(figure), "glass")]
    return [fleshed(flesh, material) for flesh, material in worn]
