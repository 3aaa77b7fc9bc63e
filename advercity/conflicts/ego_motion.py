"""How an ego that nobody holds up drives its way: lights and bends, but no traffic.

How the ego drives where nobody holds it up.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from advercity_dsl import Road
from advercity_dsl.road import Signals
from advercity_dsl.units import KM_H_PER_M_S
from numpy.typing import NDArray

from advercity.roads.routes import RoutePath, RoutePlanner, RouteSegment, build_ego_path

NOMINAL_ACCELERATION_M_S2, NOMINAL_BRAKING_M_S2 = 2.5, 2.0
NOMINAL_LATERAL_M_S2 = 3.5
CRUISE_MARGIN_KM_H = 1.0
NOMINAL_STEP_M = 0.5
GREEN_DELAY_S = 0.5
"""From green to setting out."""


@dataclass(frozen=True, eq=False)
class NominalMotion:
    """When the ego is where.

    Attributes:
        stations_m: (n,) along its way.
        times_s: (n,) since the scenario's start.
        speeds_m_s: (n,).
    """

    stations_m: NDArray[np.float64]
    times_s: NDArray[np.float64]
    speeds_m_s: NDArray[np.float64]

    def time_at(self, station_m: float) -> float:
        """When it is at a station."""
        return float(np.interp(station_m, self.stations_m, self.times_s))

    def station_at(self, time_s: float) -> float:
        """Where it is at a time."""
        return float(np.interp(time_s, self.times_s, self.stations_m))

    def speed_at(self, station_m: float) -> float:
        """How fast it is there."""
        return float(np.interp(station_m, self.stations_m, self.speeds_m_s))


def compute_nominal_motion(
    road: Road, ways: RoutePlanner, way: RoutePath, start_m: float
) -> NominalMotion:
    """The pace of the ego from rest at `start_m` on its way."""
    ego = road.ego
    top = (ego.max_speed_km_h - CRUISE_MARGIN_KM_H) / KM_H_PER_M_S
    stations = np.arange(start_m, way.length_m, NOMINAL_STEP_M)
    headings = np.unwrap(way.headings_at(stations))
    bends = np.abs(np.gradient(headings, NOMINAL_STEP_M))
    bends = np.convolve(np.pad(bends, 6, mode="edge"), np.full(13, 1 / 13), mode="valid")
    limit = np.minimum(top, np.sqrt(NOMINAL_LATERAL_M_S2 / np.maximum(bends, 1e-6)))
    halts = [
        (item.end_m, signals, item.street.id)
        for item, then in pairwise(way.segments)
        if (junction := ways.find_junction(item.street.id, then.street.id))
        and (signals := road.junctions[junction].signals) is not None
    ]
    speeds = _compute_speeds(limit, ())
    times = _integrate_times(stations, speeds)
    for line, signals, street in halts:
        at = int(np.searchsorted(stations, line))
        green = _compute_next_green_s(signals, street, float(times[at]))
        if green > times[at] + GREEN_DELAY_S:
            speeds = _compute_speeds(limit, (at,))
            times = _integrate_times(stations, speeds)
            times[at:] += max(green + GREEN_DELAY_S - times[at], 0.0)
    return NominalMotion(stations, times, speeds)


def _compute_speeds(limit: NDArray[np.float64], halts: tuple[int, ...]) -> NDArray[np.float64]:
    held = limit.copy()
    held[0] = 0.0
    for at in halts:
        held[at] = 0.0
    square = held**2
    for index in range(1, len(square)):
        square[index] = min(
            square[index], square[index - 1] + 2 * NOMINAL_ACCELERATION_M_S2 * NOMINAL_STEP_M
        )
    for index in range(len(square) - 2, -1, -1):
        square[index] = min(
            square[index], square[index + 1] + 2 * NOMINAL_BRAKING_M_S2 * NOMINAL_STEP_M
        )
    return np.sqrt(square)


def _integrate_times(
    stations: NDArray[np.float64], speeds: NDArray[np.float64]
) -> NDArray[np.float64]:
    mean = np.maximum((speeds[1:] + speeds[:-1]) / 2, 0.1)
    return np.concatenate([[0.0], np.cumsum(np.diff(stations) / mean)])


def _compute_next_green_s(signals: Signals, street: str, from_s: float) -> float:
    """The first time from `from_s` on at which an approach has green; that time if it has it."""
    slot = signals.green_s + signals.yellow_s + signals.all_red_s
    period = slot * len(signals.cycle)
    if street not in signals.cycle:
        return from_s
    begins = signals.cycle.index(street) * slot - signals.elapsed_s
    while begins + signals.green_s <= from_s:
        begins += period
    return max(begins, from_s)


DESTINATION_MARGIN_M = 10.0
"""The ego is crossed no later than this before the scenario may end."""
CROSSING_OFFSET_M = 2.1
"""From the middle of a crossing to the end of its street, inside the junction."""


@dataclass(frozen=True, eq=False)
class EgoDrive:
    """The ego's way through a road and when it is where.

    Attributes:
        road: Where the ego makes the conflict's manoeuvre.
        planner: Through that road.
        route: Streets of the ego.
        path: Of the ego.
        start_m: Station of its spawn on its way.
        end_m: Station beyond which it meets nobody.
        motion: Since the scenario's start.
    """

    road: Road
    planner: RoutePlanner
    route: tuple[str, ...]
    path: RoutePath
    start_m: float
    end_m: float
    motion: NominalMotion

    def segment_at(self, station_m: float) -> RouteSegment:
        """The street at a station; a crossing at the junction's edge belongs to the next one."""
        return next(
            item
            for item in reversed(self.path.segments)
            if item.start_m - CROSSING_OFFSET_M - 0.1 <= station_m
        )

    def station_at_fraction(self, fraction: float) -> float:
        """The station at a share of what it drives, from start to end."""
        return self.start_m + fraction * (self.end_m - self.start_m)


def build_ego_drive(road: Road) -> EgoDrive:
    """The drive of a road's ego."""
    ways, ego = RoutePlanner(road), road.ego
    way, start_m, destination_m = build_ego_path(ways, ego)
    pace = compute_nominal_motion(road, ways, way, start_m)
    end_m = destination_m - DESTINATION_MARGIN_M
    return EgoDrive(road, ways, ego.route, way, start_m, end_m, pace)
