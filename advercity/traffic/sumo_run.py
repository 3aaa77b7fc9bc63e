"""One run of SUMO: drive a demand tick by tick and record it.

Only this module and `sumo_observation` talk to libsumo.
"""

import math
from collections.abc import Container, Mapping, Sequence
from functools import partial
from pathlib import Path

import libsumo
import numpy as np
from advercity_dsl import Agent, DriverResponse, Spec, Vehicle
from numpy.typing import NDArray

from advercity.errors import RunError
from advercity.roads.lane_graph import LaneGraph
from advercity.traffic.demand import TrafficDemand, slow_trip
from advercity.traffic.route_file import (
    apply_driver_response,
    apply_style,
    compute_limits,
    find_driving,
)
from advercity.traffic.speed_profile import SpeedLimiter, SpeedProfile
from advercity.traffic.sumo_observation import ActorLog, SignalLog
from advercity.traffic.sumo_recording import SumoRecording

LATERAL_RESOLUTION_M = 0.8
STRIPE_WIDTH_M = 0.9
"""Width of the stripes in which people walk: the widest have a pram or a dog with them."""
# Bits of SUMO's speed mode. The default obeys everything. A commanded vehicle minds its leader, but
# neither lights nor right of way. A vehicle passing a cyclist in the other lane does not mind its
# leader either, since SUMO keeps both in one lane.
# A reacting ego brakes harder than SUMO's driver would; a colliding one minds no leader.
_SPEED_MODE_DEFAULT, _SPEED_MODE_COMMANDED, _SPEED_MODE_PASSING = 31, 39, 38
_SPEED_MODE_BRAKING, _SPEED_MODE_COLLIDING = 35, 34


def run_sumo(
    spec: Spec,
    demand: TrafficDemand,
    graph: LaneGraph,
    network: Path,
    routes: Path,
    speed_commands: Mapping[int, NDArray[np.float64]],
    *,
    ends_with_ego: bool = False,
) -> SumoRecording:
    """Run SUMO until a connected vehicle arrives or time is up.

    Args:
        spec: The scenario.
        demand: Its vehicles and pedestrians.
        graph: Lanes of the road.
        network: The same road as a SUMO network.
        routes: The demand as a SUMO route file.
        speed_commands: Speed at every tick of staged vehicles, and of a reacting ego; NaN leaves
            it to SUMO's driver, and the last value holds on.
        ends_with_ego: Whether other arriving vehicles drive on, until the ego arrives too.

    Raises:
        RunError: SUMO failed, or a vehicle could not start or arrive as declared.
    """
    log = routes.with_suffix(".log")
    try:
        libsumo.start(["sumo", *_build_options(spec, network, routes, log)])
        try:
            run = _SumoRun(
                spec, demand, graph, network, speed_commands, ends_with_ego=ends_with_ego
            )
            return run.run()
        finally:
            libsumo.close()
    except (libsumo.TraCIException, libsumo.FatalTraCIError) as error:
        reported = log.read_text(encoding="utf-8").strip() if log.exists() else ""
        raise RunError(f"SUMO: {reported or error}") from error


def _build_options(spec: Spec, network: Path, routes: Path, log: Path) -> list[str]:
    options = {
        "net-file": network,
        "route-files": routes,
        "error-log": log,
        "seed": spec.seeds.traffic % 2**31,
        "step-length": spec.timing.tick_s,
        "lateral-resolution": LATERAL_RESOLUTION_M,
        # A stuck vehicle must not jump elsewhere, nor vanish when it touches another.
        "time-to-teleport": -1,
        "collision.action": "warn",
        "pedestrian.striping.dawdling": 0,
        "pedestrian.striping.stripe-width": STRIPE_WIDTH_M,
        "no-step-log": "true",
        "no-warnings": "true",
    }
    return [word for name, value in options.items() for word in (f"--{name}", str(value))]


