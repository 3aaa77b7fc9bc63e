"""Where on the globe a map is, from its projection as a PROJ string.

Transverse Mercator (with UTM) is inverted by Krüger's series to the fourth order of the third
flattening, exact to 0.1 mm within 4000 km of the central meridian: Karney, J. Geodesy 85 (2011).
"""

import math
import re
from dataclasses import dataclass

from advercity_dsl.road import MapPlace
from advercity_dsl.units import Point2

from advercity.geometry.geodesy import FLATTENING, SEMI_MAJOR_M

UTM_SCALE, UTM_FALSE_EASTING_M, UTM_FALSE_NORTHING_M = 0.9996, 500_000.0, 10_000_000.0
ZONE_WIDTH_DEG = 6
NORTHERN_UTM_EPSG, SOUTHERN_UTM_EPSG, ZONES = 32_600, 32_700, range(1, 61)
EPSG_CODE = re.compile(r"(?:\+init=)?epsg:(\d{1,6})", re.IGNORECASE)
PARAMETER = re.compile(r"\+(\w+)(?:=(\S+))?")
THIRD_FLATTENING = FLATTENING / (2 - FLATTENING)
RECTIFYING_RADIUS_M = (
    SEMI_MAJOR_M / (1 + THIRD_FLATTENING) * (1 + THIRD_FLATTENING**2 / 4 + THIRD_FLATTENING**4 / 64)
)
LOCAL_DISTANCE_M = 10_000.0
"""Maps whose middle is farther from their origin get a local one."""
ORIGIN_STEP_M = 100.0
NOWHERE_DEG = 0.1


@dataclass(frozen=True)
class Projection:
    """A transverse Mercator projection of WGS84.

    Attributes:
        latitude_deg: Latitude of northing 0, without the false northing.
        longitude_deg: Central meridian.
        scale: Scale on it.
        false_m: Added easting and northing.
    """

    latitude_deg: float
    longitude_deg: float
    scale: float
    false_m: Point2


@dataclass(frozen=True)
class GlobePlace:
    """A place on WGS84.

    Attributes:
        latitude_deg: Geodetic latitude.
        longitude_deg: Longitude.
        convergence_deg: Angle from true north to the map's north, clockwise.
    """

    latitude_deg: float
    longitude_deg: float
    convergence_deg: float


def parse_projection(text: str) -> Projection | None:
    """Parse a PROJ string or an EPSG code of UTM; None if it is another projection or none."""
    code = EPSG_CODE.fullmatch(text.strip())
    if code is not None:
        return _find_utm(int(code[1]))
    values = {name: value or "" for name, value in PARAMETER.findall(text)}
    try:
        if values.get("proj") == "utm":
            return _build_utm(int(values["zone"]), is_south="south" in values)
        if values.get("proj") != "tmerc" or values.get("units", "m") != "m":
            return None
        return Projection(
            float(values.get("lat_0", 0)),
            float(values.get("lon_0", 0)),
            float(values.get("k", values.get("k_0", 1))),
            (float(values.get("x_0", 0)), float(values.get("y_0", 0))),
        )
    except (KeyError, ValueError):
        return None


