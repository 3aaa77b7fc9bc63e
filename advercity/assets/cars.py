"""Builds cars and vans: a lofted shell with wheel wells, a lofted cabin on it, and their trim."""

import numpy as np

from advercity.assets.car_shell import (
    MINIBUS_PROPORTIONS,
    PANEL_VAN_PROPORTIONS,
    CarProportions,
    CarShell,
    choose_car_proportions,
)
from advercity.assets.car_trim import build_trim
from advercity.assets.vehicle_parts import build_axle, make_vehicle_parts
from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import MeshPart, Size, split_surface
from advercity.geometry.primitives import box, loft_rings
from advercity.materials import ACTOR_PAINT
from advercity.randomness import create_generator


def build_car(blueprint_id: str, size: Size) -> list[MeshPart]:
    """Build a car of about `size`, x forward, on the ground."""
    length, width, height = size
    kind = choose_car_proportions(length, height)
    if "police" not in blueprint_id:
        return _build_motor_car(blueprint_id, size, kind)
    lower = (length, width, height - 0.10)
    return _build_motor_car(blueprint_id, lower, kind) + _build_light_bar(kind, size)


def build_van(blueprint_id: str, size: Size) -> list[MeshPart]:
    """Build a minibus, or a panel van if it is high."""
    kind = PANEL_VAN_PROPORTIONS if size[2] > 2.3 else MINIBUS_PROPORTIONS
    return _build_motor_car(blueprint_id, size, kind)


def _build_motor_car(blueprint_id: str, size: Size, kind: CarProportions) -> list[MeshPart]:
    """Build a car of given proportions; the size of its wheels varies with the blueprint."""
    length, width, height = size
    factor = create_generator("car", blueprint_id).uniform(0.97, 1.03)
    radius = min(kind.wheel_m, 0.13 * length) * factor
    shell = CarShell(kind, length, 0.455 * width, height, radius)
    front, rear = (shell.x_at(station) for station in kind.axles)
    outer, wide = shell.half - 0.012, 0.27 * shell.half
    return [
        *shell.build_pieces(),
        *_build_cabin(shell),
        *build_trim(blueprint_id, shell, width),
        *build_axle(front, outer, radius, wide, is_steered=True),
        *build_axle(rear, outer, radius, wide),
    ]


def _build_cabin(shell: CarShell) -> list[MeshPart]:
    foot, top, back_top, back_foot = shell.kind.cabin
    belt_half = 0.90 * shell.half
    roof_half = shell.kind.roof_width * shell.half
    pillar = shell.kind.pillar
    base = _compute_cabin_outline(shell, foot, back_foot, pillar, belt_half)
    base[:, 2] = shell.deck_height_at(0.5 - base[:, 0] / shell.length) - 0.03
    eaves = _compute_cabin_outline(shell, top, back_top, pillar, roof_half)
    eaves[:, 2] = 0.955 * shell.height
    centre = eaves.mean(axis=0)
    upper = centre + (eaves - centre) * (0.965, 0.93, 1)
    upper[:, 2] = 0.985 * shell.height
    crest = centre + (eaves - centre) * (0.86, 0.66, 1)
    crest[:, 2] = shell.height
    rows = [base + fraction * (eaves - base) for fraction in (0.0, 0.13, 0.93)]
    surface = loft_rings(np.stack([*rows, eaves, upper, crest]))
    points = len(base)
    column = np.tile(np.arange(points), 5)
    row = np.repeat(np.arange(5), points)
    rear = shell.kind.side_window_count > 1
    side = [True, False, True, False, rear, False, rear]
    pane = np.array([*side, *side[::-1]])
    post = np.isin(column, (3, points - 1 - 3)) & rear
    kinds = np.zeros(len(surface.triangles), dtype=np.int64)
    kinds[: 2 * len(row)] = np.repeat(
        np.where(row == 1, np.select([pane[column], post], [1, 2]), 0), 2
    )
    return [
        part
        for kind, name in enumerate((ACTOR_PAINT, "glass", "black_plastic"))
        for part in make_vehicle_parts(name, split_surface(surface, kinds == kind)[0])
    ]


def _compute_cabin_outline(
    shell: CarShell, front: float, rear: float, pillar: float, half: float
) -> Float64Array:
    """Compute the plan (14, 3) of the cabin, from the front centre over the left; z is 0."""
    bow = 0.018 * shell.length
    x0, x1, xb = shell.x_at(front), shell.x_at(rear), shell.x_at(pillar)
    post = 0.009 * shell.length
    left = [(x0, 0.82 * half), (x0 - 1.3 * bow, half), (xb + post, half * 1.01)]
    left += [(xb - post, half * 1.01), (x1 + 2.6 * bow, half), (x1, 0.84 * half)]
    outline = [(x0 + bow, 0.0), *left, (x1 - 0.6 * bow, 0.0), *((x, -y) for x, y in left[::-1])]
    return np.column_stack([np.asarray(outline), np.zeros(len(outline))])


def _build_light_bar(kind: CarProportions, size: Size) -> list[MeshPart]:
    length, width, height = size
    x = length * (0.5 - (kind.cabin[1] + kind.cabin[2]) / 2)
    low, half = height - 0.12, 0.27 * width
    red, blue = (
        box((x - 0.12, y0, low), (x + 0.12, y1, height))
        for y0, y1 in ((0.02, half), (-half, -0.02))
    )
    return [*make_vehicle_parts("sign_red", red), *make_vehicle_parts("car_paint_blue", blue)]
