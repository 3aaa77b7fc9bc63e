"""Builds things moving with a pedestrian: prams, wheelchairs, dogs on a leash.

Places are in metres in the frame of the person: origin on the ground under the standing body, x
ahead. The first bone of an attachment is its frame, which keeps its place to the person.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import ClassVar

import numpy as np

from advercity.assets.rigged_bodies import POSES_PER_CYCLE, SkinnedSurface, attach_to_bone
from advercity.assets.skeleton import compute_segment_transforms, solve_middle_joint
from advercity.assets.soft_shapes import Chain, RoundCone, SoftShape
from advercity.assets.vehicle_parts import (
    SPOKE_COUNT,
    build_round_tyre,
    build_spokes,
    compute_rolling_transforms,
)
from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import TriangleSurface, add_mirror_image, xyz
from advercity.geometry.primitives import (
    box,
    ellipsoid,
    loft_rings,
    revolve_closed_profile,
    revolve_profile,
    tube,
)
from advercity.semantics import Semantic

_FRAME = 0
"""The bone at a fixed place relative to the person."""
WHEELCHAIR_WHEEL_M = 0.30
"""Radius of the large wheels."""
PUSH_RIM_M = 0.26
_PUSH_RIM_Y_M = 0.31
_HANDLE_BEHIND_M, _HANDLE_RISE_M = 0.34, 0.45
"""Places of a wheelchair's handles behind the pelvis and above the seat."""
_FOOT_PLATE_M = 0.12
_SEAT_BELOW_PELVIS_M = 0.115
_DOG_STRIDES = 2
"""Strides of a dog in one of the person."""
_DOG_STANCE = 0.55
"""Fraction of a dog's stride in which a paw is on the ground."""
_LEG_M = 0.195
"""Length of each half of a dog's leg."""
_PAW_M = 0.036
"""Radius of a paw."""

Piece = tuple[TriangleSurface, int, str]
"""A surface, its bone, and its material."""


@dataclass(frozen=True, eq=False)
class Attachment:
    """Something moving with a person.

    Attributes:
        limbs: Surfaces with weights on bones of its own.
        bone_transforms: (poses, bones, 3, 4) from rest to each pose of the person's gait.
    """

    limbs: list[SkinnedSurface]
    bone_transforms: Float64Array

    def carry(self, limbs: Sequence[SkinnedSurface]) -> "Attachment":
        """Return it with a person who sits in it and does not move."""
        bones = self.bone_transforms.shape[1]
        still = [
            attach_to_bone(limb.surface, _FRAME, bones, limb.material, limb.semantic)
            for limb in limbs
        ]
        return Attachment([*self.limbs, *still], self.bone_transforms)


def _make_attachment(pieces: Sequence[Piece], transforms: Sequence[Float64Array]) -> Attachment:
    """Make one of rigid pieces; `transforms` (poses, 3, 4) are of bones after the frame."""
    still = np.broadcast_to(np.eye(3, 4), (POSES_PER_CYCLE, 3, 4))
    bones = np.stack([still, *transforms], axis=1)
    limbs = [
        attach_to_bone(surface, bone, bones.shape[1], material, Semantic.PEDESTRIAN)
        for surface, bone, material in pieces
    ]
    return Attachment(limbs, bones)


def build_pram(bar: Float64Array, cloth: str) -> Attachment:
    """Build a pram with a carrycot whose handlebar has its middle at `bar` (3,)."""
    rear, front = xyz(bar[0] + 0.17, 0.25, 0.13), xyz(bar[0] + 0.77, 0.23, 0.10)
    side = xyz(bar[0], 0.22, bar[2])
    cot_rear, cot_front = xyz(bar[0] + 0.14, 0.23, 0.63), xyz(bar[0] + 0.80, 0.22, 0.60)
    pieces: list[Piece] = [
        (add_mirror_image(tube([side, cot_rear, front + xyz(y=-0.02)], 0.013)), _FRAME, "metal"),
        (add_mirror_image(tube([cot_front, rear + xyz(y=-0.02)], 0.013)), _FRAME, "metal"),
        (tube([side, side * (1, -1, 1)], 0.018), _FRAME, "black_plastic"),
        *_build_carrycot(xyz(bar[0] + 0.10, z=0.0), cloth),
    ]
    for hub in (rear, front):
        pieces.append((tube([hub * (1, -1, 1), hub], 0.012, sides=6), _FRAME, "metal"))
        pieces += _build_disc_wheel(hub)
    tray = box((rear[0] - 0.05, -0.18, 0.20), (front[0] - 0.02, 0.18, 0.30))
    return _make_attachment([*pieces, (tray, _FRAME, cloth)], [])


