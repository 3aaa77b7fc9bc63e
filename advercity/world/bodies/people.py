"""Pedestrians: skinned figures whose steps are as long as their boxes."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from advercity_dsl import Looks

from advercity.randomness import generator
from advercity.semantics import Semantic
from advercity.world.bodies.clothes import garments
from advercity.world.bodies.gait import holding, walking
from advercity.world.bodies.puppets import POSES, Limb, extent, fit, fleshed, puppet, rigid, scaled
from advercity.world.bodies.skeleton import SIDES, Bone, Build, moves, standing
from advercity.world.bodies.umbrellas import umbrella
from advercity.world.scene import Body, Gait
from advercity.world.shapes import Floats

Size = tuple[float, float, float]
_STRIDES = 0.05, 0.90
"""Shortest and longest stride, in heights of the figure."""
_TRIED = 0.4, 0.8
_CHILD_M = 1.45


def pedestrian(looks: Looks, size: Size) -> Body:
    """A person who fills `size`: its height standing, its length in the longest moment of a stride.

    The length of the box sets the stride.
    """
    build = Build(size[2], looks.stout)
    rest = standing(build)
    limbs = figure(rest, build, looks)

    def walker(stride_m: float) -> Body:
        postures = walking(build, stride_m, POSES)
        return puppet(limbs, Gait(stride_m, moves(rest, postures), rests=True), size)

    body = walker(_stride_m(walker, build, size[0]))
    factor, offset = fit(body, size)
    fitted = scaled(body, factor, offset)
    if looks.umbrella is None or body.gait is None:
        return fitted
    under = _sheltered(build, looks, body.gait.cycle_m, size)
    return replace(fitted, sheltered=scaled(under, factor, offset))


def drawn_looks(blueprint_id: str, height_m: float) -> Looks:
    """Looks for a blueprint that does not declare them."""
    draw = generator("pedestrian", blueprint_id)
    child = height_m < _CHILD_M
    return Looks(
        stout=round(float(draw.uniform(0.9, 1.15)), 2),
        bottom=draw.choice(["trousers", "trousers", "shorts", "skirt"]),
        bottom_colour=draw.choice(["dark", "denim", "grey", "brown"]),
        hair=draw.choice(["short", "short", "long", "bun", "hat"]),
        hair_colour=draw.choice(["black", "brown", "blond", "grey"]),
        skin=draw.choice(["light", "light", "brown", "dark"]),
        bag="backpack" if draw.random() < (0.6 if child else 0.2) else "none",
        umbrella=None if child else draw.choice(["dark", "red", "blue"]),
    )


def figure(posture: Floats, build: Build, looks: Looks) -> list[Limb]:
    """A dressed figure in some posture, carried by its bones."""
    return [fleshed(flesh, material) for flesh, material in garments(posture, build, looks)]


def _stride_m(walker: Callable[[float], Body], build: Build, length_m: float) -> float:
    """Stride at which a walker is `length_m` long: length grows evenly with it."""
    strides = np.array(_TRIED) * build.height_m
    lengths = [np.subtract(*extent(walker(stride))[::-1])[0] for stride in strides]
    slope = (strides[1] - strides[0]) / (lengths[1] - lengths[0])
    wanted = strides[0] + slope * (length_m - lengths[0])
    return float(np.clip(wanted, *np.multiply(_STRIDES, build.height_m)))


def _sheltered(build: Build, looks: Looks, stride_m: float, size: Size) -> Body:
    """The walker with a raised right hand that holds an umbrella."""
    rest = holding(standing(build), build)
    postures = holding(walking(build, stride_m, POSES), build)
    limbs = figure(rest, build, looks)
    limbs += [
        rigid(surface, Bone.TRUNK, len(SIDES), material, Semantic.PEDESTRIAN)
        for surface, material in umbrella(rest, build, f"cloth_{looks.umbrella}")
    ]
    return puppet(limbs, Gait(stride_m, moves(rest, postures), rests=True), size)
