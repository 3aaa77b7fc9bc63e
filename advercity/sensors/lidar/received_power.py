"""The LiDAR equation, normalised, and the threshold that an echo must pass.

Powers are in units of the threshold in the dark: an echo of 1 is found half of the time.

What surfaces send back at 905 nm: diffuse, glossy and retroreflecting, dry, wet or snowed on.

How far a LiDAR finds a target of a given reflectance in a weather, in the dark.
"""

import math

import numpy as np
from numpy.typing import NDArray

from advercity.geometry.arrays import FloatArray
from advercity.materials import MATERIALS, SNOW_REFLECTANCE_905NM
from advercity.physics.extinction import extinction_from_mor
from advercity.physics.water import fresnel_reflectance
from advercity.rendering.raycaster import MATERIAL_NAMES, RayHits
from advercity.semantics import Semantic

NEAR_FIELD_M = 10.0
"""Below this range gain control and overlap keep echoes from growing with 1/R²."""
REFERENCE_REFLECTANCE = 0.10
REFERENCE_RANGE_M = 80.0
"""Where a target of 10 % facing the sensor in clear air is detected half the time."""
REFERENCE_VISIBILITY_M = 20_000.0
SIGNAL_TO_NOISE = 5.0
"""Of an echo at the detection threshold."""
PULSE_LENGTH_M = 0.749
"""Half of what light goes in a pulse of 5 ns: echoes closer than this are one."""
NOISE_RANGE_ERROR_M = 0.75
"""Of an echo as strong as the noise."""
NOISE_DOUBLING_LX = 50_000.0 / 0.3
"""Illuminance that adds as much noise power as the receiver has in the dark."""
_DARK_THRESHOLD = (
    REFERENCE_REFLECTANCE
    / math.pi
    * math.exp(-2.0 * extinction_from_mor(REFERENCE_VISIBILITY_M) * REFERENCE_RANGE_M)
    / (REFERENCE_RANGE_M**2 + NEAR_FIELD_M**2)
)
WHITE_TARGET_POWER = 1.0 / (math.pi * _DARK_THRESHOLD)
"""Power of a white target that faces the sensor in a vacuum, times the gain 1/(R² + 10²)."""


def received_power(
    range_m: FloatArray, reflected_fraction: FloatArray, extinction_per_m: float
) -> FloatArray:
    """Power (n,) of a hard Lambertian target, against the threshold.

    Args:
        range_m: (n,) metres.
        reflected_fraction: (n,) reflectance times cosine of incidence.
        extinction_per_m: Extinction coefficient at 905 nm, of the air between, 1/m.
    """
    left = np.exp(range_m * range_m.dtype.type(-2.0 * extinction_per_m))
    return left * reflected_fraction * (WHITE_TARGET_POWER / (range_m * range_m + NEAR_FIELD_M**2))


def apparent_reflectance(power: FloatArray, range_m: FloatArray) -> FloatArray:
    """Reflectance (n,) that a target would have in clear air; what a sensor calls intensity."""
    return power * ((range_m * range_m + NEAR_FIELD_M**2) / WHITE_TARGET_POWER)


def daylight_noise_factor(illuminance_lx: float) -> float:
    """How much daylight raises the receiver's noise, and with it the threshold."""
    return math.sqrt(1.0 + illuminance_lx / NOISE_DOUBLING_LX)


def detection_margin_sigma(power: FloatArray) -> FloatArray:
    """How far (n,) an echo stands above the threshold, in standard deviations of the noise."""
    return SIGNAL_TO_NOISE * (power - 1.0)


def range_standard_deviation_m(power: FloatArray, instrument_deviation_m: float) -> FloatArray:
    """Standard deviation (n,) of the range of echoes: the instrument's own and that of noise."""
    return np.sqrt(
        instrument_deviation_m**2 + (NOISE_RANGE_ERROR_M / (SIGNAL_TO_NOISE * power)) ** 2
    )


WATER_REFRACTIVE_INDEX_905NM = 1.328
"""Refractive index of water at 905 nm."""
PANE_TRANSMITTANCE = 0.85
"""Share of the light that gets through a window, one way."""
GLOSS_WIDTH_RAD = 0.07
"""Width of the highlight of varnish: a beam that meets it within 4 degrees comes straight back."""
_WATER_INTERNAL_REFLECTANCE_905NM = 0.4702
_BEAD_SHADING_COSINE = 0.05
"""Cosine of incidence below which glass beads in paint shade each other."""
_WET_BEAD_FACTOR = 0.2
"""What rain leaves of their echo."""


