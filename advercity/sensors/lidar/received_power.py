"""The LiDAR equation, detection statistics, and the reflectance of surfaces at 905 nm.

Powers are relative to the detection threshold in the dark; a return of 1 is detected half of the
time.
"""

import math
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from advercity_dsl import Lidar
from numpy.typing import NDArray

from advercity.geometry.arrays import FloatArray
from advercity.materials import MATERIALS, SNOW_FACET_SLOPE_DEG, SNOW_REFLECTANCE_905NM
from advercity.physics.extinction import extinction_from_mor
from advercity.physics.water import fresnel_reflectance
from advercity.rendering.raycaster import MATERIAL_NAMES, RayHits
from advercity.semantics import Semantic

REFERENCE_REFLECTANCE = 0.10
REFERENCE_MOR_M = 20_000.0
"""Reflectance of the target and visibility of the air for the detection range of data sheets."""
SIGNAL_TO_NOISE = 5.0
"""Signal-to-noise ratio of a return at the detection threshold."""
PULSE_LENGTH_M = 0.749
"""Half the length of a 5 ns pulse: returns closer than this overlap and count as one."""
NOISE_DOUBLING_LX = 50_000.0 / 0.3
"""Illuminance whose noise power equals the receiver's in the dark."""
_REFERENCE_PULSE_NS = 5.0


@dataclass(frozen=True)
class Receiver:
    """The sensitivity of a receiver and the length of its pulses.

    Attributes:
        white_target_power: Power of a white target facing the sensor in a vacuum, relative to the
            threshold in the dark, without the factor 1/(R² + near_field²).
        near_field_m: Range below which gain control and incomplete overlap keep power below 1/R².
        pulse_length_m: Returns closer than this overlap and count as one.
        field_of_view_rad: Full field of view of a channel.
    """

    white_target_power: float
    near_field_m: float
    pulse_length_m: float
    field_of_view_rad: float

    @staticmethod
    def from_lidar(lidar: Lidar) -> "Receiver":
        """Build the receiver that detects a target of 10 % at the range declared by the rig."""
        declared = lidar.receiver
        range_m, near_field_m = declared.range_at_10_percent_m, declared.near_field_m
        returned = (
            REFERENCE_REFLECTANCE
            / math.pi
            * math.exp(-2.0 * extinction_from_mor(REFERENCE_MOR_M) * range_m)
            / (range_m**2 + near_field_m**2)
        )
        # Exactly zero for a probability of one half.
        excess = NormalDist().inv_cdf(declared.detection_probability) / SIGNAL_TO_NOISE
        above_threshold = (1.0 + excess) * daylight_noise_factor(declared.illuminance_lx)
        return Receiver(
            white_target_power=above_threshold / (math.pi * returned),
            near_field_m=near_field_m,
            pulse_length_m=PULSE_LENGTH_M * (lidar.beam.pulse_ns / _REFERENCE_PULSE_NS),
            field_of_view_rad=declared.field_of_view_mrad * 1e-3,
        )

    def received_power(
        self,
        range_m: FloatArray,
        reflected_fraction: FloatArray | np.float32,
        extinction_per_m: float,
    ) -> FloatArray:
        """Compute the power (n,) of a hard Lambertian target, relative to the threshold.

        The LiDAR equation of a target that fills the beam is
        `rho cos(a) exp(-2 k R) / (R² + R0²)`; `reflected_fraction` is `rho cos(a)`.
        """
        # In the dtype of the ranges: a float64 factor would promote whole float32 scans.
        transmittance = np.exp(range_m * range_m.dtype.type(-2.0 * extinction_per_m))
        falloff = self.white_target_power / (range_m * range_m + self.near_field_m**2)
        return transmittance * reflected_fraction * falloff

    def apparent_reflectance(self, power: FloatArray, range_m: FloatArray) -> FloatArray:
        """Compute the reflectance (n,) of a target with the same power in clear air."""
        return power * ((range_m * range_m + self.near_field_m**2) / self.white_target_power)

    def detection_range_m(
        self, reflectance: float, extinction_per_m: float, *, max_range_m: float = 200.0
    ) -> float:
        """Compute the range, in the dark, where a target facing the sensor has power 1.

        `extinction_per_m` holds for all of its light.
        """
        step = DETECTION_RANGE_STEP_M
        ranges = np.arange(step, max_range_m + step / 2, step)
        reflectances = np.full_like(ranges, reflectance)
        found = self.received_power(ranges, reflectances, extinction_per_m) >= 1.0
        return float(ranges[found][-1]) if found.any() else 0.0


