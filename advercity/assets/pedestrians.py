"""Builds pedestrians: skinned figures, with and without umbrella, whose boxes set their strides."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from advercity_dsl import Blueprint, PedestrianAppearance

from advercity.assets.attachments import (
    WHEELCHAIR_WHEEL_M,
    Attachment,
    Wheelchair,
    build_dog,
    build_pram,
)
from advercity.assets.clothing import build_garments
from advercity.assets.people.casting import CHILD_MAX_HEIGHT_M
from advercity.assets.people.conversion import RiggedPerson, pose_shells
from advercity.assets.people.shells import Shell
from advercity.assets.rigged_bodies import (
    POSES_PER_CYCLE,
    SkinnedSurface,
    attach_to_bone,
    build_rigged_body,
    compute_box_fit,
    compute_extent,
    scale_body,
    skin_soft_shape,
)
from advercity.assets.skeleton import (
    BONE_SIDES,
    BodyBuild,
    Bone,
    Joint,
    compute_bone_transforms,
    compute_sitting_posture,
    compute_standing_posture,
    compute_walking_postures,
    joint_on_side,
    move_hands,
    raise_right_forearm,
)
from advercity.assets.vehicle_parts import SPOKE_COUNT
from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import Size, TriangleSurface, xyz
from advercity.geometry.primitives import loft_rings, tube
from advercity.materials import ACTOR_PAINT
from advercity.randomness import create_generator
from advercity.semantics import Semantic
from advercity.world import Body, Gait

_STRIDE_LIMITS = 0.05, 0.90
"""Shortest and longest stride, in heights of the figure."""
_TRIAL_STRIDES = 0.4, 0.8
_RIB_COUNT = 8
_RADIUS_M, _RISE_M, _HEAD_CLEARANCE_M = 0.50, 0.17, 0.08
_THICKNESS_M = 0.006
_ATTACHED_STRIDE = 0.64
"""Stride of a person with a pram or a dog, in heights of the figure."""
_HANDS_AHEAD, _BAR_HEIGHT = 0.25, 0.585
"""Places of a pram's handlebar, in heights of the person pushing it."""
_SHIN_SLANT = 0.94
_SEAT_BELOW_HIP_M = 0.085
PUSH_FRACTION = 0.44
"""Fraction of a cycle in which hands turn the wheels of a wheelchair."""
WHEELCHAIR_PUSH_RAD = 2 * np.pi * 6 / SPOKE_COUNT * PUSH_FRACTION
"""Turn of the wheels in a push: six spokes in a cycle, so poses repeat."""
_PUSH_START_RAD = np.radians(-38.0)
_SITTER_TOP = "cloth_grey"
_SITTER_HEIGHT_M = 1.64
_SITTER_LOOKS = PedestrianAppearance(hair_colour="grey", bottom_colour="brown")
_ATTACHMENT_COLOURS = ("dark", "red", "blue", "light", "black")
"""Colours of the prams, wheelchairs and dogs of further people of a blueprint."""
_FURS = {
    "black": "hair_black",
    "dark": "hair_black",
    "light": "hair_blond",
    "white": "cloth_white",
    "grey": "hair_grey",
    "red": "hair_red",
}
"""Furs of dogs by colour; others are brown."""


def build_umbrella(
    posture: Float64Array, build: BodyBuild, canopy_material: str
) -> list[tuple[TriangleSurface, str]]:
    """Build canopy and stick of an umbrella in the right hand, with their materials."""
    hand = posture[joint_on_side(Joint.HAND, -1)]
    above = posture[Joint.HEAD] + xyz(0.03, -0.06, 0.5 * build.head_m + _HEAD_CLEARANCE_M + _RISE_M)
    along = (above - hand) / np.linalg.norm(above - hand)
    stick = tube([hand - 0.12 * along, above + 0.05 * along], 0.009, sides=5)
    return [(_build_canopy(above), canopy_material), (stick, "metal")]


