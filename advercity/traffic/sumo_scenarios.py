"""Run SUMO scenarios of other authors once, in a child process, and record them."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from advercity_dsl import ActorClass
from numpy.typing import NDArray

from advercity.compiler.recorded_roads import Recording
from advercity.documents import parse_json
from advercity.errors import InputError, RunError, report_temporary_errors
from advercity.foreign.ledger import Ledger
from advercity.recordings.sumo_scenario import read_sumo_scenario
from advercity.recordings.track_file import MARGIN_S
from advercity.recordings.tracks import MAX_GAP_S, MAX_SIZE_M, MAX_SPEED_M_S, Track
from advercity.traffic.simulation import ERROR_MARK, EXIT_BAD_INPUT

RECORDED_S = 300.0
"""Recorded time of a scenario without a given end."""
TIMEOUT_S = 1800
MAX_NAME_LENGTH = 50
"""Maximum length of a name in a track's id of at most 64 characters; the rest is for numbers."""
_CLASS_NAMES: dict[ActorClass, str] = {
    "car": "passenger private taxi hov evehicle vip authority army ignoring custom1 custom2",
    "van": "delivery emergency",
    "truck": "truck trailer bus coach",
    "motorcycle": "motorcycle moped",
    "bicycle": "bicycle scooter",
}
CLASSES: dict[str, ActorClass] = {
    name: kind for kind, names in _CLASS_NAMES.items() for name in names.split()
}
"""Classes by SUMO's; rails and ships have none."""


def load_sumo_scenario(
    path: Path, work: Path, *, from_s: float | None = None, to_s: float | None = None
) -> Recording:
    """Run a scenario and record its road users and lights.

    Args:
        path: SUMO configuration (`*.sumocfg`).
        work: Folder for its network; keep it as long as you use the recording.
        from_s: Begin of the time to record; None is the begin of the simulation.
        to_s: End of it; None is `RECORDED_S` later.

    Raises:
        InputError: The scenario cannot be read, is refused, or has nobody in this time.
        RunError: SUMO fails.
    """
    ledger = Ledger()
    scenario = read_sumo_scenario(path, ledger)
    begins_s = scenario.begin_s if from_s is None else from_s
    ends_s = begins_s + RECORDED_S if to_s is None else to_s
    if scenario.end_s is not None and to_s is None:
        ends_s = min(ends_s, scenario.end_s)
    if not scenario.begin_s <= begins_s < ends_s <= (scenario.end_s or ends_s):
        end = "" if scenario.end_s is None else f" to {scenario.end_s:g}"
        raise InputError(
            f"{path}: `from` {begins_s:g}, `to` {ends_s:g}: its simulation is from"
            f" {scenario.begin_s:g}{end} s"
        )
    site = work / f"{path.name.partition('.')[0]}.net.xml"
    site.write_bytes(scenario.network)
    with report_temporary_errors(), TemporaryDirectory() as name:
        options = scenario.write(Path(name))
        found = _run_worker(path, options, Path(name), begins_s - MARGIN_S, ends_s + MARGIN_S)
    tracks = list(_build_tracks(found, ledger))
    if not tracks:
        raise InputError(f"{path}: nobody moves in it from {begins_s:g} to {ends_s:g} s")
    programs = {light: [tuple(item) for item in rows] for light, rows in found["lights"].items()}
    return Recording(path, tracks, site, left_out=ledger.left_out, programs=programs)


