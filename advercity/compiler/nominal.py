"""How an ego that nobody holds up drives its way: lights and bends, but no traffic."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from advercity_dsl import Road
from advercity_dsl.road import Signals
from numpy.typing import NDArray

from advercity.compiler.ways import RoadWays, Way, ego_of

GAINS_M_S2, LOSES_M_S2 = 2.5, 2.0
LATERAL_M_S2 = 3.5
BELOW_MAX_KM_H = 1.0
STEP_M = 0.5
SETTLES_S = 0.5
"""From green to setting out."""


@dataclass(frozen=True, eq=False)
class Pace:
    """When the ego is where.

    Attributes:
        stations_m: (n,) along its way.
        times_s: (n,) since the scenario's start.
        speeds_m_s: (n,).
    """

    stations_m: NDArray[np.float64]
    times_s: NDArray[np.float64]
    speeds_m_s: NDArray[np.float64]

    def time(self, station_m: float) -> float:
        """When it is at a station."""
        return float(np.interp(station_m, self.stations_m, self.times_s))

    def station(self, time_s: float) -> float:
        """Where it is at a time."""
        return float(np.interp(time_s, self.times_s, self.stations_m))

    def speed(self, station_m: float) -> float:
        """How fast it is there."""
        return float(np.interp(station_m, self.stations_m, self.speeds_m_s))


def nominal(road: Road, ways: RoadWays, way: Way, start_m: float) -> Pace:
    """The pace of the ego from rest at `start_m` on its way."""
    ego = ego_of(road)
    top = (ego.max_speed_km_h - BELOW_MAX_KM_H) / 3.6
    stations = np.arange(start_m, way.length_m, STEP_M)
    headings = np.unwrap(way.headings(stations))
    bends = np.abs(np.gradient(headings, STEP_M))
    bends = np.convolve(np.pad(bends, 6, mode="edge"), np.full(13, 1 / 13), mode="valid")
    limit = np.minimum(top, np.sqrt(LATERAL_M_S2 / np.maximum(bends, 1e-6)))
    halts = [
        (item.ends_m, signals, item.street.id)
        for item, then in pairwise(way.stretches)
        if (junction := ways.junction_between(item.street.id, then.street.id))
        and (signals := road.junctions[junction].signals) is not None
    ]
    speeds = _speeds(limit, ())
    times = _times(stations, speeds)
    for line, signals, street in halts:
        at = int(np.searchsorted(stations, line))
        green = _green(signals, street, float(times[at]))
        if green > times[at] + SETTLES_S:
            speeds = _speeds(limit, (at,))
            times = _times(stations, speeds)
            times[at:] += max(green + SETTLES_S - times[at], 0.0)
    return Pace(stations, times, speeds)


def _speeds(limit: NDArray[np.float64], halts: tuple[int, ...]) -> NDArray[np.float64]:
    held = limit.copy()
    held[0] = 0.0
    for at in halts:
        held[at] = 0.0
    square = held**2
    for index in range(1, len(square)):
        square[index] = min(square[index], square[index - 1] + 2 * GAINS_M_S2 * STEP_M)
    for index in range(len(square) - 2, -1, -1):
        square[index] = min(square[index], square[index + 1] + 2 * LOSES_M_S2 * STEP_M)
    return np.sqrt(square)


def _times(stations: NDArray[np.float64], speeds: NDArray[np.float64]) -> NDArray[np.float64]:
    mean = np.maximum((speeds[1:] + speeds[:-1]) / 2, 0.1)
    return np.concatenate([[0.0], np.cumsum(np.diff(stations) / mean)])


def _green(signals: Signals, street: str, from_s: float) -> float:
    """The first time from `from_s` on at which an approach has green; that time if it has it."""
    slot = signals.green_s + signals.yellow_s + signals.all_red_s
    period = slot * len(signals.cycle)
    if street not in signals.cycle:
        return from_s
    begins = signals.cycle.index(street) * slot - signals.elapsed_s
    while begins + signals.green_s <= from_s:
        begins += period
    return max(begins, from_s)
