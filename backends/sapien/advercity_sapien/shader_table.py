"""What the shaders read about air and light, as pictures: a table of numbers and the sky.

The renderer works in kcd/m² and klx, so that no value is far from 1.
"""

import numpy as np
from numpy.typing import NDArray

from advercity.physics import water
from advercity.physics.atmosphere import Atmosphere
from advercity.physics.photometry import cubemap_directions, cubemap_solid_angles
from advercity_sapien.ground_maps import ShelterMap, WearMap

WEAR_MAP_COLUMN, LAMP_GRID_COLUMN, FRAME_COLUMN, SHELTER_MAP_COLUMN = 14, 15, 16, 17


BODY_STATE_ROWS = 32
"""Of the ray tracer's table, for the states of as many times COLUMNS bodies."""


KILO = 1e-3
COLUMNS = 512
LAMP_LIST_ROWS = {"lamps": 3, "cells": 8, "tiles": 4, "bearings": 1}
"""Of the table, below its first row; `lamps.glsl` counts them too."""
FOG_BEAM_ROWS = 2
"""Below them, for what fog spreads of beams."""
TABLE_ROWS = 1 + sum(LAMP_LIST_ROWS.values()) + FOG_BEAM_ROWS
NO_WATER_LEVEL = -1.0
"""Water level below every hollow."""
RUT_FRACTION = 0.3
"""Of a lane that is rut."""
RIPPLE_SLOPE, RIPPLE_REFERENCE_RAIN_MM_H = 0.06, 50.0
"""Root mean square of the water's slope in puddles in rain of that rate."""

COSINE_LOBE_FACTORS = np.pi / np.array([1] + [1.5] * 3 + [4] * 5)
"""Of a harmonic's radiance, what the cosine leaves (Ramamoorthi and Hanrahan 2001)."""
HARMONIC_NORMS = np.array(
    [0.282095] + [0.488603] * 3 + [1.092548, 1.092548, 0.315392, 1.092548, 0.546274]
)


def build_sky_texture(atmosphere: Atmosphere) -> NDArray[np.float32]:
    """The sky's six faces below each other, (6 n, n, 4) in kcd/m²."""
    sky = atmosphere.sky.reshape(-1, atmosphere.sky.shape[2], 3) * np.float32(KILO)
    return np.concatenate([sky, np.ones_like(sky[..., :1])], axis=-1)


def build_airlight_texture(atmosphere: Atmosphere) -> NDArray[np.float32]:
    """The six faces of the airlight below each other, (6 m, m, 4) in kcd/m² and its growth."""
    faces = atmosphere.airlight.reshape(-1, atmosphere.airlight.shape[2], 4)
    return faces * np.array([KILO, KILO, KILO, 1.0], np.float32)


def pack_atmosphere(atmosphere: Atmosphere) -> NDArray[np.float32]:
    """The table's first row, (COLUMNS, 4): the columns that `atmosphere.glsl` names."""
    row = np.zeros((COLUMNS, 4), dtype=np.float32)
    coverage = atmosphere.puddle_coverage
    level = water.puddle_water_level(coverage) if coverage > 0.0 else NO_WATER_LEVEL
    slope = RIPPLE_SLOPE * min(1.0, atmosphere.rain_mm_h / RIPPLE_REFERENCE_RAIN_MM_H) ** 0.5
    row[0] = atmosphere.extinction_550nm, atmosphere.wetness, level, slope
    row[1] = *np.multiply(atmosphere.horizon_airlight, KILO), atmosphere.night
    row[3, :3] = np.multiply(atmosphere.sun_colour, atmosphere.sun_lx * KILO)
    row[4, :3] = atmosphere.sun_direction
    row[5:14, :3] = compute_irradiance_harmonics(atmosphere.sky) * KILO
    row[16, :3] = (
        atmosphere.snow_depth_m,
        _snow_cover_between_ruts(atmosphere),
        atmosphere.rut_snow_cover,
    )
    return row


def _snow_cover_between_ruts(atmosphere: Atmosphere) -> float:
    """Share under snow between the ruts, which with that in them makes the road's."""
    in_ruts = RUT_FRACTION * atmosphere.rut_snow_cover
    return min(1.0, (atmosphere.road_snow_cover - in_ruts) / (1.0 - RUT_FRACTION))


def pack_map_extent(plan: WearMap | ShelterMap) -> tuple[float, float, float, float]:
    """Corner and inverse size of a map seen from above, as the shaders read them."""
    return (*plan.corner, 1.0 / plan.size[0], 1.0 / plan.size[1])


def compute_irradiance_harmonics(sky: NDArray[np.float32]) -> NDArray[np.float64]:
    """Coefficients (9, 3) in lx of the irradiance by a sky in cd/m².

    They are scaled so that a horizontal surface gets exactly what the sky sends it.
    """
    size = sky.shape[1]
    directions = cubemap_directions(size).reshape(-1, 3)
    light = (sky * cubemap_solid_angles(size)[..., None]).reshape(-1, 3)
    basis = _harmonic_basis(directions)
    coefficients = (COSINE_LOBE_FACTORS * HARMONIC_NORMS**2)[:, None] * (basis.T @ light)
    horizontal = np.clip(directions[:, 2], 0.0, None) @ light
    approximate = _harmonic_basis(np.array([[0.0, 0.0, 1.0]]))[0] @ coefficients
    return coefficients * np.divide(
        horizontal, approximate, out=np.ones(3), where=approximate > 0.0
    )


def _harmonic_basis(directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Polynomials (n, 9) of the real harmonics up to second order, as in `atmosphere.glsl`."""
    x, y, z = directions.T
    return np.stack(
        [np.ones_like(x), y, z, x, x * y, y * z, 3 * z * z - 1, x * z, x * x - y * y], axis=1
    )


GRID_CELLS, LAMPS_PER_CELL = 32, 16
"""Along both edges of the ground that has lamps."""
TILES_HIGH, TILES_WIDE, LAMPS_PER_TILE = 18, 32, 12
BEARINGS, LAMPS_PER_BEARING = 64, 8
"""Of all around, clockwise from -180 degrees."""


FOG_BEAM_RINGS, FOG_BEAM_SPOKES = 16, 32
"""Rings crowd about the axis, by the square root of the angle; spokes run from right to up."""
