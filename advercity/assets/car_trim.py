"""Builds the parts fixed to the shell of a car: plates, grille, mirrors, gaps, wipers, rails."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from advercity.assets.car_forms import CENTRE, COWL, HEADER, REAR_FOOT
from advercity.assets.car_surface import CarSurface
from advercity.assets.lettering import build_number_plate
from advercity.assets.vehicle_parts import make_vehicle_parts
from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import (
    MeshPart,
    TriangleSurface,
    add_mirror_image,
    build_ribbon,
    normalize,
    xyz,
)
from advercity.geometry.primitives import box, ellipsoid, loft_rings, tube
from advercity.materials import ACTOR_PAINT

GAP_M, GAP_LIFT_M = 0.009, 0.003
"""Width of gaps between panels, and their distance from the surface."""
_CAB_DOOR = (0.14, 0.71)
"""Stations of the door of a cab."""
_CAB_STEP = 0.2
"""Station of the steps to it."""
_LATCHBACK_STATION = 0.93
"""Rear windows with an end before this station have a boot lid behind them."""


def build_trim(blueprint_id: str, body: CarSurface, width: float) -> list[MeshPart]:
    """Build the trim of a car of a width, mirrors included."""
    return [
        *_build_plates(blueprint_id, body),
        *_build_grille(body),
        *(_build_cab_trim(body, width) if body.form.is_cab else _build_mirrors(body, width)),
        *_build_gaps(body),
        *_build_handles(body),
        *_build_wipers(body),
        *(_build_roof_rails(body) if body.form.is_rugged else []),
    ]


def _build_plates(blueprint_id: str, body: CarSurface) -> list[MeshPart]:
    """Build number plates, the handle above the rear one, and the exhaust; a cab has one plate."""
    (front,), (rear,) = body.locate(0.0, [body.form.plate_row]), body.locate(20.0, [3.1])
    front_plate = build_number_plate(blueprint_id, front + xyz(0.018), 1.0)
    if body.form.is_cab:
        return front_plate
    handle = box(rear + xyz(-0.012, -0.28, 0.085), rear + xyz(0.05, 0.28, 0.11))
    pipe = tube(
        [(rear[0] + 0.25, 0.5 * body.half, 0.25), (rear[0] + 0.03, 0.5 * body.half, 0.25)], 0.03
    )
    return [
        *front_plate,
        *build_number_plate(blueprint_id, rear - xyz(0.018), -1.0),
        *make_vehicle_parts("chrome", handle, pipe),
    ]


def _build_grille(body: CarSurface) -> list[MeshPart]:
    across = np.linspace(0.0, 1.08, 5)
    rows = body.form.grille_rows
    bars = [_trace(body, across, np.full(5, v), 0.014, 0.006) for v in np.linspace(*rows, 5)[1:-1]]
    frame = [_trace(body, across, np.full(5, v), 0.02, 0.008) for v in rows]
    places = [(0.0, rows[1] - 0.3), (20.0, 4.6)][: 1 if body.form.is_cab else 2]
    badges = [
        ellipsoid(body.locate(u, [v])[0], (0.014, 0.05, 0.045), sides=10, bands=4)
        for u, v in places
    ]
    return make_vehicle_parts("chrome", *map(add_mirror_image, (*bars, *frame)), *badges)


def _build_mirrors(body: CarSurface, width: float) -> list[MeshPart]:
    """Build both mirrors: a cap in the car's paint with a glass behind, on an arm."""
    (foot,) = body.locate(COWL + 0.45, [6.2])
    y, z = width / 2 - 0.10, foot[2] + 0.06
    arm = box((foot[0] - 0.03, foot[1] - 0.05, z - 0.07), (foot[0] + 0.03, y, z - 0.03))
    cap = ellipsoid((foot[0] + 0.01, y, z), (0.06, 0.10, 0.075), sides=10, bands=6)
    glass = box((foot[0] - 0.056, y - 0.07, z - 0.045), (foot[0] - 0.03, y + 0.07, z + 0.045))
    return [
        *make_vehicle_parts("black_plastic", add_mirror_image(arm)),
        *make_vehicle_parts(ACTOR_PAINT, add_mirror_image(cap)),
        *make_vehicle_parts("chrome", add_mirror_image(glass)),
    ]


def _build_cab_trim(body: CarSurface, width: float) -> list[MeshPart]:
    """Build the special parts of truck cabs: tall mirrors, a visor, and steps to the doors."""
    (pillar,) = body.locate(COWL + 0.9, [6.6])
    low, high, x = pillar[2] - 0.28, pillar[2] + 0.24, pillar[0] + 0.06
    outer = width / 2
    arms = [
        tube([(pillar[0] - 0.1, pillar[1] - 0.04, z), (x, outer - 0.1, z)], 0.018, sides=5)
        for z in (low + 0.07, high - 0.07)
    ]
    housing = box((x - 0.03, outer - 0.24, low), (x + 0.06, outer, high))
    glass = box((x - 0.034, outer - 0.225, low + 0.02), (x - 0.028, outer - 0.015, high - 0.02))
    (side,) = body.locate(float(body.u_at(np.array([_CAB_STEP]))[0]), [2.2])
    wells, treads = (
        [
            add_mirror_image(box(side + xyz(-0.19, -0.1, z), side + xyz(0.19, lift, z + rise)))
            for z in (-0.16, 0.12)
        ]
        for lift, rise in ((0.012, 0.2), (0.03, 0.03))
    )
    return [
        *make_vehicle_parts("black_plastic", *map(add_mirror_image, (*arms, housing)), *wells),
        *make_vehicle_parts("rubber", _build_visor(body)),
        *make_vehicle_parts("chrome", add_mirror_image(glass)),
        *make_vehicle_parts("metal", *treads),
    ]


