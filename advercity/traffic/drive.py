"""Drive a demand in SUMO, tick by tick, and keep what everybody does.

The only module that talks to libsumo.
"""

from collections.abc import Callable, Iterable, Iterator
from functools import reduce
from operator import or_
from pathlib import Path

import libsumo
import numpy as np
import shapely
from advercity_dsl import Road, RoadsideUnit, Spec
from advercity_dsl.base import Point2
from numpy.typing import NDArray

from advercity.errors import RunError
from advercity.traffic.bends import Pace
from advercity.traffic.bumpers import FRONT, vehicle_states, walker_states
from advercity.traffic.demand import Demand
from advercity.traffic.lanes import LaneGraph
from advercity.traffic.trace import Actor, Lamp, Signal, Trace
from advercity.world.network import signal_groups
from advercity.world.roads import built
from advercity.world.surface import KERB_HEIGHT_M

LATERAL_RESOLUTION_M = 0.8
_RIGHT_BLINKER, _LEFT_BLINKER = 1, 2


def drive(spec: Spec, demand: Demand, graph: LaneGraph, network: Path, routes: Path) -> Trace:
    """The trace of a spec whose demand is written in the file `routes`."""
    log = routes.with_suffix(".log")
    try:
        libsumo.start(["sumo", *_options(spec, network, routes, log)])
        try:
            return _Drive(spec, demand, graph, network).run()
        finally:
            libsumo.close()
    except (libsumo.TraCIException, libsumo.FatalTraCIError) as error:
        said = log.read_text(encoding="utf-8").strip() if log.exists() else ""
        raise RunError(f"SUMO: {said or error}") from error


def _options(spec: Spec, network: Path, routes: Path, log: Path) -> list[str]:
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


