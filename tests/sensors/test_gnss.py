"""Noise and drift of satellite receivers."""

import numpy as np
import pytest
from advercity_dsl import Gnss

from advercity.geometry.geodesy import Geodetic, enu_from_geodetic
from advercity.randomness import create_generator
from advercity.sensors.gnss import measure_gnss

ORIGIN = Geodetic(49.0, 8.0, 110.0)


def assert_uncorrelated(places: np.ndarray) -> None:
    """East, north and up err independently; of 5000, a correlation of 0.07 is five sigma."""
    np.testing.assert_allclose(np.corrcoef(places.T), np.eye(3), atol=0.07)


def test_a_receiver_without_noise_reports_its_position() -> None:
    found = measure_gnss(
        Gnss(), (100, 0, 0), origin=ORIGIN, time_s=6.0, rng=create_generator("test")
    )
    assert found.longitude_deg == pytest.approx(8.001366623, abs=1e-9)
    assert found.time_s == 6.0


def test_noise_in_degrees_is_a_third_of_a_metre_at_the_equator() -> None:
    origin = Geodetic(0.0, 0.0)
    gnss = Gnss(latitude_noise_deg=3e-6, longitude_noise_deg=3e-6, altitude_noise_m=0.05)
    fixes = [
        measure_gnss(
            gnss, (50, 20, 1), origin=origin, time_s=0.0, rng=create_generator("test", number)
        )
        for number in range(10_000)
    ]
    places = np.array(
        [
            enu_from_geodetic(
                Geodetic(found.latitude_deg, found.longitude_deg, found.altitude_m), origin
            )
            for found in fixes
        ]
    )
    np.testing.assert_allclose(places.std(axis=0), [0.334, 0.332, 0.05], rtol=0.03)
    np.testing.assert_allclose(places.mean(axis=0), [50, 20, 1], atol=0.015)
    assert_uncorrelated(places)


def realistic(**fields: float) -> Gnss:
    return Gnss.model_validate({"mode": "realistic"} | fields)


def error_of(gnss: Gnss, number: int, slow: np.ndarray) -> np.ndarray:
    found = measure_gnss(
        gnss,
        (0, 0, 0),
        origin=ORIGIN,
        time_s=0.0,
        rng=create_generator("test", number),
        slow_error=slow,
    )
    place = Geodetic(found.latitude_deg, found.longitude_deg, found.altitude_m)
    return enu_from_geodetic(place, ORIGIN)


def test_noise_in_metres_is_as_wide_north_as_east_and_wider_up() -> None:
    gnss = realistic(wander_m=0.0)
    errors = np.array([error_of(gnss, number, np.zeros(3)) for number in range(5000)])
    np.testing.assert_allclose(errors.std(axis=0), [0.3, 0.3, 0.525], rtol=0.04)
    assert_uncorrelated(errors)


def test_a_realistic_receiver_drifts() -> None:
    gnss = realistic(white_noise_m=0.0)
    error = error_of(gnss, 0, np.array([1.0, -2.0, 0.5]))
    np.testing.assert_allclose(error, [1.0, -2.0, 0.875], atol=1e-6)
