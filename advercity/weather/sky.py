"""Where in the sky the light comes from: CIE general sky, fog dome, glow of the night.

Directions are unit vectors (..., 3) in the world frame, luminances in cd/m² with linear sRGB as
the last axis.
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

GROUND_ALBEDO = 0.1
"""Of roads and fields in the mean."""
SNOW_ALBEDO = 0.85
"""Of a landscape under fresh snow."""
COVERING_M = 0.002
"""Depth of snow that hides all but 1/e of it."""
CLOUD_ALBEDO = 0.6
"""Of an overcast sky, from below."""
AIRLIGHT_SIZE = 64
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
_TYPE_OF_OKTAS = (12, 12, 12, 11, 8, 7, 7, 3, 1)
HAZY_TURBIDITY = 5.0
"""From here on a clear sky is the polluted one."""

_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
_RGB_FROM_XYZ = np.array(
    [
        [3.2406, -1.5372, -0.4986],
        [-0.9689, 1.8758, 0.0415],
        [0.0557, -0.2040, 1.0570],
    ]
)
_ZENITH_XY = np.array([0.241, 0.250])
_HORIZON_XY = np.array([0.31, 0.33])
_AUREOLE_XY = np.array([0.36, 0.37])
_OVERCAST_XY = np.array([0.3127, 0.3290])
_AUREOLE_RAD = math.radians(20.0)


def direction_to(elevation_deg: float, azimuth_deg: float) -> Array:
    """Unit vector (3,) from an elevation and an azimuth clockwise from north."""
    elevation, azimuth = math.radians(elevation_deg), math.radians(azimuth_deg)
    level = math.cos(elevation)
    return np.array([level * math.sin(azimuth), level * math.cos(azimuth), math.sin(elevation)])


def cubemap_directions(size: int) -> Array:
    """Directions (6, size, size, 3) of the texels of a cubemap, laid out as `Atmosphere.sky`."""
    axis = (np.arange(size) + 0.5) / size * 2.0 - 1.0
    down, right = np.meshgrid(axis, axis, indexing="ij")
    one = np.ones_like(right)
    faces = np.stack(
        [
            np.stack([one, -right, -down], axis=-1),
            np.stack([-one, right, -down], axis=-1),
            np.stack([right, one, -down], axis=-1),
            np.stack([-right, -one, -down], axis=-1),
            np.stack([down, -right, one], axis=-1),
            np.stack([-down, -right, -one], axis=-1),
        ]
    )
    return faces / np.linalg.norm(faces, axis=-1, keepdims=True)


def texel_solid_angles(size: int) -> Array:
    """Solid angles (size, size) in sr of the texels of one face; six faces make 4 pi."""
    axis = (np.arange(size) + 0.5) / size * 2.0 - 1.0
    square = axis[:, None] ** 2 + axis[None, :] ** 2
    return 4.0 / (size**2 * (1.0 + square) ** 1.5)


def luminance(colour: Array) -> Array:
    """Luminance (...) of linear sRGB (..., 3)."""
    return colour @ _LUMINANCE


def horizontal_illuminance(cubemap: Array) -> float:
    """Illuminance in lx of level ground under a cubemap (6, n, n, 3) of cd/m²."""
    size = cubemap.shape[1]
    cosine = np.maximum(cubemap_directions(size)[..., 2], 0.0)
    return float(np.sum(luminance(cubemap) * cosine * texel_solid_angles(size)))


def sky_type(oktas: int, *, turbidity: float = 3.0) -> int:
    """CIE type of a sky with `oktas` eighths of cloud."""
    clear = _TYPE_OF_OKTAS[oktas] == 12
    return 13 if clear and turbidity >= HAZY_TURBIDITY else _TYPE_OF_OKTAS[oktas]


def cie_luminance(directions: Array, sun: Array, cie_type: int) -> Array:
    """Luminance (...) of the CIE general sky against its zenith; at the horizon below it.

    Args:
        directions: (..., 3).
        sun: (3,) towards the sun.
        cie_type: Number of the standard sky.
    """
    a, b, c, d, e = _CIE_TYPES[cie_type]

    def gradation(sine: Array | float) -> Array:
        return 1.0 + a * np.exp(b / np.maximum(sine, 1e-4))

    def indicatrix(angle: Array | float) -> Array:
        scattered = c * (np.exp(d * np.asarray(angle)) - math.exp(d * math.pi / 2.0))
        return 1.0 + scattered + e * np.cos(angle) ** 2

    from_sun = np.arccos(np.clip(directions @ sun, -1.0, 1.0))
    sun_from_zenith = math.acos(min(1.0, max(-1.0, float(sun[2]))))
    return (
        indicatrix(from_sun)
        * gradation(directions[..., 2])
        / (indicatrix(sun_from_zenith) * gradation(1.0))
    )


def daylight_colour(directions: Array, sun: Array, *, cloud_share: float) -> Array:
    """Colour (..., 3) of the sky with luminance 1: blue overhead, warm by the sun, grey clouds."""
    height = np.sqrt(np.clip(directions[..., 2:], 0.0, 1.0))
    clear = _HORIZON_XY + (_ZENITH_XY - _HORIZON_XY) * height
    from_sun = np.arccos(np.clip(directions @ sun, -1.0, 1.0))[..., None]
    aureole = np.clip(1.0 - from_sun / _AUREOLE_RAD, 0.0, 1.0)
    clear = clear + (_AUREOLE_XY - clear) * aureole
    return _colour_of(clear + (_OVERCAST_XY - clear) * cloud_share)


def ground_albedo(snow_depth_m: float) -> float:
    """Albedo of the landscape, under snow of a depth."""
    bare = math.exp(-snow_depth_m / COVERING_M)
    return SNOW_ALBEDO + (GROUND_ALBEDO - SNOW_ALBEDO) * bare


def share_from_ground(albedo: float, oktas: int) -> float:
    """Of a sky's light on the ground, what clouds have from a ground brighter than usual.

    Light goes to and fro between ground and clouds; what comes from below is even.
    """
    return CLOUD_ALBEDO * oktas / 8.0 * (albedo - GROUND_ALBEDO)


def airlight_of(illuminance_lx: float) -> float:
    """Luminance of air that is lit from above with an illuminance and from below by the ground."""
    return illuminance_lx * (1.0 + GROUND_ALBEDO) / (2.0 * math.pi)


def airlight_between(low: ArrayLike, high: ArrayLike) -> NDArray[np.float32]:
    """Airlight (6, m, m, 4) as `Atmosphere` has it, as bright everywhere along a ray.

    Args:
        low: (3,) in cd/m² looking at or below the horizon.
        high: (3,) at the zenith; between them it runs with the sine of the elevation.
    """
    share = np.maximum(cubemap_directions(AIRLIGHT_SIZE)[..., 2:], 0.0)
    colour = np.asarray(low) * (1.0 - share) + np.asarray(high) * share
    return np.concatenate([colour, np.zeros_like(share)], axis=-1).astype(np.float32)


def _colour_of(chromaticity: Array) -> Array:
    x, y = chromaticity[..., 0], chromaticity[..., 1]
    xyz = np.stack([x / y, np.ones_like(x), (1.0 - x - y) / y], axis=-1)
    rgb = xyz @ _RGB_FROM_XYZ.T
    return rgb / luminance(rgb)[..., None]
