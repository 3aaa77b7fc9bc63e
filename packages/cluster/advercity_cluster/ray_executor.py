"""Runs scenarios, and ranges of frames of long ones, on the nodes and GPUs of a Ray cluster.

A task makes its frames in a temporary folder of its node, with the worker pool of one machine, and
puts them into the store. A task whose node is lost is repeated on another one.
"""

import logging
import socket
import tempfile
import time
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from advercity_dsl import Spec

from advercity.atomic_files import resolve_links
from advercity.dataset.index import EMPTY_INDEX, INDEX_FILE, DatasetIndex, IndexEntry
from advercity.dataset.manifest import Identity
from advercity.dataset.remote import SharedScenario, upload_part
from advercity.dataset.scenario_folders import MANIFEST_FILE
from advercity.dataset.store import LEASE_TIMEOUT_S, DatasetLease, DatasetStore
from advercity.errors import AdvercityError, InputError, RunError
from advercity.pipeline.executors import ExecutorKind, run_scenarios
from advercity.pipeline.preparation import prepare_scenario
from advercity.pipeline.progress import Progress, RunListener, ScenarioResult
from advercity.pipeline.workers import TERMINATION_TIMEOUT_S
from advercity.run_options import ResourceLimits, RunOptions, RunResources

FRAMES_PER_TASK = 50
CONNECT_TIMEOUT_S = 5.0
NO_CLUSTER = "no Ray cluster answers there"
TASK_RETRIES = 3
"""Retries of a task whose node is lost."""