def _build_carrycot(foot: Float64Array, cloth: str) -> Iterator[Piece]:
    """Build the cot, its cover and its hood, from the end next to the person at `foot` (3,)."""
    stations = ((0.0, 0.12), (0.03, 0.19), (0.15, 0.22), (0.58, 0.23), (0.74, 0.19), (0.77, 0.12))
    angle = 2 * np.pi * np.arange(14) / 14
    rim = 0.80
    rings = [
        foot
        + np.column_stack(
            [
                np.full(14, x),
                half * np.cos(angle),
                np.minimum(0.76 + 0.20 * np.sin(angle), rim),
            ]
        )
        for x, half in stations
    ]
    yield loft_rings(np.stack(rings)), _FRAME, cloth
    yield ellipsoid(foot + xyz(0.30, z=rim), (0.27, 0.19, 0.05)), _FRAME, "cloth_light"
    yield _build_hood(foot + xyz(0.50, z=rim - 0.02), (0.28, 0.235)), _FRAME, cloth


def _build_hood(pivot: Float64Array, radii: tuple[float, float]) -> TriangleSurface:
    """Build a quarter of a shell over the far end, open to the person; radii along and across."""
    turn, across = np.radians(np.linspace(0.0, 112.0, 8)), np.pi * np.arange(11)[:, None] / 10
    ahead = radii[0] * np.sin(across)
    outside = np.stack(
        np.broadcast_arrays(np.cos(turn) * ahead, radii[1] * np.cos(across), np.sin(turn) * ahead),
        axis=-1,
    )
    # Cross-sections shrink to a line at both pivots: no cap spans the opening.
    return loft_rings(pivot + np.concatenate([outside, 0.93 * outside[:, ::-1]], axis=1))


def _build_disc_wheel(hub: Float64Array) -> Iterator[Piece]:
    """Build a pair of wheels without spokes, which look the same however far they have rolled."""
    radius = hub[2]
    disc = [(0.75 * radius, -0.012), (0.75 * radius, 0.012), (0.3 * radius, 0.02)]
    yield add_mirror_image(build_round_tyre(hub, radius, 0.02)), _FRAME, "rubber"
    yield add_mirror_image(revolve_profile(disc, hub)), _FRAME, "metal"


