"""Kills commands at random moments, and compares the resumed result with an undisturbed one.

    python benchmarks/kill_and_resume.py [SPEC] [--kills 20] [--other-kills 0] [--frames 12]
        [--backend sapien] [--commands split stats "export kitti"]

The same command is started again after each kill, which comes when a random number of bytes is
written; when it ends, the trees are compared and the next series starts from an empty folder. Exit
code 1 if any of them differs, `verify` finds a problem, or a file of others, which is put among
those of the command after each kill, is lost. Only the command's own process is killed (SIGKILL);
workers of `--jobs` notice that by themselves.

`--kills` are those of `run`, `--other-kills` those of each other command that writes: they work on
the dataset of the undisturbed run. `--commands` are the first words of those that are wanted.
"""

import argparse
import hashlib
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import redirect_stdout, suppress
from multiprocessing import get_context
from multiprocessing.context import ForkProcess
from pathlib import Path

from advercity.cli import main as main_of_advercity
from advercity.dataset.verification import verify_dataset
from advercity.exports.export_folder import is_export, verify_export
from advercity.exports.registry import load_export_formats

DATASET, OUTPUT = "DATASET", "OUTPUT"
"""What stands for the folder of the undisturbed run, and for the one that a command writes."""
OTHER_COMMANDS = (
    *(f"export {name} DATASET --output OUTPUT" for name in ("kitti", "nuscenes", "mcap")),
    *(f"export {name} DATASET --output OUTPUT" for name in ("openscenario", "webdataset")),
    "split DATASET --output OUTPUT",
    "stats DATASET --output OUTPUT",
    "video DATASET --output OUTPUT --kind mosaic",
    "compile library --output OUTPUT",
    "schema --output OUTPUT",
)
STRANGER = "notes_of_others.txt"
KILLED_RATIO = 0.8
"""Share of starts that are killed; the others end a series."""
MEAN_DELAY_S = 0.05
"""From the moment when a command has written so much to its kill: it may move or tidy files."""
POLLING_S = 0.02


def main() -> int:
    """Run, kill, compare; 1 if anything differs."""
    arguments = _arguments()
    for name in ("kitti", "nuscenes", "mcap", "openscenario", "webdataset"):
        load_export_formats().found[name].load()  # once, rather than in every process
    moments = random.Random(arguments.seed)
    with tempfile.TemporaryDirectory() as folder:
        dataset = Path(folder) / "dataset"
        run = _build_run_arguments(arguments)
        wrong = _kill_command(run, dataset, arguments.kills, moments)
        if arguments.other_kills:
            for command in _choose_commands(arguments.commands):
                words = command.replace(DATASET, str(dataset)).split()
                whole = Path(folder) / "other"
                wrong += _kill_command(words, whole, arguments.other_kills, moments)
                shutil.rmtree(whole)
    return min(1, wrong)


def _choose_commands(beginnings: Sequence[str]) -> list[str]:
    return [command for command in OTHER_COMMANDS if command.startswith(tuple(beginnings))]


def _kill_command(
    command: Sequence[str], whole: Path, wanted_kills: int, moments: random.Random
) -> int:
    """Run a command into `whole`, kill it elsewhere, and return how many results differ."""
    killed = whole.with_name("killed")
    _run_to_end(command, whole)
    whole_bytes = _sum_sizes(whole)
    print(
        f"{' '.join(command[:2])}: {whole_bytes} bytes, {len(_hash_tree(whole))} files", flush=True
    )
    kills, wrong, series, has_stranger = 0, 0, 1, False
    while kills < wanted_kills:
        left = max(0, whole_bytes - _sum_sizes(killed))
        after_bytes = moments.uniform(0, left)
        is_killed = moments.random() < KILLED_RATIO and _run_and_kill(
            command, killed, int(after_bytes), moments.expovariate(1 / MEAN_DELAY_S)
        )
        if is_killed:
            kills += 1
            print(
                f"kill {kills}: after {after_bytes:.0f} bytes, {_format_progress(killed)}",
                flush=True,
            )
            has_stranger = _add_stranger(killed) or has_stranger
        else:
            _run_to_end(command, killed)
            wrong += _has_differences(killed, whole, has_stranger)
            series, has_stranger = series + 1, False
            shutil.rmtree(killed)
    _run_to_end(command, killed)
    wrong += _has_differences(killed, whole, has_stranger)
    shutil.rmtree(killed)
    print(f"{kills} kills in {series} series, {wrong} of them different", flush=True)
    return wrong


