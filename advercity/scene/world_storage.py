"""Saves worlds and bodies to `.npz` files and loads them: arrays end to end, the rest as JSON.

The format is private to the cache, whose keys hold a digest of the code; it may change freely.
"""

import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from advercity.array_files import load_arrays
from advercity.documents import parse_json
from advercity.errors import RunError
from advercity.geometry.mesh import Mesh, MeshLayer, Wheel
from advercity.roads.lane_segments import LaneSegment
from advercity.semantics import Semantic
from advercity.world import Body, Gait, SignalLamp, StreetLamp, World

T = TypeVar("T")
_Rows = Sequence[NDArray[Any] | None]

MAX_WORLD_BYTES = 4 * 10**9
WORLD_DECIMALS = 9
"""Decimals of coordinates in m and of normals: all processors store the same bytes."""
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
    """Write a world to `path`, which ends in `.npz`, without its network and its bodies."""
    record = {
        "id": world.id,
        "is_left_hand": world.is_left_hand,
        "meshes": [_encode_mesh(mesh) for mesh in world.static],
        "lanes": [(lane.id, lane.kind, lane.in_junction) for lane in world.lanes],
        "street_lamps": [(lamp.position, lamp.flux_lm) for lamp in world.street_lamps],
        "signal_lamps": [
            (lamp.id, lamp.position, lamp.facing, lamp.governs) for lamp in world.signal_lamps
        ],
    }
    borders = [border for lane in world.lanes for border in (lane.left, lane.right)]
    _save(path, record, {**_list_mesh_arrays(world.static), "lane_borders": borders})


def load_world(path: Path, network: Path) -> World:
    """Load a world written by `save_world`; its SUMO network is at `network`.

    Raises:
        RunError: The file is something else.
    """
    return _load(path, lambda record, arrays: _decode_world(record, arrays, network), "a world")


def save_body(body: Body, path: Path) -> None:
    """Write the body of a blueprint to `path`, which ends in `.npz`."""
    bodies = list(_iterate_bodies(body))
    meshes = [part for one in bodies for part in one.parts]
    record = {
        "meshes": [_encode_mesh(mesh) for mesh in meshes],
        "bodies": [_encode_body(one) for one in bodies],
    }
    transforms = [None if one.gait is None else one.gait.bone_transforms for one in bodies]
    _save(path, record, {**_list_mesh_arrays(meshes), "bone_transforms": transforms})


def load_body(path: Path) -> Body:
    """Load a body written by `save_body`.

    Raises:
        RunError: The file is something else.
    """
    return _load(path, _decode_body, "a body")


def _save(path: Path, record: dict[str, Any], arrays: Mapping[str, _Rows]) -> None:
    shapes = {
        name: [None if array is None else array.shape for array in rows]
        for name, rows in arrays.items()
    }
    text = json.dumps({**record, "shapes": shapes})
    content: dict[str, Any] = {
        "record": np.frombuffer(text.encode(), dtype=np.uint8),
        **{name: _concatenate(rows, _DTYPES[name]) for name, rows in arrays.items()},
    }
    np.savez(path, **content)


def _load(path: Path, decode: Callable[[Any, Mapping[str, Iterator[Any]]], T], what: str) -> T:
    stored = load_arrays(path, max_bytes=MAX_WORLD_BYTES)
    try:
        record = parse_json(stored["record"].tobytes(), path)
        arrays = {
            name: _split(stored[name].astype(_DTYPES[name], casting="no"), rows)
            for name, rows in record["shapes"].items()
        }
        return decode(record, arrays)
    except Exception as error:  # an edited file may have any kind of damage
        raise RunError(f"{path}: not {what}: {error or type(error).__name__}") from error


def _decode_world(record: Any, arrays: Mapping[str, Iterator[Any]], network: Path) -> World:
    borders = arrays["lane_borders"]
    return World(
        id=record["id"],
        static=tuple(_decode_meshes(record["meshes"], arrays)),
        bodies={},
        lanes=tuple(
            LaneSegment(name, kind, next(borders), next(borders), in_junction)
            for name, kind, in_junction in record["lanes"]
        ),
        network=network,
        is_left_hand=record["is_left_hand"],
        street_lamps=tuple(StreetLamp(tuple(at), flux) for at, flux in record["street_lamps"]),
        signal_lamps=tuple(
            SignalLamp(name, tuple(at), tuple(facing), governs)
            for name, at, facing, governs in record["signal_lamps"]
        ),
    )


