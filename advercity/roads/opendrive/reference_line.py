"""Reference lines of roads: their plan, heights and roll, as the standard's formulas have them."""

from functools import cache

import numpy as np

from advercity.geometry.polyline import Points, left_normals, unit_vectors
from advercity.roads.opendrive.document import PlanGeometry, Road
from advercity.roads.opendrive.profiles import (
    Values,
    differentiate,
    differentiate_cubic,
    evaluate_cubic,
    evaluate_profile,
)

QUADRATURE_POINTS = 64
"""Exact to rounding for a spiral of eight turns."""
ARC_TABLE_STEP_M = 0.02
"""Step of the table of a polynomial's parameter by arc length."""
MAX_TABLE_SIZE = 200_000


def sample_plan(road: Road, at_m: Values) -> tuple[Points, Values]:
    """Compute points (n, 2) and headings (n,) of a reference line at stations (n,)."""
    begins = np.array([piece.begins_m for piece in road.geometries])
    index = np.clip(np.searchsorted(begins, at_m, side="right") - 1, 0, len(begins) - 1)
    points, headings = np.zeros((len(at_m), 2)), np.zeros(len(at_m))
    for number in np.unique(index):
        piece, here = road.geometries[number], index == number
        local, turned = _sample_piece(piece, at_m[here] - piece.begins_m)
        ahead = unit_vectors(piece.heading)
        points[here] = piece.start + local[:, :1] * ahead + local[:, 1:] * left_normals(ahead)
        headings[here] = piece.heading + turned
    return points, headings


def sample_offset_points(road: Road, at_m: Values, left_m: Values) -> Points:
    """Compute points (n, k, 3) of the road's surface at stations (n,), at `left_m` (n, k).

    The t axis is rolled by the superelevation, and heights of the cross-section are at right angles
    to it (ASAM OpenDRIVE 1.8, 10.5).
    """
    plan, headings = sample_plan(road, at_m)
    roll = evaluate_profile(road.superelevation, at_m)[:, None]
    above_m = _sample_cross_section(road, at_m, left_m)
    aside = left_m * np.cos(roll) - above_m * np.sin(roll)
    rise = left_m * np.sin(roll) + above_m * np.cos(roll)
    ahead = unit_vectors(headings)
    # The plane of the cross-section leans back on a slope.
    slope = np.arctan(evaluate_profile(differentiate(road.elevation), at_m))[:, None]
    places = (
        plan[:, None]
        + aside[..., None] * left_normals(ahead)[:, None]
        - (rise * np.sin(slope))[..., None] * ahead[:, None]
    )
    z = evaluate_profile(road.elevation, at_m)[:, None] + rise * np.cos(slope)
    return np.concatenate([places, z[..., None]], axis=-1)


def _sample_cross_section(road: Road, at_m: Values, left_m: Values) -> Values:
    """Compute heights (n, k) above the rolled plane, interpolated between cross-sections."""
    if not road.cross_sections:
        return np.zeros_like(left_m)
    heights = np.stack(
        [
            evaluate_profile(item.heights, (road.shape_sign * left_m).ravel()).reshape(left_m.shape)
            for item in road.cross_sections
        ]
    )
    stations = np.array([item.station_m for item in road.cross_sections])
    place = np.interp(at_m, stations, np.arange(len(stations)))
    before = np.minimum(place.astype(np.int64), max(len(stations) - 2, 0))
    after = np.minimum(before + 1, len(stations) - 1)
    share = (place - before)[:, None]
    rows = np.arange(len(at_m))
    return heights[before, rows] * (1 - share) + heights[after, rows] * share


def _sample_piece(piece: PlanGeometry, along_m: Values) -> tuple[Points, Values]:
    """Compute points (n, 2) and headings (n,) in the frame of a piece's start."""
    match piece.shape:
        case "arc":
            return _sample_spiral(piece.values[0], 0.0, along_m)
        case "spiral":
            first, last = piece.values
            return _sample_spiral(first, (last - first) / max(piece.length_m, 1e-9), along_m)
        case "poly3":
            u = _find_parameters(piece, along_m)
            return _evaluate_parametric((0.0, 1.0, 0.0, 0.0), piece.values, u)
        case "paramPoly3":
            u = along_m / max(piece.length_m, 1e-9) if piece.is_normalized else along_m
            return _evaluate_parametric(piece.values[:4], piece.values[4:], u)
        case _:
            return np.stack([along_m, np.zeros_like(along_m)], axis=1), np.zeros_like(along_m)


def _sample_spiral(curvature: float, rate: float, along_m: Values) -> tuple[Points, Values]:
    """Integrate a curve whose curvature changes by `rate` a metre, by Gauss and Legendre."""
    if not rate and curvature:
        turned = curvature * along_m
        # 1 - cos loses all digits of a small angle.
        aside = 2 * np.sin(turned / 2) ** 2 / curvature
        return np.stack([np.sin(turned) / curvature, aside], axis=1), turned
    nodes, weights = _quadrature()
    at = along_m[:, None] * nodes
    directions = unit_vectors(at * (curvature + at * (rate / 2)))
    points = along_m[:, None] * (weights[:, None] * directions).sum(axis=1)
    return points, along_m * (curvature + along_m * (rate / 2))


@cache
def _quadrature() -> tuple[Values, Values]:
    nodes, weights = np.polynomial.legendre.leggauss(QUADRATURE_POINTS)
    return (nodes + 1) / 2, weights / 2


def _evaluate_parametric(
    u: tuple[float, ...], v: tuple[float, ...], at: Values
) -> tuple[Points, Values]:
    points = np.stack([evaluate_cubic(u, at), evaluate_cubic(v, at)], axis=1)
    forward, aside = (evaluate_cubic(differentiate_cubic(cubic), at) for cubic in (u, v))
    return points, np.arctan2(aside, forward)


def _find_parameters(piece: PlanGeometry, along_m: Values) -> Values:
    """Find u of a cubic v(u) at arc lengths (n,)."""
    count = int(min(max(piece.length_m / ARC_TABLE_STEP_M, 100), MAX_TABLE_SIZE))
    u = np.linspace(0.0, piece.length_m, count + 1)
    speed = np.hypot(1.0, evaluate_cubic(differentiate_cubic(piece.values), u))
    travelled = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(u))])
    return np.interp(along_m, travelled, u)
