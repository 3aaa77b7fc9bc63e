"""Drive a demand in SUMO, tick by tick, and keep what everybody does.

The only module that talks to libsumo.
"""

import math
from collections.abc import Iterable, Iterator, Mapping
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
_BLINKERS = 3
LAMPS = np.array([0, Lamp.RIGHT, Lamp.LEFT, Lamp.RIGHT | Lamp.LEFT], dtype=np.uint8)
"""By SUMO's two lowest bits of a vehicle's signals."""
_USUAL, _AS_TOLD, _UNMINDFUL = 31, 39, 38
"""Speed modes: obey everything; mind whom one follows, but neither lights nor right of way; not
even whom one follows, since one passes beside the lane."""


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
        self._passing = {
            str(actor.number)
            for conflict in spec.conflicts
            if conflict.actors[0].behaviour == "overtakes"
            for actor in conflict.actors
        }
        self._cues = {str(number): speeds for number, speeds in cues.items()}
        self._rides = {str(ride.actor.id): ride for ride in demand.rides}
        most_m_s2 = spec.caution.usual_m_s2 if spec.caution else math.inf
        self._paces = {name: Pace.of(ride, graph, most_m_s2) for name, ride in self._rides.items()}
        self._signals = signal_groups(network)
        self._fronts: list[tuple[float, ...]] = []
        self._lights: list[dict[str, str]] = []
        self._tops: dict[str, float] = {}

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
            self._lights.append(_states(self._signals))
            self._mind_bends()
        return self._recording()

    def _give_cues(self, tick: int) -> None:
        """Have staged vehicles drive as planned, red lights or not; NaN leaves them to SUMO."""
        there = libsumo.vehicle.getIDList() if self._cues else ()
        for name in (name for name in self._cues if name in there):
            speed = float(self._cues[name][min(tick, len(self._cues[name]) - 1)])
            free = np.isnan(speed)
            told = _UNMINDFUL if name in self._passing else _AS_TOLD
            libsumo.vehicle.setSpeedMode(name, _USUAL if free else told)
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
        heading = math.radians(90 - libsumo.vehicle.getAngle(name))
        half = self._rides[name].actor.size[0] / 2
        east, north = libsumo.vehicle.getPosition(name)
        middle = east - half * math.cos(heading), north - half * math.sin(heading)
        return all(
            abs(here - there) <= self._spec.timing.destination_box_m
            for here, there in zip(middle, destination, strict=True)
        )

    def _vehicles(self, tick: int) -> Iterator[tuple[float, ...]]:
        """Rows of `FRONT`, angles as SUMO tells them."""
        vehicle = libsumo.vehicle
        for name in vehicle.getIDList():
            yield (
                tick,
                int(name),
                *vehicle.getPosition3D(name),
                vehicle.getAngle(name),
                vehicle.getSlope(name),
                vehicle.getSpeed(name),
                vehicle.getAcceleration(name),
                vehicle.getSignals(name) & _BLINKERS,
            )

    def _people(self, tick: int) -> Iterator[tuple[float, ...]]:
        person = libsumo.person
        for name in person.getIDList():
            position, angle = person.getPosition3D(name), person.getAngle(name)
            yield (tick, int(name), *position, angle, 0.0, person.getSpeed(name), 0.0, 0)

    def _mind_bends(self) -> None:
        vehicle = libsumo.vehicle
        for name in vehicle.getIDList():
            top = self._paces[name].at(vehicle.getRoadID(name), vehicle.getLanePosition(name))
            top = min(self._rides[name].top_speed_m_s, top)
            if self._tops.get(name) != top:
                vehicle.setMaxSpeed(name, top)
                self._tops[name] = top

    def _recording(self) -> Recording:
        fronts = np.array(self._fronts, dtype=FRONT)
        fronts["yaw"] = np.pi / 2 - np.radians(fronts["yaw"])
        fronts["slope"] = np.radians(fronts["slope"])
        fronts["lamps"] = LAMPS[fronts["lamps"]]
        fronts = fronts[np.lexsort((fronts["tick"], fronts["id"]))]
        ids, begins = np.unique(fronts["id"], return_index=True)
        shown = [
            [_shown(states, links) for links in self._signals.values()] for states in self._lights
        ]
        lights = np.array(shown, dtype=np.uint8)
        return Recording(
            tracks=dict(zip(ids.tolist(), np.split(fronts, begins[1:]), strict=True)),
            signal_ids=tuple(self._signals),
            signals=lights.reshape(len(lights), len(self._signals)),
        )


def _states(signals: Mapping[str, list[tuple[str, int]]]) -> dict[str, str]:
    """What every light shows to its links."""
    lights = dict.fromkeys(light for links in signals.values() for light, _ in links)
    return {light: libsumo.trafficlight.getRedYellowGreenState(light) for light in lights}


def _shown(states: Mapping[str, str], links: Iterable[tuple[str, int]]) -> Signal:
    """What an approach's light shows: the most that any of its links is given."""
    meaning = {"g": Signal.GREEN, "y": Signal.YELLOW}
    return max(meaning.get(states[light][link].lower(), Signal.RED) for light, link in links)
