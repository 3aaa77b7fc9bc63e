"""Embree: solids that are built once, a scene of where they stand or go, and rays cast at it.

embreex brings Embree along, but its own wrapper has neither instances nor packets of rays. Both are
a call away in Embree's C interface, used here as the manual of version 4 describes it. Sixteen rays
that go much the same way are cast together two to three times as fast as one by one.

Embree works in float32: hits are good to a tenth of a millimetre within a kilometre of the
origin.
"""

import ctypes
import weakref
from collections.abc import Collection, Sequence
from ctypes import c_char_p, c_size_t, c_uint, c_void_p
from dataclasses import dataclass
from functools import cache
from typing import Any

import embreex.rtcore_scene as embreex_scene
import numpy as np
from numpy.typing import NDArray

from advercity import poses
from advercity.errors import RunError
from advercity.poses import Matrix
from advercity.world.scene import Mesh

Floats = NDArray[np.floating[Any]]
Rows = NDArray[np.intp]

_TRIANGLES, _INSTANCE = 0, 121
_INDEX, _VERTEX = 0, 1
_UINT3, _FLOAT3, _FLOAT3X4_ROW_MAJOR = 0x5003, 0x9003, 0x9134
_ROBUST, _COHERENT = 1 << 2, 1 << 16
_EVERY_FEATURE = 0xFFFFFFFF

_LANES, _FIELDS = 16, 21
"""Of RTCRayHit16: rays, and numbers of 4 bytes that each has."""
_ORIGIN, _DIRECTION, _HIT = slice(0, 3), slice(4, 7), slice(17, 20)
_TIME, _FAR, _MASK, _TRIANGLE, _SOLID = 7, 8, 9, 17, 19
_ALIGNED = 64
_NOW = 1.0
_PACKETS = 512
"""Packets that are filled, cast and read at a time: as many as a core's cache holds."""


@dataclass(frozen=True, eq=False)
class Met:
    """What each of n rays met first.

    Attributes:
        solid: (n,) int32 row in the scene; -1 for nothing.
        triangle: (n,) int32 of that solid; -1 for nothing.
        range_m: (n,) float32; where rays end for nothing.
    """

    solid: NDArray[np.int32]
    triangle: NDArray[np.int32]
    range_m: Floats


class Solid:
    """The triangles of some meshes, one after the other, in a frame of their own."""

    def __init__(self, meshes: Sequence[Mesh]) -> None:
        starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
        moved = [mesh.triangles + start for mesh, start in zip(meshes, starts, strict=False)]
        embree, geometry = _embree(), _new_geometry(_TRIANGLES)
        vertices = [np.zeros((0, 3)), *(mesh.vertices for mesh in meshes)]
        _copy(geometry, _VERTEX, _FLOAT3, np.concatenate(vertices).astype(np.float32))
        triangles = [np.zeros((0, 3)), *moved]
        _copy(geometry, _INDEX, _UINT3, np.concatenate(triangles).astype(np.uint32))
        self.scene = _new_scene(self)
        _attach(self.scene, geometry)
        embree.rtcCommitScene(self.scene)
        _check()