def _build_visor(body: CarSurface) -> TriangleSurface:
    v = np.linspace(7.6, CENTRE, 5)
    edge = body.locate(np.full(5, HEADER - 0.05), v)
    across = np.concatenate([edge, edge[-2::-1] * (1, -1, 1)])
    section = np.array([(-0.03, 0, 0.0), (0.2, 0, -0.13), (0.2, 0, -0.10), (-0.03, 0, 0.05)])
    return loft_rings(across[:, None] + section)


def _build_gaps(body: CarSurface) -> list[MeshPart]:
    form = body.form
    ahead, pillar, behind = _list_door_edges(body)
    flank = np.linspace(1.5, 6.0, 7)
    low = np.linspace(ahead, behind, 9)
    lines = [*((np.full(7, u), flank) for u in (ahead, pillar)), (low, np.full(9, 1.55))]
    lines.append((np.full(7, behind) - 0.5 * np.clip(3.5 - flank, 0, 2) / 2, flank))
    lines.append((np.linspace(3.2, COWL - 0.05, 8), np.full(8, 6.3)))
    lines.append((np.full(5, 3.15), np.linspace(6.3, CENTRE, 5)))
    if form.is_cab:
        return _build_lines(body, lines)
    lines.append((np.linspace(3.12, 4.2, 4), np.full(4, 3.6)))
    lines.append((np.linspace(16.4, 20, 6), np.full(6, 3.7)))
    if not all(form.side_windows):  # two doors instead of a rear window
        lines.append((np.linspace(12.98, 19, 12), np.full(12, CENTRE - 0.02)))
    if form.cabin[3] < _LATCHBACK_STATION:
        lines.append((np.linspace(REAR_FOOT, 17.2, 5), np.full(5, 7.2)))
    return _build_lines(body, lines)


def _build_lines(
    body: CarSurface, lines: Sequence[tuple[Float64Array, Float64Array]]
) -> list[MeshPart]:
    strips = [add_mirror_image(_trace(body, u, v, GAP_M)) for u, v in lines]
    return make_vehicle_parts("black_plastic", *strips)


def _list_door_edges(body: CarSurface) -> tuple[float, float, float]:
    """List u of the edges of the front doors, and of the rear edge of the rear ones."""
    form = body.form
    if form.is_cab:
        ahead, behind = (float(u) for u in body.u_at(np.array(_CAB_DOOR)))
        return ahead, behind, behind
    behind = form.axles[1] - 1.05 * body.wheel_m / body.length
    edges = (
        max(form.cabin[0] + 0.015, form.axles[0] + 1.3 * body.wheel_m / body.length),
        form.pillar,
        min(behind, form.cabin[3] - 0.04),
    )
    ahead, pillar, behind = (float(u) for u in body.u_at(np.array(edges)))
    return ahead, pillar, behind


def _build_handles(body: CarSurface) -> list[MeshPart]:
    handles: list[TriangleSurface] = []
    for edge in _list_door_edges(body)[1:]:
        (place,) = body.locate(edge, [4.75])
        low = place + xyz(0.06, -0.02, -0.014)
        handles.append(add_mirror_image(box(low, place + xyz(0.24, 0.022, 0.014))))
    return make_vehicle_parts(ACTOR_PAINT, *handles)


def _build_wipers(body: CarSurface) -> list[MeshPart]:
    """Build two wipers at rest at the foot of the windscreen."""
    lines = [((7.1, 9.4), (7.35, 7.9)), ((7.1, 7.7), (7.35, 9.6))]
    arms = [
        tube(body.locate(*np.transpose(line)) * (1, side, 1) + xyz(0.012, z=0.012), 0.008, sides=4)
        for line, side in zip(lines, (1, -1), strict=True)
    ]
    return make_vehicle_parts("black_plastic", *arms)


def _build_roof_rails(body: CarSurface) -> list[MeshPart]:
    u = np.array([HEADER + 0.35, HEADER + 0.6, 11.0, 12.3, 12.6])
    lift = np.array([0.0, 0.035, 0.04, 0.035, 0.0])[:, None] * (0, 0, 1)
    rail = tube(body.locate(u, np.full(5, 7.9)) + lift, 0.018, sides=6)
    return make_vehicle_parts("black_plastic", add_mirror_image(rail))


def _trace(
    body: CarSurface, u: ArrayLike, v: ArrayLike, width_m: float, lift_m: float = GAP_LIFT_M
) -> TriangleSurface:
    """Build a strip along places (n,) on the surface."""
    points, normals = body.locate(u, v), body.compute_normals(u, v)
    along = normalize(np.gradient(points, axis=0))
    side = width_m / 2 * np.cross(normals, along)
    middle = points + lift_m * normals
    return build_ribbon(middle + side, middle - side)
