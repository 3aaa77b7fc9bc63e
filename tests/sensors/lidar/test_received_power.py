"""The LiDAR equation and the reflectance of surfaces."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from advercity.physics.extinction import extinction_from_mor
from advercity.physics.water import fresnel_reflectance
from advercity.sensors.lidar.received_power import (
    Receiver,
    daylight_noise_factor,
    detection_margin_sigma,
    wet_reflectance_ratio,
)
from tests.sensors.lidar.builders import (
    DARK,
    air,
    half_detection_range_m,
    measure,
    panel,
    received_power,
    vary,
)


def test_a_target_of_ten_per_cent_is_detected_to_80_m_in_clear_air() -> None:
    assert half_detection_range_m(0.10, math.log(20) / 20_000) == pytest.approx(80.0, rel=1e-6)


@pytest.mark.parametrize(("mor_m", "range_m"), [(50, 21.0), (100, 30.8), (200, 42.2)])
def test_fog_shortens_the_range_of_ten_per_cent(mor_m: float, range_m: float) -> None:
    foggy = air(air={"mor_m": None}, fog={"mor_m": mor_m})
    assert half_detection_range_m(0.10, foggy.extinction_per_m) == pytest.approx(range_m, rel=0.01)


def test_descriptions_name_the_last_step_of_range_at_which_a_target_is_found() -> None:
    foggy = air(air={"mor_m": None}, fog={"mor_m": 100}).extinction_per_m
    detection_range_m = Receiver.from_lidar(DARK).detection_range_m
    found_m = detection_range_m(0.10, foggy)
    assert 0.0 <= half_detection_range_m(0.10, foggy) - found_m < 0.1
    assert found_m == pytest.approx(30.8, abs=0.1)
    assert detection_range_m(0.9, 0.0) == pytest.approx(200.0)  # the end of the search
    assert detection_range_m(0.10, 1e4) == 0.0


def test_heavy_rain_shortens_the_range_of_fifty_per_cent() -> None:
    rainy = air(air={"mor_m": None}, rain={"rate_mm_h": 50})
    assert half_detection_range_m(0.50, rainy.extinction_per_m) == pytest.approx(112.3, rel=0.01)
    assert math.exp(-2 * rainy.extinction_per_m * 100) == pytest.approx(0.424, rel=0.01)


def test_light_crosses_fog_twice() -> None:
    fog = {"air": {"mor_m": None}, "fog": {"mor_m": 75}}
    lidar = vary(DARK, soft_gain=0, azimuths=100)
    found = measure(lidar, panel(25.0, lidar, "plaster"), **fog)
    assert math.exp(-2 * air(**fog).extinction_per_m * 25) == pytest.approx(0.1357, abs=1e-3)
    np.testing.assert_allclose(found.intensity, 0.6 * 0.1357, atol=1e-3)


def test_sunlight_takes_eleven_per_cent_of_the_range() -> None:
    near, far = 1.0, 200.0
    for _ in range(50):
        middle = (near + far) / 2
        power = received_power(np.array([middle]), np.array([0.1]), 0.0) / daylight_noise_factor(
            100_000
        )
        near, far = (middle, far) if power[0] > 1 else (near, middle)
    assert near / 80.0 == pytest.approx(0.89, abs=0.015)
    assert daylight_noise_factor(0.0) == 1.0


@pytest.mark.parametrize(
    ("angle_deg", "reflected"), [(0, 0.0204), (60, 0.0597), (80, 0.3479), (85, 0.5835)]
)
def test_water_at_905_nm_reflects_as_fresnel_says(angle_deg: float, reflected: float) -> None:
    cosine = np.array([math.cos(math.radians(angle_deg))], np.float32)
    assert fresnel_reflectance(cosine, 1.333)[0] == pytest.approx(reflected, abs=1e-4)


@pytest.mark.parametrize(
    ("angle_deg", "factor"), [(0, 0.586), (45, 0.578), (70, 0.460), (80, 0.261), (87, 0.048)]
)
def test_a_film_of_water_weakens_the_return(angle_deg: float, factor: float) -> None:
    cosine = np.array([math.cos(math.radians(angle_deg))], np.float32)
    reflectance = np.array([0.15], np.float32)
    assert wet_reflectance_ratio(reflectance, cosine)[0] == pytest.approx(factor, abs=1.5e-3)


@pytest.mark.parametrize(("wet", "range_m"), [(False, 25.4), (True, 13.6)])
def test_a_wet_road_is_lost_sooner(wet: bool, range_m: float) -> None:
    along = np.linspace(5.0, 40.0, 3501, dtype=np.float32)
    slant = np.hypot(along, np.float32(1.9))
    cosine = 1.9 / slant
    film = wet_reflectance_ratio(np.full_like(cosine, 0.15), cosine) if wet else 1.0
    seen = (
        detection_margin_sigma(
            received_power(slant, 0.15 * cosine * film, extinction_from_mor(20_000))
        )
        > 0
    )
    assert along[seen][-1] == pytest.approx(range_m, rel=0.02)


@given(range_m=st.floats(1, 200), mor_m=st.floats(10, 10_000), clearer=st.floats(1, 5))
def test_more_fog_never_strengthens_a_return(range_m: float, mor_m: float, clearer: float) -> None:
    thick, thin = (
        received_power(np.array([range_m]), np.array([0.3]), extinction_from_mor(visibility))
        for visibility in (mor_m, mor_m * clearer)
    )
    assert thick[0] <= thin[0]