_ROWS = [MATERIALS[name] for name in MATERIAL_NAMES]
_DIFFUSE = np.array([row.reflectance_905nm for row in _ROWS], np.float32)
_VARNISHED = np.array([row.is_varnished for row in _ROWS], np.float32)
_SHEETING = np.array([row.sheeting_reflectance for row in _ROWS], np.float32)
_BEADS = np.array([row.bead_reflectance for row in _ROWS], np.float32)
_IS_PLAIN = (_VARNISHED + _SHEETING + _BEADS) == 0.0
IS_GLASS = np.array([row.is_transparent for row in _ROWS])


def effective_reflectance(
    hits: RayHits, *, wetness: float = 0.0, snow_cover: float = 0.0, road_snow_cover: float = 0.0
) -> FloatArray:
    """Reflectance at 905 nm times cosine of incidence (n,); above 1 for retroreflectors.

    Rain leaves its film and snow its cover on what faces up; walls and windows stay as they are.

    Args:
        hits: What was met.
        wetness: 0 dry to 1 soaked.
        snow_cover: Share of the ground under snow.
        road_snow_cover: The same of carriageways.
    """
    reflectance = _DIFFUSE.take(hits.material)
    upward = (
        np.clip(hits.normal[:, 2], 0.0, 1.0) if wetness or snow_cover or road_snow_cover else None
    )
    if upward is not None and (snow_cover or road_snow_cover):
        on_road = (hits.semantic == Semantic.ROAD) | (hits.semantic == Semantic.ROAD_LINE)
        cover = np.array([snow_cover, road_snow_cover], np.float32).take(on_road)
        reflectance = reflectance + upward * cover * (
            np.float32(SNOW_REFLECTANCE_905NM) - reflectance
        )
    share = reflectance * hits.cosine
    if upward is not None and wetness:
        wet = wet_reflectance_ratio(reflectance, hits.cosine)
        share *= 1.0 + np.float32(wetness) * upward * (wet - 1.0)
    special = np.flatnonzero(~_IS_PLAIN.take(hits.material))
    share[special] += _special_reflectance(
        hits.material.take(special), hits.cosine.take(special), wetness
    )
    return share


def _special_reflectance(
    material: NDArray[np.int16], cosine: FloatArray, wetness: float
) -> FloatArray:
    """What varnish, sheeting and beads add (k,)."""
    gloss = np.exp((cosine - 1.0) / GLOSS_WIDTH_RAD**2)
    beads = np.minimum(cosine / _BEAD_SHADING_COSINE, 1.0) * (
        1.0 - (1.0 - _WET_BEAD_FACTOR) * wetness
    )
    return (
        _VARNISHED[material] * gloss
        + _SHEETING[material] * cosine**2
        + _BEADS[material] * beads.astype(np.float32)
    )


def wet_reflectance_ratio(reflectance: FloatArray, cosine: FloatArray) -> FloatArray:
    """Echo (n,) of a target under a film of water against the same target dry.

    Light crosses the surface twice and is partly held inside (Angstrom 1925; Lekner and Dorf
    1988); at grazing incidence most of it glances off.
    """
    passed = 1.0 - fresnel_reflectance(cosine, WATER_REFRACTIVE_INDEX_905NM)
    return passed**2 / (
        WATER_REFRACTIVE_INDEX_905NM**2 * (1.0 - reflectance * _WATER_INTERNAL_REFLECTANCE_905NM)
    )


DETECTION_RANGE_STEP_M = 0.1


def detection_range_m(
    reflectance: float, extinction_per_m: float, *, max_range_m: float = 200.0
) -> float:
    """Range at which a target that faces the sensor is found half of the time.

    Args:
        reflectance: Of a Lambertian target, at 905 nm.
        extinction_per_m: Extinction coefficient at 905 nm, of the air, 1/m.
        max_range_m: Beyond this the sensor does not listen.
    """
    ranges = np.arange(
        DETECTION_RANGE_STEP_M, max_range_m + DETECTION_RANGE_STEP_M / 2, DETECTION_RANGE_STEP_M
    )
    found = received_power(ranges, np.full_like(ranges, reflectance), extinction_per_m) >= 1.0
    return float(ranges[found][-1]) if found.any() else 0.0
