"""Builds trucks: a cab-over with a box body, and a fire truck."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from advercity.assets.car_forms import CAB
from advercity.assets.car_surface import CarSurface
from advercity.assets.cars import build_body_on_wheels
from advercity.assets.lettering import WritingPlane, build_number_plate, write_text
from advercity.assets.vehicle_parts import build_axle, make_vehicle_parts
from advercity.geometry.mesh import (
    MeshPart,
    Size,
    TriangleSurface,
    add_mirror_image,
    move_surface,
    xyz,
)
from advercity.geometry.primitives import box, tube
from advercity.materials import ACTOR_PAINT


class _CabPlace(NamedTuple):
    """Where a cab is: x of its ends and of its axle, half of its width, heights and mirrors."""

    front: float
    behind: float
    half: float
    height: float
    width: float
    axle_x: float
    wheel_m: float


def build_truck(blueprint_id: str, size: Size) -> list[MeshPart]:
    """Build a truck of about `size`, x forward; `fire` in the name makes it a fire truck."""
    build = _build_fire_truck if "fire" in blueprint_id else _build_box_truck
    return build(blueprint_id, size)


def _build_box_truck(blueprint_id: str, size: Size) -> list[MeshPart]:
    length, width, height = size
    front, half = length / 2, width / 2 - 0.14
    behind = front - 0.31 * length
    rear, side = -length / 2, width / 2 - 0.06
    cab = _CabPlace(front, behind, half, 0.94 * height, width, front - 0.17 * length, 0.42)
    cargo = box((rear, -side, 0.75), (behind - 0.06, side, height))
    stripe = box((rear + 0.3, -side - 0.01, 1.25), (behind - 0.4, side + 0.01, 1.7))
    return [
        *_build_cab(blueprint_id, cab, ACTOR_PAINT),
        *make_vehicle_parts("car_paint_white", cargo),
        *make_vehicle_parts(ACTOR_PAINT, stripe),
        *_build_lettering((rear + behind - 0.1) / 2, side + 0.01, 1.475),
        *_build_cargo_frame((rear, behind - 0.06), side, (0.75, height)),
        *_build_cargo_doors(rear, side, (0.75, height)),
        *_build_chassis(length, half),
        *_build_rear_lamps(blueprint_id, rear, half, 0.6),
        *_build_axles((cab.axle_x, -length / 2 + 0.24 * length), half, cab.wheel_m),
    ]


def _build_fire_truck(blueprint_id: str, size: Size) -> list[MeshPart]:
    length, width, height = size
    front, half, roof = length / 2, width / 2 - 0.16, 0.80 * height
    rear = -length / 2
    cab = _CabPlace(front, front - 2.3, half, roof, width, front - 1.45, 0.50)
    behind = front - 2.25
    body = box((rear + 0.02, -half, 0.85), (behind - 0.05, half, 0.96 * roof))
    bay = (behind - 0.05 - rear) / 4
    shutters = [
        box(
            (rear + bay * k + 0.12, -half - 0.015, 1.0),
            (rear + bay * (k + 1) - 0.06, half + 0.015, 2.35),
        )
        for k in range(4)
    ]
    stripe = box((rear + 0.01, -half - 0.008, 2.42), (behind - 0.04, half + 0.008, 2.62))
    bar = box((front - 1.0, -0.8 * half, roof - 0.02), (front - 0.7, 0.8 * half, roof + 0.2))
    return [
        *_build_cab(blueprint_id, cab, "car_paint_red"),
        *make_vehicle_parts("car_paint_red", body),
        *make_vehicle_parts("metal", *shutters, *_build_ladder(rear, front - 1.3, height)),
        *make_vehicle_parts("black_plastic", *_build_slats(rear, bay, half)),
        *make_vehicle_parts("paint_white", stripe),
        *make_vehicle_parts("car_paint_blue", bar),
        *_build_chassis(length, half),
        *_build_rear_lamps(blueprint_id, rear, half, 0.95),
        *_build_axles((cab.axle_x, rear + 2.1), half, cab.wheel_m),
    ]


def _build_cab(blueprint_id: str, place: _CabPlace, paint: str) -> list[MeshPart]:
    """Build a cab-over of a paint."""
    length = place.front - place.behind
    form = replace(CAB, axles=((place.front - place.axle_x) / length, 9.0))
    body = CarSurface(form, length, place.half, place.height, place.wheel_m)
    parts = build_body_on_wheels(blueprint_id, body, place.width)
    shift = xyz((place.front + place.behind) / 2)
    return [
        replace(
            part,
            surface=move_surface(part.surface, shift),
            material=paint if part.material == ACTOR_PAINT else part.material,
        )
        for part in parts
    ]


def _build_cargo_frame(
    ends: tuple[float, float], side: float, heights: tuple[float, float]
) -> list[MeshPart]:
    """Build the metal edges of a cargo box, and the rails along its flanks."""
    (rear, front), (low, high) = ends, heights
    out, thick = 0.012, 0.07
    posts = [
        box((x, side - thick, low), (x + thick, side + out, high))
        for x in (rear - out, front - thick + out)
    ]
    rails = [
        box((rear, side - thick, z), (front, side + out, z + depth))
        for z, depth in ((low, 0.12), (high - 0.06, 0.06))
    ]
    lintels = [
        box((x, -side, z), (x + thick, side, z + 0.07))
        for x in (rear - out, front - thick + out)
        for z in (low, high - 0.07)
    ]
    return make_vehicle_parts("metal", *map(add_mirror_image, (*posts, *rails)), *lintels)


def _build_cargo_doors(rear: float, side: float, heights: tuple[float, float]) -> list[MeshPart]:
    """Build the gap between two rear doors, their locking bars, handles and hinges."""
    low, high = heights
    gap = box((rear - 0.006, -0.012, low + 0.1), (rear + 0.02, 0.012, high - 0.1))
    bars = [
        tube([(rear - 0.022, y, low + 0.05), (rear - 0.022, y, high - 0.05)], 0.016, sides=6)
        for y in (0.18, 0.62 * side)
    ]
    handles = [
        box((rear - 0.045, y - 0.02, low + 0.42), (rear - 0.02, y + 0.26, low + 0.46))
        for y in (0.18, 0.62 * side)
    ]
    hinges = [
        box((rear - 0.02, side - 0.16, z), (rear + 0.01, side, z + 0.08))
        for z in np.linspace(low + 0.25, high - 0.35, 4)
    ]
    return [
        *make_vehicle_parts("black_plastic", gap),
        *make_vehicle_parts("metal", *map(add_mirror_image, (*bars, *handles, *hinges))),
    ]


def _build_lettering(x: float, side: float, z: float) -> list[MeshPart]:
    """Write the name of a fictional haulier on both flanks."""
    texts = [
        write_text("ALPHA CAFE", WritingPlane((x, sign * side, z), (-sign, 0, 0)), 0.26)
        for sign in (1.0, -1.0)
    ]
    return make_vehicle_parts("car_paint_white", *texts)


def _build_slats(rear: float, bay: float, half: float) -> list[TriangleSurface]:
    """Build the shadow lines between the slats of roller shutters."""
    outer = half + 0.017
    return [
        add_mirror_image(
            box((rear + bay * k + 0.14, half, z), (rear + bay * (k + 1) - 0.08, outer, z + 0.01))
        )
        for k in range(4)
        for z in np.linspace(1.1, 2.25, 7)
    ]


def _build_chassis(length: float, half: float) -> list[MeshPart]:
    beam = box((-length / 2 + 0.05, -0.45, 0.5), (length / 2 - 0.3, 0.45, 0.86))
    guard = box(
        (-length / 2 + 0.36 * length, -half + 0.05, 0.45), (0.12 * length, half - 0.05, 0.86)
    )
    bumper = box((-length / 2 + 0.03, -half + 0.1, 0.42), (-length / 2 + 0.13, half - 0.1, 0.56))
    return make_vehicle_parts("black_plastic", beam, guard, bumper)


def _build_rear_lamps(blueprint_id: str, rear: float, half: float, z: float) -> list[MeshPart]:
    lamps = add_mirror_image(
        box((rear - 0.005, half - 0.42, z), (rear + 0.15, half - 0.06, z + 0.16))
    )
    low, high = xyz(rear - 0.008, half - 0.16, z - 0.003), xyz(rear + 0.14, half - 0.05, z + 0.163)
    return [
        *make_vehicle_parts("lamp_red", lamps),
        *make_vehicle_parts("lamp_amber", add_mirror_image(box(low, high))),
        *build_number_plate(blueprint_id, (rear - 0.01, 0.0, z + 0.06), -1.0),
    ]


def _build_axles(stations: tuple[float, float], half: float, radius: float) -> list[MeshPart]:
    front, rear = stations
    return [
        *build_axle(front, half - 0.01, radius, 0.30, is_steered=True),
        *build_axle(rear, half - 0.02, radius, 0.58),
    ]


def _build_ladder(rear: float, front: float, height: float) -> list[TriangleSurface]:
    low, high = height - 0.24, height - 0.03
    rails = [
        add_mirror_image(tube([(rear + 0.1, 0.36, z), (front, 0.36, z)], 0.03, sides=5))
        for z in (low, high)
    ]
    rungs = [
        tube([(x, -0.36, high), (x, 0.36, high)], 0.022, sides=4)
        for x in np.arange(rear + 0.3, front, 0.4)
    ]
    posts = [
        add_mirror_image(box((x - 0.05, 0.31, 0.75 * height), (x + 0.05, 0.41, high)))
        for x in np.linspace(rear + 0.4, front - 0.3, 4)
    ]
    return [*rails, *rungs, *posts]
