"""Soft shapes: round cones that run into each other, and the skin around them.

What is inside has a negative distance. Skins are found by surface nets (Gibson 1998): a vertex in
every cell of a grid that the surface passes through, then moved onto the surface.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np
from numpy.typing import ArrayLike

from advercity.world.shapes import Floats, Surface

_STEP_M = 1e-4
_SKIN_M = 0.022
"""How fast a vertex forgets a bone whose flesh is farther away."""
_SEAM_M = 0.03
"""Width of the strip in the middle that bones of both sides share."""


@dataclass(frozen=True, eq=False)
class Cone:
    """A ball that moves along a line while it swells or shrinks.

    Attributes:
        start: (3,) where the ball starts.
        end: (3,) where it ends.
        radii: Of the ball at both, metres.
        bone: Index of the bone that it moves with.
    """

    start: Floats
    end: Floats
    radii: tuple[float, float]
    bone: int
    wide: float = 1.0
    """How much wider (along y) than deep the ball is."""

    def distance(self, points: Floats) -> Floats:
        """Distance (n,) of points (n, 3), metres; right on the surface and close to it nearby."""
        line = self.end - self.start
        share = (points - self.start) @ line / max(float(line @ line), 1e-12)
        share = np.clip(share, 0.0, 1.0)
        radius = self.radii[0] + share * (self.radii[1] - self.radii[0])
        away = points - self.start - share[:, None] * line
        away[:, 1] /= self.wide
        return np.linalg.norm(away, axis=1) - radius


@dataclass(frozen=True, eq=False)
class Flesh:
    """Chains of cones that run into each other.

    Attributes:
        chains: Cones of a limb or of the trunk; along a chain the skin hardly bulges.
        blend_m: How far apart chains begin to run together.
        cell_m: Size (x, y, z) of the cells of the skin.
        smooth_m: As `blend_m`, within a chain.
        hems: Height under which each chain is cut off, where some are.
    """

    chains: tuple[tuple[Cone, ...], ...]
    blend_m: float
    cell_m: tuple[float, float, float]
    smooth_m: float
    hems: tuple[float, ...] = ()

    def distance(self, points: Floats) -> Floats:
        """Distance (n,) of points (n, 3), metres."""
        limbs = [
            np.maximum(
                _union([cone.distance(points) for cone in chain], self.smooth_m), hem - points[:, 2]
            )
            for chain, hem in zip(self.chains, self.hems or self._uncut, strict=True)
        ]
        return _union(limbs, self.blend_m)

    @property
    def _uncut(self) -> tuple[float, ...]:
        return (-np.inf,) * len(self.chains)

    def skin(self) -> Surface:
        """The closed surface, with normals."""
        cones = [cone for chain in self.chains for cone in chain]
        ends = np.array([end for cone in cones for end in (cone.start, cone.end)])
        radii = np.array([(r, r * cone.wide, r) for cone in cones for r in cone.radii])
        margin = self.blend_m / 2 + 2 * np.asarray(self.cell_m)
        low, high = (ends - radii).min(axis=0) - margin, (ends + radii).max(axis=0) + margin
        axes = [
            start + step * np.arange(int(np.ceil((end - start) / step)) + 1)
            for start, end, step in zip(low, high, self.cell_m, strict=True)
        ]
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        values = self.distance(grid.reshape(-1, 3)).reshape(grid.shape[:3])
        vertices, triangles = _net(values, low, np.asarray(self.cell_m))
        for _ in range(3):
            slope = self._slope(vertices)
            steepness = np.maximum(np.sum(slope**2, axis=1), 0.2)
            vertices = vertices - (self.distance(vertices) / steepness)[:, None] * slope
        slope = self._slope(vertices)
        normals = slope / np.linalg.norm(slope, axis=1, keepdims=True)
        return _facing(Surface(vertices, triangles, normals))

    def weights(self, points: Floats, sides: Sequence[int]) -> Floats:
        """Shares (n, bones) that bones have in points (n, 3) of the skin: whose flesh is near.

        Args:
            points: On the skin.
            sides: Of each bone: 1 on the left, -1 on the right, 0 in the middle. A bone has no
                share in the other side of the body.
        """
        weights = np.full((len(points), len(sides)), 1e-12)
        for chain in self.chains:
            for cone in chain:
                near = np.exp(-((np.maximum(cone.distance(points), 0.0) / _SKIN_M) ** 2))
                weights[:, cone.bone] = np.maximum(weights[:, cone.bone], near)
        weights *= np.clip(0.5 + points[:, 1:2] * np.asarray(sides) / _SEAM_M, 0.0, 1.0) ** 2 + 1e-9
        return weights / weights.sum(axis=1, keepdims=True)

    def _slope(self, points: Floats) -> Floats:
        steps = _STEP_M * np.eye(3)
        return np.stack(
            [
                (self.distance(points + step) - self.distance(points - step)) / (2 * _STEP_M)
                for step in steps
            ],
            axis=1,
        )


def _facing(surface: Surface) -> Surface:
    """The surface without slivers; corners whose normal looks away get that of their face."""
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
    return Surface(vertices, triangles, np.concatenate([surface.normals, face[row]]))


def _union(distances: Sequence[Floats], blend_m: float) -> Floats:
    """The smooth minimum (Quilez' polynomial) of distances (n,) each."""

    def joined(first: Floats, second: Floats) -> Floats:
        close = np.maximum(blend_m - np.abs(first - second), 0.0) / blend_m
        return np.minimum(first, second) - close**2 * blend_m / 4

    return reduce(joined, distances)


def _net(values: Floats, origin: ArrayLike, cell_m: Floats) -> tuple[Floats, np.ndarray]:
    """Vertices (n, 3) and triangles (m, 3) of the surface where `values` (x, y, z) change sign."""
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
        for cell in _around(at, axis):
            np.add.at(total, tuple(cell.T), point)
            np.add.at(count, tuple(cell.T), 1)
        crossings.append((axis, at))
    cells = np.argwhere(count > 0)
    vertices = total[tuple(cells.T)] / count[tuple(cells.T)][:, None]
    number = np.full(tuple(shape), -1)
    number[tuple(cells.T)] = np.arange(len(cells))
    quads: list[np.ndarray] = []
    for axis, at in crossings:
        corners = np.stack([number[tuple(cell.T)] for cell in _around(at, axis)], axis=1)
        enters = inside[tuple(at.T)]
        corners[~enters] = corners[~enters][:, ::-1]
        quads.append(corners)
    quad = np.concatenate(quads)
    triangles = np.concatenate([quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]])
    return np.asarray(origin) + vertices * cell_m, triangles


def _around(edges: np.ndarray, axis: int) -> list[np.ndarray]:
    """The four cells around grid edges (n, 3) along an axis, counter-clockwise about it."""
    v, w = np.eye(3, dtype=int)[(axis + 1) % 3], np.eye(3, dtype=int)[(axis + 2) % 3]
    return [edges - v - w, edges - w, edges, edges - v]
