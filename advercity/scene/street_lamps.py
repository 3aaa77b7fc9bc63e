"""Builds the street lamps of towns, squares, country roads and fast roads."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from advercity_dsl.road import LampType
from advercity_dsl.units import KM_H_PER_M_S, Point2

from advercity.geometry.mesh import MeshPart, TriangleSurface, move_surface, xyz
from advercity.geometry.primitives import box, ellipsoid, loft_rings, rectangles, tube
from advercity.scene.site import Site
from advercity.semantics import Semantic
from advercity.world import StreetLamp

FAST_KM_H = 80.0
"""Least speed limit of a street with the high columns of motorways."""
_ARM_M, _COLUMN_ARM_M = 1.6, 2.4
_LIGHT_BELOW_TOP_M = 0.1
_BEFORE_POST_M = 0.2
"""Distance of a lantern's light from its post, which would shade it."""

_Piece = tuple[TriangleSurface, str]


@dataclass(frozen=True)
class _Lamp:
    """A type of lamp.

    Attributes:
        build: Builds it at the origin, its arm along x, from the height of its head.
        height_m: Usual height of its head.
        arm_m: Distance of the head from the foot, in the plan.
        flux_lm: Light of it.
    """

    build: Callable[[float], list[_Piece]]
    height_m: float
    arm_m: float
    flux_lm: float


def choose_lamp_type(land_use: str, speed_limit_m_s: float) -> LampType:
    """Choose the type of lamp on a street by its speed limit and land use."""
    if speed_limit_m_s * KM_H_PER_M_S >= FAST_KM_H:
        return "column"
    return "wooden_pole" if land_use == "rural" else "arm"


def build_street_lamp(
    at: Point2, height_m: float | None, lamp_type: LampType, site: Site
) -> tuple[list[MeshPart], StreetLamp]:
    """Build a street lamp with its arm towards the nearest street, and its light."""
    lamp = _LAMPS[lamp_type]
    top, yaw = height_m or lamp.height_m, site.yaw_to_street(at)
    foot = site.project_to_ground([at])[0]
    x, y = foot[:2] + lamp.arm_m * np.array([np.cos(yaw), np.sin(yaw)])
    light = StreetLamp(
        (float(x), float(y), float(foot[2] + top - _LIGHT_BELOW_TOP_M)), lamp.flux_lm
    )
    return [
        MeshPart(move_surface(surface, foot, yaw=yaw), material, Semantic.POLE)
        for surface, material in lamp.build(top)
    ], light


def _build_arm(top: float) -> list[_Piece]:
    end = (_ARM_M - 0.3, 0, top + 0.05)
    arm = [(0, 0, top - 0.45), (0.12, 0, top - 0.12), (0.5, 0, top), end]
    mast = tube([(0, 0, -0.3), (0, 0, 1.0), (0, 0, top - 0.4)], [0.1, 0.085, 0.06])
    head = ellipsoid((_ARM_M, 0, top + 0.03), (0.38, 0.15, 0.08), sides=10, bands=5)
    glass = rectangles([(_ARM_M, 0, top - 0.06)], (0.24, 0, 0), (0, -0.09, 0))
    return [
        (mast, "metal"),
        (tube(arm, 0.05, sides=6), "metal"),
        (head, "metal"),
        (glass, "lamp_white"),
    ]


def _build_lantern(top: float) -> list[_Piece]:
    """Build a lantern with four panes on a cast post, the head's lower edge at `top`."""
    post = tube(
        [(0, 0, -0.3), (0, 0, 0.55), (0, 0, 0.65), (0, 0, top - 0.15), (0, 0, top)],
        [0.11, 0.09, 0.055, 0.045, 0.07],
    )
    square = np.array([(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)])

    def stack(levels: list[tuple[float, float]]) -> TriangleSurface:
        rings = [np.column_stack([half * square, np.full(4, z)]) for half, z in levels]
        return loft_rings(np.stack(rings))

    panes = stack([(0.11, top), (0.17, top + 0.36)])
    roof = stack([(0.21, top + 0.36), (0.21, top + 0.39), (0.08, top + 0.52), (0.02, top + 0.58)])
    bars = [
        tube([xyz(0.11 * x, 0.11 * y, top), xyz(0.17 * x, 0.17 * y, top + 0.36)], 0.014, sides=4)
        for x, y in square
    ]
    return [(post, "black_plastic"), (panes, "lamp_white"), (roof, "black_plastic")] + [
        (bar, "black_plastic") for bar in bars
    ]


def _build_wooden_pole(top: float) -> list[_Piece]:
    """Build a dish on a bracket with a strut, on a pole of wood."""
    pole = tube([(0, 0, -0.3), (0, 0, top + 0.7)], [0.14, 0.10])
    bracket = tube([(0.05, 0, top - 0.05), (0.7, 0, top + 0.12), (_ARM_M, 0, top + 0.06)], 0.025)
    strut = tube([(0.05, 0, top - 0.5), (0.7, 0, top + 0.1)], 0.015, sides=6)
    levels = [(0.05, 0.10), (0.07, 0.04), (0.25, -0.04), (0.24, -0.05)]
    angle = 2 * np.pi * np.arange(14) / 14
    rings = [
        np.column_stack([_ARM_M + r * np.cos(angle), r * np.sin(angle), np.full(14, top + z)])
        for r, z in levels
    ]
    bulb = ellipsoid((_ARM_M, 0, top - 0.02), (0.07, 0.07, 0.05), sides=8, bands=5)
    return [
        (pole, "wood"),
        (bracket, "metal"),
        (strut, "metal"),
        (loft_rings(np.stack(rings)), "metal"),
        (bulb, "lamp_white"),
    ]


def _build_column(top: float) -> list[_Piece]:
    """Build a flat head at the end of a straight, rising arm, on a high tapered column."""
    mast = tube([(0, 0, -0.3), (0, 0, 1.5), (0, 0, top)], [0.15, 0.13, 0.075], sides=10)
    arm = tube([(0, 0, top - 0.35), (0, 0, top - 0.1), (_COLUMN_ARM_M - 0.4, 0, top + 0.1)], 0.05)
    low = xyz(_COLUMN_ARM_M - 0.42, -0.16, top + 0.02)
    head = box(low, low + xyz(0.84, 0.32, 0.09))
    glass = rectangles([(_COLUMN_ARM_M, 0, top + 0.015)], (0.36, 0, 0), (0, -0.13, 0))
    return [(mast, "metal"), (arm, "metal"), (head, "metal"), (glass, "lamp_white")]


_LAMPS: dict[LampType, _Lamp] = {
    "arm": _Lamp(_build_arm, 8.0, _ARM_M, 8000.0),
    "lantern": _Lamp(_build_lantern, 4.2, _BEFORE_POST_M, 4000.0),
    "wooden_pole": _Lamp(_build_wooden_pole, 8.0, _ARM_M, 8000.0),
    "column": _Lamp(_build_column, 12.0, _COLUMN_ARM_M, 16000.0),
}
