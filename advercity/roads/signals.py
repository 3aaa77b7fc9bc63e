"""Traffic lights and signs, and the fixed signal programs of declared junctions.

A program gives green to one approach at a time, or to several together. A crossing is green with
the approach whose right turn leads into the crossed street. Turns give way to pedestrians, and left
turns also to oncoming traffic with green at the same time.
"""

from dataclasses import dataclass
from typing import Literal

from advercity_dsl.road import Signals
from advercity_dsl.units import Point2, Point3

from advercity.roads.layout import JunctionLayout
from advercity.signal_heads import GovernedTraffic


def build_signal_phases(junction: JunctionLayout, declared: Signals) -> list[tuple[float, str]]:
    """Build the program of a junction: durations in seconds and SUMO states.

    A state has a letter per link: the movements in order, then the crossings.
    """
    phases: list[tuple[float, str]] = []
    for approaches in declared.phases:
        phases.append((declared.green_s, _green_state(junction, approaches)))
        phases.append((declared.yellow_s, _yellow_state(junction, approaches)))
        if declared.all_red_s > 0:
            links = len(junction.connecting_paths) + len(junction.crossings)
            phases.append((declared.all_red_s, "r" * links))
    return phases


def find_declared_green_s(signals: Signals, street: str, from_s: float) -> float:
    """Compute the first time from `from_s` on at which a declared approach has green."""
    slot = signals.green_s + signals.yellow_s + signals.all_red_s
    period = slot * len(signals.cycle)
    number = next((at for at, phase in enumerate(signals.phases) if street in phase), None)
    if number is None:
        return from_s
    begins = number * slot - signals.elapsed_s
    while begins + signals.green_s <= from_s:
        begins += period
    return max(begins, from_s)


LEFT_TURN_RAD = 0.6
"""A movement with a larger left turn crosses oncoming traffic."""


def _green_state(junction: JunctionLayout, approaches: tuple[str, ...]) -> str:
    # `g` gives way to pedestrians and other vehicles, `G` does not; pedestrians always have `G`.
    walking = [
        crossing.street
        for crossing in junction.crossings
        if _concurrent_approach(junction, crossing.street) in approaches
    ]
    state = ""
    for movement in (path.movement for path in junction.connecting_paths):
        turn_rad = junction.turn_angle(movement.from_street, movement.to_street)
        is_permissive = len(approaches) > 1 and turn_rad > LEFT_TURN_RAD
        if movement.from_street not in approaches:
            state += "r"
        else:
            state += "g" if is_permissive or movement.to_street in walking else "G"
    return state + "".join("G" if item.street in walking else "r" for item in junction.crossings)


def _yellow_state(junction: JunctionLayout, approaches: tuple[str, ...]) -> str:
    cars = "".join(
        "y" if path.movement.from_street in approaches else "r"
        for path in junction.connecting_paths
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
    """A signal head over the road on a mast, or beside a crossing on a post."""

    id: str
    """`<light>/<approach>`, as in `read_signal_groups`; both heads of a crossing have its id."""
    position_m: Point3
    """Where the head is attached: to the arm of a mast, or to the top of a post."""
    mast_foot_m: Point2
    facing: tuple[float, float]
    """Unit vector (x, y) towards its traffic."""
    governs: GovernedTraffic = "vehicles"


@dataclass(frozen=True)
class TrafficSign:
    """A stop or give-way sign at the roadside."""

    kind: Literal["stop", "yield"]
    position_m: Point2
    facing: tuple[float, float]
    """Unit vector (x, y) towards its traffic."""
