"""Water at radio frequencies: attenuation, and at 77 GHz the backscatter of drops and flakes.

Spheres are solved by Mie's series (Bohren and Huffman 1983, chapter 4), with the permittivity of
water of Liebe, Hufford and Manabe, Int. J. Infrared Millim. Waves 12, 659 (1991), at 10 deg C.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from advercity.geometry.arrays import Float64Array
from advercity.physics.weather_parts.part import ParticleSizeDistribution

SPEED_OF_LIGHT_M_S = 299_792_458.0
FREQUENCY_HZ = 77e9
WAVELENGTH_M = SPEED_OF_LIGHT_M_S / FREQUENCY_HZ
DECIBELS_PER_NEPER = 10.0 / math.log(10.0)
ICE_PERMITTIVITY = 3.18 + 0.006j
"""Of ice at -5 deg C and 77 GHz (Matzler, Thermal Microwave Radiation, IET 2006, chapter 5)."""
ComplexArray = NDArray[np.complexfloating]
_NUM_DIAMETERS = 200
_SMALLEST_MM = 0.02


def water_permittivity(
    temperature_c: float = 10.0, frequency_ghz: float = FREQUENCY_HZ / 1e9
) -> complex:
    """Compute the relative permittivity of water; the loss is positive."""
    theta, frequency = 1.0 - 300.0 / (273.15 + temperature_c), frequency_ghz
    static = 77.66 - 103.3 * theta
    first_ghz = 20.2 + 146.4 * theta + 316.0 * theta**2
    between, high = 0.0671 * static, 3.52 + 7.52 * theta
    value = static - frequency * (
        (static - between) / (frequency + 1j * first_ghz)
        + (between - high) / (frequency + 39.8j * first_ghz)
    )
    return complex(value.real, abs(value.imag))


def fog_attenuation_db_km(water_g_m3: float, frequency_ghz: float = FREQUENCY_HZ / 1e9) -> float:
    """Compute the attenuation by droplets much smaller than the wavelength (ITU-R P.840-8)."""
    epsilon = water_permittivity(frequency_ghz=frequency_ghz)
    ratio = (2.0 + epsilon.real) / epsilon.imag
    return 0.819 * frequency_ghz / (epsilon.imag * (1.0 + ratio**2)) * water_g_m3


@dataclass(frozen=True)
class PrecipitationEcho:
    """Effect of precipitation on waves of 77 GHz.

    Attributes:
        backscatter_per_m: Backscatter cross-section of a volume, m² per m³.
        attenuation_db_km: One-way attenuation.
    """

    backscatter_per_m: float
    attenuation_db_km: float


@lru_cache(maxsize=32)
def compute_echo(sizes: ParticleSizeDistribution, permittivity: complex) -> PrecipitationEcho:
    """Compute the echo of particles of a relative permittivity."""
    melted_mm = np.linspace(_SMALLEST_MM, sizes.max_melted_mm, _NUM_DIAMETERS)
    diameter_m = melted_mm * sizes.air_to_melted_diameter * 1e-3
    index = np.sqrt(permittivity)
    extinction, back = mie_efficiencies(np.pi * diameter_m / WAVELENGTH_M, index)
    per_m3 = sizes.intercept * np.exp(-sizes.slope_per_mm * melted_mm)
    area_m2 = np.pi / 4.0 * diameter_m**2 * per_m3
    attenuation = DECIBELS_PER_NEPER * 1e3 * float(np.trapezoid(area_m2 * extinction, melted_mm))
    return PrecipitationEcho(float(np.trapezoid(area_m2 * back, melted_mm)), attenuation)


Polarisation = Literal["horizontal", "vertical"]
_RainCurve = tuple[tuple[tuple[float, float, float], ...], float, float]
"""Terms a, b and c of each Gaussian, the slope m, and the constant of ITU-R P.838-3."""
_RAIN_CURVES: dict[Polarisation, tuple[_RainCurve, _RainCurve]] = {
    "horizontal": (
        (
            (
                (-5.33980, -0.10008, 1.13098),
                (-0.35351, 1.26970, 0.45400),
                (-0.23789, 0.86036, 0.15354),
                (-0.94158, 0.64552, 0.16817),
            ),
            -0.18961,
            0.71147,
        ),
        (
            (
                (-0.14318, 1.82442, -0.55187),
                (0.29591, 0.77564, 0.19822),
                (0.32177, 0.63773, 0.13164),
                (-5.37610, -0.96230, 1.47828),
                (16.1721, -3.29980, 3.43990),
            ),
            0.67849,
            -1.95537,
        ),
    ),
    "vertical": (
        (
            (
                (-3.80595, 0.56934, 0.81061),
                (-3.44965, -0.22911, 0.51059),
                (-0.39902, 0.73042, 0.11899),
                (0.50167, 1.07319, 0.27195),
            ),
            -0.16398,
            0.63297,
        ),
        (
            (
                (-0.07771, 2.33840, -0.76284),
                (0.56727, 0.95545, 0.54039),
                (-0.20238, 1.14520, 0.26809),
                (-48.2991, 0.791669, 0.116226),
                (48.5833, 0.791459, 0.116479),
            ),
            -0.053739,
            0.83433,
        ),
    ),
}


def rain_coefficients(frequency_ghz: float, polarisation: Polarisation) -> tuple[float, float]:
    """Compute coefficient and exponent of `rain_attenuation_db_km`, from 1 to 1000 GHz."""
    log = math.log10(frequency_ghz)
    values = [
        sum(a * math.exp(-(((log - b) / c) ** 2)) for a, b, c in terms) + slope * log + constant
        for terms, slope, constant in _RAIN_CURVES[polarisation]
    ]
    return 10.0 ** values[0], values[1]


def rain_attenuation_db_km(
    rate_mm_h: float, frequency_ghz: float, *, polarisation: Polarisation
) -> float:
    """Compute the one-way attenuation of rain on a level path (ITU-R P.838-3)."""
    coefficient, exponent = rain_coefficients(frequency_ghz, polarisation)
    return coefficient * rate_mm_h**exponent


def mie_efficiencies(size: Float64Array, index: complex) -> tuple[Float64Array, Float64Array]:
    """Compute the efficiencies (n,) of extinction and backscatter of spheres.

    Backscatter is the radar cross-section over the geometric one.

    Args:
        size: (n,) circumference over wavelength.
        index: Complex refractive index, with a positive imaginary part.
    """
    orders = int(size.max() + 4.0 * size.max() ** (1.0 / 3.0) + 2.0)
    inside = _log_derivatives(index * size, orders)
    psi, psi_before = np.sin(size), np.cos(size)
    chi, chi_before = np.cos(size), -np.sin(size)
    extinction, back = np.zeros_like(size), np.zeros(len(size), complex)
    for n in range(1, orders + 1):
        psi, psi_before = (2 * n - 1) / size * psi - psi_before, psi
        chi, chi_before = (2 * n - 1) / size * chi - chi_before, chi
        xi, xi_before = psi - 1j * chi, psi_before - 1j * chi_before
        electric, magnetic = (
            factor + n / size for factor in (inside[n] / index, inside[n] * index)
        )
        a = (electric * psi - psi_before) / (electric * xi - xi_before)
        b = (magnetic * psi - psi_before) / (magnetic * xi - xi_before)
        # Upward recurrence of psi is unstable for orders far above the size, which do not matter.
        matters = n <= size + 4.0 * np.cbrt(size) + 2.0
        extinction += np.where(matters, (2 * n + 1) * (a + b).real, 0.0)
        back += np.where(matters, (2 * n + 1) * (-1) ** n * (a - b), 0.0)
    return 2.0 / size**2 * extinction, np.abs(back) ** 2 / size**2


def _log_derivatives(argument: ComplexArray, orders: int) -> list[ComplexArray]:
    """Compute the logarithmic derivatives of Riccati-Bessel functions, by downward recurrence."""
    start = orders + int(np.abs(argument).max()) + 15
    found: list[ComplexArray] = [np.zeros_like(argument)] * (start + 1)
    for n in range(start, 0, -1):
        found[n - 1] = n / argument - 1.0 / (found[n] + n / argument)
    return found


def mix_permittivities(host: complex, inclusion: complex, fraction: float) -> complex:
    """Mix two materials (Maxwell Garnett)."""
    contrast = fraction * (inclusion - host) / (inclusion + 2.0 * host)
    return host * (1.0 + 2.0 * contrast) / (1.0 - contrast)
