"""Runs one scenario from spec to dataset: traffic once, then every frame on its own.

Also repairs datasets: it makes damaged files again from the spec in their manifest.
"""

from collections.abc import Callable, Collection, Generator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

from advercity_dsl import Spec
from pydantic import TypeAdapter

from advercity.dataset.manifest import Identity, Manifest
from advercity.dataset.partial_files import (
    find_staging_folder,
    is_being_written,
    lock_file,
    lock_scenario,
    remove_empty_staging_folder,
)
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
from advercity.pipeline.preparation import (
    PreparedScenario,
    load_or_simulate_traffic,
    prepare_scenario,
)
from advercity.pipeline.progress import Progress, ProgressCallback, ignore_progress
from advercity.pipeline.replay import load_sensor_frames, open_recording
from advercity.pipeline.sensing import open_sensors
from advercity.pipeline.sensor_choice import choose_sensors
from advercity.pipeline.spec_models import check_models, replace_models
from advercity.rendering.backend import RenderProfile, load_backend
from advercity.run_options import MAX_SCALE, MIN_SCALE, RunOptions, ViewerTarget
from advercity.sensors.sensor_frame import SensorFrame

if TYPE_CHECKING:
    from advercity.viewer.recording import RerunRecording

ShareFrames = Callable[[int], AbstractContextManager[None]]
"""Lets other workers join a scenario with so many missing frames; waits for them at the end."""


class BackgroundWriter:
    """Runs one job at a time in a thread: encoding and writing overlap with rendering.

    At most one job runs while the next frame is captured, so memory holds two frames at most.
    """

    def __init__(self, pool: ThreadPoolExecutor) -> None:
        self._pool = pool
        self._running: Future[None] | None = None

    def submit(self, job: Callable[[], None]) -> None:
        """Wait for the previous job, raise its error if it failed, and start this one."""
        self.wait()
        self._running = self._pool.submit(job)

    def wait(self) -> None:
        """Wait for the last job; raise its error if it failed."""
        if self._running is not None:
            self._running.result()


@contextmanager
def open_background_writer() -> Generator[BackgroundWriter]:
    """Open a thread for jobs; at the end, wait for the last one and raise its error."""
    with ThreadPoolExecutor(1) as pool:
        writer = BackgroundWriter(pool)
        yield writer
        writer.wait()


def _work_alone(missing_frames: int) -> AbstractContextManager[None]:
    return nullcontext()


def run_scenario(
    spec: Spec,
    options: RunOptions,
    report: ProgressCallback = ignore_progress,
    *,
    share_frames: ShareFrames = _work_alone,
) -> Path:
    """Make the missing frames of a scenario; return the scenario's folder.

    Args:
        spec: The scenario.
        options: How to run it.
        report: Receives the progress of this process.
        share_frames: Entered while other processes may claim frames, too.

    Raises:
        InputError: The backend or the frames do not exist.
        RunError: Something failed; finished frames stay, and the same call resumes.
    """
    spec = choose_sensors(spec, options)
    # Refuses a second run before the traffic, which may take minutes.
    with lock_scenario(options.folder / spec.id):
        prepared = prepare_scenario(spec, options, report)
    report(Progress(spec.id, "world"))
    writer = ScenarioWriter(
        options.folder, spec, prepared.identity, length=prepared.frame_count, fresh=options.fresh
    )
    # The viewer first: if it cannot be opened, the dataset stays untouched.
    with _open_recording(prepared, options.viewer) as recording, writer:
        if recording is not None:
            _make_and_record(prepared, writer, recording, report)
        else:
            _make_missing_frames(prepared, writer, report, share_frames)
        manifest = writer.finish()
    lost = _find_missing_frames(prepared, manifest.frames)
    if lost:
        raise RunError(
            f"{writer.scenario}: no worker made frame {lost[0]}, or its files were deleted"
            " meanwhile; run the same command again to resume"
        )
    count = len(prepared.frames)
    report(Progress(spec.id, "done", count, count, manifest.size_bytes))
    return writer.scenario


def join_scenario(
    spec: Spec, options: RunOptions, worker_index: int, report: ProgressCallback
) -> None:
    """Make frames of a scenario opened by another process, until none is left to claim.

    Args:
        spec: The scenario.
        options: Options of the run.
        worker_index: Number of this worker, above 0; it names its journal.
        report: Receives the progress of this worker alone.

    Raises:
        RunError: Something failed, or this process would write other bytes.
    """
    prepared, scenario = prepare_scenario(spec, options), options.folder / spec.id
    with lock_file(find_staging_folder(scenario) / "lock", shared=True):
        begun = Manifest.load(scenario)
        differences = begun.identity.list_differences(prepared.identity)
        if differences:
            raise RunError(
                f"{scenario}: its workers differ ({'; '.join(differences)}); use `jobs` 1"
            )
        writer = FrameWriter(
            scenario, spec, prepared.identity, length=begun.length, process=worker_index
        )

        def report_count(count: int, phase: str = "frames") -> None:
            report(Progress(spec.id, phase, count, 0, writer.size_bytes))

        missing = _find_missing_frames(prepared, begun.frames)
        count = _make_claimed_frames(prepared, missing, writer, report_count)
        report_count(count, "done")


def _make_missing_frames(
    prepared: PreparedScenario,
    writer: ScenarioWriter,
    report: ProgressCallback,
    share_frames: ShareFrames,
) -> None:
    missing, total = _find_missing_frames(prepared, writer.done_frames), len(prepared.frames)
    if not missing:
        return

    def report_count(count: int, phase: str = "frames") -> None:
        done = total - len(missing) + count
        report(Progress(prepared.spec.id, phase, done, total, writer.size_bytes))

    prepared.load_world()  # into the cache, before other workers join and load it
    report_count(0, "renderer")
    with share_frames(len(missing)):
        _make_claimed_frames(prepared, missing, writer, report_count)


