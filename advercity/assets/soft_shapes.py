"""Builds smooth surfaces around merging round cones: limbs, heads and garments.

A soft shape is a signed distance field, negative inside. Its surface is found by surface nets
(Gibson 1998): a vertex in every grid cell crossed by the surface, then moved onto it.

A figure places cones on its skeleton. Lengths are fractions of the figure's height, on the head
fractions of the head's height, unless their names end in `_m`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import pairwise, repeat
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from advercity.assets.skeleton import BodyBuild, Bone, Joint, bone_on_side, joint_on_side
from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import TriangleSurface, xyz

_GRADIENT_STEP_M = 1e-4
_WEIGHT_FALLOFF_M = 0.022
"""Distance over which the weight of a bone falls off, outside its own cones."""
_CELL_SCALE = 1.3
"""Factor on cell sizes for close-ups: people are seen from some metres."""
_SEAM_WIDTH_M = 0.03
"""Width of the strip in the middle where bones of both sides have weight."""


@dataclass(frozen=True, eq=False)
class RoundCone:
    """Volume swept by a ball along a line while its radius changes.

    Attributes:
        start: (3,) first centre of the ball, metres.
        end: (3,) last centre.
        radii: Radii of the ball at both, metres.
        bone: Number of its bone.
        width_ratio: Width of the ball (along y) over its depth.
    """

    start: Float64Array
    end: Float64Array
    radii: tuple[float, float]
    bone: int
    width_ratio: float = 1.0

    def compute_distance(self, points: Float64Array) -> Float64Array:
        """Compute the distances (n,) of points (n, 3); exact on the surface, else approximate."""
        line = self.end - self.start
        fraction = (points - self.start) @ line / max(float(line @ line), 1e-12)
        fraction = np.clip(fraction, 0.0, 1.0)
        radius = self.radii[0] + fraction * (self.radii[1] - self.radii[0])
        x, y, z = (points[:, axis] - self.start[axis] - fraction * line[axis] for axis in range(3))
        y /= self.width_ratio
        return np.sqrt(x * x + y * y + z * z) - radius


Chain = tuple[RoundCone, ...]


@dataclass(frozen=True, eq=False)
class SoftShape:
    """Chains of cones with one surface.

    Attributes:
        chains: Cones of limbs and of the trunk.
        blend_m: Distance between chains at which they begin to merge.
        cell_m: Size (x, y, z) of the grid cells of the surface.
        smooth_m: The same distance within a chain, small so the surface hardly bulges.
        hems: Height below which each chain is cut off; empty: no chain is.
    """

    chains: tuple[Chain, ...]
    blend_m: float
    cell_m: tuple[float, float, float]
    smooth_m: float
    hems: tuple[float, ...] = ()

    def compute_distance(self, points: Float64Array) -> Float64Array:
        """Compute the distances (n,) of points (n, 3), metres."""
        limbs: list[Float64Array] = []
        for chain, hem in zip(self.chains, self.hems or repeat(-np.inf), strict=False):
            distances = [cone.compute_distance(points) for cone in chain]
            limb = _compute_smooth_minimum(distances, self.smooth_m)
            limbs.append(np.maximum(limb, hem - points[:, 2]))
        return _compute_smooth_minimum(limbs, self.blend_m)

    def build_surface(self) -> TriangleSurface:
        """Build the closed surface, with normals."""
        cones = [cone for chain in self.chains for cone in chain]
        ends = np.array([end for cone in cones for end in (cone.start, cone.end)])
        radii = np.array([(r, r * cone.width_ratio, r) for cone in cones for r in cone.radii])
        margin = self.blend_m / 2 + 2 * np.asarray(self.cell_m)
        low, high = (ends - radii).min(axis=0) - margin, (ends + radii).max(axis=0) + margin
        axes = [
            start + step * np.arange(int(np.ceil((end - start) / step)) + 1)
            for start, end, step in zip(low, high, self.cell_m, strict=True)
        ]
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        values = self.compute_distance(grid.reshape(-1, 3)).reshape(grid.shape[:3])
        vertices, triangles = _extract_surface_net(values, low, np.asarray(self.cell_m))
        for _ in range(3):
            slope = self._compute_gradient(vertices)
            # Newton's step onto the surface; where chains blend, slopes near 0 would throw it off.
            steepness = np.maximum(np.sum(slope**2, axis=1), 0.2)
            vertices = vertices - (self.compute_distance(vertices) / steepness)[:, None] * slope
        slope = self._compute_gradient(vertices)
        normals = slope / np.linalg.norm(slope, axis=1, keepdims=True)
        return _fix_normals(TriangleSurface(vertices, triangles, normals))

    def compute_bone_weights(self, points: Float64Array, sides: Sequence[int]) -> Float64Array:
        """Compute the weights (n, bones) of bones in points (n, 3) by the distance of their cones.

        A bone on the left (`sides` 1) or right (-1) has no weight on the other side of the body,
        however near: thighs must not pull at each other.
        """
        weights = np.full((len(points), len(sides)), 1e-12)
        for chain in self.chains:
            for cone in chain:
                outside = np.maximum(cone.compute_distance(points), 0.0)
                near = np.exp(-((outside / _WEIGHT_FALLOFF_M) ** 2))
                weights[:, cone.bone] = np.maximum(weights[:, cone.bone], near)
        own_side = np.clip(0.5 + points[:, 1:2] * np.asarray(sides) / _SEAM_WIDTH_M, 0.0, 1.0)
        weights *= own_side**2 + 1e-9
        return weights / weights.sum(axis=1, keepdims=True)

    def _compute_gradient(self, points: Float64Array) -> Float64Array:
        differences = [
            self.compute_distance(points + step) - self.compute_distance(points - step)
            for step in _GRADIENT_STEP_M * np.eye(3)
        ]
        return np.stack(differences, axis=1) / (2 * _GRADIENT_STEP_M)


def _fix_normals(surface: TriangleSurface) -> TriangleSurface:
    """Drop slivers; corners whose normal points away from their face get the face's normal."""
    assert surface.normals is not None
    a, b, c = (surface.vertices[surface.triangles[:, corner]] for corner in range(3))
    across = np.cross(b - a, c - a)
    area = np.linalg.norm(across, axis=1)
    solid = area > 1e-9
    triangles, face = surface.triangles[solid], across[solid] / area[solid, None]
    away = np.einsum("nj,nkj->nk", face, surface.normals[triangles]) < 0.1
    row, corner = np.nonzero(away)
    vertices = np.concatenate([surface.vertices, surface.vertices[triangles[row, corner]]])
    triangles[row, corner] = len(surface.vertices) + np.arange(len(row))
    return TriangleSurface(vertices, triangles, np.concatenate([surface.normals, face[row]]))


