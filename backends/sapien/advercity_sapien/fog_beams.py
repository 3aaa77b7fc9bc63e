"""Light that fog scatters out of vehicles' beams, onto whatever is around them.

Where fog scatters little, the light that it scatters out of a beam has no length of its own: at a
point seen from the lamp along a unit ray it is the peak's illuminance there, times the optical
depth up to there, times a quantity of the ray alone. That quantity is tabled; the shader uses the
light that the beam has lost up to there for the optical depth, so that no light is counted twice.
"""

import math
from functools import cache

import numpy as np

from advercity.geometry.arrays import Float32Array, FloatArray
from advercity.physics.lamp_beams import FRONT_FOG_BEAM, LOW_BEAM, LampBeam
from advercity.physics.scattering import DropletPhaseLobes
from advercity_sapien.shader_table import COLUMNS, FOG_BEAM_RINGS, FOG_BEAM_SPOKES

DROPLET_UM = 12.0
"""Droplet diameter of every fog by night, in the shaders too; a weather's own is for daylight."""
BEAM_HALF_WIDTH_RAD, BEAM_BOTTOM_RAD, BEAM_TOP_RAD = np.radians([60.0, -14.0, 8.0])
"""Extent of the sampled beam to either side, down and up."""
STEP_HORIZONTAL_RAD, STEP_VERTICAL_RAD = np.radians([2.0, 0.25])
MIN_ANGLE_RAD = np.radians(0.26)
"""Least angle between a point and a ray of the beam: about half a step, as rays have a width."""
MIN_RAY_FRACTION = 3e-3
"""Rays with less of the strongest ray's light are left out."""
PHASE_STEPS = 4000
BEAM_AXIS = np.array([[1.0, 0.0, 0.0]])


@cache
def compute_fog_beam_rows() -> Float32Array:
    """Compute the table's rows (2, COLUMNS, 4): flow along the axis, right and up, and fluence.

    The first row is of low beams, the second of front fog lamps. Takes about a second.
    """
    rows = np.stack([_integrate_fog_beam(LOW_BEAM), _integrate_fog_beam(FRONT_FOG_BEAM)])
    return rows.reshape(2, COLUMNS, 4).astype(np.float32)


def _integrate_fog_beam(lamp_beam: LampBeam) -> FloatArray:
    """Integrate the scattered light of a beam along x by ring and spoke, (RINGS * SPOKES, 4)."""
    beam, light = _sample_beam_rays(lamp_beam)
    directions = _table_directions()
    cosine = np.clip(directions @ beam.T, -1.0, 1.0)
    angle = np.maximum(np.arccos(cosine), MIN_ANGLE_RAD)
    sine = np.maximum(np.sin(angle), np.sin(MIN_ANGLE_RAD))
    fluence, along, across = light / sine * _integrate_phase_beyond(angle)
    # Scattered light goes on along the beam and away from it, in the plane of beam and point.
    across /= sine
    flow = (along - across * cosine) @ beam + across.sum(axis=1)[:, None] * directions
    forward, left, up = flow.T
    return np.stack([forward, -left, up, fluence.sum(axis=1)], axis=-1)


def _sample_beam_rays(lamp_beam: LampBeam) -> tuple[FloatArray, FloatArray]:
    """Sample unit rays (n, 3) of a beam, and the light (n,) of each: peak intensity times sr."""
    h = np.arange(-BEAM_HALF_WIDTH_RAD, BEAM_HALF_WIDTH_RAD, STEP_HORIZONTAL_RAD)
    h += STEP_HORIZONTAL_RAD / 2.0
    v = np.arange(BEAM_BOTTOM_RAD, BEAM_TOP_RAD, STEP_VERTICAL_RAD) + STEP_VERTICAL_RAD / 2.0
    horizontal, vertical = (item.ravel() for item in np.meshgrid(h, v))
    level = np.cos(vertical)
    rays = np.stack(
        [level * np.cos(horizontal), level * np.sin(horizontal), np.sin(vertical)], axis=-1
    )
    # Float32 halves the time of some millions of angles; the table has no more digits.
    rays = rays.astype(np.float32)
    relative = lamp_beam.relative_intensity(BEAM_AXIS, rays[None])[0]
    light = (relative * level * STEP_HORIZONTAL_RAD * STEP_VERTICAL_RAD).astype(np.float32)
    is_strong = light > MIN_RAY_FRACTION * light.max()
    return rays[is_strong], light[is_strong]


def _table_directions() -> FloatArray:
    """Compute unit directions (RINGS * SPOKES, 3) to the points of the table; y is to the left."""
    off_axis = math.pi * (np.arange(FOG_BEAM_RINGS) / (FOG_BEAM_RINGS - 1)) ** 2
    azimuth = 2.0 * math.pi * np.arange(FOG_BEAM_SPOKES) / FOG_BEAM_SPOKES
    off_axis, azimuth = (item.ravel() for item in np.meshgrid(off_axis, azimuth, indexing="ij"))
    sine = np.sin(off_axis)
    directions = [np.cos(off_axis), -sine * np.cos(azimuth), sine * np.sin(azimuth)]
    return np.stack(directions, axis=-1).astype(np.float32)


def _integrate_phase_beyond(angle_rad: FloatArray) -> FloatArray:
    """Integrate the phase function's wide lobe over all scattering angles beyond some (...).

    This is what an endless ray sends to a point so far off it: (3, ...) in all, along the ray, and
    away from it.
    """
    width = math.pi / PHASE_STEPS
    turn = (np.arange(PHASE_STEPS) + 0.5) * width
    wide = DropletPhaseLobes.from_diameter_um(DROPLET_UM).wide_phase(np.cos(turn)) * width
    scattered = np.stack([wide, wide * np.cos(turn), wide * np.sin(turn)])
    sums = np.cumsum(scattered[:, ::-1], axis=1)[:, ::-1].astype(np.float32)
    return sums[:, np.minimum((angle_rad / width).astype(int), PHASE_STEPS - 1)]