def _build_canopy(top: Float64Array) -> TriangleSurface:
    """Build a closed shell over eight ribs, lower between them, with its top at (3,)."""
    angle = np.pi * np.arange(2 * _RIB_COUNT) / _RIB_COUNT
    sag = np.where(np.arange(2 * _RIB_COUNT) % 2, 0.93, 1.0)
    circle = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(2 * _RIB_COUNT)])
    circle *= sag[:, None]
    radii = np.array([0.04, 0.4, 0.75, 1.0])
    outer = [top + r * _RADIUS_M * circle - xyz(z=_RISE_M * r**2) for r in radii]
    inner = [ring - xyz(z=_THICKNESS_M) for ring in outer[::-1]]
    return loft_rings(np.stack([*outer, *inner]))


@dataclass(frozen=True, eq=False)
class Figure:
    """A dressed person.

    Attributes:
        build: Its proportions.
        rest: Posture (joints, 3) of standing.
        skin: Builds its visible surfaces in a posture.
        umbrella: Colour of an umbrella, or none.
    """

    build: BodyBuild
    rest: Float64Array
    skin: Callable[[Float64Array], list[SkinnedSurface]]
    umbrella: str | None


def build_pedestrian(looks: PedestrianAppearance, blueprint: Blueprint) -> Body:
    """Build a person of soft shapes whose stride, with all its poses, just fills the box."""
    figure = _shape_figure(looks, blueprint.stature_m)
    sitter = _shape_figure(_SITTER_LOOKS, _SITTER_HEIGHT_M)
    return build_walker(figure, looks, blueprint.size, sitter)


def build_people(people: Sequence[RiggedPerson], blueprint: Blueprint) -> Body:
    """Build converted people, the first with the others, whose strides just fill the box."""
    looks = blueprint.looks or PedestrianAppearance()
    figures = [_make_figure(person) for person in people]
    colours = (looks.bag_colour, *(one for one in _ATTACHMENT_COLOURS if one != looks.bag_colour))
    first, *others = (
        build_walker(
            figure,
            looks.model_copy(update={"bag_colour": colours[number % len(colours)]}),
            blueprint.size,
            figures[(number + 1) % len(figures)],
        )
        for number, figure in enumerate(figures)
    )
    return replace(first, others=tuple(others))


def _shape_figure(looks: PedestrianAppearance, height_m: float) -> Figure:
    build = BodyBuild(height_m, looks.stout)
    rest = compute_standing_posture(build)
    return Figure(build, rest, lambda posture: build_figure(posture, build, looks), looks.umbrella)


def _make_figure(person: RiggedPerson) -> Figure:
    def skin(posture: Float64Array) -> list[SkinnedSurface]:
        is_rest = posture is person.posture
        shells = person.shells
        return _skin_shells(shells if is_rest else pose_shells(shells, person.posture, posture))

    return Figure(person.build, person.posture, skin, person.umbrella)


def _skin_shells(shells: Iterable[tuple[Shell, str]]) -> list[SkinnedSurface]:
    return [
        SkinnedSurface(
            TriangleSurface(shell.vertices, shell.triangles, shell.compute_normals()),
            shell.weights,
            material,
            Semantic.PEDESTRIAN,
        )
        for shell, material in shells
    ]


def build_walker(figure: Figure, looks: PedestrianAppearance, size: Size, sitter: Figure) -> Body:
    """Build a body; all its poses, with the things moving with it, just fill the box of `size`.

    The length of the box sets the stride; a standing person is as wide and high as the box.

    Args:
        figure: The person.
        looks: Its attachment, and the colour of it.
        size: The box.
        sitter: The person in the wheelchair, if the figure pushes one.
    """
    if looks.attachment != "none":
        attached = _build_attached_walker(figure, looks, size, sitter)
        return scale_body(attached, *compute_box_fit(attached, size))
    standing = build_rigged_body(figure.skin(figure.rest), None, size)

    def walk(stride_m: float) -> Body:
        postures = compute_walking_postures(figure.build, figure.rest, stride_m, POSES_PER_CYCLE)
        return replace(standing, gait=_compute_gait(figure.rest, postures, stride_m))

    body = walk(_solve_stride_m(walk, figure.build, size[0]))
    factor, offset = compute_box_fit(body, size)
    fitted = scale_body(body, factor, offset)
    if figure.umbrella is None or body.gait is None:
        return fitted
    with_umbrella = _build_umbrella_body(figure, body.gait.cycle_length_m, size)
    # The scale without an umbrella: the same feet touch the ground and the same box holds.
    return replace(fitted, with_umbrella=scale_body(with_umbrella, factor, offset))


