"""Damages what runs make and read: datasets, traces, and entries of the cache.

Every file must be read, or refused with a message; files that no run wrote stay what they are.
"""

import hashlib
import io
import os
import shutil
import stat
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from advercity_dsl import Spec
from mutations import choose, damage_arrays, damage_bytes, mutate, time_limit

import advercity
from advercity.cli import main
from advercity.dataset.agent_view import AgentView
from advercity.dataset.facts import collect_scenario_facts
from advercity.dataset.index import INDEX_FILE, IndexWriter
from advercity.dataset.manifest import Identity
from advercity.dataset.partial_files import PARTIAL_SUFFIX
from advercity.dataset.reader import Scenario
from advercity.dataset.sample_series import SampleKind
from advercity.dataset.scenario_folders import MANIFEST_FILE
from advercity.dataset.verification import restore_files, verify_dataset, verify_scenario
from advercity.dataset.writer import ScenarioWriter
from advercity.errors import AdvercityError
from advercity.frames import Trace
from advercity.pipeline.cache_entries import load_or_build_entry
from advercity.pipeline.run_records import RECORDS_FILE, load_records
from advercity.pipeline.surface_maps import SurfaceMaps
from advercity.randomness import create_generator
from advercity.scene.world_storage import load_body, load_world
from advercity.sensors.sensor_frame import SensorFrame
from advercity.world import Body, World

Tree = dict[str, bytes]
"""Content of every file of a folder, by path."""
TEXT_SUFFIXES = (".yaml", ".json", ".jsonl", ".md", ".sha256")


@dataclass(frozen=True)
class Recording:
    """Two frames of a scenario, made once, with which datasets are written and mended.

    Attributes:
        spec: The scenario.
        identities: What decides the bytes, for every layout.
        frames: Sensor frames of every agent, by frame.
    """

    spec: Spec
    identities: Sequence[Identity]
    frames: Sequence[tuple[SensorFrame, ...]]


def read_tree(folder: Path) -> Tree:
    """Read every regular file of a folder."""
    tree: Tree = {}
    for parent, _, names in os.walk(folder):
        for name in names:
            path = f"{parent}/{name}"
            if stat.S_ISREG(os.lstat(path).st_mode):
                tree[path[len(str(folder)) + 1 :]] = Path(path).read_bytes()
    return tree


def write_tree(folder: Path, tree: Mapping[str, bytes]) -> None:
    """Make a folder hold these files and nothing else."""
    same = {path for path, content in read_tree(folder).items() if tree.get(path) == content}
    for parent, folders, names in os.walk(folder, topdown=False):
        for path in (Path(parent, name) for name in names):
            if path.relative_to(folder).as_posix() not in same:
                path.unlink()
        for path in (Path(parent, name) for name in folders):
            if path.is_symlink():
                path.unlink()
            elif not any(path.iterdir()):
                path.rmdir()
    for name in tree.keys() - same:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(tree[name])


STRANGERS = (
    "notes.txt",
    "{id}/thesis.tex",
    "{id}/+101/000061_mylabels.json",
    "{id}/101/000099_pred.npy",
    "{id}/102/000060.yaml.kept",
    "{id}/mine/000060.pcd",
    ".staging/{id}/notes.txt",
    ".staging/{id}/incoming/mine/000061.pcd",
    ".staging/notes.txt",
)
OF_THE_DATASET = (INDEX_FILE, MANIFEST_FILE, "lock")
"""Files that describe a dataset; a run replaces them."""


