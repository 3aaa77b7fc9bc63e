"""Builds guard rails, rows of bollards, and power lines on wooden poles."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from advercity_dsl.units import Point2

from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import (
    MeshPart,
    TriangleSurface,
    join_surfaces,
    repeat_surface,
    shade_smooth,
    xyz,
)
from advercity.geometry.primitives import box, loft_rings, tube
from advercity.scene.site import Site, sample_ground_line
from advercity.semantics import Semantic

GUARD_RAIL_HEIGHT_M = 0.75
"""Upper edge of the beam above the ground."""
_RAIL_STEP_M = 4.0
BOLLARD_HEIGHT_M, BOLLARD_SPACING_M = 0.9, 1.5
POWER_POLE_HEIGHT_M, POWER_POLE_SPACING_M = 8.5, 45.0
_SAG = 0.018
"""Sag of a wire as a fraction of its span."""
# Profile of a W-beam across the rail: distance towards the street and height below its upper edge.
_W_BEAM = np.array(
    [(0, 0), (0.08, -0.06), (0.08, -0.1), (0.02, -0.15), (0.08, -0.2), (0.08, -0.25), (0, -0.31)]
)
_BEAM_THICKNESS_M = 0.015


def build_guard_rail(line: Sequence[Point2], height_m: float | None, site: Site) -> list[MeshPart]:
    """Build a W-beam on steel posts along a line, its face towards the nearest street."""
    top = height_m or GUARD_RAIL_HEIGHT_M
    foot = sample_ground_line(line, _RAIL_STEP_M, site)
    heading = site.yaw_to_street((float(foot[0, 0]), float(foot[0, 1])))
    run = np.gradient(foot[:, :2], axis=0)
    aside = np.column_stack([-run[:, 1], run[:, 0]]) / np.linalg.norm(run, axis=1, keepdims=True)
    aside *= np.sign(aside[0] @ (np.cos(heading), np.sin(heading)))
    profile = np.concatenate([_W_BEAM, _W_BEAM[::-1] - (_BEAM_THICKNESS_M, 0)])
    rings = np.empty((len(foot), len(profile), 3))
    rings[..., :2] = foot[:, None, :2] + profile[:, :1] * aside[:, None]
    rings[..., 2] = foot[:, None, 2] + top + profile[:, 1]
    posts = repeat_surface(box((-0.05, -0.05, -0.5), (0.05, 0.05, top)), _behind(foot, aside))
    return [
        MeshPart(shade_smooth(loft_rings(rings)), "metal", Semantic.GUARD_RAIL),
        MeshPart(posts, "metal", Semantic.GUARD_RAIL),
    ]


def _behind(foot: Float64Array, aside: Float64Array) -> Float64Array:
    return foot - np.column_stack([0.08 * aside, np.zeros(len(foot))])


def build_bollards(line: Sequence[Point2], height_m: float | None, site: Site) -> list[MeshPart]:
    """Build a row of bollards along a line."""
    top = height_m or BOLLARD_HEIGHT_M
    foot = sample_ground_line(line, BOLLARD_SPACING_M, site)
    post = shade_smooth(tube([(0, 0, -0.3), (0, 0, top), (0, 0, top + 0.04)], [0.06, 0.06, 0.03]))
    band = shade_smooth(tube([(0, 0, top - 0.2), (0, 0, top - 0.1)], 0.064))
    return [
        MeshPart(repeat_surface(post, foot), "black_plastic", Semantic.POLE),
        MeshPart(repeat_surface(band, foot), "licence_plate", Semantic.POLE),
    ]


def build_power_line(line: Sequence[Point2], height_m: float | None, site: Site) -> list[MeshPart]:
    """Build wooden poles with a cross-arm along a line, and three sagging wires between them."""
    top = height_m or POWER_POLE_HEIGHT_M
    foot = sample_ground_line(line, POWER_POLE_SPACING_M, site)
    run = np.gradient(foot[:, :2], axis=0)
    yaw = np.arctan2(run[:, 1], run[:, 0])
    pole = [
        tube([(0, 0, -0.5), (0, 0, top)], [0.14, 0.1]),
        box((-0.05, -0.9, top - 0.45), (0.05, 0.9, top - 0.33)),
    ]
    ties = np.array([(0.0, -0.8, top - 0.15), (0.0, 0.0, top + 0.18), (0.0, 0.8, top - 0.15)])
    insulators = [tube([at - xyz(z=0.18), at], [0.05, 0.035], sides=6) for at in ties]
    wires = [
        _build_wire(foot[i] + _turn(tie, yaw[i]), foot[i + 1] + _turn(tie, yaw[i + 1]))
        for i, _ in pairwise(range(len(foot)))
        for tie in ties
    ]
    repeated = [
        repeat_surface(shade_smooth(join_surfaces(parts)), foot, yaw=yaw)
        for parts in (pole, insulators)
    ]
    return [
        MeshPart(repeated[0], "wood", Semantic.POLE),
        MeshPart(repeated[1], "black_plastic", Semantic.POLE),
        MeshPart(join_surfaces(map(shade_smooth, wires)), "black_plastic", Semantic.STATIC),
    ]


def _turn(point: Float64Array, yaw: float) -> Float64Array:
    cosine, sine = np.cos(yaw), np.sin(yaw)
    x, y, z = point
    return np.array([x * cosine - y * sine, x * sine + y * cosine, z])


def _build_wire(start: Float64Array, end: Float64Array) -> TriangleSurface:
    """Build a wire between two points (3,), sagging as a parabola."""
    u = np.linspace(0.0, 1.0, 7)[:, None]
    sag = 4 * _SAG * np.linalg.norm(end - start) * u * (1 - u)
    return tube(start + u * (end - start) - sag * (0.0, 0.0, 1.0), 0.012, sides=3)