def range_standard_deviation_m(lidar: Lidar, power: FloatArray) -> FloatArray:
    """Compute the standard deviation (n,) of the range of returns: the instrument's and noise's."""
    error_m = lidar.receiver.noise_range_error_m
    return np.sqrt(lidar.range_noise_m**2 + (error_m / (SIGNAL_TO_NOISE * power)) ** 2)


DETECTION_RANGE_STEP_M = 0.1
WHITE_LEVEL_OF_BYTE = 255.0
BRIGHTEST_REFLECTANCE = 1000.0
"""Reflectance reported as 255: pi times the 300 cd/lx/m² of the brightest sheeting."""


def reflectivity_fraction(reflectance: FloatArray, white_level: int) -> FloatArray:
    """Compute the reported level (n,) of a reflectance, over 255.

    The level is linear up to `white_level` at 100 %, and logarithmic for retroreflectors, as in the
    manuals of Velodyne and Ouster.
    """
    span = (WHITE_LEVEL_OF_BYTE - white_level) / math.log(BRIGHTEST_REFLECTANCE)
    beyond = white_level + span * np.log(np.maximum(reflectance, 1.0))
    level = np.where(reflectance < 1.0, white_level * reflectance, beyond)
    return np.rint(np.minimum(level, WHITE_LEVEL_OF_BYTE)) / np.float32(WHITE_LEVEL_OF_BYTE)


def daylight_noise_factor(illuminance_lx: float) -> float:
    """Compute the factor by which daylight raises the receiver's noise and its threshold."""
    return math.sqrt(1.0 + illuminance_lx / NOISE_DOUBLING_LX)


def detection_margin_sigma(power: FloatArray) -> FloatArray:
    """Compute the margin (n,) of returns above the threshold, in standard deviations of noise."""
    return SIGNAL_TO_NOISE * (power - 1.0)


WATER_REFRACTIVE_INDEX_905NM = 1.328
"""Refractive index of water at 905 nm."""
PANE_TRANSMITTANCE = 0.85
"""Transmittance of a window pane, one way."""
GLOSS_WIDTH_RAD = 0.07
"""Width of the specular lobe of varnish: within 4 degrees of normal incidence it dominates."""
_WATER_INTERNAL_REFLECTANCE_905NM = 0.4702
"""Reflectance of a water surface for diffuse light from inside."""
_BEAD_SHADING_COSINE = 0.05
"""Cosine of incidence below which glass beads in paint shade each other."""
_WET_BEAD_FACTOR = 0.2
"""Fraction of the beads' retroreflection left on a soaked road."""


def compute_rough_lobe(facet_slope_deg: float) -> float:
    """Compute the return of a rough surface at grazing incidence, relative to normal incidence.

    The return at the angle a, relative to normal incidence, is `cos(a) + lobe sin²(a)`, by Oren and
    Nayar's qualitative model (SIGGRAPH 1994) with source and sensor at one place.

    Args:
        facet_slope_deg: Standard deviation of the inclination of its Lambertian facets.
    """
    variance = math.radians(facet_slope_deg) ** 2
    facing = 1.0 - 0.5 * variance / (variance + 0.33)
    return 0.45 * variance / (variance + 0.09) / facing


_ROWS = [MATERIALS[name] for name in MATERIAL_NAMES]
_DIFFUSE = np.array([row.reflectance_905nm for row in _ROWS], np.float32)
_ROUGH_LOBE = np.array([compute_rough_lobe(row.facet_slope_deg) for row in _ROWS], np.float32)
_SNOW_LOBE = np.float32(compute_rough_lobe(SNOW_FACET_SLOPE_DEG))
_VARNISHED = np.array([row.is_varnished for row in _ROWS], np.float32)
_SHEETING = np.array([row.sheeting_reflectance for row in _ROWS], np.float32)
_BEADS = np.array([row.bead_reflectance for row in _ROWS], np.float32)
_IS_PLAIN = (_VARNISHED + _SHEETING + _BEADS) == 0.0
IS_GLASS = np.array([row.is_transparent for row in _ROWS])


