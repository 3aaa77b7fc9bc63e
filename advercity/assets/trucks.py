"""Builds trucks: a cab-over with a box body, and a fire truck."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from advercity.assets.car_forms import CAB
from advercity.assets.car_surface import CarSurface
from advercity.assets.cargo_boxes import CargoBox, build_cargo_trim
from advercity.assets.cars import build_body_on_wheels
from advercity.assets.lettering import build_number_plate
from advercity.assets.truck_wheels import build_truck_axle
from advercity.assets.vehicle_parts import make_vehicle_parts
from advercity.geometry.mesh import (
    MeshPart,
    Size,
    TriangleSurface,
    add_mirror_image,
    move_surface,
    xyz,
)
from advercity.geometry.primitives import box, rectangles, tube
from advercity.materials import ACTOR_PAINT


class CabPlace(NamedTuple):
    """Place of a cab: x of its ends and of its axle, half of its width, heights and mirrors."""

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
    behind = front - 0.32 * length
    rear, side = -length / 2, width / 2 - 0.06
    cab = CabPlace(front, behind, half, 0.94 * height, width, front - 0.17 * length, 0.42)
    cargo = CargoBox(rear, behind - 0.06, side, 0.75, height)
    walls = box((rear, -side, cargo.low), (cargo.front, side, height))
    return [
        *build_cab(blueprint_id, cab, ACTOR_PAINT),
        *make_vehicle_parts("car_paint_white", walls),
        *build_cargo_trim(blueprint_id, cargo),
        *_build_chassis(length, half),
        *build_rear_lamps(blueprint_id, rear, half, 0.6),
        *_build_axles((cab.axle_x, -length / 2 + 0.24 * length), half, cab.wheel_m),
    ]


def _build_fire_truck(blueprint_id: str, size: Size) -> list[MeshPart]:
    length, width, height = size
    front, half, roof = length / 2, width / 2 - 0.16, 0.86 * height
    rear, top = -length / 2, 0.86 * height - 0.7
    cab = CabPlace(front, front - 2.3, half, roof, width, front - 1.45, 0.50)
    behind = front - 2.25
    body = box((rear + 0.02, -half, 0.85), (behind - 0.05, half, 0.96 * roof))
    bay = (behind - 0.05 - rear) / 4
    shutters = [
        box(
            (rear + bay * k + 0.12, -half - 0.015, 1.0),
            (rear + bay * (k + 1) - 0.06, half + 0.015, top),
        )
        for k in range(4)
    ]
    stripe = box(
        (rear + 0.01, -half - 0.008, top + 0.07), (behind - 0.04, half + 0.008, top + 0.27)
    )
    bar = box((front - 1.0, -0.8 * half, roof - 0.02), (front - 0.7, 0.8 * half, roof + 0.2))
    return [
        *build_cab(blueprint_id, cab, "car_paint_red"),
        *make_vehicle_parts("car_paint_red", body),
        *make_vehicle_parts("metal", *shutters, *_build_ladder(rear, front - 1.3, height)),
        *make_vehicle_parts("black_plastic", *_build_slats(rear, bay, half, top)),
        *_build_pump_bay(rear, half, top),
        *make_vehicle_parts("car_paint_white", stripe),
        *make_vehicle_parts("car_paint_blue", bar, *_build_beacons(rear, half, 0.96 * roof)),
        *_build_chassis(length, half),
        *build_rear_lamps(blueprint_id, rear, half, 0.95),
        *_build_axles((cab.axle_x, rear + 2.1), half, cab.wheel_m),
    ]


def build_cab(blueprint_id: str, place: CabPlace, paint: str) -> list[MeshPart]:
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


def _build_pump_bay(rear: float, half: float, top: float) -> list[MeshPart]:
    """Build the back of a fire truck: the shutter before its pump, posts, steps and handrails."""
    wide = 0.62 * half
    shutter = box((rear + 0.004, -wide, 1.25), (rear + 0.03, wide, top))
    lines = [(rear + 0.003, 0.0, z) for z in np.linspace(1.35, top - 0.1, 12)]
    slats = rectangles(lines, (0, -wide + 0.02, 0), (0, 0, 0.006))
    aside = wide + 0.06
    rail = tube([(rear - 0.01, aside, 1.3), (rear - 0.01, aside, top)], 0.018, sides=6)
    step = box((rear + 0.001, -half + 0.1, 0.66), (rear + 0.4, half - 0.1, 0.72))
    posts = [
        add_mirror_image(box((rear + 0.005, half - 0.26, z), (rear + 0.03, half - 0.03, z + 0.16)))
        for z in np.arange(1.3, top - 0.1, 0.32)
    ]
    return [
        *make_vehicle_parts("metal", shutter, step, add_mirror_image(rail)),
        *make_vehicle_parts("black_plastic", slats),
        *make_vehicle_parts("sign_yellow", *posts),
    ]


def _build_beacons(rear: float, half: float, z: float) -> list[TriangleSurface]:
    corner = (rear + 0.2, half - 0.2)
    return [add_mirror_image(tube([(*corner, z), (*corner, z + 0.2)], 0.09, sides=10))]


def _build_slats(rear: float, bay: float, half: float, top: float) -> list[TriangleSurface]:
    heights = np.linspace(1.1, top - 0.1, 9)
    middles = rear + 0.03 + bay * (np.arange(4) + 0.5)
    places = [(x, half + 0.017, z) for x in middles for z in heights]
    return [add_mirror_image(rectangles(places, (0.11 - bay / 2, 0, 0), (0, 0, 0.006)))]


def _build_chassis(length: float, half: float) -> list[MeshPart]:
    beam = box((-length / 2 + 0.05, -0.45, 0.5), (length / 2 - 0.3, 0.45, 0.86))
    guard = box(
        (-length / 2 + 0.36 * length, -half + 0.05, 0.45), (0.12 * length, half - 0.05, 0.86)
    )
    bumper = box((-length / 2 + 0.03, -half + 0.1, 0.42), (-length / 2 + 0.13, half - 0.1, 0.56))
    return make_vehicle_parts("black_plastic", beam, guard, bumper)


def build_rear_lamps(blueprint_id: str, rear: float, half: float, z: float) -> list[MeshPart]:
    """Build tail and brake lamps, indicators and the number plate at height `z`."""
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
        *build_truck_axle(front, half - 0.01, radius, 0.30, is_steered=True),
        *build_truck_axle(rear, half - 0.02, radius, 0.58),
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
        add_mirror_image(box((x - 0.05, 0.31, 0.82 * height), (x + 0.05, 0.41, high)))
        for x in np.linspace(rear + 0.4, front - 0.3, 4)
    ]
    return [*rails, *rungs, *posts]
