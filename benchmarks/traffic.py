"""What recording costs against SUMO alone, as the ratio of their rates on the same demand.

    python benchmarks/traffic.py [compiled/ui_clear_day_dense.json ...] [--rounds 5]

One run measures both: SUMO's own part is what starting, stepping and closing it take, the rest is
querying the actors, limiting speeds in bends, and recording. The figure is the median of the
rounds, in processor time. Missing the goal does not fail the command.
"""

import argparse
import statistics
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from unittest.mock import patch

import libsumo
from advercity_dsl import Spec
from measurement import Figure

from advercity.compiler import read_spec
from advercity.pipeline.preparation import load_or_simulate_traffic
from advercity.roads.lane_graph import read_lane_graph
from advercity.traffic import sumo_run
from advercity.traffic.demand import draw_demand
from advercity.traffic.route_file import write_route_file

GOAL = 0.6
SPECS = [Path(f"compiled/{road}_clear_day_dense.json") for road in ("ui", "ri", "rcnj")]


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("specs", nargs="*", type=Path, default=SPECS)
    parser.add_argument("--rounds", type=int, default=5)
    arguments = parser.parse_args()
    for path in arguments.specs:
        measure(read_spec(path), arguments.rounds)


def figures(*, quick: bool) -> list[Figure]:
    """Recording on one road, or on all."""
    rounds, specs = (2, SPECS[:1]) if quick else (5, SPECS)
    return [
        Figure(
            f"traffic, {path.stem}",
            measure(read_spec(path), rounds),
            "rate of bare libsumo",
            at_least=GOAL,
        )
        for path in specs
    ]


def measure(spec: Spec, rounds: int) -> float:
    """Rate of recorded stepping over that of bare stepping."""
    network = load_or_simulate_traffic(spec).network_path
    graph = read_lane_graph(network)
    demand = draw_demand(spec, graph)
    ratios: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        routes = Path(folder) / "demand.rou.xml"
        write_route_file(demand, routes, spec.caution)
        ticks = 0
        for _ in range(rounds + 1):
            bare = Stopwatch()
            with ExitStack() as stack:
                for name in ("start", "simulationStep", "close"):
                    call = bare.timing(getattr(libsumo, name))
                    stack.enter_context(patch.object(libsumo, name, call))
                began = time.process_time()
                recording = sumo_run.run_sumo(spec, demand, graph, network, routes, {})
                whole = time.process_time() - began
            ticks = len(recording)
            ratios.append(bare.seconds / whole)
    ratio = statistics.median(ratios[1:])
    verdict = "reached" if ratio >= GOAL else "missed"
    print(
        f"{spec.id}: {ticks} ticks, recorded at {ratio:.2f} of SUMO's own rate;"
        f" the goal of {GOAL:g} is {verdict}"
    )
    return ratio


class Stopwatch:
    """Adds up what calls take."""

    def __init__(self) -> None:
        self.seconds = 0.0

    def timing(self, call: Callable[..., Any]) -> Callable[..., Any]:
        """The same call, timed."""

        def timed(*arguments: Any) -> Any:
            began = time.process_time()
            result = call(*arguments)
            self.seconds += time.process_time() - began
            return result

        return timed


if __name__ == "__main__":
    main()