def _list_mesh_arrays(meshes: Sequence[Mesh]) -> dict[str, _Rows]:
    return {name: [getattr(mesh, name) for mesh in meshes] for name in _MESH_ARRAYS}


def _concatenate(arrays: Iterable[NDArray[Any] | None], dtype: type[np.generic]) -> NDArray[Any]:
    # The empty array gives worlds without any such array its element type.
    flat = (array.ravel() for array in arrays if array is not None)
    joined = np.concatenate([np.empty(0, dtype), *flat])
    if not np.issubdtype(dtype, np.floating):
        return joined
    # Processors differ in the last bit of sines, and in their zeros; -0.0 becomes 0.0.
    return (np.round(joined.astype(np.float64), WORLD_DECIMALS) + 0.0).astype(dtype)


def _split(flat: NDArray[Any], shapes: Sequence[Sequence[int] | None]) -> Iterator[Any]:
    """Split the output of `_concatenate`; None where there was no array."""
    start = 0
    for shape in shapes:
        end = start + (0 if shape is None else math.prod(shape))
        yield None if shape is None else flat[start:end].reshape(shape)
        start = end


def _iterate_bodies(first: Body) -> Iterator[Body]:
    """Iterate over the bodies of a blueprint; one with an umbrella is after its own."""
    for body in (first, *first.others):
        yield body
        if body.with_umbrella is not None:
            yield body.with_umbrella


def _encode_body(body: Body) -> tuple[Any, ...]:
    gait = body.gait
    cycle = None if gait is None else (gait.cycle_length_m, gait.returns_to_rest)
    return body.size, len(body.parts), cycle, body.with_umbrella is not None


def _decode_body(record: Any, arrays: Mapping[str, Iterator[Any]]) -> Body:
    meshes = _decode_meshes(record["meshes"], arrays)
    first, *others = _decode_bodies(iter(record["bodies"]), meshes, arrays["bone_transforms"])
    return replace(first, others=tuple(others))


def _decode_bodies(
    rows: Iterator[Any], meshes: Iterator[Mesh], bone_transforms: Iterator[Any]
) -> Iterator[Body]:
    for size, part_count, cycle, has_umbrella in rows:
        parts = tuple(next(meshes) for _ in range(part_count))
        transforms = next(bone_transforms)
        gait = None if cycle is None else Gait(cycle[0], transforms, cycle[1])
        umbrella = next(_decode_bodies(rows, meshes, bone_transforms)) if has_umbrella else None
        yield Body(parts, tuple(size), gait, umbrella)


def _encode_mesh(mesh: Mesh) -> tuple[Any, ...]:
    wheel = None if mesh.wheel is None else (mesh.wheel.hub, mesh.wheel.is_steered)
    kind = mesh.name, mesh.material, int(mesh.semantic)
    return *kind, wheel, int(mesh.layer), mesh.maps, mesh.writing


def _decode_meshes(rows: list[Any], arrays: Mapping[str, Iterator[Any]]) -> Iterator[Mesh]:
    for name, material, semantic, wheel, layer, maps, writing in rows:
        mesh = Mesh(
            name=name,
            material=material,
            semantic=Semantic(semantic),
            wheel=Wheel(tuple(wheel[0]), wheel[1]) if wheel else None,
            layer=MeshLayer(layer),
            maps=maps,
            writing=tuple((first, last) for first, last in writing),
            **{key: next(arrays[key]) for key in _MESH_ARRAYS},
        )
        _check_arrays(mesh)
        yield mesh


def _check_arrays(mesh: Mesh) -> None:
    """Raise ValueError for mismatched arrays; renderers would read beyond their ends."""
    count = len(mesh.vertices)
    shapes = [(mesh.vertices, (count, 3)), (mesh.normals, (count, 3)), (mesh.uv, (count, 2))]
    fits = all(array is None or array.shape == shape for array, shape in shapes)
    fits &= mesh.weights is None or (mesh.weights.ndim == 2 and len(mesh.weights) == count)
    fits &= mesh.triangles.ndim == 2 and mesh.triangles.shape[1] == 3
    fits &= mesh.triangles.min(initial=0) >= 0 and mesh.triangles.max(initial=-1) < count
    if not fits:
        raise ValueError(f"arrays of mesh {mesh.name!r:.60} do not fit")
