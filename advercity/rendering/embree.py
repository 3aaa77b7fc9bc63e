"""Embree through its C interface: meshes, scenes of instances, and packets of rays.

embreex ships Embree, but its wrapper has neither instances, motion nor ray packets, so the C
functions of version 4 are called by ctypes. Packets of 16 coherent rays are two to three times as
fast as single rays. Embree computes in float32: 0.1 mm accuracy within 1 km of the origin.
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
from numpy.lib.array_utils import byte_bounds
from numpy.typing import NDArray

from advercity.errors import RunError
from advercity.geometry import poses
from advercity.geometry.arrays import FloatArray
from advercity.geometry.mesh import Mesh
from advercity.geometry.poses import Matrix

_GEOMETRY_TRIANGLE, _GEOMETRY_INSTANCE = 0, 121
_BUFFER_INDEX, _BUFFER_VERTEX = 0, 1
_UINT3, _FLOAT3, _FLOAT3X4_ROW_MAJOR = 0x5003, 0x9003, 0x9134
_DYNAMIC, _ROBUST, _COHERENT = 1 << 0, 1 << 2, 1 << 16
_EVERY_FEATURE = 0xFFFFFFFF
_LOW_QUALITY, _REFIT_QUALITY = 0, 3

_RAYS_PER_PACKET, _FIELDS_PER_RAY = 16, 21
"""Layout of RTCRayHit16: rays per packet, and 4-byte fields per ray."""
_ORIGIN, _DIRECTION, _NORMAL, _HIT = slice(0, 3), slice(4, 7), slice(12, 15), slice(17, 20)
_TIME, _FAR, _MASK, _PRIMITIVE_ID, _GEOMETRY_ID, _INSTANCE_ID = 7, 8, 9, 17, 18, 19
_ALIGNMENT_BYTES, _READ_BYTES = 64, 16
"""Alignment of packets, and the size of Embree's reads."""
_PACKETS_PER_BATCH = 512
"""Packets filled, cast and read at a time: as many as fit a core's cache."""


@dataclass(frozen=True, eq=False)
class EmbreeHits:
    """First hit of each of n rays.

    Attributes:
        instance: (n,) int32 row of the mesh in the scene; -1 for a miss.
        triangle: (n,) int32 row of the triangle in its mesh; -1 for a miss.
        range_m: (n,) float32; the maximum range for a miss.
        normal: (n, 3) float32 of the triangle in its mesh's frame, of any length; zeros for a miss.
    """

    instance: NDArray[np.int32]
    triangle: NDArray[np.int32]
    range_m: FloatArray
    normal: FloatArray


class EmbreeMesh:
    """The triangles of some meshes in sequence, in their own frame, ready for instances.

    Attributes:
        first_triangles: Row of the first triangle of each of Embree's geometries.

    Args:
        meshes: The meshes.
        is_posed: Its vertices will be moved.
        is_shared: Embree reads the arrays of the meshes, which must not change, instead of copies.
            Then each mesh is a geometry, while otherwise all are one.
    """

    def __init__(
        self, meshes: Sequence[Mesh], *, is_posed: bool = False, is_shared: bool = False
    ) -> None:
        embree, self.scene = _load_embree(), _new_scene(self, is_dynamic=is_posed)
        self._shared_meshes = meshes if is_shared else ()
        surfaces = [
            (
                mesh.vertices.astype(np.float32, copy=False),
                mesh.triangles.astype(np.int32, copy=False),
            )
            for mesh in self._shared_meshes
        ]
        for vertices, triangles in surfaces or [_join_triangles(meshes)]:
            self._geometry = _new_geometry(_GEOMETRY_TRIANGLE)
            _set_buffer(self._geometry, _BUFFER_VERTEX, _FLOAT3, vertices)
            _set_buffer(self._geometry, _BUFFER_INDEX, _UINT3, triangles)
            if is_posed:
                # A scene of any other quality builds its tree anew.
                embree.rtcSetSceneBuildQuality(self.scene, _LOW_QUALITY)
                embree.rtcSetGeometryBuildQuality(self._geometry, _REFIT_QUALITY)
            _attach(self.scene, self._geometry)
        counts = [len(triangles) for _, triangles in surfaces]
        self.first_triangles = np.cumsum([0, *counts[:-1]]).tolist()
        embree.rtcCommitScene(self.scene)
        _raise_on_error()

    def move_vertices(self, vertices: FloatArray) -> None:
        """Move the vertices (n, 3) of a posed mesh, in a tenth of the time to build another.

        Embree refits its tree, whose structure stays as built from the first vertices: so hits
        do not depend on the poses in between. Scenes of instances must be built again.
        """
        embree, rows = _load_embree(), np.ascontiguousarray(vertices, np.float32)
        buffer = embree.rtcGetGeometryBufferData(self._geometry, _BUFFER_VERTEX, 0)
        ctypes.memmove(buffer, rows.ctypes.data, rows.nbytes)
        embree.rtcUpdateGeometryBuffer(self._geometry, _BUFFER_VERTEX, 0)
        embree.rtcCommitGeometry(self._geometry)
        embree.rtcCommitScene(self.scene)
        _raise_on_error()


