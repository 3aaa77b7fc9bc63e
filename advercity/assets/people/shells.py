"""Works on weighted surfaces: clips them, moves them off the body, smooths, hems, simplifies.

All functions keep the bones' weights on the vertices.
"""

from dataclasses import dataclass, replace
from typing import cast

import fast_simplification
import numpy as np
from numpy.typing import NDArray

from advercity.geometry.arrays import Float64Array

SNAP_DECIMALS = 6
"""Decimals of metres of vertices before simplification, which amplifies rounding errors."""


@dataclass(frozen=True, eq=False)
class Shell:
    """A surface with weights.

    Attributes:
        vertices: (n, 3) metres.
        triangles: (m, 3) into `vertices`.
        weights: (n, bones).
    """

    vertices: Float64Array
    triangles: NDArray[np.int64]
    weights: Float64Array

    def compact(self) -> "Shell":
        """Drop the unused vertices."""
        used, index = np.unique(self.triangles, return_inverse=True)
        return Shell(self.vertices[used], index.reshape(-1, 3), self.weights[used])

    def compute_normals(self) -> Float64Array:
        """Compute unit normals (n, 3), weighted by the areas of the triangles around."""
        a, b, c = (self.vertices[self.triangles[:, corner]] for corner in range(3))
        total = self._sum_over_corners(np.repeat(np.cross(b - a, c - a)[:, None], 3, axis=1))
        total[np.abs(total).max(axis=1) < 1e-12] = (0.0, 0.0, 1.0)  # of no area around
        return total / np.sqrt((total**2).sum(axis=1, keepdims=True))

    def _sum_over_corners(self, values: Float64Array) -> Float64Array:
        """Sum values (m, 3, 3) of the corners of triangles at their vertices (n, 3)."""
        rows, count = self.triangles.reshape(-1), len(self.vertices)
        columns = values.reshape(-1, 3).T
        sums = [np.bincount(rows, column, count) for column in columns]
        return np.stack(sums, axis=1).astype(np.float64)


def clip_shell(shell: Shell, field: Float64Array) -> Shell:
    """Keep the part with a positive `field` (n,), cut exactly along its zero."""
    inside = field > 0.0
    corners = inside[shell.triangles]
    count = corners.sum(axis=1)
    pieces = [shell.triangles[count == 3]]
    vertices, weights, size = [shell.vertices], [shell.weights], len(shell.vertices)
    for wanted in (1, 2):
        rows = shell.triangles[count == wanted]
        lone = (corners[count == wanted] == (wanted == 1)).argmax(axis=1)
        first, second, third = (rows[np.arange(len(rows)), (lone + k) % 3] for k in range(3))
        cuts = []
        for other in (second, third):
            part = (field[first] / (field[first] - field[other]))[:, None]
            cuts.append(size + np.arange(len(rows)))
            vertices.append(shell.vertices[first] + part * _rows(shell.vertices, other, first))
            weights.append(shell.weights[first] + part * _rows(shell.weights, other, first))
            size += len(rows)
        if wanted == 1:
            pieces.append(np.stack([first, *cuts], axis=1))
        else:
            pieces.append(np.stack([second, third, cuts[1]], axis=1))
            pieces.append(np.stack([second, cuts[1], cuts[0]], axis=1))
    whole = Shell(np.concatenate(vertices), np.concatenate(pieces), np.concatenate(weights))
    return weld_shell(whole)


def _rows(values: Float64Array, end: NDArray[np.int64], start: NDArray[np.int64]) -> Float64Array:
    return values[end] - values[start]


def weld_shell(shell: Shell) -> Shell:
    """Merge equal vertices, and drop triangles without area."""
    keys = np.round(shell.vertices, SNAP_DECIMALS)
    _, first, index = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    triangles = index.reshape(-1)[shell.triangles]
    a, b, c = triangles.T
    solid = (a != b) & (b != c) & (c != a)
    return Shell(shell.vertices[first], triangles[solid], shell.weights[first]).compact()


