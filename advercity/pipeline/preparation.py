"""Prepares a scenario for rendering: backend, profile, road network, traffic, world, identity.

Networks, traces, worlds and bodies come from the cache. The first call for a spec runs
`netconvert`, simulates the traffic in SUMO (seconds to minutes) and builds the meshes.
"""

import logging
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

from advercity_dsl import Spec

from advercity.assets.bodies import build_body
from advercity.assets.driver_side import seat_driver_on_right
from advercity.assets.model_store import open_model_store
from advercity.compiler.assembly import is_edited
from advercity.conflicts.outcome import evaluate_outcomes
from advercity.dataset.manifest import Identity, RendererIdentity
from advercity.digests import compute_json_digest, compute_source_digest
from advercity.documents import read_text
from advercity.errors import BackendError, InputError, RunError, StagingError
from advercity.frames import Trace
from advercity.pipeline.cache import (
    compute_body_key,
    compute_road_key,
    compute_traffic_key,
    compute_world_key,
)
from advercity.pipeline.cache_entries import load_entry, load_or_build_entry, read_checksum
from advercity.pipeline.progress import Progress, ProgressCallback, ignore_progress
from advercity.pipeline.spec_models import check_models, find_missing_models, replace_models
from advercity.pipeline.surface_maps import SurfaceMaps
from advercity.rendering.backend import (
    RENDER_PROFILES,
    Backend,
    Capabilities,
    RenderProfile,
    load_backend,
)
from advercity.roads.plan_frame import to_plan_frame
from advercity.roads.sumo_network import write_sumo_network
from advercity.run_options import DatasetOptions, RunOptions, format_frames
from advercity.scene.build import build_world
from advercity.scene.world_storage import load_body, load_world, save_body, save_world
from advercity.sensors.agent_poses import AgentPoses
from advercity.texture_packs import TEXTURE_PACKS
from advercity.traffic.simulation import write_simulated_trace
from advercity.world import World

_logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class TrafficResult:
    """The recorded traffic of a road, density and conflict, shared by its weathers.

    Attributes:
        network_path: SUMO network of the simulation.
        trace: Every actor and signal at every tick.
        trace_sha256: Checksum of the trace's content.
    """

    network_path: Path
    trace: Trace
    trace_sha256: str


def load_cached_trace(spec: Spec) -> Trace | None:
    """Load the trace of a spec if the cache has it."""
    return load_entry(_name_trace_entry(spec), Trace.load)


def load_or_simulate_traffic(spec: Spec) -> TrafficResult:
    """Load the traffic of a spec from the cache, or simulate it now.

    The cache also records a conflict that cannot be staged: the search takes long, and all weathers
    share the traffic.

    Raises:
        InputError: The road lacks a part named in the spec.
        StagingError: A conflict of the spec cannot be staged.
        RunError: The simulation fails, or the cache cannot be written.
    """
    refusal_entry = f"refusals/{compute_traffic_key(spec)}.txt"
    refusal = load_entry(refusal_entry, read_text)
    if refusal is not None:
        raise StagingError(f"{spec.id}: {refusal}")
    network = load_or_build_entry(
        f"networks/{compute_road_key(spec)}/road.net.xml",
        lambda partial: _build_network_file(spec, partial),
        lambda path: path,
    )
    try:
        trace = load_or_build_entry(
            _name_trace_entry(spec),
            lambda partial: write_simulated_trace(spec, network, partial),
            Trace.load,
        )
    except StagingError as error:
        reason = str(error).removeprefix(f"{spec.id}: ")
        load_or_build_entry(refusal_entry, lambda partial: _write_text(partial, reason), read_text)
        raise
    return TrafficResult(network, trace, trace.compute_sha256())


