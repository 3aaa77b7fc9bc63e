"""The light that fog turns aside from vehicles' beams, on its way to whatever stands about them.

Where fog scatters little, what it turns aside from a beam has no length of its own: at a place
seen from the lamp along a unit ray it is the peak's illuminance there, times the optical depth up
to there, times a quantity of the ray alone. That is what is tabled; the light that fog has taken
from the beam up to there stands for the optical depth, so that none is given twice.
"""

import math
from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray

from advercity.geometry.arrays import FloatArray
from advercity.physics.lamp_beams import fog_beam_pattern, low_beam_pattern
from advercity.physics.scattering import DropletPhaseLobes
from advercity_sapien.shader_table import COLUMNS, FOG_BEAM_RINGS, FOG_BEAM_ROWS, FOG_BEAM_SPOKES

DROPLET_UM = 12.0
BEAM_HALF_WIDTH_RAD, BEAM_BOTTOM_RAD, BEAM_TOP_RAD = np.radians([60.0, -14.0, 8.0])
"""How far a beam is followed to both sides, down and up."""
STEP_HORIZONTAL_RAD, STEP_VERTICAL_RAD = np.radians([2.0, 0.25])
MIN_ANGLE_RAD = np.radians(0.26)
"""From a place to a ray of the beam, which stands for all that are as near as its neighbours."""
PHASE_STEPS = 4000
EMPTY_FOG_BEAM_ROWS = np.zeros((FOG_BEAM_ROWS, COLUMNS, 4), dtype=np.float32)
"""Rows of a day."""
BEAM_AXIS = np.array([[1.0, 0.0, 0.0]])


@cache
def compute_fog_beam_rows() -> NDArray[np.float32]:
    """Flow along the axis, to the right and up, and fluence, (2, COLUMNS, 4).

    The first row is of dipped beams, the second of front fog lamps.
    """
    rows = np.stack([_integrate_fog_beam(low_beam_pattern), _integrate_fog_beam(fog_beam_pattern)])
    return rows.reshape(2, COLUMNS, 4).astype(np.float32)


def _integrate_fog_beam(
    beam_fraction: Callable[[FloatArray, FloatArray], FloatArray],
) -> FloatArray:
    """By ring and spoke (RINGS * SPOKES, 4), of a beam along x."""
    beam, light = _sample_beam_rays(beam_fraction)
    ways = _table_directions()
    cosine = np.clip(ways @ beam.T, -1.0, 1.0)
    off = np.maximum(np.arccos(cosine), MIN_ANGLE_RAD)
    sine = np.maximum(np.sin(off), np.sin(MIN_ANGLE_RAD))
    around, along, across = light / sine * _integrate_phase_beyond(off)
    # What is turned goes on along the beam and away from it, in the plane of beam and place.
    across /= sine
    flow = (along - across * cosine) @ beam + across.sum(axis=1)[:, None] * ways
    forward, left, up = flow.T
    return np.stack([forward, -left, up, around.sum(axis=1)], axis=-1)


def _sample_beam_rays(
    beam_fraction: Callable[[FloatArray, FloatArray], FloatArray],
) -> tuple[FloatArray, FloatArray]:
    """Unit rays (n, 3) that make up a beam, and what of the peak's light times sr is in each."""
    h = (
        np.arange(-BEAM_HALF_WIDTH_RAD, BEAM_HALF_WIDTH_RAD, STEP_HORIZONTAL_RAD)
        + STEP_HORIZONTAL_RAD / 2.0
    )
    v = np.arange(BEAM_BOTTOM_RAD, BEAM_TOP_RAD, STEP_VERTICAL_RAD) + STEP_VERTICAL_RAD / 2.0
    aside, above = (item.ravel() for item in np.meshgrid(h, v))
    level = np.cos(above)
    rays = np.stack([level * np.cos(aside), level * np.sin(aside), np.sin(above)], axis=-1)
    rays = rays.astype(np.float32)
    light = (
        beam_fraction(BEAM_AXIS, rays[None])[0] * level * STEP_HORIZONTAL_RAD * STEP_VERTICAL_RAD
    )
    light = light.astype(np.float32)
    counts = light > 3e-3 * light.max()
    return rays[counts], light[counts]


def _table_directions() -> FloatArray:
    """Unit rays (RINGS * SPOKES, 3) to the places of the table; y is to the left."""
    off = math.pi * (np.arange(FOG_BEAM_RINGS) / (FOG_BEAM_RINGS - 1)) ** 2
    turn = 2.0 * math.pi * np.arange(FOG_BEAM_SPOKES) / FOG_BEAM_SPOKES
    off, turn = (item.ravel() for item in np.meshgrid(off, turn, indexing="ij"))
    level = np.sin(off)
    ways = [np.cos(off), -level * np.cos(turn), level * np.sin(turn)]
    return np.stack(ways, axis=-1).astype(np.float32)


def _integrate_phase_beyond(angle_rad: FloatArray) -> FloatArray:
    """What an endless beam sends to a place (...) so far off it: in all, along itself and away.

    Integrals (3, ...) of the phase function's wide lobe over all angles beyond.
    """
    width = math.pi / PHASE_STEPS
    turn = (np.arange(PHASE_STEPS) + 0.5) * width
    wide = DropletPhaseLobes.from_diameter_um(DROPLET_UM).wide_phase(np.cos(turn)) * width
    turned = np.stack([wide, wide * np.cos(turn), wide * np.sin(turn)])
    sums = np.cumsum(turned[:, ::-1], axis=1)[:, ::-1].astype(np.float32)
    return sums[:, np.minimum((angle_rad / width).astype(int), PHASE_STEPS - 1)]
