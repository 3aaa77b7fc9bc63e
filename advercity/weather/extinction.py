"""How fast light is lost in air, fog, rain, snow and dust: extinction coefficients in 1/m.

Extinctions of components add. 550 nm stands for the visible, 905 nm is the LiDAR's wavelength.
"""

import math
from dataclasses import dataclass

from advercity_dsl import Weather

KOSCHMIEDER = math.log(20.0)
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


def of_visibility(mor_m: float) -> float:
    """Extinction in 1/m of air with a meteorological optical range in metres (Koschmieder)."""
    return KOSCHMIEDER / mor_m


def kim_factor(mor_m: float, *, wavelength_nm: float = 905.0) -> float:
    """Extinction of haze at a wavelength against 550 nm, by visibility.

    Kim, McArthur and Korevaar, Proc. SPIE 4214 (2001); the exponent is stated for the 2 %
    visibility. In fog (below 500 m) there is no dependence on wavelength.
    """
    visibility_km = mor_m * math.log(50.0) / KOSCHMIEDER / 1000.0
    if visibility_km > 50.0:
        exponent = 1.6
    elif visibility_km > 6.0:
        exponent = 1.3
    elif visibility_km > 1.0:
        exponent = 0.16 * visibility_km + 0.34
    else:
        exponent = max(0.0, visibility_km - 0.5)
    return (wavelength_nm / 550.0) ** -exponent


def of_rain(rate_mm_h: float, *, q_ext: float = 2.0) -> float:
    """Extinction of rain in 1/m, any wavelength from 0.4 to 1.6 µm.

    Marshall-Palmer drop sizes, 8000 exp(-4.1 R^-0.21 D) per m³ and mm, integrated in closed
    form with the extinction efficiency `q_ext`, which is 2 in the geometric limit.
    """
    if rate_mm_h == 0.0:
        return 0.0
    slope_per_mm = 4.1 * rate_mm_h**-0.21
    return q_ext / 2.0 * math.pi * 8000e-6 / slope_per_mm**3


def of_snow(rate_mm_h: float, *, density_g_cm3: float = 0.1) -> float:
    """Extinction of snow in 1/m by its liquid-equivalent rate and the density of its flakes.

    Gunn-Marshall sizes of the melted flakes; a flake's area grows with (1 / density)^(2/3).
    """
    if rate_mm_h == 0.0:
        return 0.0
    intercept = 3.8e3 * rate_mm_h**-0.87
    slope_per_mm = 2.55 * rate_mm_h**-0.48
    return math.pi * intercept * 1e-6 / slope_per_mm**3 * density_g_cm3 ** (-2.0 / 3.0)


def of_weather(weather: Weather) -> Extinction:
    """Extinction of everything in the air of `weather`."""
    return (
        _air(weather)
        + of_fog(weather)
        + _grey(of_rain(weather.rain.rate_mm_h, q_ext=weather.rain.q_ext))
        + _grey(of_snow(weather.snow.rate_mm_h, density_g_cm3=weather.snow.density_g_cm3))
        + of_dust(weather)
    )


def _grey(extinction: float) -> Extinction:
    return Extinction(extinction, extinction)


def _air(weather: Weather) -> Extinction:
    mor_m = weather.air.mor_m
    if mor_m is None:
        return Extinction()
    visible = of_visibility(mor_m)
    return Extinction(visible, visible * kim_factor(mor_m))


def of_fog(weather: Weather) -> Extinction:
    """Extinction of the fog of `weather`."""
    return _grey(0.0 if weather.fog.mor_m is None else of_visibility(weather.fog.mor_m))


def of_dust(weather: Weather) -> Extinction:
    """Extinction of the dust of `weather`."""
    if weather.dust.mor_m is None:
        return Extinction()
    visible = of_visibility(weather.dust.mor_m)
    return Extinction(visible, visible * DUST_FACTOR_905NM)
