"""Damages every kind of input at random: each is read or refused with a message, no file is lost.

    python benchmarks/fuzz.py [--declarations N] [--specs N] [--datasets N] [--traces N]
        [--caches N] [--recordings N] [--maps N] [--predictions N] [--exports N] [--seed 1]
        [--folder DIR]

Everything runs in this process: a crash ends it; a traceback, a lost file, or a case of more than
10 s of processor time is printed with its number, and counts as failed. The folder is for the
files; in memory is quickest (`--folder /dev/shm`), since runs sync what they write. Exit code 1 if
anything failed.
"""

import argparse
import faulthandler
import logging
import os
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from unittest.mock import patch

from advercity_dsl import Spec
from fuzz_declarations import check_declaration, check_spec
from fuzz_files import (
    MAPPED_SURFACE,
    CacheFuzzer,
    DatasetFuzzer,
    Recording,
    TraceFuzzer,
    Tree,
    read_tree,
)
from fuzz_inputs import ExportFuzzer, MapFuzzer, PredictionFuzzer, RecordingFuzzer

from advercity.compiler import with_digest
from advercity.dataset.formats import FORMATS
from advercity.dataset.writer import ScenarioWriter
from advercity.pipeline import RunOptions
from advercity.pipeline.cache import (
    compute_body_key,
    compute_road_key,
    compute_traffic_key,
    compute_world_key,
    find_cache_folder,
)
from advercity.pipeline.preparation import PreparedScenario, prepare_scenario
from advercity.pipeline.run_records import RECORDS_FILE, RunRecord, describe_machine
from advercity.pipeline.sensing import open_sensors
from advercity.pipeline.surface_maps import SurfaceMaps
from advercity.testing import compile_shaped, with_small_sensors

Check = Callable[[int, int], tuple[str, str]]
DEFAULT_COUNTS = {
    "declarations": 2000,
    "specs": 500,
    "datasets": 3000,
    "traces": 1000,
    "caches": 1000,
    "recordings": 1000,
    "maps": 1000,
    "predictions": 500,
    "exports": 1000,
}
TRACE_TICKS = 40
FUZZED_EXPORTS = ("calibration", "openlabel", "openscenario")
"""Formats with small files, by frame and by scenario."""


def main() -> int:
    """Damage files of all kinds, and print counts by kind; 1 if anything failed."""
    faulthandler.enable()
    logging.getLogger("advercity").addHandler(logging.NullHandler())
    arguments = _parse_arguments()
    if arguments.folder:
        arguments.folder.mkdir(parents=True, exist_ok=True)
    outcomes: Counter[tuple[str, str]] = Counter()
    begin = time.perf_counter()
    with tempfile.TemporaryDirectory(dir=arguments.folder) as folder:
        checks = _make_checks(Path(folder))
        for name, check in checks.items():
            print(f"{name} ...", file=sys.stderr, flush=True)
            for number in range(getattr(arguments, name)):
                try:
                    outcomes[check(number, arguments.seed)] += 1
                except Exception as error:
                    outcomes[name, "failed"] += 1
                    print(
                        f"{name} {number}: {type(error).__name__}: {str(error)[:300]}", flush=True
                    )
    _print_table(outcomes)
    print(f"{outcomes.total()} in {time.perf_counter() - begin:.0f} s")
    return 1 if any(outcome == "failed" for _, outcome in outcomes) else 0


def _make_checks(folder: Path) -> dict[str, Check]:
    """Make what damages each kind; each works in a folder of its own."""
    for name in ("entries", *list(DEFAULT_COUNTS)[2:]):
        (folder / name).mkdir()
    prepared = _prepare_recording()
    trace = prepared[0].traffic.trace.cut(TRACE_TICKS)
    recording = _record(prepared)
    dataset = _write_dataset(recording, folder / "whole")
    return {
        "declarations": _in_empty_folder("declaration", check_declaration, folder),
        "specs": _in_empty_folder("spec", check_spec, folder),
        "datasets": DatasetFuzzer(recording, folder / "datasets").check,
        "traces": TraceFuzzer(trace, folder / "traces").check,
        "caches": CacheFuzzer(
            _collect_entries(prepared[0], folder / "entries"), folder / "caches"
        ).check,
        "recordings": RecordingFuzzer(folder / "recordings").check,
        "maps": MapFuzzer(folder / "maps").check,
        "predictions": PredictionFuzzer(dataset, folder / "predictions").check,
        "exports": ExportFuzzer(dataset, folder / "exports", FUZZED_EXPORTS).check,
    }


