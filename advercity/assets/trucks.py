"""Builds trucks: a cab-over with a box body, and a fire truck."""

import numpy as np
from numpy.typing import ArrayLike

from advercity.assets.lettering import WritingPlane, build_number_plate, write_text
from advercity.assets.vehicle_parts import build_axle, make_vehicle_parts
from advercity.geometry.mesh import MeshPart, Size, TriangleSurface, add_mirror_image, xyz
from advercity.geometry.primitives import box, loft_rings, plate, tube
from advercity.materials import ACTOR_PAINT

WELL_RADII = 1.15
"""Radius of a wheel well in radii of the wheel."""


def build_truck(blueprint_id: str, size: Size) -> list[MeshPart]:
    """Build a truck of about `size`, x forward; `fire` in the name makes it a fire truck."""
    build = _build_fire_truck if "fire" in blueprint_id else _build_box_truck
    return build(blueprint_id, size)


def _build_box_truck(blueprint_id: str, size: Size) -> list[MeshPart]:
    length, width, height = size
    front, half = length / 2, width / 2 - 0.14
    behind = front - 0.31 * length
    rear, side = -length / 2, width / 2 - 0.06
    cargo = box((rear, -side, 0.75), (behind - 0.06, side, height))
    stripe = box((rear + 0.3, -side - 0.01, 1.25), (behind - 0.4, side + 0.01, 1.7))
    return [
        *_build_cab(blueprint_id, front, behind, half, 0.94 * height, ACTOR_PAINT),
        *make_vehicle_parts("car_paint_white", cargo),
        *make_vehicle_parts(ACTOR_PAINT, stripe),
        *_build_lettering((rear + behind - 0.1) / 2, side + 0.01, 1.475),
        *_build_cargo_frame((rear, behind - 0.06), side, (0.75, height)),
        *_build_cargo_doors(rear, side, (0.75, height)),
        *_build_chassis(length, half),
        *_build_mirrors(front - 0.12, half, width / 2, 0.66 * height),
        *_build_rear_lamps(blueprint_id, rear, half, 0.6),
        *_build_axles((front - 0.17 * length, -length / 2 + 0.24 * length), half, 0.42),
    ]


def _build_fire_truck(blueprint_id: str, size: Size) -> list[MeshPart]:
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
    door = _build_side_windows(front - 1.75, front - 2.75, 0.54 * roof, 0.86 * roof, half)
    bar = box((front - 1.0, -0.8 * half, roof - 0.02), (front - 0.7, 0.8 * half, roof + 0.2))
    return [
        *_build_cab(blueprint_id, front, behind, half, roof, "car_paint_red"),
        *make_vehicle_parts("car_paint_red", body),
        *make_vehicle_parts("metal", *shutters, *_build_ladder(rear, front - 1.3, height)),
        *make_vehicle_parts("black_plastic", *_build_slats(rear, bay, half)),
        *make_vehicle_parts("paint_white", stripe),
        *make_vehicle_parts("glass", door),
        *make_vehicle_parts("car_paint_blue", bar),
        *_build_chassis(length, half),
        *_build_mirrors(front - 0.15, half, width / 2, 0.66 * roof),
        *_build_rear_lamps(blueprint_id, rear, half, 0.95),
        *_build_axles((front - 1.45, rear + 2.1), half, 0.50),
    ]


def _build_cab(
    blueprint_id: str, front: float, behind: float, half: float, height: float, paint: str
) -> list[MeshPart]:
    """Build a cab-over with windows, doors, steps, wipers, headlamps and a black bumper."""
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
    rear_edge = min(front - 1.25, behind + 0.25)
    panes = _build_side_windows(front - 0.28, rear_edge, sill, 0.9 * height, half)
    lamp = add_mirror_image(box((front - 0.1, half - 0.5, 0.68), (front + 0.01, half - 0.1, 0.88)))
    grille = box((front - 0.1, -half + 0.6, 0.7), (front + 0.012, half - 0.6, sill - 0.22))
    bumper = box((front - 0.3, -half - 0.01, 0.38), (front + 0.02, half + 0.01, 0.62))
    bars = [
        box((front - 0.05, 0.62 - half, z - 0.012), (front + 0.02, half - 0.62, z + 0.012))
        for z in np.linspace(0.7, sill - 0.22, 5)[1:-1]
    ]
    wipers = [
        tube(
            [low + xyz(0.03, y, 0.04), low + 0.2 * lean + xyz(0.03, y - 0.55, 0.0)], 0.009, sides=4
        )
        for y in (0.75 * half, 0.05 * half)
    ]
    return [
        *make_vehicle_parts(paint, shell),
        *make_vehicle_parts("black_plastic", *wipers, *_build_cab_doors(front, behind, half, sill)),
        *make_vehicle_parts("chrome", *bars),
        *build_number_plate(blueprint_id, (front + 0.035, 0.0, 0.505), 1.0),
        *make_vehicle_parts("glass", screen, panes),
        *make_vehicle_parts("lamp_white", lamp),
        *make_vehicle_parts("black_plastic", grille, bumper),
    ]


