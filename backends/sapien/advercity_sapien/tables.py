"""What the shaders read about air and light, as pictures: a table of numbers and the sky.

The renderer works in kcd/m² and klx, so that no value is far from 1.
"""

import numpy as np
from numpy.typing import NDArray

from advercity.weather.atmosphere import Atmosphere
from advercity.weather.sky import cubemap_directions, texel_solid_angles
from advercity_sapien.wear import WearMap

KILO = 1e-3
COLUMNS = 256

CONVOLVED = np.pi / np.array([1] + [1.5] * 3 + [4] * 5)
"""Of a harmonic's radiance, what the cosine leaves (Ramamoorthi and Hanrahan 2001)."""
NORMALISATION = np.array(
    [0.282095] + [0.488603] * 3 + [1.092548, 1.092548, 0.315392, 1.092548, 0.546274]
)


def sky_atlas(atmosphere: Atmosphere) -> NDArray[np.float32]:
    """The sky's six faces below each other, (6 n, n, 4) in kcd/m²."""
    sky = atmosphere.sky.reshape(-1, atmosphere.sky.shape[2], 3) * np.float32(KILO)
    return np.concatenate([sky, np.ones_like(sky[..., :1])], axis=-1)


def atmosphere_row(atmosphere: Atmosphere) -> NDArray[np.float32]:
    """The table's first row, (COLUMNS, 4): the columns that `atmosphere.glsl` names."""
    row = np.zeros((COLUMNS, 4), dtype=np.float32)
    row[0] = atmosphere.extinction_550nm, atmosphere.wetness, atmosphere.puddle_coverage, 0.0
    row[1, :3] = np.multiply(atmosphere.airlight_low, KILO)
    row[2, :3] = np.multiply(atmosphere.airlight_high, KILO)
    row[3, :3] = np.multiply(atmosphere.sun_colour, atmosphere.sun_lx * KILO)
    row[4, :3] = atmosphere.sun_direction
    row[5:14, :3] = irradiance_harmonics(atmosphere.sky) * KILO
    return row


def wear_column(wear: WearMap) -> tuple[float, float, float, float]:
    """Corner and inverse size of the map of wear, as `texture.glsl` reads them."""
    return (*wear.corner, 1.0 / wear.size[0], 1.0 / wear.size[1])


def irradiance_harmonics(sky: NDArray[np.float32]) -> NDArray[np.float64]:
    """Coefficients (9, 3) in lx of the irradiance by a sky in cd/m².

    They are scaled so that a horizontal surface gets exactly what the sky sends it.
    """
    size = sky.shape[1]
    directions = cubemap_directions(size).reshape(-1, 3)
    light = (sky * texel_solid_angles(size)[..., None]).reshape(-1, 3)
    basis = _basis(directions)
    coefficients = (CONVOLVED * NORMALISATION**2)[:, None] * (basis.T @ light)
    horizontal = np.clip(directions[:, 2], 0.0, None) @ light
    approximate = _basis(np.array([[0.0, 0.0, 1.0]]))[0] @ coefficients
    return coefficients * np.divide(
        horizontal, approximate, out=np.ones(3), where=approximate > 0.0
    )


def _basis(directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Polynomials (n, 9) of the real harmonics up to second order, as in `atmosphere.glsl`."""
    x, y, z = directions.T
    return np.stack(
        [np.ones_like(x), y, z, x, x * y, y * z, 3 * z * z - 1, x * z, x * x - y * y], axis=1
    )
