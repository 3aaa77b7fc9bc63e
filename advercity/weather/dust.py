"""What dust does to the colour of light: scattered many times, light takes the colour of dust."""

import math

import numpy as np
from advercity_dsl import Weather
from numpy.typing import NDArray

from advercity.weather.extinction import Extinction, of_dust
from advercity.weather.sky import luminance

Array = NDArray[np.float64]

LAYER_M = 1000.0
"""Depth of the dust above the ground: that of a storm's lower part."""


def dust_colour(weather: Weather) -> Array:
    """Colour (3,) at luminance 1 that a thick layer of the dust throws back.

    Van de Hulst's fit for a layer without end, by the similarity of single-scattering albedo and
    asymmetry; grey dust gives white.
    """
    albedo = np.asarray(weather.dust.ssa_rgb)
    absorbed = np.sqrt((1.0 - albedo) / np.maximum(1.0 - albedo * weather.dust.g, 1e-9))
    back = (1.0 - 0.139 * absorbed) * (1.0 - absorbed) / (1.0 + 1.17 * absorbed)
    bright = float(luminance(back))
    return back / bright if bright > 0.0 else np.ones(3)


def dust_share(weather: Weather, total: Extinction) -> float:
    """Share of scattered light, 0 to 1, that the dust has coloured."""
    dust = of_dust(weather).at_550nm
    if not dust:
        return 0.0
    return dust / total.at_550nm * (1.0 - math.exp(-dust * LAYER_M))


def dusty(light: Array, weather: Weather, total: Extinction) -> Array:
    """Light (..., 3) as dust colours it, as bright as before."""
    share = dust_share(weather, total)
    if not share:
        return light
    return (1.0 - share) * light + share * luminance(light)[..., None] * dust_colour(weather)
