"""Extinction of components, and visibility."""

import math
from typing import Any

import pytest
from advercity_dsl import Weather
from hypothesis import given
from hypothesis import strategies as st

from advercity.physics import extinction


def weather(time: str = "day", **parts: Any) -> Weather:
    sun = {"elevation_deg": 60 if time == "day" else -30}
    return Weather.model_validate({"id": "tried", "time": time, "sun": sun} | parts)


@given(mor_m=st.floats(10, 50_000))
def test_five_per_cent_of_the_light_remain_at_the_optical_range(mor_m: float) -> None:
    assert math.exp(-extinction.extinction_from_mor(mor_m) * mor_m) == pytest.approx(0.05, abs=1e-6)


def test_extinctions_of_fog_and_rain_add_up() -> None:
    total = extinction.compute_extinction(
        weather(air={"mor_m": None}, fog={"mor_m": 90}, rain={"rate_mm_h": 50})
    )
    assert total.at_550nm == pytest.approx(0.03757, rel=0.005)
    assert total.at_905nm == total.at_550nm


@pytest.mark.parametrize(
    ("rate_mm_h", "expected"),
    [(0, 0.0), (1, 3.65e-4), (10, 1.556e-3), (50, 4.288e-3), (100, 6.636e-3)],
)
def test_extinction_of_rain_follows_its_table(rate_mm_h: float, expected: float) -> None:
    rain = extinction.compute_extinction(weather(rain={"rate_mm_h": rate_mm_h}))["rain"]
    assert rain.at_550nm == pytest.approx(expected, rel=0.005)


@pytest.mark.parametrize(
    ("rate_mm_h", "expected"),
    [(0, 0.0), (0.5, 2.25e-3), (1, 3.34e-3), (2.5, 5.63e-3), (4, 7.37e-3)],
)
def test_extinction_of_snow_follows_its_table(rate_mm_h: float, expected: float) -> None:
    snowing = weather(snow={"rate_mm_h": rate_mm_h}, temperature_c=-3)
    snow = extinction.compute_extinction(snowing)["snow"]
    assert snow.at_550nm == pytest.approx(expected, rel=0.005)


@pytest.mark.parametrize(
    ("mor_m", "factor"),
    [(75, 1.0), (380, 1.0), (500, 0.927), (1000, 0.761), (2000, 0.686), (20_000, 0.523)],
)
def test_haze_attenuates_the_infrared_less_and_fog_does_not(mor_m: float, factor: float) -> None:
    assert extinction.kim_wavelength_factor(mor_m) == pytest.approx(factor, abs=1e-3)


def test_dust_attenuates_the_infrared_a_little_less() -> None:
    dusty = extinction.compute_extinction(weather(air={"mor_m": None}, dust={"mor_m": 300}))
    assert dusty.at_905nm == pytest.approx(0.95 * math.log(20) / 300)


@given(
    fog_m=st.floats(30, 500),
    rain_mm_h=st.floats(0, 150),
    more_rain_mm_h=st.floats(0.1, 50),
)
def test_more_rain_never_clears_the_air(
    fog_m: float, rain_mm_h: float, more_rain_mm_h: float
) -> None:
    less, more = (
        extinction.compute_extinction(
            weather(fog={"mor_m": fog_m}, rain={"rate_mm_h": min(rate, 150)})
        )
        for rate in (rain_mm_h, rain_mm_h + more_rain_mm_h)
    )
    assert more.at_550nm >= less.at_550nm
    assert more.at_905nm >= less.at_905nm
