"""Stage a conflict in every map that is named, and print a table.

    python benchmarks/towns.py MAPS... [--conflicts NAME...] [--seeds N...] [--attempts N]
        [--cells N]

Each named conflict is tried at the junctions that have room for it, as `advercity compile --settle`
does it, until one happens as declared with the first seed. The other seeds are then tried with it.
Without `--conflicts`, those between motor vehicles are tried, the guide's first.
"""

import argparse
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import yaml
from advercity_dsl import Conflict

from advercity.compiler.crossing import compile_library
from advercity.compiler.library import load_library
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
GUIDE_RECIPE = "ltap_od_ego_turns"
"""Conflict of the guide `import_your_town`."""
UNPROTECTED = {"pedestrian", "bicycle"}
HEADER = "| map | junctions | of four arms | staged | at | seeds | simulations | minutes |"


@dataclass
class TownTrial:
    """A map in which conflicts are staged.

    Attributes:
        file: The map.
        attempts: Number of simulations of a conflict at a junction and with a seed.
        simulations: Number of simulations so far.
    """

    file: Path
    attempts: int
    simulations: int = 0
    reasons: list[str] = field(default_factory=list[str])

    def stage_first(self, wanted: Sequence[str], seeds: Sequence[int], cells: int) -> str:
        """Stage one of the wanted conflicts; the row of the table."""
        began_s = time.monotonic()
        try:
            found = suggest_conflicts(self.file, SOURCES[self.file.suffix])
        except AdvercityError as error:
            return f"| {self.file.stem} | | | no: {_shorten(str(error))} | | | | |"
        arms = {item.junction: item.arms.count("(") for item in found.junctions}
        crossings = sum(count > 3 for count in arms.values())
        staged = "no: no junction has room for one | | "
        for junction, conflict in list(iterate_cells(found.junctions, wanted))[:cells]:
            happened = self._count_seeds(found, junction, conflict, seeds)
            if happened:
                where = f"{junction.junction} ({junction.control})"
                staged = f"{conflict} | {where} | {happened} of {len(seeds)}"
                break
            staged = f"no: {self.reasons[0]} | | 0 of {len(seeds)}"
        minutes = (time.monotonic() - began_s) / 60
        head = f"| {self.file.stem} | {len(arms)} | {crossings} |"
        return f"{head} {staged} | {self.simulations} | {minutes:.1f} |"

    def _count_seeds(
        self,
        found: MapSuggestions,
        junction: JunctionSuggestion,
        conflict: str,
        seeds: Iterable[int],
    ) -> int:
        """Count the seeds with which a conflict happens; 0 if it does not with the first."""
        happened = 0
        for seed in seeds:
            lines: list[str] = []
            try:
                self._settle(found, junction, conflict, seed, lines)
                happened += 1
            except AdvercityError as error:
                self.reasons.append(f"{conflict} at {junction.junction}: {_shorten(str(error))}")
            self.simulations += len(lines)
            if not happened:
                break
        return happened

    def _settle(
        self,
        found: MapSuggestions,
        junction: JunctionSuggestion,
        conflict: str,
        seed: int,
        lines: list[str],
    ) -> None:
        """Compile one conflict at one junction, with a first seed of the traffic."""
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            list(write_suggestions(found, self.file, folder))
            road = yaml.safe_load((folder / f"{junction.road}.yaml").read_text())
            road["at_junction"]["junction"] = [junction.junction]
            suite = yaml.safe_load((folder / "suite.yaml").read_text())
            suite |= {"roads": [junction.road], "cross_conflicts": [conflict]}
            suite["seeds"] = {"traffic": seed}
            (folder / f"{junction.road}.yaml").write_text(yaml.safe_dump(road, sort_keys=False))
            (folder / "suite.yaml").write_text(yaml.safe_dump(suite, sort_keys=False))
            settler = Settler(find_traffic_problems, self.attempts, lines.append)
            library = find_shipped_library()
            compile_library(library, folder, suite=suite["id"], settler=settler)


def iterate_cells(
    junctions: Sequence[JunctionSuggestion], wanted: Sequence[str]
) -> Iterator[tuple[JunctionSuggestion, str]]:
    """Yield junctions with the first wanted conflict that has room there, then with the others."""
    for name in wanted:
        yield from ((junction, name) for junction in junctions if name in junction.conflicts)


def list_conflicts_of_vehicles() -> list[str]:
    """List the shipped conflicts between motor vehicles, that of the guide first."""
    declared = load_library(find_shipped_library()).get_declarations(Conflict)
    names = [name for name, item in declared.items() if not UNPROTECTED & {*item.actor.classes}]
    return sorted(names, key=lambda name: name != GUIDE_RECIPE)


def _shorten(text: str) -> str:
    """Keep the end of an error's first line, which says why, without what would end a cell."""
    first, _, _ = text.partition("\n")
    return first[-160:].replace("|", "/")


def main() -> None:
    """Print the row of each map as it is done."""
    parser = argparse.ArgumentParser(description="Stage a conflict in every map, and print a table")
    parser.add_argument("maps", nargs="+", type=Path)
    parser.add_argument("--conflicts", nargs="+", default=list_conflicts_of_vehicles())
    parser.add_argument("--seeds", nargs="+", type=int, default=[1, 2, 3])
    parser.add_argument("--attempts", type=int, default=3, help="simulations of a conflict")
    parser.add_argument("--cells", type=int, default=4, help="conflicts that are tried in a map")
    asked = parser.parse_args()
    print(HEADER)
    print("|" + " --- |" * 8, flush=True)
    for file in asked.maps:
        trial = TownTrial(file, asked.attempts)
        print(trial.stage_first(asked.conflicts, asked.seeds, asked.cells), flush=True)


if __name__ == "__main__":
    main()
