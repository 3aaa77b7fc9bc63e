"""What recording costs against SUMO alone, as the ratio of their rates on the same demand.

    python benchmarks/traffic.py [compiled/ui_clear_day_dense.json ...] [--rounds 5]

One run gives both: SUMO's own time is that of starting, stepping and closing it; the rest is
reading the state of every road user, limiting speeds in curves, and the record. The value is the
median of the rounds, in processor time.
"""

import argparse
import statistics
import tempfile
from pathlib import Path

import libsumo
from advercity_dsl import Spec
from measurement import Measurement, Stopwatch, format_table, measure_run_time

from advercity.compiler import read_spec
from advercity.pipeline.preparation import load_or_simulate_traffic
from advercity.roads.lane_graph import read_lane_graph
from advercity.traffic import sumo_run
from advercity.traffic.demand import draw_demand
from advercity.traffic.route_file import write_route_file

GOAL = 0.8
SPECS = [Path(f"compiled/{road}_clear_day_dense.json") for road in ("ui", "ri", "rcnj")]
SUMO_CALLS = {"SUMO": [(libsumo, name) for name in ("start", "simulationStep", "close")]}


def run_benchmark(*, quick: bool) -> list[Measurement]:
    """Measure recording on one road, or on all."""
    return measure_specs(SPECS[:1], 2) if quick else measure_specs(SPECS, 5)


def measure_specs(paths: list[Path], rounds: int) -> list[Measurement]:
    """Measure some scenarios."""
    return [
        Measurement(
            f"traffic, {path.stem}",
            measure_recording(read_spec(path), rounds),
            "rate of libsumo alone",
            at_least=GOAL,
        )
        for path in paths
    ]


def measure_recording(spec: Spec, rounds: int) -> float:
    """Measure the rate of recorded stepping relative to that of SUMO alone."""
    network = load_or_simulate_traffic(spec).network_path
    graph = read_lane_graph(network)
    demand = draw_demand(spec, graph)
    ratios: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        routes = Path(folder) / "demand.rou.xml"
        write_route_file(demand, routes, spec.caution)
        for _ in range(rounds + 1):
            with Stopwatch().instrument(SUMO_CALLS) as sumo:
                whole = measure_run_time(
                    lambda: sumo_run.run_sumo(spec, demand, graph, network, routes, {})
                )
            ratios.append(sumo.stages["SUMO"].cpu_s / whole.cpu_s)
    # The first round fills caches.
    return statistics.median(ratios[1:])


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("specs", nargs="*", type=Path, default=SPECS)
    parser.add_argument("--rounds", type=int, default=5)
    arguments = parser.parse_args()
    print(format_table(measure_specs(arguments.specs, arguments.rounds)))


if __name__ == "__main__":
    main()
