"""What has to be known of a scenario before frames of it can be made."""

from dataclasses import dataclass

from advercity_dsl import Spec

from advercity.dataset.manifest import Identity, RendererIdentity
from advercity.errors import BackendError, InputError
from advercity.rendering.backend import PROFILES, Backend, Capabilities, Profile
from advercity.rendering.registry import load_backend
from advercity.runner.cache import model_digests
from advercity.runner.options import Options
from advercity.runner.progress import Progress, Report, no_report
from advercity.runner.stage import Stage, set_stage
from advercity.sources import source_digest


@dataclass(frozen=True)
class Preparation:
    """What frames are made with.

    Attributes:
        backend: That renders them.
        profile: How well.
        stage: Where, and who is there.
        identity: What decides their bytes.
        wanted: The frames that are asked for.
    """

    backend: Backend
    profile: Profile
    stage: Stage
    identity: Identity
    wanted: range

    @property
    def length(self) -> int:
        """Frames of the whole scenario."""
        return len(self.stage.trace)


def prepare(spec: Spec, options: Options, report: Report = no_report) -> Preparation:
    """Find the backend and simulate the traffic.

    Raises:
        InputError: No such backend, or no such frames.
        BackendError: It cannot do what the profile asks for.
        RunError: The traffic fails.
    """
    backend = load_backend(options.backend)
    profile = choose_profile(options, backend.capabilities())
    report(Progress(spec.id, "traffic"))
    stage = set_stage(spec)
    wanted = options.frames.of(len(stage.trace))
    if not wanted:
        raise InputError(
            f"--frames begins at {options.frames.first}, but {spec.id}"
            f" has frames 0 to {len(stage.trace) - 1}"
        )
    identity = identity_of(spec, stage, backend, profile, format=options.format)
    return Preparation(backend, profile, stage, identity, wanted)


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


def identity_of(
    spec: Spec, stage: Stage, backend: Backend, profile: Profile, *, format: str
) -> Identity:
    """What decides the bytes of `spec` in a layout, with the pictures of a backend."""
    return Identity.of(
        spec,
        trace_sha256=stage.trace_sha256,
        renderer=_renderer_identity(backend, profile),
        bodies=model_digests(spec),
        format=format,
    )


def _renderer_identity(backend: Backend, profile: Profile) -> RendererIdentity:
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
