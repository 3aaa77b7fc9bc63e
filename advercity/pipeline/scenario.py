"""Work in a thread behind the one that renders: encoding and writing cost no time of their own.

One scenario from spec to dataset: traffic once, then every frame on its own.

Makes damaged files of a dataset again, from the spec that its manifest holds.
"""

from collections.abc import Callable, Collection, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import nullcontext
from functools import partial
from itertools import chain
from pathlib import Path
from threading import Lock
from types import TracebackType
from typing import Self

from advercity_dsl import Spec
from pydantic import TypeAdapter

from advercity.conflicts.report import find_conflict_events
from advercity.dataset.manifest import Identity, Manifest
from advercity.dataset.reader import Scenario
from advercity.dataset.scenario_folders import find_scenarios
from advercity.dataset.verification import (
    FileProblem,
    compare_with_index,
    restore_files,
    verify_scenario,
)
from advercity.dataset.writer import FrameWriter, ScenarioWriter
from advercity.errors import RunError
from advercity.pipeline.options import RunOptions, ViewerTarget
from advercity.pipeline.preparation import (
    PreparedScenario,
    load_or_simulate_traffic,
    prepare_scenario,
)
from advercity.pipeline.progress import Progress, ProgressCallback, ignore_progress
from advercity.pipeline.replay import load_sensor_frames
from advercity.pipeline.sensing import open_sensors
from advercity.pipeline.workers import WorkerGroup
from advercity.rendering.backend import RenderProfile, load_backend
from advercity.roads.road_network import build_road
from advercity.sensors.sensor_frame import SensorFrame
from advercity.viewer.recording import RerunRecording


class BackgroundWriter:
    """Does jobs one after the other in a thread of its own; a context manager.

    One job is at work at most, so that memory holds two frames at most. An error of a job is
    raised by the next call, or at the end.
    """

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(1)
        self._running: Future[None] | None = None

    def submit(self, job: Callable[[], None]) -> None:
        """Wait for the job before, and start this one."""
        self._wait()
        self._running = self._pool.submit(job)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        with self._pool:
            if error is None:
                self._wait()

    def _wait(self) -> None:
        if self._running is not None:
            self._running.result()


def run_scenario(
    spec: Spec,
    options: RunOptions,
    report: ProgressCallback = ignore_progress,
    *,
    worker_count: int = 1,
) -> Path:
    """Make the frames of a scenario that are not there yet; the scenario's folder.

    Args:
        spec: The scenario.
        options: How to run it.
        report: Told of progress; from several threads if there are several processes.
        worker_count: Processes that make its frames, this one included; a live view needs one.

    Raises:
        InputError: No such backend, or no such frames.
        RunError: Something failed; what is finished stays, and the same call goes on from there.
    """
    prepared = prepare_scenario(spec, options, report)
    writer = ScenarioWriter(
        options.output, spec, prepared.identity, length=prepared.frame_count, fresh=options.fresh
    )
    # A viewer that cannot be had is found out before anything of the dataset is touched.
    with _open_recording(prepared, options.viewer) as recording, writer:
        if recording is not None:
            _make_and_record(prepared, writer, recording, report)
        elif not writer.done_frames.issuperset(prepared.frames):
            _make_frames(spec, options, prepared, writer, report, worker_count)
        manifest = writer.finish()
    lost = _find_missing_frames(prepared, manifest.frames)
    if lost:
        raise RunError(f"{writer.scenario}: no process made frame {lost[0]}; run again to go on")
    count = len(prepared.frames)
    report(Progress(spec.id, "done", count, count, manifest.size_bytes))
    return writer.scenario


def add_frames(
    spec: Spec, options: RunOptions, worker_index: int, report: ProgressCallback
) -> None:
    """Make frames of a scenario that another process has open, as long as it leaves any.

    Args:
        spec: The scenario.
        options: Of the run.
        worker_index: Number of this one, above 0.
        report: Told of what is made here.

    Raises:
        RunError: Something failed, or is other here than there.
    """
    prepared, scenario = prepare_scenario(spec, options), options.output / spec.id
    begun = Manifest.load(scenario)
    differences = begun.identity.list_differences(prepared.identity)
    if differences:
        raise RunError(f"{scenario}: its processes differ ({'; '.join(differences)}); --jobs 1")
    writer = FrameWriter(scenario, spec, options.format, worker_index)
    made = 0

    def tell(count: int) -> None:
        nonlocal made
        made = count
        report(Progress(spec.id, "frames", made, 0, writer.size_bytes))

    _make_claimed_frames(prepared, _find_missing_frames(prepared, begun.frames), writer, tell)
    report(Progress(spec.id, "done", made, made, writer.size_bytes))


def _make_frames(
    spec: Spec,
    options: RunOptions,
    prepared: PreparedScenario,
    writer: ScenarioWriter,
    report: ProgressCallback,
    processes: int,
) -> None:
    """Make every frame that is not there, with other processes."""
    absent, total = _find_missing_frames(prepared, writer.done_frames), len(prepared.frames)
    made = total - len(absent)
    one_at_a_time = Lock()

    def tell() -> None:
        with one_at_a_time:
            size_bytes = writer.size_bytes + companions.size_bytes
            report(Progress(spec.id, "frames", made + companions.frame_count, total, size_bytes))

    def go_on(count: int) -> None:
        nonlocal made
        made = total - len(absent) + count
        companions.raise_failure()
        tell()

    count = min(processes, len(absent)) - 1
    if count:
        prepared.load_world()  # into the cache, where companions find it
    companions = WorkerGroup(spec, options, count, lock=writer.lock_descriptor, on_change=tell)
    with companions:
        _make_claimed_frames(prepared, absent, writer, go_on)


