"""Places on the ellipsoid WGS84 and in the world frame around an origin, exact both ways."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from advercity.geometry.arrays import Float64Array

SEMI_MAJOR_M = 6_378_137.0
FLATTENING = 1.0 / 298.257223563
_ECCENTRICITY_2 = FLATTENING * (2.0 - FLATTENING)
_LATITUDE_ITERATIONS = 5
"""Latitude gains more than two digits in each."""


@dataclass(frozen=True)
class Geodetic:
    """A place on the Earth."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float = 0.0
    """Above the ellipsoid."""


def geodetic_from_enu(enu: ArrayLike, origin: Geodetic) -> Geodetic:
    """The place of a point (3,) of the world frame whose origin stands at `origin`."""
    ecef = _ecef_from_geodetic(origin) + _ecef_from_enu(origin) @ np.asarray(enu, dtype=np.float64)
    from_axis = math.hypot(ecef[0], ecef[1])
    latitude = math.atan2(ecef[2], from_axis * (1.0 - _ECCENTRICITY_2))
    for _ in range(_LATITUDE_ITERATIONS):
        normal = _prime_vertical_radius_m(latitude)
        latitude = math.atan2(ecef[2] + _ECCENTRICITY_2 * normal * math.sin(latitude), from_axis)
    sine, cosine = math.sin(latitude), math.cos(latitude)
    height = (
        from_axis * cosine + ecef[2] * sine - SEMI_MAJOR_M**2 / _prime_vertical_radius_m(latitude)
    )
    return Geodetic(math.degrees(latitude), math.degrees(math.atan2(ecef[1], ecef[0])), height)


def enu_from_geodetic(place: Geodetic, origin: Geodetic) -> Float64Array:
    """The point (3,) of the world frame around `origin` at a place."""
    return _ecef_from_enu(origin).T @ (_ecef_from_geodetic(place) - _ecef_from_geodetic(origin))


def _prime_vertical_radius_m(latitude: float) -> float:
    """Radius of curvature in the prime vertical."""
    return SEMI_MAJOR_M / math.sqrt(1.0 - _ECCENTRICITY_2 * math.sin(latitude) ** 2)


def _ecef_from_geodetic(place: Geodetic) -> Float64Array:
    latitude, longitude = math.radians(place.latitude_deg), math.radians(place.longitude_deg)
    normal = _prime_vertical_radius_m(latitude)
    from_axis = (normal + place.altitude_m) * math.cos(latitude)
    return np.array(
        [
            from_axis * math.cos(longitude),
            from_axis * math.sin(longitude),
            (normal * (1.0 - _ECCENTRICITY_2) + place.altitude_m) * math.sin(latitude),
        ]
    )


def _ecef_from_enu(origin: Geodetic) -> Float64Array:
    latitude, longitude = math.radians(origin.latitude_deg), math.radians(origin.longitude_deg)
    sin_lat, cos_lat = math.sin(latitude), math.cos(latitude)
    sin_lon, cos_lon = math.sin(longitude), math.cos(longitude)
    return np.array(
        [
            [-sin_lon, -sin_lat * cos_lon, cos_lat * cos_lon],
            [cos_lon, -sin_lat * sin_lon, cos_lat * sin_lon],
            [0.0, cos_lat, sin_lat],
        ]
    )
