"""The child process that runs SUMO: `python -m advercity.traffic.worker SPEC NETWORK TRACE`.

SUMO keeps one simulation per process and may end the process it runs in, so it gets its own.
"""

import sys
from pathlib import Path

from advercity_dsl import Spec

from advercity.errors import AdvercityError, InputError
from advercity.traffic.staging import stage

BAD_INPUT, FAILED = 2, 1


def main(spec_file: str, network_file: str, trace_file: str) -> None:
    """Simulate the traffic of a spec and write its trace."""
    spec = Spec.model_validate_json(Path(spec_file).read_bytes())
    stage(spec, Path(network_file)).save(Path(trace_file))


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except AdvercityError as error:
        sys.stderr.write(str(error))
        sys.exit(BAD_INPUT if isinstance(error, InputError) else FAILED)
