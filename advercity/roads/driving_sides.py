"""The driving side of a town, by its map or by its country."""

from collections.abc import Mapping

from advercity_dsl.road.streets import DrivingSide

from advercity.foreign.ledger import Ledger

Box = tuple[float, float, float, float]
"""South, west, north, east, degrees."""
LEFT_HAND_REGIONS: Mapping[str, tuple[Box, ...]] = {
    "the United Kingdom or Ireland": ((51.05, -10.7, 61.0, 1.78), (50.0, -6.5, 51.05, 1.1)),
    "Cyprus": ((34.5, 32.2, 35.7, 34.6),),
    "Malta": ((35.75, 14.1, 36.1, 14.6),),
    "Japan": (
        (24.0, 122.9, 28.5, 129.8),
        (30.0, 129.5, 34.0, 135.0),
        (33.8, 131.0, 41.6, 142.2),
        (41.3, 139.3, 45.6, 145.4),
    ),
    "Hong Kong": ((22.15, 113.83, 22.48, 114.45),),
    "India or its neighbours": (
        (5.9, 68.2, 27.2, 88.5),
        (24.5, 66.5, 27.2, 68.2),
        (27.2, 70.0, 30.3, 79.5),
        (30.3, 71.2, 34.5, 77.0),
        (21.5, 88.5, 26.5, 92.0),
    ),
    "Thailand": ((12.7, 99.3, 17.5, 102.2),),
    "Malaysia, Singapore or Indonesia": ((1.1, 99.6, 6.4, 104.4), (-9.0, 95.0, 1.1, 119.0)),
    "Australia": ((-44.0, 112.9, -10.5, 154.0),),
    "New Zealand": ((-47.5, 166.3, -34.3, 178.7),),
    "southern Africa": ((-35.0, 11.7, -17.5, 41.0),),
    "Kenya or Tanzania": ((-11.5, 34.0, 3.4, 40.9),),
    "Jamaica": ((17.6, -78.5, 18.6, -76.1),),
}
"""Regions with traffic on the left. Boxes lie within the borders of their countries, or of
neighbours that also drive on the left. Places near a border with the other side may be in none."""


def find_left_hand_region(latitude_deg: float, longitude_deg: float) -> str | None:
    """Find the name of a place's region with left-hand traffic; None elsewhere."""
    for name, boxes in LEFT_HAND_REGIONS.items():
        for south, west, north, east in boxes:
            if south <= latitude_deg <= north and west <= longitude_deg <= east:
                return name
    return None


def assume_driving_side(place_deg: tuple[float, float] | None, ledger: Ledger) -> DrivingSide:
    """Assume the side of a map without one, by its latitude and longitude.

    The left is recorded, since it is the exception.
    """
    region = find_left_hand_region(*place_deg) if place_deg else None
    if region is None:
        return "right"
    ledger.leave_out(f"driving side that the map lacks (left, as in {region}, is assumed)")
    return "left"
