"""One scenario from spec to dataset: traffic once, then every frame on its own."""

import hashlib
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from advercity_dsl import Spec

from advercity.dataset.manifest import Identity
from advercity.dataset.writer import DatasetWriter
from advercity.errors import BackendError, InputError
from advercity.rendering.backend import PROFILES, Backend, Capabilities, Profile
from advercity.rendering.casting import Caster
from advercity.rendering.registry import load_backend
from advercity.runner.cache import cache_folder, kept, road_key, traffic_key
from advercity.runner.options import Options
from advercity.runner.sensing import Senses
from advercity.traffic.simulation import simulate
from advercity.traffic.trace import Trace
from advercity.weather.derivation import atmosphere_of
from advercity.world.build import build_world
from advercity.world.network import build_network

Report = Callable[[str, str, int, int], None]
"""Called with scenario, stage, frames done and frames in all."""


@dataclass(frozen=True)
class Stage:
    """What a scenario needs before its first frame."""

    network: Path
    trace: Trace
    trace_sha256: str


def set_stage(spec: Spec) -> Stage:
    """Network and trace of a spec, from the cache or made now."""
    folder = cache_folder()
    network = kept(
        folder / "networks" / road_key(spec) / "road.net.xml",
        lambda partial: _build_network(spec, partial),
    )
    stored = kept(
        folder / "traces" / f"{traffic_key(spec)}.npz",
        lambda partial: simulate(spec, network).save(partial),
    )
    digest = hashlib.sha256(stored.read_bytes()).hexdigest()
    return Stage(network, Trace.load(stored), digest)


def _build_network(spec: Spec, path: Path) -> None:
    build_network(spec.road, path.parent).replace(path)


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
    return profile if options.scale is None else profile.scaled(options.scale)


def run_scenario(spec: Spec, options: Options, report: Report) -> Path:
    """Make the frames of a scenario that are not there yet; the scenario's folder.

    Raises:
        InputError: No such backend, or no such frames.
        RunError: Something failed; what is finished stays, and the same call goes on from there.
    """
    backend = load_backend(options.backend)
    capabilities = backend.capabilities()
    profile = choose_profile(options, capabilities)
    report(spec.id, "traffic", 0, 0)
    stage = set_stage(spec)
    wanted = options.frames.of(len(stage.trace))
    if not wanted:
        raise InputError(
            f"--frames begins at {options.frames.first}, but {spec.id}"
            f" has frames 0 to {len(stage.trace) - 1}"
        )
    identity = Identity.of(
        spec,
        trace_sha256=stage.trace_sha256,
        renderer=_renderer_identity(backend, capabilities, profile),
    )
    with DatasetWriter(
        options.output, spec, identity, length=len(stage.trace), fresh=options.fresh
    ) as writer:
        missing = [index for index in wanted if index not in writer.done]
        report(spec.id, "world", len(wanted) - len(missing), len(wanted))
        if missing:
            with _senses(spec, stage, backend, profile) as senses:
                for done, index in enumerate(missing, start=len(wanted) - len(missing)):
                    report(spec.id, "frames", done, len(wanted))
                    writer.write(index, senses.read(index))
        writer.finish()
    report(spec.id, "done", len(wanted), len(wanted))
    return options.output / spec.id


@contextmanager
def _senses(
    spec: Spec, stage: Stage, backend: Backend, profile: Profile
) -> Generator[Senses, None, None]:
    world = build_world(spec, stage.network)
    atmosphere = atmosphere_of(spec.weather, spec.road.land_use)
    with backend.open(world, atmosphere, profile) as renderer:
        yield Senses(spec, stage.trace, atmosphere, profile, renderer, Caster(world))


def _renderer_identity(
    backend: Backend, capabilities: Capabilities, profile: Profile
) -> dict[str, str | int | float | bool]:
    return {
        "backend": backend.name,
        "device": capabilities.device,
        "renderer": profile.renderer,
        "scale": profile.scale,
        "samples": profile.samples,
        "path_depth": profile.path_depth,
        "denoise": profile.denoise,
    }
