"""Where the sun is at a time and place.

The low-precision formulas of the Astronomical Almanac as Michalsky gives them (Solar Energy 40,
227-235, 1988): within 0.01 degrees from 1950 to 2050.
"""

import math
from datetime import UTC, datetime, timedelta, timezone

_EPOCH = datetime(2000, 1, 1, 12, tzinfo=UTC)
_REFRACTED_ABOVE_DEG = -0.833
"""When the upper edge of the refracted sun is on the horizon."""


def parse_time(text: str, lon_deg: float) -> datetime:
    """Read a time of ISO 8601; without an offset, it is of the nautical zone of a longitude.

    Raises:
        ValueError: It is no such time.
    """
    time = datetime.fromisoformat(text)
    if time.tzinfo is None:
        time = time.replace(tzinfo=timezone(timedelta(hours=round(lon_deg / 15.0))))
    return time


def compute_sun_position(time: datetime, lat_deg: float, lon_deg: float) -> tuple[float, float]:
    """Compute the sun's apparent elevation and its azimuth clockwise from north, in degrees."""
    days = (time - _EPOCH) / timedelta(days=1)
    anomaly = math.radians(357.528 + 0.9856003 * days)
    longitude = math.radians(
        280.460 + 0.9856474 * days + 1.915 * math.sin(anomaly) + 0.020 * math.sin(2.0 * anomaly)
    )
    obliquity = math.radians(23.439 - 4e-7 * days)
    right_ascension = math.atan2(math.cos(obliquity) * math.sin(longitude), math.cos(longitude))
    declination = math.asin(math.sin(obliquity) * math.sin(longitude))
    # The sidereal angle of Greenwich turns by 360.985647 degrees a day.
    sidereal_deg = 280.46062 + 360.98564737 * days
    hour_angle = math.radians(sidereal_deg + lon_deg) - right_ascension
    latitude = math.radians(lat_deg)
    elevation = math.asin(
        math.sin(declination) * math.sin(latitude)
        + math.cos(declination) * math.cos(latitude) * math.cos(hour_angle)
    )
    azimuth = math.atan2(
        -math.sin(hour_angle) * math.cos(declination),
        math.sin(declination) * math.cos(latitude)
        - math.cos(declination) * math.sin(latitude) * math.cos(hour_angle),
    )
    elevation_deg = math.degrees(elevation)
    return elevation_deg + _refraction_deg(elevation_deg), math.degrees(azimuth) % 360.0


def _refraction_deg(elevation_deg: float) -> float:
    """Compute how much air lifts the sun (Bennett 1982 inverted by Saemundsson 1986)."""
    if elevation_deg < _REFRACTED_ABOVE_DEG:
        return 0.0
    lifted = math.radians(elevation_deg + 10.3 / (elevation_deg + 5.11))
    return max(0.0, 1.02 / 60.0 / math.tan(lifted))
