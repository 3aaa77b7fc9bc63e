"""One scenario from spec to dataset: traffic once, then every frame on its own."""

from collections.abc import Iterator
from contextlib import nullcontext
from functools import partial
from pathlib import Path

from advercity_dsl import Spec

from advercity.dataset.manifest import Identity, RendererIdentity
from advercity.dataset.reader import Scenario
from advercity.dataset.reading import Reading
from advercity.dataset.writer import DatasetWriter
from advercity.errors import BackendError, InputError
from advercity.rendering.backend import PROFILES, Backend, Capabilities, Profile
from advercity.rendering.registry import load_backend
from advercity.runner.behind import Behind
from advercity.runner.cache import model_digests
from advercity.runner.options import Options, ViewerTarget
from advercity.runner.progress import Progress, Report, no_report
from advercity.runner.replay import stored_readings
from advercity.runner.sensing import senses
from advercity.runner.stage import Stage, set_stage
from advercity.runner.viewpoints import Viewpoints
from advercity.sources import source_digest
from advercity.viewer.events import conflict_events
from advercity.viewer.recording import Recording
from advercity.world.roads import built


def run_scenario(spec: Spec, options: Options, report: Report = no_report) -> Path:
    """Make the frames of a scenario that are not there yet; the scenario's folder.

    Raises:
        InputError: No such backend, or no such frames.
        RunError: Something failed; what is finished stays, and the same call goes on from there.
    """
    backend = load_backend(options.backend)
    capabilities = backend.capabilities()
    profile = choose_profile(options, capabilities)
    report(Progress(spec.id, "traffic"))
    stage = set_stage(spec)
    wanted = wanted_frames(spec, stage, options)
    identity = Identity.of(
        spec,
        trace_sha256=stage.trace_sha256,
        renderer=renderer_identity(backend, profile),
        bodies=model_digests(spec),
        format=options.format,
    )
    writer = DatasetWriter(
        options.output, spec, identity, length=len(stage.trace), fresh=options.fresh
    )
    # A viewer that cannot be had is found out before anything of the dataset is touched.
    with _recording(spec, stage, options.viewer) as recording, writer:
        if recording is not None or not writer.done.issuperset(wanted):
            viewpoints = Viewpoints(spec, stage.trace)
            readings = _readings(viewpoints, stage, writer, wanted, backend, profile)
            watched = recording is not None and recording.address
            doing = f"frames, live at {watched}" if watched else "frames"
            with Behind() as behind:
                for count, (index, reading) in enumerate(readings):
                    report(Progress(spec.id, doing, count, len(wanted), writer.size_bytes))
                    if index not in writer.done:
                        behind.run(partial(writer.write, index, reading))
                    if recording is not None:
                        recording.log(reading)
        writer.finish()
    report(Progress(spec.id, "done", len(wanted), len(wanted), writer.size_bytes))
    return writer.scenario


def choose_profile(options: Options, capabilities: Capabilities) -> Profile:
    """The profile asked for; `auto` is `full` where hardware traces rays, else `preview`."""
    name = options.profile
    if name == "auto":
        name = "full" if capabilities.ray_traced and capabilities.hardware else "preview"
    profile = PROFILES[name]
    if profile.renderer == "ray_traced" and not capabilities.ray_traced:
        raise BackendError(
            f"profile '{name}' traces rays, which {capabilities.device} cannot;"
            " use --profile preview"
        )
    return profile.scaled(options.scale)


def wanted_frames(spec: Spec, stage: Stage, options: Options) -> range:
    """The frames of a scenario that are asked for; InputError if there are none of them."""
    wanted = options.frames.of(len(stage.trace))
    if not wanted:
        raise InputError(
            f"--frames begins at {options.frames.first}, but {spec.id}"
            f" has frames 0 to {len(stage.trace) - 1}"
        )
    return wanted


def _readings(
    viewpoints: Viewpoints,
    stage: Stage,
    writer: DatasetWriter,
    wanted: range,
    backend: Backend,
    profile: Profile,
) -> Iterator[tuple[int, tuple[Reading, ...]]]:
    """Every wanted frame with its readings: sensed, or from the files where it is done."""
    done = writer.done
    stored = Scenario(writer.scenario)
    if done.issuperset(wanted):
        for index in wanted:
            yield index, stored_readings(stored, viewpoints, index)
        return
    with senses(viewpoints, stage, backend, profile) as sensed:
        for index in wanted:
            if index in done:
                yield index, stored_readings(stored, viewpoints, index)
            else:
                yield index, sensed.read(index)


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


def renderer_identity(backend: Backend, profile: Profile) -> RendererIdentity:
    """Whatever of backend, its sources, device and profile changes pictures."""
    return {
        "backend": backend.name,
        "backend_sha256": source_digest(type(backend).__module__.partition(".")[0]),
        "device": backend.capabilities().device,
        "renderer": profile.renderer,
        "scale": profile.scale,
        "samples": profile.samples,
        "path_depth": profile.path_depth,
        "denoise": profile.denoise,
    }
