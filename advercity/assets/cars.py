"""Builds cars and vans: a lofted shell with wheel wells, and a lofted cabin on it.

Each kind of car has its proportions. A station is the distance from the nose as a fraction of the
length; heights are fractions of the height unless their names end in `_m`.
"""

from dataclasses import dataclass

import numpy as np

from advercity.assets.vehicle_parts import build_axle, make_vehicle_parts
from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import MeshPart, Size, TriangleSurface, add_mirror_image, split_surface
from advercity.geometry.primitives import box, ellipsoid, loft_rings, tube
from advercity.materials import ACTOR_PAINT
from advercity.randomness import create_generator


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


_RING_POINTS = 18
"""Points of a cross-section of the shell."""
_ARCH_RADII = 1.14
"""Radius of a wheel arch in radii of the wheel."""


def build_car(blueprint_id: str, size: Size) -> list[MeshPart]:
    """Build a car of about `size`, x forward, on the ground."""
    length, width, height = size
    kind = choose_car_proportions(length, height)
    if "police" not in blueprint_id:
        return _build_motor_car(blueprint_id, size, kind)
    lower = (length, width, height - 0.10)
    return _build_motor_car(blueprint_id, lower, kind) + _build_light_bar(kind, size)


def build_van(blueprint_id: str, size: Size) -> list[MeshPart]:
    """Build a minibus, or a panel van if it is high."""
    kind = PANEL_VAN_PROPORTIONS if size[2] > 2.3 else MINIBUS_PROPORTIONS
    return _build_motor_car(blueprint_id, size, kind)


def _build_motor_car(blueprint_id: str, size: Size, kind: CarProportions) -> list[MeshPart]:
    """Build a car of given proportions; the size of its wheels varies with the blueprint."""
    length, width, height = size
    factor = create_generator("car", blueprint_id).uniform(0.97, 1.03)
    radius = min(kind.wheel_m, 0.13 * length) * factor
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
    """Lower body of one car, in metres."""

    kind: CarProportions
    length: float
    half: float
    height: float
    wheel_m: float

    def x_at(self, station: float) -> float:
        return self.length * (0.5 - station)

    def deck_height_at(self, station: float | Float64Array) -> Float64Array:
        heights = np.multiply(self.kind.deck_heights, self.height)
        return np.asarray(np.interp(station, self.kind.deck_stations, heights))

    def compute_stations(self) -> Float64Array:
        arch = _ARCH_RADII * self.wheel_m / self.length
        # Close stations over the wheels make the arches round.
        steps = arch * np.array([-1.0, -0.9, -0.65, -0.3, 0.0, 0.3, 0.65, 0.9, 1.0])
        edge = arch + 0.004
        wells = [axle + np.array([-edge, *steps, edge]) for axle in self.kind.axles]
        ends = np.array([0.03, 0.9, 0.97])
        return np.unique(np.concatenate([*wells, ends, self.kind.deck_stations]))

    def sill_height_at(self, station: Float64Array) -> Float64Array:
        """Compute the lower edge of the flanks: the clearance, or the arch over a wheel."""
        gap = np.abs(station[:, None] - np.asarray(self.kind.axles)).min(axis=1) * self.length
        radius = _ARCH_RADII * self.wheel_m
        inside = gap <= radius * 1.0001
        arch = self.wheel_m + np.sqrt(np.maximum(radius**2 - gap**2, 0.0))
        return np.where(inside, arch, self.bottom_height_at(station))

    def bottom_height_at(self, station: Float64Array) -> Float64Array:
        lift = np.interp(station, [0, 0.03, 0.08, 0.9, 0.97, 1], [0.10, 0.04, 0, 0, 0.07, 0.16])
        return self.kind.clearance_m + lift

    def half_width_at(self, station: Float64Array) -> Float64Array:
        at = [0, 0.012, 0.035, 0.10, 0.2, 0.8, 0.92, 0.975, 1]
        fraction = [0.72, 0.86, 0.925, 0.975, 1, 1, 0.97, 0.91, 0.80]
        return np.interp(station, at, fraction) * self.half

    def build_pieces(self) -> list[MeshPart]:
        station = self.compute_stations()
        bottom, sill = self.bottom_height_at(station), self.sill_height_at(station)
        top = self.deck_height_at(station)
        waist = top - 0.075 * self.height
        low = np.minimum(sill + 0.03, waist - 0.02)
        crown = 0.02 * self.height * np.interp(station, [0, 0.1, 0.9, 1], [0.2, 1, 1, 0.2])
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
        at = np.repeat(middle, _RING_POINTS)
        point = np.arange(_RING_POINTS)
        column = np.tile(np.minimum(point, _RING_POINTS - 1 - point), bands)
        front = (at < 0.045) & (column == 5)
        rear = (at > 0.975) & (column == 5)
        under = (column < 3) | ((column == 3) & ((at < 0.05) | (at > 0.95)))
        # Two triangles per quad of the loft; the caps, which come last, are painted.
        kinds = np.zeros(len(surface.triangles), dtype=np.int64)
        kinds[: 2 * bands * _RING_POINTS] = np.repeat(np.select([front, rear, under], [1, 2, 3]), 2)
        names = (ACTOR_PAINT, "lamp_white", "lamp_red", "black_plastic")
        return [
            part
            for kind, name in enumerate(names)
            for part in make_vehicle_parts(name, split_surface(surface, kinds == kind)[0])
        ]


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
    rows = [base + fraction * (eaves - base) for fraction in (0.0, 0.13, 0.93)]
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
    return [*make_vehicle_parts("glass", panes), *make_vehicle_parts(ACTOR_PAINT, rest)]


