"""What a scenario needs before its first frame: road network and traffic, from the cache or new.

What has to be known of a scenario before frames of it can be made.
"""

from dataclasses import dataclass
from pathlib import Path

from advercity_dsl import Spec

from advercity.dataset.manifest import Identity, RendererIdentity
from advercity.digests import compute_source_digest
from advercity.errors import BackendError, InputError
from advercity.frames import Trace
from advercity.pipeline.cache import (
    build_cached,
    compute_model_digests,
    compute_road_key,
    compute_traffic_key,
    compute_world_key,
    find_cache_folder,
    open_model_store,
)
from advercity.pipeline.options import Progress, ProgressCallback, RunOptions, ignore_progress
from advercity.rendering.backend import (
    RENDER_PROFILES,
    Backend,
    Capabilities,
    RenderProfile,
    load_backend,
)
from advercity.roads.sumo_network import write_sumo_network
from advercity.scene.build import build_world
from advercity.scene.world_storage import load_world, save_world
from advercity.traffic.simulation import simulate_in_subprocess
from advercity.world import World


@dataclass(frozen=True)
class TrafficResult:
    """What a scenario needs before its first frame."""

    network_path: Path
    trace: Trace
    trace_sha256: str


def load_cached_trace(spec: Spec) -> Trace | None:
    """The trace of a spec if it is in the cache."""
    stored = _find_trace_file(spec)
    return Trace.load(stored) if stored.is_file() else None


def load_or_simulate_traffic(spec: Spec) -> TrafficResult:
    """Network and trace of a spec, from the cache or made now."""
    folder = find_cache_folder()
    network = build_cached(
        folder / "networks" / compute_road_key(spec) / "road.net.xml",
        lambda partial: _build_network_file(spec, partial),
    )
    stored = build_cached(
        _find_trace_file(spec),
        lambda partial: simulate_in_subprocess(spec, network).save(partial),
    )
    trace = Trace.load(stored)
    return TrafficResult(network, trace, trace.compute_sha256())


def _find_trace_file(spec: Spec) -> Path:
    return find_cache_folder() / "traces" / f"{compute_traffic_key(spec)}.npz"


def load_or_build_world(spec: Spec, network_path: Path) -> World:
    """The world of a spec, from the cache or made now."""
    stored = build_cached(
        find_cache_folder() / "worlds" / f"{compute_world_key(spec)}.npz",
        lambda partial: save_world(build_world(spec, network_path, open_model_store()), partial),
    )
    return load_world(stored, network_path)


def _build_network_file(spec: Spec, path: Path) -> None:
    write_sumo_network(spec.road, path.parent).replace(path)


@dataclass(frozen=True)
class PreparedScenario:
    """What frames are made with.

    Attributes:
        backend: That renders them.
        profile: How well.
        traffic: Where, and who is there.
        identity: What decides their bytes.
        frames: The frames that are asked for.
    """

    backend: Backend
    profile: RenderProfile
    traffic: TrafficResult
    identity: Identity
    frames: range

    @property
    def length(self) -> int:
        """Frames of the whole scenario."""
        return len(self.traffic.trace)


def prepare_scenario(
    spec: Spec, options: RunOptions, report: ProgressCallback = ignore_progress
) -> PreparedScenario:
    """Find the backend and simulate the traffic.

    Raises:
        InputError: No such backend, or no such frames.
        BackendError: It cannot do what the profile asks for.
        RunError: The traffic fails.
    """
    backend = load_backend(options.backend)
    profile = resolve_profile(options, backend.capabilities())
    report(Progress(spec.id, "traffic"))
    stage = load_or_simulate_traffic(spec)
    wanted = options.frames.to_range(len(stage.trace))
    if not wanted:
        raise InputError(
            f"--frames begins at {options.frames.first}, but {spec.id}"
            f" has frames 0 to {len(stage.trace) - 1}"
        )
    identity = compute_identity(spec, stage, backend, profile, format=options.format)
    return PreparedScenario(backend, profile, stage, identity, wanted)


def resolve_profile(options: RunOptions, capabilities: Capabilities) -> RenderProfile:
    """The profile asked for; `auto` is `full` where hardware traces rays, else `preview`."""
    name = options.profile
    if name == "auto":
        name = "full" if capabilities.ray_traced and capabilities.hardware else "preview"
    profile = RENDER_PROFILES[name]
    if profile.renderer == "ray_traced" and not capabilities.ray_traced:
        raise BackendError(
            f"profile '{name}' traces rays, which {capabilities.device} cannot;"
            " use --profile preview"
        )
    return profile.with_scale(options.scale)


def compute_identity(
    spec: Spec, stage: TrafficResult, backend: Backend, profile: RenderProfile, *, format: str
) -> Identity:
    """What decides the bytes of `spec` in a layout, with the pictures of a backend."""
    return Identity.for_spec(
        spec,
        trace_sha256=stage.trace_sha256,
        renderer=_describe_renderer(backend, profile),
        bodies=compute_model_digests(spec),
        format=format,
    )


def _describe_renderer(backend: Backend, profile: RenderProfile) -> RendererIdentity:
    """Whatever of backend, its sources, device and profile changes pictures."""
    return {
        "backend": backend.name,
        "backend_sha256": compute_source_digest(type(backend).__module__.partition(".")[0]),
        "device": backend.capabilities().device,
        "renderer": profile.renderer,
        "scale": profile.scale,
        "samples": profile.samples,
        "path_depth": profile.path_depth,
        "denoise": profile.denoise,
    }
