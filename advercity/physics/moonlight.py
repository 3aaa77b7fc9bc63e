"""Light of the moon: daylight's distribution, dimmed.

Moonlight is reflected sunlight, so the atmosphere treats both alike.
"""

import math

from advercity_dsl import Weather

from advercity.physics.precipitation import is_precipitating
from advercity.physics.sky import SOLAR_LX, Daylight, cloudy_daylight

LX_PER_FOOTCANDLE = 10.764


def compute_moon_lx(phase: float) -> float:
    """Compute the illuminance by the moon above the atmosphere, normal to its rays, in lx.

    `phase` is the lit fraction of its disc. Magnitudes are -12.73 + 0.026 |a| + 4e-9 a^4 at a phase
    angle of a degrees, and 10^(-0.4 (m + 16.57)) footcandles each (Krisciunas and Schaefer 1991,
    equations 8 and 9): 0.31 lx from a full moon, 0.029 from a half one.
    """
    angle_deg = math.degrees(math.acos(2.0 * phase - 1.0))
    magnitude = -12.73 + 0.026 * angle_deg + 4e-9 * angle_deg**4
    return LX_PER_FOOTCANDLE * 10.0 ** (-0.4 * (magnitude + 16.57))


def compute_moonlight(weather: Weather) -> Daylight:
    """Compute the moonlight above any fog: 0 for a new moon or a set one."""
    moon = weather.moon
    if moon.phase == 0.0 or moon.elevation_deg <= 0.0:
        return Daylight(0.0, 0.0)
    ratio = compute_moon_lx(moon.phase) / SOLAR_LX
    sunlight = cloudy_daylight(
        moon.elevation_deg, oktas=weather.sky.oktas, precipitating=is_precipitating(weather)
    )
    return Daylight(ratio * sunlight.direct_lx, ratio * sunlight.diffuse_lx)
