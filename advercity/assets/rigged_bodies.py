"""Bodies whose parts are carried by bones: made, fitted to their box, and put into a pose."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from advercity.assets.skeleton import BONE_SIDES
from advercity.assets.soft_shapes import SoftShape
from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import Mesh, TriangleSurface, join_surfaces, shade_smooth
from advercity.semantics import Semantic
from advercity.world import Body, Gait

POSES_PER_CYCLE = 16
"""Of a cycle; a foot on the ground is kept in place between them."""
_FIT_ITERATIONS = 4


@dataclass(frozen=True, eq=False)
class SkinnedSurface:
    """A surface and the shares (n, bones) of what carries its vertices."""

    surface: TriangleSurface
    weights: Float64Array
    material: str
    semantic: Semantic


def skin_soft_shape(flesh: SoftShape, material: str) -> SkinnedSurface:
    """A garment of a person, or a part of one."""
    skin = flesh.build_surface()
    return SkinnedSurface(
        skin, flesh.compute_bone_weights(skin.vertices, BONE_SIDES), material, Semantic.PEDESTRIAN
    )


def attach_to_bone(
    surface: TriangleSurface, bone: int, bones: int, material: str, semantic: Semantic
) -> SkinnedSurface:
    """A surface that keeps its shape and goes with one bone."""
    smooth = surface if surface.normals is not None else shade_smooth(surface)
    weights = np.zeros((len(smooth.vertices), bones))
    weights[:, bone] = 1.0
    return SkinnedSurface(smooth, weights, material, semantic)


def build_rigged_body(
    limbs: Sequence[SkinnedSurface], gait: Gait, size: tuple[float, float, float]
) -> Body:
    """The body of some limbs, one mesh per material and semantic class, unfitted."""
    groups: dict[tuple[str, Semantic], list[SkinnedSurface]] = {}
    for limb in limbs:
        groups.setdefault((limb.material, limb.semantic), []).append(limb)
    parts = tuple(
        _merge_surfaces(material, semantic, own)
        for (material, semantic), own in sorted(groups.items())
    )
    return Body(parts, size, gait)


def _merge_surfaces(material: str, semantic: Semantic, limbs: Sequence[SkinnedSurface]) -> Mesh:
    surface = join_surfaces(limb.surface for limb in limbs)
    assert surface.normals is not None
    return Mesh(
        f"{semantic.name.lower()}_{material}",
        surface.vertices.astype(np.float32),
        surface.triangles.astype(np.int32),
        material,
        semantic,
        surface.normals.astype(np.float32),
        np.concatenate([limb.weights for limb in limbs]).astype(np.float32),
    )


def pose_body(body: Body, pose: int | None) -> tuple[Mesh, ...]:
    """The parts of a body in a pose of its gait, or at rest."""
    if pose is None or body.gait is None:
        return body.parts
    moves = body.gait.bone_transforms[pose]
    return tuple(_skin_mesh(part, moves) for part in body.parts)


def _skin_mesh(part: Mesh, moves: NDArray[np.float32]) -> Mesh:
    """A mesh as its bones carry it (linear blend skinning)."""
    if part.weights is None:
        return part
    move = np.tensordot(part.weights, moves, axes=1)
    vertices = np.einsum("nij,nj->ni", move[..., :3], part.vertices) + move[..., 3]
    normals = None
    if part.normals is not None:
        normals = np.einsum("nij,nj->ni", move[..., :3], part.normals)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return replace(part, vertices=vertices, normals=normals)


def fit_to_box(body: Body, size: tuple[float, float, float]) -> Body:
    """A body stretched so that its poses, all together, touch every side of its box.

    Wheels stay round and so miss it by a little the first time.
    """
    for _ in range(_FIT_ITERATIONS):
        body = scale_body(body, *compute_box_fit(body, size))
    return body


def compute_box_fit(
    body: Body, size: tuple[float, float, float]
) -> tuple[Float64Array, Float64Array]:
    """By which factor (3,) and offset (3,) a body comes to fill its box, standing on the ground."""
    low, high = compute_extent(body)
    factor = np.asarray(size) / (high - low)
    return factor, -((low + high) / 2 * (1, 1, 0) + low * (0, 0, 1)) * factor


def compute_extent(body: Body) -> tuple[Float64Array, Float64Array]:
    """Lowest and highest corner (3,) of the box around a body at rest and in all its poses.

    What moves the feet into place between poses counts too.
    """
    used = [np.unique(part.triangles) for part in body.parts]
    points = np.concatenate([p.vertices[u] for p, u in zip(body.parts, used, strict=True)])
    corners = [(points.min(axis=0), points.max(axis=0))]
    if body.gait is not None:
        shares = [part.weights for part in body.parts if part.weights is not None]
        weights = np.concatenate([w[u] for w, u in zip(shares, used, strict=True)])
        reach = (
            body.gait.cycle_length_m / len(body.gait.bone_transforms) / 2
            if body.gait.returns_to_rest
            else 0.0
        )
        for moves in body.gait.bone_transforms:
            move = np.tensordot(weights, moves, axes=1)
            carried = np.einsum("nij,nj->ni", move[..., :3], points) + move[..., 3]
            sway = np.array([reach, 0.0, 0.0])
            corners.append((carried.min(axis=0) - sway, carried.max(axis=0) + sway))
    low, high = np.array(corners, dtype=np.float64).swapaxes(0, 1)
    return low.min(axis=0), high.max(axis=0)


def scale_body(body: Body, factor: Float64Array, offset: Float64Array) -> Body:
    """A body stretched along x, y and z, then shifted, in all its poses."""
    stretch = factor.astype(np.float32)
    parts = tuple(_scale_mesh(part, factor, offset) for part in body.parts)
    if body.gait is None:
        return replace(body, parts=parts)
    moves = body.gait.bone_transforms.copy()
    moves[..., :3] *= stretch[:, None] / stretch
    moves[..., 3] = moves[..., 3] * stretch + offset
    moves[..., 3] -= np.einsum("pbij,j->pbi", moves[..., :3], offset)
    gait = replace(
        body.gait, cycle_length_m=body.gait.cycle_length_m * float(factor[0]), bone_transforms=moves
    )
    return replace(body, parts=parts, gait=gait)


def _scale_mesh(part: Mesh, factor: Float64Array, offset: Float64Array) -> Mesh:
    """A part stretched, then shifted; what turns is as much longer as it is higher."""
    if part.wheel is None:
        return replace(part, vertices=(part.vertices * factor + offset).astype(np.float32))
    hub = np.asarray(part.wheel.hub)
    place = hub * factor + offset
    vertices = (part.vertices - hub) * factor[[2, 1, 2]] + place
    wheel = replace(part.wheel, hub=tuple(place.tolist()))
    return replace(part, vertices=vertices.astype(np.float32), wheel=wheel)
