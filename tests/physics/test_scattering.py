"""The verification cases of camera and weather physics, by number.

| case | what is tried | where |
| --- | --- | --- |
| 1, 2 | contrast and airlight of cards in fog, rendered | `test_weather_cases.py` of the backend |
| 3 | a twentieth is left at the optical range | `test_weather.py` |
| 4 | components add | `test_weather.py` |
| 5 | furnace: white things in white fog, rendered | `test_weather_cases.py` of the backend |
| 6 | illuminance by the fog dome | here |
| 7 | equiangular quadrature against a brute-force march | here |
| 8 | optical depth of fog that thins with height | here |
| 9 | phase functions | here |
| 10 | halo of a lamp in fog | here; rendered in `test_renderer.py` there |
| 11 | extinction of rain | `test_weather.py` |
| 12, 13, 14 | numbers, speed, streaks and slant of drops | `test_falling.py` |
| 15, 16 | water films and Fresnel | here |
| 17 | skies give their illuminance; overcast from zenith to horizon | here, `test_weather.py` |
| 18 | a white card under a clear sky | `test_weather.py`; rendered as case 5 |
| 19, 20, 21 | automatic exposure, saturation, photon transfer | `test_camera.py` |
| 22, 23 | stray light keeps energy; veil of the sun | `test_camera.py` |
| 24 to 34 | LiDAR | `test_lidar.py` |
| 35 to 38 | positioning and motion | `test_navigation.py` |
| 39 | lying snow | `test_falling.py` |
| 40 | order of the presets | `test_weather_cases.py` of the backend, `test_lidar.py` |
"""

import math
from functools import partial

import numpy as np
import pytest

from advercity.physics import photometry, sky
from advercity.physics.scattering import (
    PhaseFunction,
    droplet_phase,
    henyey_greenstein,
    isotropic_phase,
    lamp_airlight,
    layer_optical_depth,
)
from advercity.physics.water import (
    DIFFUSE_EXTERNAL_REFLECTANCE,
    DIFFUSE_INTERNAL_REFLECTANCE,
    WATER_REFRACTIVE_INDEX,
    fresnel_reflectance,
    wet_albedo,
)

MOR_75 = math.log(20.0) / 75.0
NODE, WEIGHT = np.polynomial.legendre.leggauss(2000)


def test_equiangular_steps_find_what_a_brute_force_march_finds() -> None:
    found = lamp_airlight(
        1000.0,
        closest_approach_m=2.0,
        closest_along_ray_m=10.0,
        distance_m=60.0,
        extinction=MOR_75,
        phase=isotropic_phase,
    )
    along_m = (np.arange(600_000) + 0.5) * 1e-4
    from_lamp_m = np.hypot(2.0, along_m - 10.0)
    left = np.exp(-MOR_75 * (along_m + from_lamp_m))
    marched = 1000.0 * MOR_75 / (4.0 * math.pi) * np.sum(left / from_lamp_m**2) * 1e-4
    assert found == pytest.approx(2.6266, rel=0.01)
    assert found == pytest.approx(marched, rel=1e-4)


@pytest.mark.parametrize(
    ("from_m", "rise_m", "expected"), [(1.5, 0, 5.5585), (6.5, -6.5, 5.1153), (1.5, 30, 2.8788)]
)
def test_fog_that_thins_with_height_is_thinner_along_paths_that_climb(
    from_m: float, rise_m: float, expected: float
) -> None:
    depth = layer_optical_depth(
        math.log(20.0) / 50.0,
        scale_height_m=20.0,
        start_height_m=from_m,
        rise_m=rise_m,
        distance_m=100.0,
    )
    assert depth == pytest.approx(expected, abs=1e-3)


def test_even_fog_is_the_limit_of_a_deep_layer() -> None:
    depth = layer_optical_depth(
        0.04, scale_height_m=math.inf, start_height_m=3.0, rise_m=9.0, distance_m=50.0
    )
    assert depth == pytest.approx(2.0)


def over_sphere(phase: PhaseFunction) -> tuple[float, float]:
    """Integral and mean cosine; nodes crowd where light goes straight on."""
    turn = math.pi * ((NODE + 1.0) / 2.0) ** 3
    weight = WEIGHT / 2.0 * math.pi * 3.0 * ((NODE + 1.0) / 2.0) ** 2
    value = 2.0 * math.pi * weight * np.sin(turn) * phase(np.cos(turn))
    return float(np.sum(value)), float(np.sum(value * np.cos(turn)))


