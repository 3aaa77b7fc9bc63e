"""Side views of motor cars, by kind.

A `station` is the share of a car's length from the nose; heights are shares of its height.

Cars: a lofted shell with wheel wells under a lofted cabin, in proportions by kind.

Along a car, `station` is the share of its length from the nose.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from advercity.assets.vehicle_parts import build_axle
from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import MeshPart, Size, TriangleSurface, add_mirror_image, split_surface
from advercity.geometry.primitives import box, ellipsoid, loft_rings, tube
from advercity.materials import ACTOR_PAINT
from advercity.randomness import create_generator
from advercity.semantics import Semantic

StationTable = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class CarProportions:
    """Side view of a kind of car."""

    deck_height: StationTable
    """Height of bonnet, belt and boot by station."""
    axles: tuple[float, float]
    wheel_m: float
    clearance_m: float
    cabin: tuple[float, float, float, float]
    """Stations of windscreen foot, windscreen top, rear window top and its foot."""
    pillar: float
    """Station of the pillar between the doors."""
    roof_width: float
    """Width of the roof as a share of the widest."""
    side_window_count: int = 2
    """Side windows, counted from the front; a panel van has one."""
    has_roof_rails: bool = False
    """Whether its roof has some."""


_SALOON_PROPORTIONS = CarProportions(
    deck_height=(
        (0, 0.40),
        (0.012, 0.46),
        (0.05, 0.52),
        (0.14, 0.575),
        (0.27, 0.63),
        (0.6, 0.645),
        (0.84, 0.665),
        (0.95, 0.665),
        (0.985, 0.62),
        (1, 0.56),
    ),
    axles=(0.195, 0.775),
    wheel_m=0.33,
    clearance_m=0.17,
    cabin=(0.255, 0.42, 0.70, 0.875),
    pillar=0.53,
    roof_width=0.76,
)
_HATCHBACK_PROPORTIONS = CarProportions(
    deck_height=(
        (0, 0.38),
        (0.015, 0.45),
        (0.06, 0.53),
        (0.16, 0.60),
        (0.25, 0.635),
        (0.6, 0.655),
        (0.93, 0.675),
        (0.985, 0.63),
        (1, 0.50),
    ),
    axles=(0.19, 0.82),
    wheel_m=0.31,
    clearance_m=0.17,
    cabin=(0.215, 0.41, 0.87, 0.965),
    pillar=0.56,
    roof_width=0.79,
)
_SUV_PROPORTIONS = CarProportions(
    deck_height=(
        (0, 0.42),
        (0.012, 0.50),
        (0.05, 0.56),
        (0.15, 0.585),
        (0.26, 0.61),
        (0.6, 0.62),
        (0.95, 0.63),
        (0.985, 0.60),
        (1, 0.48),
    ),
    axles=(0.185, 0.79),
    wheel_m=0.37,
    clearance_m=0.23,
    cabin=(0.25, 0.36, 0.91, 0.975),
    pillar=0.52,
    roof_width=0.83,
    has_roof_rails=True,
)
_SPORTS_PROPORTIONS = CarProportions(
    deck_height=(
        (0, 0.40),
        (0.015, 0.47),
        (0.06, 0.54),
        (0.16, 0.60),
        (0.33, 0.665),
        (0.62, 0.68),
        (0.84, 0.71),
        (0.955, 0.69),
        (0.988, 0.63),
        (1, 0.54),
    ),
    axles=(0.19, 0.785),
    wheel_m=0.335,
    clearance_m=0.13,
    cabin=(0.32, 0.47, 0.66, 0.88),
    pillar=0.585,
    roof_width=0.73,
)
MINIBUS_PROPORTIONS = CarProportions(
    deck_height=((0, 0.38), (0.012, 0.46), (0.035, 0.52), (0.2, 0.535), (0.96, 0.535), (1, 0.46)),
    axles=(0.20, 0.76),
    wheel_m=0.32,
    clearance_m=0.2,
    cabin=(0.035, 0.12, 0.945, 0.98),
    pillar=0.34,
    roof_width=0.86,
)
PANEL_VAN_PROPORTIONS = CarProportions(
    deck_height=(
        (0, 0.27),
        (0.012, 0.32),
        (0.05, 0.375),
        (0.13, 0.43),
        (0.18, 0.45),
        (0.97, 0.46),
        (1, 0.40),
    ),
    axles=(0.165, 0.79),
    wheel_m=0.34,
    clearance_m=0.2,
    cabin=(0.135, 0.255, 0.965, 0.985),
    pillar=0.36,
    roof_width=0.87,
    side_window_count=1,
)


def choose_car_proportions(length_m: float, height_m: float) -> CarProportions:
    """Which kind of car a box of this length and height holds."""
    slenderness = height_m / length_m
    if height_m >= 1.64 and slenderness >= 0.335:
        return _SUV_PROPORTIONS
    if length_m < 4.0 or slenderness >= 0.35:
        return _HATCHBACK_PROPORTIONS
    if height_m < 1.42 and length_m < 4.9:
        return _SPORTS_PROPORTIONS
    return _SALOON_PROPORTIONS


_RING_POINTS = 18
"""Of a cross-section of the shell."""


def build_car(blueprint_id: str, size: Size) -> list[MeshPart]:
    """Pieces of a car of about `size`, x forward, on the ground."""
    length, width, height = size
    kind = choose_car_proportions(length, height)
    if "police" not in blueprint_id:
        return _build_motor_car(blueprint_id, size, kind)
    lower = (length, width, height - 0.10)
    return _build_motor_car(blueprint_id, lower, kind) + _build_light_bar(kind, size)


def build_van(blueprint_id: str, size: Size) -> list[MeshPart]:
    """Pieces of a minibus, or of a panel van if it is high."""
    return _build_motor_car(
        blueprint_id, size, PANEL_VAN_PROPORTIONS if size[2] > 2.3 else MINIBUS_PROPORTIONS
    )


def _build_motor_car(blueprint_id: str, size: Size, kind: CarProportions) -> list[MeshPart]:
    """Pieces of a car of the given proportions; its wheels vary a little with the blueprint."""
    length, width, height = size
    radius = min(kind.wheel_m, 0.13 * length) * create_generator("car", blueprint_id).uniform(
        0.97, 1.03
    )
    shell = _CarShell(kind, length, 0.455 * width, height, radius)
    front, rear = (shell.x_at(station) for station in kind.axles)
    outer, wide = shell.half - 0.012, 0.27 * shell.half
    return [
        *shell.build_pieces(),
        *_build_cabin(shell),
        *_build_trim(shell, width),
        *_build_seams(shell),
        *(_build_roof_rails(shell) if kind.has_roof_rails else []),
        *build_axle(front, outer, radius, wide, is_steered=True),
        *build_axle(rear, outer, radius, wide),
    ]


@dataclass(frozen=True)
class _CarShell:
    """The lower body of one car."""

    kind: CarProportions
    length: float
    half: float
    height: float
    wheel_m: float

    def x_at(self, station: float) -> float:
        return self.length * (0.5 - station)

    def deck_height_at(self, station: float | Float64Array) -> Float64Array:
        at, z = np.transpose(self.kind.deck_height)
        return np.asarray(np.interp(station, at, z * self.height))

    def compute_stations(self) -> Float64Array:
        arch = 1.14 * self.wheel_m / self.length
        steps = arch * np.array([-1.0, -0.9, -0.65, -0.3, 0.0, 0.3, 0.65, 0.9, 1.0])
        edge = arch + 0.004
        wells = [axle + np.array([-edge, *steps, edge]) for axle in self.kind.axles]
        ends = np.array([0.03, 0.9, 0.97])
        return np.unique(np.concatenate([*wells, ends, np.transpose(self.kind.deck_height)[0]]))

    def sill_height_at(self, station: Float64Array) -> Float64Array:
        """Lower edge of the flanks: the clearance, or the arch over a wheel."""
        gap = np.abs(station[:, None] - np.asarray(self.kind.axles)).min(axis=1) * self.length
        radius = 1.14 * self.wheel_m
        inside = gap <= radius * 1.0001
        arch = self.wheel_m + np.sqrt(np.maximum(radius**2 - gap**2, 0.0))
        return np.where(inside, arch, self.bottom_height_at(station))

    def bottom_height_at(self, station: Float64Array) -> Float64Array:
        lift = np.interp(station, [0, 0.03, 0.08, 0.9, 0.97, 1], [0.10, 0.04, 0, 0, 0.07, 0.16])
        return self.kind.clearance_m + lift

    def half_width_at(self, station: Float64Array) -> Float64Array:
        """Half the width at a station."""
        at = [0, 0.012, 0.035, 0.10, 0.2, 0.8, 0.92, 0.975, 1]
        share = [0.72, 0.86, 0.925, 0.975, 1, 1, 0.97, 0.91, 0.80]
        return np.interp(station, at, share) * self.half

    def build_pieces(self) -> list[MeshPart]:
        station = self.compute_stations()
        bottom, sill, top = (
            self.bottom_height_at(station),
            self.sill_height_at(station),
            self.deck_height_at(station),
        )
        waist = top - 0.075 * self.height
        low = np.minimum(sill + 0.03, waist - 0.02)
        crown = 0.02 * self.height * np.interp(station, [0, 0.1, 0.9, 1], [0.2, 1, 1, 0.2])
        z = [bottom, bottom, sill, sill, low, 0.45 * low + 0.55 * waist, waist, top - 0.015]
        z += [top + 0.6 * crown, top + crown]
        share = [0, 0.70, 0.71, 0.965, 0.995, 1, 0.98, 0.90, 0.55, 0]
        y = np.outer(self.half_width_at(station), share)
        half = np.stack(
            [np.broadcast_to(self._x_column(station), y.shape), y, np.column_stack(z)], -1
        )
        ring = np.concatenate([half, half[:, -2:0:-1] * (1, -1, 1)], axis=1)
        surface = loft_rings(ring)
        return [
            MeshPart(part, material, Semantic.VEHICLE)
            for part, material in self._split_by_material(surface, station)
        ]

    def _x_column(self, station: Float64Array) -> Float64Array:
        return self.length * (0.5 - station)[:, None]

    def _split_by_material(
        self, surface: TriangleSurface, station: Float64Array
    ) -> list[tuple[TriangleSurface, str]]:
        """The shell cut into lamps, black parts and paint, by band and by point of the ring."""
        bands = len(station) - 1
        middle = (station[:-1] + station[1:]) / 2
        at = np.repeat(middle, _RING_POINTS)
        column = np.tile(
            np.minimum(np.arange(_RING_POINTS), _RING_POINTS - 1 - np.arange(_RING_POINTS)), bands
        )
        front = (at < 0.045) & (column == 5)
        rear = (at > 0.975) & (column == 5)
        under = (column < 3) | ((column == 3) & ((at < 0.05) | (at > 0.95)))
        kinds = np.zeros(len(surface.triangles), dtype=np.int64)
        kinds[: 2 * bands * _RING_POINTS] = np.repeat(np.select([front, rear, under], [1, 2, 3]), 2)
        names = (ACTOR_PAINT, "lamp_white", "lamp_red", "black_plastic")
        return [(split_surface(surface, kinds == kind)[0], name) for kind, name in enumerate(names)]


def _build_cabin(shell: _CarShell) -> list[MeshPart]:
    foot, top, back_top, back_foot = shell.kind.cabin
    belt_half = 0.90 * shell.half
    roof_half = shell.kind.roof_width * shell.half
    pillar = shell.kind.pillar
    base = _compute_cabin_outline(shell, foot, back_foot, pillar, belt_half)
    base[:, 2] = shell.deck_height_at(0.5 - base[:, 0] / shell.length) - 0.03
    eaves = _compute_cabin_outline(shell, top, back_top, pillar, roof_half)
    eaves[:, 2] = 0.955 * shell.height
    centre = eaves.mean(axis=0)
    upper = centre + (eaves - centre) * (0.965, 0.93, 1)
    upper[:, 2] = 0.985 * shell.height
    crest = centre + (eaves - centre) * (0.86, 0.66, 1)
    crest[:, 2] = shell.height
    rows = [base + share * (eaves - base) for share in (0.0, 0.13, 0.93)]
    surface = loft_rings(np.stack([*rows, eaves, upper, crest]))
    points = len(base)
    column = np.tile(np.arange(points), 5)
    row = np.repeat(np.arange(5), points)
    rear = shell.kind.side_window_count > 1
    side = [True, False, True, False, rear, False, rear]
    pane = np.array([*side, *side[::-1]])
    glass = np.zeros(len(surface.triangles), dtype=bool)
    glass[: 2 * len(row)] = np.repeat((row == 1) & pane[column], 2)
    panes, rest = split_surface(surface, glass)
    return [
        MeshPart(panes, "glass", Semantic.VEHICLE),
        MeshPart(rest, ACTOR_PAINT, Semantic.VEHICLE),
    ]


def _compute_cabin_outline(
    shell: _CarShell, front: float, rear: float, pillar: float, half: float
) -> NDArray[np.float64]:
    """Outline (14, 3) of the cabin in plan, from the front middle over the left; z is left 0."""
    bow = 0.018 * shell.length
    x0, x1, xb = shell.x_at(front), shell.x_at(rear), shell.x_at(pillar)
    post = 0.009 * shell.length
    left = [
        (x0, 0.82 * half),
        (x0 - 1.3 * bow, half),
        (xb + post, half * 1.01),
        (xb - post, half * 1.01),
        (x1 + 2.6 * bow, half),
        (x1, 0.84 * half),
    ]
    outline = [(x0 + bow, 0.0), *left, (x1 - 0.6 * bow, 0.0), *((x, -y) for x, y in left[::-1])]
    return np.column_stack([np.asarray(outline), np.zeros(len(outline))])


def _build_trim(shell: _CarShell, width: float) -> list[MeshPart]:
    """Grille, plates and mirrors."""
    front, rear = shell.x_at(0), shell.x_at(1)
    grille = 0.36 * shell.height
    foot = shell.x_at(shell.kind.cabin[0]) - 0.10 * shell.length
    belt = float(shell.deck_height_at(0.3))
    arm = add_mirror_image(
        box((foot - 0.05, 0.8 * shell.half, belt), (foot, width / 2 - 0.04, belt + 0.04))
    )
    mirror = add_mirror_image(
        ellipsoid((foot, width / 2 - 0.09, belt + 0.07), (0.055, 0.09, 0.07), sides=6, bands=3)
    )
    plates = [
        box((front - 0.02, -0.26, 0.40), (front + 0.012, 0.26, 0.51)),
        box((rear - 0.012, -0.26, grille + 0.02), (rear + 0.04, 0.26, grille + 0.13)),
    ]
    intake = box((front - 0.05, -0.5 * shell.half, 0.32), (front + 0.006, 0.5 * shell.half, grille))
    return [
        MeshPart(arm, "black_plastic", Semantic.VEHICLE),
        MeshPart(mirror, ACTOR_PAINT, Semantic.VEHICLE),
        MeshPart(intake, "black_plastic", Semantic.VEHICLE),
        *(MeshPart(plate, "licence_plate", Semantic.VEHICLE) for plate in plates),
    ]


def _build_seams(shell: _CarShell) -> list[MeshPart]:
    """Gaps between doors, and their handles."""
    foot, _, _, back_foot = shell.kind.cabin
    behind = shell.kind.axles[1] - 1.3 * shell.wheel_m / shell.length
    doors = [foot + 0.03, shell.kind.pillar, min(behind, back_foot - 0.04)]
    low, outer = shell.kind.clearance_m + 0.10, shell.half + 0.003
    seams = [
        box(
            (x - 0.006, outer - 0.02, low),
            (x + 0.006, outer, float(shell.deck_height_at(station)) * 0.9),
        )
        for station in doors
        if (x := shell.x_at(station))
    ]
    handles = [
        box((x, outer - 0.02, z - 0.015), (x + 0.15, outer + 0.018, z + 0.015))
        for station in doors[1:]
        if (x := shell.x_at(station) + 0.06) and (z := 0.84 * float(shell.deck_height_at(station)))
    ]
    return [
        MeshPart(add_mirror_image(part), "black_plastic", Semantic.VEHICLE)
        for part in (*seams, *handles)
    ]


def _build_roof_rails(shell: _CarShell) -> list[MeshPart]:
    """Along the edges of the roof."""
    _, top, back_top, _ = shell.kind.cabin
    y, z = 0.88 * shell.kind.roof_width * shell.half, shell.height + 0.02
    ahead, behind = shell.x_at(top + 0.04), shell.x_at(back_top - 0.02)
    ends = [(ahead, y, z - 0.07), (ahead - 0.1, y, z), (behind + 0.1, y, z), (behind, y, z - 0.07)]
    return [
        MeshPart(add_mirror_image(tube(ends, 0.02, sides=5)), "black_plastic", Semantic.VEHICLE)
    ]


def _build_light_bar(kind: CarProportions, size: Size) -> list[MeshPart]:
    length, width, height = size
    x = length * (0.5 - (kind.cabin[1] + kind.cabin[2]) / 2)
    low, half = height - 0.12, 0.27 * width
    sides = {"sign_red": (0.02, half), "car_paint_blue": (-half, -0.02)}
    return [
        MeshPart(box((x - 0.12, y0, low), (x + 0.12, y1, height)), material, Semantic.VEHICLE)
        for material, (y0, y1) in sides.items()
    ]
