"""What a scenario needs before its first frame: road network and traffic, from the cache or new."""

from dataclasses import dataclass
from pathlib import Path

from advercity_dsl import Spec

from advercity.runner.cache import cache_folder, kept, road_key, shelf, traffic_key, world_key
from advercity.traffic.simulation import simulate
from advercity.traffic.trace import Trace
from advercity.world.build import build_world
from advercity.world.network import build_network
from advercity.world.scene import World
from advercity.world.storage import load_world, save_world


@dataclass(frozen=True)
class Stage:
    """What a scenario needs before its first frame."""

    network: Path
    trace: Trace
    trace_sha256: str


def kept_trace(spec: Spec) -> Trace | None:
    """The trace of a spec if it is in the cache."""
    stored = _trace_file(spec)
    return Trace.load(stored) if stored.is_file() else None


def set_stage(spec: Spec) -> Stage:
    """Network and trace of a spec, from the cache or made now."""
    folder = cache_folder()
    network = kept(
        folder / "networks" / road_key(spec) / "road.net.xml",
        lambda partial: _build_network(spec, partial),
    )
    stored = kept(
        _trace_file(spec),
        lambda partial: simulate(spec, network).save(partial),
    )
    trace = Trace.load(stored)
    return Stage(network, trace, trace.sha256())


def _trace_file(spec: Spec) -> Path:
    return cache_folder() / "traces" / f"{traffic_key(spec)}.npz"


def world_of(spec: Spec, network: Path) -> World:
    """The world of a spec, from the cache or made now."""
    stored = kept(
        cache_folder() / "worlds" / f"{world_key(spec)}.npz",
        lambda partial: save_world(build_world(spec, network, shelf()), partial),
    )
    return load_world(stored, network)


def _build_network(spec: Spec, path: Path) -> None:
    build_network(spec.road, path.parent).replace(path)