def _in_empty_folder(kind: str, check: Callable[[int, int, Path], str], folder: Path) -> Check:
    def run(number: int, seed: int) -> tuple[str, str]:
        with tempfile.TemporaryDirectory(dir=folder) as empty:
            return kind, check(number, seed, Path(empty))

    return run


def _prepare_recording() -> list[PreparedScenario]:
    """Prepare a scenario with all sensors, few pixels and a bare road in every layout."""
    spec = with_small_sensors(compile_shaped(suite="radar")[0])
    data = spec.model_dump(mode="json")
    data["road"]["surroundings"] = []
    data["agents"] = [data["agents"][0], data["agents"][-1]]  # a vehicle and a unit
    data["channel"] = compile_shaped(suite="cooperative")[0].model_dump(mode="json")["channel"]
    sensors = data["agents"][0]["sensors"]
    sensors["can"] = {}
    sensors["camera"] |= {
        "mounts": sensors["camera"]["mounts"][:1],
        "truth": ["instance", "normal", "flow"],
        "hdr": True,
        "raw": {"pattern": "rggb", "bits": 12, "black_level": 64},
    }
    # Of one agent, with coarse cells: a cube of the rig has ten times the size of all else.
    data["agents"][0]["sensors"]["radar"] |= {
        "output": "cube",
        "azimuth_cell_deg": 30,
        "elevation_cell_deg": 30,
        "speed_cell_m_s": 5,
    }
    spec = with_digest(Spec.model_validate(data))
    return [
        prepare_scenario(spec, RunOptions(Path(), backend="fake", profile="preview", format=layout))
        for layout in FORMATS
    ]


def _record(prepared: list[PreparedScenario]) -> Recording:
    with open_sensors(prepared[0]) as sensors:
        frames = [sensors.capture_frame(index) for index in range(2)]
    return Recording(prepared[0].spec, [one.identity for one in prepared], frames)


def _write_dataset(recording: Recording, folder: Path) -> Path:
    spec, frames = recording.spec, recording.frames
    with ScenarioWriter(folder, spec, recording.identities[0], length=len(frames)) as writer:
        for number, frame in enumerate(frames):
            writer.write_frame(number, frame)
        writer.finish()
    return folder


def _collect_entries(prepared: PreparedScenario, folder: Path) -> Tree:
    """Collect an entry of each kind of the cache, and the bodies of a car and of a person."""
    spec, cache = prepared.spec, find_cache_folder()
    prepared.load_world()
    kinds = {one.actor_class: name for name, one in spec.blueprints.items()}
    bodies = [compute_body_key(spec, kinds[kind]) for kind in ("bicycle", "pedestrian")]
    names = [
        f"networks/{compute_road_key(spec)}/road.net.xml",
        f"worlds/{compute_world_key(spec)}.npz",
        *(f"bodies/{key}.npz" for key in bodies),
    ]
    entries = {name: (cache / name).read_bytes() for name in names}
    prepared.traffic.trace.cut(TRACE_TICKS).save(folder / "trace.npz")
    entries[f"traces/{compute_traffic_key(spec)}.npz"] = (folder / "trace.npz").read_bytes()
    with patch.dict(os.environ, ADVERCITY_CACHE=str(folder / "made")):
        _ = SurfaceMaps()[MAPPED_SURFACE]
    made = read_tree(folder / "made")
    entries |= {name: content for name, content in made.items() if name.endswith(".npz")}
    record = RunRecord(
        machine=describe_machine(),
        backend="fake",
        renderer="raster",
        format="opv2v",
        pixels=100,
        beams=10,
        setup_s=1,
        frame_s=1,
        frame_bytes=100,
        memory_bytes=1000,
    )
    return {**entries, RECORDS_FILE: record.model_dump_json().encode() + b"\n"}


def _print_table(outcomes: Counter[tuple[str, str]]) -> None:
    columns = ("read", "refused", "failed")
    print(f"| kind | {' | '.join(columns)} |\n|---|---|---|---|")
    for kind in sorted({kind for kind, _ in outcomes}):
        print(f"| {kind} | {' | '.join(str(outcomes[kind, column]) for column in columns)} |")


def _parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    for name, count in DEFAULT_COUNTS.items():
        parser.add_argument(f"--{name}", type=int, default=count)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--folder", type=Path, help="where folders of this run are made")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