def _compute_smooth_minimum(distances: Sequence[Float64Array], blend_m: float) -> Float64Array:
    """Compute the polynomial smooth minimum (Quilez) of distances (n,) each."""

    def blend(first: Float64Array, second: Float64Array) -> Float64Array:
        close = np.maximum(blend_m - np.abs(first - second), 0.0) / blend_m
        return np.minimum(first, second) - close**2 * blend_m / 4

    return reduce(blend, distances)


def _extract_surface_net(
    values: Float64Array, origin: ArrayLike, cell_m: Float64Array
) -> tuple[Float64Array, np.ndarray]:
    """Extract vertices (n, 3) and triangles (m, 3) where `values` (x, y, z) change sign."""
    shape = np.array(values.shape) - 1
    inside = values < 0
    total, count = np.zeros((*shape, 3)), np.zeros(shape)
    crossings: list[tuple[int, np.ndarray]] = []
    for axis in range(3):
        first = [slice(None)] * 3
        second = [slice(None)] * 3
        first[axis], second[axis] = slice(None, -1), slice(1, None)
        a, b = values[tuple(first)], values[tuple(second)]
        at = np.argwhere(inside[tuple(first)] != inside[tuple(second)])
        start, end = a[tuple(at.T)], b[tuple(at.T)]
        point = at.astype(np.float64)
        point[:, axis] += start / (start - end)
        for cell in _find_adjacent_cells(at, axis):
            np.add.at(total, tuple(cell.T), point)
            np.add.at(count, tuple(cell.T), 1)
        crossings.append((axis, at))
    # The vertex of a cell is the mean of the crossings on its edges.
    cells = np.argwhere(count > 0)
    vertices = total[tuple(cells.T)] / count[tuple(cells.T)][:, None]
    number = np.full(tuple(shape), -1)
    number[tuple(cells.T)] = np.arange(len(cells))
    quads: list[np.ndarray] = []
    for axis, at in crossings:
        rows = [number[tuple(cell.T)] for cell in _find_adjacent_cells(at, axis)]
        corners = np.stack(rows, axis=1)
        enters = inside[tuple(at.T)]
        corners[~enters] = corners[~enters][:, ::-1]
        quads.append(corners)
    quad = np.concatenate(quads)
    triangles = np.concatenate([quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]])
    return np.asarray(origin) + vertices * cell_m, triangles


def _find_adjacent_cells(edges: np.ndarray, axis: int) -> list[np.ndarray]:
    """Find the four cells around grid edges (n, 3) along an axis, counter-clockwise about it."""
    v, w = np.eye(3, dtype=int)[(axis + 1) % 3], np.eye(3, dtype=int)[(axis + 2) % 3]
    return [edges - v - w, edges - w, edges, edges - v]