def _run_worker(
    path: Path, options: Sequence[str], folder: Path, from_s: float, to_s: float
) -> dict[str, Any]:
    output = folder / "recorded.json"
    command = [sys.executable, "-m", "advercity.traffic.scenario_worker", str(os.getpid())]
    try:
        done = subprocess.run(  # noqa: S603 - our own module, options that were checked
            [*command, str(output), f"{from_s:g}", f"{to_s:g}", *options],
            capture_output=True,
            text=True,
            errors="replace",
            timeout=TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise InputError(
            f"{path}: SUMO takes longer than {TIMEOUT_S} s; take a shorter time with `from`, `to`"
        ) from None
    error = " ".join(done.stderr.rpartition(ERROR_MARK)[2].split())[-600:]
    if done.returncode == EXIT_BAD_INPUT:
        said = done.stderr.partition(ERROR_MARK)[0]
        causes = [line for line in said.splitlines() if line.startswith("Error:")]
        raise InputError(f"{path}: {error}", *(f"SUMO: {line[7:307]}" for line in causes[:3]))
    if done.returncode != 0:
        raise RunError(f"{path}: SUMO fails: {error or f'exit code {done.returncode}'}")
    return parse_json(output.read_bytes(), output)


def _build_tracks(found: dict[str, Any], ledger: Ledger) -> Iterator[Track]:
    taken: set[str] = set()
    for name, rows in found["vehicles"].items():
        vehicle_class, *size = found["kinds"][name]
        actor_class = CLASSES.get(vehicle_class)
        if actor_class is None:
            ledger.leave_out(
                f"vehicle of class {vehicle_class}", plural=f"{vehicle_class} vehicles"
            )
            continue
        length_m = size[0]
        if length_m > MAX_SIZE_M:
            kind = f"longer than {MAX_SIZE_M:g} m"
            ledger.leave_out(f"vehicle {kind}", plural=f"vehicles {kind}")
            continue
        yield from _split_track(name, actor_class, tuple(size), rows, length_m / 2, taken, ledger)
    for name, rows in found["people"].items():
        yield from _split_track(name, "pedestrian", (0.0, 0.0, 0.0), rows, 0.0, taken, ledger)


def _split_track(
    name: str,
    actor_class: ActorClass,
    size: tuple[float, ...],
    rows: Sequence[Sequence[float]],
    ahead_m: float,
    taken: set[str],
    ledger: Ledger,
) -> Iterator[Track]:
    """Build the tracks of one road user; after a jump it continues as another.

    Args:
        name: SUMO's id.
        actor_class: Class.
        size: Length, width and height in metres.
        rows: Times, places and angles in SUMO's form.
        ahead_m: Distance of those places from the middle of the box.
        taken: Used ids.
        ledger: Where to record parts that are too short.
    """
    table = np.array(rows, dtype=np.float64)
    # SUMO's angles are clockwise from north.
    headings = np.pi / 2 - np.radians(table[:, 3])
    ahead = ahead_m * np.column_stack([np.cos(headings), np.sin(headings)])
    times_s, places = table[:, 0], table[:, 1:3] - ahead
    for part in _find_runs(times_s, places):
        if len(times_s[part]) < 2:
            ledger.leave_out(
                "motion of a single step in the recorded time",
                plural="motions of a single step in the recorded time",
            )
            continue
        yield Track(
            id=_make_id(name, taken),
            actor_class=actor_class,
            size=(size[0], size[1], size[2]),
            times_s=times_s[part],
            places=places[part],
            headings_rad=np.unwrap(headings[part]),
        )


def _find_runs(times_s: NDArray[np.float64], places: NDArray[np.float64]) -> Iterator[slice]:
    """Find the parts of a motion without gaps and jumps."""
    steps_s = np.diff(times_s)
    moved_m = np.linalg.norm(np.diff(places, axis=0), axis=1)
    breaks = np.flatnonzero((steps_s > MAX_GAP_S) | (moved_m > MAX_SPEED_M_S * steps_s)) + 1
    edges = [0, *breaks.tolist(), len(times_s)]
    yield from (slice(first, last) for first, last in pairwise(edges))


def _make_id(name: str, taken: set[str]) -> str:
    """Make a unique id of permitted characters."""
    plain = re.sub(r"[^A-Za-z0-9_.:-]", "_", name)[:MAX_NAME_LENGTH]
    found, number = plain, 1
    while found in taken:
        number += 1
        found = f"{plain}.part{number}"
    taken.add(found)
    return found