def _build_attached_walker(
    figure: Figure, looks: PedestrianAppearance, size: Size, sitter: Figure
) -> Body:
    """Build a person with its attachment, unscaled."""
    cloth = f"cloth_{looks.bag_colour}"
    if looks.attachment == "wheelchair":
        return _build_wheelchair_user(figure, cloth, size)
    h = figure.build.height_m
    stride_m = _ATTACHED_STRIDE * h
    bar = xyz(_HANDS_AHEAD * h, 0.0, _BAR_HEIGHT * h)
    if looks.attachment == "pram":
        hands = {left: bar + xyz(-0.02, 0.15 * left, 0.03) for left in (1, -1)}
        attachment = build_pram(bar, cloth)
    elif looks.attachment == "dog":
        hand = xyz(0.12 * h, -0.16 * h, 0.56 * h)
        hands = {-1: hand}
        fur = _FURS.get(looks.bag_colour, "hair_brown")
        attachment = build_dog(xyz(0.45, -0.42), hand + xyz(0.02, z=-0.05), stride_m, fur)
    else:
        seat_z_m = _compute_seat_z_m(sitter.build)
        chair = Wheelchair(bar[0] - Wheelchair(0.0, seat_z_m).handle[0], seat_z_m)
        hands = {left: chair.handle * (1, left, 1) + xyz(-0.02, z=0.03) for left in (1, -1)}
        attachment = chair.build(stride_m, cloth).carry(_seat_figure(sitter, chair))
    rest = move_hands(figure.rest, figure.rest, hands)
    walking = compute_walking_postures(figure.build, figure.rest, stride_m, POSES_PER_CYCLE)
    gait = _compute_gait(rest, move_hands(walking, figure.rest, hands), stride_m)
    return _attach(figure.skin(rest), gait, attachment, size)


def _compute_seat_z_m(build: BodyBuild) -> float:
    """Compute the height of a wheelchair's seat, whose user's shins slant a little."""
    knee_z_m = Wheelchair.sole_z_m + build.ankle_m + _SHIN_SLANT * build.leg_m / 2
    return knee_z_m - 0.1 * build.leg_m / 2 - _SEAT_BELOW_HIP_M


def _seat_figure(sitter: Figure, chair: Wheelchair) -> list[SkinnedSurface]:
    """Build the sitter of a wheelchair, hands on the thighs, in other clothes than the pusher's."""
    rest = compute_sitting_posture(sitter.rest, sitter.build, chair.pelvis, chair.sole_z_m)
    hands = {left: rest[joint_on_side(Joint.KNEE, left)] + xyz(-0.12, z=0.08) for left in (1, -1)}
    limbs = sitter.skin(move_hands(rest, sitter.rest, hands))
    return [
        replace(limb, material=_SITTER_TOP) if limb.material == ACTOR_PAINT else limb
        for limb in limbs
    ]


def _build_wheelchair_user(figure: Figure, cloth: str, size: Size) -> Body:
    """Build a person who turns the wheels of its chair by hand: pushes, then reaches back."""
    chair = Wheelchair(0.0, _compute_seat_z_m(figure.build))
    sitting = compute_sitting_posture(figure.rest, figure.build, chair.pelvis, chair.sole_z_m)
    phase = np.arange(POSES_PER_CYCLE) / POSES_PER_CYCLE
    reach = np.clip((phase - PUSH_FRACTION) / (1.0 - PUSH_FRACTION), 0.0, 1.0)
    back = 1.0 - reach**2 * (3.0 - 2.0 * reach)
    angle = _PUSH_START_RAD + WHEELCHAIR_PUSH_RAD * np.where(
        phase < PUSH_FRACTION, phase / PUSH_FRACTION, back
    )
    lift = xyz(z=1.0) * (0.04 + 0.03 * np.sin(np.pi * reach))[:, None]
    hands = {left: chair.compute_rim_places(angle, left) + lift for left in (1, -1)}
    postures = np.broadcast_to(sitting, (POSES_PER_CYCLE, *sitting.shape))
    postures = move_hands(postures, figure.rest, hands)
    cycle_m = WHEELCHAIR_PUSH_RAD / PUSH_FRACTION * WHEELCHAIR_WHEEL_M
    gait = _compute_gait(postures[0], postures, cycle_m)
    return _attach(figure.skin(postures[0]), gait, chair.build(cycle_m, cloth), size)