@pytest.mark.parametrize("g", [-0.3, 0.0, 0.7, 0.87])
def test_henyey_and_greensteins_function_has_the_mean_cosine_of_its_name(g: float) -> None:
    assert over_sphere(partial(henyey_greenstein, g=g)) == pytest.approx((1.0, g), abs=1e-3)


@pytest.mark.parametrize(("diameter_um", "mean"), [(10, 0.864), (12, 0.869), (16, 0.876)])
def test_droplets_scatter_all_light_and_mostly_forwards(diameter_um: float, mean: float) -> None:
    found = over_sphere(partial(droplet_phase, diameter_um=diameter_um))
    assert found == pytest.approx((1.0, mean), abs=1e-3)


@pytest.mark.parametrize(("angle_deg", "value"), [(1, 100), (5, 1.71), (30, 0.184), (150, 0.0102)])
def test_droplets_of_12_micrometres_scatter_as_mie_says(angle_deg: float, value: float) -> None:
    cosine = np.cos(np.radians([angle_deg]))
    assert float(droplet_phase(cosine)[0]) == pytest.approx(value, rel=0.01)


@pytest.mark.parametrize(
    ("mor_m", "angle_deg", "expected"),
    [
        *((100, angle, value) for angle, value in [(2, 6.3), (5, 1.20), (10, 0.40), (20, 0.11)]),
        *((50, angle, value) for angle, value in [(2, 5.1), (5, 0.96), (10, 0.32)]),
        *((200, angle, value) for angle, value in [(2, 5.0), (5, 0.95), (10, 0.32)]),
    ],
)
def test_a_lamp_30_metres_away_wears_its_halo(
    mor_m: float, angle_deg: float, expected: float
) -> None:
    angle = math.radians(angle_deg)
    found = lamp_airlight(
        1000.0,
        closest_approach_m=30.0 * math.sin(angle),
        closest_along_ray_m=30.0 * math.cos(angle),
        distance_m=1000.0,
        extinction=math.log(20.0) / mor_m,
        phase=droplet_phase,
    )
    assert found == pytest.approx(expected, rel=0.1)


@pytest.mark.parametrize(("angle_deg", "share"), [(0, 0.0204), (60, 0.0597), (80, 0.3479)])
def test_water_mirrors_more_the_flatter_one_looks(angle_deg: float, share: float) -> None:
    cosine = np.cos(np.radians([angle_deg]))
    assert float(fresnel_reflectance(cosine, WATER_REFRACTIVE_INDEX)[0]) == pytest.approx(
        share, abs=1e-4
    )


def test_a_film_of_water_darkens_as_angstrom_found() -> None:
    body = float(wet_albedo(np.array([0.30]))[0])
    assert body == pytest.approx(0.1716, rel=0.01)
    assert body + DIFFUSE_EXTERNAL_REFLECTANCE == pytest.approx(0.2380, rel=0.01)


def test_diffuse_reflection_of_water_is_the_mean_over_its_angles() -> None:
    cosine, weight = (NODE + 1.0) / 2.0, WEIGHT / 2.0
    assert 2.0 * np.sum(
        weight * cosine * fresnel_reflectance(cosine, WATER_REFRACTIVE_INDEX)
    ) == pytest.approx(DIFFUSE_EXTERNAL_REFLECTANCE, abs=2e-4)
    assert pytest.approx(0.4746, abs=1e-4) == DIFFUSE_INTERNAL_REFLECTANCE


@pytest.mark.parametrize("cie_type", [1, 3, 5, 7, 8, 11, 12, 13])
def test_every_sky_gives_the_illuminance_that_it_is_scaled_to(cie_type: int) -> None:
    sun, directions = (
        sky.direction_from_elevation_azimuth(45.0, 120.0),
        photometry.cubemap_directions(128),
    )
    relative = sky.cie_relative_luminance(directions, sun, cie_type)[..., None] * np.ones(3)
    scaled = relative * (12_345.0 / photometry.horizontal_illuminance(relative))
    fine = photometry.cubemap_directions(256)
    finer = sky.cie_relative_luminance(fine, sun, cie_type)[..., None] * np.ones(3)
    ratio = photometry.horizontal_illuminance(scaled) / photometry.horizontal_illuminance(relative)
    assert ratio * photometry.horizontal_illuminance(finer) == pytest.approx(12_345.0, rel=0.005)