class EmbreeScene:
    """Instances of meshes, at rest or in motion while rays are cast.

    Args:
        meshes: k meshes.
        world_from_mesh: (k, 4, 4) poses.
        previous_world_from_mesh: (k, 4, 4) poses one tick earlier, for rays at times in between:
            positions are interpolated linearly, rotations by slerp. None without motion.
    """

    def __init__(
        self,
        meshes: Sequence[EmbreeMesh],
        world_from_mesh: Matrix,
        previous_world_from_mesh: Matrix | None = None,
    ) -> None:
        self._scene = _new_scene(self)
        self._hidden: frozenset[int] = frozenset()
        self._packets = _RayPackets()
        shared = [mesh for mesh in meshes if len(mesh.first_triangles) > 1]
        assert len(shared) <= 1, "no geometry but the first is looked up by its mesh"
        # A miss has -1 for the geometry, which looks up the last row.
        starts = shared[0].first_triangles if shared else [0]
        self._first_triangles = np.array([*starts, 0], np.int32)
        for row, mesh in enumerate(meshes):
            geometry = _new_geometry(_GEOMETRY_INSTANCE)
            _load_embree().rtcSetGeometryInstancedScene(geometry, mesh.scene)
            if previous_world_from_mesh is None:
                _set_static_transform(geometry, world_from_mesh[row])
            else:
                _set_motion_transforms(
                    geometry, previous_world_from_mesh[row], world_from_mesh[row]
                )
            _attach(self._scene, geometry)
        _load_embree().rtcCommitScene(self._scene)
        _raise_on_error()

    def hide(self, rows: Collection[int]) -> None:
        """Hide the instances in `rows`, and no others, from rays."""
        hidden = frozenset(rows)
        if hidden == self._hidden:
            return
        embree = _load_embree()
        for row in hidden - self._hidden:
            embree.rtcDisableGeometry(embree.rtcGetGeometry(self._scene, row))
        for row in self._hidden - hidden:
            embree.rtcEnableGeometry(embree.rtcGetGeometry(self._scene, row))
        embree.rtcCommitScene(self._scene)
        self._hidden = hidden

    def cast(
        self,
        origins: FloatArray,
        directions: FloatArray,
        max_range_m: float,
        *,
        time_fraction: FloatArray | None = None,
        rings: int = 1,
    ) -> EmbreeHits:
        """Find the first hit of each ray.

        Rays have origins and unit directions (n, 3) in float32, and times (n,) from 0 (previous
        poses) to 1 (current poses); without times it is 1. Successive rays belong to `rings` rings
        in turn, and a packet takes successive rays of one ring: their directions should be similar.
        """
        count = len(directions)
        hits = EmbreeHits(
            instance=np.empty(count, np.int32),
            triangle=np.empty(count, np.int32),
            range_m=np.empty(count, np.float32),
            normal=np.empty((3, count), np.float32).T,  # columns are faster to fill than rows
        )
        if rings > len(self._packets.floats):
            self._packets = _RayPackets(rings)
        per_block = _RAYS_PER_PACKET * rings
        per_batch = len(self._packets.floats) // rings * per_block
        for first in range(0, count, per_batch):
            batch = slice(first, min(first + per_batch, count))
            blocks = -((first - batch.stop) // per_block)
            shape = (blocks, rings, _FIELDS_PER_RAY, _RAYS_PER_PACKET)
            floats = self._packets.floats[: blocks * rings].reshape(shape)
            integers = floats.view(np.int32)
            floats[:, :, _ORIGIN] = _to_packets(origins[batch], rings)
            floats[:, :, _DIRECTION] = _to_packets(directions[batch], rings)
            floats[:, :, _TIME] = (
                1.0 if time_fraction is None else _to_packets(time_fraction[batch], rings)
            )
            floats[:, :, _FAR] = max_range_m
            floats[:, :, _NORMAL] = 0.0
            integers[:, :, _HIT] = -1
            self._packets.cast(self._scene, blocks * rings)
            triangle = self._first_triangles.take(integers[:, :, _GEOMETRY_ID], mode="wrap")
            triangle += integers[:, :, _PRIMITIVE_ID]
            for target, field in (
                (hits.instance, integers[:, :, _INSTANCE_ID]),
                (hits.triangle, triangle),
                (hits.range_m, floats[:, :, _FAR]),
                *zip(hits.normal.T, np.moveaxis(floats[:, :, _NORMAL], 2, 0), strict=True),
            ):
                target[batch] = field.swapaxes(1, 2).ravel()[: batch.stop - first]
        return hits


class _RayPackets:
    """Memory of some RTCRayHit16, structures of arrays for 16 rays and their hits.

    Attributes:
        floats: (packets, fields, lanes) float32.
        integers: View of the same bytes as int32.
    """

    def __init__(self, count: int = _PACKETS_PER_BATCH) -> None:
        # RTCRayHit16 must be aligned to 64 bytes, which NumPy does not promise.
        size = count * _FIELDS_PER_RAY * _RAYS_PER_PACKET
        room = np.zeros(size + 2 * _ALIGNMENT_BYTES // 4, np.float32)
        packets = room[-room.ctypes.data % _ALIGNMENT_BYTES // 4 :][:size]
        self.floats = packets.reshape(count, _FIELDS_PER_RAY, _RAYS_PER_PACKET)
        self.integers = self.floats.view(np.int32)
        self.integers[:, _MASK] = -1
        self._valid = np.full(_RAYS_PER_PACKET + _ALIGNMENT_BYTES // 4, -1, np.int32)
        self._valid = self._valid[-self._valid.ctypes.data % _ALIGNMENT_BYTES // 4 :]
        base, size = self.floats.ctypes.data, self.floats[0].nbytes
        self._packets = [c_void_p(base + packet * size) for packet in range(count)]
        self._arguments = _IntersectArguments(_COHERENT, _EVERY_FEATURE)

    def cast(self, scene: int, count: int) -> None:
        """Cast the rays of the first `count` packets."""
        intersect, valid = _load_embree().rtcIntersect16, c_void_p(self._valid.ctypes.data)
        handle, arguments = c_void_p(scene), ctypes.byref(self._arguments)
        for packet in self._packets[:count]:
            intersect(valid, handle, packet, arguments)


class _IntersectArguments(ctypes.Structure):
    _fields_ = (
        ("flags", c_uint),
        ("feature_mask", c_uint),
        ("context", c_void_p),
        ("filter", c_void_p),
        ("intersect", c_void_p),
    )


_SINGLE_POINTER_FUNCTIONS = (
    "rtcCommitGeometry",
    "rtcCommitScene",
    "rtcDisableGeometry",
    "rtcEnableGeometry",
    "rtcReleaseGeometry",
    "rtcReleaseScene",
)


@cache
def _load_embree() -> Any:
    # embreex's extension module is linked to Embree, so its handle finds Embree's symbols too.
    # PyDLL keeps the interpreter lock: calls are shorter than releasing and taking it again.
    embree = ctypes.PyDLL(embreex_scene.__file__)
    for name in _SINGLE_POINTER_FUNCTIONS:
        getattr(embree, name).argtypes = (c_void_p,)
    for name, result, *arguments in (
        ("rtcNewDevice", c_void_p, c_char_p),
        ("rtcGetDeviceError", c_uint, c_void_p),
        ("rtcNewScene", c_void_p, c_void_p),
        ("rtcSetSceneFlags", None, c_void_p, c_uint),
        ("rtcSetSceneBuildQuality", None, c_void_p, c_uint),
        ("rtcSetGeometryBuildQuality", None, c_void_p, c_uint),
        ("rtcNewGeometry", c_void_p, c_void_p, c_uint),
        ("rtcGetGeometry", c_void_p, c_void_p, c_uint),
        ("rtcAttachGeometry", c_uint, c_void_p, c_void_p),
        ("rtcSetGeometryInstancedScene", None, c_void_p, c_void_p),
        ("rtcSetGeometryTimeStepCount", None, c_void_p, c_uint),
        ("rtcSetGeometryTransform", None, c_void_p, c_uint, c_uint, c_void_p),
        ("rtcSetGeometryTransformQuaternion", None, c_void_p, c_uint, c_void_p),
        ("rtcGetGeometryBufferData", c_void_p, c_void_p, c_uint, c_uint),
        ("rtcUpdateGeometryBuffer", None, c_void_p, c_uint, c_uint),
        (
            "rtcSetSharedGeometryBuffer",
            *(None, c_void_p, c_uint, c_uint, c_uint),
            *(c_void_p, c_size_t, c_size_t, c_size_t),
        ),
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
def _open_device() -> int:
    # Embree's threads wait busily: small trees take twice the CPU time. Each core has a process.
    return _load_embree().rtcNewDevice(b"threads=1")


def _raise_on_error() -> None:
    error = _load_embree().rtcGetDeviceError(_open_device())
    if error:
        raise RunError(f"Embree reports error {error}; is there enough memory?")


def _new_scene(owner: object, *, is_dynamic: bool = False) -> int:
    """Create a scene with its owner's lifetime, without gaps between adjacent triangles."""
    scene = _load_embree().rtcNewScene(_open_device())
    weakref.finalize(owner, _load_embree().rtcReleaseScene, scene)
    _load_embree().rtcSetSceneFlags(scene, _ROBUST | _DYNAMIC if is_dynamic else _ROBUST)
    return scene


def _new_geometry(kind: int) -> int:
    return _load_embree().rtcNewGeometry(_open_device(), kind)


def _attach(scene: int, geometry: int) -> None:
    """Commit a geometry and transfer its ownership to a scene."""
    embree = _load_embree()
    embree.rtcCommitGeometry(geometry)
    embree.rtcAttachGeometry(scene, geometry)
    embree.rtcReleaseGeometry(geometry)


def _join_triangles(meshes: Sequence[Mesh]) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Join the vertices (n, 3) and the triangles (m, 3) of some meshes."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)], dtype=np.int32)
    triangles = [mesh.triangles + start for mesh, start in zip(meshes, starts, strict=False)]
    # The empty first item lets no meshes concatenate.
    vertices = [np.zeros((0, 3), np.float32), *(mesh.vertices for mesh in meshes)]
    joined = np.concatenate([np.zeros((0, 3), np.int32), *triangles], dtype=np.int32)
    return np.concatenate(vertices, dtype=np.float32), joined


def _set_buffer(geometry: int, kind: int, form: int, rows: NDArray[Any]) -> None:
    """Make a geometry read rows (n, 3) of 4-byte numbers in place, or else a copy of them.

    Embree may read beyond the last row: they must be followed by others of the same array.
    """
    whole = rows.base
    if not (
        isinstance(whole, np.ndarray)
        and rows.flags.c_contiguous
        and byte_bounds(rows)[1] + _READ_BYTES <= byte_bounds(whole)[1]
    ):
        _copy_buffer(geometry, kind, form, np.ascontiguousarray(rows))
        return
    _load_embree().rtcSetSharedGeometryBuffer(
        geometry, kind, 0, form, rows.ctypes.data, 0, rows.strides[0], len(rows)
    )


def _copy_buffer(geometry: int, kind: int, form: int, rows: NDArray[Any]) -> None:
    """Copy rows (n, 3) of 4-byte numbers into a new buffer of a geometry."""
    buffer = _load_embree().rtcSetNewGeometryBuffer(
        geometry, kind, 0, form, rows.strides[0], len(rows)
    )
    ctypes.memmove(buffer, rows.ctypes.data, rows.nbytes)


def _set_static_transform(instance: int, world_from_mesh: Matrix) -> None:
    rows = world_from_mesh[:3].astype(np.float32)
    _load_embree().rtcSetGeometryTransform(instance, 0, _FLOAT3X4_ROW_MAJOR, rows.ctypes.data)


def _set_motion_transforms(instance: int, previous: Matrix, current: Matrix) -> None:
    embree = _load_embree()
    embree.rtcSetGeometryTimeStepCount(instance, 2)
    for step, world_from_mesh in enumerate((previous, current)):
        parts = _to_quaternion_decomposition(world_from_mesh)
        embree.rtcSetGeometryTransformQuaternion(instance, step, parts.ctypes.data)


def _to_quaternion_decomposition(matrix: Matrix) -> FloatArray:
    """Build an RTCQuaternionDecomposition (16,): scale, skew, shift, rotation, translation."""
    return np.concatenate(
        [np.ones(3), np.zeros(6), poses.to_quaternion(matrix), matrix[:3, 3]], dtype=np.float32
    )


def _to_packets(rays: FloatArray, rings: int) -> FloatArray:
    """Reorder a field of rays, (n,) or (n, 3), by block, ring and packet: (k, rings, ..., lanes).

    Copies of the last ray fill up the last block.
    """
    missing = -len(rays) % (rings * _RAYS_PER_PACKET)
    if missing:
        rays = np.concatenate([rays, np.repeat(rays[-1:], missing, axis=0)])
    return np.moveaxis(rays.reshape(-1, _RAYS_PER_PACKET, rings, *rays.shape[1:]), 1, -1)
