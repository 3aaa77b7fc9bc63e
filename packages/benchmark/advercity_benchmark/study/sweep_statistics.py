"""Statistics of a LiDAR's echoes: number, range, intensity, rows and loneliness."""

from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from advercity.errors import InputError
from advercity.geometry.arrays import Float32Array, Float64Array
from advercity_benchmark.study.recordings import INSTALL_HINT, Recording

RANGE_EDGES_M = np.linspace(0.0, 120.0, 25)
INTENSITY_EDGES = np.linspace(0.0, 1.0, 21)
ELEVATION_EDGES_DEG = np.linspace(-30.0, 20.0, 21)
MIN_RANGE_M = 2.5
"""Nearer echoes are of the LiDAR's own vehicle in some sets, and left out in others."""
NEIGHBOUR_COUNT, MIN_RADIUS_M, RADIUS_SPACINGS = 3, 0.04, 3.0
"""A point is lonely with fewer than three neighbours within 4 cm or three spacings of the beams:
the filter for snow of Charron et al. (2018), with their parameters."""


@dataclass(frozen=True, eq=False)
class SweepStatistics:
    """Means over the sweeps of one recording.

    Attributes:
        name: Name of the recording.
        sweeps: Number of sweeps.
        echoes: Echoes of a sweep beyond 2.5 m.
        median_range_m: Median range of all echoes.
        far_range_m: Range exceeded by 5 % of the echoes.
        mean_intensity: Mean intensity.
        lonely_ratio: Echoes with hardly any neighbours, as of flakes and ghosts, among all.
        ranges, intensities, elevations: Fractions of the echoes in the bins of this module; echoes
            outside of the bins are in the outermost.
    """

    name: str
    sweeps: int
    echoes: float
    median_range_m: float
    far_range_m: float
    mean_intensity: float
    lonely_ratio: float
    ranges: Float64Array
    intensities: Float64Array
    elevations: Float64Array


def compute_sweep_statistics(recording: Recording) -> SweepStatistics:
    """Compute the statistics of all sweeps of a recording, one at a time.

    Raises:
        InputError: It has no echoes.
    """
    ranges: list[Float32Array] = []
    intensities: list[Float32Array] = []
    elevations: list[Float32Array] = []
    lonely = 0
    for load_sweep in recording.sweep_loaders:
        sweep = load_sweep()
        range_m = np.linalg.norm(sweep.points, axis=1)
        kept = np.isfinite(range_m) & (range_m > MIN_RANGE_M)
        points, range_m = sweep.points[kept], range_m[kept]
        ranges.append(range_m)
        intensities.append(sweep.intensity[kept])
        elevations.append(np.degrees(np.arcsin(points[:, 2] / range_m)))
        lonely += int(find_lonely_points(points).sum())
    if not any(map(len, ranges)):
        raise InputError(f"'{recording.name}' has no LiDAR echoes beyond {MIN_RANGE_M} m")
    range_m, intensity = np.concatenate(ranges), np.concatenate(intensities)
    return SweepStatistics(
        recording.name,
        len(ranges),
        len(range_m) / len(ranges),
        float(np.median(range_m)),
        float(np.quantile(range_m, 0.95)),
        float(intensity.mean()),
        lonely / len(range_m),
        _compute_fractions(range_m, RANGE_EDGES_M),
        _compute_fractions(intensity, INTENSITY_EDGES),
        _compute_fractions(np.concatenate(elevations), ELEVATION_EDGES_DEG),
    )


def find_lonely_points(points: Float32Array) -> NDArray[np.bool_]:
    """Find the points (n,) of a sweep (n, 3) with hardly any neighbours.

    Raises:
        InputError: SciPy is not installed.
    """
    if len(points) <= NEIGHBOUR_COUNT:
        return np.ones(len(points), np.bool_)
    try:
        spatial: Any = import_module("scipy.spatial")
    except ImportError as error:
        raise InputError(f"SciPy is not installed; {INSTALL_HINT}") from error
    range_m = np.linalg.norm(points, axis=1)
    directions = points / range_m[:, None]
    # The next nearest but itself: the spacing of beams of any LiDAR.
    spacing_rad = np.median(spatial.KDTree(directions).query(directions, k=2)[0][:, 1])
    radius_m = np.maximum(MIN_RADIUS_M, RADIUS_SPACINGS * spacing_rad * range_m)
    farthest_m = spatial.KDTree(points).query(points, k=NEIGHBOUR_COUNT + 1)[0][:, -1]
    return farthest_m > radius_m


def compute_jensen_shannon_distance(one: Float64Array, other: Float64Array) -> float:
    """Compute the distance of two distributions over the same bins: 0 equal, 1 disjoint.

    It is the square root of the divergence in bits (Endres and Schindelin 2003).
    """
    middle = (one + other) / 2.0

    def divergence(fraction: Float64Array) -> float:
        filled = fraction > 0.0
        return float((fraction[filled] * np.log2(fraction[filled] / middle[filled])).sum())

    return float(np.sqrt(max(0.0, (divergence(one) + divergence(other)) / 2.0)))


def _compute_fractions(values: Float32Array, edges: Float64Array) -> Float64Array:
    counts, _ = np.histogram(np.clip(values, edges[0], edges[-1]), edges)
    return counts / len(values)
