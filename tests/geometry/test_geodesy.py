"""Geodetic positions and the local east-north-up frame."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from advercity.geometry.geodesy import Geodetic, enu_from_geodetic, geodetic_from_enu

ORIGIN = Geodetic(49.0, 8.0, 110.0)


@pytest.mark.parametrize(
    ("enu", "expected"),
    [
        ((1000, 1000, 10), (49.008991032, 8.013668672, 120.1567)),
        ((100, 0, 0), (48.999999992, 8.001366623, 110.0008)),
        ((-250, 400, 2), (49.003596692, 7.996583197, 112.0174)),
        ((0, 0, 0), (49.0, 8.0, 110.0)),
    ],
)
def test_places_on_the_ellipsoid_are_exact(
    enu: tuple[float, float, float], expected: tuple[float, float, float]
) -> None:
    place = geodetic_from_enu(enu, ORIGIN)
    assert place.latitude_deg == pytest.approx(expected[0], abs=1e-9)
    assert place.longitude_deg == pytest.approx(expected[1], abs=1e-9)
    assert place.altitude_m == pytest.approx(expected[2], abs=1e-4)


@given(
    east=st.floats(-2000, 2000),
    north=st.floats(-2000, 2000),
    up=st.floats(-50, 200),
    latitude=st.floats(-85, 85),
    longitude=st.floats(-179, 179),
)
def test_converting_to_geodetic_and_back_is_the_identity(
    east: float, north: float, up: float, latitude: float, longitude: float
) -> None:
    origin = Geodetic(latitude, longitude, 30.0)
    back = enu_from_geodetic(geodetic_from_enu((east, north, up), origin), origin)
    np.testing.assert_allclose(back, (east, north, up), atol=1e-3)
