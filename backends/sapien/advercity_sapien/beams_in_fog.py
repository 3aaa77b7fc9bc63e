"""The light that fog turns aside from vehicles' beams, on its way to whatever stands about them.

Where fog scatters little, what it turns aside from a beam has no length of its own: at a place
seen from the lamp along a unit ray it is the peak's illuminance there, times the optical depth up
to there, times a quantity of the ray alone. That is what is tabled; the light that fog has taken
from the beam up to there stands for the optical depth, so that none is given twice.
"""

import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from advercity.rendering.lamps import beam_share, fog_beam_share
from advercity.weather.scattering import DropletLobes
from advercity_sapien.tables import COLUMNS, SPREAD_ROWS

Floats = NDArray[np.floating[Any]]

DROPLET_UM = 12.0
RINGS, SPOKES = 16, 32
"""Rings crowd about the axis, by the square root of the angle; spokes run from right to up."""
BEAM_WIDE_RAD, BEAM_LOW_RAD, BEAM_HIGH_RAD = np.radians([60.0, -14.0, 8.0])
"""How far a beam is followed to both sides, down and up."""
STEP_WIDE_RAD, STEP_HIGH_RAD = np.radians([2.0, 0.25])
NEAREST_RAD = np.radians(0.26)
"""From a place to a ray of the beam, which stands for all that are as near as its neighbours."""
TURNS = 4000
NO_BEAMS = np.zeros((SPREAD_ROWS, COLUMNS, 4), dtype=np.float32)
"""Rows of a day."""
FORWARD = np.array([[1.0, 0.0, 0.0]])


@cache
def spread_rows() -> NDArray[np.float32]:
    """Flow along the axis, to the right and up, and fluence, (2, COLUMNS, 4).

    The first row is of dipped beams, the second of front fog lamps.
    """
    rows = np.stack([_spread(beam_share), _spread(fog_beam_share)])
    return rows.reshape(2, COLUMNS, 4).astype(np.float32)


def _spread(share: Callable[[Floats, Floats], Floats]) -> Floats:
    """By ring and spoke (RINGS * SPOKES, 4), of a beam along x."""
    beam, light = _rays_of(share)
    ways = _ways()
    cosine = np.clip(ways @ beam.T, -1.0, 1.0)
    off = np.maximum(np.arccos(cosine), NEAREST_RAD)
    sine = np.maximum(np.sin(off), np.sin(NEAREST_RAD))
    around, along, across = light / sine * _beyond(off)
    # What is turned goes on along the beam and away from it, in the plane of beam and place.
    across /= sine
    flow = (along - across * cosine) @ beam + across.sum(axis=1)[:, None] * ways
    forward, left, up = flow.T
    return np.stack([forward, -left, up, around.sum(axis=1)], axis=-1)


def _rays_of(share: Callable[[Floats, Floats], Floats]) -> tuple[Floats, Floats]:
    """Unit rays (n, 3) that make up a beam, and what of the peak's light times sr is in each."""
    h = np.arange(-BEAM_WIDE_RAD, BEAM_WIDE_RAD, STEP_WIDE_RAD) + STEP_WIDE_RAD / 2.0
    v = np.arange(BEAM_LOW_RAD, BEAM_HIGH_RAD, STEP_HIGH_RAD) + STEP_HIGH_RAD / 2.0
    aside, above = (item.ravel() for item in np.meshgrid(h, v))
    level = np.cos(above)
    rays = np.stack([level * np.cos(aside), level * np.sin(aside), np.sin(above)], axis=-1)
    rays = rays.astype(np.float32)
    light = share(FORWARD, rays[None])[0] * level * STEP_WIDE_RAD * STEP_HIGH_RAD
    light = light.astype(np.float32)
    counts = light > 3e-3 * light.max()
    return rays[counts], light[counts]


def _ways() -> Floats:
    """Unit rays (RINGS * SPOKES, 3) to the places of the table; y is to the left."""
    off = math.pi * (np.arange(RINGS) / (RINGS - 1)) ** 2
    turn = 2.0 * math.pi * np.arange(SPOKES) / SPOKES
    off, turn = (item.ravel() for item in np.meshgrid(off, turn, indexing="ij"))
    level = np.sin(off)
    ways = [np.cos(off), -level * np.cos(turn), level * np.sin(turn)]
    return np.stack(ways, axis=-1).astype(np.float32)


def _beyond(off: Floats) -> Floats:
    """What an endless beam sends to a place (...) so far off it: in all, along itself and away.

    Integrals (3, ...) of the phase function's wide lobe over all angles beyond.
    """
    width = math.pi / TURNS
    turn = (np.arange(TURNS) + 0.5) * width
    wide = DropletLobes.of(DROPLET_UM).wide(np.cos(turn)) * width
    turned = np.stack([wide, wide * np.cos(turn), wide * np.sin(turn)])
    sums = np.cumsum(turned[:, ::-1], axis=1)[:, ::-1].astype(np.float32)
    return sums[:, np.minimum((off / width).astype(int), TURNS - 1)]
