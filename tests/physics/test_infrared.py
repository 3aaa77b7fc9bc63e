"""Infrared of 8 to 14 um, against tables and laws that others published."""

import math
from typing import Any

import numpy as np
import pytest
from advercity_dsl import Weather

from advercity.physics.extinction import compute_extinction
from advercity.physics.infrared import (
    STEFAN_BOLTZMANN,
    WATER_INDEX,
    WATER_UM,
    InfraredAir,
    band_radiance,
    brightness_temperature,
    droplet_factor,
    mie_extinction,
)


def find_air(**parts: Any) -> InfraredAir:
    weather = Weather.model_validate(
        {"id": "tried", "time": "night", "sun": {"elevation_deg": -30}, "sky": {"oktas": 0}} | parts
    )
    return InfraredAir.from_weather(weather, compute_extinction(weather))


def test_a_black_body_at_300_k_radiates_38_per_cent_in_the_band() -> None:
    # Incropera, Fundamentals of Heat and Mass Transfer, table 12.1: 2400 and 4200 um K.
    fraction = 0.516014 - 0.140256
    total = STEFAN_BOLTZMANN * 300.0**4 / math.pi
    assert float(band_radiance(300.0)) == pytest.approx(fraction * total, rel=2e-4)
    kelvin = np.array([230.0, 287.3, 400.0])
    np.testing.assert_allclose(brightness_temperature(band_radiance(kelvin)), kelvin, atol=1e-3)


def test_spheres_extinguish_as_tables_of_mie_theory_have_it() -> None:
    # Wiscombe, NCAR/TN-140+STR (1979): index 1.33 + 1e-5 i, size parameters 1 and 100.
    found = mie_extinction(np.array([1.0, 100.0]), 1.33 + 1e-5j)
    np.testing.assert_allclose(found, [0.093952, 2.101321], rtol=2e-5)


@pytest.mark.parametrize("radius_um", [2.5, 4.0, 6.0, 10.0])
def test_fog_at_11_um_follows_the_water_in_it(radius_um: float) -> None:
    # Chylek (J. Atmos. Sci. 35, 296, 1978): Q is 0.29 of the size parameter up to 14 um, so that
    # the extinction depends on the water alone.
    index = complex(WATER_INDEX[WATER_UM.tolist().index(11.0)])
    found = mie_extinction(np.array([2.0 * math.pi * radius_um / 11.0]), index)
    assert found == pytest.approx([0.29 * 2.0 * math.pi * radius_um / 11.0], rel=0.2)


def test_small_droplets_hide_less_than_in_the_visible_and_large_ones_as_much() -> None:
    assert droplet_factor(5.0) < 0.4
    assert 0.7 < droplet_factor(12.0) < 0.9
    assert droplet_factor(50.0) == pytest.approx(1.1, abs=0.1)


def test_haze_is_nearly_transparent_and_dense_fog_hides_as_it_does_from_the_eye() -> None:
    visibility_m = 500.0
    visible_per_m = math.log(20.0) / visibility_m
    haze = find_air(air={"mor_m": visibility_m})
    assert haze.drops_per_m < 0.7 * visible_per_m
    clear = find_air(air={"mor_m": 20_000.0})
    assert clear.drops_per_m < 0.03 * math.log(20.0) / 20_000.0
    fog = find_air(fog={"mor_m": 50.0, "droplet_um": 20})
    assert fog.extinction_per_m == pytest.approx(math.log(20.0) / 50.0, rel=0.1)
    rain = find_air(rain={"rate_mm_h": 50}, air={"mor_m": None})
    assert rain.drops_per_m == pytest.approx(4.288e-3, rel=5e-3)


def test_a_clear_sky_is_cold_above_and_as_warm_as_the_air_at_the_horizon_and_in_fog() -> None:
    sine = np.array([1.0, 0.3, 0.0])
    clear, cloudy, fog = (
        brightness_temperature(find_air(temperature_c=10, **parts).sky_radiance(sine)) - 273.15
        for parts in ({}, {"sky": {"oktas": 8}}, {"fog": {"mor_m": 50, "depth_m": 100}})
    )
    assert clear[0] < -25
    assert clear[0] < clear[1] < clear[2] < 10
    assert 0 < cloudy[0] < 10
    np.testing.assert_allclose(fog, 10, atol=0.3)


def test_the_loss_to_a_clear_sky_is_swinbanks_and_clouds_take_most_of_it() -> None:
    # At 15 degC Swinbank's sky gives 0.777 of a black body's radiation.
    clear = find_air(temperature_c=15, air={"mor_m": None})
    assert clear.longwave_loss_w_m2 == pytest.approx(0.223 * 390.9, rel=0.01)
    cloudy = find_air(temperature_c=15, air={"mor_m": None}, sky={"oktas": 8})
    assert cloudy.longwave_loss_w_m2 == pytest.approx(0.16 * clear.longwave_loss_w_m2, rel=1e-6)