@dataclass(frozen=True)
class Wheelchair:
    """A wheelchair whose sitter has the pelvis at `pelvis_x_m`, with a seat of a height."""

    pelvis_x_m: float
    seat_z_m: float
    sole_z_m: ClassVar[float] = _FOOT_PLATE_M

    @property
    def pelvis(self) -> Float64Array:
        """Pelvis (3,) of its sitter."""
        return xyz(self.pelvis_x_m, z=self.seat_z_m + _SEAT_BELOW_PELVIS_M)

    @property
    def handle(self) -> Float64Array:
        """Left handle (3,)."""
        return xyz(self.pelvis_x_m - _HANDLE_BEHIND_M, 0.21, self.seat_z_m + _HANDLE_RISE_M)

    @property
    def _hub(self) -> Float64Array:
        return xyz(self.pelvis_x_m - 0.03, 0.265, WHEELCHAIR_WHEEL_M)

    def compute_rim_places(self, angle: Float64Array, left: int) -> Float64Array:
        """Compute places (n, 3) on a push rim at angles (n,) ahead of its top."""
        x, z = PUSH_RIM_M * np.sin(angle), PUSH_RIM_M * np.cos(angle)
        hub = self._hub * (1, 0, 1) + xyz(y=_PUSH_RIM_Y_M * left)
        return hub + np.column_stack([x, np.zeros(len(angle)), z])

    def build(self, cycle_m: float, cloth: str) -> Attachment:
        """Build the chair, whose wheels roll by about `cycle_m` in a cycle of the gait."""
        # A wheel must look the same after a cycle, so it turns by whole spokes.
        spokes = round(SPOKE_COUNT * cycle_m / (2 * np.pi * WHEELCHAIR_WHEEL_M))
        turns = spokes / SPOKE_COUNT * np.arange(POSES_PER_CYCLE) / POSES_PER_CYCLE
        hub = self._hub
        rim = [(PUSH_RIM_M + 0.01 * np.cos(a), 0.01 * np.sin(a)) for a in np.arange(5) * 1.2566]
        wheel = [
            (build_round_tyre(hub, WHEELCHAIR_WHEEL_M, 0.016), "rubber"),
            (revolve_closed_profile(rim, hub + xyz(y=0.045), sides=24), "metal"),
            *((spoke, "metal") for spoke in build_spokes(hub, WHEELCHAIR_WHEEL_M)),
        ]
        pieces = [(add_mirror_image(surface), 1, material) for surface, material in wheel]
        rolling = compute_rolling_transforms(hub * (1, 0, 1), turns)
        return _make_attachment(
            [*self._build_frame(), *self._build_seat(cloth), *pieces], [rolling]
        )

    def _build_frame(self) -> Iterator[Piece]:
        x, z, y = self.pelvis_x_m, self.seat_z_m - 0.02, 0.21
        foot = xyz(x + 0.56, 0.15, _FOOT_PLATE_M - 0.02)
        caster = xyz(x + 0.34, 0.23, 0.09)
        back = [self.handle + xyz(0.09), xyz(x - 0.21, y, z), xyz(x - 0.17, y, 0.22)]
        rails = [xyz(x - 0.21, y, z), xyz(x + 0.36, y, z), foot + xyz(-0.06), foot + xyz(0.02)]
        low = [xyz(x - 0.17, y, 0.22), xyz(x + 0.34, y, 0.22)]
        fork = [caster + xyz(y=-0.02), xyz(x + 0.33, y, 0.22), xyz(x + 0.33, y, z)]
        arm = [xyz(x - 0.24, y, z + 0.22), xyz(x + 0.10, y, z + 0.22), xyz(x + 0.16, y, z)]
        for line in (back, rails, low, fork, arm):
            yield add_mirror_image(tube(line, 0.012, sides=6)), _FRAME, "metal"
        grip = tube([self.handle, self.handle + xyz(0.10)], 0.017, sides=6)
        yield add_mirror_image(grip), _FRAME, "black_plastic"
        pad = box(xyz(x - 0.16, y - 0.03, z + 0.22), xyz(x + 0.10, y + 0.03, z + 0.25))
        yield add_mirror_image(pad), _FRAME, "black_plastic"
        plate = box(foot + xyz(-0.06, -0.09, 0), foot + xyz(0.09, 0.05, 0.02))
        yield add_mirror_image(plate), _FRAME, "black_plastic"
        yield tube([self._hub * (1, -1, 1), self._hub], 0.015, sides=6), _FRAME, "metal"
        yield from _build_disc_wheel(caster)

    def _build_seat(self, cloth: str) -> Iterator[Piece]:
        x, z = self.pelvis_x_m, self.seat_z_m
        yield box((x - 0.20, -0.21, z - 0.05), (x + 0.32, 0.21, z)), _FRAME, cloth
        foot, top = xyz(x - 0.20, z=z), xyz(x - 0.26, z=z + 0.40)
        rings = [
            place
            + np.array(
                [(dx, y, 0.0) for dx, y in ((0, 0.21), (-0.03, 0.21), (-0.03, -0.21), (0, -0.21))]
            )
            for place in (foot, top)
        ]
        yield loft_rings(np.stack(rings)), _FRAME, cloth


class _DogBone(IntEnum):
    """Bones of a dog, after the frame, which is its trunk; the lower half of a leg follows."""

    FRONT_LEFT = 1
    FRONT_RIGHT = 3
    HIND_LEFT = 5
    HIND_RIGHT = 7


_DOG_BONE_SIDES = (0, 1, 1, -1, -1, 1, 1, -1, -1)
_FRONT_LEGS = (_DogBone.FRONT_LEFT, _DogBone.FRONT_RIGHT)
_TROT_PHASES = {
    _DogBone.FRONT_LEFT: 0.0,
    _DogBone.HIND_RIGHT: 0.0,
    _DogBone.FRONT_RIGHT: 0.5,
    _DogBone.HIND_LEFT: 0.5,
}
"""Diagonal legs move together."""


def build_dog(at: Float64Array, hand: Float64Array, stride_m: float, fur: str) -> Attachment:
    """Build a dog trotting at a person's stride, trunk over `at` (3,), leash to a hand (3,)."""
    legs = {bone: _compute_leg(bone, stride_m / _DOG_STRIDES) for bone in _DogBone}
    bones = 1 + 2 * len(legs)
    shape = _shape_dog({bone: rest for bone, (rest, _) in legs.items()})
    surface = shape.build_surface()
    weights = shape.compute_bone_weights(surface.vertices, _DOG_BONE_SIDES)
    placed = TriangleSurface(surface.vertices + at, surface.triangles, surface.normals)
    collar = at + xyz(0.33, z=0.53)
    middle = 0.5 * (hand + collar) - xyz(z=0.05)
    pieces: list[Piece] = [
        (tube([hand, middle, collar], 0.006, sides=4), _FRAME, "rubber"),
        (tube([collar + xyz(-0.02, z=-0.02), collar + xyz(0.0, z=0.02)], 0.075), _FRAME, "rubber"),
        (ellipsoid(at + xyz(0.635, z=0.615), (0.02, 0.02, 0.018), sides=6), _FRAME, "rubber"),
        *(
            (ellipsoid(at + xyz(0.525, y, 0.695), (0.012, 0.012, 0.014), sides=6), _FRAME, "rubber")
            for y in (0.045, -0.045)
        ),
    ]
    ends = np.array([(0, 1), (1, 2)])
    transforms: list[Float64Array] = []
    for rest, postures in legs.values():
        moved = compute_segment_transforms(rest + at, postures + at, ends).astype(np.float64)
        transforms += [moved[:, 0], moved[:, 1]]
    rigid = _make_attachment(pieces, transforms)
    skinned = SkinnedSurface(placed, weights[:, :bones], fur, Semantic.PEDESTRIAN)
    return Attachment([*rigid.limbs, skinned], rigid.bone_transforms)


