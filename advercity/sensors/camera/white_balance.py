"""White: a camera makes grey of what the light of its scene makes of grey."""

import numpy as np
from numpy.typing import NDArray

from advercity.weather.atmosphere import Atmosphere
from advercity.weather.sky import cubemap_directions, luminance, texel_solid_angles

Array = NDArray[np.float64]

_KELVIN = np.array([2700.0, 3200.0, 4000.0, 5500.0, 6500.0, 10_000.0])
_BLACK_BODY = np.array(
    [
        [1.93, 0.81, 0.19],
        [1.68, 0.87, 0.33],
        [1.39, 0.94, 0.50],
        [1.10, 0.99, 0.82],
        [1.0, 1.0, 1.0],
        [0.82, 1.01, 1.40],
    ]
)
"""Linear sRGB at luminance 1 by temperature."""
DAY_K = (5500.0, 7500.0)
NIGHT_K = (3500.0, 6500.0)
"""Whites that a camera looks for; what is yellower or bluer stays so, as dust and low sun do."""


def white_of(atmosphere: Atmosphere) -> Array:
    """Colour (3,) at luminance 1 that the camera shows as grey.

    That of the light on level ground, as far as the camera follows it: sun and sky by day, the
    air's glow and street lamps by night. A cast that no temperature has, such as green, stays.
    """
    illuminant = _light_on_ground(atmosphere)
    low_k, high_k = NIGHT_K if atmosphere.night else DAY_K
    temperature = np.clip(_temperature(illuminant), low_k, high_k)
    return _black_body(float(temperature))


def _light_on_ground(atmosphere: Atmosphere) -> Array:
    if atmosphere.night:
        return np.asarray(atmosphere.airlight_low)
    sky = atmosphere.sky.astype(np.float64)
    size = sky.shape[1]
    weight = np.maximum(cubemap_directions(size)[..., 2], 0.0) * texel_solid_angles(size)
    diffuse = np.tensordot(weight, sky, axes=3)
    direct = atmosphere.sun_lx * max(0.0, float(atmosphere.sun_direction[2]))
    return diffuse + direct * np.asarray(atmosphere.sun_colour)


def _temperature(illuminant: Array) -> float:
    """Of the black body with the same ratio of red to blue, in K."""
    red, _, blue = np.maximum(illuminant, 1e-12)
    ratio = np.log(_BLACK_BODY[:, 0] / _BLACK_BODY[:, 2])
    found = np.interp(-np.log(red / blue), -ratio, 1e6 / _KELVIN)
    return float(1e6 / found)


def _black_body(temperature_k: float) -> Array:
    mired = 1e6 / _KELVIN[::-1]
    channels = [np.interp(1e6 / temperature_k, mired, column) for column in _BLACK_BODY[::-1].T]
    colour = np.array(channels)
    return colour / float(luminance(colour))
