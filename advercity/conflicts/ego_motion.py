"""Predict the ego's drive: its route and its speed with lights and bends, without traffic.

Specs are solved on this prediction; at run time SUMO drives the ego, limited by `speed_profile`.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from advercity_dsl import Road, StagedConflict, Vehicle
from advercity_dsl.road import Signals
from advercity_dsl.traffic import ActorClass
from advercity_dsl.units import KM_H_PER_M_S
from numpy.typing import NDArray

from advercity.geometry.polyline import StationedPolyline
from advercity.roads.bend_speed import BEND_STEP_M, compute_bend_speeds
from advercity.roads.routes import RoutePath, RoutePlanner, RouteSegment, build_ego_path

NOMINAL_BRAKING_M_S2 = 2.0
CRUISE_MARGIN_KM_H = 1.0
"""Connected vehicles cruise this much below their maximum speed, as in the original."""
NOMINAL_STEP_M = 0.5
GREEN_DELAY_S = 0.5
"""Time from green to setting out."""


CONNECTED_ACCELERATION_M_S2: Mapping[ActorClass, float] = {"car": 2.5, "van": 2.0, "truck": 1.2}
"""Acceleration of connected vehicles by class of their body; a car's is the original's."""


@dataclass(frozen=True, eq=False)
class NominalMotion:
    """Time of the ego at each station of its path.

    Attributes:
        stations_m: (n,) along its path.
        times_s: (n,) since the scenario's start.
    """

    stations_m: NDArray[np.float64]
    times_s: NDArray[np.float64]

    def time_at(self, station_m: float) -> float:
        """Interpolate the time at a station."""
        return float(np.interp(station_m, self.stations_m, self.times_s))

    def station_at(self, time_s: float) -> float:
        """Interpolate the station at a time."""
        return float(np.interp(time_s, self.times_s, self.stations_m))

    def find_top_speed_m_s(self, station_m: float) -> float:
        """Find the highest speed in the `TEST_CLOCK_S` before a station."""
        at_s = self.time_at(station_m)
        times_s = np.linspace(max(at_s - TEST_CLOCK_S, self.times_s[0]), at_s, 41)
        if at_s <= times_s[0]:
            return 0.0
        stations = np.interp(times_s, self.times_s, self.stations_m)
        return float((np.diff(stations) / np.diff(times_s)).max(initial=0.0))


TEST_CLOCK_S = 4.0
"""Time before the ego's arrival over which its speed counts, as in Euro NCAP's tests."""
SETTLING_S = 1.0
"""Time for which it keeps that speed, before those seconds and after its arrival."""


@dataclass(frozen=True)
class SpeedZone:
    """A part of the ego's drive with a conflict's speed limit; distances count from its spawn."""

    from_m: float
    to_m: float
    speed_m_s: float


def build_speed_zone(station_m: float, speed_m_s: float) -> SpeedZone:
    """Build the zone around a conflict point that limits the ego to the drawn speed."""
    settling_m = speed_m_s * SETTLING_S
    before_m = speed_m_s * TEST_CLOCK_S + settling_m
    return SpeedZone(station_m - before_m, station_m + settling_m, speed_m_s)


def list_speed_zones(conflicts: Iterable[StagedConflict]) -> tuple[SpeedZone, ...]:
    """List the zones of staged conflicts; specs of earlier versions have none."""
    return tuple(
        build_speed_zone(item.station_m, item.parameters["ego_speed_km_h"] / KM_H_PER_M_S)
        for item in conflicts
        if "ego_speed_km_h" in item.parameters
    )


def compute_nominal_motion(
    road: Road,
    planner: RoutePlanner,
    path: RoutePath,
    start_m: float,
    zones: Iterable[SpeedZone] = (),
    *,
    actor_class: ActorClass = "car",
) -> NominalMotion:
    """Compute the motion of an ego of a class from rest at `start_m` on its path."""
    ego, gain_m_s2 = road.ego, CONNECTED_ACCELERATION_M_S2[actor_class]
    stations = np.arange(start_m, path.length_m, NOMINAL_STEP_M)
    limit = _compute_speed_limit(ego, path.line, stations)
    for zone in zones:
        inside = (stations - start_m >= zone.from_m) & (stations - start_m <= zone.to_m)
        limit[inside] = np.minimum(limit[inside], zone.speed_m_s)
    times = ego.waits_s + _integrate_times(stations, _compute_speeds(limit, gain_m_s2))
    for before, after in pairwise(path.segments):
        at = int(np.searchsorted(stations, before.end_m))
        green = planner.find_next_green_s(before.street.id, after.street.id, float(times[at]))
        if green is not None and green > times[at] + GREEN_DELAY_S:
            times = ego.waits_s + _integrate_times(stations, _compute_speeds(limit, gain_m_s2, at))
            times[at:] += max(green + GREEN_DELAY_S - times[at], 0.0)
    return NominalMotion(stations, times)


def compute_free_drive_s(
    ego: Vehicle,
    path: StationedPolyline,
    begin_m: float,
    end_m: float,
    *,
    actor_class: ActorClass,
    first_m_s: float,
    top_m_s: float,
) -> float:
    """Compute the time of the ego between two stations of a path without hindrance.

    It starts at `first_m_s` and drives no faster than `top_m_s`.
    """
    stations = np.arange(begin_m, end_m + NOMINAL_STEP_M, NOMINAL_STEP_M)
    limit = np.minimum(_compute_speed_limit(ego, path, stations), top_m_s)
    gain_m_s2 = CONNECTED_ACCELERATION_M_S2[actor_class]
    speeds = _compute_speeds(limit, gain_m_s2, first_m_s=first_m_s)
    return float(np.interp(end_m, stations, _integrate_times(stations, speeds)))


def _compute_speed_limit(
    ego: Vehicle, path: StationedPolyline, stations_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Compute the maximum speeds (n,) of the ego at stations (n,) of its path."""
    samples = np.arange(0.0, path.length_m + BEND_STEP_M, BEND_STEP_M)
    bends = np.interp(stations_m, samples, compute_bend_speeds(path.points_at(samples)))
    return np.minimum((ego.max_speed_km_h - CRUISE_MARGIN_KM_H) / KM_H_PER_M_S, bends)


