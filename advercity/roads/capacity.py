"""How many road users a road has room for."""

import math

VEHICLE_SPACING_M = 8.0
"""Spacing of the positions where vehicles may start, as in the original."""
WALKER_SPACING_M = 1.0


def describe_excess(vehicles: int, walkers: int, *, lane_m: float, sidewalk_m: float) -> str:
    """Describe the road users without room on a road; empty if all fit.

    Args:
        vehicles: Vehicles of the background traffic.
        walkers: Pedestrians; without sidewalks there are none.
        lane_m: Length of all driving lanes.
        sidewalk_m: Length of all sidewalks.
    """
    places = math.floor(lane_m / VEHICLE_SPACING_M)
    if vehicles > places:
        return (
            f"{vehicles} vehicles do not fit on {lane_m:.0f} m of lanes, which have room for"
            f" {places}, {VEHICLE_SPACING_M:g} m each"
        )
    places = math.floor(sidewalk_m / WALKER_SPACING_M)
    if walkers > places > 0:
        return (
            f"{walkers} pedestrians do not fit on {sidewalk_m:.0f} m of sidewalks, which have room"
            f" for {places}, {WALKER_SPACING_M:g} m each"
        )
    return ""
