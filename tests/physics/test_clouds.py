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
    choose_cloud_kind,
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
    sine = rng.uniform(0.0, 1.0, 3000)
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


def _slab(depth_m: float, sun: tuple[float, float, float] = (0.0, 0.0, 1.0)) -> CloudLayer:
    """Cloud of which sky, ground and sun have yet to be lit."""
    return CloudLayer("cumulus", 1.0, 1000.0, depth_m, sun, 0.0, 0.0, 0.0, 3.0, 0.0)


def _upward(elevation_deg: float) -> NDArray[np.float64]:
    return np.tile(direction_from_elevation_azimuth(elevation_deg, 0.0), (3000, 1))


def _even(height: float) -> NDArray[np.float32]:
    return np.full((1024, 1024), height, np.float32)


@pytest.mark.parametrize(
    ("height", "depth_m", "elevation_deg", "optical_depth"),
    [
        # 20 /km less the edges: 0.03 of the depth at the base and 0.06 at the top.
        (1.0, 50.0, 90.0, 0.91),
        (1.0, 20.0, 90.0, 0.364),
        (0.5, 50.0, 90.0, 0.41),
        (1.0, 50.0, 30.0, 1.82),
    ],
)
def test_an_even_cloud_hides_as_its_depth_and_its_edges_say(
    height: float, depth_m: float, elevation_deg: float, optical_depth: float
) -> None:
    opacity, _ = march_heaps(_even(height), _slab(depth_m), _upward(elevation_deg))
    assert opacity.mean() == pytest.approx(1 - math.exp(-optical_depth), rel=5e-3)


def _thin_luminance(**light: float) -> float:
    """Mean luminance per lx of a cloud of 1 m, of which every part is seen: 0.0182 deep."""
    (lux,) = light.values()
    layer = replace(_slab(1.0), **light)
    opacity, luminance = march_heaps(_even(1.0), layer, _upward(90.0))
    assert opacity.mean() == pytest.approx(0.0182, rel=0.02)
    return float(luminance.mean()) / (opacity.mean() * 0.75 / math.pi * lux)


def test_a_thin_cloud_scatters_sky_from_above_ground_from_below_and_the_sun_ahead() -> None:
    """The middle of its density is at 0.4418 / 0.91 = 0.4855 of the depth."""
    assert _thin_luminance(diffuse_lx=100.0) == pytest.approx(0.25 + 0.75 * 0.4855, rel=0.01)
    assert _thin_luminance(ground_lx=100.0) == pytest.approx(1 - 0.4855, rel=0.01)
    assert _thin_luminance(direct_lx=100.0) == pytest.approx(1.5, rel=0.01)
    aside = replace(_slab(1.0), direct_lx=100.0)
    opacity, luminance = march_heaps(_even(1.0), aside, _upward(30.0))
    found = luminance.mean() / (opacity.mean() * 0.75 / math.pi * 100)
    assert found == pytest.approx(0.9 + 0.6 * math.exp(-math.pi), rel=0.01)


@pytest.mark.parametrize("elevation_deg", [90.0, 30.0])
def test_cloud_between_it_and_the_sun_darkens_a_base(elevation_deg: float) -> None:
    """At the base all four samples are in cloud: 1.5 x 0.35 x 0.02 x the depth."""
    y, z = math.cos(math.radians(elevation_deg)), math.sin(math.radians(elevation_deg))
    heights, rays = _even(1.0), _upward(90.0)
    ratios = []
    for depth_m in (100.0, 300.0):
        layer = replace(_slab(depth_m, (0.0, y, z)), direct_lx=1.0)
        opacity, luminance = march_heaps(heights, layer, rays)
        ratios.append(luminance.mean() / (opacity.mean() * 0.75 / math.pi))
    angle = math.radians(90.0 - elevation_deg)
    phase = 0.9 + 0.6 * math.exp(-3.0 * angle)
    expected = [phase * _integrate_sunlight(depth_m, z) for depth_m in (100.0, 300.0)]
    np.testing.assert_allclose(ratios, expected, rtol=0.03)


def _integrate_sunlight(depth_m: float, sine: float) -> float:
    """Average the sun's light over where rays upwards end, by a fine sum."""
    height = (np.arange(20_000) + 0.5) / 20_000
    density = np.minimum(1.0, (1.0 - height) / 0.12) * np.minimum(1.0, height / 0.06)
    through = np.exp(-0.02 * depth_m * np.cumsum(density) / len(height))
    ends = density * through
    covered = sum(
        step * np.clip((1.0 - height - step) / 0.12, 0.0, 1.0) for step in (0.08, 0.2, 0.42, 0.8)
    )
    depth = covered * 0.35 * 0.02 * depth_m / sine
    light = 0.75 * np.exp(-depth) + 0.25 * np.exp(-0.25 * depth)
    return float((ends * light).sum() / ends.sum())


def test_many_heaps_tower_over_few_and_over_a_deck_from_which_it_rains() -> None:
    assert choose_cloud_kind(2, precipitating=False) == ("cumulus", 1300.0, 500.0)
    assert choose_cloud_kind(6, precipitating=True) == ("cumulus", 1300.0, 900.0)
    assert choose_cloud_kind(6.1, precipitating=False) == ("stratocumulus", 1000.0, 400.0)
    assert choose_cloud_kind(8, precipitating=True) == ("stratus", 600.0, 500.0)