@dataclass(frozen=True)
class RayExecutor:
    """Runs scenarios on a Ray cluster.

    Attributes:
        output: Folder shared by all nodes, or URL of a store.
        address: Running cluster, as `ray.init` takes it; None starts one on this machine alone.
        frames_per_task: Largest number of frames of a task.
        patience_s: Time after which an unrenewed lease is taken over.
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
        """Run every spec; return the results in the order of `specs`.

        Files equal those of a run on one machine of the same kind. The same call resumes an
        interrupted run.

        Args:
            specs: Scenarios to run, all with different ids.
            options: How to run them; this executor's `output` replaces theirs.
            resources: Limits for each task; Ray itself decides how many run at a time.
            listener: Receives progress and results.

        Raises:
            InputError: Ray is not installed, or an option does not fit.
            RunError: No cluster answers, or another run is writing the dataset.
        """
        if options.viewer.is_enabled:
            raise InputError("`rrd`, `stream` and `connect` show runs on this machine only")
        store = DatasetStore(self.output)
        with _connect_ray(self.address) as ray, DatasetLease(store, self.patience_s) as lease:
            driver = _RayDriver(ray, self, store, lease, options, listener, resources.limits)
            try:
                return driver.run(specs)
            finally:
                driver.close()


@dataclass(frozen=True)
class ScenarioSurvey:
    """Frames and identity of a scenario, determined by a node before rendering."""

    wanted: range
    length: int
    identity: Identity


@dataclass
class _ClusterScenario:
    """A running scenario and its result so far."""

    spec: Spec
    began_s: float = field(default_factory=time.monotonic)
    parts: SharedScenario | None = None
    open_tasks: int = 0
    wanted: range = range(0)
    result: ScenarioResult = field(init=False)

    def __post_init__(self) -> None:
        """Begin with an empty result."""
        self.result = ScenarioResult(self.spec.id, None, 0, 0, 0.0, 0)

    @property
    def progress(self) -> Progress:
        frames, size_bytes = self.result.frames, self.result.size_bytes
        return Progress(self.spec.id, "frames", frames, len(self.wanted), size_bytes)

    def add(self, made: ScenarioResult) -> None:
        """Add the result of a task."""
        last = self.result
        if made.error is not None:
            self.fail(made.error)
            return
        self.result = replace(
            last,
            frames=min(len(self.wanted), last.frames + made.frames),
            size_bytes=last.size_bytes + made.size_bytes,
            peak_memory_bytes=max(last.peak_memory_bytes, made.peak_memory_bytes),
        )

    def fail(self, error: AdvercityError) -> None:
        """Record the first error."""
        self.result = replace(self.result, error=self.result.error or error)

    def finish(self) -> ScenarioResult:
        """Return the result with the elapsed time."""
        self.result = replace(self.result, time_s=time.monotonic() - self.began_s)
        return self.result


def survey_scenario(spec: Spec, options: RunOptions) -> ScenarioSurvey:
    """Determine frames and identity of a scenario; runs as a task on a node."""
    prepared = prepare_scenario(spec, options)
    return ScenarioSurvey(prepared.frames, prepared.frame_count, prepared.identity)


def make_task_frames(
    spec: Spec, options: RunOptions, output: str, limits: ResourceLimits
) -> ScenarioResult:
    """Make frames of a scenario and put them into the store; runs as a task on a node."""
    with tempfile.TemporaryDirectory(prefix="advercity_") as folder:
        local = replace(options, output=Path(folder))
        (result,) = run_scenarios([spec], local, resources=RunResources(1, limits))
        if result.error is None:
            upload_part(DatasetStore(output), Path(folder) / spec.id)
        return result


class _RayDriver:
    """Submits tasks and combines their results."""

    def __init__(
        self,
        ray: Any,
        executor: RayExecutor,
        store: DatasetStore,
        lease: DatasetLease,
        options: RunOptions,
        listener: RunListener,
        limits: ResourceLimits,
    ) -> None:
        self._ray, self._executor = ray, executor
        self._store, self._lease = store, lease
        self._options, self._listener, self._limits = options, listener, limits
        gpus = 1 if self._ray.cluster_resources().get("GPU", 0) else 0
        task_options = {"num_cpus": 1, "num_gpus": gpus, "max_retries": TASK_RETRIES}
        if limits.memory_bytes is not None:
            # Ray then starts no more tasks than a node has memory for.
            task_options["memory"] = limits.memory_bytes
        self._survey, self._make = (
            self._ray.remote(**task_options)(task) for task in (survey_scenario, make_task_frames)
        )
        self._pending: dict[Any, _ClusterScenario] = {}

    def run(self, specs: Sequence[Spec]) -> list[ScenarioResult]:
        """Run every spec to its end."""
        runs = [_ClusterScenario(spec) for spec in specs]
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
                run.fail(_translate_ray_error(error))
            except AdvercityError as error:
                run.fail(error)
            self._lease.check()
            if not run.open_tasks:
                self._record_end(run)
        return [run.result for run in runs]

    def close(self) -> None:
        """Cancel the running tasks."""
        left = list(self._pending)
        for task in left:
            self._ray.cancel(task)
        if left:
            self._ray.wait(left, num_returns=len(left), timeout=TERMINATION_TIMEOUT_S)

    def _record_end(self, run: _ClusterScenario) -> None:
        result = run.finish()
        text = self._store.read(f"{run.spec.id}/{MANIFEST_FILE}")
        failed, refused = result.error is not None, not run.wanted
        entry = IndexEntry.from_manifest_text(run.spec, text, failed=failed, refused=refused)
        self._update_index((), {run.spec.id: entry})
        self._listener.on_result(result)

    def _update_index(self, waiting: Sequence[Spec], ended: dict[str, IndexEntry]) -> None:
        # No other run writes the index as long as this driver holds the lease.
        text = self._store.read(INDEX_FILE)
        index = EMPTY_INDEX if text is None else DatasetIndex.parse(text, where=INDEX_FILE)
        self._store.write(INDEX_FILE, index.with_waiting(waiting).with_entries(ended).to_json())

    def _track_task(self, run: _ClusterScenario, task: Any) -> None:
        self._pending[task] = run
        run.open_tasks += 1

    def _handle_answer(self, run: _ClusterScenario, ready: Any) -> None:
        answer = self._ray.get(ready)
        if isinstance(answer, ScenarioSurvey):
            self._submit_tasks(run, answer)
        else:
            run.add(answer)
        self._listener.on_progress(run.progress)
        if not run.open_tasks and run.result.error is None and run.parts is not None:
            manifest = run.parts.finish(run.wanted)
            run.result = replace(run.result, size_bytes=manifest.size_bytes)

    def _submit_tasks(self, run: _ClusterScenario, found: ScenarioSurvey) -> None:
        """Submit a task for every range of missing frames."""
        run.parts = SharedScenario(self._store, run.spec, found.identity, found.length)
        records = run.parts.begin(fresh=self._options.fresh)
        done = {record.frame for record in records.values()}
        run.wanted = found.wanted
        run.result = replace(
            run.result,
            frames=sum(index in done for index in found.wanted),
            size_bytes=sum(record.size for record in records.values()),
        )
        pieces = _split_into_tasks(found.wanted, done, self._executor.frames_per_task)
        if pieces:
            self._update_index((), {run.spec.id: IndexEntry.from_manifest_text(run.spec, None)})
        for piece in pieces:
            frames = slice(piece.start, piece.stop, piece.step)
            options = replace(self._options, frames=frames, fresh=False)
            task = self._make.remote(run.spec, options, self._executor.output, self._limits)
            self._track_task(run, task)


def _split_into_tasks(wanted: range, done: set[int | None], most: int) -> list[range]:
    """Split frames into ranges of at most `most`, trimmed to the missing ones."""
    blocks = [wanted[first : first + most] for first in range(0, len(wanted), most)]
    pieces: list[range] = []
    for block in blocks:
        absent = [place for place, index in enumerate(block) if index not in done]
        if absent:
            pieces.append(block[absent[0] : absent[-1] + 1])
    return pieces


@contextmanager
def _connect_ray(address: str | None) -> Generator[Any]:
    """Connect to a running cluster, or start one on this machine alone."""
    if address is not None:
        _check_address(address)  # before Ray is imported, which takes seconds
    try:
        import ray
    except ImportError as error:
        message = "`executor` ray: Ray is not installed; try: pip install 'advercity[ray]'"
        raise InputError(message) from error
    alone: dict[str, Any] = {"_node_ip_address": "127.0.0.1", "include_dashboard": False}
    more = {} if address else alone
    try:
        ray.init(address=address, log_to_driver=False, logging_level=logging.ERROR, **more)
    except (OSError, RuntimeError, ValueError) as error:
        raise RunError(f"`cluster_address` {address}: {NO_CLUSTER}: {error}") from error
    try:
        yield ray
    finally:
        ray.shutdown()


def _check_address(address: str) -> None:
    """Raise a RunError if `HOST:PORT` does not answer; Ray would wait very long."""
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if port.isdecimal():
        try:
            socket.create_connection((host, int(port)), CONNECT_TIMEOUT_S).close()
        except (OSError, OverflowError, UnicodeError) as error:
            raise RunError(f"`cluster_address` {address}: {NO_CLUSTER}: {error}") from error


def _create_executor(options: RunOptions) -> RayExecutor:
    output = str(options.output)
    # Links may lead elsewhere on other nodes.
    shared = output if "://" in output else str(resolve_links(Path(output)))
    return RayExecutor(shared, options.cluster_address)


RAY = ExecutorKind("ray", _create_executor)


def _translate_ray_error(error: Exception) -> AdvercityError:
    """Return the error raised by a task, or a description of Ray's error."""
    cause = getattr(error, "cause", None)
    if isinstance(cause, AdvercityError):
        return cause
    if cause is not None:
        return RunError(f"a task failed: {type(cause).__name__}: {cause}")
    first = str(error).strip().splitlines()[0]
    return RunError(
        f"task failed after {TASK_RETRIES} retries: {first}; run the same command again to resume"
    )
