"""Motorcycles and scooters with their riders."""

import numpy as np
from advercity_dsl import Looks
from advercity_dsl.catalogue import Saddle

from advercity.semantics import Semantic
from advercity.world.bodies.riders import Rider, Seat, dressed, riding
from advercity.world.bodies.spokes import spokes, tyre
from advercity.world.materials import PAINT
from advercity.world.scene import Body, Wheel
from advercity.world.shapes import (
    Floats,
    Piece,
    Surface,
    both_sides,
    box,
    ellipsoid,
    hoop,
    loft,
    meshes,
    tube,
    xyz,
)

Size = tuple[float, float, float]
_SPORTY_DEG = 15.0


def motorcycle(blueprint_id: str, size: Size) -> Body:
    """A rider on a motorcycle of about `size`, or on a scooter if it is short."""
    length, width, height = size
    scooter = length < 1.95
    cruiser = length > 2.25
    radius = 0.24 if scooter else 0.31
    rear, front = xyz(radius - length / 2, z=radius), xyz(length / 2 - radius, z=radius)
    saddle = xyz(-0.14 * length, z=0.47 * height)
    head = xyz(front[0] - (0.30 if cruiser else 0.20), z=0.60 * height)
    grip = head + xyz(-0.14 if cruiser else -0.08, width / 2 - 0.05, 0.10 if cruiser else 0.02)
    bars = [grip * (1, -1, 1) - (0.08, 0.04, 0), head, grip + xyz(-0.08, 0.04, 0)]
    shell = (
        _scooter_shell(front, saddle, head) if scooter else _motorcycle_shell(rear, saddle, head)
    )
    fork = both_sides(tube([front + xyz(0, 0.08, 0), head + xyz(0, 0.08, 0)], 0.028, sides=6))
    seat = ellipsoid(saddle + xyz(-0.08, 0, 0.03), (0.30, 0.13, 0.065), sides=10, bands=5)
    fenders = [_fender(hub, radius) for hub in (front, rear)]
    lamp = head + xyz(0.07, 0, -0.04)
    tail = xyz(rear[0] - 0.05, z=0.52 if scooter else saddle[2] + 0.02)
    lamps = [
        (ellipsoid(lamp, (0.06, 0.085, 0.085), sides=10, bands=5), "lamp_white"),
        (ellipsoid(tail, (0.05, 0.07, 0.04), sides=8, bands=4), "lamp_red"),
    ]
    foot = xyz(0.12 * length if scooter or cruiser else -0.08 * length, z=0.30)
    lean = np.radians(3.0 if scooter or cruiser else 24.0)
    place = Seat(saddle + xyz(0, 0, 0.15), grip, height, lean)
    pieces = [
        *_vehicle([*shell, *fenders], PAINT),
        *_vehicle([tube(bars, 0.02, sides=6), seat], "black_plastic"),
        *_vehicle([fork, *_engine(rear, length, scooter)], "metal"),
        *(piece for surface, material in lamps for piece in _vehicle([surface], material)),
        *(piece for hub in (front, rear) for piece in _wheel(hub, radius)),
        *_rider(blueprint_id, place, foot + xyz(y=0.19), scooter=scooter),
    ]
    return Body(tuple(meshes(pieces)), size)


def rider_of(blueprint_id: str, saddle: Saddle, size: Size) -> list[Piece]:
    """Somebody on the model of a motorcycle; who hardly leans is dressed for town."""
    pelvis = xyz(*saddle.seat) + xyz(z=0.12)
    place = Seat(pelvis, xyz(*saddle.grip), size[2], np.radians(saddle.lean_deg))
    return _rider(blueprint_id, place, xyz(*saddle.peg), scooter=saddle.lean_deg < _SPORTY_DEG)


def _rider(blueprint_id: str, seat: Seat, peg: Floats, *, scooter: bool) -> list[Piece]:
    rider = Rider.on(seat)
    looks = Looks(stout=1.05, bottom_colour="denim" if scooter else "black")
    helmet = "car_paint_white" if scooter else "black_plastic"
    posture = riding(rider, np.array([[peg, peg * (1, -1, 1)]]))[0]
    worn = dressed(posture, rider.build, looks, helmet, key=blueprint_id, visor=True)
    return [Piece(limb.surface, limb.material, limb.semantic) for limb in worn]


def _vehicle(surfaces: list[Surface], material: str, wheel: Wheel | None = None) -> list[Piece]:
    return [Piece(surface, material, Semantic.VEHICLE, wheel) for surface in surfaces]


