"""Sizes of drops and flakes by their published distributions, and the wind that carries them."""

from typing import Any

import numpy as np
import pytest
from advercity_dsl import Weather
from advercity_dsl.weather_components import Wind

from advercity.physics.extinction import compute_extinction
from advercity.physics.precipitation import wind_at_height
from advercity.physics.weather_parts.part import ParticleSizeDistribution


def sizes(**parts: Any) -> ParticleSizeDistribution:
    """Of a weather in which one thing falls."""
    said = {"id": "tried", "time": "day", "sun": {"elevation_deg": 60}} | parts
    (found,) = compute_extinction(Weather.model_validate(said)).precipitation
    return found.sizes


def test_rain_has_the_sizes_of_marshall_and_palmer() -> None:
    """At 10 mm/h: 8000 per m³ and mm at 0, falling by 4.1 x 10^-0.21 = 2.528 per mm, to 6 mm."""
    rain = sizes(rain={"rate_mm_h": 10})
    found = rain.number_concentration_above(np.array([0.0, 1.0, 3.0, 6.0]))
    np.testing.assert_allclose(found, [3164.5, 252.6, 1.608, 0.0], rtol=2e-3)


def test_snow_has_the_sizes_of_gunn_and_marshall() -> None:
    """At 2 mm/h: 2079 per m³ and mm at 0, falling by 1.828 per mm of melted diameter."""
    snow = sizes(snow={"rate_mm_h": 2}, temperature_c=-3)
    found = snow.number_concentration_above(np.array([0.0, 1.0, 2.0]))
    np.testing.assert_allclose(found, [1137.3, 182.8, 29.4], rtol=2e-3)


def test_a_flake_has_the_mass_of_its_drop() -> None:
    """At a tenth of the density of water, the cube root of ten; a drop of rain is its own."""
    light = {"rate_mm_h": 2, "density_g_cm3": 0.1}
    assert sizes(rain={"rate_mm_h": 10}).air_to_melted_diameter == 1.0
    assert sizes(snow=light, temperature_c=-3).air_to_melted_diameter == pytest.approx(2.1544, 1e-4)


def test_drawn_diameters_are_exponential_between_their_bounds() -> None:
    """The median above 1 mm is ln 2 / 2.528 = 0.274 mm further on."""
    rain = sizes(rain={"rate_mm_h": 10})
    least, uniform = np.ones(3), np.array([0.0, 0.5, 1.0])
    drawn = rain.sample_diameters_mm(least, uniform, 6.0)
    np.testing.assert_allclose(drawn, [1.0, 1.274, 6.0], atol=1e-3)
    np.testing.assert_allclose(
        rain.sample_diameters_mm(least, uniform, 1.5), [1.0, 1.176, 1.5], atol=1e-3
    )


@pytest.mark.parametrize(
    ("from_deg", "velocity"), [(0, (0, -10, 0)), (90, (-10, 0, 0)), (225, (7.071, 7.071, 0))]
)
def test_wind_blows_from_its_bearing_and_slower_near_the_ground(
    from_deg: float, velocity: tuple[float, float, float]
) -> None:
    """At 2 m, ln(2 / 0.5) / ln(10 / 0.5) = 0.4628 of what it is at 10 m."""
    wind = Wind(speed_m_s=10, from_deg=from_deg)
    np.testing.assert_allclose(wind_at_height(wind, 10), velocity, atol=1e-3)
    np.testing.assert_allclose(wind_at_height(wind, 2), np.multiply(velocity, 0.4628), atol=1e-3)
