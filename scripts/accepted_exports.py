#!/usr/bin/env python
"""Print a table of the readers of others that exports are tested with: accepted or not.

`scripts/setup_peers` sets up the environment of these readers. Each test exports a small dataset,
reads it with them and compares values. Arguments are formats; without any, all are tested. A reader
that is not installed is `missing`, and its format `not tested`.
"""

import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PYTHON = os.environ.get("READERS_PYTHON", ROOT / ".venv-readers" / "bin" / "python")
OPENCOOD = os.environ.get("OPENCOOD_PYTHON", "")
"""Interpreter that has OpenCOOD or HEAL, which need PyTorch and no package index has."""
EXPORTS = {
    "adver_city": (),
    "clouds": ("open3d", "pypcd4"),
    "coco": ("pycocotools",),
    "croissant": ("mlcroissant",),
    "kitti": ("nuscenes-devkit", "pykitti"),
    "mcap": ("mcap-ros2-support", "rosbags"),
    "nuscenes": ("nuscenes-devkit",),
    "openlabel": ("vcd", "kognic-openlabel"),
    "openscenario": ("asam-qc-openscenarioxml",),
    "osi": ("betterosi",),
    "tidy_opendrive": ("asam-qc-opendrive",),
}
"""Distributions by the name of the tests, `tests/exports/test_<name>.py`."""
LOADERS = {"opencood": "OpenCOOD or HEAL"}
"""Readers of datasets themselves, by the name of the tests, `tests/integration/test_<name>.py`."""
FIND_VERSION = "import importlib.metadata, sys; print(importlib.metadata.version(sys.argv[1]))"


def find_version(reader: str) -> str:
    """Find the version of a reader in its environment; `missing` if it is not installed."""
    command = [PYTHON, "-c", FIND_VERSION, reader]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=True)  # noqa: S603 - ours
    except (OSError, subprocess.CalledProcessError):
        return "missing"
    return done.stdout.strip()


def name_readers(name: str) -> str:
    """Name the readers of a format with their versions."""
    if name in LOADERS:
        return f"{LOADERS[name]}, {OPENCOOD or 'missing: OPENCOOD_PYTHON names no interpreter'}"
    found = [f"{reader} {find_version(reader)}" for reader in EXPORTS[name]]
    return ", ".join(found) or "the original's steps, in the test"


def check_format(name: str) -> str:
    """Run the tests of a format, and return whether its readers accept it."""
    folder = "integration" if name in LOADERS else "exports"
    command = [sys.executable, "-m", "pytest", "-q", f"tests/{folder}/test_{name}.py"]
    done = subprocess.run(  # noqa: S603 - the tests of this repository
        command, capture_output=True, text=True, check=False, cwd=ROOT
    )
    counts = re.findall(r"\d+ (?:passed|failed|skipped|errors?)", done.stdout)
    if done.returncode:
        return f"no: {', '.join(counts)}"
    return "not tested" if any("skipped" in count for count in counts) else "yes"


def main() -> None:
    """Print a row for every format."""
    row = "{:16} {:62} {}".format
    print(row("format", "readers", "accepted, values compared"))
    for name in sys.argv[1:] or (*EXPORTS, *LOADERS):
        print(row(name, name_readers(name), check_format(name)), flush=True)


if __name__ == "__main__":
    main()
