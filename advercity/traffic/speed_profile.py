"""Limit a vehicle's speed along its route: slower in bends, and braking in time before them.

SUMO's drivers know speed limits but no bends, so `SpeedLimiter` lowers a vehicle's maximum speed
tick by tick.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from math import inf, nan

import numpy as np
from numpy.typing import NDArray

from advercity.roads.bend_speed import BEND_STEP_M, MAX_BEND_SPEED_M_S, compute_bend_speeds
from advercity.roads.lane_graph import LaneGraph
from advercity.roads.network_file import SumoLane
from advercity.traffic.demand import VehicleTrip

BRAKING_M_S2 = 2.0
"""Deceleration towards a bend."""


@dataclass(frozen=True, eq=False)
class SpeedProfile:
    """Maximum speed along a route.

    Attributes:
        edge_starts_m: Station along the route of every edge, internal ones included.
        edge_lengths_m: Length of the shortest lane of each edge.
        speeds_m_s: Maximum speed every `BEND_STEP_M` from the start of the first edge.
    """

    edge_starts_m: dict[str, float]
    edge_lengths_m: dict[str, float]
    speeds_m_s: list[float]

    @staticmethod
    def from_trip(trip: VehicleTrip, graph: LaneGraph, max_m_s2: float = inf) -> "SpeedProfile":
        """Build the profile of a trip's route; `max_m_s2` caps lateral acceleration and braking."""
        profile = _build_profile(trip.edges, trip.lane, graph, max_m_s2)
        limit = np.array(profile.speeds_m_s)
        stations = np.arange(len(limit)) * BEND_STEP_M - (trip.front_position_m or 0.0)
        for zone in trip.speed_zones:
            inside = (stations >= zone.from_m) & (stations <= zone.to_m)
            limit[inside] = np.minimum(limit[inside], zone.speed_m_s)
        braked = _limit_by_braking(limit, min(BRAKING_M_S2, max_m_s2))
        return replace(profile, speeds_m_s=braked.tolist()) if trip.speed_zones else profile

    def speed_at(self, station_m: float) -> float:
        """Interpolate the maximum speed at a station along the route."""
        sample = station_m / BEND_STEP_M
        # Just below the last sample, to have a next one for interpolation.
        last = len(self.speeds_m_s) - 1.001
        if sample > last:
            sample = last
        index = int(sample)
        low, high = self.speeds_m_s[index], self.speeds_m_s[index + 1]
        return low + (sample - index) * (high - low)


# Many vehicles share a route, and dry runs differ in few vehicles. The graph is hashed by identity.
@lru_cache(maxsize=1024)
def _build_profile(
    edges: tuple[str, ...], lane: int, graph: LaneGraph, max_m_s2: float
) -> SpeedProfile:
    lanes = list(_iterate_route_lanes(edges, graph.lanes[f"{edges[0]}_{lane}"], graph))
    begins = np.cumsum([0.0, *(lane.length_m for lane in lanes)])
    stations = np.concatenate(
        [lane.line.stations_m + begin for lane, begin in zip(lanes, begins, strict=False)]
    )
    points = np.concatenate([lane.shape[:, :2] for lane in lanes])
    samples = np.arange(0.0, begins[-1] + BEND_STEP_M, BEND_STEP_M)
    path = np.column_stack([np.interp(samples, stations, axis) for axis in points.T])
    limit = compute_bend_speeds(path, max_m_s2)
    return SpeedProfile(
        edge_starts_m={lane.edge: float(at) for lane, at in zip(lanes, begins, strict=False)},
        edge_lengths_m={lane.edge: graph.shortest_lane_m[lane.edge] for lane in lanes},
        speeds_m_s=_limit_by_braking(limit, min(BRAKING_M_S2, max_m_s2)).tolist(),
    )


def list_route_lanes(trip: VehicleTrip, graph: LaneGraph) -> list[SumoLane]:
    """List the lanes of a trip's route, internal ones included."""
    first = graph.lanes[f"{trip.edges[0]}_{trip.lane}"]
    return list(_iterate_route_lanes(trip.edges, first, graph))


def _iterate_route_lanes(
    edges: Iterable[str], lane: SumoLane, graph: LaneGraph
) -> Iterator[SumoLane]:
    yield lane
    for edge in tuple(edges)[1:]:
        connection = graph.find_connection(lane, edge)
        yield from graph.iterate_internal_lanes(connection)
        lane = graph.lanes[connection.target]
        yield lane


def _limit_by_braking(limit: NDArray[np.float64], braking_m_s2: float) -> NDArray[np.float64]:
    """Compute the highest speeds (n,) from which braking meets every lower limit ahead."""
    stations = np.arange(len(limit)) * BEND_STEP_M
    energy = limit**2 + 2 * braking_m_s2 * stations
    lowest_ahead = np.minimum.accumulate(energy[::-1])[::-1]
    return np.sqrt(lowest_ahead - 2 * braking_m_s2 * stations)


LocateVehicle = Callable[[], tuple[str, float]]
"""Returns a vehicle's edge and its position on it in metres."""


class SpeedLimiter:
    """Keeps one vehicle's maximum speed to the profile of its route.

    SUMO moves a vehicle by exactly speed times tick, so it is located only if it may have left its
    edge.
    """

    def __init__(self, profile: SpeedProfile, max_speed_m_s: float, locate: LocateVehicle) -> None:
        """Limit a vehicle to a profile and to a maximum speed."""
        self._profile = profile
        self._max_speed_m_s = max_speed_m_s
        self._locate = locate
        self._position_m = 0.0
        self._edge_length_m = -inf  # on no edge yet: the first update locates the vehicle
        self._edge_start_m: float | None = None
        self._commanded_m_s = nan

    def change(self, profile: SpeedProfile, max_speed_m_s: float) -> None:
        """Limit the vehicle to another profile of its route and another highest speed."""
        self._profile, self._max_speed_m_s = profile, max_speed_m_s

    def update(self, moved_m: float) -> float | None:
        """Move the vehicle on and return its new maximum speed; None if unchanged."""
        self._position_m += moved_m
        if self._position_m >= self._edge_length_m:
            edge, self._position_m = self._locate()
            self._edge_start_m = self._profile.edge_starts_m.get(edge)
            self._edge_length_m = self._profile.edge_lengths_m.get(edge, -inf)
        limit = MAX_BEND_SPEED_M_S  # SUMO may leave the route's edges inside junctions
        if self._edge_start_m is not None:
            limit = self._profile.speed_at(self._edge_start_m + self._position_m)
        limit = min(self._max_speed_m_s, limit)
        if limit == self._commanded_m_s:
            return None
        self._commanded_m_s = limit
        return limit
