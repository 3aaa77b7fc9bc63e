"""Builds riders of bicycles and motorcycles: hands on the grips, feet on pedals or pegs."""

from dataclasses import dataclass

import numpy as np
from advercity_dsl import PedestrianAppearance

from advercity.assets import clothing
from advercity.assets.rigged_bodies import SkinnedSurface, skin_soft_shape
from advercity.assets.skeleton import (
    JOINT_COUNT,
    BodyBuild,
    Joint,
    joint_on_side,
    solve_middle_joint,
)
from advercity.assets.soft_shapes import Figure
from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import xyz
from advercity.materials import ACTOR_PAINT
from advercity.randomness import create_generator

_TRUNK_LENGTH, _NECK_LENGTH = 0.27, 0.045
_ARM_LENGTHS = 0.172, 0.166
"""Lengths in heights of the figure, as in its standing posture."""
_HELMET_RISE = 0.08
"""Thickness of the helmet on top of the head, in heights of the head."""
_MAX_ARM_EXTENSION, _MAX_LEAN_RAD = 0.94, np.radians(50.0)
_COAT_MATERIALS = [f"cloth_{name}" for name in ("red", "light", "blue", "dark", "yellow", "green")]


@dataclass(frozen=True, eq=False)
class Seat:
    """Constraints of a two-wheeler on its rider.

    Attributes:
        pelvis: (3,) point over the saddle, metres.
        grip: (3,) left grip.
        top_m: Height of the rider's helmet above the ground.
        lean_rad: Forward lean of the trunk; riders lean more if they cannot reach the grips.
    """

    pelvis: Float64Array
    grip: Float64Array
    top_m: float
    lean_rad: float


@dataclass(frozen=True, eq=False)
class Rider:
    """A figure meeting the constraints of its seat.

    Attributes:
        build: Proportions at which the helmet is at its declared height.
        trunk: (2, 3) pelvis and neck.
        grip: (3,) left grip.
    """

    build: BodyBuild
    trunk: Float64Array
    grip: Float64Array

    @staticmethod
    def from_seat(seat: Seat) -> "Rider":
        """Find the least lean to reach the grips, in whole degrees more than the seat's."""
        leans = np.arange(seat.lean_rad, _MAX_LEAN_RAD, np.radians(1.0))
        riders = [Rider.with_lean(seat, float(lean_rad)) for lean_rad in leans]
        return next((rider for rider in riders if rider.can_reach_grips()), riders[-1])

    @staticmethod
    def with_lean(seat: Seat, lean_rad: float) -> "Rider":
        """Fit a rider with a given lean, whether the hands reach the grips or not."""
        build = _solve_build(seat, lean_rad)
        up = xyz(np.sin(lean_rad), 0, np.cos(lean_rad))
        neck = seat.pelvis + _TRUNK_LENGTH * build.height_m * up
        return Rider(build, np.stack([seat.pelvis, neck]), seat.grip)

    def can_reach_grips(self) -> bool:
        """Return whether slightly bent arms are long enough for the grips."""
        distance = float(np.linalg.norm(self.compute_shoulder(1) - self.grip))
        return distance < _MAX_ARM_EXTENSION * sum(_ARM_LENGTHS) * self.build.height_m

    def compute_shoulder(self, left: int) -> Float64Array:
        """Compute the left (1) or right (-1) shoulder (3,)."""
        return self.trunk[1] + self.build.height_m * xyz(-0.005, 0.098 * left, -0.028)


def _solve_build(seat: Seat, lean_rad: float) -> BodyBuild:
    """Solve for the height of the figure whose helmet is at the top of the seat's box."""
    height_m = 1.7
    # The head shrinks less than the body, so a few rounds of substitution are needed.
    for _ in range(4):
        head = (0.97 + _HELMET_RISE) * BodyBuild(height_m).head_m / height_m
        heights = _TRUNK_LENGTH * np.cos(lean_rad) + _NECK_LENGTH + head
        height_m = (seat.top_m - seat.pelvis[2]) / heights
    return BodyBuild(float(height_m))


def compute_riding_postures(rider: Rider, soles: Float64Array) -> Float64Array:
    """Compute postures (n, joints, 3) of a rider on its seat.

    Soles (n, 2, 3) are points under the balls of the left and right foot.
    """
    build = rider.build
    h = build.height_m
    pelvis, neck = rider.trunk
    postures = np.zeros((len(soles), JOINT_COUNT, 3))
    postures[:, Joint.PELVIS], postures[:, Joint.NECK] = pelvis, neck
    postures[:, Joint.HEAD] = neck + xyz(0.03 * h, 0, _NECK_LENGTH * h + 0.5 * build.head_m)
    for row, left in enumerate((1, -1)):
        shoulder = rider.compute_shoulder(left)
        hand = rider.grip * (1, left, 1)
        elbow = solve_middle_joint(
            shoulder, hand, _ARM_LENGTHS[0] * h, _ARM_LENGTHS[1] * h, (-0.3, 0.5 * left, -0.8)
        )
        hip = pelvis + h * xyz(0, 0.05 * left, -0.02)
        ankle = soles[:, row] + h * xyz(-0.072, 0, 0.046)
        half = build.leg_m / 2
        knee = solve_middle_joint(
            np.broadcast_to(hip, ankle.shape), ankle, half, half, (1.0, 0.25 * left, 0.4)
        )
        toe = soles[:, row] + h * xyz(0.012, 0.004 * left, 0.02)
        places = (shoulder, elbow, hand, hip, knee, ankle, toe)
        for joint, place in zip(list(Joint)[Joint.SHOULDER :], places, strict=True):
            postures[:, joint_on_side(joint, left)] = place
    return postures


def build_rider(
    posture: Float64Array,
    build: BodyBuild,
    looks: PedestrianAppearance,
    helmet_material: str,
    *,
    key: str,
    has_visor: bool = False,
) -> list[SkinnedSurface]:
    """Build a rider in a posture (joints, 3), with a helmet; the top's colour is drawn by `key`.

    A helmet with a visor, as for motorcycles, has a chin guard, too.
    """
    figure = Figure(posture, build)
    coat = str(create_generator("rider", key).choice(_COAT_MATERIALS))
    # Paint is the machine's, so the top has a material of its own.
    layers = [
        (shape, coat if material == ACTOR_PAINT else material)
        for shape, material in clothing.build_garments(posture, build, looks)
    ]
    layers.append((clothing.build_helmet(figure), helmet_material))
    if has_visor:
        layers += [
            (clothing.build_chin_guard(figure), helmet_material),
            (clothing.build_visor(figure), "glass"),
        ]
    return [skin_soft_shape(shape, material) for shape, material in layers]