class Scene:
    """Solids where they stand, or where they go while rays are cast.

    Args:
        solids: k solids.
        now: (k, 4, 4) `world_from_solid`.
        before: (k, 4, 4) where they come from: places go straight, turns go evenly. None if they
            stand still.
    """

    def __init__(self, solids: Sequence[Solid], now: Matrix, before: Matrix | None = None) -> None:
        self._scene = _new_scene(self)
        self._hidden: frozenset[int] = frozenset()
        self._packets = _Packets()
        for row, solid in enumerate(solids):
            geometry = _new_geometry(_INSTANCE)
            _embree().rtcSetGeometryInstancedScene(geometry, solid.scene)
            if before is None:
                _place(geometry, now[row])
            else:
                _move(geometry, before[row], now[row])
            _attach(self._scene, geometry)
        _embree().rtcCommitScene(self._scene)
        _check()

    def hide(self, rows: Collection[int]) -> None:
        """Let rays pass through those solids, and through no others."""
        hidden = frozenset(rows)
        if hidden == self._hidden:
            return
        embree = _embree()
        for row in hidden - self._hidden:
            embree.rtcDisableGeometry(embree.rtcGetGeometry(self._scene, row))
        for row in self._hidden - hidden:
            embree.rtcEnableGeometry(embree.rtcGetGeometry(self._scene, row))
        embree.rtcCommitScene(self._scene)
        self._hidden = hidden

    def cast(
        self,
        origins: Floats,
        directions: Floats,
        max_range_m: float,
        *,
        share: Floats | None = None,
        order: Rows | None = None,
    ) -> Met:
        """What each ray meets first.

        Args:
            origins: (n, 3) float32.
            directions: (n, 3) float32, unit vectors.
            max_range_m: Where rays end.
            share: (n,) float32 of the way from before to now when each ray is cast; None for now.
            order: (n,) rows of rays in an order in which neighbours go much the same way; None
                for the order they come in.
        """
        count = len(directions)
        met = Met(
            solid=np.empty(count, np.int32),
            triangle=np.empty(count, np.int32),
            range_m=np.empty(count, np.float32),
        )
        rows = np.arange(count) if order is None else order
        floats, whole = self._packets.floats, self._packets.whole
        for first in range(0, count, _PACKETS * _LANES):
            some = rows[first : first + _PACKETS * _LANES]
            packets = -(-len(some) // _LANES)
            # The last ray fills what is left of the last packet.
            lanes = np.append(some, np.repeat(some[-1:], packets * _LANES - len(some)))
            floats[:packets, _ORIGIN] = _by_packet(origins.take(lanes, axis=0))
            floats[:packets, _DIRECTION] = _by_packet(directions.take(lanes, axis=0))
            floats[:packets, _TIME] = (
                1.0 if share is None else share.take(lanes).reshape(-1, _LANES)
            )
            floats[:packets, _FAR] = max_range_m
            whole[:packets, _HIT] = -1
            self._packets.cast(self._scene, packets)
            met.solid[some] = whole[:packets, _SOLID].reshape(-1)[: len(some)]
            met.triangle[some] = whole[:packets, _TRIANGLE].reshape(-1)[: len(some)]
            met.range_m[some] = floats[:packets, _FAR].reshape(-1)[: len(some)]
        return met


class _Packets:
    """Room for `_PACKETS` RTCRayHit16, which hold field by field what 16 rays are and met.

    Attributes:
        floats: (packets, fields, lanes) float32.
        whole: The same bytes as int32.
    """

    def __init__(self) -> None:
        room = np.zeros(_PACKETS * _FIELDS * _LANES + 2 * _ALIGNED // 4, np.float32)
        start = -room.ctypes.data % _ALIGNED // 4
        packets = room[start:][: _PACKETS * _FIELDS * _LANES]
        self.floats = packets.reshape(_PACKETS, _FIELDS, _LANES)
        self.whole = self.floats.view(np.int32)
        self.whole[:, _MASK] = -1
        self._valid = np.full(_LANES + _ALIGNED // 4, -1, np.int32)
        self._valid = self._valid[-self._valid.ctypes.data % _ALIGNED // 4 :]
        base, size = self.floats.ctypes.data, self.floats[0].nbytes
        self._packets = [c_void_p(base + packet * size) for packet in range(_PACKETS)]
        self._arguments = _Arguments(_COHERENT, _EVERY_FEATURE)

    def cast(self, scene: int, count: int) -> None:
        """Have the first `count` packets cast."""
        intersect, valid = _embree().rtcIntersect16, c_void_p(self._valid.ctypes.data)
        at, how = c_void_p(scene), ctypes.byref(self._arguments)
        for packet in self._packets[:count]:
            intersect(valid, at, packet, how)


class _Arguments(ctypes.Structure):
    """RTCIntersectArguments."""

    _fields_ = (
        ("flags", c_uint),
        ("feature_mask", c_uint),
        ("context", c_void_p),
        ("filter", c_void_p),
        ("intersect", c_void_p),
    )


_POINTERS_IN = (
    "rtcCommitGeometry",
    "rtcCommitScene",
    "rtcDisableGeometry",
    "rtcEnableGeometry",
    "rtcReleaseGeometry",
    "rtcReleaseScene",
)


@cache
def _embree() -> Any:
    """Embree's functions, as far as they are called here.

    The library that embreex's module is linked to is found by way of that module. Calls are too
    short for others to have the interpreter meanwhile.
    """
    embree = ctypes.PyDLL(embreex_scene.__file__)
    for name in _POINTERS_IN:
        getattr(embree, name).argtypes = (c_void_p,)
    for name, result, *arguments in (
        ("rtcNewDevice", c_void_p, c_char_p),
        ("rtcGetDeviceError", c_uint, c_void_p),
        ("rtcNewScene", c_void_p, c_void_p),
        ("rtcSetSceneFlags", None, c_void_p, c_uint),
        ("rtcNewGeometry", c_void_p, c_void_p, c_uint),
        ("rtcGetGeometry", c_void_p, c_void_p, c_uint),
        ("rtcAttachGeometry", c_uint, c_void_p, c_void_p),
        ("rtcSetGeometryInstancedScene", None, c_void_p, c_void_p),
        ("rtcSetGeometryTimeStepCount", None, c_void_p, c_uint),
        ("rtcSetGeometryTransform", None, c_void_p, c_uint, c_uint, c_void_p),
        ("rtcSetGeometryTransformQuaternion", None, c_void_p, c_uint, c_void_p),
        (
            "rtcSetNewGeometryBuffer",
            c_void_p,
            *(c_void_p, c_uint, c_uint, c_uint, c_size_t, c_size_t),
        ),
    ):
        getattr(embree, name).restype = result
        getattr(embree, name).argtypes = tuple(arguments)
    return embree


@cache
def _device() -> int:
    return _embree().rtcNewDevice(None)


def _check() -> None:
    error = _embree().rtcGetDeviceError(_device())
    if error:
        raise RunError(f"Embree fails with error {error}; is there enough memory?")


def _new_scene(owner: object) -> int:
    """A scene that lives as long as its owner; no ray slips between two triangles of it."""
    scene = _embree().rtcNewScene(_device())
    weakref.finalize(owner, _embree().rtcReleaseScene, scene)
    _embree().rtcSetSceneFlags(scene, _ROBUST)
    return scene


def _new_geometry(kind: int) -> int:
    return _embree().rtcNewGeometry(_device(), kind)


def _attach(scene: int, geometry: int) -> None:
    """Hand a geometry over to a scene."""
    embree = _embree()
    embree.rtcCommitGeometry(geometry)
    embree.rtcAttachGeometry(scene, geometry)
    embree.rtcReleaseGeometry(geometry)


def _copy(geometry: int, kind: int, form: int, rows: NDArray[Any]) -> None:
    """Give a geometry a copy of rows (n, 3) of 4 bytes each."""
    room = _embree().rtcSetNewGeometryBuffer(geometry, kind, 0, form, rows.strides[0], len(rows))
    ctypes.memmove(room, rows.ctypes.data, rows.nbytes)


def _place(instance: int, world_from_solid: Matrix) -> None:
    rows = world_from_solid[:3].astype(np.float32)
    _embree().rtcSetGeometryTransform(instance, 0, _FLOAT3X4_ROW_MAJOR, rows.ctypes.data)


def _move(instance: int, before: Matrix, now: Matrix) -> None:
    embree = _embree()
    embree.rtcSetGeometryTimeStepCount(instance, 2)
    for step, world_from_solid in enumerate((before, now)):
        parts = _quaternion_parts(world_from_solid)
        embree.rtcSetGeometryTransformQuaternion(instance, step, parts.ctypes.data)


def _quaternion_parts(matrix: Matrix) -> Floats:
    """RTCQuaternionDecomposition (16,) of a turn and a shift: scale, skew, shift, turn, place."""
    return np.concatenate(
        [np.ones(3), np.zeros(6), poses.quaternion(matrix), matrix[:3, 3]], dtype=np.float32
    )


def _by_packet(vectors: Floats) -> Floats:
    """Vectors (n, 3) packet by packet (n / lanes, 3, lanes)."""
    return vectors.reshape(-1, _LANES, 3).transpose(0, 2, 1)