def _write_text(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")


def _name_trace_entry(spec: Spec) -> str:
    return f"traces/{compute_traffic_key(spec)}.npz"


def _build_network_file(spec: Spec, path: Path) -> None:
    write_sumo_network(to_plan_frame(spec.road), path.parent).replace(path)


def load_or_build_world(spec: Spec, network_path: Path) -> World:
    """Load the static scene and the bodies of a spec from the cache, or build them now.

    Each body has its own entry: bodies take longest to build, and roads share them.

    Raises:
        RunError: A model of the spec is not installed, or cannot be used.
    """
    store = open_model_store()
    world = load_or_build_entry(
        _name_world_entry(spec),
        lambda partial: save_world(build_world(spec, network_path), partial),
        lambda path: load_world(path, network_path),
    )
    bodies = {
        name: load_or_build_entry(
            _name_body_entry(spec, name),
            lambda partial, name=name: save_body(
                build_body(name, spec.blueprints[name], store), partial
            ),
            load_body,
        )
        for name in spec.blueprints
    }
    if spec.road.is_left_hand:
        bodies = {name: seat_driver_on_right(body) for name, body in bodies.items()}
    for blueprint in spec.blueprints.values():
        # A cached body lacks its model's images, and may be older than the model.
        store.prepare_model(blueprint)
    return replace(world, bodies=bodies, material_maps=_open_surface_maps(spec))


def _open_surface_maps(spec: Spec) -> SurfaceMaps:
    packs = [pack for name, pack in TEXTURE_PACKS.items() if name in spec.assets]
    return SurfaceMaps(packs, open_model_store().images)


def _name_world_entry(spec: Spec) -> str:
    return f"worlds/{compute_world_key(spec)}.npz"


def _name_body_entry(spec: Spec, name: str) -> str:
    return f"bodies/{compute_body_key(spec, name)}.npz"


@dataclass(frozen=True)
class PreparedScenario:
    """A scenario with everything needed to make its frames.

    Attributes:
        spec: The scenario.
        traffic: Its recorded traffic.
        backend: Renders the frames.
        profile: Renderer and image scale.
        frames: Requested frames.
        options: Options of the dataset's content.
        missing_models: Models and photographs of the spec with generated substitutes.
        edited: Whether the spec was edited after it was compiled.
        missed_conflicts: How staged conflicts differ from their declaration.
    """

    spec: Spec
    traffic: TrafficResult
    backend: Backend
    profile: RenderProfile
    frames: range
    options: DatasetOptions = field(default_factory=DatasetOptions)
    missing_models: tuple[str, ...] = ()
    edited: bool = False
    missed_conflicts: tuple[str, ...] = ()

    @property
    def frame_count(self) -> int:
        """Frames of the whole scenario."""
        return len(self.traffic.trace)

    @cached_property
    def poses(self) -> AgentPoses:
        """Poses of every agent and sensor in every frame."""
        return AgentPoses(self.spec, self.traffic.trace)

    @cached_property
    def identity(self) -> Identity:
        """Everything the bytes of the dataset depend on."""
        return Identity.for_spec(
            self.spec,
            trace_sha256=self.traffic.trace_sha256,
            world_sha256=self._world[1],
            renderer=_describe_renderer(self.backend, self.profile),
            options=self.options,
            missing_models=self.missing_models,
            edited=self.edited,
            missed_conflicts=self.missed_conflicts,
        )

    def load_world(self) -> World:
        """Load the world from the cache, or build it now; later calls return the same one."""
        return self._world[0]

    @cached_property
    def _world(self) -> tuple[World, str]:
        """The world, and a digest of the checksums of its cache entries and images."""
        spec = replace_models(self.spec, self.missing_models)
        world = load_or_build_world(spec, self.traffic.network_path)
        entries = [_name_world_entry(spec)]
        entries += [_name_body_entry(spec, name) for name in spec.blueprints]
        checksums: list[str | None] = [read_checksum(entry) for entry in entries]
        # A spec's checksums of models cover triangles only, not images.
        store = open_model_store()
        checksums += [store.compute_images_digest(one) for one in spec.blueprints.values()]
        checksums += _open_surface_maps(spec).list_checksums()
        return world, compute_json_digest(checksums)


def prepare_scenario(
    spec: Spec, options: RunOptions, report: ProgressCallback = ignore_progress
) -> PreparedScenario:
    """Load the backend, resolve the profile and load or simulate the traffic.

    Raises:
        InputError: The backend or the frames do not exist, or models are missing.
        BackendError: The backend cannot render the profile.
        RunError: The traffic simulation fails, or a staged conflict does not happen.
    """
    options = resolve_backend(options)
    backend = load_backend(options.backend)
    profile = resolve_profile(options, backend.capabilities())
    missing_models = find_missing_models(spec)
    if missing_models:
        check_models([spec], allow_missing=options.allow_missing_models)
    report(Progress(spec.id, "traffic"))
    traffic = load_or_simulate_traffic(spec)
    outcomes = evaluate_outcomes(spec, traffic.trace)
    missed = tuple(problem for outcome in outcomes for problem in outcome.problems)
    if missed and not options.allow_missed:
        raise RunError(
            f"{spec.id}: {'; '.join(missed)}; `advercity simulate` draws the traffic, and"
            " `allow_missed` makes the data all the same"
        )
    frame_count = len(traffic.trace)
    frames = options.select_frames(frame_count, spec.timing.tick_s)
    if not frames:
        raise InputError(
            f"`frames` {format_frames(options.frames)}: selects none of {spec.id}, which has frames"
            f" 0 to {frame_count - 1}"
        )
    return PreparedScenario(
        spec,
        traffic,
        backend,
        profile,
        frames,
        options,
        missing_models=missing_models,
        edited=is_edited(spec),
        missed_conflicts=missed,
    )


def resolve_profile(options: RunOptions, capabilities: Capabilities) -> RenderProfile:
    """Resolve the requested profile; `auto` is `full` if hardware traces rays, else `preview`.

    Raises:
        BackendError: The profile traces rays, but the device cannot.
    """
    name = options.profile
    if name == "auto":
        name = "full" if capabilities.ray_traced and capabilities.hardware else "preview"
    profile = RENDER_PROFILES[name]
    if profile.renderer == "ray_traced" and not capabilities.ray_traced:
        raise BackendError(
            f"profile '{name}' traces rays, which {capabilities.device} cannot;"
            " use `profile` preview"
        )
    return profile.with_scale(options.scale)


AUTOMATIC_BACKEND = "auto"
"""Selects the backend by profile and machine."""


def resolve_backend(options: RunOptions) -> RunOptions:
    """Replace the backend `auto`: Mitsuba for `full` where only it traces rays fast, else SAPIEN.

    Without a graphics card a traced image takes minutes with SAPIEN, and seconds with Mitsuba if
    it is installed and has a compiler. The choice is then logged.
    """
    if options.backend != AUTOMATIC_BACKEND:
        return options
    if options.profile != "full" or _traces_in_hardware("sapien"):
        return replace(options, backend="sapien")
    try:
        load_backend("mitsuba").capabilities()
    except (BackendError, InputError) as error:
        _logger.warning(
            "backend sapien: no device here traces rays in hardware, so an image takes minutes;"
            " with backend mitsuba it would take seconds (%s)",
            error,
        )
        return replace(options, backend="sapien")
    _logger.warning("backend mitsuba: no device here traces rays in hardware")
    return replace(options, backend="mitsuba")


def _traces_in_hardware(name: str) -> bool:
    try:
        found = load_backend(name).capabilities()
    except (BackendError, InputError):
        return False
    return found.ray_traced and found.hardware


def _describe_renderer(backend: Backend, profile: RenderProfile) -> RendererIdentity:
    """Collect the facts of backend, sources, device and profile with effect on images."""
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
