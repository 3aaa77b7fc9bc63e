"""OpenSCENARIO files: which are read, and whether their actors move as road users do.

    python benchmarks/scenarios.py [--root FOLDER] [--esmini PROGRAM] FILE_OR_FOLDER ...

A row of the table has the file, the number of its actors, how long they move, and what is
conspicuous in their tracks alone, without the player's own state: a step that is longer than the
speeds around it allow, an acceleration of over 12 m/s², a heading more than 30° off the way, an
actor that never moves though the scenario gives it a speed. A file may want all of these: steps of
speed, ends of roads, trajectories with corners.

`--esmini` names esmini's program, which plays each file, too, with `--disable_controllers`; the
last column is how far the centres of boxes are from its own, median / maximum in m. The last table
counts the reasons for which files are refused.
"""

import argparse
import re
import subprocess
import sys
import tempfile
import traceback
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from advercity.errors import InputError
from advercity.recordings.openscenario.scenario import RecordedScenario, read_scenario
from advercity.recordings.tracks import Track

Floats = NDArray[np.float64]
MAX_JUMP_M = 0.5
MAX_ACCELERATION_M_S2 = 12.0
MAX_TURNED_DEG = 30.0
BACKWARDS_DEG = 150.0
MIN_SPEED_M_S = 1.0
"""Slower ones may turn on the spot."""
ESMINI_STEP_S = 0.01
ESMINI_TIMEOUT_S = 60
HEADER = ("file", "actors", "s", "conspicuous", "from esmini, m")


@dataclass(frozen=True)
class Result:
    """A row of the table, and why the file is refused, if it is."""

    row: tuple[str, ...]
    refusal: str = ""
    is_traceback: bool = False


def check_motion(track: Track) -> Iterator[str]:
    """Describe what no road user does, or few."""
    way = np.diff(track.places, axis=0)
    length_m, step_s = np.hypot(*way.T), np.diff(track.times_s)
    speed_m_s = length_m / step_s
    around = np.maximum(np.append(speed_m_s[1:], 0.0), np.append(0.0, speed_m_s[:-1]))
    excess_m = length_m - around * step_s
    if excess_m.max() > MAX_JUMP_M:
        yield f"jumps {excess_m.max():.1f} m at {_find_time(track, excess_m)}"
    acceleration = np.abs(np.diff(speed_m_s)) / np.maximum(step_s[1:] + step_s[:-1], 0.04) * 2
    if len(acceleration) and acceleration.max() > MAX_ACCELERATION_M_S2:
        at = _find_time(track, acceleration)
        index = int(acceleration.argmax())
        before, after = speed_m_s[index : index + 2]
        yield f"{before:.1f} to {after:.1f} m/s at {at}"
    heading = (track.headings_rad[1:] + track.headings_rad[:-1]) / 2
    turned = np.angle(np.exp(1j * (np.arctan2(way[:, 1], way[:, 0]) - heading)))
    turned_deg = np.where(speed_m_s > MIN_SPEED_M_S, np.abs(np.degrees(turned)), 0.0)
    if (turned_deg > BACKWARDS_DEG).any():
        yield "drives backwards"
    aside_deg = np.where(turned_deg > BACKWARDS_DEG, 0.0, turned_deg)
    if aside_deg.max() > MAX_TURNED_DEG:
        yield f"looks {aside_deg.max():.0f}° off its way at {_find_time(track, aside_deg)}"


def _find_time(track: Track, values: Floats) -> str:
    return f"{track.times_s[int(values.argmax())]:.2f} s"


def list_driven(path: Path) -> set[str]:
    """List the entities to which a file gives a speed in the beginning."""
    found: set[str] = set()
    for private in ElementTree.parse(path).getroot().iterfind("Storyboard/Init/Actions/Private"):
        speeds = [item.get("value", "") for item in private.iter("AbsoluteTargetSpeed")]
        if any(re.search(r"[1-9$]", speed) for speed in speeds):
            found.add(private.get("entityRef", ""))
    return found


def describe_scenario(path: Path, scenario: RecordedScenario) -> str:
    """Describe all that is conspicuous in a scenario, once for actors that do the same."""
    driven = list_driven(path)
    remarks: dict[str, list[str]] = {}
    for track in scenario.tracks:
        if np.ptp(track.places, axis=0).max() < 0.1:
            faults = ["stands"] if track.id in driven else []
        else:
            faults = [*check_motion(track)]
        for fault in faults:
            remarks.setdefault(fault, []).append(track.id)
    return "; ".join(
        f"{names[0]}{f' and {len(names) - 1} more' if len(names) > 1 else ''}: {fault}"
        for fault, names in remarks.items()
    )