def effective_reflectance(
    hits: RayHits, *, wetness: float = 0.0, snow_cover: float = 0.0, road_snow_cover: float = 0.0
) -> FloatArray:
    """Compute the return of surfaces (n,) relative to a white one facing the sensor.

    A Lambertian surface returns its reflectance times the cosine of incidence, a rough one more at
    grazing incidence; retroreflectors return more than 1. Water films and snow cover surfaces that
    face up under the open sky, not walls and windows. `wetness` is 0 dry to 1 soaked; covers are
    fractions of the ground and of carriageways.
    """
    reflectance, lobe = (table.take(hits.material) for table in (_DIFFUSE, _ROUGH_LOBE))
    upward = (
        hits.keep_exposed(np.clip(hits.normal[:, 2], 0.0, 1.0))
        if wetness or snow_cover or road_snow_cover
        else None
    )
    if upward is not None and (snow_cover or road_snow_cover):
        on_road = (hits.semantic == Semantic.ROAD) | (hits.semantic == Semantic.ROAD_LINE)
        covered = upward * np.array([snow_cover, road_snow_cover], np.float32).take(on_road)
        reflectance = reflectance + covered * (np.float32(SNOW_REFLECTANCE_905NM) - reflectance)
        lobe = lobe + covered * (_SNOW_LOBE - lobe)
    cosine = hits.cosine
    # Misses have a cosine of 0.
    square_sine = (1.0 - cosine * cosine) * (cosine > 0.0)
    effective = reflectance * (cosine + lobe * square_sine)
    if upward is not None and wetness:
        wet = reflectance * cosine * wet_reflectance_ratio(reflectance, cosine, lobe)
        effective += np.float32(wetness) * upward * (wet - effective)
    special = np.flatnonzero(~_IS_PLAIN.take(hits.material))
    film = wetness
    if hits.is_covered is not None:
        film = hits.keep_exposed(np.full(len(effective), wetness, np.float32)).take(special)
    effective[special] += _special_reflectance(
        hits.material.take(special), hits.cosine.take(special), film
    )
    return effective


def _special_reflectance(
    material: NDArray[np.int16], cosine: FloatArray, wetness: FloatArray | float
) -> FloatArray:
    """Compute the contributions (k,) of varnish, retroreflective sheeting and glass beads."""
    gloss = np.exp((cosine - 1.0) / GLOSS_WIDTH_RAD**2)
    beads = np.minimum(cosine / _BEAD_SHADING_COSINE, 1.0) * (
        1.0 - (1.0 - _WET_BEAD_FACTOR) * wetness
    )
    return (
        _VARNISHED[material] * gloss
        + _SHEETING[material] * cosine**2
        + _BEADS[material] * beads.astype(np.float32)
    )


def wet_reflectance_ratio(
    reflectance: FloatArray, cosine: FloatArray, rough_lobe: FloatArray | float = 0.0
) -> FloatArray:
    """Compute the return (n,) of a target under a film of water, relative to a Lambertian dry one.

    Light crosses the surface twice and is partly absorbed after internal reflection (Angstrom
    1925; Lekner and Dorf 1988); at grazing incidence most of it is reflected away. Water refracts
    it towards the normal, which leaves little of the lobe of a rough target.
    """
    index_squared = WATER_REFRACTIVE_INDEX_905NM**2
    transmitted = 1.0 - fresnel_reflectance(cosine, WATER_REFRACTIVE_INDEX_905NM)
    square_sine = (1.0 - cosine * cosine) / np.float32(index_squared)
    rough = 1.0 + rough_lobe * square_sine / np.sqrt(1.0 - square_sine)
    return (
        rough
        * transmitted**2
        / (index_squared * (1.0 - reflectance * _WATER_INTERNAL_REFLECTANCE_905NM))
    )