class DatasetFuzzer:
    """Damages files of a dataset, and does with it what users do.

    Args:
        recording: What it holds.
        folder: An empty folder to work in.
    """

    def __init__(self, recording: Recording, folder: Path) -> None:
        self._recording, self._folder = recording, folder
        self._dataset = folder / "dataset"
        self._dataset.mkdir()
        (folder / "outside.txt").write_text("of others")
        states = [
            self._write_states(identity, folder / identity.format)
            for identity in recording.identities
        ]
        self._states = [
            (identity, state, whole)
            for identity, (whole, killed) in zip(recording.identities, states, strict=True)
            for state in (whole, killed)
        ]
        self._actions: dict[str, Callable[[Identity], None]] = {
            "read": self._read,
            "verify": lambda _: run_command("verify", self._dataset),
            "sheet": lambda _: run_command(
                "sheet", self._dataset / recording.spec.id, "--output", folder / "sheet.png"
            ),
            "facts": lambda _: self._collect_facts(),
            "resume": lambda identity: self._resume(identity, fresh=False),
            "fresh": lambda identity: self._resume(identity, fresh=True),
            "repair": lambda _: self._repair(),
        }

    def check(self, number: int, seed: int) -> tuple[str, str]:
        """Damage one file; return its kind, and `read` or `refused`; anything else is raised."""
        rng = create_generator(seed, "dataset", number)
        identity, state, whole = self._states[int(rng.integers(len(self._states)))]
        strangers = {
            path.format(id=self._recording.spec.id): f"of others: {path}".encode()
            for path in STRANGERS
        }
        lost = sorted(whole.keys() - state.keys())
        if lost:  # in the place of one that the run writes next
            strangers[choose(lost, rng)] = b"of others, in the way"
        tree = {**state, **strangers}
        kinds: dict[str, list[str]] = {}
        for path in sorted(state):
            kinds.setdefault(name_kind(path), []).append(path)
        kind = choose(sorted(kinds), rng)
        target = choose(kinds[kind], rng)
        write_tree(self._dataset, tree)
        damaged = damage_file(self._dataset / target, self._folder / "outside.txt", rng)
        action = choose(sorted(self._actions), rng)
        outcome = "read"
        with time_limit():
            try:
                self._actions[action](identity)
            except AdvercityError as error:
                assert str(error).strip(), "empty message"
                outcome = "refused"
        if damaged is not None and damaged != state[target] and is_data(target):
            strangers[target] = damaged
        self._check_nothing_lost(strangers)
        if action in ("resume", "fresh") and outcome == "read":
            same_size = damaged is not None and len(damaged) == len(state[target])
            self._check_whole(whole, except_path=target if same_size else "")
        return kind, outcome

    def _write_states(self, identity: Identity, folder: Path) -> tuple[Tree, Tree]:
        """Write a dataset of two frames, and one whose run was killed during the second."""
        spec, frames = self._recording.spec, self._recording.frames
        with ScenarioWriter(folder, spec, identity, length=len(frames)) as writer:
            writer.write_frame(0, frames[0])
            writer.finish()
        IndexWriter(folder, [spec]).record_result(spec.id, failed=False)
        with ScenarioWriter(folder, spec, identity, length=len(frames)) as writer:
            writer.claim_frame(1)
            writer.write_frame(1, frames[1])
            killed = read_tree(folder)
            writer.finish()
        IndexWriter(folder, [spec]).record_result(spec.id, failed=False)
        whole = read_tree(folder)
        (journal,) = (path for path in killed if name_kind(path) == "journal")
        announced, moved = killed[journal].splitlines(keepends=True)
        killed[journal] = announced + moved[: len(moved) // 2]
        for path in [path for path in killed if "/000061" in path][::2]:
            incoming = f".staging/{spec.id}/incoming/0/{path.partition('/')[2]}{PARTIAL_SUFFIX}"
            killed[incoming] = killed.pop(path)
        shutil.rmtree(folder)
        return whole, killed

    def _read(self, identity: Identity) -> None:
        refused: list[AdvercityError] = []
        dataset = advercity.open_dataset(self._dataset)
        for scenario in dataset.scenarios:
            refused += read_samples(scenario)
        for frame in dataset:
            for view in frame.views.values():
                refused += read_view(view)
            for agent in frame.views:
                refused += try_each([partial(frame.messages, agent)])
        if refused:
            raise refused[0]

    def _collect_facts(self) -> None:
        for manifest in self._dataset.glob(f"*/{MANIFEST_FILE}"):
            collect_scenario_facts(Scenario(manifest.parent))

    def _resume(self, identity: Identity, *, fresh: bool) -> None:
        spec, frames = self._recording.spec, self._recording.frames
        index = IndexWriter(self._dataset, [spec])
        with ScenarioWriter(
            self._dataset, spec, identity, length=len(frames), fresh=fresh
        ) as writer:
            for number in sorted({*range(len(frames))} - writer.done_frames):
                writer.write_frame(number, frames[number])
            writer.finish()
        index.record_result(spec.id, failed=False)

    def _repair(self) -> None:
        scenario = self._dataset / self._recording.spec.id
        restore_files(scenario, verify_scenario(scenario), self._recording.frames.__getitem__)

    def _check_nothing_lost(self, strangers: Mapping[str, bytes]) -> None:
        contents = {*read_tree(self._dataset).values()}
        for path, content in strangers.items():
            assert content in contents, f"{path} is lost"
        assert (self._folder / "outside.txt").read_text() == "of others", "written through a link"

    def _check_whole(self, whole: Tree, *, except_path: str) -> None:
        found = read_tree(self._dataset)
        for path in whole.keys() - {except_path, INDEX_FILE}:
            assert found[path] == whole[path], f"{path} differs after a run"
        # A damaged index may list a scenario that never was, of which all is missing.
        damaged = {
            one.path
            for one in verify_dataset(self._dataset)
            if one.is_damage and one.scenario.name == self._recording.spec.id
        }
        assert all(except_path.endswith(path) for path in damaged), f"{damaged} after a run"


def name_kind(path: str) -> str:
    """Name the kind of a file of a dataset."""
    name = Path(path).name
    if name.startswith("journal_"):
        return "journal"
    if name.endswith(PARTIAL_SUFFIX):
        return "unfinished file"
    return name if name in OF_THE_DATASET else Path(path).suffix


def is_data(path: str) -> bool:
    """Whether a file is data, which its user may have changed; runs replace all others."""
    return name_kind(path) not in (*OF_THE_DATASET, "journal", "unfinished file")


def damage_file(path: Path, outside: Path, rng: np.random.Generator) -> bytes | None:
    """Damage a file, or put something else in its place; return the content, None for no file."""
    raw = path.read_bytes()
    if rng.random() < 0.1:
        path.unlink()
        match int(rng.integers(6)):
            case 0:
                path.mkdir()
            case 1:
                os.mkfifo(path)
            case 2:
                path.symlink_to("/dev/zero")
            case 3:
                path.symlink_to(path)
            case 4:
                path.symlink_to(outside)
            case _:
                pass
        return None
    if path.suffix in TEXT_SUFFIXES and rng.random() < 0.5:
        damaged = mutate(raw.decode(), rng)
    elif path.suffix == ".npz" and rng.random() < 0.5:
        damaged = damage_arrays(raw, rng)
    else:
        damaged = damage_bytes(raw, rng)
    path.write_bytes(damaged)
    return damaged


def run_command(*arguments: object) -> None:
    """Run the command line in this process; AdvercityError with what it printed if it refuses."""
    printed, before = io.StringIO(), sys.argv
    code: Any = 0
    sys.argv = ["advercity", *map(str, arguments)]
    try:
        with redirect_stdout(printed), redirect_stderr(printed):
            main()
    except SystemExit as end:
        code = end.code
    finally:
        sys.argv = before
    assert code in (None, 0, 1, 2), f"exit code {code}"
    assert "Traceback" not in printed.getvalue(), printed.getvalue()
    if code:
        assert "error: " in printed.getvalue(), "no message"
        raise AdvercityError(printed.getvalue())


def read_view(view: AgentView) -> list[AdvercityError]:
    """Read everything of an agent; return what its readers refused."""
    return try_each(
        [
            *(lambda: view.boxes, lambda: view.extras, lambda: view.cloud, lambda: view.speed_m_s),
            *(lambda: view.world_from_agent, lambda: view.world_from_lidar, lambda: view.image(0)),
            *(lambda: view.world_from_camera(0), lambda: view.intrinsic(0)),
            *(lambda: view.semantic(0), lambda: view.depth(0), lambda: view.depth_cm(0)),
            *(lambda: view.bird_view("dynamic"), lambda: view.measured, lambda: view.can),
            *(lambda: view.load_radar(0), lambda: view.load_radar_cube(0), lambda: view.motion),
            *(lambda: view.pixels(0, np.ones((1, 3))), lambda: view.load_lidar_pose(0)),
            *(lambda: view.instance(0), lambda: view.normal(0), lambda: view.flow(0)),
            *(lambda: view.hdr(0), lambda: view.raw(0), lambda: view.load_readout(0)),
            *(lambda: view.camera_model(0), lambda: view.load_radar_pose(0)),
            *(lambda: view.thermal(0), lambda: view.thermal_semantic(0), lambda: view.stamps),
            *(lambda: view.thermal_instance(0), lambda: view.load_thermal_model(0)),
            *(view.load_velocities, view.load_messages_document),
        ]
    )


def read_samples(scenario: Scenario) -> list[AdvercityError]:
    """Read the samples of every agent of a scenario; return what was refused."""
    kinds: tuple[SampleKind, ...] = ("gnss", "imu", "can")
    reads: list[Callable[[], object]] = [lambda: scenario.roles]
    for agent in scenario.agents:
        reads += [partial(scenario.load_samples, agent, kind) for kind in kinds]
        reads.append(partial(scenario.load_stamps, agent))
    return try_each(reads)


def try_each(reads: Iterable[Callable[[], object]]) -> list[AdvercityError]:
    """Call readers; return what they refused."""
    refused: list[AdvercityError] = []
    for read in reads:
        try:
            read()
        except AdvercityError as error:
            refused.append(error)
    return refused


class TraceFuzzer:
    """Damages a trace as `simulate` writes it, and reads it.

    Args:
        trace: The trace.
        folder: An empty folder to work in.
    """

    def __init__(self, trace: Trace, folder: Path) -> None:
        self._path = folder / "trace.npz"
        trace.save(self._path)
        self._raw = self._path.read_bytes()

    def check(self, number: int, seed: int) -> tuple[str, str]:
        """Damage it; return its kind, and `read` or `refused`; anything else is raised."""
        rng = create_generator(seed, "trace", number)
        damage = damage_arrays if number % 2 else damage_bytes
        damaged = damage(self._raw, rng)
        self._path.write_bytes(damaged)
        with time_limit():
            try:
                trace = Trace.load(self._path)
            except AdvercityError as error:
                assert str(error).startswith(str(self._path)), "no file in the message"
                return "trace", "refused"
            for index in range(len(trace)):
                trace.build_frame(index)
            trace.compute_sha256()
        return "trace", "read"


OF_OTHERS_IN_CACHE = (
    "notes.txt",
    "traces/mine.npz",
    "worlds/notes.txt",
    "networks/mine/road.net.xml",
)


class CacheFuzzer:
    """Damages entries of the cache, with and without their checksums, and uses it.

    Args:
        entries: Content of the entries by name, one of each kind and several bodies.
        folder: An empty folder to work in, which is the cache.
    """

    def __init__(self, entries: Tree, folder: Path) -> None:
        self._folder = folder / "cache"
        self._folder.mkdir()
        (folder / "outside.txt").write_text("of others")
        self._outside = folder / "outside.txt"
        self._entries = entries
        checksums = {
            f"{name}.sha256": f"{hashlib.sha256(content).hexdigest()}  {name}\n".encode()
            for name, content in entries.items()
            if name != RECORDS_FILE
        }
        self._tree = {**entries, **checksums}
        self._strangers = {path: f"of others: {path}".encode() for path in OF_OTHERS_IN_CACHE}

    def check(self, number: int, seed: int) -> tuple[str, str]:
        """Damage an entry; return its kind, and what came of it; anything else is raised."""
        rng = create_generator(seed, "cache", number)
        write_tree(self._folder, {**self._tree, **self._strangers})
        name = choose(sorted(self._entries), rng)
        path, checksum = self._folder / name, self._folder / f"{name}.sha256"
        is_entry = name != RECORDS_FILE
        if is_entry and rng.random() < 0.2:
            damage_file(checksum, self._outside, rng)
        else:
            damage_file(path, self._outside, rng)
            if is_entry and path.is_file() and rng.random() < 0.5:
                digest = hashlib.sha256(path.read_bytes()).hexdigest()
                checksum.write_text(f"{digest}  {name}\n")
        outcome = "read"
        with time_limit(), patch.dict(os.environ, ADVERCITY_CACHE=str(self._folder)):
            try:
                if rng.random() < 0.1:
                    run_command("cache", choose(["show", "prune", "clear"], rng))
                else:
                    self._load(name)
            except AdvercityError as error:
                assert str(error).strip(), "empty message"
                outcome = "refused"
        found = read_tree(self._folder)
        for stranger, content in self._strangers.items():
            assert found[stranger] == content, f"{stranger} is lost"
        assert self._outside.read_text() == "of others", "written through a link"
        return f"cache: {name.partition('/')[0]}", outcome

    def _load(self, name: str) -> None:
        kind = name.partition("/")[0]
        if kind == RECORDS_FILE:
            load_records(backend="fake", renderer="raster", format="opv2v")
        elif kind == "maps":
            _ = SurfaceMaps()[MAPPED_SURFACE]
        else:
            loaded = load_or_build_entry(name, self._write_entry, LOADERS[kind])
            check_loaded(loaded)

    def _write_entry(self, partial: Path) -> None:
        """Make an entry again, as it was."""
        (name,) = (one for one in self._entries if one.endswith(partial.name))
        partial.write_bytes(self._entries[name])


MAPPED_SURFACE = "asphalt"
"""The surface whose images are an entry of the fuzzed cache."""
LOADERS: dict[str, Callable[[Path], object]] = {
    "networks": lambda path: path,
    "traces": Trace.load,
    "worlds": lambda path: load_world(path, Path("road.net.xml")),
    "bodies": load_body,
}
"""What loads an entry, by kind."""


def check_loaded(loaded: object) -> None:
    """Use what was loaded as renderers do, which index without looking."""
    meshes = loaded.static if isinstance(loaded, World) else ()
    for mesh in loaded.parts if isinstance(loaded, Body) else meshes:
        assert not mesh.triangles.size or mesh.triangles.min() >= 0, mesh.name
        assert mesh.triangles.max(initial=-1) < len(mesh.vertices), mesh.name
