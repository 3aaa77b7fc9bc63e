"""Simulate the traffic of a spec."""

import subprocess
import sys
import tempfile
from pathlib import Path

from advercity_dsl import Spec

from advercity.errors import InputError, RunError
from advercity.frames import Trace

EXIT_BAD_INPUT = 2


def simulate_in_subprocess(spec: Spec, network: Path) -> Trace:
    """The traffic of a spec on its road's SUMO network.

    It depends on the road, the agents' places, the demand, the blueprints, the timing, the traffic
    seed and what drivers do about the weather, and on nothing else; so all weathers of a road and
    density share it, unless a suite has drivers who react.

    Args:
        spec: What to simulate.
        network: The SUMO network of `spec.road`, in world coordinates.

    Raises:
        InputError: The spec asks for what the road does not have.
        RunError: SUMO failed, or the ego does not get to its destination.
    """
    with tempfile.TemporaryDirectory() as folder:
        spec_file, trace_file = Path(folder) / "spec.json", Path(folder) / "trace.npz"
        spec_file.write_text(spec.model_dump_json(), encoding="utf-8")
        command = [sys.executable, "-m", "advercity.traffic.sumo_worker"]
        done = subprocess.run(  # noqa: S603 - our own module with paths of our own
            [*command, str(spec_file), str(network.resolve()), str(trace_file)],
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode == EXIT_BAD_INPUT:
            raise InputError(f"{spec.id}: {done.stderr.strip()}")
        if done.returncode != 0:
            raise RunError(f"{spec.id}: traffic simulation failed: {_format_failure(done)}")
        return Trace.load(trace_file)


def _format_failure(done: subprocess.CompletedProcess[str]) -> str:
    if done.returncode < 0:
        return f"killed by signal {-done.returncode}"
    said = done.stderr.strip()
    last = said.splitlines()[-1] if said.startswith("Traceback") else said
    return last or f"exit code {done.returncode}"
