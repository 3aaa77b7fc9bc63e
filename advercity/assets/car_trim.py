"""Builds what is fixed to the shell of a car: plates, grille, mirrors, seams, wipers, cladding."""

import numpy as np

from advercity.assets.car_shell import ARCH_RADII, CarShell
from advercity.assets.lettering import build_number_plate
from advercity.assets.vehicle_parts import make_vehicle_parts
from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import (
    MeshPart,
    TriangleSurface,
    add_mirror_image,
    build_ribbon,
    move_surface,
    xyz,
)
from advercity.geometry.primitives import box, ellipsoid, tube
from advercity.materials import ACTOR_PAINT

SEAM_M = 0.010
"""Width of gaps between panels, with the shadow in them."""
SEAM_LIFT_M = 0.004
BONNET_EDGE, BOOT_EDGE = 0.80, 0.74
"""Edges of the lids as fractions of the half width."""
LATCHBACK_STATION = 0.93
"""Rear windows that end before this station have a boot lid behind them."""


def build_trim(blueprint_id: str, shell: CarShell, width: float) -> list[MeshPart]:
    """Build the trim of a car of a width, mirrors included."""
    return [
        *_build_front(blueprint_id, shell),
        *_build_rear(blueprint_id, shell),
        *_build_mirrors(shell, width),
        *_build_door_seams(shell),
        *_build_lid_seams(shell),
        *_build_wipers(shell),
        *(_build_roof_rails(shell) if shell.kind.has_roof_rails else []),
        *(_build_arch_cladding(shell) if shell.kind.has_roof_rails else []),
    ]


def _build_front(blueprint_id: str, shell: CarShell) -> list[MeshPart]:
    """Build grille with bars and badge, air intake, fog lamp recesses and number plate."""
    front, half, top = shell.x_at(0), shell.half, float(shell.deck_height_at(0))
    low, high = 0.86 * top, 0.96 * top
    grille = box((front - 0.05, -0.46 * half, low), (front + 0.006, 0.46 * half, high))
    bars = [
        box((front - 0.02, -0.45 * half, z - 0.004), (front + 0.014, 0.45 * half, z + 0.004))
        for z in np.linspace(low, high, 4)[1:]
    ]
    badge = ellipsoid((front + 0.006, 0.0, high), (0.016, 0.05, 0.04), sides=10, bands=4)
    intake = box((front - 0.05, -0.42 * half, 0.27), (front + 0.006, 0.42 * half, 0.335))
    recess = add_mirror_image(
        box((front - 0.08, 0.50 * half, 0.27), (front + 0.006, 0.68 * half, 0.36))
    )
    return [
        *make_vehicle_parts("black_plastic", grille, intake, recess),
        *make_vehicle_parts("chrome", *bars, badge),
        *build_number_plate(blueprint_id, (front + 0.02, 0.0, 0.45), 1.0),
    ]


def _build_rear(blueprint_id: str, shell: CarShell) -> list[MeshPart]:
    """Build the lower bumper, exhaust, handle and badge of the boot, and the number plate."""
    rear, half, height = shell.x_at(1), shell.half, shell.height
    plate_z = 0.36 * height + 0.075
    bumper = box((rear - 0.006, -0.62 * half, 0.31), (rear + 0.08, 0.62 * half, 0.42))
    handle = box((rear - 0.014, -0.30, plate_z + 0.065), (rear + 0.04, 0.30, plate_z + 0.095))
    exhaust = tube([(rear + 0.2, 0.5 * half, 0.27), (rear - 0.012, 0.5 * half, 0.27)], 0.032)
    badge = ellipsoid((rear, 0.0, plate_z + 0.15), (0.01, 0.04, 0.032), sides=10, bands=4)
    gaps = [] if shell.kind.side_window_count > 1 else [_build_rear_door_gap(shell)]
    return [
        *make_vehicle_parts("black_plastic", bumper, *gaps),
        *make_vehicle_parts("chrome", handle, exhaust, badge),
        *build_number_plate(blueprint_id, (rear - 0.018, 0.0, plate_z), -1.0),
    ]


def _build_rear_door_gap(shell: CarShell) -> TriangleSurface:
    """Build the gap between the two rear doors of a panel van."""
    _, _, back_top, back_foot = shell.kind.cabin
    bow = 0.6 * 0.018 * shell.length
    foot = (shell.x_at(back_foot) - bow, 0.0, float(shell.deck_height_at(back_foot)))
    top = (shell.x_at(back_top) - bow, 0.0, 0.94 * shell.height)
    return tube(
        [(shell.x_at(1), 0.0, 0.45), (shell.x_at(1), 0.0, foot[2] - 0.1), foot, top], 0.008, sides=4
    )


def _build_mirrors(shell: CarShell, width: float) -> list[MeshPart]:
    """Build both mirrors: a cap in the car's paint with a glass behind, on an arm."""
    foot = shell.x_at(shell.kind.cabin[0]) - 0.10 * shell.length
    belt = float(shell.deck_height_at(0.3))
    y, z = width / 2 - 0.09, belt + 0.07
    arm = box((foot - 0.05, 0.8 * shell.half, belt), (foot, width / 2 - 0.04, belt + 0.04))
    cap = ellipsoid((foot, y, z), (0.055, 0.09, 0.07), sides=8, bands=4)
    glass = box((foot - 0.058, y - 0.065, z - 0.045), (foot - 0.03, y + 0.065, z + 0.045))
    return [
        *make_vehicle_parts("black_plastic", add_mirror_image(arm)),
        *make_vehicle_parts(ACTOR_PAINT, add_mirror_image(cap)),
        *make_vehicle_parts("chrome", add_mirror_image(glass)),
    ]


