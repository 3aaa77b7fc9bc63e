"""Daylight by the sun's elevation and the clouds, and its distribution over the sky.

Illuminance follows IES and Kasten-Czeplak, relative luminance the CIE general sky. Directions are
unit vectors (..., 3) in the world frame, luminances in cd/m² with linear sRGB as the last axis.
"""

import math
from dataclasses import dataclass

import numpy as np
from advercity_dsl import Weather
from numpy.typing import ArrayLike, NDArray

from advercity.geometry.arrays import Float64Array
from advercity.materials import SNOWY_LANDSCAPE_ALBEDO
from advercity.physics.photometry import colour_from_chromaticity, cubemap_directions
from advercity.physics.precipitation import is_precipitating

_TWILIGHT_ELEVATION_DEG = (-18.0, -12.0, -6.0, 0.0)
_TWILIGHT_LX = (0.0006, 0.008, 3.4, 800.0)
"""Illuminance by a clear sky; at sunset as `clear_daylight`."""
SOLAR_LX = 127_500.0
"""Illuminance by the sun above the atmosphere, normal to its rays (IES 1984)."""
RAIN_CLOUD_TRANSMITTANCE = 0.5
"""Transmittance of a raining or snowing cloud, relative to a dry one of the same cover."""

_SUN_TABLE_ELEVATION_DEG = (5.0, 10.0, 20.0, 60.0)
_SUN_TABLE_COLOUR = ((1.87, 0.83, 0.12), (1.53, 0.91, 0.33), (1.32, 0.95, 0.54), (1.19, 0.97, 0.74))
"""Linear sRGB at luminance 1 of the Hosek-Wilkie solar disc at turbidity 3."""


@dataclass(frozen=True)
class Daylight:
    """Light above any fog, in lx."""

    direct_lx: float
    """Direct normal illuminance by the sun."""
    diffuse_lx: float
    """Horizontal illuminance by the sky."""


def air_mass(elevation_deg: float) -> float:
    """Compute the optical air mass towards the sun (Kasten and Young 1989)."""
    lifted = elevation_deg + 6.07995
    return 1.0 / (math.sin(math.radians(elevation_deg)) + 0.50572 * lifted**-1.6364)


def clear_daylight(elevation_deg: float) -> Daylight:
    """Compute the daylight of a cloudless sky (IES 1984) with the sun above the horizon."""
    sine = math.sin(math.radians(elevation_deg))
    return Daylight(
        direct_lx=SOLAR_LX * math.exp(-0.21 * air_mass(elevation_deg)),
        diffuse_lx=800.0 + 15_500.0 * math.sqrt(sine),
    )


def twilight_illuminance(elevation_deg: float) -> float:
    """Compute the illuminance in lx by a clear sky with the sun at or below the horizon.

    Logarithmic between sunset and the ends of civil, nautical and astronomical twilight (6, 12 and
    18 degrees below the horizon), after which it is 0.
    """
    if elevation_deg < _TWILIGHT_ELEVATION_DEG[0]:
        return 0.0
    return math.exp(np.interp(elevation_deg, _TWILIGHT_ELEVATION_DEG, np.log(_TWILIGHT_LX)))


def cloudy_daylight(
    elevation_deg: float, *, oktas: float = 0, precipitating: bool = False
) -> Daylight:
    """Compute the daylight under `oktas` eighths of cloud; twilight with the sun set.

    The total decreases as 1 - 0.75 (N/8)^3.4 (Kasten and Czeplak 1980), and its diffuse fraction
    increases from the clear sky's to 1.
    """
    cover = oktas / 8.0
    by_rain = RAIN_CLOUD_TRANSMITTANCE if precipitating else 1.0
    by_clouds = 1.0 - 0.75 * cover**3.4
    if elevation_deg <= 0.0:
        return Daylight(0.0, twilight_illuminance(elevation_deg) * by_clouds * by_rain)
    clear = clear_daylight(elevation_deg)
    sine = math.sin(math.radians(elevation_deg))
    clear_total = clear.direct_lx * sine + clear.diffuse_lx
    total = clear_total * by_clouds * by_rain
    clear_diffuse = clear.diffuse_lx / clear_total
    diffuse = clear_diffuse + (1.0 - clear_diffuse) * cover**2
    return Daylight(direct_lx=total * (1.0 - diffuse) / sine, diffuse_lx=total * diffuse)


def derive_daylight(weather: Weather) -> Daylight:
    """Derive the daylight of `weather` from its sun and its clouds."""
    return cloudy_daylight(
        weather.sun.elevation_deg,
        oktas=weather.sky.oktas,
        precipitating=is_precipitating(weather),
    )


