"""Drive a demand in SUMO, tick by tick, and keep what everybody does.

The only module that talks to libsumo.
"""

from collections.abc import Iterable, Iterator, Mapping
from functools import reduce
from operator import or_
from pathlib import Path

import libsumo
import numpy as np
from advercity_dsl import RoadsideUnit, Spec
from advercity_dsl.base import Point2
from numpy.typing import NDArray

from advercity.errors import RunError
from advercity.traffic.bends import Pace
from advercity.traffic.bumpers import FRONT
from advercity.traffic.demand import Demand
from advercity.traffic.lanes import LaneGraph
from advercity.traffic.recording import Recording
from advercity.traffic.trace import Lamp, Signal
from advercity.world.network import signal_groups

LATERAL_RESOLUTION_M = 0.8
_RIGHT_BLINKER, _LEFT_BLINKER = 1, 2
_USUAL, _AS_TOLD = 31, 39
"""Speed modes: obey everything; mind whom one follows, but neither lights nor right of way."""


def drive(
    spec: Spec,
    demand: Demand,
    graph: LaneGraph,
    network: Path,
    routes: Path,
    cues: Mapping[int, NDArray[np.float64]],
) -> Recording:
    """What happens when the demand, written in the file `routes`, sets out.

    Args:
        spec: The scenario.
        demand: Who takes part.
        graph: Lanes of the road.
        network: The same as a SUMO network.
        routes: The demand as a SUMO route file.
        cues: Speed in every tick of staged vehicles; NaN leaves it to the driver, the last one
            lasts.
    """
    log = routes.with_suffix(".log")
    try:
        libsumo.start(["sumo", *_options(spec, network, routes, log)])
        try:
            return _Drive(spec, demand, graph, network, cues).run()
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

    def __init__(
        self,
        spec: Spec,
        demand: Demand,
        graph: LaneGraph,
        network: Path,
        cues: Mapping[int, NDArray[np.float64]],
    ) -> None:
        self._spec = spec
        self._demand = demand
        self._cues = {str(number): speeds for number, speeds in cues.items()}
        self._rides = {str(ride.actor.id): ride for ride in demand.rides}
        self._paces = {name: Pace.of(ride, graph) for name, ride in self._rides.items()}
        self._signals = signal_groups(network)
        self._fronts: list[tuple[float, ...]] = []
        self._lights: list[list[Signal]] = []

    def run(self) -> Recording:
        """Drive until somebody arrives or time is up."""
        for tick in range(self._spec.timing.max_ticks + 1):
            self._give_cues(tick)
            libsumo.simulationStep()
            if tick == 0:
                self._check_start()
                self._introduce()
            if self._has_arrived():
                break
            self._fronts.extend((*self._vehicles(tick), *self._people(tick)))
            self._lights.append([_shown(links) for links in self._signals.values()])
            self._mind_bends()
        return self._recording()

    def _give_cues(self, tick: int) -> None:
        """Have staged vehicles drive as planned, red lights or not; NaN leaves them to SUMO."""
        there = libsumo.vehicle.getIDList() if self._cues else ()
        for name in (name for name in self._cues if name in there):
            speed = float(self._cues[name][min(tick, len(self._cues[name]) - 1)])
            free = np.isnan(speed)
            libsumo.vehicle.setSpeedMode(name, _USUAL if free else _AS_TOLD)
            libsumo.vehicle.setSpeed(name, -1 if free else speed)

    def _introduce(self) -> None:
        """Connected and staged vehicles do not give way to each other inside junctions."""
        connected = [str(ride.actor.id) for ride in self._demand.connected]
        staged = [str(ride.actor.id) for ride in self._demand.staged]
        for names, others in ((connected, staged), (staged, connected)):
            for name in names:
                libsumo.vehicle.setParameter(name, "junctionModel.ignoreIDs", " ".join(others))

    def _check_start(self) -> None:
        there = libsumo.vehicle.getIDList()
        for ride in (*self._demand.connected, *self._demand.staged):
            if str(ride.actor.id) not in there:
                raise RunError(
                    f"SUMO finds no room for vehicle {ride.actor.id} on lane"
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

    def _recording(self) -> Recording:
        fronts = np.array(self._fronts, dtype=FRONT)
        fronts = fronts[np.lexsort((fronts["tick"], fronts["id"]))]
        ids, begins = np.unique(fronts["id"], return_index=True)
        lights = np.array(self._lights, dtype=np.uint8)
        return Recording(
            tracks=dict(zip(ids.tolist(), np.split(fronts, begins[1:]), strict=True)),
            signal_ids=tuple(self._signals),
            signals=lights.reshape(len(lights), len(self._signals)),
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