def play_esmini(program: Path, path: Path) -> dict[str, Floats]:
    """Play a file with esmini.

    Returns:
        Time in s and centre of the box, (n, 3) in m, by entity.
    """
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log.csv"
        options = ["--headless", "--disable_stdout", "--disable_controllers"]
        files = ["--csv_logger", log, "--logfile_path", Path(folder) / "log.txt"]
        subprocess.run(
            [program, "--osc", path.name, "--fixed_timestep", f"{ESMINI_STEP_S}", *options, *files],
            cwd=path.parent,
            timeout=ESMINI_TIMEOUT_S,
            capture_output=True,
            check=False,
        )
        lines = log.read_text().splitlines() if log.exists() else []
    begin = next((i for i, line in enumerate(lines) if line.startswith("Index")), len(lines))
    names = [name.strip() for name in lines[begin].split(",")] if begin < len(lines) else []
    keys = [re.sub(r"^#1 | \[.*", "", name) for name in names if name.startswith("#1 ")]
    found: dict[str, list[tuple[float, float, float]]] = {}
    for line in lines[begin + 1 :]:
        values = [value.strip() for value in line.split(",")]
        for first in range(2, len(values) - len(keys) + 1, max(len(keys), 1)):
            entity = dict(zip(keys, values[first : first + len(keys)], strict=True))
            x, y, heading, box_x, box_y = (
                float(entity[key])
                for key in (
                    "World_Position_X",
                    "World_Position_Y",
                    "World_Heading_Angle",
                    "bb_x",
                    "bb_y",
                )
            )
            centre = complex(x, y) + complex(box_x, box_y) * np.exp(1j * heading)
            row = float(values[1]), float(centre.real), float(centre.imag)
            found.setdefault(entity["Entity_Name"], []).append(row)
    return {name: np.array(rows) for name, rows in found.items()}


def compare_esmini(program: Path, path: Path, scenario: RecordedScenario) -> str:
    """Describe how far all actors are from where esmini has them, median / maximum."""
    entities = play_esmini(program, path)
    distances_m: list[Floats] = []
    for track in scenario.tracks:
        rows = entities.get(track.id, np.zeros((0, 3)))
        inside = (rows[:, 0] >= track.times_s[0]) & (rows[:, 0] <= track.times_s[-1])
        times_s, x, y = rows[inside].T
        places = [np.interp(times_s, track.times_s, item) for item in track.places.T]
        distances_m.append(np.hypot(places[0] - x, places[1] - y))
    joined = np.concatenate(distances_m) if distances_m else np.zeros(0)
    return f"{np.median(joined):.2f} / {joined.max():.2f}" if len(joined) else ""


def check_file(path: Path, root: Path | None, esmini: Path | None) -> Result:
    """Read a file and check the motion of its actors."""
    try:
        scenario = read_scenario(path, root=root)
    except InputError as error:
        reason = str(error).splitlines()[0].rpartition("/")[2]
        return Result((path.stem, "", "", f"refused: {reason}"), _shorten(reason))
    except Exception:
        last = traceback.format_exc().splitlines()[-1]
        return Result((path.stem, "", "", f"TRACEBACK: {last}"), "traceback", is_traceback=True)
    end_s = max(track.times_s[-1] for track in scenario.tracks)
    remarks = describe_scenario(path, scenario)
    distance = compare_esmini(esmini, path, scenario) if esmini is not None else ""
    return Result((path.stem, str(len(scenario.tracks)), f"{end_s:.1f}", remarks, distance))


def _shorten(reason: str) -> str:
    """Keep the element and what is wrong with it, without names, numbers and the way out."""
    text = re.sub(r"^\S*?: ", "", reason).partition("; ")[0]
    return re.sub(r"\d[\d.]*", "N", re.sub(r"'[^']*'", "'…'", text))


def _list_files(places: Iterable[Path]) -> Iterator[Path]:
    for place in places:
        yield from sorted(place.glob("*.xosc")) if place.is_dir() else [place]


def _print_row(cells: Sequence[str]) -> None:
    print(f"| {' | '.join(cell.replace('|', '/') for cell in cells)} |", flush=True)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the tables; the exit code is 1 if some file ends in a traceback."""
    parser = argparse.ArgumentParser(description="Play OpenSCENARIO files.")
    parser.add_argument("--root", type=Path, help="folder in which all catalogues are")
    parser.add_argument("--esmini", type=Path, help="esmini's program")
    parser.add_argument("places", nargs="+", type=Path, metavar="FILE_OR_FOLDER")
    options = parser.parse_args(arguments)
    _print_row(HEADER)
    _print_row(["---"] * len(HEADER))
    results: list[Result] = []
    for path in _list_files(options.places):
        results.append(check_file(path, options.root, options.esmini))
        _print_row(results[-1].row)
    refusals = Counter(result.refusal for result in results if result.refusal)
    print(f"\n{len(results) - refusals.total()} of {len(results)} files are read.\n")
    _print_row(("files", "reason"))
    _print_row(("---", "---"))
    for reason, count in refusals.most_common():
        _print_row((str(count), reason))
    return 1 if any(result.is_traceback for result in results) else 0


if __name__ == "__main__":
    sys.exit(main())
