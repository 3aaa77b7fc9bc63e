"""Trucks: a cab-over with a box body, and the fire truck."""

import numpy as np
from numpy.typing import ArrayLike

from advercity.assets.vehicle_parts import build_axle
from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import MeshPart, Size, TriangleSurface, add_mirror_image
from advercity.geometry.primitives import box, loft_rings, plate, tube
from advercity.materials import ACTOR_PAINT
from advercity.semantics import Semantic


def build_truck(blueprint_id: str, size: Size) -> list[MeshPart]:
    """Pieces of a truck of about `size`, x forward; a blueprint named so is a fire truck."""
    return _build_fire_truck(size) if "fire" in blueprint_id else _build_box_truck(size)


def _build_box_truck(size: Size) -> list[MeshPart]:
    length, width, height = size
    front, half = length / 2, width / 2 - 0.14
    behind = front - 0.31 * length
    cargo = box((-length / 2, -width / 2 + 0.06, 0.75), (behind - 0.06, width / 2 - 0.06, height))
    stripe = box(
        (-length / 2 + 0.3, -width / 2 + 0.05, 1.25), (behind - 0.4, width / 2 - 0.05, 1.7)
    )
    return [
        *_build_cab(front, behind, half, 0.94 * height, ACTOR_PAINT),
        *_make_vehicle_pieces("car_paint_white", cargo),
        *_make_vehicle_pieces(ACTOR_PAINT, stripe),
        *_build_chassis(length, half),
        *_build_mirrors(front - 0.12, half, width / 2, 0.66 * height),
        *_build_rear_lamps(-length / 2, half, 0.6),
        *_build_axles((front - 0.17 * length, -length / 2 + 0.24 * length), half, 0.42),
    ]


def _build_fire_truck(size: Size) -> list[MeshPart]:
    length, width, height = size
    front, half, roof = length / 2, width / 2 - 0.16, 0.80 * height
    behind = front - 0.36 * length
    rear = -length / 2
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
    door = add_mirror_image(
        plate(
            [
                (x, half + 0.012, z)
                for x, z in _compute_window_corners(
                    front - 1.75, front - 2.75, 0.54 * roof, 0.86 * roof
                )
            ],
            0.02,
        )
    )
    bar = box((front - 1.0, -0.8 * half, roof - 0.02), (front - 0.7, 0.8 * half, roof + 0.2))
    return [
        *_build_cab(front, behind, half, roof, "car_paint_red"),
        *_make_vehicle_pieces("car_paint_red", body),
        *_make_vehicle_pieces("metal", *shutters, *_build_ladder(rear, front - 1.3, height)),
        *_make_vehicle_pieces("paint_white", stripe),
        *_make_vehicle_pieces("glass", door),
        *_make_vehicle_pieces("car_paint_blue", bar),
        *_build_chassis(length, half),
        *_build_mirrors(front - 0.15, half, width / 2, 0.66 * roof),
        *_build_rear_lamps(rear, half, 0.95),
        *_build_axles((front - 1.45, rear + 2.1), half, 0.50),
    ]


def _make_vehicle_pieces(material: str, *surfaces: TriangleSurface) -> list[MeshPart]:
    return [MeshPart(surface, material, Semantic.VEHICLE) for surface in surfaces]


