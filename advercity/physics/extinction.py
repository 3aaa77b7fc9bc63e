"""How fast light is lost in air, fog, rain, snow and dust: extinction coefficients in 1/m.

Extinctions of components add. 550 nm stands for the visible, 905 nm is the LiDAR's wavelength.
"""

import math
from dataclasses import dataclass

from advercity_dsl import Weather


def visibility_without_precipitation_m(weather: Weather) -> float:
    """What haze, fog and dust leave of it together; extinctions add."""
    parts = (weather.air.mor_m, weather.fog.mor_m, weather.dust.mor_m)
    extinction = sum(1 / part for part in parts if part is not None)
    return 1 / extinction if extinction else float("inf")


KOSCHMIEDER_CONSTANT = math.log(20.0)
"""Extinction times meteorological optical range: 5 % contrast is left, WMO-No. 8."""
DUST_FACTOR_905NM = 0.95
"""Extinction of mineral dust at 905 nm against 550 nm; weak in wavelength."""


@dataclass(frozen=True)
class Extinction:
    """One component's extinction in 1/m at both wavelengths."""

    at_550nm: float = 0.0
    at_905nm: float = 0.0

    def __add__(self, other: "Extinction") -> "Extinction":
        return Extinction(self.at_550nm + other.at_550nm, self.at_905nm + other.at_905nm)


def extinction_from_mor(mor_m: float) -> float:
    """Extinction in 1/m of air with a meteorological optical range in metres (Koschmieder)."""
    return KOSCHMIEDER_CONSTANT / mor_m


def kim_wavelength_factor(mor_m: float, *, wavelength_nm: float = 905.0) -> float:
    """Extinction of haze at a wavelength against 550 nm, by visibility.

    Kim, McArthur and Korevaar, Proc. SPIE 4214 (2001); the exponent is stated for the 2 %
    visibility. In fog (below 500 m) there is no dependence on wavelength.
    """
    visibility_km = mor_m * math.log(50.0) / KOSCHMIEDER_CONSTANT / 1000.0
    if visibility_km > 50.0:
        exponent = 1.6
    elif visibility_km > 6.0:
        exponent = 1.3
    elif visibility_km > 1.0:
        exponent = 0.16 * visibility_km + 0.34
    else:
        exponent = max(0.0, visibility_km - 0.5)
    return (wavelength_nm / 550.0) ** -exponent


def rain_extinction(rate_mm_h: float, *, q_ext: float = 2.0) -> float:
    """Extinction of rain in 1/m, any wavelength from 0.4 to 1.6 µm.

    Marshall-Palmer drop sizes, 8000 exp(-4.1 R^-0.21 D) per m³ and mm, integrated in closed
    form with the extinction efficiency `q_ext`, which is 2 in the geometric limit.
    """
    if rate_mm_h == 0.0:
        return 0.0
    slope_per_mm = 4.1 * rate_mm_h**-0.21
    return q_ext / 2.0 * math.pi * 8000e-6 / slope_per_mm**3


def snow_extinction(rate_mm_h: float, *, density_g_cm3: float = 0.1) -> float:
    """Extinction of snow in 1/m by its liquid-equivalent rate and the density of its flakes.

    Gunn-Marshall sizes of the melted flakes; a flake's area grows with (1 / density)^(2/3).
    """
    if rate_mm_h == 0.0:
        return 0.0
    intercept = 3.8e3 * rate_mm_h**-0.87
    slope_per_mm = 2.55 * rate_mm_h**-0.48
    return math.pi * intercept * 1e-6 / slope_per_mm**3 * density_g_cm3 ** (-2.0 / 3.0)


def total_extinction(weather: Weather) -> Extinction:
    """Extinction of everything in the air of `weather`."""
    return (
        _air_extinction(weather)
        + fog_extinction(weather)
        + _wavelength_independent(rain_extinction(weather.rain.rate_mm_h, q_ext=weather.rain.q_ext))
        + _wavelength_independent(
            snow_extinction(weather.snow.rate_mm_h, density_g_cm3=weather.snow.density_g_cm3)
        )
        + dust_extinction(weather)
    )


def _wavelength_independent(extinction: float) -> Extinction:
    return Extinction(extinction, extinction)


def _air_extinction(weather: Weather) -> Extinction:
    mor_m = weather.air.mor_m
    if mor_m is None:
        return Extinction()
    visible = extinction_from_mor(mor_m)
    return Extinction(visible, visible * kim_wavelength_factor(mor_m))


def fog_extinction(weather: Weather) -> Extinction:
    """Extinction of the fog of `weather`."""
    return _wavelength_independent(
        0.0 if weather.fog.mor_m is None else extinction_from_mor(weather.fog.mor_m)
    )


def dust_extinction(weather: Weather) -> Extinction:
    """Extinction of the dust of `weather`."""
    if weather.dust.mor_m is None:
        return Extinction()
    visible = extinction_from_mor(weather.dust.mor_m)
    return Extinction(visible, visible * DUST_FACTOR_905NM)


def visibility_m(extinction: Extinction) -> float:
    """Meteorological optical range of all that is in the air; inf in a vacuum."""
    return KOSCHMIEDER_CONSTANT / extinction.at_550nm if extinction.at_550nm else math.inf
