"""Scenarios, and ranges of frames of long ones, over the nodes and graphics cards of a Ray cluster.

A task makes its frames in a folder of its node, in a process within limits as anywhere, and then
puts them into the store. A task whose node is lost is done again on another one.
"""

import logging
import tempfile
import time
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from advercity_dsl import Spec

from advercity.dataset.index import INDEX_FILE, DatasetIndex, IndexEntry
from advercity.dataset.manifest import Identity
from advercity.dataset.remote import SharedScenario, upload_part
from advercity.dataset.scenario_folders import MANIFEST_FILE
from advercity.dataset.store import LEASE_TIMEOUT_S, DatasetLease, DatasetStore
from advercity.errors import AdvercityError, InputError, RunError
from advercity.pipeline.messages import WorkerJob
from advercity.pipeline.options import ResourceLimits, RunOptions, RunResources
from advercity.pipeline.preparation import prepare_scenario
from advercity.pipeline.progress import Progress, RunListener, ScenarioResult, ignore_progress
from advercity.pipeline.workers import TERMINATION_TIMEOUT_S as ENDING_S
from advercity.pipeline.workers import run_worker

FRAMES_PER_TASK = 50
TASK_RETRIES = 3
"""Of a task whose node is lost."""


@dataclass(frozen=True)
class RayExecutor:
    """Where to run, and where what is made shall lie.

    Attributes:
        output: Folder that all nodes share, or URL of a store.
        address: Of a running cluster, as `ray.init` takes it; None is one on this machine alone.
        frames_per_task: Longer ranges are cut.
        patience_s: How long a dataset that another run began is watched before it is taken over.
    """

    output: str
    address: str | None = None
    frames_per_task: int = FRAMES_PER_TASK
    patience_s: float = LEASE_TIMEOUT_S

    def run(
        self,
        specs: Sequence[Spec],
        options: RunOptions,
        *,
        resources: RunResources,
        listener: RunListener,
    ) -> list[ScenarioResult]:
        """Run every spec; how each ended, in the order of `specs`.

        The bytes are those of a run on one machine of the same kind. The same call goes on where
        an earlier one was cut short.

        Args:
            specs: What to run, all with different ids.
            options: How to run them; `output` is the cluster's.
            listener: Told of progress and ends.
            resources: Limits for each task; Ray itself decides how many run at a time.

        Raises:
            InputError: Ray is not installed, or an option does not fit.
            RunError: There is no such cluster, or another run is making the dataset.
        """
        if options.viewer.is_enabled:
            raise InputError("--rrd, --stream and --connect show a run on this machine alone")
        store = DatasetStore(self.output)
        with DatasetLease(store, self.patience_s) as lease, _connect_ray(self.address) as ray:
            driver = _RayDriver(ray, self, store, lease, options, listener, resources.limits)
            try:
                return driver.run(specs)
            finally:
                driver.close()


@dataclass(frozen=True)
class ScenarioSurvey:
    """What a node finds out before anything is made."""

    wanted: range
    length: int
    identity: Identity


@dataclass
class _ScenarioRun:
    """A scenario that is under way."""

    spec: Spec
    began_s: float = field(default_factory=time.monotonic)
    parts: SharedScenario | None = None
    open_tasks: int = 0
    wanted: int = 0
    done: int = 0
    size_bytes: int = 0
    peak_memory_bytes: int = 0
    error: AdvercityError | None = None

    def progress(self) -> Progress:
        return Progress(self.spec.id, "frames", self.done, self.wanted, self.size_bytes)

    def outcome(self) -> ScenarioResult:
        return ScenarioResult(
            scenario=self.spec.id,
            error=self.error,
            frames=self.done,
            size_bytes=self.size_bytes,
            time_s=time.monotonic() - self.began_s,
            peak_memory_bytes=self.peak_memory_bytes,
        )


def survey_scenario(spec: Spec, options: RunOptions) -> ScenarioSurvey:
    """On a node: how long a scenario is, and what its data would be made by there."""
    prepared = prepare_scenario(spec, options)
    return ScenarioSurvey(prepared.frames, prepared.frame_count, prepared.identity)


def make_task_frames(
    spec: Spec, options: RunOptions, output: str, limits: ResourceLimits
) -> ScenarioResult:
    """On a node: make frames of a scenario and put them into the store."""
    with tempfile.TemporaryDirectory(prefix="advercity_") as folder:
        local = replace(options, output=Path(folder))
        outcome = run_worker(WorkerJob(spec, local), limits, ignore_progress)
        if outcome.error is None:
            upload_part(DatasetStore(output), Path(folder) / spec.id)
        return outcome


