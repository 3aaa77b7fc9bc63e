"""Places of projected coordinates; the numbers are PROJ's (pyproj 3.7)."""

import pytest

from advercity.geometry.geodesy import Geodetic, geodetic_from_enu
from advercity.roads.georeference import (
    choose_origin,
    find_utm_zone,
    locate,
    parse_projection,
    project,
)


@pytest.mark.parametrize(
    ("text", "east_m", "north_m", "longitude_deg", "latitude_deg"),
    [
        ("+proj=utm +zone=32 +datum=WGS84", 691600, 5335000, 11.575558238932622, 48.13937796639319),
        ("epsg:32632", 691620, 5334998.25, 11.575826017208025, 48.13935621516445),
        ("+proj=utm +zone=33 +south", 345678.9, 6234567.8, 13.328647807753907, -34.01818909532485),
        (
            "+proj=tmerc +lat_0=40.7 +lon_0=-74 +k=0.9999 +x_0=1000 +y_0=-500",
            5000,
            7000,
            -73.95261879024451,
            40.767534924373926,
        ),
    ],
)
def test_projected_coordinates_are_where_proj_has_them(
    text: str, east_m: float, north_m: float, longitude_deg: float, latitude_deg: float
) -> None:
    projection = parse_projection(text)
    assert projection is not None

    place = locate(projection, east_m, north_m)

    assert place.longitude_deg == pytest.approx(longitude_deg, abs=1e-9)
    assert place.latitude_deg == pytest.approx(latitude_deg, abs=1e-9)
    found = project(projection, latitude_deg, longitude_deg)
    assert found == pytest.approx((east_m, north_m), abs=1e-3)


@pytest.mark.parametrize(
    ("latitude_deg", "longitude_deg", "code"),
    [(49.0, 8.42, "epsg:32632"), (-33.9, 151.2, "epsg:32756"), (0.0, -180.0, "epsg:32601")],
)
def test_a_place_is_in_the_utm_zone_of_its_longitude(
    latitude_deg: float, longitude_deg: float, code: str
) -> None:
    assert find_utm_zone(latitude_deg, longitude_deg) == parse_projection(code)


def test_a_map_s_axes_are_turned_by_the_meridian_convergence() -> None:
    projection = parse_projection("+proj=utm +zone=32 +datum=WGS84")
    assert projection is not None
    place = locate(projection, 691600, 5335000)
    origin = Geodetic(place.latitude_deg, place.longitude_deg, 0.0, place.convergence_deg)

    # PROJ's factor at this place; 1 km east on the grid is 1000.0 m / 1.00005 on the ellipsoid.
    assert place.convergence_deg == pytest.approx(1.918779874517491, abs=1e-4)
    found = geodetic_from_enu((1000.0, 0.0, 0.0), origin)
    ahead = locate(projection, 692600, 5335000)
    assert found.latitude_deg == pytest.approx(ahead.latitude_deg, abs=1e-6)
    assert found.longitude_deg == pytest.approx(ahead.longitude_deg, abs=1e-6)


@pytest.mark.parametrize(
    "text", ["", "+proj=lcc +lat_1=49", "+proj=utm +zone=61", "+proj=utm", "epsg:3857", "LOCAL_CS"]
)
def test_other_projections_are_not_guessed(text: str) -> None:
    assert parse_projection(text) is None


@pytest.mark.parametrize(
    ("bounds", "origin"),
    [
        ((-200, -150, 110, 270), (0, 0)),
        ((9000, 0, 10900, 100), (0, 0)),
        ((11000, 0, 11340, 80), (11200, 0)),
        ((691600, 5335000, 691900, 5335090), (691800, 5335000)),
    ],
)
def test_maps_far_from_their_origin_get_a_local_one(
    bounds: tuple[float, float, float, float], origin: tuple[float, float]
) -> None:
    assert choose_origin(*bounds) == origin
