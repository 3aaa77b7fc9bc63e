"""Damages what others give to commands: recordings of traffic, maps, predictions, and exports.

Every file must be read, or refused with a message; files of others stay what they are.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from advercity_benchmark.predictions import (
    FramePredictions,
    load_predictions,
    write_predictions,
)
from advercity_benchmark.truth import load_frame_truth
from advercity_dsl import MapFile, Road
from advercity_dsl.road import MapSource
from fuzz_files import damage_file, read_tree, run_command, write_tree
from mutations import choose, damage_attributes, time_limit

from advercity.compiler.recorded_roads import load_recorded_scenario, load_recorded_table
from advercity.dataset.reader import Dataset
from advercity.errors import AdvercityError
from advercity.exports.export_folder import verify_export
from advercity.exports.exporting import export_dataset
from advercity.foreign.ledger import Ledger
from advercity.randomness import create_generator
from advercity.recordings.sumo_scenario import read_sumo_scenario
from advercity.roads.map_import import import_map
from tests.recordings.recorded_files import (
    write_ind,
    write_interaction,
    write_openscenario,
    write_street,
)
from tests.roads.imported_roads import declaration
from tests.roads.lanelet2_maps import LaneletMap
from tests.roads.sumo_networks import build_crossing_network
from tests.traffic.sumo_scenario_files import write_sumo_scenario

MAPS = Path(__file__).parents[1] / "tests" / "data" / "maps"

COMMAND_RATE = 0.02
"""Fraction of recordings that go through the whole command, which compiles for seconds."""


class RecordingFuzzer:
    """Damages recordings of traffic and their map, and imports them.

    Args:
        folder: An empty folder to work in.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder / "recordings"
        self._outside = folder / "outside.txt"
        self._outside.write_text("of others")
        makers = {"ind": write_ind, "interaction": write_interaction, "own": _write_own_table}
        self._trees: dict[str, tuple[str, dict[str, bytes]]] = {}
        for kind, write in {**makers, "openscenario": write_openscenario}.items():
            self._folder.mkdir()
            name = write(self._folder).name
            write_street(self._folder)
            self._trees[kind] = name, read_tree(self._folder)
            write_tree(self._folder, {})
            self._folder.rmdir()
        self._folder.mkdir()

    def check(self, number: int, seed: int) -> tuple[str, str]:
        """Damage a file; return its kind, and `read` or `refused`; anything else is raised."""
        rng = create_generator(seed, "recording", number)
        kind = choose(sorted(self._trees), rng)
        name, tree = self._trees[kind]
        write_tree(self._folder, tree)
        is_whole = rng.random() < COMMAND_RATE
        files = sorted(one for one in tree if is_whole or not one.endswith(".xodr"))
        damage_file(self._folder / choose(files, rng), self._outside, rng)
        outcome = "read"
        with time_limit():
            try:
                self._import(kind, self._folder / name, is_whole)
            except AdvercityError as error:
                assert str(error).strip(), "empty message"
                outcome = "refused"
        assert self._outside.read_text() == "of others", "written through a link"
        return f"recording: {kind}{', whole command' if is_whole else ''}", outcome

    def _import(self, kind: str, path: Path, is_whole: bool) -> None:
        if not is_whole:
            load = load_recorded_scenario if kind == "openscenario" else load_recorded_table
            tracks = load(path).tracks
            assert all(np.isfinite(track.places).all() for track in tracks), "no places"
            return
        command = "openscenario" if kind == "openscenario" else "trajectories"
        ego = "Ego" if kind == "openscenario" else "1"
        run_command(
            *("import", command, path, "--map", self._folder / "hill.xodr", "--ego", ego),
            *("--looks", "shaped", "--output", self._folder / "out"),
        )


class MapFuzzer:
    """Damages maps of every format and scenarios of SUMO, and imports them.

    Args:
        folder: An empty folder to work in.
    """

    def __init__(self, folder: Path) -> None:
        self._folder, self._outside = folder / "maps", folder / "outside.txt"
        self._outside.write_text("of others")
        self._folder.mkdir()
        write_sumo_scenario(folder / "scenario")
        self._maps: list[tuple[MapSource, str, str]] = [
            ("opendrive", "bend.xodr", (MAPS / "bend.xodr").read_text()),
            ("opendrive", "junction.xodr", (MAPS / "junction.xodr").read_text()),
            ("osm", "crossroads.osm", (MAPS / "crossroads.osm").read_text()),
            ("sumo", "town.net.xml", build_crossing_network()),
            ("lanelet2", "lanes.osm", _write_lanelets()),
        ]
        self._scenario = read_tree(folder / "scenario")

    def check(self, number: int, seed: int) -> tuple[str, str]:
        """Damage a file; return its kind, and `read` or `refused`; anything else is raised."""
        rng = create_generator(seed, "map", number)
        outcome = "read"
        if rng.random() < 0.2:
            kind, load = "sumo scenario", self._damage_scenario(rng)
        else:
            kind, load = self._damage_map(rng)
        with time_limit():
            try:
                load()
            except AdvercityError as error:
                assert str(error).strip(), "empty message"
                outcome = "refused"
        assert self._outside.read_text() == "of others", "written through a link"
        return f"map: {kind}", outcome

    def _damage_map(self, rng: np.random.Generator) -> tuple[str, Callable[[], object]]:
        source, name, text = choose(self._maps, rng)
        write_tree(self._folder, {name: text.encode()})
        self._damage(self._folder / name, rng)
        declared = MapFile(source=source, file=name)
        road = Road.model_validate(
            declaration(source, name, origin_lat_deg=48.1, origin_lon_deg=11.5)
        )
        return source, lambda: import_map(declared, road, self._folder)

    def _damage_scenario(self, rng: np.random.Generator) -> Callable[[], object]:
        write_tree(self._folder, self._scenario)
        self._damage(self._folder / choose(sorted(self._scenario), rng), rng)
        return lambda: read_sumo_scenario(self._folder / "town.sumocfg", Ledger())

    def _damage(self, path: Path, rng: np.random.Generator) -> None:
        if path.suffix == ".gz" or rng.random() < 0.3:
            damage_file(path, self._outside, rng)
        else:
            path.write_text(damage_attributes(path.read_text(), rng))


