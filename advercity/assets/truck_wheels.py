"""Builds the wheels of trucks: steel discs, which bulge on steered axles and are hollow on others.

Rims are of 22.5 inches, 0.57 of the diameter of the tyre on them.
"""

from functools import partial

import numpy as np

from advercity.assets.vehicle_parts import build_axle, make_vehicle_parts, set_layer
from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import MeshLayer, MeshPart, TriangleSurface, move_surface, xyz
from advercity.geometry.primitives import rectangles, revolve_closed_profile, revolve_profile

_SIDES = 16
_TYRE = np.array([(0.56, 0.08), (0.90, 0.0), (1.0, 0.12), (1.0, 0.88), (0.82, 1.0)])
"""Radius as a fraction of the tyre's, and place across it from its outer face."""
_TWIN_TYRE_M = 0.46
"""Least width of an axle's end with two tyres."""
_TWIN_GAP = 0.08
_STEERED_DISC = np.array(
    [(0.55, 0.8), (0.60, 0.10), (0.57, 0.03), (0.50, 0.25), (0.33, 0.05), (0.16, 0.0)]
)
_HOLLOW_DISC = np.array(
    [(0.55, 0.8), (0.60, 0.10), (0.57, 0.05), (0.50, 0.30), (0.33, 0.36), (0.20, 0.10)]
)
"""Rim, disc and hub, as `_TYRE` in measures of the outer tyre."""
_SLOPE = slice(3, 5)
"""The rows of a disc around its holes."""
_HOLE_COUNT = 8


def build_truck_axle(
    x_m: float, outer_y_m: float, radius_m: float, width_m: float, *, is_steered: bool = False
) -> list[MeshPart]:
    """Build an axle of a truck like `build_axle`; wide ends have two tyres each."""
    build_wheel = partial(_build_wheel, is_steered=is_steered)
    return build_axle(
        x_m, outer_y_m, radius_m, width_m, is_steered=is_steered, build_wheel=build_wheel
    )


def _build_wheel(
    face: Float64Array, radius_m: float, width_m: float, *, is_steered: bool
) -> list[MeshPart]:
    """Build a left-hand wheel around the centre (3,) of its outer face."""
    is_twin = width_m >= _TWIN_TYRE_M
    tyre_m = width_m * (1 - _TWIN_GAP) / 2 if is_twin else width_m
    measures = np.array([radius_m, -tyre_m])
    disc = (_STEERED_DISC if is_steered else _HOLLOW_DISC) * measures
    tyre = revolve_closed_profile(_TYRE * measures, face, sides=_SIDES)
    parts = [
        *make_vehicle_parts("rubber", tyre),
        *make_vehicle_parts("car_paint_silver", revolve_profile(disc, face, sides=_SIDES)),
    ]
    details = make_vehicle_parts("black_plastic", _build_holes(disc[_SLOPE], face))
    if is_twin:
        behind = move_surface(tyre, xyz(y=tyre_m - width_m))
        details += make_vehicle_parts("rubber", behind)
    return [*parts, *set_layer(MeshLayer.DETAIL, details)]


def _build_holes(slope: Float64Array, face: Float64Array) -> TriangleSurface:
    """Build the holes around a disc between two rows of its profile, just above the surface."""
    angle = 2 * np.pi * (np.arange(_HOLE_COUNT) + 0.5) / _HOLE_COUNT
    outward = np.column_stack([np.cos(angle), np.zeros(_HOLE_COUNT), np.sin(angle)])
    around = np.column_stack([-np.sin(angle), np.zeros(_HOLE_COUNT), np.cos(angle)])
    (outer, outer_y), (inner, inner_y) = slope
    middle = (outer + inner) / 2 * outward + (0, (outer_y + inner_y) / 2 + 0.012, 0)
    upward = 0.28 * ((outer - inner) * outward + (0, outer_y - inner_y, 0))
    return rectangles(face + middle, 0.09 * (outer + inner) * around, upward)