class _SumoRun:
    """Our state of one run; SUMO's own state is global to the process."""

    def __init__(
        self,
        spec: Spec,
        demand: TrafficDemand,
        graph: LaneGraph,
        network: Path,
        speed_commands: Mapping[int, NDArray[np.float64]],
        *,
        ends_with_ego: bool,
    ) -> None:
        self._spec = spec
        self._ends_with_ego = ends_with_ego
        self._demand = demand
        passing = {
            str(actor.number)
            for conflict in spec.conflicts
            if conflict.actors[0].behaviour == "overtakes"
            for actor in conflict.actors
        }
        collides = any(conflict.resolved_by == "nobody" for conflict in spec.conflicts)
        ego_mode = _SPEED_MODE_COLLIDING if collides else _SPEED_MODE_BRAKING
        self._speed_modes = dict.fromkeys(passing, _SPEED_MODE_PASSING)
        self._speed_modes[str(spec.ego.number)] = ego_mode
        self._speed_commands = {str(number): speeds for number, speeds in speed_commands.items()}
        self._connected = [
            (agent, agent.place) for agent in spec.agents if isinstance(agent.place, Vehicle)
        ]
        self._lengths_m = {trip.actor.id: trip.actor.size[0] for trip in demand.connected}
        max_m_s2 = spec.caution.usual_m_s2 if spec.caution else math.inf
        self._limiters = {
            name: SpeedLimiter(
                SpeedProfile.from_trip(trip, graph, max_m_s2),
                trip.top_speed_m_s,
                partial(_locate_vehicle, name),
            )
            for trip in demand.trips
            for name in (str(trip.actor.id),)
        }
        self._swaying = {str(trip.actor.id): trip for trip in demand.vehicles}
        self._graph = graph
        warm_up, tick_s = spec.timing.warm_up_ticks, spec.timing.tick_s
        self._responses = {
            warm_up + round(item.at_s / tick_s): item for item in spec.caution_changes
        }
        self._actors = ActorLog()
        self._signals = SignalLog(network)
        self._staged = [str(trip.actor.id) for trip in demand.staged]
        self._followers = set[str]()

    def run(self) -> SumoRecording:
        arrived: list[int] = []
        for tick in range(self._spec.timing.max_ticks + 1):
            self._apply_speed_commands(tick)
            if tick in self._responses:
                self._apply_driver_response(self._responses[tick])
            libsumo.simulationStep()
            vehicles = libsumo.vehicle.getIDList()
            if tick == 0:
                self._check_start(vehicles)
                self._ignore_junction_foes()
            arrived = [
                agent.number
                for agent, place in self._connected
                if self._has_arrived(agent, place, vehicles)
            ]
            if arrived:
                break
            speeds = self._actors.record_vehicles(tick, vehicles)
            self._actors.record_pedestrians(tick, libsumo.person.getIDList())
            self._signals.record()
            self._apply_speed_limits(vehicles, speeds)
            self._sway_speeds(vehicles, tick)
            self._ignore_followers(vehicles)
        return SumoRecording(
            tracks=self._actors.build_fronts(self._spec.timing.tick_s),
            signal_ids=self._signals.ids,
            signals=self._signals.build_states(),
            arrived=frozenset(arrived),
        )

    def _has_arrived(self, agent: Agent, place: Vehicle, present: Container[str]) -> bool:
        """Return whether a vehicle's centre is near its destination, or the vehicle is gone.

        All connected vehicles take part in every frame, so a vehicle off the site ends the
        scenario, too.
        """
        name = str(agent.number)
        if name not in present:
            if agent.is_ego:
                raise RunError(f"{agent.id} left the site without coming near its destination")
            return True
        if self._ends_with_ego and not agent.is_ego:
            return False
        front = libsumo.vehicle.getPosition3D(name)
        heading = math.radians(90 - libsumo.vehicle.getAngle(name))
        half_m, box_m = self._lengths_m[agent.number] / 2, self._spec.timing.destination_box_m
        # Keep this order: another one changes the last bit of the sum, and maybe the last tick.
        east_m = front[0] - place.destination_m[0] - half_m * math.cos(heading)
        north_m = front[1] - place.destination_m[1] - half_m * math.sin(heading)
        return abs(east_m) <= box_m and abs(north_m) <= box_m

    def _apply_speed_commands(self, tick: int) -> None:
        """Command scheduled speeds, red lights or not; NaN leaves vehicles to SUMO."""
        present = libsumo.vehicle.getIDList()
        for name, speeds in self._speed_commands.items():
            if name in present:
                speed = float(speeds[min(tick, len(speeds) - 1)])
                free = np.isnan(speed)
                mode = self._speed_modes.get(name, _SPEED_MODE_COMMANDED)
                libsumo.vehicle.setSpeedMode(name, _SPEED_MODE_DEFAULT if free else mode)
                libsumo.vehicle.setSpeed(name, -1 if free else speed)

    def _apply_driver_response(self, response: DriverResponse) -> None:
        """Apply a new response to the weather to all but staged vehicles, from now on."""
        present = set(libsumo.vehicle.getIDList())
        for trip in (*self._demand.connected, *self._demand.vehicles):
            name = str(trip.actor.id)
            slowed = slow_trip(trip, response, before=self._spec.caution)
            driving = find_driving(trip, is_connected=trip in self._demand.connected)
            driving = apply_style(apply_driver_response(driving, response), trip.style)
            limits = compute_limits(trip, driving)
            # SUMO gives each vehicle with a changed limit a type of its own.
            for domain in (libsumo.vehicletype, *([libsumo.vehicle] if name in present else [])):
                domain.setAccel(name, limits.acceleration_m_s2)
                domain.setDecel(name, limits.deceleration_m_s2)
                domain.setEmergencyDecel(name, limits.max_emergency_braking_m_s2)
                domain.setTau(name, limits.headway_s)
            if name in self._swaying:
                self._swaying[name] = slowed
            profile = SpeedProfile.from_trip(trip, self._graph, response.usual_m_s2)
            self._limiters[name].change(profile, slowed.top_speed_m_s)

    def _ignore_junction_foes(self) -> None:
        """Make connected and staged vehicles not give way to each other inside junctions."""
        connected = [str(trip.actor.id) for trip in self._demand.connected]
        for names, others in ((connected, self._staged), (self._staged, connected)):
            for name in names:
                libsumo.vehicle.setParameter(name, "junctionModel.ignoreIDs", " ".join(others))

    def _ignore_followers(self, vehicles: Container[str]) -> None:
        """Make the ego ignore vehicles behind a staged one, in front of which it turns."""
        behind: set[str] = set()
        for name in self._staged:
            if name in vehicles:
                # In the order of their positions, from the start of the lane on.
                lane = libsumo.lane.getLastStepVehicleIDs(libsumo.vehicle.getLaneID(name))
                behind.update(lane[: lane.index(name)] if name in lane else ())
        if not behind <= self._followers:
            self._followers |= behind
            names = " ".join((*self._staged, *sorted(self._followers)))
            ego = str(self._spec.ego.number)
            libsumo.vehicle.setParameter(ego, "junctionModel.ignoreIDs", names)

    def _check_start(self, vehicles: Container[str]) -> None:
        for trip in (*self._demand.connected, *self._demand.staged):
            if str(trip.actor.id) not in vehicles:
                raise RunError(
                    f"SUMO finds no room for vehicle {trip.actor.id} on lane"
                    f" {trip.edges[0]}_{trip.lane} at {trip.front_position_m:.1f} m"
                )

    def _sway_speeds(self, vehicles: Sequence[str], tick: int) -> None:
        """Vary each driver's desired speed a little over time."""
        for name in vehicles:
            trip = self._swaying.get(name)
            if trip is not None and trip.speed_factor is not None:
                sway = trip.style.sway_at(tick * self._spec.timing.tick_s)
                libsumo.vehicle.setSpeedFactor(name, trip.speed_factor * sway)

    def _apply_speed_limits(self, vehicles: Sequence[str], speeds: Sequence[float]) -> None:
        tick_s = self._spec.timing.tick_s
        for name, speed in zip(vehicles, speeds, strict=True):
            limit = self._limiters[name].update(speed * tick_s)
            if limit is not None:
                libsumo.vehicle.setMaxSpeed(name, limit)


def _locate_vehicle(name: str) -> tuple[str, float]:
    return libsumo.vehicle.getRoadID(name), libsumo.vehicle.getLanePosition(name)
