"""When a connected vehicle is where it wants to be, which ends a scenario.

Drive a demand in SUMO, tick by tick, and keep what everybody does.

This and `observation` are the only modules that talk to libsumo.
"""

import math
from collections.abc import Container, Mapping, Sequence
from pathlib import Path

import libsumo
import numpy as np
from advercity_dsl import Agent, Spec, Timing, Vehicle
from numpy.typing import NDArray

from advercity.errors import RunError
from advercity.roads.lane_graph import LaneGraph
from advercity.traffic import sumo_api
from advercity.traffic.demand import TrafficDemand, VehicleTrip
from advercity.traffic.kinematics import SumoRecording
from advercity.traffic.speed_profile import SpeedLimiter, SpeedProfile
from advercity.traffic.sumo_observation import ActorPresence, PedestrianLog, SignalLog, VehicleLog

MAX_APPROACH_SPEED_M_S = 50.0


class DestinationMonitor:
    """Where a connected vehicle goes, and whether it is there.

    While it is far from there it is not asked where it is.
    """

    def __init__(self, ride: VehicleTrip, agent: Agent, place: Vehicle, timing: Timing) -> None:
        """Of the ride of an agent in a place."""
        self._vehicle = str(ride.actor.id)
        self._agent = agent.id
        self._place = place
        self._timing = timing
        self._half_m = ride.actor.size[0] / 2
        self._far_for = 0

    def has_ended(self, present: Container[str]) -> bool:
        """Whether its vehicle has arrived, or is not among those there, at the next tick.

        All connected vehicles are there in every frame, so one that has left the site ends the
        scenario, too.

        Raises:
            RunError: The ego has left.
        """
        if self._vehicle not in present:
            if self._place.is_ego:
                raise RunError(f"{self._agent} left the site without coming near its destination")
            return True
        self._far_for -= 1
        return self._far_for < 0 and self._is_at_destination()

    def _is_at_destination(self) -> bool:
        box_m, goal = self._timing.destination_box_m, self._place.destination_m
        east, north, _ = sumo_api.vehicle_position(self._vehicle)
        east, north = east - goal[0], north - goal[1]
        apart_m = max(abs(east), abs(north)) - box_m - self._half_m
        self._far_for = int(apart_m / (MAX_APPROACH_SPEED_M_S * self._timing.tick_s))
        heading = math.radians(90 - sumo_api.vehicle_angle(self._vehicle))
        back = self._half_m * math.cos(heading), self._half_m * math.sin(heading)
        return abs(east - back[0]) <= box_m and abs(north - back[1]) <= box_m


def build_destination_monitors(spec: Spec, demand: TrafficDemand) -> tuple[DestinationMonitor, ...]:
    """Those of a scenario's connected vehicles."""
    rides = {ride.actor.id: ride for ride in demand.connected}
    return tuple(
        DestinationMonitor(rides[agent.number], agent, agent.place, spec.timing)
        for agent in spec.agents
        if isinstance(agent.place, Vehicle)
    )


LATERAL_RESOLUTION_M = 0.8
_SPEED_MODE_DEFAULT, _SPEED_MODE_COMMANDED, _SPEED_MODE_UNCHECKED = 31, 39, 38
"""Speed modes: obey everything; mind whom one follows, but neither lights nor right of way; not
even whom one follows, since one passes beside the lane."""


def run_sumo(
    spec: Spec,
    demand: TrafficDemand,
    graph: LaneGraph,
    network: Path,
    routes: Path,
    speed_commands: Mapping[int, NDArray[np.float64]],
) -> SumoRecording:
    """What happens when the demand, written in the file `routes`, sets out.

    Args:
        spec: The scenario.
        demand: Who takes part.
        graph: Lanes of the road.
        network: The same as a SUMO network.
        routes: The demand as a SUMO route file.
        speed_commands: Speed of staged vehicles in every tick; NaN leaves it to the driver, and
            the last one stays.
    """
    log = routes.with_suffix(".log")
    try:
        libsumo.start(["sumo", *_build_options(spec, network, routes, log)])
        try:
            return _SumoRun(spec, demand, graph, network, speed_commands).run()
        finally:
            libsumo.close()
    except (libsumo.TraCIException, libsumo.FatalTraCIError) as error:
        said = log.read_text(encoding="utf-8").strip() if log.exists() else ""
        raise RunError(f"SUMO: {said or error}") from error


