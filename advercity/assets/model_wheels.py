"""Finds the wheels of foreign models by their tyres: rings on the ground."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from advercity.assets.model_files import ModelPart
from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import Wheel

WELD_M = 1e-3
"""Vertices closer than this are the same."""
DIAMETER_RANGE_M = (0.4, 1.3)
MAX_GROUND_GAP_M = 0.03
MAX_WIDTH_FRACTION, ROUND_TOLERANCE = 0.6, 0.25
"""Greatest width of a tyre in diameters, and difference between its height and its length."""
TWIN_TYRE_DISTANCE_M = 0.25
"""Tyres on one side with hubs closer than this along the body are twins, one wheel."""
RIM_OVERHANG_M = 0.06
"""Distance by which rims and hub caps may extend beyond a tyre."""
_SHARED_AXLE_DISTANCE_M = 0.3
"""Wheels closer than this along a body share an axle."""


@dataclass(frozen=True, eq=False)
class Tyre:
    """Position and size of a tyre.

    Attributes:
        hub: (3,) its centre.
        rolling_direction: (2,) unit vector, seen from above.
        radii: Half its length and half its height.
        half_width: Half its width, along the axle.
    """

    hub: Float64Array
    rolling_direction: Float64Array
    radii: tuple[float, float]
    half_width: float

    @staticmethod
    def from_points(points: Float64Array) -> "Tyre | None":
        """Fit a tyre to points (n, 3); None if they have not its shape."""
        low, high = points[:, 2].min(), points[:, 2].max()
        if low > MAX_GROUND_GAP_M or not DIAMETER_RANGE_M[0] < high - low < DIAMETER_RANGE_M[1]:
            return None
        # Seen from above, a tyre is longest along its rolling direction, also a steered one.
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
        """Transform points (n, 3) to its axes: rolling direction, axle, up; origin at the hub."""
        offset = points - self.hub
        x, y = self.rolling_direction
        return np.column_stack([offset[:, :2] @ (x, y), offset[:, :2] @ (-y, x), offset[:, 2]])

    def contains(self, points: Float64Array) -> bool:
        """Return whether points (n, 3) lie in its cylinder, and so turn with it."""
        along, lateral, up = self.to_tyre_frame(points).T
        radius = (along / self.radii[0]) ** 2 + (up / self.radii[1]) ** 2
        half_width = self.half_width + RIM_OVERHANG_M
        return bool((radius < 1.02).all() and (np.abs(lateral) < half_width).all())

    def straighten(self, points: Float64Array, x_m: float) -> Float64Array:
        """Move points (n, 3) with it to where it is round, on the ground, unsteered and at x."""
        radius = sum(self.radii) / 2
        stretch = np.array([radius / self.radii[0], 1.0, radius / self.radii[1]])
        return self.to_tyre_frame(points) * stretch + np.array([x_m, self.hub[1], radius])


def separate_wheels(parts: Iterable[ModelPart]) -> tuple[list[ModelPart], list[list[ModelPart]]]:
    """Separate a model, in the body frame, into its body and its wheels, unsteered."""
    pieces = [piece for part in parts for piece in _split_connected(part)]
    fits = [Tyre.from_points(get_used_vertices(piece)) for piece in pieces]
    groups = _group_twin_tyres([tyre for tyre in fits if tyre is not None])
    largest = [max(group, key=lambda tyre: tyre.radii) for group in groups]
    wheels: list[list[ModelPart]] = [[] for _ in groups]
    rest: list[ModelPart] = []
    for piece in pieces:
        points = get_used_vertices(piece)
        number = next(
            (n for n, group in enumerate(groups) if any(t.contains(points) for t in group)), -1
        )
        if number < 0:
            rest.append(piece)
        else:
            tyre = largest[number]
            vertices = tyre.straighten(piece.vertices, _compute_axle_x_m(tyre, largest))
            wheels[number].append(replace(piece, vertices=vertices))
    return rest, wheels


def _compute_axle_x_m(tyre: Tyre, tyres: Sequence[Tyre]) -> float:
    """Average the hubs of an axle: steering moves the front wheels of a model apart."""
    near = [t.hub[0] for t in tyres if abs(t.hub[0] - tyre.hub[0]) < TWIN_TYRE_DISTANCE_M]
    return float(np.mean(near))


def get_used_vertices(part: ModelPart) -> Float64Array:
    """Return the vertices (n, 3) used by triangles of a part; parts may share one array."""
    return part.vertices[np.unique(part.triangles)]


def _split_connected(part: ModelPart) -> list[ModelPart]:
    corners = part.vertices[part.triangles].reshape(-1, 3)
    grid = np.round(corners / WELD_M).astype(np.int64)
    _, index = np.unique(grid, axis=0, return_inverse=True)
    labels = _label_components(index.reshape(-1, 3))
    order = np.argsort(labels, kind="stable")
    bounds = np.flatnonzero(np.diff(labels[order])) + 1
    return [
        replace(
            part,
            triangles=part.triangles[rows],
            uv=None if part.uv is None else part.uv[rows],
        )
        for rows in np.split(order, bounds)
    ]


def _label_components(triangles: NDArray[np.int64]) -> NDArray[np.int64]:
    """Label triangles (m, 3) by the lowest vertex (m,) connected with each."""
    # Labels spread in a few rounds over whole arrays; trimesh's own search needs scipy or loops.
    label = np.arange(int(triangles.max(initial=-1)) + 1)
    while True:
        before = label.copy()
        lowest = label[triangles].min(axis=1)
        for corner in range(3):
            np.minimum.at(label, triangles[:, corner], lowest)
        label = label[label]
        if np.array_equal(label, before):
            return label[triangles[:, 0]]


def _group_twin_tyres(tyres: Sequence[Tyre]) -> list[list[Tyre]]:
    """Group tyres lying side by side, from front to rear."""
    groups: list[list[Tyre]] = []
    for tyre in sorted(tyres, key=lambda tyre: -tyre.hub[0]):
        for group in groups:
            is_close = abs(group[0].hub[0] - tyre.hub[0]) < TWIN_TYRE_DISTANCE_M
            if is_close and group[0].hub[1] * tyre.hub[1] > 0.0:
                group.append(tyre)
                break
        else:
            groups.append([tyre])
    return groups


def find_model_wheels(parts: Sequence[ModelPart], *, has_steering: bool) -> dict[int, Wheel]:
    """Find the wheels of a converted model by number; front ones may steer, others share axles."""
    hubs: dict[int, Float64Array] = {}
    for number in sorted({part.wheel for part in parts} - {0}):
        points = np.concatenate([get_used_vertices(p) for p in parts if p.wheel == number])
        hubs[number] = (points.min(axis=0) + points.max(axis=0)) / 2
    foremost = max((hub[0] for hub in hubs.values()), default=0.0)
    wheels: dict[int, Wheel] = {}
    for number, (x, y, z) in hubs.items():
        if has_steering and x > foremost - _SHARED_AXLE_DISTANCE_M:
            wheels[number] = Wheel((float(x), float(y), float(z)), is_steered=True)
        else:
            same_axle = (
                wheel
                for wheel in wheels.values()
                if abs(wheel.hub[0] - x) < _SHARED_AXLE_DISTANCE_M
            )
            wheels[number] = next(same_axle, Wheel((float(x), 0.0, float(z))))
    return wheels
