"""What the shaders read of an atmosphere: parameters of the table, and textures of sky and air."""

import cv2
import numpy as np
from numpy.typing import ArrayLike

from advercity.geometry.arrays import Float32Array, Float64Array
from advercity.physics import water
from advercity.physics.atmosphere import Atmosphere
from advercity.physics.clouds import draw_cloudy_sky
from advercity.physics.photometry import cubemap_directions, cubemap_solid_angles
from advercity_sapien.shader_table import KILO

CLOUDY_SKY_SIZE = 512
"""Texels along an edge of the sky's cubemap where it has clouds."""
DUSK, NIGHT = 0.75, 1.0
"""Parameter of times when lamps light the scene: with light of the sky, and in the dark."""
NO_WATER_LEVEL = -1.0
"""Water level below every hollow."""
RUT_FRACTION = 0.3
"""Fraction of a lane's width that is rut."""
RIPPLE_SLOPE, RIPPLE_REFERENCE_RAIN_MM_H = 0.06, 50.0
"""Root mean square of the slope of puddles' water in rain of that rate."""

COSINE_LOBE_FACTORS = np.pi / np.array([1] + [1.5] * 3 + [4] * 5)
"""Factors by which the cosine lobe reduces each harmonic (Ramamoorthi and Hanrahan 2001)."""
HARMONIC_NORMS = np.array(
    [0.282095] + [0.488603] * 3 + [1.092548, 1.092548, 0.315392, 1.092548, 0.546274]
)


def build_sky_texture(atmosphere: Atmosphere) -> Float32Array:
    """Stack the sky's six cubemap faces n texels wide to (6 n, n, 4), in kcd/m², with clouds."""
    faces = atmosphere.sky
    if atmosphere.clouds is not None:
        drawn = draw_cloudy_sky(atmosphere.clouds, faces, CLOUDY_SKY_SIZE)
        if atmosphere.cloud_contrast < 1.0:
            smooth = np.stack([cv2.resize(face, drawn.shape[1:3]) for face in faces])
            drawn = smooth + np.float32(atmosphere.cloud_contrast) * (drawn - smooth)
        faces = drawn
    sky = faces.reshape(-1, faces.shape[2], 3) * np.float32(KILO)
    return np.concatenate([sky, np.ones_like(sky[..., :1])], axis=-1)


def build_airlight_texture(atmosphere: Atmosphere) -> Float32Array:
    """Stack the airlight's faces to (6 m, m, 4): kcd/m² and its growth along the path."""
    faces = atmosphere.airlight.reshape(-1, atmosphere.airlight.shape[2], 4)
    return faces * np.array([KILO, KILO, KILO, 1.0], np.float32)


def compute_light_parameters(atmosphere: Atmosphere) -> dict[str, ArrayLike]:
    """Compute the values of the table's parameters that follow from light, by name."""
    return {
        "horizon_airlight": np.multiply(atmosphere.horizon_airlight, KILO),
        "night": NIGHT if atmosphere.is_dark else DUSK if atmosphere.night else 0.0,
        "sun_irradiance": np.multiply(atmosphere.sun_colour, atmosphere.sun_lx * KILO),
        "sun_direction": atmosphere.sun_direction,
        "sky_harmonics": compute_irradiance_harmonics(atmosphere.sky) * KILO,
    }


def compute_air_parameters(atmosphere: Atmosphere) -> dict[str, ArrayLike]:
    """Compute the values of the table's parameters that follow from air and ground, by name."""
    coverage = atmosphere.puddle_coverage
    rain = min(1.0, atmosphere.rain_mm_h / RIPPLE_REFERENCE_RAIN_MM_H)
    return {
        "extinction": atmosphere.extinction.at_550nm,
        "wetness": atmosphere.wetness,
        "puddle_level": water.puddle_water_level(coverage) if coverage > 0.0 else NO_WATER_LEVEL,
        "ripple_slope": RIPPLE_SLOPE * rain**0.5,
        "ice_cover": atmosphere.ice_cover,
        "snow_depth": atmosphere.snow_depth_m,
        "snow_between_ruts": _snow_cover_between_ruts(atmosphere),
        "snow_in_ruts": atmosphere.rut_snow_cover,
    }


def _snow_cover_between_ruts(atmosphere: Atmosphere) -> float:
    """Compute the snow cover between the ruts that makes up the road's with the cover in them."""
    in_ruts = RUT_FRACTION * atmosphere.rut_snow_cover
    return min(1.0, (atmosphere.road_snow_cover - in_ruts) / (1.0 - RUT_FRACTION))


def compute_irradiance_harmonics(sky: Float32Array) -> Float64Array:
    """Project the irradiance by a sky (6, n, n, 3) on spherical harmonics: (9, 3) in lx.

    Second order leaves an error of some per cent; the coefficients are scaled so that a horizontal
    surface gets exactly what the sky sends it.
    """
    size = sky.shape[1]
    directions = cubemap_directions(size).reshape(-1, 3)
    light = (sky * cubemap_solid_angles(size)[..., None]).reshape(-1, 3)
    basis = _harmonic_basis(directions)
    coefficients = (COSINE_LOBE_FACTORS * HARMONIC_NORMS**2)[:, None] * (basis.T @ light)
    horizontal = np.clip(directions[:, 2], 0.0, None) @ light
    approximate = _harmonic_basis(np.array([[0.0, 0.0, 1.0]]))[0] @ coefficients
    level = np.divide(horizontal, approximate, out=np.ones(3), where=approximate > 0.0)
    return coefficients * level


def _harmonic_basis(directions: Float64Array) -> Float64Array:
    """Evaluate the polynomials (n, 9) of real harmonics that `skyIrradiance` in GLSL has."""
    x, y, z = directions.T
    return np.stack(
        [np.ones_like(x), y, z, x, x * y, y * z, 3 * z * z - 1, x * z, x * x - y * y], axis=1
    )
