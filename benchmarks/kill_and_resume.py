"""Kills a run at random moments, and compares the resumed result with that of an undisturbed run.

    python benchmarks/kill_and_resume.py [SPEC] [--kills 20] [--frames 12] [--backend sapien]

The same command is started again after each kill; when it ends, the trees are compared and the next
series starts from an empty folder. Exit code 1 if any of them differs or `verify` finds a problem.
Only the run's own process is killed (SIGKILL); its `--jobs` workers notice that by themselves.
"""

import argparse
import hashlib
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from advercity.dataset.verification import verify_dataset


def main() -> int:
    """Run, kill, compare; 1 if anything differs."""
    arguments = _arguments()
    moments = random.Random(arguments.seed)
    with tempfile.TemporaryDirectory() as folder:
        whole, killed = Path(folder) / "whole", Path(folder) / "killed"
        begin = time.perf_counter()
        subprocess.run(_build_command(arguments, whole), check=True, stdout=subprocess.DEVNULL)
        whole_s = time.perf_counter() - begin
        print(f"undisturbed: {whole_s:.1f} s, {len(_hash_tree(whole))} files")
        kills, wrong, series = 0, 0, 1
        while kills < arguments.kills:
            delay_s = moments.uniform(0.3, 0.95) * whole_s
            begin = time.perf_counter()
            if _run_and_kill(_build_command(arguments, killed), delay_s):
                kills += 1
                print(
                    f"kill {kills}: after {delay_s:.1f} s, {_format_progress(killed)}", flush=True
                )
            else:
                # The machine may be less busy than during the first run.
                whole_s = max(0.8 * whole_s, time.perf_counter() - begin)
                wrong += _has_differences(killed, whole)
                series += 1
                shutil.rmtree(killed)
        subprocess.run(_build_command(arguments, killed), check=True, stdout=subprocess.DEVNULL)
        wrong += _has_differences(killed, whole)
        print(f"{kills} kills in {series} series, {wrong} of them different")
    return min(1, wrong)


def _build_command(arguments: argparse.Namespace, output: Path) -> list[str]:
    return [
        *(sys.executable, "-c", "from advercity.cli import main; main()"),
        *("run", str(arguments.spec), "--output", str(output), "--jobs", str(arguments.jobs)),
        *("--profile", "preview", "--scale", str(arguments.scale)),
        *("--backend", arguments.backend),
        *("--frames", f"0:{arguments.frames}"),
    ]


def _run_and_kill(command: list[str], delay_s: float) -> bool:
    """Start a process and kill it after a delay; False if it ended before."""
    process = subprocess.Popen(command, start_new_session=True, stdout=subprocess.DEVNULL)
    try:
        code = process.wait(delay_s)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        return True
    if code:
        raise subprocess.CalledProcessError(code, command)
    return False


def _has_differences(killed: Path, whole: Path) -> bool:
    """Whether the trees differ, or `verify` finds a problem."""
    problems = verify_dataset(killed)
    differ = _hash_tree(killed) != _hash_tree(whole)
    print(f"done: {len(problems)} problems, {'DIFFERENT' if differ else 'equal'}")
    return differ or bool(problems)


def _format_progress(root: Path) -> str:
    frames = {path.name[:6] for path in root.glob("*/*/[0-9]*.yaml")}
    return f"{len(frames)} frames"


def _hash_tree(root: Path) -> dict[str, str]:
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
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--backend", default="sapien")
    parser.add_argument("--scale", type=float, default=0.05)
    parser.add_argument("--seed", type=int, default=1)
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
