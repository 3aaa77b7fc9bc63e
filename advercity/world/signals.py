"""Fixed signal programmes: one approach at a time, with crossings that walk beside it.

A crossing walks with the approach that turns right into the crossed street: its left turns stay
free of people, and its right turns give way to them.
"""

from dataclasses import dataclass

from advercity.world.junctions import JunctionLayout


@dataclass(frozen=True)
class Phase:
    """What every link shows for some time: a SUMO state with a letter per link."""

    duration_s: float
    state: str


@dataclass(frozen=True)
class Program:
    """The programme of a junction: links are its movements in order, then its crossings."""

    junction: str
    offset_s: float
    phases: tuple[Phase, ...]


def program(junction: JunctionLayout) -> Program | None:
    """The programme of a signalised junction, None for any other."""
    declared = junction.declared.signals
    if declared is None:
        return None
    phases: list[Phase] = []
    for approach in declared.cycle:
        phases += [
            Phase(declared.green_s, _green(junction, approach)),
            Phase(declared.yellow_s, _yellow(junction, approach)),
        ]
        if declared.all_red_s > 0:
            links = len(junction.paths) + len(junction.crossings)
            phases.append(Phase(declared.all_red_s, "r" * links))
    return Program(junction.id, -declared.elapsed_s, tuple(phases))


def _green(junction: JunctionLayout, approach: str) -> str:
    walking = [
        crossing.street
        for crossing in junction.crossings
        if _walks_with(junction, crossing.street) == approach
    ]
    state = ""
    for path in junction.paths:
        if path.movement.from_street != approach:
            state += "r"
        else:
            state += "g" if path.movement.to_street in walking else "G"
    return state + "".join("G" if item.street in walking else "r" for item in junction.crossings)


def _yellow(junction: JunctionLayout, approach: str) -> str:
    cars = "".join("y" if path.movement.from_street == approach else "r" for path in junction.paths)
    return cars + "r" * len(junction.crossings)


def _walks_with(junction: JunctionLayout, street: str) -> str | None:
    into = {
        path.movement.from_street: junction.turn(path.movement.from_street, street)
        for path in junction.paths
        if path.movement.to_street == street
    }
    return min(into, key=lambda name: into[name]) if into else None
