"""How smoothly everybody moves: the worst values over traces, found by differences of positions.

    python benchmarks/motion.py [compiled/ui_clear_day_dense.json ...] [--all]

Without specs it takes one of each road, dense; `--all` takes every trace of the shipped suites. All
values are differences of positions and yaws, compared with the speeds and velocities of the trace.
"""

import argparse
from collections import defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
from advercity_dsl import Spec
from measurement import Measurement, format_table
from numpy.typing import NDArray

from advercity.compiler import compile_library, read_spec
from advercity.frames import Trace
from advercity.pipeline.preparation import load_or_simulate_traffic

SPECS = [
    Path(f"compiled/{road}_clear_day_dense.json") for road in ("ui", "unj", "ri", "rsnj", "rcnj")
]
SUITES = ("adver_city", "conflicts", "unsignalised")
EMERGENCY_M_S2, ASIDE_M_S2 = 3.0, 3.5
"""Change of speed, and acceleration across the path, beyond which the second before and after is an
emergency; drivers take bends with up to the latter."""
LIMITS = {
    "displacement less speed": ("m/s", 0.2),
    "displacement less velocity": ("m/s", 0.2),
    "jerk of connected vehicles and staged actors": ("m/s³", 20.0),
    "jerk of connected and staged vehicles outside emergencies": ("m/s³", 5.0),
    "jerk of background": ("m/s³", 30.0),
    "turn rate of people": ("°/s", 180.0),
}


def run_benchmark(*, quick: bool) -> list[Measurement]:
    """Measure two roads, or all."""
    return measure_specs(read_spec(path) for path in (SPECS[2:4] if quick else SPECS))


def measure_specs(specs: Iterable[Spec]) -> list[Measurement]:
    """Measure the worst value of every quantity over the traces of specs."""
    worst: dict[str, tuple[float, str]] = defaultdict(lambda: (0.0, "nobody"))
    for spec in specs:
        trace = load_or_simulate_traffic(spec).trace
        for quantity, value, who in _measure_trace(spec, trace):
            worst[quantity] = max(worst[quantity], (value, who))
    return [
        Measurement(f"{quantity}: {worst[quantity][1]}", worst[quantity][0], unit, at_most=limit)
        for quantity, (unit, limit) in LIMITS.items()
    ]


def _measure_trace(spec: Spec, trace: Trace) -> Iterator[tuple[str, float, str]]:
    watched = {agent.number for agent in spec.agents}
    watched |= {actor.number for item in spec.conflicts for actor in item.actors}
    for actor in trace.actors:
        _, rows = trace.get_track(actor.id)
        if len(rows) < 4:
            continue
        places = np.column_stack([rows[name] for name in "xyz"])
        steps = np.diff(places, axis=0) / trace.tick_s
        velocity = np.column_stack([rows[name] for name in ("vx", "vy", "vz")])
        jerk = _norms(np.diff(places, n=3, axis=0)) / trace.tick_s**3
        party = "connected vehicles and staged actors" if actor.id in watched else "background"
        found = {
            "displacement less speed": _norms(steps) - (rows["speed"][1:] + rows["speed"][:-1]) / 2,
            "displacement less velocity": _norms((steps[1:] + steps[:-1]) / 2 - velocity[1:-1]),
            f"jerk of {party}": jerk,
        }
        if actor.id in watched and actor.actor_class != "pedestrian":
            calm = ~_find_emergencies(rows["speed"], velocity, trace.tick_s)[1:-2]
            found["jerk of connected and staged vehicles outside emergencies"] = jerk[calm]
        if actor.actor_class == "pedestrian":
            turns = np.diff(np.unwrap(rows["yaw"])) / trace.tick_s
            found["turn rate of people"] = np.degrees(turns)
        who = f"{actor.actor_class} {actor.id} of {spec.id}"
        for quantity, values in found.items():
            yield quantity, float(np.abs(values).max(initial=0)), who


def _norms(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.linalg.norm(vectors, axis=1)


def _find_emergencies(
    speed: NDArray[np.float64], velocity: NDArray[np.float64], tick_s: float
) -> NDArray[np.bool_]:
    """Find ticks (n,) within a second of hard braking, accelerating or steering."""
    along = np.gradient(speed, tick_s)
    square = np.sum(np.gradient(velocity, tick_s, axis=0) ** 2, axis=1)
    hard = (np.abs(along) > EMERGENCY_M_S2) | (square - along**2 > ASIDE_M_S2**2)
    return np.convolve(hard, np.ones(21), mode="full")[10:-10] > 0


def _compile_suites() -> Iterator[Spec]:
    """Compile one spec per trace: weathers share them."""
    for suite in SUITES:
        for spec in compile_library(Path("library/nhtsa"), suite=suite):
            if "clear_day" in spec.id:
                yield spec


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("specs", nargs="*", type=Path, default=SPECS)
    parser.add_argument("--all", action="store_true")
    arguments = parser.parse_args()
    specs = _compile_suites() if arguments.all else map(read_spec, arguments.specs)
    print(format_table(measure_specs(specs)))


if __name__ == "__main__":
    main()
