"""The shaders' inputs from an atmosphere: parameters of the table, textures of sky and air."""

import numpy as np
from numpy.typing import ArrayLike

from advercity.geometry.arrays import Float32Array, Float64Array
from advercity.physics.atmosphere import Atmosphere
from advercity.physics.photometry import (
    cubemap_directions,
    cubemap_solid_angles,
    stack_cubemap,
)
from advercity.rendering.surface_weather import compute_surface_weather
from advercity.rendering.visible_sky import draw_visible_sky
from advercity_sapien.shader_table import KILO

DUSK, NIGHT = 0.75, 1.0
"""Parameter of times when lamps light the scene: with light of the sky, and in the dark."""

COSINE_LOBE_FACTORS = np.pi / np.array([1] + [1.5] * 3 + [4] * 5)
"""Factors by which the cosine lobe reduces each harmonic (Ramamoorthi and Hanrahan 2001)."""
HARMONIC_NORMS = np.array(
    [0.282095] + [0.488603] * 3 + [1.092548, 1.092548, 0.315392, 1.092548, 0.546274]
)


def build_sky_texture(atmosphere: Atmosphere) -> Float32Array:
    """Stack the sky's six cubemap faces n texels wide to (6 n, n, 4), in kcd/m², with clouds."""
    sky = stack_cubemap(draw_visible_sky(atmosphere)) * np.float32(KILO)
    return np.concatenate([sky, np.ones_like(sky[..., :1])], axis=-1)


def build_airlight_texture(atmosphere: Atmosphere) -> Float32Array:
    """Stack the airlight's faces to (6 m, m, 4): kcd/m² and its growth along the path."""
    return stack_cubemap(atmosphere.airlight) * np.array([KILO, KILO, KILO, 1.0], np.float32)


def compute_light_parameters(atmosphere: Atmosphere) -> dict[str, ArrayLike]:
    """Compute the table's parameters derived from light, by name."""
    return {
        "horizon_airlight": np.multiply(atmosphere.horizon_airlight, KILO),
        "night": NIGHT if atmosphere.is_dark else DUSK if atmosphere.night else 0.0,
        "sun_irradiance": np.multiply(atmosphere.sun_colour, atmosphere.sun_lx * KILO),
        "sun_direction": atmosphere.sun_direction,
        "sky_harmonics": compute_irradiance_harmonics(atmosphere.sky) * KILO,
    }


def compute_air_parameters(atmosphere: Atmosphere) -> dict[str, ArrayLike]:
    """Compute the table's parameters derived from air and ground, by name."""
    weather = compute_surface_weather(atmosphere)
    return {
        "extinction": atmosphere.extinction.at_550nm,
        "wetness": weather.wetness,
        "puddle_level": weather.puddle_level,
        "ripple_slope": weather.ripple_slope,
        "ice_cover": weather.ice_cover,
        "snow_depth": weather.snow_depth_m,
        "snow_between_ruts": weather.snow_between_ruts,
        "snow_in_ruts": weather.snow_in_ruts,
    }


def compute_irradiance_harmonics(sky: Float32Array) -> Float64Array:
    """Project the irradiance by a sky (6, n, n, 3) on spherical harmonics: (9, 3) in lx.

    Second order leaves an error of some per cent; the coefficients are scaled so a horizontal
    surface gets the sky's exact irradiance.
    """
    size = sky.shape[1]
    directions = cubemap_directions(size).reshape(-1, 3)
    light = (sky * cubemap_solid_angles(size)[..., None]).reshape(-1, 3)
    basis = _harmonic_basis(directions)
    # Not by products of matrices: OpenBLAS sums in another order for every number of threads.
    coefficients = (COSINE_LOBE_FACTORS * HARMONIC_NORMS**2)[:, None] * np.einsum(
        "nk,nj->kj", basis, light
    )
    horizontal = np.einsum("n,nj->j", np.clip(directions[:, 2], 0.0, None), light)
    approximate = _harmonic_basis(np.array([[0.0, 0.0, 1.0]]))[0] @ coefficients
    level = np.divide(horizontal, approximate, out=np.ones(3), where=approximate > 0.0)
    return coefficients * level


def _harmonic_basis(directions: Float64Array) -> Float64Array:
    """Evaluate the polynomials (n, 9) of real harmonics, as `skyIrradiance` in GLSL."""
    x, y, z = directions.T
    return np.stack(
        [np.ones_like(x), y, z, x, x * y, y * z, 3 * z * z - 1, x * z, x * x - y * y], axis=1
    )
