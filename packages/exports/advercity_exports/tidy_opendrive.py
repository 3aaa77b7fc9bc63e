"""Lengths and records of an OpenDRIVE file, corrected for ASAM's checker.

netconvert measures curves by straight pieces, up to some centimetres short, and begins a new record
of lines and elevations at every point of a polyline.
"""

import math
from itertools import pairwise
from xml.etree.ElementTree import Element

import numpy as np
from numpy.polynomial.legendre import leggauss

from advercity.geometry.arrays import Float64Array

SAME_PLACE_M, SAME_SLOPE = 1e-4, 1e-6
"""Greatest differences of equal records: of places, and of slopes and headings."""
COEFFICIENTS = ("a", "b", "c", "d")
_NODES, _WEIGHTS = leggauss(32)


def tidy_road(road: Element) -> None:
    """Join equal records of a road, and correct lengths of its curves and places along it."""
    plan = road.find("planView")
    assert plan is not None
    _join_lines(plan)
    profile = road.find("elevationProfile")
    if profile is not None:
        _join_elevations(profile)
    _measure_curves(road, plan)


def _read(element: Element, *names: str) -> Float64Array:
    return np.array([float(element.get(name, 0)) for name in names])


def _write(element: Element, name: str, value: float) -> None:
    element.set(name, f"{value:.9f}")


def _join_lines(plan: Element) -> None:
    kept: Element | None = None
    for geometry in list(plan):
        if geometry.find("line") is None:
            kept = None
        elif kept is not None and _goes_on(kept, geometry):
            _write(kept, "length", (_read(kept, "length") + _read(geometry, "length")).item())
            plan.remove(geometry)
        else:
            kept = geometry


def _goes_on(line: Element, other: Element) -> bool:
    """Return whether a line continues in another one."""
    x, y, heading, length = _read(line, "x", "y", "hdg", "length").tolist()
    other_x, other_y, other_heading = _read(other, "x", "y", "hdg").tolist()
    end = x + length * math.cos(heading), y + length * math.sin(heading)
    turn = math.remainder(other_heading - heading, math.tau)
    return abs(turn) < SAME_SLOPE and math.dist(end, (other_x, other_y)) < SAME_PLACE_M


def _join_elevations(profile: Element) -> None:
    kept: Element | None = None
    for elevation in list(profile):
        if kept is not None and _is_same_profile(kept, elevation):
            profile.remove(elevation)
        else:
            kept = elevation


def _is_same_profile(first: Element, second: Element) -> bool:
    step = (_read(second, "s") - _read(first, "s")).item()
    a, b, c, d = _read(first, *COEFFICIENTS).tolist()
    moved = (a + b * step + c * step**2 + d * step**3, b + 2 * c * step + 3 * d * step**2)
    differences = np.abs([*moved, c + 3 * d * step, d] - _read(second, *COEFFICIENTS))
    return bool((differences < (SAME_PLACE_M, *[SAME_SLOPE] * 3)).all())


def _measure_curves(road: Element, plan: Element) -> None:
    """Give curves their true lengths, and move everything along the road with them."""
    geometries = list(plan)
    starts = [_read(one, "s").item() for one in geometries]
    old = np.array([*starts, _read(road, "length").item()])
    lengths = [_measure_length(one) for one in geometries]
    new = np.concatenate([[0.0], np.cumsum(lengths)])
    for geometry, start, length in zip(geometries, new.tolist(), lengths, strict=False):
        _write(geometry, "s", start)
        _write(geometry, "length", length)
    _write(road, "length", float(new[-1]))
    profile = road.find("elevationProfile")
    _stretch_elevations([] if profile is None else list(profile), old, new)
    for element in road.iter():
        if "s" in element.attrib and element.tag != "geometry":
            _write(element, "s", float(np.interp(_read(element, "s").item(), old, new)))


def _measure_length(geometry: Element) -> float:
    """Measure a geometry; a curve by Gauss' quadrature, which is exact to the micrometre."""
    curve = geometry.find("paramPoly3")
    if curve is None:
        return _read(geometry, "length").item()
    end = 1.0 if curve.get("pRange") == "normalized" else _read(geometry, "length").item()
    at = (_NODES + 1) / 2 * end
    speeds = [
        b + 2 * c * at + 3 * d * at**2
        for b, c, d in (_read(curve, *(f"{name}{axis}" for name in "bcd")) for axis in "UV")
    ]
    return float((_WEIGHTS * np.hypot(*speeds)).sum() / 2 * end)


def _stretch_elevations(elevations: list[Element], old: Float64Array, new: Float64Array) -> None:
    """Stretch profiles so each ends at its former height."""
    ends = [*(_read(one, "s").item() for one in elevations), float(old[-1])]
    for elevation, (start, end) in zip(elevations, pairwise(ends), strict=True):
        stretched = np.interp(end, old, new) - np.interp(start, old, new)
        scale = (end - start) / stretched if stretched > 0 else 1.0
        for power, name in enumerate(COEFFICIENTS):
            _write(elevation, name, _read(elevation, name).item() * scale**power)