def _make_claimed_frames(
    prepared: PreparedScenario,
    missing: Sequence[int],
    writer: FrameWriter | ScenarioWriter,
    on_frame: Callable[[int], None],
) -> int:
    """Make missing frames not claimed by other workers; return their number.

    `on_frame` gets the number of frames captured so far, before each and at the end.
    """
    count = 0
    claimed = filter(writer.claim_frame, missing)
    first = next(claimed, None)
    if first is None:
        return 0  # without opening the renderer, which takes seconds
    with open_background_writer() as background, open_sensors(prepared) as sensors:
        for index in chain([first], claimed):
            on_frame(count)
            background.submit(partial(writer.write_frame, index, sensors.capture_frame(index)))
            count += 1
    on_frame(count)
    return count


def _make_and_record(
    prepared: PreparedScenario,
    writer: ScenarioWriter,
    recording: "RerunRecording",
    report: ProgressCallback,
) -> None:
    """Show the requested frames in order: finished ones from files, others when captured."""
    stored, done = Scenario(writer.scenario), writer.done_frames
    is_complete = done.issuperset(prepared.frames)
    if not is_complete:
        report(Progress(prepared.spec.id, "renderer"))
    sensing = nullcontext() if is_complete else open_sensors(prepared)
    with open_background_writer() as background, sensing as sensors:
        for count, index in enumerate(prepared.frames):
            total, size_bytes = len(prepared.frames), writer.size_bytes
            progress = Progress(
                prepared.spec.id, "frames", count, total, size_bytes, recording.address
            )
            report(progress)
            if sensors is None or index in done:
                recording.log_frame(load_sensor_frames(stored, prepared.poses, index))
            else:
                captured = sensors.capture_frame(index)
                background.submit(partial(writer.write_frame, index, captured))
                recording.log_frame(captured)


def _find_missing_frames(prepared: PreparedScenario, done: Collection[int]) -> list[int]:
    return sorted({*prepared.frames}.difference(done))


def _open_recording(
    prepared: PreparedScenario, viewer: ViewerTarget
) -> "RerunRecording | nullcontext[None]":
    if not viewer.is_enabled:
        return nullcontext()
    return open_recording(prepared.spec, prepared.traffic.trace, viewer)


def repair_dataset(dataset: Path, report: ProgressCallback = ignore_progress) -> list[FileProblem]:
    """Make missing and changed files of a dataset again; return the remaining problems.

    A missing scenario, or one with another manifest, has to be run again.

    Raises:
        InputError: The folder is no dataset.
        RunError: The files cannot be reproduced on this machine, or cannot be written.
    """
    left = compare_with_index(dataset)
    for scenario in find_scenarios(dataset):
        problems = verify_scenario(scenario)
        is_damaged = any(problem.is_damage for problem in problems)
        left += _repair_scenario(scenario, problems, report) if is_damaged else problems
        if not is_damaged and not is_being_written(scenario):
            remove_empty_staging_folder(scenario)
    return left


def _repair_scenario(
    scenario: Path, problems: list[FileProblem], report: ProgressCallback
) -> list[FileProblem]:
    if all(problem.frame is None for problem in problems):
        return restore_files(scenario, problems, lambda frame: ())
    manifest = Manifest.load(scenario)
    spec = manifest.spec
    backend_name, profile = _parse_renderer(scenario, manifest.identity)
    backend = load_backend(backend_name)
    report(Progress(spec.id, "traffic"))
    prepared = PreparedScenario(
        spec,
        load_or_simulate_traffic(spec),
        backend,
        profile,
        frames=range(manifest.length),
        options=manifest.identity.options,
        missing_models=manifest.identity.missing_models,
        edited=manifest.identity.edited,
        missed_conflicts=manifest.identity.missed_conflicts,
    )
    differences = manifest.identity.list_differences(prepared.identity)
    if manifest.length != prepared.frame_count:
        differences.append(f"length: {manifest.length}, {prepared.frame_count}")
    if differences:
        raise RunError(
            f"{scenario}: cannot be repaired here, where something differs"
            f" ({'; '.join(differences)}); repair it with its original version and"
            " device, or make it again with `advercity run --fresh`"
        )
    shown = replace_models(spec, manifest.identity.missing_models)
    check_models([shown], allow_missing=False)
    damaged = sorted({problem.frame for problem in problems if problem.frame is not None})
    with open_sensors(prepared) as sensors:

        def capture_frame(frame: int) -> tuple[SensorFrame, ...]:
            report(Progress(spec.id, "frames", damaged.index(frame), len(damaged)))
            return sensors.capture_frame(frame)

        left = restore_files(scenario, problems, capture_frame)
    report(Progress(spec.id, "done", len(damaged), len(damaged)))
    return left


def _parse_renderer(scenario: Path, identity: Identity) -> tuple[str, RenderProfile]:
    """Rebuild backend and profile from a manifest; RunError if no run can have them."""
    values = {"name": "as made", **identity.renderer}
    backend = values.pop("backend", None)
    for name in ("backend_sha256", "device"):
        values.pop(name, None)
    try:
        profile = TypeAdapter(RenderProfile).validate_python(values)
        if not isinstance(backend, str) or not MIN_SCALE <= profile.scale <= MAX_SCALE:
            raise ValueError("no backend, or a scale outside the limits")
    except ValueError as error:
        raise RunError(
            f"{scenario}: its manifest names no valid renderer; make it again with"
            " `advercity run --fresh`"
        ) from error
    return backend, profile