def _build_cab_doors(
    front: float, behind: float, half: float, sill: float
) -> list[TriangleSurface]:
    """Build the gaps of both doors of a cab, their handles, and the steps below them."""
    ahead, rear, low = front - 0.24, max(front - 1.3, behind + 0.2), 0.66
    outer = half + 0.005
    gaps = [box((x - 0.008, half - 0.02, low), (x + 0.008, outer, sill)) for x in (ahead, rear)]
    gaps.append(box((rear, half - 0.02, low), (ahead, outer, low + 0.014)))
    handle = box((rear + 0.06, half - 0.02, sill - 0.16), (rear + 0.24, half + 0.03, sill - 0.11))
    steps = [
        box((ahead - 0.6, half - 0.25, z), (ahead - 0.1, half + 0.006, z + 0.05))
        for z in (0.40, 0.58)
    ]
    return [add_mirror_image(part) for part in (*gaps, handle, *steps)]


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


def _build_side_windows(
    front: float, rear: float, bottom: float, top: float, half: float
) -> TriangleSurface:
    """Build a window with a raked front edge on either side, just outside the cab."""
    corners = [(rear, bottom), (rear, top), (front - 0.1, top), (front, bottom)]
    return add_mirror_image(plate([(x, half + 0.012, z) for x, z in corners], 0.02))


def _extrude_outline(outline: ArrayLike, half: float, bevel_m: float) -> TriangleSurface:
    """Extrude a side view (n, 2) of x and z across the width, with both edges bevelled."""
    flat = np.asarray(outline, dtype=np.float64)
    middle = (flat.min(axis=0) + flat.max(axis=0)) / 2
    inner = middle + (flat - middle) * (1 - 2 * bevel_m / np.ptp(flat, axis=0))
    sections = ((inner, -half), (flat, bevel_m - half), (flat, half - bevel_m), (inner, half))
    return loft_rings(np.stack([np.insert(profile, 1, y, axis=1) for profile, y in sections]))


def _build_chassis(length: float, half: float) -> list[MeshPart]:
    beam = box((-length / 2 + 0.05, -0.45, 0.5), (length / 2 - 0.3, 0.45, 0.86))
    guard = box(
        (-length / 2 + 0.36 * length, -half + 0.05, 0.45), (0.12 * length, half - 0.05, 0.86)
    )
    bumper = box((-length / 2 + 0.03, -half + 0.1, 0.42), (-length / 2 + 0.13, half - 0.1, 0.56))
    return make_vehicle_parts("black_plastic", beam, guard, bumper)


def _build_mirrors(x: float, half: float, outer: float, z: float) -> list[MeshPart]:
    arm = box((x - 0.03, half - 0.1, z + 0.25), (x + 0.03, outer - 0.02, z + 0.29))
    glass = box((x - 0.06, outer - 0.13, z - 0.12), (x + 0.04, outer, z + 0.32))
    return make_vehicle_parts("black_plastic", add_mirror_image(arm), add_mirror_image(glass))


def _build_rear_lamps(blueprint_id: str, rear: float, half: float, z: float) -> list[MeshPart]:
    lamps = add_mirror_image(
        box((rear - 0.005, half - 0.42, z), (rear + 0.15, half - 0.06, z + 0.16))
    )
    return [
        *make_vehicle_parts("lamp_red", lamps),
        *build_number_plate(blueprint_id, (rear - 0.01, 0.0, z + 0.06), -1.0),
    ]


def _build_axles(stations: tuple[float, float], half: float, radius: float) -> list[MeshPart]:
    """Build the wheels, the front ones before dark wheel wells in the flanks of the cab."""
    front, rear = stations
    angle = np.radians(np.linspace(0, 180, 13))
    x, z = front - WELL_RADII * radius * np.cos(angle), radius * (1 + WELL_RADII * np.sin(angle))
    well = plate(np.column_stack([x, np.full(len(x), half + 0.004), z]), 0.02)
    return [
        *make_vehicle_parts("black_plastic", add_mirror_image(well)),
        *build_axle(front, half + 0.02, radius, 0.30, is_steered=True),
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
