"""The child process that runs SUMO.

    python -m advercity.traffic.sumo_worker PARENT SPEC NETWORK TRACE

PARENT is the id of the starting process. SUMO keeps one simulation per process and may end its
process, so it gets its own.
"""

import sys
from pathlib import Path

from advercity_dsl import Spec

from advercity.documents import MAX_JSON_BYTES, parse_json, read_text
from advercity.errors import (
    AdvercityError,
    InputError,
    StagingError,
    explain_system_error,
)
from advercity.processes import end_with_parent
from advercity.traffic.dry_run import simulate_with_dry_runs
from advercity.traffic.simulation import (
    ERROR_MARK,
    EXIT_BAD_INPUT,
    EXIT_FAILED,
    EXIT_UNSTAGED,
)


def main(spec_file: str, network_file: str, trace_file: str) -> None:
    """Simulate the traffic of a spec and write its trace."""
    path = Path(spec_file)
    spec = Spec.model_validate(parse_json(read_text(path, max_bytes=MAX_JSON_BYTES), path))
    simulate_with_dry_runs(spec, Path(network_file)).save(Path(trace_file))


if __name__ == "__main__":
    try:
        end_with_parent(int(sys.argv[1]))
        main(*sys.argv[2:])
    except AdvercityError as error:
        sys.stderr.write(f"{ERROR_MARK}{error}")
        codes = {InputError: EXIT_BAD_INPUT, StagingError: EXIT_UNSTAGED}
        sys.exit(next((codes[kind] for kind in codes if isinstance(error, kind)), EXIT_FAILED))
    except (OSError, MemoryError) as error:
        sys.stderr.write(str(explain_system_error(error)))
        sys.exit(EXIT_FAILED)
