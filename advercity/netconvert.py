"""Runs SUMO's `netconvert`."""

import os
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import sumo

from advercity.errors import RunError

TIMEOUT_S = 120
COMMON = {
    "offset.disable-normalization": "true",
    "walkingareas": "true",
    "no-turnarounds": "true",
    "precision": "3",
    "xml-validation": "never",
}
"""World coordinates to the millimetre, and ways for people on foot."""


@dataclass(frozen=True)
class Outcome:
    """What became of a run: whether it wrote the network, and what it had to say."""

    succeeded: bool
    said: str


def netconvert(options: Mapping[str, str], output: Path) -> Outcome:
    """Write a network.

    Args:
        options: Over the `COMMON` ones; files in them are relative to the folder of `output`.
        output: The network.

    Raises:
        RunError: The program is missing or hangs.
    """
    chosen = {**COMMON, **options, "output-file": output.name}
    program = str(Path(sumo.SUMO_HOME) / "bin" / "netconvert")
    command = [program, *(word for name, value in chosen.items() for word in (f"--{name}", value))]
    try:
        done = subprocess.run(  # noqa: S603  the program is the wheel's own
            command,
            cwd=output.parent,
            env={**os.environ, "SUMO_HOME": sumo.SUMO_HOME},
            capture_output=True,
            text=True,
            errors="replace",
            timeout=TIMEOUT_S,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise RunError(f"netconvert does not run: {error}; is eclipse-sumo installed?") from error
    succeeded = done.returncode == 0 and output.exists()
    said = done.stderr.strip()
    return Outcome(succeeded, said or ("" if succeeded else done.stdout.strip()))
