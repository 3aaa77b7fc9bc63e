"""Worlds in files: all their arrays end to end in one `.npz`, and what they are as JSON in it."""

import json
from collections.abc import Iterable, Iterator, Sequence
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from advercity.semantics import Semantic
from advercity.world.scene import Body, Lane, Mesh, SignalLamp, StreetLamp, World


def save_world(world: World, path: Path) -> None:
    """Write a world to `path`, which ends in `.npz`; its network stays where it is."""
    parts = [*world.static, *(part for body in world.bodies.values() for part in body.parts)]
    lanes = world.lanes
    what = {
        "id": world.id,
        "static": len(world.static),
        "meshes": [_described(mesh) for mesh in parts],
        "bodies": [(name, body.size, len(body.parts)) for name, body in world.bodies.items()],
        "lanes": [(lane.id, lane.kind, len(lane.left), lane.in_junction) for lane in lanes],
        "street_lamps": [(lamp.position, lamp.flux_lm) for lamp in world.street_lamps],
        "signal_lamps": [(lamp.id, lamp.position, lamp.facing) for lamp in world.signal_lamps],
    }
    np.savez(
        path,
        what=np.frombuffer(json.dumps(what).encode(), dtype=np.uint8),
        vertices=_joined((mesh.vertices for mesh in parts), np.float32),
        triangles=_joined((mesh.triangles for mesh in parts), np.int32),
        normals=_joined((m.normals for m in parts if m.normals is not None), np.float32),
        lanes=_joined((side for lane in lanes for side in (lane.left, lane.right)), np.float64),
    )


def load_world(path: Path, network: Path) -> World:
    """The world that `save_world` has written, whose SUMO network is at `network`."""
    with np.load(path, allow_pickle=False) as stored:
        what = json.loads(stored["what"].tobytes())
        parts = list(_meshes(what["meshes"], *(stored[key] for key in _ARRAYS)))
        lanes = tuple(_lanes(what["lanes"], stored["lanes"]))
    names, sizes, counts = zip(*what["bodies"], strict=True) if what["bodies"] else ((), (), ())
    bodies = _sliced(parts[what["static"] :], counts)
    return World(
        id=what["id"],
        static=tuple(parts[: what["static"]]),
        bodies={
            name: Body(tuple(own), tuple(size))
            for name, size, own in zip(names, sizes, bodies, strict=True)
        },
        lanes=lanes,
        network=network,
        street_lamps=tuple(StreetLamp(tuple(at), flux) for at, flux in what["street_lamps"]),
        signal_lamps=tuple(
            SignalLamp(name, tuple(at), tuple(facing)) for name, at, facing in what["signal_lamps"]
        ),
    )


_ARRAYS = ("vertices", "triangles", "normals")


def _described(mesh: Mesh) -> tuple[str, str, int, int, int, bool]:
    return (
        mesh.name,
        mesh.material,
        int(mesh.semantic),
        len(mesh.vertices),
        len(mesh.triangles),
        mesh.normals is not None,
    )


def _joined(arrays: Iterable[NDArray[Any]], dtype: type[np.generic]) -> NDArray[Any]:
    return np.concatenate([np.empty((0, 3), dtype=dtype), *arrays])


def _sliced(rows: Any, counts: Sequence[int]) -> list[Any]:
    """Consecutive pieces of a sequence or an array, as long as `counts`."""
    return [rows[start:end] for start, end in pairwise(accumulate(counts, initial=0))]


def _meshes(
    described: list[Any],
    vertices: NDArray[np.float32],
    triangles: NDArray[np.int32],
    normals: NDArray[np.float32],
) -> Iterator[Mesh]:
    smooth = [row[3] if row[5] else 0 for row in described]
    for row, own_vertices, own_triangles, own_normals in zip(
        described,
        _sliced(vertices, [row[3] for row in described]),
        _sliced(triangles, [row[4] for row in described]),
        _sliced(normals, smooth),
        strict=True,
    ):
        name, material, semantic, _, _, is_smooth = row
        yield Mesh(
            name=name,
            vertices=own_vertices,
            triangles=own_triangles,
            material=material,
            semantic=Semantic(semantic),
            normals=own_normals if is_smooth else None,
        )


def _lanes(described: list[Any], borders: NDArray[np.float64]) -> Iterator[Lane]:
    sides = _sliced(borders, [count for _, _, count, _ in described for _ in range(2)])
    for (name, kind, _, in_junction), left, right in zip(
        described, sides[::2], sides[1::2], strict=True
    ):
        yield Lane(name, kind, left, right, in_junction)
