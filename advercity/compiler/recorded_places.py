"""Whether the vehicles of a recording drive on the lanes of its map."""

import logging
from collections.abc import Iterable

import numpy as np
import shapely
from advercity_dsl import MapNetwork, Spec

from advercity.errors import InputError
from advercity.recordings.tracks import Track
from advercity.roads.network_file import parse_packed_network

_logger = logging.getLogger(__name__)

MAX_LANE_DISTANCE_M = 10.0
"""Median distance of vehicles from lanes beyond which map and recording have other frames."""
LANE_WIDTH_M = 3.5
"""Median distance from lanes beyond which a vehicle drives next to them."""
MAX_LISTED = 8
UNMOTORISED = ("pedestrian", "bicycle")


def check_places(spec: Spec, tracks: Iterable[Track]) -> None:
    """Check that motor vehicles are on the map, and log the ones next to its lanes.

    Args:
        spec: A spec of the road.
        tracks: The tracks, in the map's own coordinates.

    Raises:
        InputError: They are far from all lanes.
    """
    imported = spec.road.imported
    vehicles = [track for track in tracks if track.actor_class not in UNMOTORISED]
    if not (isinstance(imported, MapNetwork) and vehicles):
        return
    mirror = (1.0, -1.0) if spec.road.is_left_hand else (1.0, 1.0)
    lanes = [
        lane.centre[:, :2] * mirror + imported.offset_m
        for lane in parse_packed_network(imported.network).lanes
        if lane.permits("passenger") and len(lane.centre) > 1
    ]
    lines = shapely.MultiLineString(lanes)
    medians_m = {
        track.id: float(np.median(shapely.distance(lines, shapely.points(track.places))))
        for track in vehicles
    }
    typical_m = np.median(list(medians_m.values()))
    if typical_m > MAX_LANE_DISTANCE_M:
        extents = (
            "{:.0f} to {:.0f} m east and {:.0f} to {:.0f} m north".format(
                *np.column_stack([points.min(axis=0), points.max(axis=0)]).ravel()
            )
            for points in map(np.concatenate, (lanes, [track.places for track in vehicles]))
        )
        map_extent, recorded_extent = extents
        raise InputError(
            f"vehicles are {typical_m:.0f} m from the lanes of the map (median): its lanes are at"
            f" {map_extent}, the vehicles at {recorded_extent}; is it the right map? move and"
            " turn the recording with `offset` and `turn`"
        )
    beside = [f"{name} ({away:.0f} m)" for name, away in medians_m.items() if away > LANE_WIDTH_M]
    if beside:
        listed = ", ".join([*beside[:MAX_LISTED], *["..."][: len(beside) - MAX_LISTED]])
        _logger.warning("vehicles next to the lanes of the map: %d: %s", len(beside), listed)