def _build_cab(
    front: float, behind: float, half: float, height: float, paint: str
) -> list[MeshPart]:
    """A cab-over with a raked windscreen, side windows, headlamps and a black bumper."""
    sill, brow = 0.52 * height, 0.93 * height
    rake = 0.10 * height
    outline = [(front - 0.03, 0.5), (front, 0.65), (front, sill - 0.06), (front - 0.03, sill)]
    outline += [(front - rake, brow), (front - rake - 0.12, height - 0.02)]
    outline += [(front - rake - 0.3, height), (behind, height), (behind, 0.5)]
    shell = _extrude_outline(outline, half, 0.07)
    lean = np.array([0.03 - rake, 0.0, brow - sill])
    out = 0.012 * np.array([lean[2], 0.0, -lean[0]]) / np.linalg.norm(lean)
    foot = np.array([front - 0.03, 0.0, sill]) + out
    low, high = foot + 0.06 * lean, foot + 0.93 * lean
    side = (0.0, half - 0.14, 0.0)
    screen = plate([low - side, low + side, high + side, high - side], 0.02)
    window = _compute_window_corners(
        front - 0.28, min(front - 1.25, behind + 0.25), sill, 0.9 * height
    )
    panes = add_mirror_image(plate([(x, half + 0.012, z) for x, z in window], 0.02))
    lamp = add_mirror_image(box((front - 0.1, half - 0.5, 0.68), (front + 0.01, half - 0.1, 0.88)))
    grille = box((front - 0.1, -half + 0.6, 0.7), (front + 0.012, half - 0.6, sill - 0.22))
    bumper = box((front - 0.3, -half - 0.01, 0.38), (front + 0.02, half + 0.01, 0.62))
    number = box((front - 0.1, -0.26, 0.45), (front + 0.03, 0.26, 0.56))
    return [
        *_make_vehicle_pieces(paint, shell),
        *_make_vehicle_pieces("glass", screen, panes),
        *_make_vehicle_pieces("lamp_white", lamp),
        *_make_vehicle_pieces("black_plastic", grille, bumper),
        *_make_vehicle_pieces("licence_plate", number),
    ]


def _compute_window_corners(
    x0: float, x1: float, bottom: float, top: float
) -> list[tuple[float, float]]:
    """Corners of a left-hand window from front to back, its front edge raked."""
    return [(x0, bottom), (x0 - 0.1, top), (x1, top), (x1, bottom)][::-1]


def _extrude_outline(outline: ArrayLike, half: float, bevel_m: float) -> TriangleSurface:
    """A side view (n, 2) of x and z drawn across the width, its two edges bevelled."""
    flat = np.asarray(outline, dtype=np.float64)
    middle = (flat.min(axis=0) + flat.max(axis=0)) / 2
    inner = middle + (flat - middle) * (1 - 2 * bevel_m / np.ptp(flat, axis=0))
    rings = [
        _lift_profile(profile, y)
        for profile, y in (
            (inner, -half),
            (flat, bevel_m - half),
            (flat, half - bevel_m),
            (inner, half),
        )
    ]
    return loft_rings(np.stack(rings))


def _lift_profile(profile: Float64Array, y: float) -> Float64Array:
    return np.column_stack([profile[:, 0], np.full(len(profile), y), profile[:, 1]])


def _build_chassis(length: float, half: float) -> list[MeshPart]:
    beam = box((-length / 2 + 0.05, -0.45, 0.5), (length / 2 - 0.3, 0.45, 0.86))
    guard = box(
        (-length / 2 + 0.36 * length, -half + 0.05, 0.45), (0.12 * length, half - 0.05, 0.86)
    )
    bumper = box((-length / 2 + 0.03, -half + 0.1, 0.42), (-length / 2 + 0.13, half - 0.1, 0.56))
    return _make_vehicle_pieces("black_plastic", beam, guard, bumper)


def _build_mirrors(x: float, half: float, outer: float, z: float) -> list[MeshPart]:
    arm = box((x - 0.03, half - 0.1, z + 0.25), (x + 0.03, outer - 0.02, z + 0.29))
    glass = box((x - 0.06, outer - 0.13, z - 0.12), (x + 0.04, outer, z + 0.32))
    return _make_vehicle_pieces("black_plastic", add_mirror_image(arm), add_mirror_image(glass))


def _build_rear_lamps(rear: float, half: float, z: float) -> list[MeshPart]:
    lamps = add_mirror_image(
        box((rear - 0.005, half - 0.42, z), (rear + 0.15, half - 0.06, z + 0.16))
    )
    number = box((rear - 0.005, -0.26, z), (rear + 0.1, 0.26, z + 0.12))
    return [
        *_make_vehicle_pieces("lamp_red", lamps),
        *_make_vehicle_pieces("licence_plate", number),
    ]


def _build_axles(stations: tuple[float, float], half: float, radius: float) -> list[MeshPart]:
    front, rear = stations
    return [
        *build_axle(front, half - 0.02, radius, 0.30, is_steered=True),
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
