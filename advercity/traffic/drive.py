"""Drive a demand in SUMO, tick by tick, and keep what everybody does.

This and `observation` are the only modules that talk to libsumo.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import libsumo
import numpy as np
from advercity_dsl import Spec
from numpy.typing import NDArray

from advercity.errors import RunError
from advercity.traffic import calls
from advercity.traffic.arrival import goals
from advercity.traffic.bends import Pace
from advercity.traffic.demand import Demand
from advercity.traffic.lanes import LaneGraph
from advercity.traffic.observation import PersonLog, Presence, SignalLog, VehicleLog
from advercity.traffic.pacing import Pacing
from advercity.traffic.recording import Recording

LATERAL_RESOLUTION_M = 0.8
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
        most_m_s2 = spec.caution.usual_m_s2 if spec.caution else math.inf
        self._goals = goals(spec, demand)
        self._names = [str(ride.actor.id) for ride in demand.rides]
        self._pacing = Pacing(
            [Pace.of(ride, graph, most_m_s2) for ride in demand.rides],
            [ride.top_speed_m_s for ride in demand.rides],
        )
        self._there = Presence(calls.vehicles_that_came, calls.vehicles_that_left)
        self._on_foot = Presence(calls.people_who_came, calls.people_who_left)
        self._vehicles = VehicleLog(self._there, (str(ride.actor.id) for ride in demand.staged))
        self._people = PersonLog(self._on_foot)
        self._signals = SignalLog(network)

    def run(self) -> Recording:
        """Drive until somebody arrives or time is up."""
        for tick in range(self._spec.timing.max_ticks + 1):
            self._give_cues(tick)
            libsumo.simulationStep()
            if self._there.look():
                self._pacing.meet([self._names.index(name) for name in self._there.names])
            self._on_foot.look()
            if tick == 0:
                self._check_start()
                self._introduce()
            if any(goal.is_over(self._there.known) for goal in self._goals):
                break
            speeds = self._vehicles.note()
            self._people.note()
            self._signals.note()
            self._mind_bends(speeds)
        return self._recording()

    def _give_cues(self, tick: int) -> None:
        """Have staged vehicles drive as planned, red lights or not; NaN leaves them to SUMO."""
        for name in (name for name in self._cues if name in self._there.known):
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
        for ride in (*self._demand.connected, *self._demand.staged):
            if str(ride.actor.id) not in self._there.known:
                raise RunError(
                    f"SUMO finds no room for vehicle {ride.actor.id} on lane"
                    f" {ride.edges[0]}_{ride.lane} at {ride.front_m:.1f} m"
                )

    def _mind_bends(self, speeds: Sequence[float]) -> None:
        """Tell those for whom it has changed how fast they may go where they are."""
        moved_m = np.array(speeds) * self._spec.timing.tick_s
        for ride, top_m_s in self._pacing.news(moved_m, self._where):
            calls.set_vehicle_top_speed(self._names[ride], top_m_s)

    def _where(self, ride: int) -> tuple[str, float]:
        name = self._names[ride]
        return calls.vehicle_edge(name), calls.vehicle_lane_position(name)

    def _recording(self) -> Recording:
        return Recording(
            tracks=self._vehicles.fronts(self._spec.timing.tick_s) | self._people.fronts(),
            signal_ids=self._signals.ids,
            signals=self._signals.shown(),
        )