def daylight_for_weather(weather: Weather) -> Daylight:
    """Compute the daylight of `weather`; authored illuminances override derived ones by day."""
    derived = derive_daylight(weather)
    if weather.sun.elevation_deg <= 0.0:
        return derived
    direct, diffuse = weather.sky.direct_lx, weather.sky.diffuse_lx
    return Daylight(
        direct_lx=derived.direct_lx if direct is None else direct,
        diffuse_lx=derived.diffuse_lx if diffuse is None else diffuse,
    )


def sun_colour(elevation_deg: float) -> tuple[float, float, float]:
    """Colour of direct sunlight, linear sRGB with luminance 1."""
    red, green, blue = (
        float(np.interp(elevation_deg, _SUN_TABLE_ELEVATION_DEG, channel))
        for channel in zip(*_SUN_TABLE_COLOUR, strict=True)
    )
    return red, green, blue


GROUND_ALBEDO = 0.1
"""Mean albedo of roads and fields."""
SNOW_COVER_SCALE_M = 0.002
"""Depth of snow at which 1/e of the bare ground remains visible."""
CLOUD_ALBEDO = 0.6
"""Albedo of an overcast sky, from below."""
AIRLIGHT_CUBEMAP_SIZE = 64
"""Texels along an edge of the cubemap of airlight."""

_CIE_TYPES = {
    1: (4.0, -0.70, 0.0, -1.0, 0.0),
    3: (1.1, -0.80, 0.0, -1.0, 0.0),
    5: (0.0, -1.0, 0.0, -1.0, 0.0),
    7: (0.0, -1.0, 5.0, -2.5, 0.30),
    8: (0.0, -1.0, 10.0, -3.0, 0.45),
    11: (-1.0, -0.55, 10.0, -3.0, 0.45),
    12: (-1.0, -0.32, 10.0, -3.0, 0.45),
    13: (-1.0, -0.32, 16.0, -3.0, 0.30),
}
"""Parameters a to e of ISO 15469:2004 / CIE S 011, by sky type."""
_CIE_TYPE_BY_OKTAS = (12, 12, 12, 11, 8, 7, 7, 3, 1)
HAZY_TURBIDITY = 5.0
"""Turbidity from which a clear sky is CIE type 13, polluted."""
_ZENITH_XY = np.array([0.241, 0.250])
_HORIZON_XY = np.array([0.31, 0.33])
_AUREOLE_XY = np.array([0.36, 0.37])
_OVERCAST_XY = np.array([0.3127, 0.3290])
_AUREOLE_RAD = math.radians(20.0)
_TWILIGHT_ZENITH_XY, _TWILIGHT_GLOW_XY = np.array([0.240, 0.235]), np.array([0.44, 0.39])
"""Above, blue by ozone (Hulburt 1953); low over the place of the set sun, as skylight of 2800 K."""
_TWILIGHT_FROM_DEG = 6.0
"""Elevation of the sun at which twilight begins to colour the sky; at 0 it does so wholly."""
_TWILIGHT_GLOW_HEIGHT = math.sin(math.radians(10.0))


def direction_from_elevation_azimuth(elevation_deg: float, azimuth_deg: float) -> Float64Array:
    """Convert an elevation and an azimuth clockwise from north to a unit vector (3,)."""
    elevation, azimuth = math.radians(elevation_deg), math.radians(azimuth_deg)
    level = math.cos(elevation)
    return np.array([level * math.sin(azimuth), level * math.cos(azimuth), math.sin(elevation)])


def cie_sky_type(oktas: int, *, turbidity: float = 3.0) -> int:
    """Choose the CIE type of a sky with `oktas` eighths of cloud."""
    clear = _CIE_TYPE_BY_OKTAS[oktas] == 12
    return 13 if clear and turbidity >= HAZY_TURBIDITY else _CIE_TYPE_BY_OKTAS[oktas]


def cie_relative_luminance(
    directions: Float64Array, sun: Float64Array, cie_type: int
) -> Float64Array:
    """Compute the luminance (...) of a CIE general sky relative to its zenith.

    Directions (..., 3) below the horizon have the luminance of the horizon; `cie_type` is the
    number of the standard sky, 1 to 15 (ISO 15469).
    """
    a, b, c, d, e = _CIE_TYPES[cie_type]

    def gradation(sine: Float64Array | float) -> Float64Array:
        return 1.0 + a * np.exp(b / np.maximum(sine, 1e-4))

    def indicatrix(angle: Float64Array | float) -> Float64Array:
        scattered = c * (np.exp(d * np.asarray(angle)) - math.exp(d * math.pi / 2.0))
        return 1.0 + scattered + e * np.cos(angle) ** 2

    from_sun = np.arccos(np.clip(directions @ sun, -1.0, 1.0))
    sun_from_zenith = math.acos(min(1.0, max(-1.0, float(sun[2]))))
    relative = indicatrix(from_sun) * gradation(directions[..., 2])
    return relative / (indicatrix(sun_from_zenith) * gradation(1.0))


