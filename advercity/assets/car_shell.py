"""Proportions of kinds of cars, and the lofted lower body of one.

A station is the distance from the nose as a fraction of the length; heights are fractions of the
height unless their names end in `_m`.
"""

from dataclasses import dataclass

import numpy as np

from advercity.assets.vehicle_parts import make_vehicle_parts
from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import MeshPart, TriangleSurface, split_surface
from advercity.geometry.primitives import loft_rings
from advercity.materials import ACTOR_PAINT


@dataclass(frozen=True)
class CarProportions:
    """Side view of a kind of car; numbers are stations or fractions of the height or width."""

    deck_stations: tuple[float, ...]
    deck_heights: tuple[float, ...]
    """Heights of bonnet, belt line and boot at these stations."""
    axles: tuple[float, float]
    wheel_m: float
    clearance_m: float
    cabin: tuple[float, float, float, float]
    """Stations of foot and top of the windscreen, then of top and foot of the rear window."""
    pillar: float
    """Station of the B-pillar, between the doors."""
    roof_width: float
    """Width of the roof as a fraction of the greatest width."""
    side_window_count: int = 2
    """Side windows from the front; a panel van has one."""
    has_roof_rails: bool = False


_SALOON_PROPORTIONS = CarProportions(
    deck_stations=(0, 0.012, 0.05, 0.14, 0.27, 0.6, 0.84, 0.95, 0.985, 1),
    deck_heights=(0.40, 0.46, 0.52, 0.575, 0.63, 0.645, 0.665, 0.665, 0.62, 0.56),
    axles=(0.195, 0.775),
    wheel_m=0.33,
    clearance_m=0.17,
    cabin=(0.255, 0.42, 0.70, 0.875),
    pillar=0.53,
    roof_width=0.76,
)
_HATCHBACK_PROPORTIONS = CarProportions(
    deck_stations=(0, 0.015, 0.06, 0.16, 0.25, 0.6, 0.93, 0.985, 1),
    deck_heights=(0.38, 0.45, 0.53, 0.60, 0.635, 0.655, 0.675, 0.63, 0.50),
    axles=(0.19, 0.82),
    wheel_m=0.31,
    clearance_m=0.17,
    cabin=(0.215, 0.41, 0.87, 0.965),
    pillar=0.56,
    roof_width=0.79,
)
_SUV_PROPORTIONS = CarProportions(
    deck_stations=(0, 0.012, 0.05, 0.15, 0.26, 0.6, 0.95, 0.985, 1),
    deck_heights=(0.42, 0.50, 0.56, 0.585, 0.61, 0.62, 0.63, 0.60, 0.48),
    axles=(0.185, 0.79),
    wheel_m=0.37,
    clearance_m=0.23,
    cabin=(0.25, 0.36, 0.91, 0.975),
    pillar=0.52,
    roof_width=0.83,
    has_roof_rails=True,
)
_SPORTS_PROPORTIONS = CarProportions(
    deck_stations=(0, 0.015, 0.06, 0.16, 0.33, 0.62, 0.84, 0.955, 0.988, 1),
    deck_heights=(0.40, 0.47, 0.54, 0.60, 0.665, 0.68, 0.71, 0.69, 0.63, 0.54),
    axles=(0.19, 0.785),
    wheel_m=0.335,
    clearance_m=0.13,
    cabin=(0.32, 0.47, 0.66, 0.88),
    pillar=0.585,
    roof_width=0.73,
)
MINIBUS_PROPORTIONS = CarProportions(
    deck_stations=(0, 0.012, 0.035, 0.2, 0.96, 1),
    deck_heights=(0.38, 0.46, 0.52, 0.535, 0.535, 0.46),
    axles=(0.20, 0.76),
    wheel_m=0.32,
    clearance_m=0.2,
    cabin=(0.035, 0.12, 0.945, 0.98),
    pillar=0.34,
    roof_width=0.86,
)
PANEL_VAN_PROPORTIONS = CarProportions(
    deck_stations=(0, 0.012, 0.05, 0.13, 0.18, 0.97, 1),
    deck_heights=(0.27, 0.32, 0.375, 0.43, 0.45, 0.46, 0.40),
    axles=(0.165, 0.79),
    wheel_m=0.34,
    clearance_m=0.2,
    cabin=(0.135, 0.255, 0.965, 0.985),
    pillar=0.36,
    roof_width=0.87,
    side_window_count=1,
)


def choose_car_proportions(length_m: float, height_m: float) -> CarProportions:
    """Choose the kind of car that a box of this length and height holds."""
    slenderness = height_m / length_m
    if height_m >= 1.64 and slenderness >= 0.335:
        return _SUV_PROPORTIONS
    if length_m < 4.0 or slenderness >= 0.35:
        return _HATCHBACK_PROPORTIONS
    if height_m < 1.42 and length_m < 4.9:
        return _SPORTS_PROPORTIONS
    return _SALOON_PROPORTIONS


RING_POINTS = 18
"""Points of a cross-section of the shell."""
ARCH_RADII = 1.14
"""Radius of a wheel arch in radii of the wheel."""


