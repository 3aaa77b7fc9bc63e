"""Saves worlds to files and loads them: arrays end to end in one `.npz`, the rest as JSON in it.

The format is private to the cache, whose keys hold a digest of the code; it may change freely.
"""

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from advercity.array_files import load_arrays
from advercity.documents import parse_json
from advercity.errors import RunError
from advercity.geometry.mesh import Mesh, MeshLayer, Wheel
from advercity.roads.lane_segments import LaneSegment
from advercity.semantics import Semantic
from advercity.world import Body, Gait, SignalLamp, StreetLamp, World

MAX_WORLD_BYTES = 4 * 10**9
WORLD_DECIMALS = 9
"""Decimals of coordinates in m and of normals, so that all processors store the same bytes."""
_MESH_ARRAYS = ("vertices", "triangles", "normals", "weights", "uv")
_DTYPES: dict[str, type[np.generic]] = {
    "vertices": np.float32,
    "triangles": np.int32,
    "normals": np.float32,
    "weights": np.float32,
    "uv": np.float32,
    "bone_transforms": np.float32,
    "lane_borders": np.float64,
}


def save_world(world: World, path: Path) -> None:
    """Write a world to `path`, which ends in `.npz`; its network is not included."""
    bodies = list(_iterate_bodies(world.bodies))
    meshes = [*world.static, *(part for _, body in bodies for part in body.parts)]
    gaits = [body.gait for _, body in bodies]
    arrays: dict[str, list[NDArray[Any] | None]] = {
        **{name: [getattr(mesh, name) for mesh in meshes] for name in _MESH_ARRAYS},
        "bone_transforms": [None if gait is None else gait.bone_transforms for gait in gaits],
        "lane_borders": [border for lane in world.lanes for border in (lane.left, lane.right)],
    }
    record = {
        "id": world.id,
        "static": len(world.static),
        "meshes": [_encode_mesh(mesh) for mesh in meshes],
        "bodies": [(*key, body.size, len(body.parts), _encode_gait(body)) for key, body in bodies],
        "lanes": [(lane.id, lane.kind, lane.in_junction) for lane in world.lanes],
        "street_lamps": [(lamp.position, lamp.flux_lm) for lamp in world.street_lamps],
        "signal_lamps": [(lamp.id, lamp.position, lamp.facing) for lamp in world.signal_lamps],
        "shapes": {
            name: [None if array is None else array.shape for array in rows]
            for name, rows in arrays.items()
        },
    }
    content: dict[str, Any] = {
        "record": np.frombuffer(json.dumps(record).encode(), dtype=np.uint8),
        **{name: _concatenate(rows, _DTYPES[name]) for name, rows in arrays.items()},
    }
    np.savez(path, **content)


def load_world(path: Path, network: Path) -> World:
    """Load a world that `save_world` has written; its SUMO network is at `network`.

    Raises:
        RunError: The file is something else.
    """
    stored = load_arrays(path, max_bytes=MAX_WORLD_BYTES)
    try:
        return _decode_world(stored, network, path)
    except Exception as error:  # whatever an edited file may lack or have too much
        raise RunError(f"{path}: not a world: {error or type(error).__name__}") from error


def _decode_world(stored: Mapping[str, NDArray[Any]], network: Path, path: Path) -> World:
    record = parse_json(stored["record"].tobytes(), path)
    arrays = {name: _split(stored[name], record["shapes"][name]) for name in _DTYPES}
    meshes = _decode_meshes(record["meshes"], arrays)
    borders = arrays["lane_borders"]
    return World(
        id=record["id"],
        static=tuple(next(meshes) for _ in range(record["static"])),
        bodies=_decode_bodies(record["bodies"], meshes, arrays["bone_transforms"]),
        lanes=tuple(
            LaneSegment(name, kind, next(borders), next(borders), in_junction)
            for name, kind, in_junction in record["lanes"]
        ),
        network=network,
        street_lamps=tuple(StreetLamp(tuple(at), flux) for at, flux in record["street_lamps"]),
        signal_lamps=tuple(
            SignalLamp(name, tuple(at), tuple(facing))
            for name, at, facing in record["signal_lamps"]
        ),
    )


def _concatenate(arrays: Iterable[NDArray[Any] | None], dtype: type[np.generic]) -> NDArray[Any]:
    # The empty array gives worlds without any such array its element type.
    flat = (array.ravel() for array in arrays if array is not None)
    joined = np.concatenate([np.empty(0, dtype), *flat])
    if not np.issubdtype(dtype, np.floating):
        return joined
    # Processors differ in the last bit of sines, and in what they take for zero; -0.0 becomes 0.0.
    return (np.round(joined.astype(np.float64), WORLD_DECIMALS) + 0.0).astype(dtype)


def _split(flat: NDArray[Any], shapes: Sequence[Sequence[int] | None]) -> Iterator[Any]:
    """Split what `_concatenate` has joined; None where there was no array."""
    start = 0
    for shape in shapes:
        end = start + (0 if shape is None else math.prod(shape))
        yield None if shape is None else flat[start:end].reshape(shape)
        start = end


def _iterate_bodies(bodies: Mapping[str, Body]) -> Iterator[tuple[tuple[str, bool], Body]]:
    """Iterate over bodies by blueprint and umbrella; one with an umbrella is before its own.

    The others of a blueprint follow its first body.
    """
    for name, first in bodies.items():
        for body in (first, *first.others):
            if body.with_umbrella is not None:
                yield (name, True), body.with_umbrella
            yield (name, False), body


def _encode_gait(body: Body) -> tuple[float, bool] | None:
    return None if body.gait is None else (body.gait.cycle_length_m, body.gait.returns_to_rest)


def _decode_bodies(
    rows: list[Any], meshes: Iterator[Mesh], bone_transforms: Iterator[Any]
) -> dict[str, Body]:
    bodies: dict[str, list[Body]] = {}
    with_umbrella: Body | None = None
    for name, has_umbrella, size, part_count, gait in rows:
        parts = tuple(next(meshes) for _ in range(part_count))
        transforms = next(bone_transforms)
        body = Body(
            parts,
            tuple(size),
            None if gait is None else Gait(gait[0], transforms, gait[1]),
            None if has_umbrella else with_umbrella,
        )
        with_umbrella = body if has_umbrella else None
        if not has_umbrella:
            bodies.setdefault(name, []).append(body)
    return {name: replace(first, others=tuple(rest)) for name, (first, *rest) in bodies.items()}


def _encode_mesh(mesh: Mesh) -> tuple[Any, ...]:
    wheel = None if mesh.wheel is None else (mesh.wheel.hub, mesh.wheel.is_steered)
    return mesh.name, mesh.material, int(mesh.semantic), wheel, int(mesh.layer), mesh.maps


def _decode_meshes(rows: list[Any], arrays: Mapping[str, Iterator[Any]]) -> Iterator[Mesh]:
    for name, material, semantic, wheel, layer, maps in rows:
        yield Mesh(
            name=name,
            material=material,
            semantic=Semantic(semantic),
            wheel=Wheel(tuple(wheel[0]), wheel[1]) if wheel else None,
            layer=MeshLayer(layer),
            maps=maps,
            **{key: next(arrays[key]) for key in _MESH_ARRAYS},
        )
