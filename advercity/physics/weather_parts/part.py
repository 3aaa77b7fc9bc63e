"""Records of a part of the weather: floating or falling particles, and functions to find them.

Diameters are in millimetres. Snow is sized by its melted diameter, as in the literature.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from advercity_dsl import Weather

from advercity.geometry.arrays import FloatArray
from advercity.physics.scattering import PhaseLobes

WATER_DENSITY_G_M3 = 1e6
_ISOTROPIC = PhaseLobes.from_mean_cosine(0.0)


@dataclass(frozen=True)
class Extinction:
    """Extinction coefficient in 1/m at the two wavelengths of sensors."""

    at_550nm: float = 0.0
    at_905nm: float = 0.0

    def __add__(self, other: "Extinction") -> "Extinction":
        return Extinction(self.at_550nm + other.at_550nm, self.at_905nm + other.at_905nm)


@dataclass(frozen=True)
class Suspension:
    """Floating particles.

    Attributes:
        name: Name of the part.
        extinction: Their extinction.
        mor_m: Visibility in them alone, which sets the extinction.
        infrared_depth_m: Height up to which they are in the infrared sky.
        infrared_factor: Extinction from 8 to 14 um relative to 550 nm; droplets follow Mie.
        layer_m: Depth of their daylight-scattering layer; None if they belong to the clear sky.
        lobes: Their phase function in such a layer.
        albedo: Scattered fraction of red, green and blue light; the rest is absorbed.
        lidar_ratio_sr: Extinction over backscatter at 905 nm; None if no LiDAR detects them.
        droplet_um: Effective diameter of droplets of water; None for other particles.
    """

    name: str
    extinction: Extinction
    mor_m: float = math.inf
    infrared_depth_m: float = 0.0
    infrared_factor: float = 1.0
    layer_m: float | None = None
    lobes: PhaseLobes = _ISOTROPIC
    albedo: tuple[float, float, float] = (1.0, 1.0, 1.0)
    lidar_ratio_sr: float | None = None
    droplet_um: float | None = None

    @property
    def water_g_m3(self) -> float:
        """Liquid water of the droplets, from their extinction of light."""
        droplet_um = self.droplet_um or 0.0
        return self.extinction.at_550nm * droplet_um * 1e-6 / 3.0 * WATER_DENSITY_G_M3


@dataclass(frozen=True)
class ParticleSizeDistribution:
    """Exponential distribution: `intercept` exp(-`slope_per_mm` D), D the melted diameter.

    Attributes:
        intercept: Particles per m³ and mm at D = 0.
        slope_per_mm: Decay of the number with D.
        max_melted_mm: Largest melted diameter.
        air_to_melted_diameter: Diameter in the air relative to the melted diameter.
    """

    intercept: float
    slope_per_mm: float
    max_melted_mm: float
    air_to_melted_diameter: float = 1.0

    def number_concentration_above(self, diameter_mm: FloatArray | float) -> FloatArray:
        """Compute the number per m³ (n,) of particles above a melted diameter."""
        least = np.minimum(diameter_mm, self.max_melted_mm)
        beyond = math.exp(-self.slope_per_mm * self.max_melted_mm)
        tail = np.exp(-self.slope_per_mm * least) - beyond
        return self.intercept / self.slope_per_mm * tail

    def sample_diameters_mm(
        self, min_mm: FloatArray, uniform: FloatArray, max_mm: FloatArray | float
    ) -> FloatArray:
        """Convert numbers (n,) in [0, 1) to melted diameters (n,) between two bounds."""
        span = 1.0 - np.exp(-self.slope_per_mm * np.maximum(max_mm - min_mm, 0.0))
        return min_mm - np.log1p(-uniform * span) / self.slope_per_mm


@dataclass(frozen=True, kw_only=True)
class Precipitation:
    """Falling particles.

    Attributes:
        name: Name of the part.
        sizes: Their sizes.
        extinction_per_m: Extinction coefficient; they are much larger than both wavelengths.
        compute_speed: Terminal speed by melted diameter, in units of `speed_m_s`.
        speed_m_s: Unit of the terminal speed.
        reflectance: Lambertian reflectance of a particle at 905 nm. The receiver of a LiDAR looks
            a few mrad off the beam, so it misses the glory of exact backscatter.
        permittivity: Relative permittivity at 77 GHz.
        attenuation_db_km: One-way attenuation at 77 GHz; None if it follows from the sizes.
        bands_mm: Edges of bands of melted diameter in images, without the largest diameter.
            Smaller particles only add to the extinction of the air.
        speed_factors: Factors of the speed, as particles of one size differ in shape.
        sways: Whether gusts sway the particles; others are too heavy.
        is_clear: Whether light passes through them.
        glint_deviation: Standard deviation of the logarithm of their brightness.
    """

    name: str
    sizes: ParticleSizeDistribution
    extinction_per_m: float
    compute_speed: Callable[[FloatArray | float], FloatArray]
    speed_m_s: float = 1.0
    reflectance: float
    permittivity: complex
    attenuation_db_km: float | None = None
    bands_mm: tuple[float, ...]
    speed_factors: tuple[float, ...] = (1.0,)
    sways: bool = False
    is_clear: bool = False
    glint_deviation: float = 0.0

    @property
    def extinction(self) -> Extinction:
        """Extinction of the particles."""
        return Extinction(self.extinction_per_m, self.extinction_per_m)


AirPart = Suspension | Precipitation


@dataclass(frozen=True)
class Deposit:
    """A part of the weather on the ground.

    Attributes:
        name: Name of the part.
        depth_m: Depth in the open.
        road_coverage: Fraction of the carriageway under it.
        rut_coverage: Fraction of the wheel ruts under it.
        friction: Coefficient of tyres on it; None for the drivers' friction on snow.
    """

    name: str
    depth_m: float
    road_coverage: float
    rut_coverage: float
    friction: float | None = None


def _list_no_words(part: Any, weather: Weather) -> Iterable[str]:
    return ()


@dataclass(frozen=True)
class PartPhysics:
    """Effects of a part of the weather, as functions of its value in a weather.

    Attributes:
        find_particles: Its particles in the air; None if it has none.
        find_deposit: Its particles on the ground; None if none lie there.
        list_words: Its terms in texts, of the value and its weather.
        list_quantities: Its quantities in datasets, by name with the unit at its end.
    """

    find_particles: Callable[[Any], AirPart | None]
    find_deposit: Callable[[Any], Deposit | None] = lambda part: None
    list_words: Callable[[Any, Weather], Iterable[str]] = _list_no_words
    list_quantities: Callable[[Any], Mapping[str, float]] = lambda part: {}


@cache
def load_all_physics() -> Mapping[str, PartPhysics]:
    """Load the effects of all parts, by name."""
    # Imported here: loading the language's models takes longer than opening a dataset.
    from advercity_dsl.registry import load_named
    from advercity_dsl.weather_parts import load_weather_parts

    return {name: load_named(part.physics) for name, part in load_weather_parts().found.items()}


def iterate_parts(weather: Weather) -> Iterator[tuple[PartPhysics, Any]]:
    """Iterate over the parts of a weather, also absent ones: effects and value."""
    for name, physics in load_all_physics().items():
        yield physics, getattr(weather, name)


def list_deposits(weather: Weather) -> list[Deposit]:
    """List the deposits on the ground in a weather, in the order of the parts."""
    found = (physics.find_deposit(part) for physics, part in iterate_parts(weather))
    return [deposit for deposit in found if deposit is not None]
