"""Traffic lights and signs, and the fixed signal programs of declared junctions.

A program gives green to one approach at a time. A crossing is green together with the approach
that turns right into the crossed street: left turns then never meet pedestrians, and right turns
give way to them.
"""

from dataclasses import dataclass
from typing import Literal

from advercity_dsl.road import Signals
from advercity_dsl.units import Point2, Point3

from advercity.roads.layout import JunctionLayout


def build_signal_phases(junction: JunctionLayout, declared: Signals) -> list[tuple[float, str]]:
    """Build the program of a junction: durations in seconds and SUMO states.

    A state has a letter per link: the movements in order, then the crossings.
    """
    phases: list[tuple[float, str]] = []
    for approach in declared.cycle:
        phases.append((declared.green_s, _green_state(junction, approach)))
        phases.append((declared.yellow_s, _yellow_state(junction, approach)))
        if declared.all_red_s > 0:
            links = len(junction.connecting_paths) + len(junction.crossings)
            phases.append((declared.all_red_s, "r" * links))
    return phases


def find_declared_green_s(signals: Signals, street: str, from_s: float) -> float:
    """Compute the first time from `from_s` on at which a declared approach has green."""
    slot = signals.green_s + signals.yellow_s + signals.all_red_s
    period = slot * len(signals.cycle)
    if street not in signals.cycle:
        return from_s
    begins = signals.cycle.index(street) * slot - signals.elapsed_s
    while begins + signals.green_s <= from_s:
        begins += period
    return max(begins, from_s)


def _green_state(junction: JunctionLayout, approach: str) -> str:
    # `g` gives way to pedestrians and `G` does not; pedestrians always have `G`.
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
    """A signal head over the road, on a mast."""

    id: str
    """`<light>/<approach>`, as in `read_signal_groups`."""
    position_m: Point3
    """Where the head is attached to its arm."""
    mast_foot_m: Point2
    facing: tuple[float, float]
    """Unit vector (x, y) towards the traffic that it governs."""


@dataclass(frozen=True)
class TrafficSign:
    """A stop or give-way sign at the roadside."""

    kind: Literal["stop", "yield"]
    position_m: Point2
    facing: tuple[float, float]
    """Unit vector (x, y) towards the traffic that it governs."""
