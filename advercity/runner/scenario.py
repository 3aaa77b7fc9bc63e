"""One scenario from spec to dataset: traffic once, then every frame on its own."""

from collections.abc import Callable, Collection, Sequence
from contextlib import nullcontext
from functools import partial
from itertools import chain
from pathlib import Path
from threading import Lock

from advercity_dsl import Spec

from advercity.dataset.frame_writer import FrameWriter
from advercity.dataset.manifest import Manifest
from advercity.dataset.reader import Scenario
from advercity.dataset.writer import DatasetWriter
from advercity.errors import RunError
from advercity.runner.behind import Behind
from advercity.runner.companions import Companions
from advercity.runner.options import Options, ViewerTarget
from advercity.runner.preparation import Preparation, prepare
from advercity.runner.progress import Progress, Report, no_report
from advercity.runner.replay import stored_readings
from advercity.runner.sensing import senses
from advercity.runner.stage import Stage, world_of
from advercity.runner.viewpoints import Viewpoints
from advercity.viewer.events import conflict_events
from advercity.viewer.recording import Recording
from advercity.world.roads import built


def run_scenario(
    spec: Spec, options: Options, report: Report = no_report, *, processes: int = 1
) -> Path:
    """Make the frames of a scenario that are not there yet; the scenario's folder.

    Args:
        spec: The scenario.
        options: How to run it.
        report: Told of progress; from several threads if there are several processes.
        processes: That make its frames, this one included; one alone if they are to be seen live.

    Raises:
        InputError: No such backend, or no such frames.
        RunError: Something failed; what is finished stays, and the same call goes on from there.
    """
    prepared = prepare(spec, options, report)
    writer = DatasetWriter(
        options.output, spec, prepared.identity, length=prepared.length, fresh=options.fresh
    )
    # A viewer that cannot be had is found out before anything of the dataset is touched.
    with _recording(spec, prepared.stage, options.viewer) as recording, writer:
        if recording is not None:
            _make_and_show(spec, prepared, writer, recording, report)
        elif not writer.done.issuperset(prepared.wanted):
            _make(spec, options, prepared, writer, report, processes)
        manifest = writer.finish()
    lost = _absent(prepared, manifest.frames)
    if lost:
        raise RunError(f"{writer.scenario}: no process made frame {lost[0]}; run again to go on")
    count = len(prepared.wanted)
    report(Progress(spec.id, "done", count, count, manifest.size_bytes))
    return writer.scenario


def add_frames(spec: Spec, options: Options, process: int, report: Report) -> None:
    """Make frames of a scenario that another process has open, as long as it leaves any.

    Args:
        spec: The scenario.
        options: Of the run.
        process: Number of this one, above 0.
        report: Told of what is made here.

    Raises:
        RunError: Something failed, or is other here than there.
    """
    prepared, scenario = prepare(spec, options), options.output / spec.id
    begun = Manifest.load(scenario)
    differences = begun.identity.differences(prepared.identity)
    if differences:
        raise RunError(f"{scenario}: its processes differ ({'; '.join(differences)}); --jobs 1")
    writer = FrameWriter(scenario, spec, options.format, process)
    made = 0

    def tell(count: int) -> None:
        nonlocal made
        made = count
        report(Progress(spec.id, "frames", made, 0, writer.size_bytes))

    _add_frames(spec, prepared, _absent(prepared, begun.frames), writer, tell)
    report(Progress(spec.id, "done", made, made, writer.size_bytes))


def _make(
    spec: Spec,
    options: Options,
    prepared: Preparation,
    writer: DatasetWriter,
    report: Report,
    processes: int,
) -> None:
    """Make every frame that is not there, with other processes."""
    absent, total = _absent(prepared, writer.done), len(prepared.wanted)
    made = total - len(absent)
    one_at_a_time = Lock()

    def tell() -> None:
        with one_at_a_time:
            size_bytes = writer.size_bytes + companions.size_bytes
            report(Progress(spec.id, "frames", made + companions.frames, total, size_bytes))

    def go_on(count: int) -> None:
        nonlocal made
        made = total - len(absent) + count
        companions.check()
        tell()

    count = min(processes, len(absent)) - 1
    if count:
        world_of(spec, prepared.stage.network)  # into the cache, where companions find it
    companions = Companions(spec, options, count, lock=writer.lock, changed=tell)
    with companions:
        _add_frames(spec, prepared, absent, writer, go_on)


def _add_frames(
    spec: Spec,
    prepared: Preparation,
    absent: Sequence[int],
    writer: FrameWriter | DatasetWriter,
    go_on: Callable[[int], None],
) -> None:
    """Make frames that nobody else has claimed.

    Args:
        spec: The scenario.
        prepared: What they are made with.
        absent: Frames that are not there.
        writer: Takes them.
        go_on: Called with the number of frames sensed so far, before each and at the end.
    """
    count = 0
    claimed = filter(writer.claim, absent)
    first = next(claimed, None)
    if first is None:
        return
    viewpoints = Viewpoints(spec, prepared.stage.trace)
    with (
        Behind() as behind,
        senses(viewpoints, prepared.stage, prepared.backend, prepared.profile) as sensed,
    ):
        for index in chain([first], claimed):
            go_on(count)
            behind.run(partial(writer.write, index, sensed.read(index)))
            count += 1
    go_on(count)


def _make_and_show(
    spec: Spec,
    prepared: Preparation,
    writer: DatasetWriter,
    recording: Recording,
    report: Report,
) -> None:
    """Show every wanted frame in turn: from the files where it is done, else as it is made."""
    doing = f"frames, live at {recording.address}" if recording.address else "frames"
    viewpoints, stored = Viewpoints(spec, prepared.stage.trace), Scenario(writer.scenario)
    done = writer.done
    sensing = (
        nullcontext()
        if done.issuperset(prepared.wanted)
        else senses(viewpoints, prepared.stage, prepared.backend, prepared.profile)
    )
    with Behind() as behind, sensing as sensed:
        for count, index in enumerate(prepared.wanted):
            report(Progress(spec.id, doing, count, len(prepared.wanted), writer.size_bytes))
            if sensed is None or index in done:
                recording.log(stored_readings(stored, viewpoints, index))
            else:
                readings = sensed.read(index)
                behind.run(partial(writer.write, index, readings))
                recording.log(readings)


def _absent(prepared: Preparation, done: Collection[int]) -> list[int]:
    return sorted({*prepared.wanted}.difference(done))


def _recording(spec: Spec, stage: Stage, viewer: ViewerTarget) -> Recording | nullcontext[None]:
    if not viewer.is_asked_for:
        return nullcontext()
    return Recording(
        spec,
        built(spec.road).lanes,
        file=viewer.file,
        serve=viewer.serve,
        connect=viewer.connect,
        cloud_colour=viewer.cloud_colour,
        events=conflict_events(spec, stage.trace),
    )