class TrunkSection(NamedTuple):
    """An ellipse across the trunk; `up` and `forward` are from the pelvis."""

    up: float
    forward: float
    half_depth: float
    half_width: float


@dataclass(frozen=True, eq=False)
class Figure:
    """A person without clothes: a posture (joints, 3) in metres, and a build."""

    posture: Float64Array
    build: BodyBuild

    def build_soft_shape(
        self,
        chains: list[Chain],
        *,
        blend: float,
        cell: tuple[float, float, float],
        hems: tuple[float, ...] = (),
    ) -> SoftShape:
        """Make a soft shape; `blend` and `cell` are fractions of the height, `hems` metres."""
        h = self.build.height_m
        # Cells shrink less than the figure, or children would have the most triangles.
        scale = _CELL_SCALE * (0.5 + 0.5 * h / 1.75)
        x, y, z = (scale * edge for edge in cell)
        return SoftShape(tuple(chains), blend * h, (x, y, z), 0.012 * h, hems)

    def build_head_cover(self, *cones: RoundCone) -> SoftShape:
        """Make a soft shape of cones on the head: hair, a cap, a helmet."""
        unit = self.build.head_m
        return SoftShape((cones,), 0.01, (0.16 * unit, 0.16 * unit, 0.165 * unit), 0.02)

    def make_cone(
        self, start: Float64Array, end: Float64Array, thick: float, thin: float, bone: int
    ) -> RoundCone:
        """Make a cone between points (3,) in metres; radii are fractions of the height."""
        h = self.build.height_m
        return RoundCone(start, end, (thick * h, thin * h), bone)

    def make_limb_cone(
        self, start: Joint, end: Joint, left: int, thick: float, thin: float, bone: Bone
    ) -> RoundCone:
        """Make a cone between joints on the left (1) or right (-1)."""
        first, last = (self.posture[joint_on_side(joint, left)] for joint in (start, end))
        return self.make_cone(first, last, thick, thin, bone_on_side(bone, left))

    def interpolate_joints(
        self, start: Joint, end: Joint, left: int, fraction: float
    ) -> Float64Array:
        """Interpolate a point (3,) between joints on the left (1) or right (-1)."""
        first, last = (self.posture[joint_on_side(joint, left)] for joint in (start, end))
        return first + fraction * (last - first)

    def compute_up(self) -> Float64Array:
        """Compute the unit vector (3,) along the spine."""
        spine = self.posture[Joint.NECK] - self.posture[Joint.PELVIS]
        return spine / np.linalg.norm(spine)

    def compute_trunk_point(self, fore: float, left: float, high: float) -> Float64Array:
        """Compute a point (3,) in metres from fractions of the height forward, left and up."""
        up = self.compute_up()
        across = xyz(y=1.0)
        spine = np.linalg.norm(self.posture[Joint.NECK] - self.posture[Joint.PELVIS])
        scale = self.build.height_m
        offset = scale * (fore * np.cross(across, up) + left * across)
        # The spine of a standing figure is 0.27 heights long; a rider's may differ.
        return self.posture[Joint.PELVIS] + offset + high / 0.27 * spine * up

    def stack_trunk_sections(self, sections: tuple[TrunkSection, ...]) -> Chain:
        """Make the cones of the trunk from section to section."""
        stout = self.build.stoutness
        return tuple(
            RoundCone(
                self.compute_trunk_point(low.forward, 0, low.up),
                self.compute_trunk_point(high.forward, 0, high.up),
                (
                    low.half_depth * stout * self.build.height_m,
                    high.half_depth * stout * self.build.height_m,
                ),
                Bone.TRUNK,
                width_ratio=(low.half_width / low.half_depth + high.half_width / high.half_depth)
                / 2,
            )
            for low, high in pairwise(sections)
        )

    def make_trunk_cones(
        self, start: tuple[float, float, float], end: tuple[float, float, float], *radii: float
    ) -> Chain:
        """Make a cone between two trunk points (forward, left, up), and its mirror image."""
        scale = self.build.height_m
        stout = self.build.stoutness
        thick = (radii[0] * scale * stout, radii[1] * scale * stout)
        return tuple(
            RoundCone(
                self.compute_trunk_point(start[0], left * start[1], start[2]),
                self.compute_trunk_point(end[0], left * end[1], end[2]),
                thick,
                Bone.TRUNK,
            )
            for left in (1, -1)
        )

    def make_head_cone(
        self, start: tuple[float, float, float], end: tuple[float, float, float], *radii: float
    ) -> RoundCone:
        """Make a cone between points forward, left and up of the centre of the head."""
        unit = self.build.head_m
        middle = self.posture[Joint.HEAD]
        first, last = middle + unit * np.array(start), middle + unit * np.array(end)
        return RoundCone(first, last, (radii[0] * unit, radii[1] * unit), Bone.HEAD)
