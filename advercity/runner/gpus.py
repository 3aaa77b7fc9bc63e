"""Which graphics cards there are to share out."""

import os
import shutil
import subprocess
from collections.abc import Iterable

VARIABLE = "CUDA_VISIBLE_DEVICES"


def visible_gpus() -> tuple[str, ...]:
    """Names of the cards that a process may see, as `CUDA_VISIBLE_DEVICES` takes them."""
    chosen = os.environ.get(VARIABLE)
    if chosen is not None:
        return tuple(name.strip() for name in chosen.split(",") if name.strip())
    program = shutil.which("nvidia-smi")
    if program is None:
        return ()
    command = [program, "--query-gpu=index", "--format=csv,noheader"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603
    return tuple(done.stdout.split()) if done.returncode == 0 else ()


def seen_by(places: Iterable[int], gpus: tuple[str, ...]) -> dict[str, str]:
    """Variables for one who has some places among all that run side by side: a card for each."""
    if not gpus:
        return {}
    return {VARIABLE: ",".join(dict.fromkeys(gpus[place % len(gpus)] for place in places))}
