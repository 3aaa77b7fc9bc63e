"""Albedo of surfaces lighting others, after rain and snow."""

from dataclasses import replace

import numpy as np
import pytest
from advercity_sapien.weathered_albedo import WeatheredAlbedo
from numpy.typing import NDArray

from advercity.materials import MATERIALS
from advercity.rendering.raycaster import MATERIAL_INDEX
from advercity.rendering.surface_weather import CLEAN_SNOW, NO_WATER_LEVEL, SurfaceWeather

DRY = SurfaceWeather(
    wetness=0.0,
    puddle_level=NO_WATER_LEVEL,
    ripple_slope=0.0,
    ice_cover=0.0,
    snow_depth_m=0.0,
    snow_between_ruts=0.0,
    snow_in_ruts=0.0,
)
UPWARD, UPRIGHT = 1.0, 0.0


def look_up(weather: SurfaceWeather, material: str, upward: float) -> NDArray[np.float64]:
    index = np.array([MATERIAL_INDEX[material]], np.int16)
    return WeatheredAlbedo(weather).look_up(index, np.array([upward]))[0]


@pytest.mark.parametrize("name", ["asphalt", "grass", "plaster", "car_paint_black"])
def test_dry_surfaces_keep_their_albedo(name: str) -> None:
    np.testing.assert_allclose(look_up(DRY, name, UPWARD), MATERIALS[name].albedo)


def test_soaked_asphalt_reflects_half_and_its_film_mirrors_some_light() -> None:
    """0.85 of 0.934 of 0.53 / (1 - 0.1 0.47) of 0.1 is 0.044; the film mirrors 0.066."""
    red = look_up(replace(DRY, wetness=1.0), "asphalt", UPWARD)[0]
    assert red == pytest.approx(0.044 + 0.066, abs=0.002)


def test_drops_on_blades_make_no_film() -> None:
    assert look_up(replace(DRY, wetness=1.0), "grass", UPWARD)[1] < 0.6 * 0.135


def test_snow_lies_on_what_faces_up_and_where_wheels_leave_it() -> None:
    snow = replace(DRY, snow_depth_m=0.1, snow_between_ruts=0.5, snow_in_ruts=0.5)
    np.testing.assert_allclose(look_up(snow, "grass", UPWARD), CLEAN_SNOW)
    np.testing.assert_allclose(look_up(snow, "plaster", UPRIGHT), MATERIALS["plaster"].albedo)
    assert look_up(snow, "asphalt", UPWARD)[1] == pytest.approx(0.5 * (0.1 + 0.76), abs=0.01)
