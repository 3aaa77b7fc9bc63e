"""Thermal infrared, 8 to 14 um: radiance by temperature, extinction in the air, and the sky.

Water drops are Mie spheres with the refractive index of Hale and Querry (Appl. Opt. 12, 555, 1973).
Compared with the visible, fog of small droplets (radiation fog) has half the extinction; fog of
large ones, rain and snow have the same, and haze is nearly transparent.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from advercity_dsl import Weather
from numpy.typing import NDArray
from scipy.special import spherical_jn, spherical_yn

from advercity.geometry.arrays import Float64Array, FloatArray
from advercity.physics.clouds import choose_cloud_kind
from advercity.physics.extinction import AirExtinction
from advercity.physics.weather_parts.part import Suspension

BAND_UM = 8.0, 14.0
ZERO_CELSIUS_K = 273.15
STEFAN_BOLTZMANN = 5.670374e-8
"""W/(m² K⁴)."""
_PLANCK_1, _PLANCK_2 = 1.191043e8, 14387.77
"""Constants of Planck's law for micrometres, W/(m² sr um) and um K."""
_TABLE_K = np.arange(120.0, 1001.0, 0.5)

WATER_UM = np.arange(8.0, 15.0)
WATER_INDEX = np.array(
    [
        1.291 + 0.0343j,
        1.262 + 0.0399j,
        1.218 + 0.0508j,
        1.153 + 0.0968j,
        1.111 + 0.199j,
        1.123 + 0.305j,
        1.149 + 0.370j,
    ]
)
"""Refractive index of water at `WATER_UM`."""
DRY_GAS_PER_KM, VAPOUR_PER_KM = 0.06, 0.023
"""Extinction by carbon dioxide and the like, and for each g/m³ of vapour: an assumption, with a
transmittance of 0.82 per km at 6 g/m³ and 0.68 at 14, close to models of the atmosphere."""
VAPOUR_DEPTH_M = 2200.0
"""Height of a column of all vapour at the ground's density."""
DRY_HUMIDITY = 0.7
"""Relative humidity without fog and precipitation."""
SKY_COOLER_K = 5.0
"""Temperature of the emitting air of a clear sky below the air's at the ground."""
LAPSE_K_M = 0.0065
_MIN_SINE = 0.03
"""Sine of the elevation below which paths grow no longer: the Earth is round."""


@lru_cache(maxsize=1)
def _tabulate_radiance() -> Float64Array:
    wavelength_um = np.linspace(*BAND_UM, 121)
    exponent = _PLANCK_2 / (wavelength_um * _TABLE_K[:, None])
    spectrum = _PLANCK_1 / wavelength_um**5 / np.expm1(exponent)
    return np.asarray(np.trapezoid(spectrum, wavelength_um, axis=1))


def band_radiance(kelvin: FloatArray | float) -> Float64Array:
    """Compute the radiance (...) of a black body from 8 to 14 um, W/(m² sr), by Planck's law."""
    return np.asarray(np.interp(kelvin, _TABLE_K, _tabulate_radiance()))


def brightness_temperature(radiance: FloatArray | float) -> Float64Array:
    """Compute the temperature (...) in kelvin of the black body with a radiance (...)."""
    return np.asarray(np.interp(radiance, _tabulate_radiance(), _TABLE_K))


def mie_extinction(size: Float64Array, index: complex) -> Float64Array:
    """Compute the extinction efficiency (n,) of spheres by their size parameter (n,).

    Bohren and Huffman, Absorption and Scattering of Light by Small Particles, eqs. 4.53 and 4.62.
    """
    order = np.arange(1, int(size.max() + 4.0 * size.max() ** (1 / 3) + 10))[:, None]

    def psi(z: NDArray[np.complex128]) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        value = spherical_jn(order, z)
        return z * value, value + z * spherical_jn(order, z, derivative=True)

    inside, inside_slope = psi((index * size).astype(np.complex128))
    outside, outside_slope = psi(size.astype(np.complex128))
    second = spherical_yn(order, size)
    xi = outside + 1j * size * second
    xi_slope = outside_slope + 1j * (second + size * spherical_yn(order, size, derivative=True))
    electric = (index * inside * outside_slope - outside * inside_slope) / (
        index * inside * xi_slope - xi * inside_slope
    )
    magnetic = (inside * outside_slope - index * outside * inside_slope) / (
        inside * xi_slope - index * xi * inside_slope
    )
    terms = (2 * order + 1) * (electric + magnetic).real
    # Functions of high orders at small sizes overflow; their terms are negligible.
    return 2.0 / size**2 * np.where(np.isfinite(terms), terms, 0.0).sum(axis=0)


DROPLET_VARIANCE = 0.15
"""Effective variance of the gamma distribution of droplets (Hansen and Travis 1974)."""


@lru_cache(maxsize=64)
def droplet_factor(diameter_um: float) -> float:
    """Compute the extinction of fog in the band relative to the visible, by effective diameter."""
    radius = np.linspace(0.05, 4.0, 40) * diameter_um / 2.0
    mean = diameter_um / 2.0
    power = (1.0 - 3.0 * DROPLET_VARIANCE) / DROPLET_VARIANCE
    area = radius ** (power + 2.0) * np.exp(-radius / (mean * DROPLET_VARIANCE))
    by_wavelength = [
        float(mie_extinction(2.0 * math.pi * radius / wavelength, complex(index)) @ area)
        for wavelength, index in zip(WATER_UM.tolist(), WATER_INDEX.tolist(), strict=True)
    ]
    return float(np.mean(by_wavelength) / (2.0 * area.sum()))