def _build_options(spec: Spec, network: Path, routes: Path, log: Path) -> list[str]:
    options = {
        "net-file": network,
        "route-files": routes,
        "error-log": log,
        "seed": spec.seeds.traffic % 2**31,
        "step-length": spec.timing.tick_s,
        "lateral-resolution": LATERAL_RESOLUTION_M,
        "time-to-teleport": -1,
        "collision.action": "warn",
        "pedestrian.striping.dawdling": 0,
        "no-step-log": "true",
        "no-warnings": "true",
    }
    return [word for name, value in options.items() for word in (f"--{name}", str(value))]


class _SumoRun:
    """One run: SUMO's state is global, ours is what has been recorded of it."""

    def __init__(
        self,
        spec: Spec,
        demand: TrafficDemand,
        graph: LaneGraph,
        network: Path,
        cues: Mapping[int, NDArray[np.float64]],
    ) -> None:
        self._spec = spec
        self._demand = demand
        self._passing = {
            str(actor.number)
            for conflict in spec.conflicts
            if conflict.actors[0].behaviour == "overtakes"
            for actor in conflict.actors
        }
        self._cues = {str(number): speeds for number, speeds in cues.items()}
        most_m_s2 = spec.caution.usual_m_s2 if spec.caution else math.inf
        self._goals = build_destination_monitors(spec, demand)
        self._names = [str(ride.actor.id) for ride in demand.trips]
        self._pacing = SpeedLimiter(
            [SpeedProfile.from_trip(ride, graph, most_m_s2) for ride in demand.trips],
            [ride.top_speed_m_s for ride in demand.trips],
        )
        self._there = ActorPresence(sumo_api.departed_vehicle_ids, sumo_api.arrived_vehicle_ids)
        self._on_foot = ActorPresence(sumo_api.departed_person_ids, sumo_api.arrived_person_ids)
        self._vehicles = VehicleLog(self._there, (str(ride.actor.id) for ride in demand.staged))
        self._people = PedestrianLog(self._on_foot)
        self._signals = SignalLog(network)

    def run(self) -> SumoRecording:
        """Drive until somebody arrives or time is up."""
        for tick in range(self._spec.timing.max_ticks + 1):
            self._apply_speed_commands(tick)
            libsumo.simulationStep()
            if self._there.update():
                self._pacing.set_present([self._names.index(name) for name in self._there.ids])
            self._on_foot.update()
            if tick == 0:
                self._check_start()
                self._ignore_junction_foes()
            if any(goal.has_ended(self._there.id_set) for goal in self._goals):
                break
            speeds = self._vehicles.record()
            self._people.record()
            self._signals.record()
            self._apply_speed_limits(speeds)
        return self._build_recording()

    def _apply_speed_commands(self, tick: int) -> None:
        """Have staged vehicles drive as planned, red lights or not; NaN leaves them to SUMO."""
        for name in (name for name in self._cues if name in self._there.id_set):
            speed = float(self._cues[name][min(tick, len(self._cues[name]) - 1)])
            free = np.isnan(speed)
            told = _SPEED_MODE_UNCHECKED if name in self._passing else _SPEED_MODE_COMMANDED
            libsumo.vehicle.setSpeedMode(name, _SPEED_MODE_DEFAULT if free else told)
            libsumo.vehicle.setSpeed(name, -1 if free else speed)

    def _ignore_junction_foes(self) -> None:
        """Connected and staged vehicles do not give way to each other inside junctions."""
        connected = [str(ride.actor.id) for ride in self._demand.connected]
        staged = [str(ride.actor.id) for ride in self._demand.staged]
        for names, others in ((connected, staged), (staged, connected)):
            for name in names:
                libsumo.vehicle.setParameter(name, "junctionModel.ignoreIDs", " ".join(others))

    def _check_start(self) -> None:
        for ride in (*self._demand.connected, *self._demand.staged):
            if str(ride.actor.id) not in self._there.id_set:
                raise RunError(
                    f"SUMO finds no room for vehicle {ride.actor.id} on lane"
                    f" {ride.edges[0]}_{ride.lane} at {ride.front_position_m:.1f} m"
                )

    def _apply_speed_limits(self, speeds: Sequence[float]) -> None:
        """Tell those for whom it has changed how fast they may go where they are."""
        moved_m = np.array(speeds) * self._spec.timing.tick_s
        for ride, top_m_s in self._pacing.update_limits(moved_m, self._locate):
            sumo_api.set_vehicle_max_speed(self._names[ride], top_m_s)

    def _locate(self, ride: int) -> tuple[str, float]:
        name = self._names[ride]
        return sumo_api.vehicle_edge(name), sumo_api.vehicle_lane_position(name)

    def _build_recording(self) -> SumoRecording:
        return SumoRecording(
            tracks=self._vehicles.build_fronts(self._spec.timing.tick_s)
            | self._people.build_fronts(),
            signal_ids=self._signals.ids,
            signals=self._signals.build_states(),
        )
