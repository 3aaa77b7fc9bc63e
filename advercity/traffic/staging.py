"""Stage a spec's conflicts: rehearse the traffic, time the actors, clear their ways."""

import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from advercity_dsl import Spec
from numpy.typing import NDArray

from advercity.traffic.demand import Demand, draw
from advercity.traffic.drive import drive
from advercity.traffic.lanes import LaneGraph, read_lanes
from advercity.traffic.recording import Recording, trace_of
from advercity.traffic.route_file import write_route_file
from advercity.traffic.trace import Trace


def stage(spec: Spec, network: Path) -> Trace:
    """The trace."""
    graph = read_lanes(network)
    demand = draw(spec, graph)
    return trace_of(spec, demand, recorded(spec, demand, graph, network, {}))


def recorded(
    spec: Spec,
    demand: Demand,
    graph: LaneGraph,
    network: Path,
    cues: Mapping[int, NDArray[np.float64]],
) -> Recording:
    """One run of SUMO."""
    with tempfile.TemporaryDirectory() as folder:
        routes = Path(folder) / "demand.rou.xml"
        write_route_file(demand, routes)
        return drive(spec, demand, graph, network, routes, cues)