def _write_lanelets() -> str:
    """Write a street of two lanes that another one leaves, with a speed limit."""
    lanelets = LaneletMap()
    limit = lanelets.rule("speed_limit", sign_type="30 km/h")
    middle, left, right = (lanelets.way([(0.0, y, 0.0), (50.0, y, 0.5)]) for y in (0.0, 3.5, -3.5))
    lanelets.lanelet(middle, right, [limit], location="urban", one_way="yes")
    lanelets.lanelet(middle, left, [limit], location="urban", one_way="yes")
    ends = ([(50.0, y, 0.5), (80.0, y + 20.0, 1.0)] for y in (0.0, -3.5))
    lanelets.lane(*ends, location="urban", participant="vehicle")
    return lanelets.write()


def _write_own_table(folder: Path) -> Path:
    columns = "id,class,time_s,x_m,y_m,heading_deg,length_m,width_m,height_m"
    rows = [f"1,car,{i / 10},{50 + i},-1.75,0,4.6,1.8,1.5" for i in range(41)]
    rows += [f"2,car,{i / 10},{160 - i},1.75,180,4.2,1.8,1.5" for i in range(41)]
    path = folder / "table.csv"
    path.write_text("\n".join((columns, *rows)) + "\n")
    return path


class PredictionFuzzer:
    """Damages predictions, and evaluates them.

    Args:
        dataset: A dataset.
        folder: An empty folder to work in.
    """

    def __init__(self, dataset: Path, folder: Path) -> None:
        self._dataset, self._path = dataset, folder / "predictions.jsonl"
        self._outside = folder / "outside.txt"
        self._outside.write_text("of others")
        found: dict[tuple[str, int], FramePredictions] = {}
        for frame in Dataset(dataset):
            boxes = load_frame_truth(frame).boxes[:5]
            key = frame.scenario.spec.id, frame.index
            found[key] = FramePredictions(boxes, np.linspace(1, 0, len(boxes)))
        write_predictions(self._path, found)
        self._raw = self._path.read_bytes()

    def check(self, number: int, seed: int) -> tuple[str, str]:
        """Damage them; return the kind, and `read` or `refused`; anything else is raised."""
        rng = create_generator(seed, "prediction", number)
        self._path.unlink(missing_ok=True) if not self._path.is_dir() else self._path.rmdir()
        self._path.write_bytes(self._raw)
        damage_file(self._path, self._outside, rng)
        outcome = "read"
        with time_limit():
            try:
                if rng.random() < 0.1:
                    run_command("benchmark", "evaluate", self._path, self._dataset)
                else:
                    load_predictions(self._path)
            except AdvercityError as error:
                assert str(error).strip(), "empty message"
                outcome = "refused"
        return "predictions", outcome


class ExportFuzzer:
    """Damages exports among files of others; verifies, resumes and makes them anew.

    Args:
        dataset: A dataset.
        folder: An empty folder to work in.
        formats: The formats.
    """

    def __init__(self, dataset: Path, folder: Path, formats: tuple[str, ...]) -> None:
        self._dataset, self._export = dataset, folder / "export"
        self._outside = folder / "outside.txt"
        self._outside.write_text("of others")
        self._trees: dict[str, dict[str, bytes]] = {}
        for name in formats:
            export_dataset(name, dataset, folder / name)
            self._trees[name] = read_tree(folder / name)
        self._export.mkdir()

    def check(self, number: int, seed: int) -> tuple[str, str]:
        """Damage a file; return its kind, and `read` or `refused`; anything else is raised."""
        rng = create_generator(seed, "export", number)
        name = choose(sorted(self._trees), rng)
        tree = self._trees[name]
        strangers = {"notes.txt": b"of others", f"{min(tree)}.mine/x.bin": b"of others, too"}
        write_tree(self._export, {**tree, **strangers})
        target = "export.json" if rng.random() < 0.3 else choose(sorted(tree), rng)
        damaged = damage_file(self._export / target, self._outside, rng)
        actions: dict[str, Callable[[], object]] = {
            "verify": lambda: verify_export(self._export),
            "command": lambda: run_command("verify", self._export),
            "resume": lambda: export_dataset(name, self._dataset, self._export),
            "fresh": lambda: export_dataset(name, self._dataset, self._export, fresh=True),
        }
        action = choose(sorted(actions), rng)
        outcome = "read"
        with time_limit():
            try:
                actions[action]()
            except AdvercityError as error:
                assert str(error).strip(), "empty message"
                outcome = "refused"
        if damaged is not None and damaged != tree[target] and target != "export.json":
            strangers[target] = damaged
        found = read_tree(self._export)
        for path, content in strangers.items():
            assert content in found.values(), f"{path} is lost after {action}"
        assert self._outside.read_text() == "of others", "written through a link"
        if outcome == "read" and action in ("resume", "fresh"):
            same_size = damaged is not None and len(damaged) == len(tree[target])
            for path in tree.keys() - ({target} if same_size else set[str]()):
                assert found[path] == tree[path], f"{path} differs after {action}"
        return f"export: {name}", outcome