def find_utm_zone(latitude_deg: float, longitude_deg: float) -> Projection:
    """Find the projection of the UTM zone of a place, without the exceptions around Norway."""
    zone = int((longitude_deg + 180) // ZONE_WIDTH_DEG) % len(ZONES) + 1
    north_m = UTM_FALSE_NORTHING_M if latitude_deg < 0 else 0.0
    return Projection(0.0, zone * ZONE_WIDTH_DEG - 183, UTM_SCALE, (UTM_FALSE_EASTING_M, north_m))


def project(projection: Projection, latitude_deg: float, longitude_deg: float) -> Point2:
    """Compute the easting and northing of a place."""
    conformal = _compute_conformal_latitude(math.radians(latitude_deg))
    turned = math.radians(longitude_deg - projection.longitude_deg)
    xi = math.atan2(math.tan(conformal), math.cos(turned))
    eta = math.asinh(math.sin(turned) / math.hypot(math.tan(conformal), math.cos(turned)))
    terms = [(2 * index, value) for index, value in enumerate(_forward(), start=1)]
    north = xi + sum(v * math.sin(k * xi) * math.cosh(k * eta) for k, v in terms)
    east = eta + sum(v * math.cos(k * xi) * math.sinh(k * eta) for k, v in terms)
    radius_m = RECTIFYING_RADIUS_M * projection.scale
    begins = _compute_rectifying_latitude(math.radians(projection.latitude_deg))
    return (
        projection.false_m[0] + radius_m * east,
        projection.false_m[1] + radius_m * (north - begins),
    )


def locate(projection: Projection, east_m: float, north_m: float) -> GlobePlace:
    """Compute the place of projected coordinates."""
    radius_m = RECTIFYING_RADIUS_M * projection.scale
    begins_m = radius_m * _compute_rectifying_latitude(math.radians(projection.latitude_deg))
    eta = (east_m - projection.false_m[0]) / radius_m
    xi = (north_m - projection.false_m[1] + begins_m) / radius_m
    terms = [
        (2 * index * xi, 2 * index * eta, value) for index, value in enumerate(_backward(), start=1)
    ]
    xi_sphere = xi - sum(v * math.sin(x) * math.cosh(y) for x, y, v in terms)
    eta_sphere = eta - sum(v * math.cos(x) * math.sinh(y) for x, y, v in terms)
    conformal = math.asin(math.sin(xi_sphere) / math.cosh(eta_sphere))
    turned = math.atan2(math.sinh(eta_sphere), math.cos(xi_sphere))
    latitude = _find_latitude(conformal)
    # Third-order terms of the convergence are below 1e-4 degrees inside a zone.
    convergence = math.atan(math.tan(turned) * math.sin(latitude))
    return GlobePlace(
        math.degrees(latitude),
        projection.longitude_deg + math.degrees(turned),
        math.degrees(convergence),
    )


def locate_origin(
    projection: str | Projection,
    east_m: float,
    north_m: float,
    *,
    altitude_m: float = 0.0,
    turn_deg: float = 0.0,
) -> MapPlace | None:
    """Locate the world's origin by a map's projection.

    Args:
        projection: Projection, or its PROJ string or EPSG code.
        east_m: Easting of the origin in the projection.
        north_m: Northing of the origin.
        altitude_m: Height of the map's origin.
        turn_deg: Counter-clockwise rotation of the map in the projection.

    Returns:
        The place; None if the projection is another one or none, or the place is not on the globe.
    """
    parsed = parse_projection(projection) if isinstance(projection, str) else projection
    if parsed is None:
        return None
    try:
        found = locate(parsed, east_m, north_m)
        place = MapPlace(
            latitude_deg=found.latitude_deg,
            longitude_deg=found.longitude_deg,
            altitude_m=altitude_m,
            convergence_deg=found.convergence_deg - turn_deg,
        )
    except (ValueError, OverflowError):
        return None
    # Editors without a place write a projection around latitude and longitude 0.
    is_nowhere = max(abs(place.latitude_deg), abs(place.longitude_deg)) < NOWHERE_DEG
    return None if is_nowhere else place


def choose_origin(west_m: float, south_m: float, east_m: float, north_m: float) -> Point2:
    """Choose the map coordinates of the world's origin: (0, 0) unless the map is far from there."""
    middle = (west_m + east_m) / 2, (south_m + north_m) / 2
    if math.hypot(*middle) <= LOCAL_DISTANCE_M:
        return 0.0, 0.0
    x, y = (round(value / ORIGIN_STEP_M) * ORIGIN_STEP_M for value in middle)
    return x, y


def _find_utm(code: int) -> Projection | None:
    for base, is_south in ((NORTHERN_UTM_EPSG, False), (SOUTHERN_UTM_EPSG, True)):
        if code - base in ZONES:
            return _build_utm(code - base, is_south=is_south)
    return None


def _build_utm(zone: int, *, is_south: bool) -> Projection | None:
    if zone not in ZONES:
        return None
    return find_utm_zone(-1.0 if is_south else 1.0, zone * ZONE_WIDTH_DEG - 183)


def _forward() -> tuple[float, ...]:
    n = THIRD_FLATTENING
    return (
        n / 2 - 2 * n**2 / 3 + 5 * n**3 / 16 + 41 * n**4 / 180,
        13 * n**2 / 48 - 3 * n**3 / 5 + 557 * n**4 / 1440,
        61 * n**3 / 240 - 103 * n**4 / 140,
        49561 * n**4 / 161280,
    )


def _backward() -> tuple[float, ...]:
    n = THIRD_FLATTENING
    return (
        n / 2 - 2 * n**2 / 3 + 37 * n**3 / 96 - n**4 / 360,
        n**2 / 48 + n**3 / 15 - 437 * n**4 / 1440,
        17 * n**3 / 480 - 37 * n**4 / 840,
        4397 * n**4 / 161280,
    )


def _compute_rectifying_latitude(latitude: float) -> float:
    """Compute the rectifying latitude: distance from the equator over the rectifying radius."""
    conformal = _compute_conformal_latitude(latitude)
    return conformal + sum(
        value * math.sin(2 * index * conformal) for index, value in enumerate(_forward(), start=1)
    )


def _compute_conformal_latitude(latitude: float) -> float:
    eccentricity = math.sqrt(FLATTENING * (2 - FLATTENING))
    sine = math.sin(latitude)
    stretched = math.atanh(sine) - eccentricity * math.atanh(eccentricity * sine)
    return math.atan(math.sinh(stretched))


def _find_latitude(conformal: float) -> float:
    """Find the latitude of a conformal latitude; the difference shrinks 150-fold each time."""
    latitude = conformal
    for _ in range(8):
        latitude += conformal - _compute_conformal_latitude(latitude)
    return latitude