def _wheel(hub: Floats, radius: float) -> list[Piece]:
    wheel = Wheel(tuple(hub.tolist()))
    rim = hoop(_square(0.66 * radius, 0.035), hub, sides=14)
    return [
        *_vehicle([tyre(hub, radius, 0.065)], "rubber", wheel),
        *_vehicle([rim, *spokes(hub, 0.72 * radius)], "metal", wheel),
    ]


def _square(radius: float, half: float) -> Floats:
    return np.array(
        [(radius, -half), (radius + 0.03, -half), (radius + 0.03, half), (radius, half)]
    )


def _fender(hub: Floats, radius: float) -> Surface:
    angle = np.radians(np.linspace(35, 150, 7))
    outer, half = radius + 0.035, 0.075
    arc = np.column_stack([np.cos(angle), np.zeros(7), np.sin(angle)])
    left = np.array([0.0, half, 0.0])
    rings = [
        hub
        + np.array(
            [
                a * outer - left,
                a * outer + left,
                a * (outer - 0.02) + left,
                a * (outer - 0.02) - left,
            ]
        )
        for a in arc
    ]
    return loft(np.stack(rings))


def _hull(stations: list[tuple[float, float, float, float]]) -> Surface:
    """A rounded hull of elliptical sections: (x, z of the middle, half width, half height)."""
    angle = 2 * np.pi * np.arange(10) / 10
    rings = [
        np.column_stack([np.full(10, x), half_y * np.cos(angle), z + half_z * np.sin(angle)])
        for x, z, half_y, half_z in stations
    ]
    return loft(np.stack(rings))


def _motorcycle_shell(rear: Floats, saddle: Floats, head: Floats) -> list[Surface]:
    x0, x1, z = saddle[0], head[0], saddle[2]
    tank = [(x0 + 0.05, z + 0.0, 0.08, 0.05), (x0 + 0.16, z + 0.06, 0.14, 0.11)]
    tank += [(x1 - 0.14, z + 0.08, 0.15, 0.13), (x1 - 0.02, z + 0.04, 0.09, 0.08)]
    tail = [(rear[0] - 0.10, z + 0.05, 0.04, 0.03), (rear[0] + 0.05, z + 0.0, 0.09, 0.06)]
    tail += [(x0, z - 0.06, 0.12, 0.08)]
    fairing = [(x1 - 0.30, z - 0.28, 0.13, 0.12), (x1 - 0.08, z - 0.14, 0.18, 0.24)]
    fairing += [(x1 + 0.10, z + 0.02, 0.16, 0.16), (x1 + 0.17, z + 0.06, 0.07, 0.08)]
    return [_hull(tank), _hull(tail), _hull(fairing)]


def _scooter_shell(front: Floats, saddle: Floats, head: Floats) -> list[Surface]:
    x0, z = saddle[0], saddle[2]
    shield_foot = xyz(front[0] - 0.34, z=0.30)
    rear = [(x0 - 0.42, 0.48, 0.06, 0.08), (x0 - 0.25, 0.48, 0.17, 0.20), (x0, 0.50, 0.18, 0.20)]
    rear += [(x0 + 0.20, z - 0.16, 0.12, 0.16)]
    floor = box((x0, -0.17, 0.26), (shield_foot[0], 0.17, 0.32))
    shield = loft(
        [
            [
                (p[0] + t, w, p[2]),
                (p[0] + t + 0.03, 0, p[2]),
                (p[0] + t, -w, p[2]),
                (p[0] + t - 0.05, 0, p[2]),
            ]
            for p, t, w in (
                (shield_foot, 0, 0.16),
                ((shield_foot + head) / 2, 0.03, 0.21),
                (head, 0, 0.12),
            )
        ]
    )
    return [_hull(rear), floor, shield]


def _engine(rear: Floats, length: float, scooter: bool) -> list[Surface]:
    pipe = [xyz(0.1, z=0.24), xyz(-0.2, z=0.22), rear + xyz(-0.10, 0, 0.03)]
    exhaust = tube(np.array(pipe) + xyz(0, -0.16, 0), [0.03, 0.035, 0.05], sides=8)
    if scooter:
        return [exhaust]
    block = ellipsoid((0.02, 0, 0.36), (0.13 * length, 0.16, 0.16), sides=8, bands=4)
    cylinders = [
        tube([xyz(0.0, z=0.38), xyz(0.26 * lean, z=0.66)], [0.10, 0.085], sides=6)
        for lean in (-0.55, 0.75)
    ]
    arm = both_sides(tube([xyz(-0.05, 0.09, 0.36), rear + xyz(y=0.09)], 0.03, sides=4))
    return [exhaust, block, *cylinders, arm]