def _build_door_seams(shell: CarShell) -> list[MeshPart]:
    """Build the gaps between doors, and the door handles."""
    foot, _, _, back_foot = shell.kind.cabin
    behind = shell.kind.axles[1] - 1.3 * shell.wheel_m / shell.length
    doors = [foot + 0.03, shell.kind.pillar, min(behind, back_foot - 0.04)]
    low, outer = shell.kind.clearance_m + 0.10, shell.half + 0.003
    edges = [(shell.x_at(station), float(shell.deck_height_at(station))) for station in doors]
    seams = [box((x - 0.005, outer - 0.02, low), (x + 0.005, outer, 0.9 * z)) for x, z in edges]
    sill = box((edges[-1][0], outer - 0.02, low), (edges[0][0], outer, low + 0.008))
    handles = [
        box(
            (x + 0.06, outer - 0.02, 0.84 * z - 0.015),
            (x + 0.06 + 0.15, outer + 0.018, 0.84 * z + 0.015),
        )
        for x, z in edges[1:]
    ]
    return make_vehicle_parts("black_plastic", *map(add_mirror_image, (*seams, sill, *handles)))


def _build_lid_seams(shell: CarShell) -> list[MeshPart]:
    """Build the gaps around the bonnet, and around a boot lid."""
    foot, _, _, back_foot = shell.kind.cabin
    seams = [
        _build_seam_along(shell, 0.05, foot + 0.01, BONNET_EDGE),
        _build_seam_across(shell, 0.05, BONNET_EDGE),
    ]
    if back_foot < LATCHBACK_STATION:
        seams.append(_build_seam_along(shell, back_foot, 0.975, BOOT_EDGE))
    return make_vehicle_parts("black_plastic", *map(add_mirror_image, seams))


def _build_seam_along(
    shell: CarShell, first: float, last: float, fraction: float
) -> TriangleSurface:
    stations = shell.compute_stations()
    inner = stations[(stations > first) & (stations < last)]
    line = np.concatenate([[first], inner, [last]])
    spread = SEAM_M / 2 / shell.half
    left, right = (
        shell.locate_deck(line, np.full(len(line), fraction + side * spread)) for side in (-1, 1)
    )
    return move_surface(build_ribbon(left, right), xyz(z=SEAM_LIFT_M))


def _build_seam_across(shell: CarShell, station: float, fraction: float) -> TriangleSurface:
    across = np.linspace(0.0, fraction, 6)
    spread = SEAM_M / 2 / shell.length
    left, right = (
        shell.locate_deck(np.full(len(across), station + side * spread), across) for side in (1, -1)
    )
    return move_surface(build_ribbon(left, right), xyz(z=SEAM_LIFT_M))


def _build_wipers(shell: CarShell) -> list[MeshPart]:
    """Build two wipers that rest at the foot of the windscreen."""
    lines = [(0.62, -0.02), (0.04, -0.60)]
    arms = [
        tube(
            [_locate_on_screen(shell, hub, 0.10), _locate_on_screen(shell, tip, 0.17)],
            0.007,
            sides=4,
        )
        for hub, tip in lines
    ]
    return make_vehicle_parts("black_plastic", *arms)


def _locate_on_screen(shell: CarShell, across: float, rise: float) -> Float64Array:
    """Locate a point just in front of the windscreen, by fractions of half width and height."""
    foot, top, _, _ = shell.kind.cabin
    base_z, top_z = float(shell.deck_height_at(foot)) - 0.03, 0.955 * shell.height
    bow = 0.018 * shell.length * (1 - abs(across) / 0.82)
    low, high = (
        np.array([shell.x_at(station) + bow, 0.0, z])
        for station, z in ((foot, base_z), (top, top_z))
    )
    half = (0.90 + rise * (shell.kind.roof_width - 0.90)) * shell.half
    normal = np.array([top_z - base_z, 0.0, low[0] - high[0]])
    point = low + rise * (high - low) + 0.02 * normal / np.linalg.norm(normal)
    return point + xyz(y=across * half)


def _build_roof_rails(shell: CarShell) -> list[MeshPart]:
    """Build rails along the edges of the roof."""
    _, top, back_top, _ = shell.kind.cabin
    y, z = 0.88 * shell.kind.roof_width * shell.half, shell.height + 0.02
    ahead, behind = shell.x_at(top + 0.04), shell.x_at(back_top - 0.02)
    ends = [(ahead, y, z - 0.07), (ahead - 0.1, y, z), (behind + 0.1, y, z), (behind, y, z - 0.07)]
    return make_vehicle_parts("black_plastic", add_mirror_image(tube(ends, 0.02, sides=5)))


def _build_arch_cladding(shell: CarShell) -> list[MeshPart]:
    """Build black rings around the wheel arches."""
    radius = ARCH_RADII * shell.wheel_m + 0.02
    angle = np.radians(np.linspace(-8, 188, 10))
    rings = [
        tube(
            np.column_stack(
                [
                    shell.x_at(axle) + radius * np.cos(angle),
                    np.full(len(angle), shell.half - 0.012),
                    shell.wheel_m + radius * np.sin(angle),
                ]
            ),
            0.03,
            sides=4,
        )
        for axle in shell.kind.axles
    ]
    return make_vehicle_parts("black_plastic", *map(add_mirror_image, rings))
