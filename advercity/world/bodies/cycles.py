"""Bicycles and motorcycles with their riders."""

import numpy as np

from advercity.randomness import generator
from advercity.semantics import Semantic
from advercity.world.bodies.people import Looks, Pose, Side, bent, figure
from advercity.world.materials import PAINT
from advercity.world.shapes import (
    Floats,
    Piece,
    Surface,
    both_sides,
    box,
    ellipsoid,
    hoop,
    loft,
    tube,
    xyz,
)

Size = tuple[float, float, float]
_COATS = ("cloth_red", "cloth_light", "cloth_blue", "cloth_dark")


def bicycle(blueprint_id: str, size: Size) -> list[Piece]:
    """Pieces of a cyclist on a bicycle of about `size`, x forward."""
    length, width, height = size
    radius = min(0.34, 0.215 * length)
    rear, front = xyz(radius - length / 2, z=radius), xyz(length / 2 - radius, z=radius)
    seat, crank = xyz(-0.13 * length, z=0.52 * height), xyz(-0.04 * length, z=0.30)
    head = xyz(front[0] - 0.13 * length, z=0.55 * height)
    stem = head + xyz(-0.02, 0, 0.10)
    grip = xyz(stem[0] - 0.02, z=stem[2] + 0.02) + xyz(0, width / 2 - 0.06, 0)
    bars = [grip * (1, -1, 1) + xyz(-0.08, -0.03, 0), stem, grip + xyz(-0.08, 0.03, 0)]
    frame = [
        tube([crank, seat], 0.022),
        tube([crank, head - xyz(0, 0, 0.08)], 0.026),
        tube([seat * (1, 1, 0.93), head], 0.024),
        tube([head + xyz(0.01, 0, -0.08), stem], 0.02),
        *(both_sides(tube([end, rear + xyz(0, 0.05, 0)], 0.013, sides=5)) for end in (crank, seat)),
        both_sides(tube([head + xyz(0.012, 0.02, -0.08), front + xyz(0, 0.05, 0)], 0.015, sides=5)),
    ]
    black = [
        tube(bars, 0.016, sides=6),
        ellipsoid(seat + xyz(0, 0, 0.03), (0.14, 0.08, 0.04), sides=8, bands=4),
        tube([crank - xyz(0, 0.05, 0), crank + xyz(0, 0.05, 0)], 0.06, sides=10),
    ]
    metal = [part for hub in (front, rear) for part in _spokes(hub, radius)]
    pedals = [crank + xyz(0.11, 0.10, 0.11), crank + xyz(-0.11, -0.10, -0.11)]
    black += [
        box(pedal - xyz(0.05, 0.04, 0.012), pedal + xyz(0.05, 0.04, 0.012)) for pedal in pedals
    ]
    tyres = [_tyre(hub, radius, 0.022) for hub in (front, rear)]
    lamps = [
        (ellipsoid(head + xyz(0.05, 0, 0.02), (0.03, 0.03, 0.03), sides=8, bands=4), "lamp_white"),
        (ellipsoid(seat + xyz(-0.05, 0, -0.10), (0.03, 0.03, 0.03), sides=8, bands=4), "lamp_red"),
    ]
    looks = Looks(
        height_m=height,
        half_breadth_m=0.165,
        half_depth_m=0.12,
        coat=_coat(blueprint_id),
        trousers="cloth_blue" if length > 1.8 else "cloth_dark",
        helmet=None if length > 1.8 else "cloth_light",
    )
    lean = 0.10 if length > 1.8 else 0.24
    rider = _rider(
        seat + xyz(0.02, 0, 0.10), lean, height, grip, [p + xyz(0, 0, 0.06) for p in pedals]
    )
    return [
        *_vehicle(frame, PAINT),
        *_vehicle(black, "black_plastic"),
        *_vehicle(metal, "metal"),
        *_vehicle(tyres, "rubber"),
        *(Piece(part, material, Semantic.VEHICLE) for part, material in lamps),
        *figure(rider, looks),
    ]


