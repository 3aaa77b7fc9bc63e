"""Echoes of single drops and flakes that fly through a beam.

Particles that send back enough are rare and independent, so how many a beam meets is a Poisson
number. Rate, range and size come from tables made once per weather; no particle is simulated.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from advercity_dsl import Weather
from numpy.typing import NDArray

from advercity.sensors.lidar.beams import APERTURE_M, DIVERGENCE_RAD
from advercity.sensors.lidar.cloud import PointKind
from advercity.sensors.lidar.draws import LEVELS, levels
from advercity.sensors.lidar.power import echo
from advercity.weather.precipitation import SizeDistribution, sizes_of

Array = NDArray[np.float64]
Floats = NDArray[np.floating[Any]]

REFLECTANCE = {"rain": 0.05, "snow": 0.2}
"""Of a drop seen from a few mrad beside the beam, where the glory right behind it is missed; of a
flake."""
POINT_KIND = {"rain": PointKind.RAIN, "snow": PointKind.SNOW}
NEAREST_M = 0.5
REACH_M = 60.0
STEP_M = 0.02
LEAST_POWER = 0.4
"""Weaker particles are left out; three standard deviations of noise would have to help."""


@dataclass(frozen=True, eq=False)
class ParticleTable:
    """How often, where and how strongly a beam meets particles of one kind."""

    sizes: SizeDistribution
    expected: float
    """Particles of at least `LEAST_POWER` that a beam meets."""
    range_m: Floats
    """Where they are: quantiles (LEVELS,)."""
    least_mm: Floats
    """Melted diameter (LEVELS,) there of a particle of that power."""

    @staticmethod
    def of(sizes: SizeDistribution, extinction: float) -> "ParticleTable":
        """The table for air of that extinction, 1/m."""
        range_m = np.arange(NEAREST_M, REACH_M, STEP_M)
        least_mm = least_diameter_mm(range_m, sizes, extinction, LEAST_POWER)
        per_m = beam_area_m2(range_m) * sizes.number_above(least_mm)
        steps = np.concatenate([[0.0], (per_m[1:] + per_m[:-1]) / 2.0 * STEP_M])
        met = np.cumsum(steps)
        middle = np.interp((np.arange(LEVELS) + 0.5) * (met[-1] / LEVELS), met, range_m)
        least = np.interp(middle, range_m, least_mm)
        return ParticleTable(
            sizes, float(met[-1]), middle.astype(np.float32), least.astype(np.float32)
        )

    def draw(
        self, beams: int, rng: np.random.Generator
    ) -> tuple[NDArray[np.int32], Floats, Floats]:
        """Beam (k,) ascending, range (k,) and power (k,) of all that a turn of beams meets.

        As if nothing else stood in the way; what is behind a surface is for the caller to drop.
        """
        count = int(rng.poisson(beams * self.expected))
        beam = np.sort(rng.integers(beams, size=count, dtype=np.int32))
        level = levels(rng, count)
        least_mm = self.least_mm.take(level)
        diameter_mm = least_mm + self._beyond(least_mm, rng.random(count, np.float32))
        power = np.float32(LEAST_POWER) * (diameter_mm / least_mm) ** 2
        return beam, self.range_m.take(level), power

    def _beyond(self, least_mm: Floats, uniform: Floats) -> Floats:
        """How much larger (k,) than the least each is: exponential, cut at the largest."""
        slope = np.float32(self.sizes.slope_per_mm)
        cut = 1.0 - np.exp(-slope * np.maximum(self.sizes.largest_mm - least_mm, 0.0))
        return -np.log1p(-uniform * cut) / slope


def tables_of(weather: Weather, extinction: float) -> tuple[ParticleTable, ...]:
    """The tables of all that falls in `weather`."""
    return tuple(ParticleTable.of(sizes, extinction) for sizes in sizes_of(weather))


def beam_area_m2(range_m: Array) -> Array:
    """Cross-section (n,) of a beam, an ellipse."""
    wide, high = (
        size + opening * range_m for size, opening in zip(APERTURE_M, DIVERGENCE_RAD, strict=True)
    )
    return math.pi / 4.0 * wide * high


def least_diameter_mm(
    range_m: Array, sizes: SizeDistribution, extinction: float, power: float
) -> Array:
    """Melted diameter (n,) of a particle that returns `power`, against the threshold."""
    filling = echo(range_m, np.full_like(range_m, REFLECTANCE[sizes.kind]), extinction)
    area_m2 = power / filling * beam_area_m2(range_m)
    return np.sqrt(area_m2 * 4.0 / math.pi) * 1e3 / sizes.swelling
