"""The wheels of foreign models, found by their tyres: rings that stand on the ground."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from advercity.assets.model_files import ModelPart
from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import Wheel

WELD_M = 1e-3
"""Vertices nearer than this are one."""
DIAMETER_RANGE_M = (0.4, 1.3)
MAX_GROUND_GAP_M = 0.03
MAX_WIDTH_FRACTION, ROUND_TOLERANCE = 0.6, 0.25
"""Width of a tyre in diameters, at most; by how much its height may differ from its length."""
TWIN_TYRE_DISTANCE_M = 0.25
"""Tyres on one side whose hubs are this near along the body are one wheel."""
RIM_OVERHANG_M = 0.06
"""How far rims and hub caps stand out of a tyre."""


@dataclass(frozen=True, eq=False)
class Tyre:
    """A tyre.

    Attributes:
        hub: (3,) its middle.
        rolling_direction: (2,) unit, where it rolls, seen from above.
        radii: Half its length and half its height.
        half_width: Along its axle.
    """

    hub: Float64Array
    rolling_direction: Float64Array
    radii: tuple[float, float]
    half_width: float

    @staticmethod
    def from_points(points: Float64Array) -> "Tyre | None":
        """The tyre that some points (n, 3) are, or None if they are something else."""
        low, high = points[:, 2].min(), points[:, 2].max()
        if low > MAX_GROUND_GAP_M or not DIAMETER_RANGE_M[0] < high - low < DIAMETER_RANGE_M[1]:
            return None
        _, axes = np.linalg.eigh(np.cov(points[:, :2].T))
        along = axes[:, 1] * (1.0 if axes[0, 1] > 0 else -1.0)
        across = np.array([-along[1], along[0]])
        flat = points[:, :2] @ np.column_stack([along, across])
        (length, width), middle = np.ptp(flat, axis=0), (flat.min(axis=0) + flat.max(axis=0)) / 2
        hub = np.append(middle @ np.stack([along, across]), (low + high) / 2)
        height = high - low
        if width > MAX_WIDTH_FRACTION * height or abs(length / height - 1.0) > ROUND_TOLERANCE:
            return None
        return Tyre(hub, along, (length / 2, height / 2), width / 2)

    def to_tyre_frame(self, points: Float64Array) -> Float64Array:
        """Points (n, 3) from its hub: along the way it rolls, along its axle, up."""
        away = points - self.hub
        x, y = self.rolling_direction
        return np.column_stack([away[:, :2] @ (x, y), away[:, :2] @ (-y, x), away[:, 2]])

    def contains(self, points: Float64Array) -> bool:
        """Whether points (n, 3) turn with it."""
        along, aside, up = self.to_tyre_frame(points).T
        far = (along / self.radii[0]) ** 2 + (up / self.radii[1]) ** 2
        return bool((far < 1.02).all() and (np.abs(aside) < self.half_width + RIM_OVERHANG_M).all())

    def straighten(self, points: Float64Array, x_m: float) -> Float64Array:
        """Points (n, 3) of it once it is round, on the ground and straight ahead, its hub at x."""
        radius = sum(self.radii) / 2
        stretch = np.array([radius / self.radii[0], 1.0, radius / self.radii[1]])
        return self.to_tyre_frame(points) * stretch + np.array([x_m, self.hub[1], radius])


def separate_wheels(parts: Iterable[ModelPart]) -> tuple[list[ModelPart], list[list[ModelPart]]]:
    """What does not turn of a model, and each of its wheels, straight ahead.

    Args:
        parts: In our frame, metres, on the ground.
    """
    pieces = [piece for part in parts for piece in _split_connected(part)]
    rings = [
        ring for ring in map(Tyre.from_points, map(_get_used_vertices, pieces)) if ring is not None
    ]
    groups = _group_twin_tyres(rings)
    tyres = [max(group, key=lambda ring: ring.radii) for group in groups]
    wheels: list[list[ModelPart]] = [[] for _ in groups]
    rest: list[ModelPart] = []
    for piece in pieces:
        points = _get_used_vertices(piece)
        number = next(
            (n for n, own in enumerate(groups) if any(r.contains(points) for r in own)), -1
        )
        if number < 0:
            rest.append(piece)
        else:
            straight = tyres[number].straighten(
                piece.vertices, _compute_axle_x_m(tyres[number], tyres)
            )
            wheels[number].append(replace(piece, vertices=straight))
    return rest, wheels


def _compute_axle_x_m(tyre: Tyre, tyres: Sequence[Tyre]) -> float:
    """Where the axle of a tyre is; one that is turned may stand beside it."""
    return float(
        np.mean([t.hub[0] for t in tyres if abs(t.hub[0] - tyre.hub[0]) < TWIN_TYRE_DISTANCE_M])
    )


def _get_used_vertices(part: ModelPart) -> Float64Array:
    return part.vertices[np.unique(part.triangles)]


def _split_connected(part: ModelPart) -> list[ModelPart]:
    """The pieces of a part that hang together."""
    corners = part.vertices[part.triangles].reshape(-1, 3)
    grid = np.round(corners / WELD_M).astype(np.int64)
    _, index = np.unique(grid, axis=0, return_inverse=True)
    point = index.reshape(-1, 3)
    own = _label_components(point)
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


def _label_components(triangles: NDArray[np.int64]) -> NDArray[np.int64]:
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


def _group_twin_tyres(rings: Sequence[Tyre]) -> list[list[Tyre]]:
    """Rings side by side, from the front to the rear."""
    groups: list[list[Tyre]] = []
    for ring in sorted(rings, key=lambda ring: -ring.hub[0]):
        for group in groups:
            near = abs(group[0].hub[0] - ring.hub[0]) < TWIN_TYRE_DISTANCE_M
            if near and group[0].hub[1] * ring.hub[1] > 0.0:
                group.append(ring)
                break
        else:
            groups.append([ring])
    return groups


_SHARED_AXLE_DISTANCE_M = 0.3
"""Wheels that are this near along a body share an axle."""


def find_model_wheels(parts: Sequence[ModelPart], *, has_steering: bool) -> dict[int, Wheel]:
    """The wheels of a model by their numbers: those in front may steer, others share axles."""
    hubs: dict[int, Float64Array] = {}
    for number in sorted({part.wheel for part in parts} - {0}):
        own = [part.vertices[np.unique(part.triangles)] for part in parts if part.wheel == number]
        points = np.concatenate(own)
        hubs[number] = (points.min(axis=0) + points.max(axis=0)) / 2
    foremost = max((hub[0] for hub in hubs.values()), default=0.0)
    wheels: dict[int, Wheel] = {}
    for number, (x, y, z) in hubs.items():
        if has_steering and x > foremost - _SHARED_AXLE_DISTANCE_M:
            wheels[number] = Wheel((float(x), float(y), float(z)), is_steered=True)
        else:
            near = (
                other
                for other in wheels.values()
                if abs(other.hub[0] - x) < _SHARED_AXLE_DISTANCE_M
            )
            wheels[number] = next(near, Wheel((float(x), 0.0, float(z))))
    return wheels
