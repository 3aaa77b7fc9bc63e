"""Clouds: how much they hide, what lights them, and that they keep the light on the ground."""

import math
from dataclasses import replace

import numpy as np
import pytest
from advercity_dsl import Weather
from numpy.typing import NDArray

from advercity.physics import photometry
from advercity.physics.atmosphere import Atmosphere, compute_atmosphere
from advercity.physics.clouds import (
    CloudLayer,
    build_heap_heights,
    draw_cloudy_sky,
    march_heaps,
)
from advercity.physics.sky import direction_from_elevation_azimuth


def weather(**fields: object) -> Weather:
    return Weather.model_validate({"id": "tried", "time": "day"} | fields)


def _day(oktas: int, elevation_deg: float = 60.0, rain_mm_h: float = 0.0) -> Atmosphere:
    return compute_atmosphere(
        weather(
            sun={"elevation_deg": elevation_deg, "azimuth_deg": 180},
            sky={"oktas": oktas},
            rain={"rate_mm_h": rain_mm_h},
        ),
        "urban",
    )


def _clouds(oktas: int, elevation_deg: float = 60.0) -> CloudLayer:
    clouds = _day(oktas, elevation_deg).clouds
    assert clouds is not None
    return clouds


def _opacity(layer: CloudLayer, rays: NDArray[np.float64]) -> NDArray[np.float64]:
    return march_heaps(build_heap_heights(layer), layer, rays)[0]


@pytest.mark.parametrize(("oktas", "rain_mm_h"), [(2, 0.0), (5, 0.0), (7, 0.0), (8, 10.0)])
def test_a_sky_with_clouds_lights_the_ground_as_much_as_the_mean_sky(
    oktas: int, rain_mm_h: float
) -> None:
    air = _day(oktas, rain_mm_h=rain_mm_h)
    assert air.clouds is not None
    drawn = draw_cloudy_sky(air.clouds, air.sky, 128)
    assert photometry.horizontal_illuminance(drawn) == pytest.approx(air.sky_lx, rel=1e-3)
    assert drawn.min() > 0.0


@pytest.mark.parametrize("oktas", [1, 3, 6])
def test_heaps_hide_as_many_eighths_of_the_sky_as_declared(oktas: int) -> None:
    rng = np.random.default_rng(5)
    sine = rng.uniform(math.sin(math.radians(10.0)), 1.0, 3000)
    azimuth = rng.uniform(0.0, 2.0 * math.pi, 3000)
    level = np.sqrt(1.0 - sine**2)
    rays = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), sine], axis=1)
    assert _opacity(_clouds(oktas), rays).mean() == pytest.approx(oktas / 8.0, abs=0.05)


@pytest.mark.parametrize("elevation_deg", [20.0, 45.0, 75.0])
def test_the_sun_is_in_a_gap_as_its_declared_light_needs(elevation_deg: float) -> None:
    rays = np.array(
        [
            direction_from_elevation_azimuth(elevation_deg + above, 180.0 + aside)
            for above in (-1.0, 0.0, 1.0)
            for aside in (-1.0, 0.0, 1.0)
        ]
    )
    assert _opacity(_clouds(4, elevation_deg), rays).max() < 0.05


def test_heaps_are_brighter_opposite_a_low_sun_than_below() -> None:
    layer = _clouds(5, 30.0)
    heights = build_heap_heights(layer)

    def mean_luminance(elevation_deg: float) -> float:
        rays = np.array(
            [direction_from_elevation_azimuth(elevation_deg, step) for step in range(-60, 61)]
        )
        opacity, luminance = march_heaps(heights, layer, rays)
        return float(luminance.sum() / opacity.sum())

    assert mean_luminance(8.0) > 1.3 * mean_luminance(70.0)


def test_haze_hides_far_heaps() -> None:
    air = _day(4)
    assert air.clouds is not None
    hazy = replace(air.clouds, haze_per_m=3.0 / 2000.0)
    face = draw_cloudy_sky(hazy, air.sky, 128)[2]  # north, where the clear sky is smooth
    low = photometry.luminance(face[58:62].astype(float))  # 1 to 5 degrees up
    clear = draw_cloudy_sky(air.clouds, air.sky, 128)[2]
    assert low.std() / low.mean() < 0.1 * (clear[40:60].std() / clear[40:60].mean())


@pytest.mark.parametrize(
    "changes",
    [
        {"time": "night", "sun": {"elevation_deg": -30}, "sky": {"oktas": 4}},
        {"fog": {"mor_m": 75}, "sun": {"elevation_deg": 60}, "sky": {"oktas": 4}},
        {"sun": {"elevation_deg": 60}, "sky": {"oktas": 0}},
    ],
)
def test_nights_fog_and_cloudless_days_have_no_clouds_to_draw(changes: dict[str, object]) -> None:
    assert compute_atmosphere(weather(**changes), "urban").clouds is None
