"""Runs readers of other projects, in an environment of their own."""

import json
import os
import subprocess
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
PYTHON = Path(os.environ.get("READERS_PYTHON", ROOT / ".venv-readers" / "bin" / "python"))
HINT = "readers of exports are not tested; `scripts/setup_peers` installs them"
needs_readers = pytest.mark.skipif(not PYTHON.exists(), reason=HINT)


def run_reader(script: str, *arguments: str | Path) -> Any:
    """Run a script of this folder with the readers' interpreter; return the JSON it prints last."""
    path = Path(__file__).with_name(script)
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    done = subprocess.run(
        [PYTHON, path, *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        env=environment,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])