@dataclass(frozen=True)
class CarShell:
    """Lower body of one car, in metres."""

    kind: CarProportions
    length: float
    half: float
    height: float
    wheel_m: float

    def x_at(self, station: float) -> float:
        """Compute x of a station."""
        return self.length * (0.5 - station)

    def deck_height_at(self, station: float | Float64Array) -> Float64Array:
        """Compute the height of bonnet, belt line or boot."""
        heights = np.multiply(self.kind.deck_heights, self.height)
        return np.asarray(np.interp(station, self.kind.deck_stations, heights))

    def compute_stations(self) -> Float64Array:
        """Compute the stations (n,) of the cross-sections."""
        arch = ARCH_RADII * self.wheel_m / self.length
        # Close stations over the wheels make the arches round.
        steps = arch * np.array([-1.0, -0.9, -0.65, -0.3, 0.0, 0.3, 0.65, 0.9, 1.0])
        edge = arch + 0.004
        wells = [axle + np.array([-edge, *steps, edge]) for axle in self.kind.axles]
        ends = np.array([0.03, 0.9, 0.97])
        return np.unique(np.concatenate([*wells, ends, self.kind.deck_stations]))

    def sill_height_at(self, station: Float64Array) -> Float64Array:
        """Compute the lower edge of the flanks: the clearance, or the arch over a wheel."""
        gap = np.abs(station[:, None] - np.asarray(self.kind.axles)).min(axis=1) * self.length
        radius = ARCH_RADII * self.wheel_m
        inside = gap <= radius * 1.0001
        arch = self.wheel_m + np.sqrt(np.maximum(radius**2 - gap**2, 0.0))
        return np.where(inside, arch, self.bottom_height_at(station))

    def locate_deck(self, station: Float64Array, fraction: Float64Array) -> Float64Array:
        """Locate points (n, 3) of the deck on the left, at fractions (n,) of the half width."""
        top, crown = self.deck_height_at(station), self._crown_at(station)
        x, y = self.length * (0.5 - station), self.half_width_at(station) * fraction
        inner = top + crown - (fraction / 0.55) * 0.4 * crown
        edge = top - 0.015
        outer = edge + (0.90 - fraction) / 0.35 * (top + 0.6 * crown - edge)
        return np.column_stack([x, y, np.where(fraction < 0.55, inner, outer)])

    def _crown_at(self, station: Float64Array) -> Float64Array:
        return 0.02 * self.height * np.interp(station, [0, 0.1, 0.9, 1], [0.2, 1, 1, 0.2])

    def bottom_height_at(self, station: Float64Array) -> Float64Array:
        """Compute the height of the floor, which rises towards both ends."""
        lift = np.interp(station, [0, 0.03, 0.08, 0.9, 0.97, 1], [0.10, 0.04, 0, 0, 0.07, 0.16])
        return self.kind.clearance_m + lift

    def half_width_at(self, station: Float64Array) -> Float64Array:
        """Compute half of the width."""
        at = [0, 0.012, 0.035, 0.10, 0.2, 0.8, 0.92, 0.975, 1]
        fraction = [0.72, 0.86, 0.925, 0.975, 1, 1, 0.97, 0.91, 0.80]
        return np.interp(station, at, fraction) * self.half

    def build_pieces(self) -> list[MeshPart]:
        """Build the lower body with its lamps and its black parts."""
        station = self.compute_stations()
        bottom, sill = self.bottom_height_at(station), self.sill_height_at(station)
        top = self.deck_height_at(station)
        waist = top - 0.075 * self.height
        low = np.minimum(sill + 0.03, waist - 0.02)
        crown = self._crown_at(station)
        z = [bottom, bottom, sill, sill, low, 0.45 * low + 0.55 * waist, waist, top - 0.015]
        z += [top + 0.6 * crown, top + crown]
        fraction = [0, 0.70, 0.71, 0.965, 0.995, 1, 0.98, 0.90, 0.55, 0]
        y = np.outer(self.half_width_at(station), fraction)
        x = np.broadcast_to(self.length * (0.5 - station)[:, None], y.shape)
        half = np.stack([x, y, np.column_stack(z)], -1)
        ring = np.concatenate([half, half[:, -2:0:-1] * (1, -1, 1)], axis=1)
        return self._split_by_material(loft_rings(ring), station)

    def _split_by_material(self, surface: TriangleSurface, station: Float64Array) -> list[MeshPart]:
        """Split the shell into lamps, black parts and paint, by station and point of the ring."""
        bands = len(station) - 1
        middle = (station[:-1] + station[1:]) / 2
        at = np.repeat(middle, RING_POINTS)
        point = np.arange(RING_POINTS)
        column = np.tile(np.minimum(point, RING_POINTS - 1 - point), bands)
        front = (at < 0.045) & (column == 5)
        rear = (at > 0.975) & (column == 5)
        under = (column < 3) | ((column == 3) & ((at < 0.05) | (at > 0.95)))
        # Two triangles per quad of the loft; the caps, which come last, are painted.
        kinds = np.zeros(len(surface.triangles), dtype=np.int64)
        kinds[: 2 * bands * RING_POINTS] = np.repeat(np.select([front, rear, under], [1, 2, 3]), 2)
        names = (ACTOR_PAINT, "lamp_white", "lamp_red", "black_plastic")
        return [
            part
            for kind, name in enumerate(names)
            for part in make_vehicle_parts(name, split_surface(surface, kinds == kind)[0])
        ]
