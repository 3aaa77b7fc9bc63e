"""Compute extinction coefficients of the air, part by part, and the resulting visibility.

Visibility is the meteorological optical range (MOR, WMO-No. 8): the path over which a beam of
white light loses 95 % of its flux. Koschmieder's law ties it to the extinction coefficient in the
visible, `MOR = ln 20 / extinction`; only `mor_from_extinction` and `extinction_from_mor` apply it.
Extinctions of parts add, visibilities do not. 550 nm represents the visible, 905 nm is the
wavelength of the LiDARs.
"""

import math
from dataclasses import dataclass
from functools import cached_property

from advercity_dsl import Weather

from advercity.physics.weather_parts.part import (
    AirPart,
    Extinction,
    Precipitation,
    Suspension,
    iterate_parts,
)

KOSCHMIEDER_CONSTANT = math.log(20.0)
"""Extinction times MOR: the optical depth at which 5 % of the light remain."""


@dataclass(frozen=True)
class AirExtinction:
    """Extinction of everything in the air: its parts, in the order in which they add up."""

    parts: tuple[AirPart, ...] = ()

    def __getitem__(self, name: str) -> Extinction:
        """Return the extinction of a part by its name; zero if it is absent."""
        return next((part.extinction for part in self.parts if part.name == name), Extinction())

    @cached_property
    def total(self) -> Extinction:
        """Total extinction of the air."""
        return sum((part.extinction for part in self.parts), Extinction())

    @property
    def suspended(self) -> tuple[Suspension, ...]:
        """Floating particles."""
        return tuple(part for part in self.parts if isinstance(part, Suspension))

    @property
    def layers(self) -> tuple[tuple[Suspension, float], ...]:
        """Floating particles that hide the sky, as fog and dust, with their optical depth."""
        return tuple(
            (part, part.extinction.at_550nm * part.layer_m)
            for part in self.suspended
            if part.layer_m is not None
        )

    @property
    def precipitation(self) -> tuple[Precipitation, ...]:
        """Falling particles."""
        return tuple(part for part in self.parts if isinstance(part, Precipitation))

    @property
    def water_g_m3(self) -> float:
        """Floating liquid water; 0 without fog."""
        return sum(part.water_g_m3 for part in self.suspended)

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
    """Compute the extinction of every part of the air of `weather`."""
    found = (physics.find_particles(part) for physics, part in iterate_parts(weather))
    return AirExtinction(tuple(part for part in found if part is not None))


def mor_without_precipitation_m(weather: Weather) -> float:
    """Compute the visibility in metres in floating particles alone; inf without them.

    Tables of drivers' reactions use it, because rain and snow have tables of their own. It is at
    least the visibility of the whole air, `AirExtinction.mor_m`.
    """
    # Without the factor ln 20, which cancels: a table's step at exactly one part's visibility
    # is compared with `<`, and rounding by the factor would miss it by a digit.
    reciprocal = sum(1 / part.mor_m for part in compute_extinction(weather).suspended)
    return 1 / reciprocal if reciprocal else math.inf


def kim_wavelength_factor(mor_m: float, *, wavelength_nm: float = 905.0) -> float:
    """Compute the extinction of haze at a wavelength relative to 550 nm.

    Kim, McArthur and Korevaar, Proc. SPIE 4214 (2001). Fog (below 500 m) does not depend on the
    wavelength.
    """
    # Kim states the exponent for the range with 2 % of the light left, not 5 %.
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