def _compute_leg(bone: _DogBone, stride_m: float) -> tuple[Float64Array, Float64Array]:
    """Compute hip, middle joint and paw of a leg at rest (3, 3), and trotting (poses, 3, 3)."""
    is_front = bone in _FRONT_LEGS
    left = 1 if bone in (_DogBone.FRONT_LEFT, _DogBone.HIND_LEFT) else -1
    hip = xyz(0.22 if is_front else -0.27, 0.07 * left, 0.39)
    phase = (_DOG_STRIDES * np.arange(POSES_PER_CYCLE) / POSES_PER_CYCLE + _TROT_PHASES[bone]) % 1.0
    reach_m = _DOG_STANCE * stride_m / 2
    swing = np.clip((phase - _DOG_STANCE) / (1.0 - _DOG_STANCE), 0.0, 1.0)
    eased = swing**2 * (3.0 - 2.0 * swing)
    ahead = np.where(phase < _DOG_STANCE, reach_m - stride_m * phase, reach_m * (2 * eased - 1.0))
    lift = 0.06 * np.sin(np.pi * swing) ** 2
    paws = hip * (1, 1, 0) + np.column_stack([ahead, np.zeros(len(phase)), _PAW_M + lift])
    paws = np.concatenate([[hip * (1, 1, 0) + xyz(z=_PAW_M)], paws])
    hips = np.broadcast_to(hip, paws.shape)
    bend = (-1.0 if is_front else 1.0, 0.0, 0.0)
    legs = np.stack([hips, solve_middle_joint(hips, paws, _LEG_M, _LEG_M, bend), paws], axis=1)
    return legs[0], legs[1:]


def _shape_dog(legs: dict[_DogBone, Float64Array]) -> SoftShape:
    """Shape a dog at rest over the origin, given the joints (3, 3) of its legs."""

    def cone(start: Float64Array, end: Float64Array, radii: tuple[float, float]) -> RoundCone:
        return RoundCone(start, end, radii, _FRAME)

    trunk: Chain = (
        cone(xyz(0.20, z=0.44), xyz(-0.05, z=0.46), (0.125, 0.11)),
        cone(xyz(-0.05, z=0.46), xyz(-0.26, z=0.47), (0.11, 0.095)),
        cone(xyz(0.24, z=0.48), xyz(0.42, z=0.63), (0.09, 0.065)),
        cone(xyz(0.44, z=0.67), xyz(0.50, z=0.66), (0.082, 0.065)),
        cone(xyz(0.50, z=0.65), xyz(0.61, z=0.615), (0.050, 0.032)),
    )
    tail: Chain = (
        cone(xyz(-0.34, z=0.52), xyz(-0.45, z=0.58), (0.026, 0.02)),
        cone(xyz(-0.45, z=0.58), xyz(-0.53, z=0.68), (0.02, 0.012)),
    )
    ears: list[Chain] = [
        (cone(xyz(0.43, y, 0.735), xyz(0.40, 1.5 * y, 0.65), (0.018, 0.024)),)
        for y in (0.06, -0.06)
    ]
    limbs: list[Chain] = []
    for bone, (hip, middle, paw) in legs.items():
        thick = 0.05 if bone in _FRONT_LEGS else 0.065
        toe = paw + xyz(0.03, z=-0.002)
        limbs.append(
            (
                RoundCone(hip, middle, (thick, 0.032), bone),
                RoundCone(middle, paw, (0.032, 0.022), bone + 1),
                RoundCone(paw, toe, (0.026, 0.024), bone + 1),
            )
        )
    return SoftShape((trunk, tail, *ears, *limbs), 0.03, (0.042, 0.033, 0.042), 0.03)
