"""Extinction coefficients of air, fog, rain, snow, hail and dust, and the visibility they leave.

The visibility of this project is the meteorological optical range (MOR, WMO-No. 8): the path over
which a beam of white light loses 95 % of its flux. Koschmieder's law ties it to the extinction
coefficient in the visible, `MOR = ln 20 / extinction`; `mor_from_extinction` and
`extinction_from_mor` are the only places that apply the law. Extinctions of components add, their
visibilities do not. 550 nm represents the visible, 905 nm is the wavelength of the LiDARs.
"""

import math
from dataclasses import dataclass

from advercity_dsl import Weather
from advercity_dsl.weather_components import Hail

from advercity.physics.precipitation import (
    hail_size_distribution,
    rain_size_distribution,
    snow_size_distribution,
)

KOSCHMIEDER_CONSTANT = math.log(20.0)
"""Extinction times MOR: the optical depth that leaves 5 % of the light."""
DUST_FACTOR_905NM = 0.95
"""Extinction of mineral dust at 905 nm relative to 550 nm: coarse grains hardly discriminate."""


@dataclass(frozen=True)
class Extinction:
    """Extinction coefficient in 1/m at the two wavelengths that sensors use."""

    at_550nm: float = 0.0
    at_905nm: float = 0.0

    def __add__(self, other: "Extinction") -> "Extinction":
        return Extinction(self.at_550nm + other.at_550nm, self.at_905nm + other.at_905nm)


@dataclass(frozen=True)
class AirExtinction:
    """Extinction of everything in the air, component by component."""

    haze: Extinction = Extinction()
    """Of the air itself and its haze."""
    fog: Extinction = Extinction()
    rain: Extinction = Extinction()
    snow: Extinction = Extinction()
    dust: Extinction = Extinction()
    hail: Extinction = Extinction()

    @property
    def total(self) -> Extinction:
        """Total extinction of the air."""
        # Floating-point sums depend on their order, and datasets hold the digits of this one.
        return self.haze + self.fog + self.rain + self.snow + self.dust + self.hail

    @property
    def at_550nm(self) -> float:
        """Total extinction coefficient in the visible, 1/m."""
        return self.total.at_550nm

    @property
    def at_905nm(self) -> float:
        """Total extinction coefficient at the wavelength of LiDARs, 1/m."""
        return self.total.at_905nm

    @property
    def mor_m(self) -> float:
        """Visibility: meteorological optical range of the whole air, metres; inf in a vacuum."""
        return mor_from_extinction(self.at_550nm)


def mor_from_extinction(extinction_per_m: float) -> float:
    """Convert an extinction coefficient, 1/m, to the visibility (MOR) in metres; inf for 0."""
    return KOSCHMIEDER_CONSTANT / extinction_per_m if extinction_per_m else math.inf


def extinction_from_mor(mor_m: float) -> float:
    """Convert a visibility (MOR) in metres to the extinction coefficient at 550 nm, 1/m."""
    return KOSCHMIEDER_CONSTANT / mor_m


def compute_extinction(weather: Weather) -> AirExtinction:
    """Compute the extinction of every component of the air of `weather`."""
    rain, snow = weather.rain, weather.snow
    return AirExtinction(
        haze=_extinction_of_haze(weather.air.mor_m),
        fog=_grey_extinction(_extinction_or_zero(weather.fog.mor_m)),
        rain=_grey_extinction(rain_extinction(rain.rate_mm_h, q_ext=rain.q_ext)),
        snow=_grey_extinction(snow_extinction(snow.rate_mm_h, density_g_cm3=snow.density_g_cm3)),
        dust=_extinction_of_dust(weather.dust.mor_m),
        hail=_grey_extinction(_hail_extinction(weather.hail)),
    )


def mor_without_precipitation_m(weather: Weather) -> float:
    """Compute the visibility in metres that haze, fog and dust alone leave; inf without them.

    Drivers' reactions are tabulated by it, because rain and snow have tables of their own. It is
    at least the visibility of the whole air, `AirExtinction.mor_m`.
    """
    parts = (weather.air.mor_m, weather.fog.mor_m, weather.dust.mor_m)
    # Without the factor ln 20, which cancels: a table's step at exactly one component's visibility
    # is compared with `<`, and multiplying and dividing by ln 20 would miss it by a digit.
    reciprocal = sum(1 / part for part in parts if part is not None)
    return 1 / reciprocal if reciprocal else math.inf


def kim_wavelength_factor(mor_m: float, *, wavelength_nm: float = 905.0) -> float:
    """Compute the extinction of haze at a wavelength relative to 550 nm.

    Kim, McArthur and Korevaar, Proc. SPIE 4214 (2001). Fog (below 500 m) does not depend on the
    wavelength.
    """
    # Kim states the exponent for the range at which 2 % of the light is left, not 5 %.
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
    """Compute the extinction coefficient of rain in 1/m, for wavelengths from 0.4 to 1.6 um.

    The cross-sections of the Marshall-Palmer drops, integrated in closed form, times the
    extinction efficiency `q_ext`, which is 2 in the geometric limit.
    """
    if rate_mm_h == 0.0:
        return 0.0
    sizes = rain_size_distribution(rate_mm_h)
    # The 1e-6 converts mm² of cross-section to m².
    return q_ext / 2.0 * math.pi * (sizes.intercept * 1e-6) / sizes.slope_per_mm**3


def snow_extinction(rate_mm_h: float, *, density_g_cm3: float = 0.1) -> float:
    """Compute the extinction coefficient of snow in 1/m from its liquid-equivalent rate.

    A flake's area grows with (1 / density)^(2/3) relative to the drop it melts to.
    """
    if rate_mm_h == 0.0:
        return 0.0
    sizes = snow_size_distribution(rate_mm_h, density_g_cm3)
    melted = math.pi * sizes.intercept * 1e-6 / sizes.slope_per_mm**3
    return melted * density_g_cm3 ** (-2.0 / 3.0)


def _hail_extinction(hail: Hail) -> float:
    """Compute the extinction coefficient of hail in 1/m in the geometric limit."""
    if hail.rate_mm_h == 0.0:
        return 0.0
    sizes = hail_size_distribution(hail.rate_mm_h, hail.largest_mm)
    return math.pi * (sizes.intercept * 1e-6) / sizes.slope_per_mm**3


def _extinction_or_zero(mor_m: float | None) -> float:
    return 0.0 if mor_m is None else extinction_from_mor(mor_m)


def _grey_extinction(extinction_per_m: float) -> Extinction:
    """Build the extinction of particles much larger than both wavelengths."""
    return Extinction(extinction_per_m, extinction_per_m)


def _extinction_of_haze(mor_m: float | None) -> Extinction:
    if mor_m is None:
        return Extinction()
    visible = extinction_from_mor(mor_m)
    return Extinction(visible, visible * kim_wavelength_factor(mor_m))


def _extinction_of_dust(mor_m: float | None) -> Extinction:
    visible = _extinction_or_zero(mor_m)
    return Extinction(visible, visible * DUST_FACTOR_905NM)
