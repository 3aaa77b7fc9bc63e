"""Every value that the project quotes, in one run: `make bench`.

    python benchmarks/bench.py [--full] [--output output/bench] [NAME ...]

Each benchmark runs in a process of its own, one after the other; the table goes to `OUTPUT.md` and,
for programs, to `OUTPUT.json`. Quick rounds take some ten minutes on two cores. Baselines that are
not installed are left out, and named. Exit code 1 if a benchmark fails or does not end in time; a
value that misses its goal is marked in the table.
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
from measurement import Measurement, format_table

NAMES = [
    *("compile", "traffic", "bodies", "lidar", "radar", "positioning"),
    *("camera", "tracing", "effects", "encode", "frame"),
    *("cores", "resume", "reader", "motion", "export"),
]
PACKAGES = [
    *("advercity", "sapien", "libsumo", "embreex", "numpy", "opencv-python-headless"),
    *("open3d", "open3d-cpu", "mitsuba"),
]
PEERS = {"mitsuba": "Mitsuba", "open3d": "Open3D"}
"""Modules of the baselines that come with the extra `bench`."""
TIME_LIMIT_S = {False: 900, True: 3600}
"""Longest time of one benchmark, quick or full."""


def main() -> int:
    """Measure all and print the table; 1 if a benchmark failed."""
    arguments = _parse_arguments()
    if arguments.only:
        module = importlib.import_module(arguments.only)
        found = module.run_benchmark(quick=not arguments.full)
        arguments.output.write_text(json.dumps([asdict(one) for one in found]))
        return 0
    measurements: list[Measurement] = []
    failed: list[str] = []
    for name in arguments.names or NAMES:
        started = time.perf_counter()
        found = _run_in_subprocess(name, arguments.full)
        measurements += found or []
        failed += [] if found else [name]
        line = f"{name}: {time.perf_counter() - started:.0f} s"
        print(line if found else f"{line}, FAILED", file=sys.stderr, flush=True)
    _write_report(arguments.output, measurements, failed)
    return int(bool(failed))


def _parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(NAMES))
    parser.add_argument("--full", action="store_true", help="more rounds")
    parser.add_argument("--output", type=Path, default=Path("output/bench"))
    parser.add_argument("--only", choices=NAMES, help="write one's values to OUTPUT as JSON")
    return parser.parse_args()


def _run_in_subprocess(name: str, full: bool) -> list[Measurement] | None:
    """Run a benchmark; None if it fails, with its own output on stderr.

    Values come back in a file: programs that it calls print all sorts of things on stdout.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "measurements.json"
        command = [sys.executable, __file__, "--only", name, "--output", str(file)]
        command += ["--full"] if full else []
        try:
            subprocess.run(command, stdout=sys.stderr, check=True, timeout=TIME_LIMIT_S[full])
        except (subprocess.CalledProcessError, subprocess.TimeoutExpired) as error:
            print(f"{name}: {error}", file=sys.stderr)
            return None
        return [Measurement(**one) for one in json.loads(file.read_text())]


def _write_report(output: Path, measurements: list[Measurement], failed: list[str]) -> None:
    """Print the table, and write it as Markdown and as JSON."""
    machine = _describe_machine()
    missing = [
        f"\n{name} is not installed, so nothing is measured against it: pip install"
        " 'advercity[bench]'"
        for module, name in PEERS.items()
        if find_spec(module) is None
    ]
    failures = [f"\n{name} FAILED; see its output above" for name in failed]
    text = "\n".join([*machine, "", format_table(measurements), *missing, *failures])
    print(text)
    output.parent.mkdir(parents=True, exist_ok=True)
    output.with_suffix(".md").write_text(text + "\n")
    # Programs read these keys: they stay.
    rows = [asdict(one) | {"holds": one.meets_goal} for one in measurements]
    record = {"machine": machine, "figures": rows, "failed": failed}
    output.with_suffix(".json").write_text(json.dumps(record, indent=1) + "\n")


def _describe_machine() -> list[str]:
    """Describe machine, device and versions, a line each."""
    installed = [f"{name} {number}" for name in PACKAGES if (number := _find_version(name))]
    return [
        f"{time.strftime('%Y-%m-%d')}, {platform.system()} on {platform.machine()},"
        f" {len(os.sched_getaffinity(0))} cores (load {os.getloadavg()[0]:.1f}),"
        f" Python {platform.python_version()}",
        f"Vulkan: {find_vulkan_device().name}",
        f"Versions: {', '.join(installed)}",
    ]


def _find_version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


if __name__ == "__main__":
    sys.exit(main())