def _build_run_arguments(arguments: argparse.Namespace) -> list[str]:
    return [
        *("run", str(arguments.spec), "--output", OUTPUT, "--jobs", str(arguments.jobs)),
        *("--profile", "preview", "--scale", str(arguments.scale)),
        *("--backend", arguments.backend),
        *("--frames", f"0:{arguments.frames}"),
    ]


def _start(command: Sequence[str], output: Path) -> ForkProcess:
    """Start a command in a process of its own, which has all modules of this one."""
    words = [str(output) if word == OUTPUT else word for word in command]
    process = get_context("fork").Process(target=_run_command, args=(words,))
    process.start()
    return process


def _run_command(words: list[str]) -> None:
    os.setsid()
    sys.argv = ["advercity", *words]
    with Path(os.devnull).open("w") as nowhere, redirect_stdout(nowhere):
        main_of_advercity()


def _run_to_end(command: Sequence[str], output: Path) -> None:
    process = _start(command, output)
    process.join()
    assert process.exitcode == 0, f"exit code {process.exitcode} of {command}"


def _run_and_kill(command: Sequence[str], output: Path, after_bytes: int, delay_s: float) -> bool:
    """Kill a command some time after it has written so much; False if it ended before."""
    # Unfinished files may be beside the output; how busy the machine is must not matter.
    before = _sum_sizes(output.parent)
    process = _start(command, output)
    while process.is_alive() and _sum_sizes(output.parent) - before <= after_bytes:
        time.sleep(POLLING_S)
    process.join(delay_s)
    if process.is_alive():
        os.killpg(process.pid or 0, signal.SIGKILL)
    process.join()
    assert process.exitcode in (0, -signal.SIGKILL), f"exit code {process.exitcode} of {command}"
    return process.exitcode != 0


def _sum_sizes(folder: Path) -> int:
    """Sum the sizes of the files in a folder, some of which may vanish meanwhile."""
    total = 0
    for parent, _, names in os.walk(folder):
        for name in names:
            with suppress(FileNotFoundError):
                total += os.lstat(f"{parent}/{name}").st_size
    return total


def _add_stranger(folder: Path) -> bool:
    """Put a file of others into a folder that a command has claimed; False if it has not yet.

    An export refuses a folder with files of others and no manifest.
    """
    is_claimed = any(
        path.is_file() for pattern in ("*", "*/manifest.json") for path in folder.glob(pattern)
    )
    if is_claimed:
        (folder / STRANGER).write_text("of others")
    return is_claimed


def _has_differences(killed: Path, whole: Path, has_stranger: bool) -> bool:
    """Whether the trees differ, a file of others has changed, or `verify` finds a problem."""
    found = verify_export(killed)[0] if is_export(killed) else []
    if any(killed.glob("*/manifest.json")):
        found = verify_dataset(killed)
    problems = [problem for problem in found if problem.is_damage]
    is_lost = has_stranger and (killed / STRANGER).read_text() != "of others"
    differ = _hash_tree(killed) != _hash_tree(whole) or is_lost
    print(f"done: {len(problems)} problems, {'DIFFERENT' if differ else 'equal'}", flush=True)
    return differ or bool(problems)


def _format_progress(root: Path) -> str:
    frames = {path.name[:6] for path in root.glob("*/*/[0-9]*.yaml")}
    return f"{len(frames)} frames, {len(_hash_tree(root))} files"


def _hash_tree(root: Path) -> dict[str, str]:
    """Hash the files of a folder, without that of others; links as what they lead to."""
    return {
        str(path.relative_to(root)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in root.rglob("*")
        if path.is_file() and path.name != STRANGER
    }


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("spec", type=Path, nargs="?", default="compiled/ui_fog_day_sparse.json")
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--other-kills", type=int, default=0)
    parser.add_argument("--commands", nargs="+", default=[""])
    parser.add_argument("--frames", type=int, default=12)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--backend", default="sapien")
    parser.add_argument("--scale", type=float, default=0.05)
    parser.add_argument("--seed", type=int, default=1)
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
