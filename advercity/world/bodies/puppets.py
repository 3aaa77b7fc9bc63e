"""Bodies whose parts are carried by bones: made, fitted to their box, and put into a pose."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from advercity.semantics import Semantic
from advercity.world.bodies.flesh import Flesh
from advercity.world.bodies.skeleton import SIDES
from advercity.world.scene import Body, Gait, Mesh
from advercity.world.shapes import Floats, Surface, joined, shaded

POSES = 16
"""Of a cycle; a foot on the ground is kept in place between them."""
_FITTINGS = 4


@dataclass(frozen=True, eq=False)
class Limb:
    """A surface and the shares (n, bones) of what carries its vertices."""

    surface: Surface
    weights: Floats
    material: str
    semantic: Semantic


def fleshed(flesh: Flesh, material: str) -> Limb:
    """A garment of a person, or a part of one."""
    skin = flesh.skin()
    return Limb(skin, flesh.weights(skin.vertices, SIDES), material, Semantic.PEDESTRIAN)


def rigid(surface: Surface, bone: int, bones: int, material: str, semantic: Semantic) -> Limb:
    """A surface that keeps its shape and goes with one bone."""
    smooth = surface if surface.normals is not None else shaded(surface)
    weights = np.zeros((len(smooth.vertices), bones))
    weights[:, bone] = 1.0
    return Limb(smooth, weights, material, semantic)


def puppet(limbs: Sequence[Limb], gait: Gait, size: tuple[float, float, float]) -> Body:
    """The body of some limbs, one mesh per material and semantic class, unfitted."""
    groups: dict[tuple[str, Semantic], list[Limb]] = {}
    for limb in limbs:
        groups.setdefault((limb.material, limb.semantic), []).append(limb)
    parts = tuple(
        _mesh(material, semantic, own) for (material, semantic), own in sorted(groups.items())
    )
    return Body(parts, size, gait)


def _mesh(material: str, semantic: Semantic, limbs: Sequence[Limb]) -> Mesh:
    surface = joined(limb.surface for limb in limbs)
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


def posed(body: Body, pose: int | None) -> tuple[Mesh, ...]:
    """The parts of a body in a pose of its gait, or at rest."""
    if pose is None or body.gait is None:
        return body.parts
    moves = body.gait.moves[pose]
    return tuple(_carried(part, moves) for part in body.parts)


def _carried(part: Mesh, moves: NDArray[np.float32]) -> Mesh:
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


def fitted(body: Body, size: tuple[float, float, float]) -> Body:
    """A body stretched so that its poses, all together, touch every side of its box.

    Wheels stay round and so miss it by a little the first time.
    """
    for _ in range(_FITTINGS):
        body = scaled(body, *fit(body, size))
    return body


def fit(body: Body, size: tuple[float, float, float]) -> tuple[Floats, Floats]:
    """By which factor (3,) and offset (3,) a body comes to fill its box, standing on the ground."""
    low, high = extent(body)
    factor = np.asarray(size) / (high - low)
    return factor, -((low + high) / 2 * (1, 1, 0) + low * (0, 0, 1)) * factor


def extent(body: Body) -> tuple[Floats, Floats]:
    """Lowest and highest corner (3,) of the box around a body at rest and in all its poses.

    What moves the feet into place between poses counts too.
    """
    used = [np.unique(part.triangles) for part in body.parts]
    points = np.concatenate([p.vertices[u] for p, u in zip(body.parts, used, strict=True)])
    corners = [(points.min(axis=0), points.max(axis=0))]
    if body.gait is not None:
        shares = [part.weights for part in body.parts if part.weights is not None]
        weights = np.concatenate([w[u] for w, u in zip(shares, used, strict=True)])
        reach = body.gait.cycle_m / len(body.gait.moves) / 2 if body.gait.rests else 0.0
        for moves in body.gait.moves:
            move = np.tensordot(weights, moves, axes=1)
            carried = np.einsum("nij,nj->ni", move[..., :3], points) + move[..., 3]
            sway = np.array([reach, 0.0, 0.0])
            corners.append((carried.min(axis=0) - sway, carried.max(axis=0) + sway))
    low, high = np.array(corners, dtype=np.float64).swapaxes(0, 1)
    return low.min(axis=0), high.max(axis=0)


def scaled(body: Body, factor: Floats, offset: Floats) -> Body:
    """A body stretched along x, y and z, then shifted, in all its poses."""
    stretch = factor.astype(np.float32)
    parts = tuple(_stretched(part, factor, offset) for part in body.parts)
    if body.gait is None:
        return replace(body, parts=parts)
    moves = body.gait.moves.copy()
    moves[..., :3] *= stretch[:, None] / stretch
    moves[..., 3] = moves[..., 3] * stretch + offset
    moves[..., 3] -= np.einsum("pbij,j->pbi", moves[..., :3], offset)
    gait = replace(body.gait, cycle_m=body.gait.cycle_m * float(factor[0]), moves=moves)
    return replace(body, parts=parts, gait=gait)


def _stretched(part: Mesh, factor: Floats, offset: Floats) -> Mesh:
    """A part stretched, then shifted; what turns is as much longer as it is higher."""
    if part.wheel is None:
        return replace(part, vertices=(part.vertices * factor + offset).astype(np.float32))
    hub = np.asarray(part.wheel.hub)
    place = hub * factor + offset
    vertices = (part.vertices - hub) * factor[[2, 1, 2]] + place
    wheel = replace(part.wheel, hub=tuple(place.tolist()))
    return replace(part, vertices=vertices.astype(np.float32), wheel=wheel)