class _RayDriver:
    """Hands out tasks and brings together what comes back."""

    def __init__(
        self,
        ray: Any,
        cluster: RayExecutor,
        store: DatasetStore,
        lease: DatasetLease,
        options: RunOptions,
        watcher: RunListener,
        limits: ResourceLimits,
    ) -> None:
        self._ray, self._cluster = ray, cluster
        self._store, self._lease = store, lease
        self._options, self._watcher, self._limits = options, watcher, limits
        gpus = 1 if self._ray.cluster_resources().get("GPU", 0) else 0
        asked = {"num_cpus": 1, "num_gpus": gpus, "max_retries": TASK_RETRIES}
        if limits.memory_bytes is not None:
            asked["memory"] = limits.memory_bytes
        self._survey, self._make = (
            self._ray.remote(**asked)(task) for task in (survey_scenario, make_task_frames)
        )
        self._pending: dict[Any, _ScenarioRun] = {}

    def run(self, specs: Sequence[Spec]) -> list[ScenarioResult]:
        """All of them, to the end."""
        runs = [_ScenarioRun(spec) for spec in specs]
        self._update_index(specs, {})
        for run in runs:
            self._track_task(run, self._survey.remote(run.spec, self._options))
        while self._pending:
            (ready, *_), _ = self._ray.wait(list(self._pending), num_returns=1)
            run = self._pending.pop(ready)
            run.open_tasks -= 1
            try:
                self._handle_answer(run, ready)
            except self._ray.exceptions.RayError as error:
                run.error = run.error or _translate_ray_error(error)
            except AdvercityError as error:
                run.error = run.error or error
            self._lease.check()
            if not run.open_tasks:
                text = self._store.read(f"{run.spec.id}/{MANIFEST_FILE}")
                entry = IndexEntry.from_manifest_text(run.spec, text, failed=run.error is not None)
                self._update_index((), {run.spec.id: entry})
                self._watcher.on_result(run.outcome())
        return [run.outcome() for run in runs]

    def close(self) -> None:
        """End what is still being done."""
        left = list(self._pending)
        for task in left:
            self._ray.cancel(task)
        if left:
            self._ray.wait(left, num_returns=len(left), timeout=ENDING_S)

    def _update_index(self, waiting: Sequence[Spec], ended: dict[str, IndexEntry]) -> None:
        """In the index, which is this driver's alone as long as it holds the lease."""
        text = self._store.read(INDEX_FILE)
        index = DatasetIndex() if text is None else DatasetIndex.parse(text, where=INDEX_FILE)
        self._store.write(INDEX_FILE, index.with_waiting(waiting).with_entries(ended).to_json())

    def _track_task(self, run: _ScenarioRun, task: Any) -> None:
        self._pending[task] = run
        run.open_tasks += 1

    def _handle_answer(self, run: _ScenarioRun, ready: Any) -> None:
        answer = self._ray.get(ready)
        if isinstance(answer, ScenarioSurvey):
            self._submit_tasks(run, answer)
        else:
            self._record_result(run, answer)
        if not run.open_tasks and run.error is None and run.parts is not None:
            manifest = run.parts.finish()
            run.size_bytes = manifest.size_bytes

    def _submit_tasks(self, run: _ScenarioRun, found: ScenarioSurvey) -> None:
        """A task for every piece of what is not there yet."""
        run.parts = SharedScenario(self._store, run.spec, found.identity, found.length)
        records = run.parts.begin(fresh=self._options.fresh)
        done = {record.frame for record in records.values()}
        pieces = _split_into_tasks(found.wanted, done, self._cluster.frames_per_task)
        run.wanted = len(found.wanted)
        run.done = sum(index in done for index in found.wanted)
        run.size_bytes = sum(record.size for record in records.values())
        for piece in pieces:
            options = replace(
                self._options, frames=slice(piece.start, piece.stop, piece.step), fresh=False
            )
            task = self._make.remote(run.spec, options, self._cluster.output, self._limits)
            self._track_task(run, task)
        self._watcher.on_progress(run.progress())

    def _record_result(self, run: _ScenarioRun, made: ScenarioResult) -> None:
        run.error = run.error or made.error
        run.peak_memory_bytes = max(run.peak_memory_bytes, made.peak_memory_bytes)
        if made.error is None:
            run.done = min(run.wanted, run.done + made.frames)
            run.size_bytes += made.size_bytes
        self._watcher.on_progress(run.progress())


def _split_into_tasks(wanted: range, done: set[int | None], most: int) -> list[range]:
    """Ranges of at most so many frames that hold all that are not done."""
    blocks = [wanted[first : first + most] for first in range(0, len(wanted), most)]
    pieces: list[range] = []
    for block in blocks:
        absent = [place for place, index in enumerate(block) if index not in done]
        if absent:
            pieces.append(block[absent[0] : absent[-1] + 1])
    return pieces


@contextmanager
def _connect_ray(address: str | None) -> Generator[Any]:
    """Ray, with a cluster: a running one, or one that only this machine can reach."""
    try:
        import ray
    except ImportError as error:
        message = "--executor ray: Ray is not installed; pip install 'advercity[ray]'"
        raise InputError(message) from error
    alone: dict[str, Any] = {"_node_ip_address": "127.0.0.1", "include_dashboard": False}
    more = {} if address else alone
    try:
        ray.init(address=address, log_to_driver=False, logging_level=logging.ERROR, **more)
    except (ConnectionError, ValueError) as error:
        raise RunError(f"--address {address}: no Ray cluster answers there: {error}") from error
    try:
        yield ray
    finally:
        ray.shutdown()


def resolve_output(output: str) -> str:
    """A URL as it is; a path as every node that shares the folder knows it."""
    return output if "://" in output else str(Path(output).resolve())


def _translate_ray_error(error: Exception) -> AdvercityError:
    """What a task failed of, or Ray itself."""
    cause = getattr(error, "cause", None)
    if isinstance(cause, AdvercityError):
        return cause
    if cause is not None:
        return RunError(f"a task failed: {type(cause).__name__}: {cause}")
    first = str(error).strip().splitlines()[0]
    return RunError(
        f"lost on the cluster, {TASK_RETRIES} retries in vain: {first}; run again to go on"
    )
