"""The sun by time and place, against published positions."""

import pytest
from advercity_dsl.sun_position import compute_sun_position, parse_time
from advercity_dsl.weather_components import Sun
from pydantic import ValidationError

# pvlib for 49 N 8 E; the example of NREL's solar position algorithm (Reda and Andreas 2008, table
# A5.1), whose place is 1830 m up, where air refracts by 0.004 degrees less.
POSITIONS = [
    ("2024-06-21T10:00Z", 49.0, 8.0, 58.92, 137.21),
    ("2024-12-21T11:00Z", 49.0, 8.0, 17.38, 173.69),
    ("2003-10-17T12:30:30-07:00", 39.742476, -105.1786, 90.0 - 50.11162, 194.34024),
]


@pytest.mark.parametrize(("at", "lat_deg", "lon_deg", "elevation_deg", "azimuth_deg"), POSITIONS)
def test_the_sun_is_where_almanacs_have_it(
    at: str, lat_deg: float, lon_deg: float, elevation_deg: float, azimuth_deg: float
) -> None:
    found = compute_sun_position(parse_time(at, lon_deg), lat_deg, lon_deg)
    assert found == pytest.approx((elevation_deg, azimuth_deg), abs=0.01)


def test_the_sun_sets_at_the_time_of_almanacs() -> None:
    """Ottawa, 22 November 2024: 16:26 in eastern standard time; its upper edge is at 0 degrees."""
    before, after = (
        Sun.model_validate({"at": f"2024-11-22T16:{minute}", "lat_deg": 45.42, "lon_deg": -75.70})
        for minute in (24, 28)
    )
    assert before.elevation_deg > -0.27 > after.elevation_deg


def test_a_time_without_an_offset_is_of_the_zone_of_its_longitude() -> None:
    assert parse_time("2024-11-22T16:30", -75.7) == parse_time("2024-11-22T21:30Z", 0.0)


@pytest.mark.parametrize(
    ("local", "utc"),
    [
        ("2025-06-21T12:00 Europe/Madrid", "2025-06-21T10:00Z"),
        ("2025-12-21 12:00  Europe/Madrid", "2025-12-21T11:00Z"),
        ("2025-03-20T06:50 Asia/Kolkata", "2025-03-20T01:20Z"),
        ("2025-12-21T06:10 Australia/Sydney", "2025-12-20T19:10Z"),
        ("2025-12-21T06:10 UTC", "2025-12-21T06:10Z"),
    ],
)
def test_a_time_may_be_of_a_zone(local: str, utc: str) -> None:
    assert parse_time(local, 100.0) == parse_time(utc, 0.0)
    sun = Sun.model_validate({"at": local, "lat_deg": 10, "lon_deg": 100})
    assert sun.time_utc == parse_time(utc, 0.0)


def test_legal_noon_of_madrid_is_hours_before_the_suns() -> None:
    """At a declination of 23.44 degrees, 34.2 and 4.2 degrees before the meridian."""
    madrid = {"lat_deg": 40.4168, "lon_deg": -3.7038}
    found = [
        Sun.model_validate({"at": f"2025-06-21T12:00{zone}"} | madrid).elevation_deg
        for zone in (" Europe/Madrid", "")
    ]
    assert found == pytest.approx([56.7, 72.66], abs=0.05)


@pytest.mark.parametrize(
    ("at", "message"),
    [
        ("2025-06-21T12:00 Europe/Madird", "did you mean 'Europe/Madrid'"),
        ("2025-06-21T12:00 ../etc/passwd", "is not a time"),
        ("2025-06-21T12:00 Europe/../../x", "is not a time zone"),
        ("2025-06-21T12:00+02:00 Europe/Madrid", "has an offset and a time zone"),
        ("2025-03-30T02:30 Europe/Madrid", "clocks of Europe/Madrid change"),
        ("2025-10-26T02:30 Europe/Madrid", "give the offset instead"),
        ("noon Europe/Madrid", "is not a time"),
        ("2025-06-21", "a date without a time; add one, as in 2025-06-21T16:30"),
        ("20250621 Europe/Madrid", "a date without a time; add one, as in 2025-06-21T16:30"),
    ],
)
def test_a_time_of_no_zone_is_refused(at: str, message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        Sun.model_validate({"at": at, "lat_deg": 40, "lon_deg": -3})


def test_a_spec_has_the_angles_alone() -> None:
    sun = Sun.model_validate({"at": "2024-06-21T10:00Z", "lat_deg": 49, "lon_deg": 8})
    written = sun.model_dump(mode="json")
    assert written == {"elevation_deg": sun.elevation_deg, "azimuth_deg": sun.azimuth_deg}
    assert Sun.model_validate(written).elevation_deg == sun.elevation_deg


@pytest.mark.parametrize(
    ("written", "message"),
    [
        ({"at": "2024-11-22T16:30"}, "requires lat_deg and lon_deg"),
        ({"lat_deg": 45.0}, "requires at and lon_deg"),
        ({"at": "tomorrow", "lat_deg": 45, "lon_deg": 0}, "'tomorrow' is not a time"),
        (
            {"at": "2024-11-22T16:30", "lat_deg": 45, "lon_deg": 0, "elevation_deg": 3},
            "cannot be combined with at",
        ),
    ],
)
def test_a_time_without_its_place_is_refused(written: dict[str, object], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        Sun.model_validate(written)
