"""Every figure that the project quotes, in one run: `make bench`.

    python benchmarks/bench.py [--full] [--output output/bench] [NAME ...]

Each benchmark is measured in a process of its own, one after the other; the table goes to
`OUTPUT.md` and, for programs, to `OUTPUT.json`. Quick rounds take some ten minutes on two cores.
Peers that are not installed are left out, and named. Exit code 1 if a benchmark breaks or does not
come to its end; a figure that misses its goal says so in the table.
"""

import argparse
import importlib
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path

from advercity_sapien.backend import find_vulkan_device
from measurement import Figure, table

NAMES = [
    *("compile", "traffic", "lidar", "camera", "tracing", "effects", "encode", "frame", "cores"),
    *("resume", "reader"),
]
PACKAGES = [
    *("advercity", "sapien", "libsumo", "embreex", "numpy", "opencv-python-headless"),
    *("open3d", "open3d-cpu", "mitsuba"),
]
PEERS = {"mitsuba": "Mitsuba", "open3d": "Open3D"}
"""Modules of those that come with the extra `bench`."""
LONGEST_S = {False: 900, True: 3600}
"""That one benchmark may take, quick or full."""


def main() -> int:
    """Measure all and print the table; 1 if a benchmark broke."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(NAMES))
    parser.add_argument("--full", action="store_true", help="more rounds")
    parser.add_argument("--output", type=Path, default=Path("output/bench"))
    parser.add_argument("--only", choices=NAMES, help="write one's figures to OUTPUT as JSON")
    arguments = parser.parse_args()
    if arguments.only:
        figures = importlib.import_module(arguments.only).figures(quick=not arguments.full)
        arguments.output.write_text(json.dumps([asdict(one) for one in figures]))
        return 0
    found: list[Figure] = []
    failed: list[str] = []
    for name in arguments.names or NAMES:
        began = time.perf_counter()
        figures = _in_a_child(name, arguments.full)
        found += figures or []
        failed += [] if figures else [name]
        took = f"{name}: {time.perf_counter() - began:.0f} s"
        print(took if figures else f"{took}, BROKEN", file=sys.stderr, flush=True)
    left_out = [
        f"\n{name} is not installed, so no figure is against it: pip install 'advercity[bench]'"
        for module, name in PEERS.items()
        if find_spec(module) is None
    ]
    broken = [f"\n{name} broke; what it said is above" for name in failed]
    text = "\n".join([*_machine(), "", table(found), *left_out, *broken])
    print(text)
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    arguments.output.with_suffix(".md").write_text(text + "\n")
    rows = [asdict(one) | {"holds": one.holds} for one in found]
    record = {"machine": _machine(), "figures": rows, "failed": failed}
    arguments.output.with_suffix(".json").write_text(json.dumps(record, indent=1) + "\n")
    return int(bool(failed))


def _in_a_child(name: str, full: bool) -> list[Figure] | None:
    """None if the benchmark breaks, which its own words on stderr explain.

    Figures come back in a file: programs that it calls say all sorts of things on stdout.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "figures.json"
        command = [sys.executable, __file__, "--only", name, "--output", str(file)]
        command += ["--full"] if full else []
        try:
            subprocess.run(command, stdout=sys.stderr, check=True, timeout=LONGEST_S[full])
        except (subprocess.CalledProcessError, subprocess.TimeoutExpired) as error:
            print(f"{name}: {error}", file=sys.stderr)
            return None
        return [Figure(**one) for one in json.loads(file.read_text())]


def _machine() -> list[str]:
    """Lines on what was measured where."""
    installed = [f"{name} {number}" for name in PACKAGES if (number := _version(name))]
    return [
        f"{time.strftime('%Y-%m-%d')}, {platform.system()} on {platform.machine()},"
        f" {len(os.sched_getaffinity(0))} cores (load {os.getloadavg()[0]:.1f}),"
        f" Python {platform.python_version()}",
        f"Vulkan: {find_vulkan_device().name}",
        f"Versions: {', '.join(installed)}",
    ]


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


if __name__ == "__main__":
    sys.exit(main())
