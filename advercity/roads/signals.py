"""Fixed signal programmes: one approach at a time, with crossings that walk beside it.

A crossing walks with the approach that turns right into the crossed street: its left turns stay
free of people, and its right turns give way to them.
"""

from dataclasses import dataclass
from typing import Literal

from advercity_dsl.units import Point2, Point3

from advercity.roads.layout import JunctionLayout


@dataclass(frozen=True)
class SignalPhase:
    """What every link shows for some time: a SUMO state with a letter per link."""

    duration_s: float
    state: str


@dataclass(frozen=True)
class SignalProgram:
    """The programme of a junction: links are its movements in order, then its crossings."""

    junction: str
    offset_s: float
    phases: tuple[SignalPhase, ...]


def build_signal_program(junction: JunctionLayout) -> SignalProgram | None:
    """The programme of a signalised junction, None for any other."""
    declared = junction.declared.signals
    if declared is None:
        return None
    phases: list[SignalPhase] = []
    for approach in declared.cycle:
        phases += [
            SignalPhase(declared.green_s, _green_state(junction, approach)),
            SignalPhase(declared.yellow_s, _yellow_state(junction, approach)),
        ]
        if declared.all_red_s > 0:
            links = len(junction.connecting_paths) + len(junction.crossings)
            phases.append(SignalPhase(declared.all_red_s, "r" * links))
    return SignalProgram(junction.id, -declared.elapsed_s, tuple(phases))


def _green_state(junction: JunctionLayout, approach: str) -> str:
    walking = [
        crossing.street
        for crossing in junction.crossings
        if _concurrent_approach(junction, crossing.street) == approach
    ]
    state = ""
    for path in junction.connecting_paths:
        if path.movement.from_street != approach:
            state += "r"
        else:
            state += "g" if path.movement.to_street in walking else "G"
    return state + "".join("G" if item.street in walking else "r" for item in junction.crossings)


def _yellow_state(junction: JunctionLayout, approach: str) -> str:
    cars = "".join(
        "y" if path.movement.from_street == approach else "r" for path in junction.connecting_paths
    )
    return cars + "r" * len(junction.crossings)


def _concurrent_approach(junction: JunctionLayout, street: str) -> str | None:
    into = {
        path.movement.from_street: junction.turn_angle(path.movement.from_street, street)
        for path in junction.connecting_paths
        if path.movement.to_street == street
    }
    return min(into, key=lambda name: into[name]) if into else None


@dataclass(frozen=True)
class TrafficLight:
    """A traffic light: heads hang at `at_m`, on a mast whose foot is at `pole_m`."""

    id: str
    """`<light>/<approach>`, as in `signal_groups`."""
    position_m: Point3
    mast_foot_m: Point2
    facing: tuple[float, float]
    """Unit vector towards the traffic it is for."""


@dataclass(frozen=True)
class TrafficSign:
    """A stop or give-way sign."""

    kind: Literal["stop", "yield"]
    position_m: Point2
    facing: tuple[float, float]
    """Unit vector towards the traffic it is for."""