def motorcycle(blueprint_id: str, size: Size) -> list[Piece]:
    """Pieces of a rider on a motorcycle of about `size`, or on a scooter if it is short."""
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
    rims = [hoop(_square(0.66 * radius, 0.035), hub, sides=14) for hub in (front, rear)]
    spokes = [part for hub in (front, rear) for part in _spokes(hub, 0.72 * radius)]
    lamp = head + xyz(0.07, 0, -0.04)
    tail = xyz(rear[0] - 0.05, z=0.52 if scooter else saddle[2] + 0.02)
    lamps = [
        (ellipsoid(lamp, (0.06, 0.085, 0.085), sides=10, bands=5), "lamp_white"),
        (ellipsoid(tail, (0.05, 0.07, 0.04), sides=8, bands=4), "lamp_red"),
    ]
    foot = xyz(0.12 * length if scooter or cruiser else -0.08 * length, z=0.30)
    feet = [foot + xyz(0, 0.19, 0.05), foot + xyz(0, -0.19, 0.05)]
    looks = Looks(
        height_m=min(1.75, 1.12 * height),
        half_breadth_m=0.18,
        half_depth_m=0.13,
        coat=_coat(blueprint_id),
        helmet="car_paint_white" if scooter else "black_plastic",
        visor=True,
    )
    lean = 0.04 if scooter or cruiser else 0.26
    rider = _rider(saddle + xyz(0, 0, 0.13), lean, height, grip, feet)
    return [
        *_vehicle([*shell, *fenders], PAINT),
        *_vehicle([tube(bars, 0.02, sides=6), seat], "black_plastic"),
        *_vehicle([fork, *rims, *spokes, *_engine(rear, length, scooter)], "metal"),
        *_vehicle([_tyre(hub, radius, 0.065) for hub in (front, rear)], "rubber"),
        *(Piece(part, material, Semantic.VEHICLE) for part, material in lamps),
        *figure(rider, looks),
    ]


def _coat(blueprint_id: str) -> str:
    return str(generator("rider", blueprint_id).choice(_COATS))


def _vehicle(surfaces: list[Surface], material: str) -> list[Piece]:
    return [Piece(surface, material, Semantic.VEHICLE) for surface in surfaces]


def _tyre(hub: Floats, radius: float, half_width: float) -> Surface:
    angle = 2 * np.pi * np.arange(6) / 6
    profile = np.column_stack(
        [radius - half_width + half_width * np.cos(angle), half_width * np.sin(angle)]
    )
    return hoop(profile, hub, sides=20)


def _square(radius: float, half: float) -> Floats:
    return np.array(
        [(radius, -half), (radius + 0.03, -half), (radius + 0.03, half), (radius, half)]
    )


def _spokes(hub: Floats, radius: float) -> list[Surface]:
    angle = np.pi * np.arange(5) / 5
    along = np.column_stack([np.cos(angle), np.zeros(5), np.sin(angle)]) * 0.95 * radius
    axle = tube([hub - xyz(0, 0.05, 0), hub + xyz(0, 0.05, 0)], 0.03, sides=6)
    return [axle, *(tube([hub - arm, hub + arm], 0.006, sides=3) for arm in along)]


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


def _rider(seat: Floats, lean_m: float, height: float, grip: Floats, feet: list[Floats]) -> Pose:
    """A sitting figure whose hands and feet are where they belong; its crown is at `height`."""
    head = np.array([seat[0] + lean_m + 0.12, 0.0, height - 0.135])
    neck = head + xyz(-0.06, 0, -0.15)

    def side(left: float, foot: Floats) -> Side:
        shoulder = neck + xyz(-0.01, left * 0.17, -0.06)
        hand = grip * (1, left, 1)
        hip = seat + xyz(0, left * 0.09, 0)
        ankle = foot + xyz(-0.05, 0, 0.03)
        return Side(
            shoulder=shoulder,
            elbow=bent(shoulder, hand, 0.25, 0.24, (-0.2, 0.3 * left, -0.9)),
            hand=hand,
            hip=hip,
            knee=bent(hip, ankle, 0.41, 0.40, (1.0, left * 0.2, 0.4)),
            ankle=ankle,
            toe=foot + xyz(0.13, 0, -0.01),
        )

    return Pose(
        pelvis=seat + xyz(0, 0, 0.08),
        neck=neck,
        head=head,
        sides=(side(1, feet[0]), side(-1, feet[1])),
    )


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
    fairing = [(x1 - 0.25, z - 0.16, 0.12, 0.10), (x1 - 0.05, z - 0.08, 0.18, 0.20)]
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
    block = ellipsoid((0.0, 0, 0.40), (0.11 * length, 0.15, 0.15), sides=8, bands=5)
    return [exhaust, block]