def cloudy_relative_luminance(
    directions: Float64Array, sun: Float64Array, oktas: float, *, turbidity: float
) -> Float64Array:
    """Compute the luminance (...) of a sky with `oktas` eighths of cloud relative to its zenith.

    Between whole eighths, as clouds gather or break up, it is the mean of the two CIE skies.
    """
    fewer = math.floor(oktas)
    luminance = cie_relative_luminance(directions, sun, cie_sky_type(fewer, turbidity=turbidity))
    if fewer == oktas:
        return luminance
    more = cie_sky_type(fewer + 1, turbidity=turbidity)
    part = oktas - fewer
    return (1.0 - part) * luminance + part * cie_relative_luminance(directions, sun, more)


def sky_colour(
    directions: Float64Array, sun: Float64Array, *, cloud_fraction: float
) -> Float64Array:
    """Compute the sky's colour (..., 3): blue above, warm near the sun, grey with clouds.

    At a low or set sun, the sky is warm along the horizon on its side, and bluer above.
    """
    low = min(1.0, max(0.0, 1.0 - math.degrees(math.asin(sun[2])) / _TWILIGHT_FROM_DEG))
    zenith = _ZENITH_XY + (_TWILIGHT_ZENITH_XY - _ZENITH_XY) * low
    height = np.sqrt(np.clip(directions[..., 2:], 0.0, 1.0))
    clear = _HORIZON_XY + (zenith - _HORIZON_XY) * height
    from_sun = np.arccos(np.clip(directions @ sun, -1.0, 1.0))[..., None]
    aureole = np.clip(1.0 - from_sun / _AUREOLE_RAD, 0.0, 1.0)
    clear = clear + (_AUREOLE_XY - clear) * aureole
    if low > 0.0:
        towards_sun = directions[..., :2] @ sun[:2] / max(math.hypot(*sun[:2]), 1e-9)
        around = (0.5 + 0.5 * towards_sun[..., None]) ** 2
        glow = low * around * np.exp(-np.square(height) / _TWILIGHT_GLOW_HEIGHT)
        clear = clear + (_TWILIGHT_GLOW_XY - clear) * glow
    return colour_from_chromaticity(clear + (_OVERCAST_XY - clear) * cloud_fraction)


def ground_albedo(snow_depth_m: float) -> float:
    """Compute the albedo of the landscape under a depth of snow."""
    bare = math.exp(-snow_depth_m / SNOW_COVER_SCALE_M)
    return SNOWY_LANDSCAPE_ALBEDO + (GROUND_ALBEDO - SNOWY_LANDSCAPE_ALBEDO) * bare


def ground_lit_fraction(albedo: float, oktas: float) -> float:
    """Compute the fraction of the sky's light reflected by clouds from a bright ground.

    Only the excess over the usual ground counts: formulas of daylight include the usual one.
    """
    return CLOUD_ALBEDO * oktas / 8.0 * (albedo - GROUND_ALBEDO)


def airlight_from_illuminance(illuminance_lx: float) -> float:
    """Compute the luminance of air lit from above and, by the ground, from below."""
    return illuminance_lx * (1.0 + GROUND_ALBEDO) / (2.0 * math.pi)


def level_airlight_directions() -> Float64Array:
    """Build the level directions (6, m, m, 3) below or above the texels of an airlight cubemap."""
    level = cubemap_directions(AIRLIGHT_CUBEMAP_SIZE) * [1.0, 1.0, 0.0]
    return level / np.linalg.norm(level, axis=-1, keepdims=True)


def build_airlight_cubemap(low: ArrayLike, high: ArrayLike) -> NDArray[np.float32]:
    """Build an airlight cubemap (6, m, m, 4) as in `Atmosphere`, constant along each ray.

    From `low` (3,) or (6, m, m, 3), at and below the horizon, to `high` at the zenith, in cd/m², it
    is linear in the sine of the elevation.
    """
    sine = np.maximum(cubemap_directions(AIRLIGHT_CUBEMAP_SIZE)[..., 2:], 0.0)
    colour = np.asarray(low) * (1.0 - sine) + np.asarray(high) * sine
    return np.concatenate([colour, np.zeros_like(sine)], axis=-1).astype(np.float32)
