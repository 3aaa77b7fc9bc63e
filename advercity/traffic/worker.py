"""The child process that runs SUMO: `python -m advercity.traffic.worker SPEC NETWORK TRACE`.

SUMO keeps one simulation per process and may end the process it runs in, so it gets its own.
"""

import sys
import tempfile
from pathlib import Path

from advercity_dsl import Spec

from advercity.errors import AdvercityError, InputError
from advercity.traffic.demand import draw
from advercity.traffic.drive import drive
from advercity.traffic.lanes import read_lanes
from advercity.traffic.route_file import write_route_file

BAD_INPUT, FAILED = 2, 1


def main(spec_file: str, network_file: str, trace_file: str) -> None:
    """Simulate the traffic of a spec and write its trace."""
    spec = Spec.model_validate_json(Path(spec_file).read_bytes())
    network = Path(network_file)
    graph = read_lanes(network)
    demand = draw(spec, graph)
    with tempfile.TemporaryDirectory() as folder:
        routes = Path(folder) / "demand.rou.xml"
        write_route_file(demand, routes)
        drive(spec, demand, graph, network, routes).save(Path(trace_file))


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except AdvercityError as error:
        sys.stderr.write(str(error))
        sys.exit(BAD_INPUT if isinstance(error, InputError) else FAILED)
