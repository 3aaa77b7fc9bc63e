"""Assembles bodies with bones, fits bodies to their boxes, and puts them into poses."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from advercity.assets.skeleton import BONE_SIDES
from advercity.assets.soft_shapes import SoftShape
from advercity.geometry.arrays import Float32Array, Float64Array, IndexArray
from advercity.geometry.mesh import Mesh, Size, TriangleSurface, join_surfaces, shade_smooth
from advercity.identity_cache import cache_by_identity
from advercity.semantics import Semantic
from advercity.world import Body, Gait

POSES_PER_CYCLE = 16
"""Poses of a gait; between two of them the whole body is shifted, so feet do not slide."""
_KEPT_POSES = 2048
"""Poses with kept vertices: enough for 128 people, some 75 MB."""
_FIT_ITERATIONS = 4
_ROUNDING_M = 1e-4
"""Upper bound of rounding errors of points."""


@dataclass(frozen=True, eq=False)
class SkinnedSurface:
    """A surface with the weights (n, bones) of bones on its vertices."""

    surface: TriangleSurface
    weights: Float64Array
    material: str
    semantic: Semantic


def skin_soft_shape(shape: SoftShape, material: str) -> SkinnedSurface:
    """Skin a soft shape of a person to the bones of its cones."""
    surface = shape.build_surface()
    weights = shape.compute_bone_weights(surface.vertices, BONE_SIDES)
    return SkinnedSurface(surface, weights, material, Semantic.PEDESTRIAN)


def attach_to_bone(
    surface: TriangleSurface, bone: int, bones: int, material: str, semantic: Semantic
) -> SkinnedSurface:
    """Attach a rigid surface to one of `bones` bones."""
    smooth = surface if surface.normals is not None else shade_smooth(surface)
    weights = np.zeros((len(smooth.vertices), bones))
    weights[:, bone] = 1.0
    return SkinnedSurface(smooth, weights, material, semantic)


def build_rigged_body(limbs: Sequence[SkinnedSurface], gait: Gait | None, size: Size) -> Body:
    """Assemble a body of one mesh per material and semantic class; it is not fitted to `size`."""
    groups: dict[tuple[str, Semantic], list[SkinnedSurface]] = {}
    for limb in limbs:
        groups.setdefault((limb.material, limb.semantic), []).append(limb)
    parts = tuple(
        _merge_surfaces(material, semantic, group)
        for (material, semantic), group in sorted(groups.items())
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


@dataclass(frozen=True, eq=False)
class _Skin:
    """Points and the bones moving each: one or two of many, as a rule.

    Attributes:
        points: (n, 3) float32 at rest.
        bones: First the first bone of every point, then the second bone of the points with two,
            and so on: rows (m,) of the points, bones (m,), weights (m, 1).
    """

    points: Float32Array
    bones: tuple[tuple[IndexArray, IndexArray, Float32Array], ...]

    @classmethod
    def build(cls, weights: Float32Array, points: Float32Array) -> "_Skin":
        """Build it from the weights (n, bones) of all bones, nearly all zero."""
        counts = np.count_nonzero(weights, axis=1)
        order = np.argsort(weights == 0.0, axis=1, kind="stable")
        bones: list[tuple[IndexArray, IndexArray, Float32Array]] = []
        for number in range(int(counts.max(initial=1))):
            rows = np.flatnonzero(counts > number) if number else np.arange(len(points))
            bones.append((rows, order[rows, number], weights[rows, order[rows, number]][:, None]))
        return cls(points, tuple(bones))

    def blend(self, transforms: Float32Array) -> Float32Array:
        """Blend the transforms of bones (bones, 3, 4) to transforms of the points (n, 3, 4)."""
        # Not by a product of matrices: OpenBLAS sums in another order on every kind of processor.
        flat = transforms.reshape(len(transforms), -1)
        (_, first, weights), *others = self.bones
        blended = flat.take(first, axis=0) * weights
        for rows, bones, weights in others:
            blended[rows] += flat.take(bones, axis=0) * weights
        return blended.reshape(-1, 3, 4)

    def move(self, transforms: Float32Array) -> Float32Array:
        """Move the points (n, 3) by transforms of bones (bones, 3, 4): linear blend skinning."""
        return self.apply(self.blend(transforms))

    def apply(self, blended: Float32Array) -> Float32Array:
        """Apply its own transform (n, 3, 4) to each point."""
        return np.einsum("nij,nj->ni", blended[..., :3], self.points) + blended[..., 3]


@cache_by_identity(maxsize=512)
def _build_body_skin(body: Body) -> _Skin:
    weights = [part.weights for part in body.parts if part.weights is not None]
    return _Skin.build(np.concatenate(weights), _join_vertices(body.parts))


def pose_body(body: Body, pose: int | None) -> tuple[Mesh, ...]:
    """Compute the parts of a body in a pose of its gait; None: at rest."""
    if pose is None or body.gait is None:
        return body.parts
    skin = _build_body_skin(body)
    blended = skin.blend(body.gait.bone_transforms[pose])
    ends = np.cumsum([len(part.vertices) for part in body.parts])[:-1]
    moved, turns = np.split(skin.apply(blended), ends), np.split(blended[..., :3], ends)
    return tuple(
        replace(part, vertices=vertices, normals=_turn_normals(part.normals, turn))
        for part, vertices, turn in zip(body.parts, moved, turns, strict=True)
    )


@cache_by_identity(maxsize=_KEPT_POSES)
def pose_vertices(body: Body, pose: int | None) -> Float32Array:
    """Compute the vertices (n, 3) of all parts of `pose_body` in sequence; they are read-only.

    People who walk return to the same few poses every second, so they are kept.
    """
    vertices = (
        _join_vertices(body.parts)
        if pose is None or body.gait is None
        else _build_body_skin(body).move(body.gait.bone_transforms[pose])
    )
    vertices.flags.writeable = False
    return vertices


def _join_vertices(parts: Sequence[Mesh]) -> Float32Array:
    return np.concatenate([part.vertices for part in parts])


def _turn_normals(normals: Float32Array | None, rotations: Float32Array) -> Float32Array | None:
    """Turn normals (n, 3) by rotations (n, 3, 3), possibly with a stretch."""
    if normals is None:
        return None
    turned = np.einsum("nij,nj->ni", rotations, normals)
    return turned / np.linalg.norm(turned, axis=1, keepdims=True)


def fit_to_box(body: Body, size: Size) -> Body:
    """Stretch a body until all its poses together touch every side of its box."""
    # Wheels stay round, so the first stretch misses the box a little.
    for _ in range(_FIT_ITERATIONS):
        body = scale_body(body, *compute_box_fit(body, size))
    return body


def compute_box_fit(body: Body, size: Size) -> tuple[Float64Array, Float64Array]:
    """Compute the factor (3,) and the offset (3,) to fill a box with a body."""
    low, high = compute_extent(body)
    factor = np.asarray(size) / (high - low)
    return factor, -((low + high) / 2 * (1, 1, 0) + low * (0, 0, 1)) * factor


def compute_extent(body: Body) -> tuple[Float64Array, Float64Array]:
    """Compute the lowest and highest corner (3,) of a body at rest and in all its poses.

    The shift of the body between poses is included.
    """
    used = [np.unique(part.triangles) for part in body.parts]
    points = np.concatenate([p.vertices[u] for p, u in zip(body.parts, used, strict=True)])
    corners = [(points.min(axis=0), points.max(axis=0))]
    if body.gait is not None:
        all_weights = [part.weights for part in body.parts if part.weights is not None]
        weights = np.concatenate([w[u] for w, u in zip(all_weights, used, strict=True)])
        poses = body.gait.bone_transforms
        outermost = _find_outermost_points(weights, poses, points)
        weights, points = weights[outermost], points[outermost]
        shift_m = body.gait.cycle_length_m / len(poses) / 2 if body.gait.returns_to_rest else 0.0
        shift = np.array([shift_m, 0.0, 0.0])
        skin = _Skin.build(weights, points)
        for transforms in poses:
            moved = skin.move(transforms)
            axes = np.ascontiguousarray(moved.T)  # three long rows are searched sooner
            corners.append((axes.min(axis=1) - shift, axes.max(axis=1) + shift))
    low, high = np.array(corners, dtype=np.float64).swapaxes(0, 1)
    return low.min(axis=0), high.max(axis=0)


def _find_outermost_points(
    weights: Float32Array, poses: Float32Array, points: Float32Array
) -> IndexArray:
    """Find the rows of the points (n, 3) possibly farthest along an axis in some pose.

    A product of matrices is fast, but rounds in another way on every kind of processor: it finds
    the few points whose places are then computed.
    """
    weighted = weights[:, :, None] * np.pad(points, ((0, 0), (0, 1)), constant_values=1.0)[:, None]
    coordinates = poses.transpose(1, 3, 0, 2).reshape(weighted[0].size, -1)
    moved = weighted.reshape(len(points), -1) @ coordinates
    is_low = moved <= moved.min(axis=0) + _ROUNDING_M
    is_high = moved >= moved.max(axis=0) - _ROUNDING_M
    return np.flatnonzero((is_low | is_high).any(axis=1))


def scale_body(body: Body, factor: Float64Array, offset: Float64Array) -> Body:
    """Stretch a body along x, y and z, then shift it, in all its poses."""
    stretch = factor.astype(np.float32)
    parts = tuple(_scale_mesh(part, factor, offset) for part in body.parts)
    if body.gait is None:
        return replace(body, parts=parts)
    # Conjugate each transform with the stretch and shift: x' = S T(S^-1 x).
    transforms = body.gait.bone_transforms.copy()
    transforms[..., :3] *= stretch[:, None] / stretch
    transforms[..., 3] = transforms[..., 3] * stretch + offset
    transforms[..., 3] -= np.einsum("pbij,j->pbi", transforms[..., :3], offset)
    cycle_length_m = body.gait.cycle_length_m * float(factor[0])
    gait = replace(body.gait, cycle_length_m=cycle_length_m, bone_transforms=transforms)
    return replace(body, parts=parts, gait=gait)


def _scale_mesh(part: Mesh, factor: Float64Array, offset: Float64Array) -> Mesh:
    """Stretch a part, then shift it; wheels are stretched along x as along z, to stay round."""
    if part.wheel is None:
        return replace(part, vertices=(part.vertices * factor + offset).astype(np.float32))
    hub = np.asarray(part.wheel.hub)
    moved_hub = hub * factor + offset
    vertices = (part.vertices - hub) * factor[[2, 1, 2]] + moved_hub
    wheel = replace(part.wheel, hub=tuple(moved_hub.tolist()))
    return replace(part, vertices=vertices.astype(np.float32), wheel=wheel)
