"""Runs one frame of every compiled spec at a tiny scale, and tells which fail.

    python benchmarks/every_spec.py [compiled] [--scale 0.05]

Exit code 1 if any fails. The data go to a temporary folder; traces come from the usual cache.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

from advercity.compiler import read_spec
from advercity.errors import AdvercityError
from advercity.pipeline import RunOptions, run_scenario


def main() -> int:
    """Run them all; the number of failures, at most 1."""
    arguments = _arguments()
    failed = 0
    with tempfile.TemporaryDirectory() as folder:
        options = RunOptions(
            output=Path(folder),
            profile="preview",
            scale=arguments.scale,
            frames=slice(0, 1),
        )
        for path in sorted(arguments.folder.glob("*.json")):
            begin = time.perf_counter()
            try:
                scenario = run_scenario(read_spec(path), options)
            except AdvercityError as error:
                failed += 1
                print(f"FAILED  {path.stem}: {error}")
                continue
            files = sum(1 for file in scenario.rglob("*") if file.is_file())
            print(f"ok      {path.stem}: {files} files, {time.perf_counter() - begin:.1f} s")
    print(f"{failed} failed")
    return min(failed, 1)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=Path("compiled"))
    parser.add_argument("--scale", type=float, default=0.05)
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