def _compute_cabin_outline(
    shell: _CarShell, front: float, rear: float, pillar: float, half: float
) -> Float64Array:
    """Compute the plan (14, 3) of the cabin, from the front centre over the left; z is 0."""
    bow = 0.018 * shell.length
    x0, x1, xb = shell.x_at(front), shell.x_at(rear), shell.x_at(pillar)
    post = 0.009 * shell.length
    left = [(x0, 0.82 * half), (x0 - 1.3 * bow, half), (xb + post, half * 1.01)]
    left += [(xb - post, half * 1.01), (x1 + 2.6 * bow, half), (x1, 0.84 * half)]
    outline = [(x0 + bow, 0.0), *left, (x1 - 0.6 * bow, 0.0), *((x, -y) for x, y in left[::-1])]
    return np.column_stack([np.asarray(outline), np.zeros(len(outline))])


def _build_trim(shell: _CarShell, width: float) -> list[MeshPart]:
    """Build grille, licence plates and mirrors."""
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
        *make_vehicle_parts("black_plastic", arm, intake),
        *make_vehicle_parts(ACTOR_PAINT, mirror),
        *make_vehicle_parts("licence_plate", *plates),
    ]


def _build_seams(shell: _CarShell) -> list[MeshPart]:
    """Build the gaps between doors, and the door handles."""
    foot, _, _, back_foot = shell.kind.cabin
    behind = shell.kind.axles[1] - 1.3 * shell.wheel_m / shell.length
    doors = [foot + 0.03, shell.kind.pillar, min(behind, back_foot - 0.04)]
    low, outer = shell.kind.clearance_m + 0.10, shell.half + 0.003
    edges = [(shell.x_at(station), float(shell.deck_height_at(station))) for station in doors]
    seams = [box((x - 0.006, outer - 0.02, low), (x + 0.006, outer, 0.9 * z)) for x, z in edges]
    handles = [
        box(
            (x + 0.06, outer - 0.02, 0.84 * z - 0.015),
            (x + 0.06 + 0.15, outer + 0.018, 0.84 * z + 0.015),
        )
        for x, z in edges[1:]
    ]
    return make_vehicle_parts("black_plastic", *map(add_mirror_image, (*seams, *handles)))


def _build_roof_rails(shell: _CarShell) -> list[MeshPart]:
    """Build rails along the edges of the roof."""
    _, top, back_top, _ = shell.kind.cabin
    y, z = 0.88 * shell.kind.roof_width * shell.half, shell.height + 0.02
    ahead, behind = shell.x_at(top + 0.04), shell.x_at(back_top - 0.02)
    ends = [(ahead, y, z - 0.07), (ahead - 0.1, y, z), (behind + 0.1, y, z), (behind, y, z - 0.07)]
    return make_vehicle_parts("black_plastic", add_mirror_image(tube(ends, 0.02, sides=5)))


def _build_light_bar(kind: CarProportions, size: Size) -> list[MeshPart]:
    length, width, height = size
    x = length * (0.5 - (kind.cabin[1] + kind.cabin[2]) / 2)
    low, half = height - 0.12, 0.27 * width
    red, blue = (
        box((x - 0.12, y0, low), (x + 0.12, y1, height))
        for y0, y1 in ((0.02, half), (-half, -0.02))
    )
    return [*make_vehicle_parts("sign_red", red), *make_vehicle_parts("car_paint_blue", blue)]
