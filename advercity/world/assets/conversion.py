"""From a foreign model to ours: upright, facing x, in metres, what is seen of it, in few parts.

A converted model is a GLB whose meshes are named after our materials, x forward, y left, z up.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import cast

import fast_simplification
import numpy as np
from advercity_dsl.catalogue import BodyModel
from numpy.typing import NDArray

from advercity.errors import RunError
from advercity.world.assets.materials import (
    LENSES,
    MATERIAL_OF,
    at_their_places,
    by_colour,
    part_of,
)
from advercity.world.assets.visible import seen
from advercity.world.assets.wavefront import Part
from advercity.world.assets.wheels import wheels_apart
from advercity.world.materials import PAINT

VERSION = 2
"""Of this conversion; another one makes other files of the same models."""
LENGTH_TOLERANCE = 0.25
"""By how much a model's proportions may differ from its blueprint's before it is turned wrong."""
WELD_SHARE = 5e-5
"""Of the model's length: vertices nearer than this are one."""
SHAPES = frozenset({PAINT, "glass", "lamp_white", "lamp_red"})
"""What people know a vehicle by; it is thinned less than the rest."""
SHAPING = 3.0
LOWEST, ALL_AROUND = -0.25, -1.0
"""Nobody looks at cars from underneath, but wheels turn."""
FEWEST = 24
"""Triangles that are left of any part."""

Size = tuple[float, float, float]


def converted(parts: Iterable[Part], model: BodyModel, size: Size) -> list[Part]:
    """The parts that are seen of a model, in our frame and of our materials.

    Args:
        parts: As they are in its file.
        model: How to take them.
        size: Full length, width and height of the blueprint in metres, which it is scaled to.

    Raises:
        RunError: Nothing is left, or its proportions are another thing's.
    """
    kept = [part for part in parts if part_of(part.material, model.materials) != "none"]
    if not kept:
        raise RunError(f"{name_of(model)}: no material of it stands for any part")
    upright = [_upright(part, model) for part in kept]
    rest, wheels = wheels_apart(_fitted(upright, model, size))
    outside = _outside(_sorted_out(rest, model, size), LOWEST)
    for number, own in enumerate(wheels, start=1):
        turning = _outside(_sorted_out(own, model, size), ALL_AROUND)
        outside += [replace(part, wheel=number) for part in turning]
    return _thinned(outside, model.triangles)


def name_of(model: BodyModel) -> str:
    """Of a model, for people."""
    return model.pack or model.file or "model"


def _upright(part: Part, model: BodyModel) -> Part:
    x, y, z = part.vertices.T
    if model.up == "y":
        x, y, z = z, x, y
    turn = np.radians(model.turn_deg)
    cosine, sine = np.cos(turn), np.sin(turn)
    vertices = np.column_stack([x * cosine - y * sine, x * sine + y * cosine, z])
    return Part(part.material, vertices, part.triangles, part.colours)


def _fitted(parts: Sequence[Part], model: BodyModel, size: Size) -> list[Part]:
    """The parts scaled to the size, standing on the origin."""
    used = np.concatenate([part.vertices[part.triangles].reshape(-1, 3) for part in parts])
    low, high = used.min(axis=0), used.max(axis=0)
    factor = np.asarray(size) / np.maximum(high - low, 1e-9)
    stretch = factor / np.median(factor)
    if np.abs(stretch - 1.0).max() > LENGTH_TOLERANCE:
        found = " x ".join(f"{extent:.3g}" for extent in high - low)
        raise RunError(
            f"{name_of(model)}: is {found} (length, width, height in its own unit), which does not"
            f" fit {size[0]:g} x {size[1]:g} x {size[2]:g} m; set `turn_deg` and `up` so that its"
            " front faces along x and its roof up"
        )
    middle = (low + high) / 2 * (1, 1, 0) + low * (0, 0, 1)
    return [
        Part(part.material, (part.vertices - middle) * factor, part.triangles, part.colours)
        for part in parts
    ]


def _sorted_out(parts: Sequence[Part], model: BodyModel, size: Size) -> list[Part]:
    """One part for each of our materials."""
    found: dict[str, list[Part]] = {}
    for part in parts:
        named = part_of(part.material, model.materials)
        stands_for = (
            by_colour(part) if named == "by_colour" else np.full(len(part.triangles), named)
        )
        if named in LENSES or named == "by_colour":
            stands_for = at_their_places(stands_for, part, size)
        for kind in np.unique(stands_for):
            material = MATERIAL_OF[kind]
            triangles = part.triangles[stands_for == kind]
            found.setdefault(material, []).append(Part(material, part.vertices, triangles))
    return [_joined(material, some) for material, some in sorted(found.items())]


def _joined(material: str, parts: Sequence[Part]) -> Part:
    """One part of several, with one vertex where theirs meet."""
    corners = np.concatenate([part.vertices[part.triangles] for part in parts]).reshape(-1, 3)
    grid = np.round(corners / (WELD_SHARE * np.ptp(corners, axis=0).max() + 1e-6)).astype(np.int64)
    _, first, index = np.unique(grid, axis=0, return_index=True, return_inverse=True)
    triangles = index.reshape(-1, 3)
    a, b, c = triangles.T
    return Part(material, corners[first], triangles[(a != b) & (b != c) & (c != a)])


def _outside(parts: Sequence[Part], lowest: float) -> list[Part]:
    """What can be seen of the parts, each triangle facing who sees it; thin sheets face both.

    `lowest` is the sine of the steepest look upwards.
    """
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    vertices = np.concatenate([part.vertices for part in parts])
    triangles = np.concatenate(
        [part.triangles + start for part, start in zip(parts, starts, strict=False)]
    )
    front, back = seen(vertices, triangles, lowest)
    bounds = np.cumsum([0, *(len(part.triangles) for part in parts)])
    kept: list[Part] = []
    for part, first, last in zip(parts, bounds[:-1], bounds[1:], strict=True):
        ahead, behind = front[first:last], back[first:last]
        faces = np.concatenate([part.triangles[ahead], part.triangles[behind][:, ::-1]])
        if len(faces):
            kept.append(_joined(part.material, [Part(part.material, part.vertices, faces)]))
    return kept


def _thinned(parts: Sequence[Part], budget: int) -> list[Part]:
    """The parts with about `budget` triangles in all; what makes the shape loses the fewest."""
    total = sum(len(part.triangles) for part in parts)
    if total <= budget:
        return list(parts)
    weights = [SHAPING if part.material in SHAPES else 1.0 for part in parts]
    shares = [weight * len(part.triangles) for weight, part in zip(weights, parts, strict=True)]
    return [
        replace(_simplified(part, max(FEWEST, int(budget * share / sum(shares)))), wheel=part.wheel)
        for part, share in zip(parts, shares, strict=True)
    ]


def _simplified(part: Part, count: int) -> Part:
    if len(part.triangles) <= count:
        return part
    points, triangles = cast(
        tuple[NDArray[np.float64], NDArray[np.int32]],
        fast_simplification.simplify(
            part.vertices, part.triangles.astype(np.int32), target_count=count, agg=3
        ),
    )
    return _joined(part.material, [Part(part.material, points, triangles.astype(np.int64))])
