"""Blooming: light of bright targets in nearby beams.

Mirrors and lenses scatter a small part of the light about its direction. In the far wings of a
receiver's point spread it falls with the square of the angle (Harvey and Peterson's law with the
exponent -2), so beams next to a sign a thousand times as bright as white detect it, too.
"""

import math

import numpy as np
from numpy.typing import NDArray

from advercity.geometry.arrays import FloatArray, IndexArray
from advercity.sensors.lidar.beams import ScanPattern, build_ray_directions
from advercity.sensors.lidar.returns import Returns

MAX_STRAY_ANGLE_DEG = 3.0
"""Largest angle of the search for stray light."""
MIN_STRAY_POWER = 0.02
"""Power, of one target's beam in another beam, below which stray light is left out."""
_GROUP = 64
"""Bright beams at a time; they are neighbours, so few other beams are near any of them."""


def find_stray_light(
    pattern: ScanPattern, bright: Returns, stray_light_db: float, pulse_length_m: float
) -> tuple[NDArray[np.int32], FloatArray, FloatArray]:
    """Find the stray light of bright returns in every beam.

    Light of bright returns overlapping in range adds up to one return.

    Args:
        pattern: Pattern of the beams, one ray each.
        bright: Returns whose light strays.
        stray_light_db: Power in a beam 1 deg off a target, relative to a beam on it.
        pulse_length_m: Returns closer than this overlap.

    Returns:
        Beam (k,) ascending, range (k,) and power (k,) relative to the threshold.
    """
    # Equal ranges are sorted by beam, so sums do not depend on the order of the input.
    nearest_first = bright.select(np.lexsort((bright.beam, bright.range_m)))
    apart = np.flatnonzero(np.diff(nearest_first.range_m) >= pulse_length_m) + 1
    found = [
        _spread_light(pattern, nearest_first.select(rows), stray_light_db)
        for rows in np.split(np.arange(len(bright)), apart)
    ]
    beam, range_m, power = (np.concatenate(parts) for parts in zip(*found, strict=True))
    order = np.argsort(beam, kind="stable")
    return beam[order], range_m[order], power[order]


def _spread_light(
    pattern: ScanPattern, bright: Returns, stray_light_db: float
) -> tuple[NDArray[np.int32], FloatArray, FloatArray]:
    """Spread the light of returns overlapping in range over all nearby beams."""
    at_one_degree = 10.0 ** (stray_light_db / 10.0)
    directions, bright = build_ray_directions(pattern), bright.select(np.argsort(bright.beam))
    power, weighted_m = np.zeros(len(directions)), np.zeros(len(directions))
    for begin in range(0, len(bright), _GROUP):
        group = bright.select(np.arange(begin, min(begin + _GROUP, len(bright))))
        beside = _find_beams_beside(directions, group, at_one_degree)
        square = _square_chord(directions.take(beside, axis=0), directions.take(group.beam, axis=0))
        square_deg = square * np.float32(math.degrees(1.0) ** 2)
        square_deg[beside[:, None] == group.beam] = np.inf
        strayed = group.power * (np.float32(at_one_degree) / square_deg)
        strayed *= strayed > MIN_STRAY_POWER
        power[beside] += strayed.sum(axis=1)
        weighted_m[beside] += (strayed * group.range_m).sum(axis=1)
    lit = np.flatnonzero(power)
    return (
        lit.astype(np.int32),
        (weighted_m[lit] / power[lit]).astype(np.float32),
        power[lit].astype(np.float32),
    )


def _find_beams_beside(directions: FloatArray, group: Returns, at_one_degree: float) -> IndexArray:
    """Find the beams (k,) within reach of the light of a group's returns, ascending."""
    axes = directions.take(group.beam, axis=0)
    middle = axes[len(axes) // 2 :][:1]
    strongest = float(group.power.max()) * at_one_degree / MIN_STRAY_POWER
    reach_deg = min(math.sqrt(strongest), MAX_STRAY_ANGLE_DEG)
    # Chords, like angles, add up at most.
    reach = math.radians(reach_deg) + math.sqrt(_square_chord(axes, middle).max())
    return np.flatnonzero(_square_chord(directions, middle)[:, 0] <= reach**2)


def _square_chord(directions: FloatArray, axes: FloatArray) -> FloatArray:
    """Compute the squared distances (n, m) of unit vectors (n, 3) and (m, 3)."""
    # Axis by axis: a matrix product would lose all digits of small angles.
    x, y, z = ((a[:, None] - b) ** 2 for a, b in zip(directions.T, axes.T, strict=True))
    return x + y + z
