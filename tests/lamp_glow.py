"""The glow of a street lamp in the air by brute force, to compare pictures of renderers with."""

import math

import numpy as np

from advercity.geometry.arrays import FloatArray
from advercity.physics.scattering import PhaseLobes
from advercity.rendering.fog_beams import DROPLET_UM

STEPS, FAR_M = 20_000, 5000.0


def integrate_street_glow(
    lamp: tuple[float, float, float],
    intensity_cd: float,
    extinction: float,
    eye: FloatArray,
    rays: FloatArray,
) -> FloatArray:
    """Integrate the light (n,) in cd/m² that air scatters from a lamp above into rays (n, 3).

    Once by the wide lobe, or as often as it happens by the narrow one: the latter loses nothing.
    """
    return np.array([_integrate(np.subtract(lamp, eye), intensity_cd, extinction, r) for r in rays])


def _integrate(away: FloatArray, intensity_cd: float, extinction: float, ray: FloatArray) -> float:
    lobes = PhaseLobes.from_diameter_um(DROPLET_UM)
    distance = float(np.linalg.norm(away))
    # Steps are short near the lamp.
    edge = float(away @ ray) + np.sinh(np.linspace(-math.asinh(FAR_M), math.asinh(FAR_M), STEPS))
    edge = edge[edge > 0.0]
    along, step = (edge[1:] + edge[:-1]) / 2.0, np.diff(edge)
    from_lamp = along[:, None] * ray - away
    range_m = np.linalg.norm(from_lamp, axis=1)
    lux = intensity_cd * np.maximum(-from_lamp[:, 2] / range_m, 0.0) / range_m**2
    cosine = from_lamp @ -ray / range_m
    path = extinction * (along + range_m)
    angle = np.arccos(away @ ray / distance)
    depth = np.asarray(lobes.narrow_fraction * extinction * distance)
    narrow = lobes.narrow_fraction * lobes.narrow_phase(cosine) * np.exp(-path)
    wide = lobes.wide_fraction * lobes.wide_phase(cosine) * np.exp(-lobes.wide_fraction * path)
    scattered = narrow * lobes.deflection_gain(angle, depth) + wide
    return float((lux * scattered * extinction * step).sum())
