"""How much light comes from sun and sky, by the sun's elevation and the clouds."""

import math
from dataclasses import dataclass

import numpy as np
from advercity_dsl import Weather

RAIN_CLOUD_SHARE = 0.5
"""Light that a raining or snowing cloud lets through, against a dry one of the same cover."""

_SUN_ELEVATION_DEG = (5.0, 10.0, 20.0, 60.0)
_SUN_COLOUR = ((1.87, 0.83, 0.12), (1.53, 0.91, 0.33), (1.32, 0.95, 0.54), (1.19, 0.97, 0.74))
"""Linear sRGB at luminance 1 of Hosek-Wilkie's sun at turbidity 3."""


@dataclass(frozen=True)
class Daylight:
    """Light above any fog, in lx."""

    direct_lx: float
    """By the sun, on a surface that faces it."""
    diffuse_lx: float
    """By the sky, on level ground."""


def air_mass(elevation_deg: float) -> float:
    """Optical air mass towards the sun (Kasten and Young 1989)."""
    lifted = elevation_deg + 6.07995
    return 1.0 / (math.sin(math.radians(elevation_deg)) + 0.50572 * lifted**-1.6364)


def clear_daylight(elevation_deg: float) -> Daylight:
    """A cloudless sky (IES 1984 daylight availability), the sun above the horizon."""
    sine = math.sin(math.radians(elevation_deg))
    return Daylight(
        direct_lx=127_500.0 * math.exp(-0.21 * air_mass(elevation_deg)),
        diffuse_lx=800.0 + 15_500.0 * math.sqrt(sine),
    )


def daylight(elevation_deg: float, *, oktas: int = 0, precipitating: bool = False) -> Daylight:
    """Sun and sky under `oktas` eighths of cloud; nothing when the sun is down.

    The total falls as 1 - 0.75 (N/8)^3.4 (Kasten and Czeplak 1980), and the sky's share of it
    rises from that of a clear sky to all.
    """
    if elevation_deg <= 0.0:
        return Daylight(0.0, 0.0)
    clear = clear_daylight(elevation_deg)
    sine = math.sin(math.radians(elevation_deg))
    clear_total = clear.direct_lx * sine + clear.diffuse_lx
    cover = oktas / 8.0
    total = clear_total * (1.0 - 0.75 * cover**3.4) * (RAIN_CLOUD_SHARE if precipitating else 1.0)
    clear_share = clear.diffuse_lx / clear_total
    share = clear_share + (1.0 - clear_share) * cover**2
    return Daylight(direct_lx=total * (1.0 - share) / sine, diffuse_lx=total * share)


def daylight_of(weather: Weather) -> Daylight:
    """Sun and sky of `weather`; what its author gave stands, the rest is derived."""
    derived = daylight(
        weather.sun.elevation_deg,
        oktas=weather.sky.oktas,
        precipitating=weather.rain.rate_mm_h > 0.0 or weather.snow.rate_mm_h > 0.0,
    )
    direct, diffuse = weather.sky.direct_lx, weather.sky.diffuse_lx
    return Daylight(
        direct_lx=derived.direct_lx if direct is None else direct,
        diffuse_lx=derived.diffuse_lx if diffuse is None else diffuse,
    )


def sun_colour(elevation_deg: float) -> tuple[float, float, float]:
    """Colour of direct sunlight, linear sRGB with luminance 1."""
    red, green, blue = (
        float(np.interp(elevation_deg, _SUN_ELEVATION_DEG, channel))
        for channel in zip(*_SUN_COLOUR, strict=True)
    )
    return red, green, blue
