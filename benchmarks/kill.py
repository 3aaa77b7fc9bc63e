"""Kills a run at random again and again, and compares what it leaves with an undisturbed one.

    python benchmarks/kill.py [compiled/ui_fog_day_sparse.json] [--kills 20] [--frames 12]

Each time the same command is started again. Exit code 1 if the trees differ or `verify` finds
anything. Every process is a new one, killed with SIGKILL along with its children.
"""

import argparse
import hashlib
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from advercity.dataset.manifest import verify_dataset


def main() -> int:
    """Run, kill, compare; 1 if anything differs."""
    arguments = _arguments()
    moments = random.Random(arguments.seed)
    with tempfile.TemporaryDirectory() as folder:
        whole, killed = Path(folder) / "whole", Path(folder) / "killed"
        begin = time.perf_counter()
        subprocess.run(_command(arguments, whole), check=True)
        whole_s = time.perf_counter() - begin
        print(f"undisturbed: {whole_s:.1f} s, {len(_tree(whole))} files")
        for number in range(arguments.kills):
            patience_s = moments.uniform(0.0, whole_s)
            code = _run_for(_command(arguments, killed), patience_s)
            print(f"kill {number + 1}: after {patience_s:.1f} s, {_state(code)}, {_done(killed)}")
        subprocess.run(_command(arguments, killed), check=True)
        problems = verify_dataset(killed)
        same = _tree(killed) == _tree(whole)
        print(f"after the last start: {len(problems)} problems, {'equal' if same else 'DIFFERENT'}")
    return 0 if same and not problems else 1


def _command(arguments: argparse.Namespace, output: Path) -> list[str]:
    return [
        *(sys.executable, "-c", "from advercity.cli import main; main()"),
        *("run", str(arguments.spec), "--output", str(output)),
        *("--profile", "preview", "--scale", str(arguments.scale)),
        *("--frames", f"0:{arguments.frames}"),
    ]


def _run_for(command: list[str], patience_s: float) -> int:
    """Exit code of a process that is given so long."""
    process = subprocess.Popen(command, start_new_session=True, stdout=subprocess.DEVNULL)
    try:
        return process.wait(patience_s)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        return process.wait()


def _state(code: int) -> str:
    return "killed" if code == -signal.SIGKILL else f"ended with {code}"


def _done(root: Path) -> str:
    frames = {path.name[:6] for path in root.glob("*/*/[0-9]*.yaml")}
    return f"{len(frames)} frames there"


def _tree(root: Path) -> dict[str, str]:
    return {
        str(path.relative_to(root)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in root.rglob("*")
        if path.is_file()
    }


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("spec", type=Path, nargs="?", default="compiled/ui_fog_day_sparse.json")
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--frames", type=int, default=12)
    parser.add_argument("--scale", type=float, default=0.05)
    parser.add_argument("--seed", type=int, default=1)
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