class _Drive:
    """One run: SUMO's state is global, ours is what has been recorded of it."""

    def __init__(self, spec: Spec, demand: Demand, graph: LaneGraph, network: Path) -> None:
        self._spec = spec
        self._demand = demand
        self._rides = {str(ride.actor.id): ride for ride in (*demand.connected, *demand.vehicles)}
        self._paces = {name: Pace.of(ride, graph) for name, ride in self._rides.items()}
        self._signals = signal_groups(network)
        self._fronts: list[tuple[float, ...]] = []
        self._lights: list[list[Signal]] = []

    def run(self) -> Trace:
        """Drive until somebody arrives or time is up."""
        for tick in range(self._spec.timing.max_ticks + 1):
            libsumo.simulationStep()
            if tick == 0:
                self._check_start()
            if self._has_arrived():
                break
            self._fronts.extend((*self._vehicles(tick), *self._people(tick)))
            self._lights.append([_shown(links) for links in self._signals.values()])
            self._mind_bends()
        return self._trace()

    def _check_start(self) -> None:
        there = libsumo.vehicle.getIDList()
        for ride in self._demand.connected:
            if str(ride.actor.id) not in there:
                raise RunError(
                    f"SUMO finds no room for connected vehicle {ride.actor.id} on lane"
                    f" {ride.edges[0]}_{ride.lane} at {ride.front_m:.1f} m"
                )

    def _has_arrived(self) -> bool:
        """Whether a connected vehicle is at its destination; the first one ends the scenario.

        All of them are there in every frame, so one that has left the site ends it too.
        """
        there = libsumo.vehicle.getIDList()
        for agent in self._spec.agents:
            if isinstance(agent.place, RoadsideUnit):
                continue
            gone = str(agent.number) not in there
            if gone and agent.place.role == "ego":
                raise RunError(f"{agent.id} left the site without coming near its destination")
            if gone or self._is_near(str(agent.number), agent.place.destination_m):
                return True
        return False

    def _is_near(self, name: str, destination: Point2) -> bool:
        heading = _heading(libsumo.vehicle.getAngle(name))
        half = self._rides[name].actor.size[0] / 2
        east, north = libsumo.vehicle.getPosition(name)
        middle = np.array([east - half * np.cos(heading), north - half * np.sin(heading)])
        return bool((np.abs(middle - destination) <= self._spec.timing.destination_box_m).all())

    def _vehicles(self, tick: int) -> Iterator[tuple[float, ...]]:
        vehicle = libsumo.vehicle
        for name in vehicle.getIDList():
            yield (
                tick,
                int(name),
                *vehicle.getPosition3D(name),
                _heading(vehicle.getAngle(name)),
                np.radians(vehicle.getSlope(name)),
                vehicle.getSpeed(name),
                vehicle.getAcceleration(name),
                _indicators(vehicle.getSignals(name)),
            )

    def _people(self, tick: int) -> Iterator[tuple[float, ...]]:
        person = libsumo.person
        for name in person.getIDList():
            position, heading = person.getPosition3D(name), _heading(person.getAngle(name))
            yield (tick, int(name), *position, heading, 0.0, person.getSpeed(name), 0.0, 0)

    def _mind_bends(self) -> None:
        vehicle = libsumo.vehicle
        for name in vehicle.getIDList():
            here = vehicle.getRoadID(name), vehicle.getLanePosition(name)
            top = min(self._rides[name].top_speed_m_s, self._paces[name].at(*here))
            vehicle.setMaxSpeed(name, top)

    def _trace(self) -> Trace:
        kerb = _kerb(self._spec.road)
        first, tick_s = self._spec.timing.warm_up_ticks + 1, self._spec.timing.tick_s
        lights = self._lights[first:]
        fronts = np.array(self._fronts, dtype=FRONT)
        fronts = fronts[np.lexsort((fronts["tick"], fronts["id"]))]
        ids, begins = np.unique(fronts["id"], return_index=True)
        walks = {walk.actor.id: walk for walk in self._demand.walkers}
        rides = {ride.actor.id: ride for ride in self._rides.values()}
        actors: list[Actor] = []
        states: list[NDArray[np.void]] = []
        for number, track in zip(ids.tolist(), np.split(fronts, begins[1:]), strict=True):
            if number in walks:
                actor, speed = walks[number].actor, walks[number].speed_m_s
                kept = walker_states(
                    track, actor.size[0], speed_m_s=speed, tick_s=tick_s, kerb=kerb
                )
            else:
                actor = rides[number].actor
                kept = vehicle_states(track, actor.size[0], tick_s=tick_s)
                if actor.actor_class == "bicycle":
                    kept["lamps"] = 0
            kept = kept[kept["tick"] >= first]
            if len(kept) > 0:
                kept["tick"] -= first
                kept["actor"] = len(actors)
                actors.append(actor)
                states.append(kept)
        if not states:
            raise RunError("a connected vehicle arrives during the warm-up; move it back")
        together = np.concatenate(states)
        return Trace(
            tick_s=tick_s,
            first_tick=first,
            actors=tuple(actors),
            states=together[np.lexsort((together["actor"], together["tick"]))],
            signal_ids=tuple(self._signals),
            signals=np.array(lights, dtype=np.uint8).reshape(len(lights), len(self._signals)),
        )


def _kerb(road: Road) -> Callable[[NDArray[np.complex128]], NDArray[np.float64]]:
    """Height of a sidewalk above the roadway for places on foot, 0 on the roadway."""
    roadway = built(road).kerbless
    shapely.prepare(roadway)
    return lambda places: np.where(
        shapely.contains_xy(roadway, places.real, places.imag), 0.0, KERB_HEIGHT_M
    )


def _heading(angle_deg: float) -> float:
    """Radians counter-clockwise from east, from SUMO's degrees clockwise from north."""
    return float(np.pi / 2 - np.radians(angle_deg))


def _indicators(signals: int) -> Lamp:
    lit = {Lamp.LEFT: signals & _LEFT_BLINKER, Lamp.RIGHT: signals & _RIGHT_BLINKER}
    return reduce(or_, (lamp for lamp, on in lit.items() if on), Lamp(0))


def _shown(links: Iterable[tuple[str, int]]) -> Signal:
    """What an approach's light shows: the most that any of its links is given."""
    states = [libsumo.trafficlight.getRedYellowGreenState(light)[link] for light, link in links]
    meaning = {"g": Signal.GREEN, "y": Signal.YELLOW}
    return max(meaning.get(state.lower(), Signal.RED) for state in states)
