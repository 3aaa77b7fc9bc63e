"""Worlds in files: all their arrays end to end in one `.npz`, and what they are as JSON in it."""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from advercity.geometry.mesh import Mesh, Wheel
from advercity.roads.lane_segments import LaneSegment
from advercity.semantics import Semantic
from advercity.world import Body, Gait, SignalLamp, StreetLamp, World


def save_world(world: World, path: Path) -> None:
    """Write a world to `path`, which ends in `.npz`; its network stays where it is."""
    bodies = list(_iterate_bodies(world.bodies))
    parts = [*world.static, *(part for _, body in bodies for part in body.parts)]
    lanes = world.lanes
    what = {
        "id": world.id,
        "static": len(world.static),
        "meshes": [_encode_mesh(mesh) for mesh in parts],
        "bodies": [(*key, body.size, len(body.parts), _encode_gait(body)) for key, body in bodies],
        "lanes": [(lane.id, lane.kind, len(lane.left), lane.in_junction) for lane in lanes],
        "street_lamps": [(lamp.position, lamp.flux_lm) for lamp in world.street_lamps],
        "signal_lamps": [(lamp.id, lamp.position, lamp.facing) for lamp in world.signal_lamps],
    }
    np.savez(
        path,
        what=np.frombuffer(json.dumps(what).encode(), dtype=np.uint8),
        vertices=_concatenate_rows((mesh.vertices for mesh in parts), np.float32),
        triangles=_concatenate_rows((mesh.triangles for mesh in parts), np.int32),
        normals=_concatenate_rows((m.normals for m in parts if m.normals is not None), np.float32),
        weights=_concatenate_flat(mesh.weights for mesh in parts if mesh.weights is not None),
        moves=_concatenate_flat(
            (body.gait.bone_transforms for _, body in bodies if body.gait is not None)
        ),
        lanes=_concatenate_rows(
            (side for lane in lanes for side in (lane.left, lane.right)), np.float64
        ),
    )


def load_world(path: Path, network: Path) -> World:
    """The world that `save_world` has written, whose SUMO network is at `network`."""
    with np.load(path, allow_pickle=False) as stored:
        what = json.loads(stored["what"].tobytes())
        parts = list(_decode_meshes(what["meshes"], *(stored[key] for key in _MESH_ARRAYS)))
        lanes = tuple(_decode_lanes(what["lanes"], stored["lanes"]))
        bodies = _decode_bodies(what["bodies"], parts[what["static"] :], stored["moves"])
    return World(
        id=what["id"],
        static=tuple(parts[: what["static"]]),
        bodies=bodies,
        lanes=lanes,
        network=network,
        street_lamps=tuple(StreetLamp(tuple(at), flux) for at, flux in what["street_lamps"]),
        signal_lamps=tuple(
            SignalLamp(name, tuple(at), tuple(facing)) for name, at, facing in what["signal_lamps"]
        ),
    )


_MESH_ARRAYS = ("vertices", "triangles", "normals", "weights")
_BodyKey = tuple[str, bool]
"""Of a body: its blueprint, and whether it is the one under an umbrella."""


def _iterate_bodies(bodies: Mapping[str, Body]) -> Iterator[tuple[_BodyKey, Body]]:
    for name, body in bodies.items():
        if body.with_umbrella is not None:
            yield (name, True), body.with_umbrella
        yield (name, False), body


def _encode_gait(body: Body) -> tuple[float, int, int, bool] | None:
    gait = body.gait
    return (
        None
        if gait is None
        else (gait.cycle_length_m, *gait.bone_transforms.shape[:2], gait.returns_to_rest)
    )


def _decode_bodies(
    described: list[Any], parts: Sequence[Mesh], moves: NDArray[np.float32]
) -> dict[str, Body]:
    """Bodies by blueprint; one under an umbrella stands before the one that it belongs to."""
    own = _split_by_counts(parts, [row[3] for row in described])
    counts = [12 * row[4][1] * row[4][2] if row[4] else 0 for row in described]
    bodies: dict[str, Body] = {}
    sheltered: Body | None = None
    for row, meshes, numbers in zip(described, own, _split_by_counts(moves, counts), strict=True):
        name, is_sheltered, size, _, walks = row
        gait = Gait(walks[0], numbers.reshape(*walks[1:3], 3, 4), walks[3]) if walks else None
        body = Body(tuple(meshes), tuple(size), gait, None if is_sheltered else sheltered)
        sheltered = body if is_sheltered else None
        if not is_sheltered:
            bodies[name] = body
    return bodies


def _encode_mesh(mesh: Mesh) -> tuple[Any, ...]:
    return (
        mesh.name,
        mesh.material,
        int(mesh.semantic),
        len(mesh.vertices),
        len(mesh.triangles),
        mesh.normals is not None,
        0 if mesh.weights is None else mesh.weights.shape[1],
        None if mesh.wheel is None else (mesh.wheel.hub, mesh.wheel.is_steered),
    )


def _concatenate_rows(arrays: Iterable[NDArray[Any]], dtype: type[np.generic]) -> NDArray[Any]:
    return np.concatenate([np.empty((0, 3), dtype=dtype), *arrays])


def _concatenate_flat(arrays: Iterable[NDArray[np.float32]]) -> NDArray[np.float32]:
    return np.concatenate([np.empty(0, np.float32), *(array.ravel() for array in arrays)])


def _split_by_counts(rows: Any, counts: Sequence[int]) -> list[Any]:
    """Consecutive pieces of a sequence or an array, as long as `counts`."""
    return [rows[start:end] for start, end in pairwise(accumulate(counts, initial=0))]


def _decode_meshes(
    described: list[Any],
    vertices: NDArray[np.float32],
    triangles: NDArray[np.int32],
    normals: NDArray[np.float32],
    weights: NDArray[np.float32],
) -> Iterator[Mesh]:
    smooth = [row[3] if row[5] else 0 for row in described]
    for row, own_vertices, own_triangles, own_normals, own_weights in zip(
        described,
        _split_by_counts(vertices, [row[3] for row in described]),
        _split_by_counts(triangles, [row[4] for row in described]),
        _split_by_counts(normals, smooth),
        _split_by_counts(weights, [row[3] * row[6] for row in described]),
        strict=True,
    ):
        name, material, semantic, count, _, is_smooth, bones, wheel = row
        yield Mesh(
            name=name,
            vertices=own_vertices,
            triangles=own_triangles,
            material=material,
            semantic=Semantic(semantic),
            normals=own_normals if is_smooth else None,
            weights=own_weights.reshape(count, bones) if bones else None,
            wheel=Wheel(tuple(wheel[0]), wheel[1]) if wheel else None,
        )


def _decode_lanes(described: list[Any], borders: NDArray[np.float64]) -> Iterator[LaneSegment]:
    sides = _split_by_counts(borders, [count for _, _, count, _ in described for _ in range(2)])
    for (name, kind, _, in_junction), left, right in zip(
        described, sides[::2], sides[1::2], strict=True
    ):
        yield LaneSegment(name, kind, left, right, in_junction)