def _make_claimed_frames(
    prepared: PreparedScenario,
    absent: Sequence[int],
    writer: FrameWriter | ScenarioWriter,
    on_frame: Callable[[int], None],
) -> None:
    """Make frames that nobody else has claimed.

    Args:
        prepared: What they are made with.
        absent: Frames that are not there.
        writer: Takes them.
        on_frame: Called with the number of frames sensed so far, before each and at the end.
    """
    count = 0
    claimed = filter(writer.claim_frame, absent)
    first = next(claimed, None)
    if first is None:
        return
    with BackgroundWriter() as behind, open_sensors(prepared) as sensed:
        for index in chain([first], claimed):
            on_frame(count)
            behind.submit(partial(writer.write_frame, index, sensed.capture_frame(index)))
            count += 1
    on_frame(count)


def _make_and_record(
    prepared: PreparedScenario,
    writer: ScenarioWriter,
    recording: RerunRecording,
    report: ProgressCallback,
) -> None:
    """Show every wanted frame in turn: from the files where it is done, else as it is made."""
    doing = f"frames, live at {recording.address}" if recording.address else "frames"
    stored, done = Scenario(writer.scenario), writer.done_frames
    sensing = nullcontext() if done.issuperset(prepared.frames) else open_sensors(prepared)
    with BackgroundWriter() as behind, sensing as sensed:
        for count, index in enumerate(prepared.frames):
            total, size_bytes = len(prepared.frames), writer.size_bytes
            report(Progress(prepared.spec.id, doing, count, total, size_bytes))
            if sensed is None or index in done:
                recording.log_frame(load_sensor_frames(stored, prepared.poses, index))
            else:
                readings = sensed.capture_frame(index)
                behind.submit(partial(writer.write_frame, index, readings))
                recording.log_frame(readings)


def _find_missing_frames(prepared: PreparedScenario, done: Collection[int]) -> list[int]:
    return sorted({*prepared.frames}.difference(done))


def _open_recording(
    prepared: PreparedScenario, viewer: ViewerTarget
) -> RerunRecording | nullcontext[None]:
    if not viewer.is_enabled:
        return nullcontext()
    spec = prepared.spec
    return RerunRecording(
        spec,
        build_road(spec.road).lanes,
        file=viewer.file,
        serve=viewer.serve,
        connect=viewer.connect,
        cloud_colour=viewer.cloud_colour,
        events=find_conflict_events(spec, prepared.traffic.trace),
    )


def repair_dataset(dataset: Path, report: ProgressCallback = ignore_progress) -> list[FileProblem]:
    """Make every missing or changed file of a dataset again; the problems that stay.

    A scenario that is gone, or whose manifest is another one, is for `run` to make again.

    Raises:
        InputError: There is no dataset.
        RunError: The files cannot be made again here, or the disk does not take them.
    """
    left = compare_with_index(dataset)
    for scenario in find_scenarios(dataset):
        problems = verify_scenario(scenario)
        if problems:
            left += _repair_scenario(scenario, problems, report)
    return left


def _repair_scenario(
    scenario: Path, problems: list[FileProblem], report: ProgressCallback
) -> list[FileProblem]:
    if all(problem.frame is None for problem in problems):
        return restore_files(scenario, problems, lambda frame: ())
    manifest = Manifest.load(scenario)
    spec, renderer = manifest.spec, manifest.identity.renderer
    backend = load_backend(str(renderer["backend"]))
    report(Progress(spec.id, "traffic"))
    prepared = PreparedScenario(
        spec,
        load_or_simulate_traffic(spec),
        backend,
        _parse_profile(manifest.identity),
        frames=range(manifest.length),
        format=manifest.identity.format,
    )
    differences = manifest.identity.list_differences(prepared.identity)
    if differences:
        raise RunError(
            f"{scenario}: cannot be repaired here, where something is not as it was"
            f" ({'; '.join(differences)}); repair it with what it was made with, or make it anew"
            " with `advercity run --fresh`"
        )
    damaged = sorted({problem.frame for problem in problems if problem.frame is not None})
    with open_sensors(prepared) as sensed:

        def readings_of(frame: int) -> tuple[SensorFrame, ...]:
            report(Progress(spec.id, "frames", damaged.index(frame), len(damaged)))
            return sensed.capture_frame(frame)

        left = restore_files(scenario, problems, readings_of)
    report(Progress(spec.id, "done", len(damaged), len(damaged)))
    return left


def _parse_profile(identity: Identity) -> RenderProfile:
    """The profile that a manifest tells of."""
    kept = identity.renderer.keys() - {"backend", "backend_sha256", "device"}
    values = {name: identity.renderer[name] for name in kept}
    return TypeAdapter(RenderProfile).validate_python({"name": "as made", **values})
