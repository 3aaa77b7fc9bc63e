"""Simulate the traffic of a spec in a child process."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from advercity_dsl import Spec, TrajectorySet

from advercity.errors import InputError, RunError, StagingError, report_temporary_errors
from advercity.frames import Trace
from advercity.processes import describe_end
from advercity.roads.mirrored_traffic import mirror_trace
from advercity.roads.plan_frame import to_plan_spec
from advercity.traffic.recorded_traffic import build_recorded_trace

EXIT_BAD_INPUT, EXIT_FAILED, EXIT_UNSTAGED = 2, 1, 3
"""Exit codes of the child process."""
ERROR_MARK = "\x1e"
"""Precedes the child's own error on its standard error, where SUMO also writes."""


def simulate_in_subprocess(spec: Spec, network: Path) -> Trace:
    """Simulate the traffic of a spec and return its trace; see `write_simulated_trace`."""
    with tempfile.TemporaryDirectory() as folder:
        trace_file = Path(folder) / "trace.npz"
        write_simulated_trace(spec, network, trace_file)
        return Trace.load(trace_file)


def write_simulated_trace(spec: Spec, network: Path, trace_file: Path) -> None:
    """Simulate the traffic of a spec on its road's SUMO network and write its trace in the world.

    It depends only on the road, the agents' places, the demand, the blueprints, the timing, the
    traffic seed and the drivers' response to the weather. So all weathers of a road and density
    share it, unless a suite has drivers that react. Recorded trajectories of a road replace SUMO.

    Args:
        spec: The scenario.
        network: The SUMO network of `spec.road`, in the plan frame.
        trace_file: File to write.

    Raises:
        InputError: The spec needs something that the road lacks.
        StagingError: A conflict cannot be staged.
        RunError: SUMO failed, or the ego does not get to its destination.
    """
    _write_plan_trace(to_plan_spec(spec), network, trace_file)
    if spec.road.is_left_hand:
        mirror_trace(Trace.load(trace_file)).save(trace_file)


def _write_plan_trace(spec: Spec, network: Path, trace_file: Path) -> None:
    """Simulate a spec in the plan frame and write its trace, in the plan frame too."""
    recorded = spec.road.trajectories
    if isinstance(recorded, TrajectorySet):
        build_recorded_trace(spec, recorded, network).save(trace_file)
        return
    with report_temporary_errors(), tempfile.TemporaryDirectory() as folder:
        spec_file = Path(folder) / "spec.json"
        spec_file.write_text(spec.model_dump_json(), encoding="utf-8")
        command = [sys.executable, "-m", "advercity.traffic.sumo_worker", str(os.getpid())]
        completed = subprocess.run(  # noqa: S603 - our own module with paths of our own
            [*command, str(spec_file), str(network.resolve()), str(trace_file.resolve())],
            capture_output=True,
            text=True,
            check=False,
        )
    if completed.returncode == EXIT_BAD_INPUT:
        raise InputError(*f"{spec.id}: {_get_error(completed)}".splitlines())
    if completed.returncode != 0:
        kind = StagingError if completed.returncode == EXIT_UNSTAGED else RunError
        raise kind(f"{spec.id}: traffic simulation failed: {_format_failure(completed)}")


def _format_failure(completed: subprocess.CompletedProcess[str]) -> str:
    if completed.returncode < 0:
        return describe_end(completed.returncode)
    output = _get_error(completed)
    last = output.splitlines()[-1] if output.startswith("Traceback") else output
    return last or describe_end(completed.returncode)


def _get_error(completed: subprocess.CompletedProcess[str]) -> str:
    return completed.stderr.rpartition(ERROR_MARK)[2].strip()
