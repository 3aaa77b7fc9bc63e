"""Every figure that the project quotes, in one run: `make bench`.

    python benchmarks/bench.py [--full] [--output output/bench] [NAME ...]

Each benchmark is measured in a process of its own, one after the other; the table goes to
`OUTPUT.md` and, for programs, to `OUTPUT.json`. Quick rounds take some ten minutes on two cores.
Exit code 1 if a figure is not as wanted, or a benchmark fails.
"""

import argparse
import importlib
import json
import os
import platform
import subprocess
import sys
import time
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from advercity_sapien.device import probe
from figures import Figure, table

NAMES = ["compile", "traffic", "lidar", "camera", "tracing", "encode", "frame", "resume"]
PACKAGES = [
    *("advercity", "sapien", "libsumo", "embreex", "numpy", "opencv-python-headless"),
    *("open3d", "open3d-cpu", "mitsuba"),
]


def main() -> int:
    """Measure all and print the table; 1 if anything is not as wanted."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(NAMES))
    parser.add_argument("--full", action="store_true", help="more rounds")
    parser.add_argument("--output", type=Path, default=Path("output/bench"))
    parser.add_argument("--only", choices=NAMES, help="print one benchmark's figures as JSON")
    arguments = parser.parse_args()
    if arguments.only:
        print(json.dumps([asdict(one) for one in _figures(arguments.only, arguments.full)]))
        return 0
    found: list[Figure] = []
    failed: list[str] = []
    for name in arguments.names or NAMES:
        began = time.perf_counter()
        figures = _in_a_child(name, arguments.full)
        found += figures or []
        failed += [] if figures else [name]
        took = f"{name}: {time.perf_counter() - began:.0f} s"
        print(took if figures else f"{took}, FAILED", file=sys.stderr, flush=True)
    text = "\n".join([*_machine(), "", table(found), *(f"\n{name} failed" for name in failed)])
    print(text)
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    arguments.output.with_suffix(".md").write_text(text + "\n")
    rows = [asdict(one) | {"holds": one.holds} for one in found]
    record = {"machine": _machine(), "figures": rows, "failed": failed}
    arguments.output.with_suffix(".json").write_text(json.dumps(record, indent=1) + "\n")
    return int(bool(failed) or not all(one.holds for one in found))


def _figures(name: str, full: bool) -> list[Figure]:
    return importlib.import_module(name).figures(quick=not full)


def _in_a_child(name: str, full: bool) -> list[Figure] | None:
    """None if the benchmark fails, which its own words on stderr explain."""
    command = [sys.executable, __file__, "--only", name, *(["--full"] if full else [])]
    child = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False)
    if child.returncode:
        return None
    return [Figure(**one) for one in json.loads(child.stdout.splitlines()[-1])]


def _machine() -> list[str]:
    """Lines on what was measured where."""
    installed = [f"{name} {number}" for name in PACKAGES if (number := _version(name))]
    return [
        f"{time.strftime('%Y-%m-%d')}, {platform.system()} on {platform.machine()},"
        f" {len(os.sched_getaffinity(0))} cores (load {os.getloadavg()[0]:.1f}),"
        f" Python {platform.python_version()}",
        f"Vulkan: {probe().name}",
        f"Versions: {', '.join(installed)}",
    ]


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


if __name__ == "__main__":
    sys.exit(main())
