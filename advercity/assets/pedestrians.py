"""Builds pedestrians: skinned figures, with and without umbrella, whose boxes set their strides."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
from advercity_dsl import PedestrianAppearance

from advercity.assets.clothing import build_garments
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
    compute_standing_posture,
    compute_walking_postures,
    joint_on_side,
    raise_right_forearm,
)
from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import Size, TriangleSurface, xyz
from advercity.geometry.primitives import loft_rings, tube
from advercity.randomness import create_generator
from advercity.semantics import Semantic
from advercity.world import Body, Gait

_STRIDE_LIMITS = 0.05, 0.90
"""Shortest and longest stride, in heights of the figure."""
_TRIAL_STRIDES = 0.4, 0.8
_CHILD_MAX_HEIGHT_M = 1.45
_RIB_COUNT = 8
_RADIUS_M, _RISE_M, _HEAD_CLEARANCE_M = 0.50, 0.17, 0.08
_THICKNESS_M = 0.006


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
    """A dressed standing figure, and the same with a raised right hand.

    Attributes:
        build: Its proportions.
        rest: Posture (joints, 3) of standing.
        limbs: What is seen of it.
        raised_limbs: The same with a raised right hand.
        umbrella: Colour of an umbrella, or none.
    """

    build: BodyBuild
    rest: Float64Array
    limbs: list[SkinnedSurface]
    raised_limbs: list[SkinnedSurface]
    umbrella: str | None


def build_pedestrian(looks: PedestrianAppearance, size: Size) -> Body:
    """Build a person of soft shapes whose stride, with all its poses, just fills the box."""
    build = BodyBuild(size[2], looks.stout)
    rest = compute_standing_posture(build)
    raised = build_figure(raise_right_forearm(rest, build), build, looks) if looks.umbrella else []
    limbs = build_figure(rest, build, looks)
    return build_walker(Figure(build, rest, limbs, raised, looks.umbrella), size)


def build_person(person: RiggedPerson, size: Size) -> Body:
    """Build a converted person whose stride, with all its poses, just fills the box."""
    raised: list[SkinnedSurface] = []
    if person.umbrella:
        posture = raise_right_forearm(person.posture, person.build)
        raised = _skin_shells(pose_shells(person.shells, person.posture, posture))
    limbs = _skin_shells(person.shells)
    return build_walker(Figure(person.build, person.posture, limbs, raised, person.umbrella), size)


def _skin_shells(shells: Iterable[tuple[Shell, str]]) -> list[SkinnedSurface]:
    """Give shells smooth normals."""
    return [
        SkinnedSurface(
            TriangleSurface(shell.vertices, shell.triangles, shell.compute_normals()),
            shell.weights,
            material,
            Semantic.PEDESTRIAN,
        )
        for shell, material in shells
    ]


def build_walker(figure: Figure, size: Size) -> Body:
    """Build a body whose stride, with all its poses, just fills the box of `size`.

    The length of the box sets the stride; a standing person is as wide and high as the box.
    """
    standing = build_rigged_body(figure.limbs, None, size)

    def walk(stride_m: float) -> Body:
        postures = compute_walking_postures(figure.build, figure.rest, stride_m, POSES_PER_CYCLE)
        return replace(standing, gait=_compute_gait(figure.rest, postures, stride_m))

    body = walk(_solve_stride_m(walk, figure.build, size[0]))
    factor, offset = compute_box_fit(body, size)
    fitted = scale_body(body, factor, offset)
    if figure.umbrella is None or body.gait is None:
        return fitted
    with_umbrella = _build_umbrella_body(figure, body.gait.cycle_length_m, size)
    # The same scale as without, so that the same feet touch the ground and the same box holds.
    return replace(fitted, with_umbrella=scale_body(with_umbrella, factor, offset))


def draw_looks(blueprint_id: str, height_m: float) -> PedestrianAppearance:
    """Draw the looks of a blueprint that does not declare them."""
    # Each field is one draw, in this order: another order would dress everyone anew.
    draw = create_generator("pedestrian", blueprint_id)
    child = height_m < _CHILD_MAX_HEIGHT_M
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
    """Build the walker with a raised right hand that holds an umbrella."""
    build = figure.build
    rest = raise_right_forearm(figure.rest, build)
    walking = compute_walking_postures(build, figure.rest, stride_m, POSES_PER_CYCLE)
    limbs = figure.raised_limbs + [
        attach_to_bone(surface, Bone.TRUNK, len(BONE_SIDES), material, Semantic.PEDESTRIAN)
        for surface, material in build_umbrella(rest, build, f"cloth_{figure.umbrella}")
    ]
    gait = _compute_gait(rest, raise_right_forearm(walking, build), stride_m)
    return build_rigged_body(limbs, gait, size)
