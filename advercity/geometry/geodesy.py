"""Conversion between the ellipsoid WGS84 and the world frame (east, north, up) at an origin.

Both directions are exact to rounding; the formulas are from EPSG guidance note 7-2.
"""

import math
from dataclasses import dataclass

import numpy as np
from advercity_dsl import Road
from numpy.typing import ArrayLike

from advercity.geometry.arrays import Float64Array

SEMI_MAJOR_M = 6_378_137.0
FLATTENING = 1.0 / 298.257223563
_ECCENTRICITY_2 = FLATTENING * (2.0 - FLATTENING)
_LATITUDE_ITERATIONS = 5
"""Each iteration of the latitude gains more than two digits, so five exhaust a double."""


@dataclass(frozen=True)
class Geodetic:
    """A position in geodetic coordinates of WGS84."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float = 0.0
    """Height above the ellipsoid, not above sea level."""
    convergence_deg: float = 0.0
    """Bearing of the frame's y axis at its origin, clockwise from true north."""


def find_world_origin(road: Road) -> Geodetic:
    """Find where the world frame of a road is on the globe."""
    return Geodetic(
        road.origin_lat_deg, road.origin_lon_deg, road.origin_alt_m, road.origin_convergence_deg
    )


def geodetic_from_enu(enu: ArrayLike, origin: Geodetic) -> Geodetic:
    """Convert a point (3,) of the world frame, metres, whose origin is at `origin`."""
    ecef = _ecef_from_geodetic(origin) + _ecef_from_enu(origin) @ np.asarray(enu, dtype=np.float64)
    from_axis = math.hypot(ecef[0], ecef[1])
    latitude = math.atan2(ecef[2], from_axis * (1.0 - _ECCENTRICITY_2))
    # The ellipsoid has no closed form for the latitude of a point above it.
    for _ in range(_LATITUDE_ITERATIONS):
        normal = _prime_vertical_radius_m(latitude)
        latitude = math.atan2(ecef[2] + _ECCENTRICITY_2 * normal * math.sin(latitude), from_axis)
    sine, cosine = math.sin(latitude), math.cos(latitude)
    surface_m = SEMI_MAJOR_M**2 / _prime_vertical_radius_m(latitude)
    height = from_axis * cosine + ecef[2] * sine - surface_m
    return Geodetic(math.degrees(latitude), math.degrees(math.atan2(ecef[1], ecef[0])), height)


def enu_from_geodetic(position: Geodetic, origin: Geodetic) -> Float64Array:
    """Convert a geodetic position to a point (3,) of the world frame at `origin`, metres."""
    return _ecef_from_enu(origin).T @ (_ecef_from_geodetic(position) - _ecef_from_geodetic(origin))


def enu_from_ecef(ecef: ArrayLike, origin: Geodetic) -> Float64Array:
    """Convert Earth-centred points (..., 3), metres, to the world frame at `origin`."""
    relative = np.asarray(ecef, dtype=np.float64) - _ecef_from_geodetic(origin)
    return relative @ _ecef_from_enu(origin)


def _prime_vertical_radius_m(latitude: float) -> float:
    """Compute the radius of curvature in the prime vertical at a latitude in radians."""
    return SEMI_MAJOR_M / math.sqrt(1.0 - _ECCENTRICITY_2 * math.sin(latitude) ** 2)


def _ecef_from_geodetic(position: Geodetic) -> Float64Array:
    latitude, longitude = math.radians(position.latitude_deg), math.radians(position.longitude_deg)
    normal = _prime_vertical_radius_m(latitude)
    from_axis = (normal + position.altitude_m) * math.cos(latitude)
    polar = (normal * (1.0 - _ECCENTRICITY_2) + position.altitude_m) * math.sin(latitude)
    return np.array([from_axis * math.cos(longitude), from_axis * math.sin(longitude), polar])


def _ecef_from_enu(origin: Geodetic) -> Float64Array:
    """Rotation (3, 3) from east, north, up at `origin`, turned, to the Earth-centred frame."""
    latitude, longitude = math.radians(origin.latitude_deg), math.radians(origin.longitude_deg)
    sin_lat, cos_lat = math.sin(latitude), math.cos(latitude)
    sin_lon, cos_lon = math.sin(longitude), math.cos(longitude)
    turned = math.radians(origin.convergence_deg)
    sine, cosine = math.sin(turned), math.cos(turned)
    ecef_from_true = np.array(
        [
            [-sin_lon, -sin_lat * cos_lon, cos_lat * cos_lon],
            [cos_lon, -sin_lat * sin_lon, cos_lat * sin_lon],
            [0.0, cos_lat, sin_lat],
        ]
    )
    if not turned:
        return ecef_from_true
    return ecef_from_true @ np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
