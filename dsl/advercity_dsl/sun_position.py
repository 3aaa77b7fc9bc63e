"""Where the sun is at a time and place.

The low-precision formulas of the Astronomical Almanac as Michalsky gives them (Solar Energy 40,
227-235, 1988): within 0.01 degrees from 1950 to 2050.
"""

import math
import re
from datetime import UTC, date, datetime, timedelta, timezone
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError, available_timezones

from advercity_dsl.base import suggest_name

_EPOCH = datetime(2000, 1, 1, 12, tzinfo=UTC)
_REFRACTED_ABOVE_DEG = -0.833
"""When the upper edge of the refracted sun is on the horizon."""


_WITH_ZONE = re.compile(r"(\S.*\S)\s+([A-Za-z]\S*)")
_HINT = "write e.g. 2024-11-22T16:30"


class TimeError(ValueError):
    """A text without a valid instant.

    Attributes:
        message: The error.
        hint: How to correct it.
    """

    def __init__(self, message: str, hint: str) -> None:
        super().__init__(f"{message}; {hint}")
        self.message, self.hint = message, hint


def parse_time(text: str, lon_deg: float) -> datetime:
    """Read a time of ISO 8601, which a name of the IANA time zone database may follow.

    Without an offset and a zone, it is of the nautical zone of a longitude.

    Raises:
        TimeError: It is no such time, or clocks of the zone show it twice or never.
    """
    match = _WITH_ZONE.fullmatch(text.strip())
    written, zone = match.groups() if match else (text.strip(), None)
    try:
        time = datetime.fromisoformat(written)
    except ValueError:
        raise TimeError(f"'{text}' is not a time", _HINT) from None
    if is_date_alone(written):
        hint = f"add one, as in {time.date()}T16:30"
        raise TimeError(f"'{text}' is a date without a time", hint)
    if zone is not None:
        return _place_in_zone(time, zone)
    if time.tzinfo is None:
        time = time.replace(tzinfo=timezone(timedelta(hours=round(lon_deg / 15.0))))
    return time


def is_date_alone(text: str) -> bool:
    """Return whether a text is a date of ISO 8601 alone, which Python takes for midnight."""
    try:
        date.fromisoformat(text)
    except ValueError:
        return False
    return True


def is_without_zone(text: str) -> bool:
    """Return whether a valid time has neither an offset nor a zone."""
    match = _WITH_ZONE.fullmatch(text.strip())
    return match is None and datetime.fromisoformat(text.strip()).tzinfo is None


def _place_in_zone(time: datetime, zone: str) -> datetime:
    if time.tzinfo is not None:
        raise TimeError("has an offset and a time zone", "remove one of the two")
    try:
        placed = time.replace(tzinfo=ZoneInfo(zone))
    except (ZoneInfoNotFoundError, ValueError, OSError):
        hint = suggest_name(zone, available_timezones())
        raise TimeError(f"'{zone}' is not a time zone", hint) from None
    earlier, later = placed.utcoffset(), placed.replace(fold=1).utcoffset()
    if earlier != later:
        hint = f"give the offset instead, as in {placed.isoformat(timespec='minutes')}"
        raise TimeError(f"is when clocks of {zone} change", hint)
    return placed


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
