"""What encoding, writing and verifying cost against rendering, as ratios.

    python benchmarks/encode.py [compiled/ui_fog_day_sparse.json] [--frames 0:20] [--profile full]

Times the same frames with and without the files being made, in turns, and takes the least of each:
`overhead` is what a run takes longer for writing behind rendering. `verify` is what a scenario of
all its frames would take, by the time of these.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from unittest.mock import patch

from advercity.compiler import read_spec
from advercity.dataset.manifest import Manifest, verify
from advercity.dataset.writer import DatasetWriter
from advercity.runner import Options, parse_frames, run_scenario

ROUNDS = 3


def main() -> int:
    """Measure and print; 1 if the overhead is above 15 % or a verification above 10 s."""
    arguments = _arguments()
    spec = read_spec(arguments.spec)
    frames = parse_frames(arguments.frames)
    with tempfile.TemporaryDirectory() as folder:
        options = Options(output=Path(folder), profile=arguments.profile, frames=frames, fresh=True)
        run_scenario(spec, options)
        with_files: list[float] = []
        without: list[float] = []
        for _ in range(ROUNDS):
            with patch.object(DatasetWriter, "write"):
                without.append(_seconds(lambda: run_scenario(spec, options)))
            with_files.append(_seconds(lambda: run_scenario(spec, options)))
        scenario = Path(folder) / spec.id
        manifest = Manifest.load(scenario)
        verify_s = min(_seconds(lambda: verify(scenario)) for _ in range(ROUNDS))
        verify_s *= manifest.length / len(manifest.frames)
    overhead = min(with_files) / min(without) - 1
    print(f"{len(manifest.frames)} frames, {len(manifest.files)} files")
    print(f"rendering and sensing: {min(without):.1f} s; with files: {min(with_files):.1f} s")
    print(f"overhead: {overhead:.1%}")
    print(f"verify: {verify_s:.1f} s for all {manifest.length} frames")
    return int(overhead > 0.15 or verify_s > 10)


def _seconds(act: Callable[[], object]) -> float:
    begin = time.perf_counter()
    act()
    return time.perf_counter() - begin


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("spec", type=Path, nargs="?", default="compiled/ui_fog_day_sparse.json")
    parser.add_argument("--frames", default="0:20")
    parser.add_argument("--profile", default="preview")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