def _compute_speeds(
    limit: NDArray[np.float64], gain_m_s2: float, *halts: int, first_m_s: float = 0.0
) -> NDArray[np.float64]:
    """Compute speeds (n,) below a limit (n,), from a first one, with halts at some samples."""
    limit = limit.copy()
    limit[[0, *halts]] = first_m_s, *(0.0 for _ in halts)
    square = limit**2  # changes evenly with distance under constant acceleration
    gain, loss = (
        2 * limit_m_s2 * NOMINAL_STEP_M for limit_m_s2 in (gain_m_s2, NOMINAL_BRAKING_M_S2)
    )
    for index in range(1, len(square)):
        square[index] = min(square[index], square[index - 1] + gain)
    for index in range(len(square) - 2, -1, -1):
        square[index] = min(square[index], square[index + 1] + loss)
    return np.sqrt(square)


def _integrate_times(
    stations: NDArray[np.float64], speeds: NDArray[np.float64]
) -> NDArray[np.float64]:
    mean = np.maximum((speeds[1:] + speeds[:-1]) / 2, 0.1)  # never 0: a halt takes no time here
    return np.concatenate([[0.0], np.cumsum(np.diff(stations) / mean)])


DESTINATION_MARGIN_M = 10.0
"""Minimum distance of a meeting from the destination."""
CROSSING_OFFSET_M = 2.1
"""Distance from the centre of a crossing to the end of its street, inside the junction."""


@dataclass(frozen=True, eq=False)
class EgoDrive:
    """The ego's path through a road and its predicted motion.

    Attributes:
        road: Road on which the ego makes the conflict's manoeuvre.
        planner: Route planner of that road.
        route: Streets of the ego.
        path: Path of the ego.
        start_m: Station of its spawn on its path.
        end_m: Last station for a meeting.
        motion: Its motion from the scenario's start.
        zones: Where conflicts limit its speed.
        actor_class: Class of the ego's body.
    """

    road: Road
    planner: RoutePlanner
    route: tuple[str, ...]
    path: RoutePath
    start_m: float
    end_m: float
    motion: NominalMotion
    zones: tuple[SpeedZone, ...] = ()
    actor_class: ActorClass = "car"

    @property
    def intersection(self) -> tuple[str, RouteSegment, RouteSegment] | None:
        """The first junction of three streets or more, and the streets before and after it."""
        index = self.planner.find_intersection(self.road.ego)
        if index is None:
            return None
        before, after = self.path.segments[index : index + 2]
        junction = self.planner.find_junction(before.street.id, after.street.id)
        return None if junction is None else (junction, before, after)

    def limit_speed(self, station_m: float, speed_m_s: float) -> "EgoDrive":
        """Return the drive with a speed limit before a conflict point at a station."""
        return self.with_zones(*self.zones, build_speed_zone(station_m - self.start_m, speed_m_s))

    def with_zones(self, *zones: SpeedZone) -> "EgoDrive":
        """Return the drive with other speed limits of conflicts."""
        return replace(self, zones=zones)._on_road(self.road)

    def with_lights(self, junction: str, lights: Signals | None) -> "EgoDrive":
        """Return the drive through a junction with another signal program, or without one."""
        declared = self.road.junctions[junction].model_copy(update={"signals": lights})
        junctions = {**self.road.junctions, junction: declared}
        road = self.road.model_copy(update={"junctions": junctions})
        return self._on_road(road)

    def with_waits(self, waits_s: float) -> "EgoDrive":
        """Return the drive of an ego that waits at its start for another time."""
        agents = {
            name: place.model_copy(update={"waits_s": waits_s}) if place is self.road.ego else place
            for name, place in self.road.agents.items()
        }
        return self._on_road(self.road.model_copy(update={"agents": agents}))

    def _on_road(self, road: Road) -> "EgoDrive":
        planner = self.planner if road is self.road else RoutePlanner(road)
        motion = compute_nominal_motion(
            *(road, planner, self.path, self.start_m, self.zones), actor_class=self.actor_class
        )
        return replace(self, road=road, planner=planner, motion=motion)

    def segment_at(self, station_m: float) -> RouteSegment:
        """Find the street at a station; a crossing inside the junction belongs to the next one."""
        return next(
            item
            for item in reversed(self.path.segments)
            if item.start_m - CROSSING_OFFSET_M - 0.1 <= station_m
        )


def build_ego_drive(road: Road, actor_class: ActorClass = "car") -> EgoDrive:
    """Predict the drive of a road's ego, with a body of a class."""
    planner, ego = RoutePlanner(road), road.ego
    path, start_m, destination_m = build_ego_path(planner, ego)
    motion = compute_nominal_motion(road, planner, path, start_m, actor_class=actor_class)
    end_m = destination_m - DESTINATION_MARGIN_M
    return EgoDrive(
        *(road, planner, ego.route, path, start_m, end_m, motion), actor_class=actor_class
    )