def vapour_g_m3(temperature_c: float, humidity: float) -> float:
    """Compute the density of water vapour (Magnus formula, WMO-No. 8)."""
    pressure_pa = humidity * 611.2 * math.exp(17.62 * temperature_c / (243.12 + temperature_c))
    return 1000.0 * pressure_pa / (461.5 * (temperature_c + ZERO_CELSIUS_K))


@dataclass(frozen=True)
class InfraredAir:
    """Air and sky from 8 to 14 um.

    Attributes:
        air_k: Temperature of the air.
        gas_per_m: Extinction by gases.
        drops_per_m: Extinction by haze, fog, precipitation and dust.
        drops_depth_m: Height up to which those are above a camera.
        cloud_fraction: Fraction of the sky covered by clouds.
        cloud_k: Temperature of their base.
        cloud_base_m: Height of their base.
    """

    air_k: float
    gas_per_m: float
    drops_per_m: float
    drops_depth_m: float
    cloud_fraction: float
    cloud_k: float
    cloud_base_m: float

    @staticmethod
    def from_weather(weather: Weather, extinction: AirExtinction) -> "InfraredAir":
        """Derive the air of a weather with an extinction."""
        temperature_c, precipitation = weather.temperature_c, extinction.precipitation
        is_wet = extinction.water_g_m3 > 0 or bool(precipitation)
        vapour = vapour_g_m3(temperature_c, 1.0 if is_wet else DRY_HUMIDITY)
        _, base_m, _ = choose_cloud_kind(weather.sky.oktas, precipitating=bool(precipitation))
        layers = [
            *((_compute_extinction(part), part.infrared_depth_m) for part in extinction.suspended),
            *((part.extinction_per_m, base_m) for part in precipitation),
        ]
        drops_per_m = sum(layer for layer, _ in layers)
        optical_depth = sum(layer * depth for layer, depth in layers)
        return InfraredAir(
            air_k=temperature_c + ZERO_CELSIUS_K,
            gas_per_m=(DRY_GAS_PER_KM + VAPOUR_PER_KM * vapour) / 1000.0,
            drops_per_m=drops_per_m,
            drops_depth_m=optical_depth / drops_per_m if drops_per_m else 0.0,
            cloud_fraction=weather.sky.oktas / 8.0,
            cloud_k=temperature_c + ZERO_CELSIUS_K - LAPSE_K_M * base_m,
            cloud_base_m=base_m,
        )

    @property
    def extinction_per_m(self) -> float:
        """Extinction near the ground."""
        return self.gas_per_m + self.drops_per_m

    def see_through(self, radiance: Float64Array, range_m: Float64Array) -> Float64Array:
        """Compute the radiance (...) seen through the air, which radiates itself.

        Drops scatter as much light of their surroundings into the path as out of it; the
        surroundings count as black bodies of the air's temperature.
        """
        transmittance = np.exp(-self.extinction_per_m * range_m)
        return transmittance * radiance + (1.0 - transmittance) * band_radiance(self.air_k)

    def sky_radiance(self, sine: Float64Array) -> Float64Array:
        """Compute the radiance (...) of the sky, W/(m² sr), by the sine (...) of the elevation."""
        path = 1.0 / np.maximum(sine, _MIN_SINE)
        gas, cloud = band_radiance(self.air_k - SKY_COOLER_K), band_radiance(self.cloud_k)
        clear = -np.expm1(-self.gas_per_m * VAPOUR_DEPTH_M * path) * gas
        below = np.exp(-self.gas_per_m * min(self.cloud_base_m, VAPOUR_DEPTH_M) * path)
        cloudy = below * cloud + (1.0 - below) * gas
        above = (1.0 - self.cloud_fraction) * clear + self.cloud_fraction * cloudy
        left = np.exp(-self.drops_per_m * self.drops_depth_m * path)
        return left * above + (1.0 - left) * band_radiance(self.air_k)

    @property
    def longwave_loss_w_m2(self) -> float:
        """Net loss of a black level surface of the air's temperature to an open sky.

        Clear: Swinbank (Q. J. R. Meteorol. Soc. 89, 339, 1963); clouds: Unsworth and Monteith
        (ibid. 101, 13, 1975).
        """
        clear = 9.365e-6 * self.air_k**2
        emissivity = clear + 0.84 * self.cloud_fraction * (1.0 - clear)
        left = math.exp(-self.drops_per_m * self.drops_depth_m)
        return max(0.0, left * (1.0 - emissivity)) * STEFAN_BOLTZMANN * self.air_k**4


def _compute_extinction(part: Suspension) -> float:
    """Compute the extinction of floating particles from 8 to 14 um, 1/m."""
    factor = droplet_factor(part.droplet_um) if part.droplet_um else part.infrared_factor
    return part.extinction.at_550nm * factor