def smooth_shell(shell: Shell, rounds: int) -> Shell:
    """Move vertices to the mean of their neighbours, except on open edges."""
    free = np.ones(len(shell.vertices))
    free[np.unique(find_open_edges(shell))] = 0.0
    ends = shell.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    starts, stops = np.concatenate([ends, ends[:, ::-1]]).T
    count = np.maximum(np.bincount(starts, minlength=len(shell.vertices)), 1)[:, None]
    vertices = shell.vertices
    for _ in range(rounds):
        sums = [np.bincount(starts, vertices[stops, axis], len(vertices)) for axis in range(3)]
        vertices = vertices + free[:, None] * (np.stack(sums, axis=1) / count - vertices)
    return replace(shell, vertices=vertices)


def drape_shell(shell: Shell, ease_m: Float64Array, rounds: int) -> Shell:
    """Move a surface outwards by `ease_m` (n,) or more, without the folds of the body below."""
    normals = shell.compute_normals()
    # Open edges are not smoothed: with all of the ease they would stick out.
    first = ease_m.copy()
    first[np.unique(find_open_edges(shell))] *= 0.8
    loose = replace(shell, vertices=shell.vertices + first[:, None] * normals)
    loose = smooth_shell(loose, rounds)
    off = ((loose.vertices - shell.vertices) * normals).sum(axis=1)
    push = np.maximum(0.7 * ease_m - off, 0.0)
    return replace(loose, vertices=loose.vertices + push[:, None] * normals)


def find_open_edges(shell: Shell) -> NDArray[np.int64]:
    """Find the edges (k, 2) of only one triangle, in its order."""
    edges = shell.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    low, high = np.sort(edges, axis=1).T
    _, index, count = np.unique(
        low * len(shell.vertices) + high, return_inverse=True, return_counts=True
    )
    return edges[count[index.reshape(-1)] == 1]


def add_hems(shell: Shell, width_m: float) -> Shell:
    """Fold the open edges inwards by `width_m`, so no garment is seen from inside."""
    edges = find_open_edges(shell)
    rim, index = np.unique(edges, return_inverse=True)
    inner = len(shell.vertices) + index.reshape(-1, 2)
    folded = shell.vertices[rim] - width_m * shell.compute_normals()[rim]
    (a, b), (c, d) = edges.T, inner.T
    return Shell(
        np.concatenate([shell.vertices, folded]),
        np.concatenate([shell.triangles, np.stack([b, a, c], 1), np.stack([b, c, d], 1)]),
        np.concatenate([shell.weights, shell.weights[rim]]),
    )


def simplify_shell(shell: Shell, count: int) -> Shell:
    """Simplify to about `count` triangles; merged vertices have the mean of their weights."""
    rounded = replace(shell, vertices=np.round(shell.vertices, SNAP_DECIMALS))
    if len(shell.triangles) <= count:
        return rounded
    points, triangles, collapses = cast(
        tuple[NDArray[np.float64], NDArray[np.int32], NDArray[np.int32]],
        fast_simplification.simplify(
            rounded.vertices,
            rounded.triangles.astype(np.int32),
            target_count=count,
            agg=5,
            return_collapses=True,
        ),
    )
    _, _, merged = fast_simplification.replay_simplification(
        rounded.vertices, rounded.triangles.astype(np.int32), collapses
    )
    into = np.asarray(merged).reshape(-1)
    kept = into >= 0  # the others were on removed triangles
    count_into = np.maximum(np.bincount(into[kept], minlength=len(points)), 1)[:, None]
    sums = [np.bincount(into[kept], column[kept], len(points)) for column in shell.weights.T]
    weights = np.stack(sums, axis=1) / count_into
    simple = Shell(np.round(points, SNAP_DECIMALS), triangles.astype(np.int64), weights)
    return simple.compact()


def join_shells(*shells: Shell) -> Shell:
    """Join surfaces."""
    starts = np.cumsum([0, *(len(shell.vertices) for shell in shells)])
    pairs = zip(shells, starts, strict=False)
    return Shell(
        np.concatenate([shell.vertices for shell in shells]),
        np.concatenate([shell.triangles + start for shell, start in pairs]),
        np.concatenate([shell.weights for shell in shells]),
    )
