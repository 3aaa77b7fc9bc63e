"""What the shaders read about air and light, as pictures: a table of numbers and the sky.

The renderer works in kcd/m² and klx, so that no value is far from 1.
"""

import numpy as np
from numpy.typing import NDArray

from advercity.weather import puddles
from advercity.weather.atmosphere import Atmosphere
from advercity.weather.sky import cubemap_directions, texel_solid_angles
from advercity_sapien.shelter import ShelterMap
from advercity_sapien.wear import WearMap

KILO = 1e-3
COLUMNS = 512
LIST_ROWS = {"lamps": 3, "cells": 8, "tiles": 4, "bearings": 1}
"""Of the table, below its first row; `lamps.glsl` counts them too."""
SPREAD_ROWS = 2
"""Below them, for what fog spreads of beams."""
TABLE_ROWS = 1 + sum(LIST_ROWS.values()) + SPREAD_ROWS
DRY = -1.0
"""Water level below every hollow."""
RUT_SHARE = 0.3
"""Of a lane that is rut."""
RIPPLE_SLOPE, RIPPLING_RAIN_MM_H = 0.06, 50.0
"""Root mean square of the water's slope in puddles in rain of that rate."""

CONVOLVED = np.pi / np.array([1] + [1.5] * 3 + [4] * 5)
"""Of a harmonic's radiance, what the cosine leaves (Ramamoorthi and Hanrahan 2001)."""
NORMALISATION = np.array(
    [0.282095] + [0.488603] * 3 + [1.092548, 1.092548, 0.315392, 1.092548, 0.546274]
)


def sky_atlas(atmosphere: Atmosphere) -> NDArray[np.float32]:
    """The sky's six faces below each other, (6 n, n, 4) in kcd/m²."""
    sky = atmosphere.sky.reshape(-1, atmosphere.sky.shape[2], 3) * np.float32(KILO)
    return np.concatenate([sky, np.ones_like(sky[..., :1])], axis=-1)


def airlight_atlas(atmosphere: Atmosphere) -> NDArray[np.float32]:
    """The six faces of the airlight below each other, (6 m, m, 4) in kcd/m² and its growth."""
    faces = atmosphere.airlight.reshape(-1, atmosphere.airlight.shape[2], 4)
    return faces * np.array([KILO, KILO, KILO, 1.0], np.float32)


def atmosphere_row(atmosphere: Atmosphere) -> NDArray[np.float32]:
    """The table's first row, (COLUMNS, 4): the columns that `atmosphere.glsl` names."""
    row = np.zeros((COLUMNS, 4), dtype=np.float32)
    coverage = atmosphere.puddle_coverage
    level = puddles.level(coverage) if coverage > 0.0 else DRY
    slope = RIPPLE_SLOPE * min(1.0, atmosphere.rain_mm_h / RIPPLING_RAIN_MM_H) ** 0.5
    row[0] = atmosphere.extinction_550nm, atmosphere.wetness, level, slope
    row[1] = *np.multiply(atmosphere.airlight_low, KILO), atmosphere.night
    row[3, :3] = np.multiply(atmosphere.sun_colour, atmosphere.sun_lx * KILO)
    row[4, :3] = atmosphere.sun_direction
    row[5:14, :3] = irradiance_harmonics(atmosphere.sky) * KILO
    row[16, :3] = atmosphere.snow_depth_m, _between_ruts(atmosphere), atmosphere.rut_snow_cover
    return row


def _between_ruts(atmosphere: Atmosphere) -> float:
    """Share under snow between the ruts, which with that in them makes the road's."""
    in_ruts = RUT_SHARE * atmosphere.rut_snow_cover
    return min(1.0, (atmosphere.road_snow_cover - in_ruts) / (1.0 - RUT_SHARE))


def map_column(plan: WearMap | ShelterMap) -> tuple[float, float, float, float]:
    """Corner and inverse size of a map seen from above, as the shaders read them."""
    return (*plan.corner, 1.0 / plan.size[0], 1.0 / plan.size[1])


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
