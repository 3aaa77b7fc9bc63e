"""The wheels of foreign models, found by their tyres: rings that stand on the ground."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from advercity.world.assets.wavefront import Part

Floats = NDArray[np.float64]

WELD_M = 1e-3
"""Vertices nearer than this are one."""
DIAMETER_M = (0.4, 1.3)
OFF_GROUND_M = 0.03
FLAT_SHARE, ROUND_TOLERANCE = 0.6, 0.25
"""Width of a tyre in diameters, at most; by how much its height may differ from its length."""
TWIN_M = 0.25
"""Tyres on one side whose hubs are this near along the body are one wheel."""
BESIDE_M = 0.06
"""How far rims and hub caps stand out of a tyre."""


@dataclass(frozen=True, eq=False)
class Ring:
    """A tyre.

    Attributes:
        hub: (3,) its middle.
        along: (2,) unit, where it rolls, seen from above.
        radii: Half its length and half its height.
        half_width: Along its axle.
    """

    hub: Floats
    along: Floats
    radii: tuple[float, float]
    half_width: float

    @staticmethod
    def of(points: Floats) -> "Ring | None":
        """The tyre that some points (n, 3) are, or None if they are something else."""
        low, high = points[:, 2].min(), points[:, 2].max()
        if low > OFF_GROUND_M or not DIAMETER_M[0] < high - low < DIAMETER_M[1]:
            return None
        _, axes = np.linalg.eigh(np.cov(points[:, :2].T))
        along = axes[:, 1] * (1.0 if axes[0, 1] > 0 else -1.0)
        across = np.array([-along[1], along[0]])
        flat = points[:, :2] @ np.column_stack([along, across])
        (length, width), middle = np.ptp(flat, axis=0), (flat.min(axis=0) + flat.max(axis=0)) / 2
        hub = np.append(middle @ np.stack([along, across]), (low + high) / 2)
        height = high - low
        if width > FLAT_SHARE * height or abs(length / height - 1.0) > ROUND_TOLERANCE:
            return None
        return Ring(hub, along, (length / 2, height / 2), width / 2)

    def seen_from(self, points: Floats) -> Floats:
        """Points (n, 3) from its hub: along the way it rolls, along its axle, up."""
        away = points - self.hub
        x, y = self.along
        return np.column_stack([away[:, :2] @ (x, y), away[:, :2] @ (-y, x), away[:, 2]])

    def holds(self, points: Floats) -> bool:
        """Whether points (n, 3) turn with it."""
        along, aside, up = self.seen_from(points).T
        far = (along / self.radii[0]) ** 2 + (up / self.radii[1]) ** 2
        return bool((far < 1.02).all() and (np.abs(aside) < self.half_width + BESIDE_M).all())

    def straightened(self, points: Floats, x_m: float) -> Floats:
        """Points (n, 3) of it once it is round, on the ground and straight ahead, its hub at x."""
        radius = sum(self.radii) / 2
        stretch = np.array([radius / self.radii[0], 1.0, radius / self.radii[1]])
        return self.seen_from(points) * stretch + np.array([x_m, self.hub[1], radius])


def wheels_apart(parts: Iterable[Part]) -> tuple[list[Part], list[list[Part]]]:
    """What does not turn of a model, and each of its wheels, straight ahead.

    Args:
        parts: In our frame, metres, on the ground.
    """
    pieces = [piece for part in parts for piece in _connected(part)]
    rings = [ring for ring in map(Ring.of, map(_points, pieces)) if ring is not None]
    groups = _twins(rings)
    tyres = [max(group, key=lambda ring: ring.radii) for group in groups]
    wheels: list[list[Part]] = [[] for _ in groups]
    rest: list[Part] = []
    for piece in pieces:
        points = _points(piece)
        number = next((n for n, own in enumerate(groups) if any(r.holds(points) for r in own)), -1)
        if number < 0:
            rest.append(piece)
        else:
            straight = tyres[number].straightened(piece.vertices, _axle_m(tyres[number], tyres))
            wheels[number].append(replace(piece, vertices=straight))
    return rest, wheels


def _axle_m(tyre: Ring, tyres: Sequence[Ring]) -> float:
    """Where the axle of a tyre is; one that is turned may stand beside it."""
    return float(np.mean([t.hub[0] for t in tyres if abs(t.hub[0] - tyre.hub[0]) < TWIN_M]))


def _points(part: Part) -> Floats:
    return part.vertices[np.unique(part.triangles)]


def _connected(part: Part) -> list[Part]:
    """The pieces of a part that hang together."""
    corners = part.vertices[part.triangles].reshape(-1, 3)
    grid = np.round(corners / WELD_M).astype(np.int64)
    _, index = np.unique(grid, axis=0, return_inverse=True)
    point = index.reshape(-1, 3)
    own = _lowest_linked(point)
    order = np.argsort(own, kind="stable")
    bounds = np.flatnonzero(np.diff(own[order])) + 1
    return [
        replace(
            part,
            triangles=part.triangles[rows],
            colours=None if part.colours is None else part.colours[rows],
        )
        for rows in np.split(order, bounds)
    ]


def _lowest_linked(triangles: NDArray[np.int64]) -> NDArray[np.int64]:
    """The lowest vertex (m,) that each triangle hangs together with."""
    label = np.arange(int(triangles.max(initial=-1)) + 1)
    while True:
        before = label.copy()
        lowest = label[triangles].min(axis=1)
        for corner in range(3):
            np.minimum.at(label, triangles[:, corner], lowest)
        label = label[label]
        if np.array_equal(label, before):
            return label[triangles[:, 0]]


def _twins(rings: Sequence[Ring]) -> list[list[Ring]]:
    """Rings side by side, from the front to the rear."""
    groups: list[list[Ring]] = []
    for ring in sorted(rings, key=lambda ring: -ring.hub[0]):
        for group in groups:
            near = abs(group[0].hub[0] - ring.hub[0]) < TWIN_M
            if near and group[0].hub[1] * ring.hub[1] > 0.0:
                group.append(ring)
                break
        else:
            groups.append([ring])
    return groups