def _attach(
    limbs: Sequence[SkinnedSurface], gait: Gait, attachment: Attachment, size: Size
) -> Body:
    """Join a person and its attachment; the attachment's bones follow the person's."""
    own, more = len(BONE_SIDES), attachment.bone_transforms.shape[1]
    joined = [
        *(replace(limb, weights=np.pad(limb.weights, ((0, 0), (0, more)))) for limb in limbs),
        *(
            replace(limb, weights=np.pad(limb.weights, ((0, 0), (own, 0))))
            for limb in attachment.limbs
        ),
    ]
    transforms = np.concatenate([gait.bone_transforms, attachment.bone_transforms], axis=1)
    moving = replace(gait, bone_transforms=transforms.astype(np.float32))
    return build_rigged_body(joined, moving, size)


def draw_looks(blueprint_id: str, height_m: float) -> PedestrianAppearance:
    """Draw the looks of a blueprint without declared looks."""
    # Each field is one draw, in this order: another order would dress everyone anew.
    draw = create_generator("pedestrian", blueprint_id)
    child = height_m < CHILD_MAX_HEIGHT_M
    return PedestrianAppearance(
        stout=round(float(draw.uniform(0.9, 1.15)), 2),
        bottom=draw.choice(["trousers", "trousers", "shorts", "skirt"]),
        bottom_colour=draw.choice(["dark", "denim", "grey", "brown"]),
        hair=draw.choice(["short", "short", "long", "bun", "hat"]),
        hair_colour=draw.choice(["black", "brown", "blond", "grey"]),
        skin=draw.choice(["light", "light", "brown", "dark"]),
        bag="backpack" if draw.random() < (0.6 if child else 0.2) else "none",
        umbrella=None if child else draw.choice(["dark", "red", "blue"]),
    )


def build_figure(
    posture: Float64Array, build: BodyBuild, looks: PedestrianAppearance
) -> list[SkinnedSurface]:
    """Build a dressed figure in a posture, skinned to its bones."""
    return [
        skin_soft_shape(shape, material)
        for shape, material in build_garments(posture, build, looks)
    ]


def _compute_gait(rest: Float64Array, postures: Float64Array, stride_m: float) -> Gait:
    return Gait(stride_m, compute_bone_transforms(rest, postures), returns_to_rest=True)


def _solve_stride_m(
    build_walker: Callable[[float], Body], build: BodyBuild, length_m: float
) -> float:
    """Solve for the stride at which a walker is `length_m` long, by linear extrapolation."""
    strides = np.array(_TRIAL_STRIDES) * build.height_m
    lengths = [np.subtract(*compute_extent(build_walker(stride))[::-1])[0] for stride in strides]
    slope = (strides[1] - strides[0]) / (lengths[1] - lengths[0])
    wanted = strides[0] + slope * (length_m - lengths[0])
    return float(np.clip(wanted, *np.multiply(_STRIDE_LIMITS, build.height_m)))


def _build_umbrella_body(figure: Figure, stride_m: float, size: Size) -> Body:
    """Build the walker with an umbrella in a raised right hand."""
    build = figure.build
    rest = raise_right_forearm(figure.rest, build)
    walking = compute_walking_postures(build, figure.rest, stride_m, POSES_PER_CYCLE)
    limbs = figure.skin(rest) + [
        attach_to_bone(surface, Bone.TRUNK, len(BONE_SIDES), material, Semantic.PEDESTRIAN)
        for surface, material in build_umbrella(rest, build, f"cloth_{figure.umbrella}")
    ]
    gait = _compute_gait(rest, raise_right_forearm(walking, build), stride_m)
    return build_rigged_body(limbs, gait, size)
