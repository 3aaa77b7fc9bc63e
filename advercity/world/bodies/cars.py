"""Cars: a lofted shell with wheel wells under a lofted cabin, in proportions by kind.

Along a car, `station` is the share of its length from the nose.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from advercity.randomness import generator
from advercity.semantics import Semantic
from advercity.world.bodies.proportions import MINIBUS, PANEL_VAN, Proportions, proportions
from advercity.world.bodies.wheels import axle
from advercity.world.materials import PAINT
from advercity.world.shapes import (
    Floats,
    Piece,
    Surface,
    both_sides,
    box,
    ellipsoid,
    loft,
    split,
    tube,
)

Size = tuple[float, float, float]


_POINTS = 18
"""Of a cross-section of the shell."""


def car(blueprint_id: str, size: Size) -> list[Piece]:
    """Pieces of a car of about `size`, x forward, on the ground."""
    length, width, height = size
    kind = proportions(length, height)
    if "police" not in blueprint_id:
        return _motor_car(blueprint_id, size, kind)
    lower = (length, width, height - 0.10)
    return _motor_car(blueprint_id, lower, kind) + _light_bar(kind, size)


def van(blueprint_id: str, size: Size) -> list[Piece]:
    """Pieces of a minibus, or of a panel van if it is high."""
    return _motor_car(blueprint_id, size, PANEL_VAN if size[2] > 2.3 else MINIBUS)


def _motor_car(blueprint_id: str, size: Size, kind: Proportions) -> list[Piece]:
    """Pieces of a car of the given proportions; its wheels vary a little with the blueprint."""
    length, width, height = size
    radius = min(kind.wheel_m, 0.13 * length) * generator("car", blueprint_id).uniform(0.97, 1.03)
    shell = _Shell(kind, length, 0.455 * width, height, radius)
    front, rear = (shell.x(station) for station in kind.axles)
    outer, wide = shell.half - 0.012, 0.27 * shell.half
    return [
        *shell.pieces(),
        *_cabin(shell),
        *_trim(shell, width),
        *_seams(shell),
        *(_rails(shell) if kind.rails else []),
        *axle(front, outer, radius, wide, steers=True),
        *axle(rear, outer, radius, wide),
    ]


@dataclass(frozen=True)
class _Shell:
    """The lower body of one car."""

    kind: Proportions
    length: float
    half: float
    height: float
    wheel_m: float

    def x(self, station: float) -> float:
        return self.length * (0.5 - station)

    def deck(self, station: float | Floats) -> Floats:
        at, z = np.transpose(self.kind.deck)
        return np.asarray(np.interp(station, at, z * self.height))

    def stations(self) -> Floats:
        arch = 1.14 * self.wheel_m / self.length
        steps = arch * np.array([-1.0, -0.9, -0.65, -0.3, 0.0, 0.3, 0.65, 0.9, 1.0])
        edge = arch + 0.004
        wells = [axle + np.array([-edge, *steps, edge]) for axle in self.kind.axles]
        ends = np.array([0.03, 0.9, 0.97])
        return np.unique(np.concatenate([*wells, ends, np.transpose(self.kind.deck)[0]]))

    def sill(self, station: Floats) -> Floats:
        """Lower edge of the flanks: the clearance, or the arch over a wheel."""
        gap = np.abs(station[:, None] - np.asarray(self.kind.axles)).min(axis=1) * self.length
        radius = 1.14 * self.wheel_m
        inside = gap <= radius * 1.0001
        arch = self.wheel_m + np.sqrt(np.maximum(radius**2 - gap**2, 0.0))
        return np.where(inside, arch, self.bottom(station))

    def bottom(self, station: Floats) -> Floats:
        lift = np.interp(station, [0, 0.03, 0.08, 0.9, 0.97, 1], [0.10, 0.04, 0, 0, 0.07, 0.16])
        return self.kind.clearance_m + lift

    def halves(self, station: Floats) -> Floats:
        """Half the width at a station."""
        at = [0, 0.012, 0.035, 0.10, 0.2, 0.8, 0.92, 0.975, 1]
        share = [0.72, 0.86, 0.925, 0.975, 1, 1, 0.97, 0.91, 0.80]
        return np.interp(station, at, share) * self.half

    def pieces(self) -> list[Piece]:
        station = self.stations()
        bottom, sill, top = self.bottom(station), self.sill(station), self.deck(station)
        waist = top - 0.075 * self.height
        low = np.minimum(sill + 0.03, waist - 0.02)
        crown = 0.02 * self.height * np.interp(station, [0, 0.1, 0.9, 1], [0.2, 1, 1, 0.2])
        z = [bottom, bottom, sill, sill, low, 0.45 * low + 0.55 * waist, waist, top - 0.015]
        z += [top + 0.6 * crown, top + crown]
        share = [0, 0.70, 0.71, 0.965, 0.995, 1, 0.98, 0.90, 0.55, 0]
        y = np.outer(self.halves(station), share)
        half = np.stack([np.broadcast_to(self._x(station), y.shape), y, np.column_stack(z)], -1)
        ring = np.concatenate([half, half[:, -2:0:-1] * (1, -1, 1)], axis=1)
        surface = loft(ring)
        return [
            Piece(part, material, Semantic.VEHICLE)
            for part, material in self._painted(surface, station)
        ]

    def _x(self, station: Floats) -> Floats:
        return self.length * (0.5 - station)[:, None]

    def _painted(self, surface: Surface, station: Floats) -> list[tuple[Surface, str]]:
        """The shell cut into lamps, black parts and paint, by band and by point of the ring."""
        bands = len(station) - 1
        middle = (station[:-1] + station[1:]) / 2
        at = np.repeat(middle, _POINTS)
        column = np.tile(np.minimum(np.arange(_POINTS), _POINTS - 1 - np.arange(_POINTS)), bands)
        front = (at < 0.045) & (column == 5)
        rear = (at > 0.975) & (column == 5)
        under = (column < 3) | ((column == 3) & ((at < 0.05) | (at > 0.95)))
        kinds = np.zeros(len(surface.triangles), dtype=np.int64)
        kinds[: 2 * bands * _POINTS] = np.repeat(np.select([front, rear, under], [1, 2, 3]), 2)
        names = (PAINT, "lamp_white", "lamp_red", "black_plastic")
        return [(split(surface, kinds == kind)[0], name) for kind, name in enumerate(names)]


def _cabin(shell: _Shell) -> list[Piece]:
    foot, top, back_top, back_foot = shell.kind.cabin
    belt_half = 0.90 * shell.half
    roof_half = shell.kind.roof_width * shell.half
    pillar = shell.kind.pillar
    base = _cabin_ring(shell, foot, back_foot, pillar, belt_half)
    base[:, 2] = shell.deck(0.5 - base[:, 0] / shell.length) - 0.03
    eaves = _cabin_ring(shell, top, back_top, pillar, roof_half)
    eaves[:, 2] = 0.955 * shell.height
    centre = eaves.mean(axis=0)
    upper = centre + (eaves - centre) * (0.965, 0.93, 1)
    upper[:, 2] = 0.985 * shell.height
    crest = centre + (eaves - centre) * (0.86, 0.66, 1)
    crest[:, 2] = shell.height
    rows = [base + share * (eaves - base) for share in (0.0, 0.13, 0.93)]
    surface = loft(np.stack([*rows, eaves, upper, crest]))
    points = len(base)
    column = np.tile(np.arange(points), 5)
    row = np.repeat(np.arange(5), points)
    rear = shell.kind.windows > 1
    side = [True, False, True, False, rear, False, rear]
    pane = np.array([*side, *side[::-1]])
    glass = np.zeros(len(surface.triangles), dtype=bool)
    glass[: 2 * len(row)] = np.repeat((row == 1) & pane[column], 2)
    panes, rest = split(surface, glass)
    return [
        Piece(panes, "glass", Semantic.VEHICLE),
        Piece(rest, PAINT, Semantic.VEHICLE),
    ]


def _cabin_ring(
    shell: _Shell, front: float, rear: float, pillar: float, half: float
) -> NDArray[np.float64]:
    """Outline (14, 3) of the cabin in plan, from the front middle over the left; z is left 0."""
    bow = 0.018 * shell.length
    x0, x1, xb = shell.x(front), shell.x(rear), shell.x(pillar)
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


def _trim(shell: _Shell, width: float) -> list[Piece]:
    """Grille, plates and mirrors."""
    front, rear = shell.x(0), shell.x(1)
    grille = 0.36 * shell.height
    foot = shell.x(shell.kind.cabin[0]) - 0.10 * shell.length
    belt = float(shell.deck(0.3))
    arm = both_sides(
        box((foot - 0.05, 0.8 * shell.half, belt), (foot, width / 2 - 0.04, belt + 0.04))
    )
    mirror = both_sides(
        ellipsoid((foot, width / 2 - 0.09, belt + 0.07), (0.055, 0.09, 0.07), sides=6, bands=3)
    )
    plates = [
        box((front - 0.02, -0.26, 0.40), (front + 0.012, 0.26, 0.51)),
        box((rear - 0.012, -0.26, grille + 0.02), (rear + 0.04, 0.26, grille + 0.13)),
    ]
    intake = box((front - 0.05, -0.5 * shell.half, 0.32), (front + 0.006, 0.5 * shell.half, grille))
    return [
        Piece(arm, "black_plastic", Semantic.VEHICLE),
        Piece(mirror, PAINT, Semantic.VEHICLE),
        Piece(intake, "black_plastic", Semantic.VEHICLE),
        *(Piece(plate, "licence_plate", Semantic.VEHICLE) for plate in plates),
    ]


def _seams(shell: _Shell) -> list[Piece]:
    """Gaps between doors, and their handles."""
    foot, _, _, back_foot = shell.kind.cabin
    behind = shell.kind.axles[1] - 1.3 * shell.wheel_m / shell.length
    doors = [foot + 0.03, shell.kind.pillar, min(behind, back_foot - 0.04)]
    low, outer = shell.kind.clearance_m + 0.10, shell.half + 0.003
    seams = [
        box((x - 0.006, outer - 0.02, low), (x + 0.006, outer, float(shell.deck(station)) * 0.9))
        for station in doors
        if (x := shell.x(station))
    ]
    handles = [
        box((x, outer - 0.02, z - 0.015), (x + 0.15, outer + 0.018, z + 0.015))
        for station in doors[1:]
        if (x := shell.x(station) + 0.06) and (z := 0.84 * float(shell.deck(station)))
    ]
    return [
        Piece(both_sides(part), "black_plastic", Semantic.VEHICLE) for part in (*seams, *handles)
    ]


def _rails(shell: _Shell) -> list[Piece]:
    """Along the edges of the roof."""
    _, top, back_top, _ = shell.kind.cabin
    y, z = 0.88 * shell.kind.roof_width * shell.half, shell.height + 0.02
    ahead, behind = shell.x(top + 0.04), shell.x(back_top - 0.02)
    ends = [(ahead, y, z - 0.07), (ahead - 0.1, y, z), (behind + 0.1, y, z), (behind, y, z - 0.07)]
    return [Piece(both_sides(tube(ends, 0.02, sides=5)), "black_plastic", Semantic.VEHICLE)]


def _light_bar(kind: Proportions, size: Size) -> list[Piece]:
    length, width, height = size
    x = length * (0.5 - (kind.cabin[1] + kind.cabin[2]) / 2)
    low, half = height - 0.12, 0.27 * width
    sides = {"sign_red": (0.02, half), "car_paint_blue": (-half, -0.02)}
    return [
        Piece(box((x - 0.12, y0, low), (x + 0.12, y1, height)), material, Semantic.VEHICLE)
        for material, (y0, y1) in sides.items()
    ]
