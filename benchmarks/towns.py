"""Stage a conflict in every map that is named, and print a table.

    python benchmarks/towns.py MAPS... [--attempts N] [--cells N]

Of each map, the junctions with most conflicts are tried in turn, with the surest conflict of each
first and `ltap_od_ego_turns` next, as `advercity compile --settle` does it, until one happens as
declared.
"""

import argparse
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import yaml

from advercity.compiler.crossing import compile_library
from advercity.compiler.map_suggestions import (
    JunctionSuggestion,
    MapSource,
    MapSuggestions,
    suggest_conflicts,
    write_suggestions,
)
from advercity.compiler.settling import Settler
from advercity.compiler.shipped_library import find_shipped_library
from advercity.errors import AdvercityError
from advercity.pipeline.traffic_report import find_traffic_problems

SOURCES: dict[str, MapSource] = {".osm": "osm", ".xodr": "opendrive"}
RECIPE = "ltap_od_ego_turns"
"""Conflict of the guide `import_your_town`, which is tried where there is room for it."""
HEADER = "| map | junctions | of four arms | staged | at | traffic seed | simulations | minutes |"


def stage_first(file: Path, cells: int, attempts: int) -> str:
    """Stage a conflict in a map; the row of the table."""
    began_s = time.monotonic()
    try:
        found = suggest_conflicts(file, SOURCES[file.suffix])
    except AdvercityError as error:
        return f"| {file.stem} | | | no: {_shorten(str(error))} | | | | |"
    crossings = sum(item.arms.count("(") > 3 for item in found.junctions)
    head = f"| {file.stem} | {len(found.junctions)} | {crossings} |"
    why, simulations = "nothing has a place", 0
    for junction, conflict in list(_iterate_cells(found))[:cells]:
        lines: list[str] = []
        try:
            settled = _settle(file, found, junction, conflict, attempts, lines)
        except AdvercityError as error:
            why = f"{conflict} at {junction.junction}: {_shorten(str(error))}"
            simulations += len(lines)
            continue
        simulations += len(lines)
        minutes = (time.monotonic() - began_s) / 60
        where = f"{junction.junction} ({junction.control})"
        return f"{head} {conflict} | {where} | {settled} | {simulations} | {minutes:.1f} |"
    return f"{head} no: {why} | | | {simulations} | {(time.monotonic() - began_s) / 60:.1f} |"


def _iterate_cells(found: MapSuggestions) -> Iterator[tuple[JunctionSuggestion, str]]:
    for junction in found.junctions:
        first = junction.conflicts[:1]
        yield from ((junction, name) for name in first)
        if RECIPE in junction.conflicts and RECIPE not in first:
            yield junction, RECIPE


def _settle(
    file: Path,
    found: MapSuggestions,
    junction: JunctionSuggestion,
    conflict: str,
    attempts: int,
    lines: list[str],
) -> int:
    """Compile one conflict at one junction; the traffic seed with which it happens."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        list(write_suggestions(found, file, folder))
        road = yaml.safe_load((folder / f"{junction.road}.yaml").read_text())
        road["at_junction"]["junction"] = [junction.junction]
        suite = yaml.safe_load((folder / "suite.yaml").read_text())
        suite |= {"roads": [junction.road], "cross_conflicts": [conflict]}
        (folder / f"{junction.road}.yaml").write_text(yaml.safe_dump(road, sort_keys=False))
        (folder / "suite.yaml").write_text(yaml.safe_dump(suite, sort_keys=False))
        settler = Settler(find_traffic_problems, attempts, lines.append)
        library = find_shipped_library()
        specs = compile_library(library, folder, suite=suite["id"], settler=settler)
    settled = specs[0].provenance.settled
    assert settled is not None, "a settler records what it found"
    return settled.traffic


def _shorten(text: str) -> str:
    """Keep the end of an error's first line, which says why, without what would end a cell."""
    first, _, _ = text.partition("\n")
    return first[-160:].replace("|", "/")


def main() -> None:
    """Print the row of each map as it is done."""
    parser = argparse.ArgumentParser(description="Stage a conflict in every map, and print a table")
    parser.add_argument("maps", nargs="+", type=Path)
    parser.add_argument("--attempts", type=int, default=3, help="simulations of a conflict")
    parser.add_argument("--cells", type=int, default=4, help="conflicts that are tried in a map")
    asked = parser.parse_args()
    print(HEADER)
    print("|" + " --- |" * 8, flush=True)
    for file in asked.maps:
        print(stage_first(file, asked.cells, asked.attempts), flush=True)


if __name__ == "__main__":
    main()
