"""Hail, clear ice and gusts."""

import math

import numpy as np
import pytest
from advercity_dsl import Lidar, Weather
from advercity_dsl.weather_components import Hail

from advercity.physics.atmosphere import compute_atmosphere
from advercity.physics.extinction import compute_extinction
from advercity.physics.stopping import DEFAULT_GRIP, friction_coefficient
from advercity.physics.timeline import WeatherTimeline
from advercity.physics.weather_parts.hail import compute_speed_m_s, find_stones
from advercity.physics.weather_parts.part import Precipitation
from advercity.physics.weather_text import format_weather
from advercity.sensors.lidar import derive_lidar_conditions
from advercity.sensors.lidar.beams import BeamShape
from advercity.sensors.lidar.received_power import Receiver
from advercity.sensors.lidar.volume_scattering import min_detectable_diameter_mm


def build_weather(**values: object) -> Weather:
    return Weather.model_validate({"kind": "weather", "id": "mine", "time": "day"} | values)


def stones_of(rate_mm_h: float, largest_mm: float) -> Precipitation:
    stones = find_stones(Hail(rate_mm_h=rate_mm_h, largest_mm=largest_mm))
    assert stones is not None
    return stones


def test_hail_of_10_mm_h_has_the_sizes_of_cheng_and_english():
    # Rates are 4.96 L^-1.17 mm/h: of 10 mm/h the slope is 0.55/mm, and 115 x 0.55^3.63 is 13.1.
    sizes = stones_of(10, 40).sizes

    assert sizes.slope_per_mm == pytest.approx(0.5496, abs=1e-3)
    assert sizes.intercept == pytest.approx(13.09, abs=0.05)
    assert sizes.number_concentration_above(5.0) == pytest.approx(1.526, abs=0.01)


def test_the_stones_that_fall_melt_to_the_rate():
    sizes = stones_of(25, 60).sizes
    diameter_mm = np.linspace(0, 60, 6001)
    number = sizes.intercept * np.exp(-sizes.slope_per_mm * diameter_mm)
    volume_mm3 = math.pi / 6 * diameter_mm**3 * 0.9 * compute_speed_m_s(diameter_mm)

    # 1 mm³ per m² and second is 3.6e-3 mm an hour.
    rate = 3.6e-3 * np.trapezoid(number * volume_mm3, diameter_mm)
    assert rate == pytest.approx(25, rel=0.01)
    assert compute_speed_m_s(10.0) == pytest.approx(9)


def test_hail_adds_to_rain():
    both = build_weather(rain={"rate_mm_h": 20}, hail={"rate_mm_h": 10})
    air = compute_extinction(both)

    assert [part.name for part in air.precipitation] == ["rain", "hail"]
    # pi 13.09e-6 / 0.5496^3
    assert air["hail"].at_550nm == pytest.approx(2.478e-4, rel=0.01)
    assert air.total.at_905nm == pytest.approx(
        sum(air[name].at_905nm for name in ("air", "rain", "hail"))
    )


def test_a_lidar_detects_smaller_stones_than_drops():
    # In rain of 50 mm/h at 10 m a drop needs 8.1 mm (weather reference, 7.6); a stone reflects six
    # times as much.
    stones = stones_of(25, 40)
    lidar = Lidar()
    (least_mm,) = min_detectable_diameter_mm(
        np.array([10.0]),
        stones,
        4.288e-3,
        Receiver.from_lidar(lidar),
        BeamShape.from_lidar(lidar),
        1.0,
    )

    assert least_mm == pytest.approx(8.1 / math.sqrt(6), rel=0.01)


def test_ice_looks_to_a_lidar_like_water():
    glazed = build_weather(surface={"ice_mm": 0.5}, temperature_c=-2)
    conditions = derive_lidar_conditions(compute_atmosphere(glazed, "rural"), glazed.lens)

    assert conditions.wetness == pytest.approx(1 - 1 / math.e)


def test_ice_takes_the_grip_of_a_road():
    mu = [
        friction_coefficient(
            DEFAULT_GRIP, build_weather(surface={"ice_mm": ice_mm}, temperature_c=-2)
        )
        for ice_mm in (0, 0.5, 5)
    ]

    # Dry asphalt has 0.8 and ice 0.1; 0.5 mm leave 1/e of the texture.
    assert mu == pytest.approx([0.8, 0.1 + 0.7 / math.e, 0.1], abs=1e-4)


def test_rain_below_zero_is_called_freezing():
    text = format_weather(
        build_weather(rain={"rate_mm_h": 2}, surface={"ice_mm": 3}, temperature_c=-2)
    )

    assert text == "day: light freezing rain, clear, 3 mm of ice, -2 degC"


def test_gusts_have_the_mean_and_the_peak_that_were_asked_for():
    gusty = build_weather(wind={"speed_m_s": 10, "gust_factor": 1.6})
    peaks, means = [], []
    for seed in range(12):
        timeline = WeatherTimeline(gusty, 1.0, seed, "scenario")
        speeds = [timeline.weather_at(frame).wind.speed_m_s for frame in range(600)]
        peaks.append(max(speeds))
        means.append(np.mean(speeds))
        assert np.std(speeds) == pytest.approx(2.0, rel=0.25)

    assert np.mean(means) == pytest.approx(10, rel=0.02)
    assert np.mean(peaks) == pytest.approx(16, rel=0.06)


def test_gusts_are_a_function_of_frame_and_key():
    gusty = build_weather(wind={"speed_m_s": 10, "gust_factor": 1.6})
    first, again, other = (WeatherTimeline(gusty, 0.1, seed, "scenario") for seed in (1, 1, 2))
    late = first.weather_at(50)

    assert again.weather_at(50) == late
    assert other.weather_at(50) != late
    assert first.is_changing
    assert first.find_light_frame(50) == 0
