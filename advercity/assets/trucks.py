"""Builds trucks: a cab-over with a box body, and a fire truck."""

from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from advercity.assets.car_forms import CAB
from advercity.assets.car_surface import CarSurface
from advercity.assets.cars import build_body_on_wheels
from advercity.assets.lettering import WritingPlane, build_number_plate, fit_height, write_text
from advercity.assets.vehicle_parts import build_axle, make_vehicle_parts
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
from advercity.randomness import create_generator

_HAULIERS = "BREAD DAILY", "FJELL GLASS", "MOVING HOME", "QUICK PARCELS", "RIVER PAPER", "SOFA HAUL"
_MIN_CARGO_M3 = 8.0
"""Volume above which a white box of a truck's model is its cargo box."""
_BOX_TRIANGLES = 12


class _CabPlace(NamedTuple):
    """Where a cab is: x of its ends and of its axle, half of its width, heights and mirrors."""

    front: float
    behind: float
    half: float
    height: float
    width: float
    axle_x: float
    wheel_m: float


class _CargoBox(NamedTuple):
    """Where a cargo box is: x of its ends, half of its width, heights of floor and roof."""

    rear: float
    front: float
    side: float
    low: float
    high: float


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
    cargo = _CargoBox(rear, behind - 0.06, side, 0.75, height)
    walls = box((rear, -side, cargo.low), (cargo.front, side, height))
    return [
        *_build_cab(blueprint_id, cab, ACTOR_PAINT),
        *make_vehicle_parts("car_paint_white", walls),
        *_build_cargo_trim(blueprint_id, cargo),
        *_build_chassis(length, half),
        *_build_rear_lamps(blueprint_id, rear, half, 0.6),
        *_build_axles((cab.axle_x, -length / 2 + 0.24 * length), half, cab.wheel_m),
    ]


def _build_fire_truck(blueprint_id: str, size: Size) -> list[MeshPart]:
    length, width, height = size
    front, half, roof = length / 2, width / 2 - 0.16, 0.86 * height
    rear, top = -length / 2, 0.86 * height - 0.7
    cab = _CabPlace(front, front - 2.3, half, roof, width, front - 1.45, 0.50)
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
        *_build_cab(blueprint_id, cab, "car_paint_red"),
        *make_vehicle_parts("car_paint_red", body),
        *make_vehicle_parts("metal", *shutters, *_build_ladder(rear, front - 1.3, height)),
        *make_vehicle_parts("black_plastic", *_build_slats(rear, bay, half, top)),
        *_build_pump_bay(rear, half, top),
        *make_vehicle_parts("car_paint_white", stripe),
        *make_vehicle_parts("car_paint_blue", bar, *_build_beacons(rear, half, 0.96 * roof)),
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


def build_model_cargo_trim(blueprint_id: str, parts: Iterable[MeshPart]) -> list[MeshPart]:
    """Build doors, frame and lettering of a truck's model whose cargo box is a plain box."""
    trim: list[MeshPart] = []
    for part in parts:
        vertices = part.surface.vertices
        low, high = vertices.min(axis=0).tolist(), vertices.max(axis=0).tolist()
        is_plain = len(part.surface.triangles) <= _BOX_TRIANGLES
        is_large = np.prod(np.subtract(high, low)) > _MIN_CARGO_M3
        if part.material == "car_paint_white" and is_plain and is_large:
            cargo = _CargoBox(low[0], high[0], high[1], low[2], high[2])
            trim += _build_cargo_trim(blueprint_id, cargo)
    return trim


def _build_cargo_trim(blueprint_id: str, cargo: _CargoBox) -> list[MeshPart]:
    """Build what is on a cargo box: frame, doors, and the haulier's name on a stripe."""
    rear, front, side, low, _ = cargo
    out = side + 0.01
    stripe = box((rear + 0.3, -out, low + 0.5), (front - 0.34, out, low + 0.95))
    return [
        *make_vehicle_parts(ACTOR_PAINT, stripe),
        *_build_lettering(
            blueprint_id, (rear + front - 0.04) / 2, out, low + 0.725, 0.85 * (front - rear - 0.64)
        ),
        *_build_cargo_frame(cargo),
        *_build_cargo_doors(cargo),
    ]


def _build_cargo_frame(cargo: _CargoBox) -> list[MeshPart]:
    """Build the metal edges of a cargo box, and the rails along its flanks."""
    rear, front, side, low, high = cargo
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


def _build_cargo_doors(cargo: _CargoBox) -> list[MeshPart]:
    """Build two rear doors: the rubber seal around them, locking bars, handles and hinges."""
    rear, _, side, low, high = cargo
    seals = [
        *_build_outline(rear - 0.006, (side - 0.1, low + 0.12, high - 0.1), 0.05),
        box((rear - 0.006, -0.03, low + 0.1), (rear + 0.02, 0.03, high - 0.1)),
    ]
    # Contour markings of UN Regulation 104.
    markings = _build_outline(rear - 0.016, (side - 0.03, low + 0.04, high - 0.03), 0.05)
    bars = [
        tube([(rear - 0.022, y, low + 0.05), (rear - 0.022, y, high - 0.05)], 0.02, sides=6)
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
        *make_vehicle_parts("black_plastic", *seals),
        *make_vehicle_parts("sign_red", *markings),
        *make_vehicle_parts("metal", *map(add_mirror_image, (*bars, *handles, *hinges))),
    ]


def _build_outline(
    x: float, edges: tuple[float, float, float], wide: float
) -> list[TriangleSurface]:
    """Build a band that faces behind, along edges: half its width, its lower and upper height."""
    half, low, high = edges
    uprights = [(x, y, (low + high) / 2) for y in (-half, half)]
    levels = [(x, 0, z) for z in (low, high)]
    return [
        rectangles(uprights, (0, -wide / 2, 0), (0, 0, (high - low) / 2)),
        rectangles(levels, (0, -half, 0), (0, 0, wide / 2)),
    ]


def _build_lettering(
    blueprint_id: str, x: float, side: float, z: float, length_m: float
) -> list[MeshPart]:
    """Write the name of a fictional haulier on both flanks, no longer than a length."""
    name = str(create_generator("haulier", blueprint_id).choice(_HAULIERS))
    height_m = fit_height(name, 0.26, length_m)
    texts = [
        write_text(name, WritingPlane((x, sign * side, z), (-sign, 0, 0)), height_m)
        for sign in (1.0, -1.0)
    ]
    return make_vehicle_parts("car_paint_white", *texts)


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
    """Build two beacons at the rear corners of a roof."""
    corner = (rear + 0.2, half - 0.2)
    return [add_mirror_image(tube([(*corner, z), (*corner, z + 0.2)], 0.09, sides=10))]


def _build_slats(rear: float, bay: float, half: float, top: float) -> list[TriangleSurface]:
    """Build the shadow lines between the slats of roller shutters."""
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
        add_mirror_image(box((x - 0.05, 0.31, 0.82 * height), (x + 0.05, 0.41, high)))
        for x in np.linspace(rear + 0.4, front - 0.3, 4)
    ]
    return [*rails, *rungs, *posts]
