"""Umbrellas over the heads of those who hold them.

Pedestrians: skinned figures whose steps are as long as their boxes.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from advercity_dsl import PedestrianAppearance

from advercity.assets.clothing import build_garments
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

_RIB_COUNT = 8
_RADIUS_M, _RISE_M, _HEAD_CLEARANCE_M = 0.50, 0.17, 0.08
_THICKNESS_M = 0.006


def build_umbrella(
    posture: Float64Array, build: BodyBuild, canopy_material: str
) -> list[tuple[TriangleSurface, str]]:
    """Canopy and stick of an umbrella in the right hand, with their materials."""
    hand = posture[joint_on_side(Joint.HAND, -1)]
    above = posture[Joint.HEAD] + xyz(0.03, -0.06, 0.5 * build.head_m + _HEAD_CLEARANCE_M + _RISE_M)
    along = (above - hand) / np.linalg.norm(above - hand)
    stick = tube([hand - 0.12 * along, above + 0.05 * along], 0.009, sides=5)
    return [(_build_canopy(above), canopy_material), (stick, "metal")]


def _build_canopy(top: Float64Array) -> TriangleSurface:
    """A closed shell over eight ribs, sagging between them."""
    angle = np.pi * np.arange(2 * _RIB_COUNT) / _RIB_COUNT
    sag = np.where(np.arange(2 * _RIB_COUNT) % 2, 0.93, 1.0)
    circle = (
        np.column_stack([np.cos(angle), np.sin(angle), np.zeros(2 * _RIB_COUNT)]) * sag[:, None]
    )
    share = np.array([0.04, 0.4, 0.75, 1.0])
    outer = [top + r * _RADIUS_M * circle - xyz(z=_RISE_M * r**2) for r in share]
    inner = [ring * 1.0 - xyz(z=_THICKNESS_M) for ring in outer[::-1]]
    return loft_rings(np.stack([*outer, *inner]))


_STRIDE_LIMITS = 0.05, 0.90
"""Shortest and longest stride, in heights of the figure."""
_TRIAL_STRIDES = 0.4, 0.8
_CHILD_MAX_HEIGHT_M = 1.45


def build_pedestrian(looks: PedestrianAppearance, size: Size) -> Body:
    """A person who fills `size`: its height standing, its length in the longest moment of a stride.

    The length of the box sets the stride.
    """
    build = BodyBuild(size[2], looks.stout)
    rest = compute_standing_posture(build)
    limbs = build_figure(rest, build, looks)

    def walker(stride_m: float) -> Body:
        postures = compute_walking_postures(build, stride_m, POSES_PER_CYCLE)
        return build_rigged_body(
            limbs,
            Gait(stride_m, compute_bone_transforms(rest, postures), returns_to_rest=True),
            size,
        )

    body = walker(_solve_stride_m(walker, build, size[0]))
    factor, offset = compute_box_fit(body, size)
    fitted = scale_body(body, factor, offset)
    if looks.umbrella is None or body.gait is None:
        return fitted
    under = _build_umbrella_body(build, looks, body.gait.cycle_length_m, size)
    return replace(fitted, with_umbrella=scale_body(under, factor, offset))


def draw_looks(blueprint_id: str, height_m: float) -> PedestrianAppearance:
    """Looks for a blueprint that does not declare them."""
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
    """A dressed figure in some posture, carried by its bones."""
    return [
        skin_soft_shape(flesh, material)
        for flesh, material in build_garments(posture, build, looks)
    ]


def _solve_stride_m(walker: Callable[[float], Body], build: BodyBuild, length_m: float) -> float:
    """Stride at which a walker is `length_m` long: length grows evenly with it."""
    strides = np.array(_TRIAL_STRIDES) * build.height_m
    lengths = [np.subtract(*compute_extent(walker(stride))[::-1])[0] for stride in strides]
    slope = (strides[1] - strides[0]) / (lengths[1] - lengths[0])
    wanted = strides[0] + slope * (length_m - lengths[0])
    return float(np.clip(wanted, *np.multiply(_STRIDE_LIMITS, build.height_m)))


def _build_umbrella_body(
    build: BodyBuild, looks: PedestrianAppearance, stride_m: float, size: Size
) -> Body:
    """The walker with a raised right hand that holds an umbrella."""
    rest = raise_right_forearm(compute_standing_posture(build), build)
    postures = raise_right_forearm(
        compute_walking_postures(build, stride_m, POSES_PER_CYCLE), build
    )
    limbs = build_figure(rest, build, looks)
    limbs += [
        attach_to_bone(surface, Bone.TRUNK, len(BONE_SIDES), material, Semantic.PEDESTRIAN)
        for surface, material in build_umbrella(rest, build, f"cloth_{looks.umbrella}")
    ]
    return build_rigged_body(
        limbs, Gait(stride_m, compute_bone_transforms(rest, postures), returns_to_rest=True), size
    )
