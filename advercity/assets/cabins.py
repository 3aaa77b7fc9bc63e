"""Builds the visible inside of vehicles: lining, seats, dashboard and driver."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from advercity.assets.vehicle_parts import make_vehicle_parts, set_layer
from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import (
    MeshLayer,
    MeshPart,
    TriangleSurface,
    add_mirror_image,
    keep_triangles,
    xyz,
)
from advercity.geometry.primitives import box, ellipsoid, loft_rings, tube
from advercity.randomness import create_generator

LINING = "upholstery"
_HEADROOM_M, _SEAT_BELOW_ROOF_M, _SEAT_PITCH_M = 0.24, 0.92, 0.86
"""Centre of a head and seats below the roof, and distance between rows of seats."""
_WALL_M = 0.005
_TIERS = np.array([(0.0, 0.92), (0.12, 1.0), (0.88, 1.0), (1.0, 0.9)])
"""Position along a cushion, and its width there as a fraction: its edges are rounded."""
_MIN_GLAZING_M, _OPEN_CABIN_M = 1.2, 1.7
"""Length of panes below which a car has only a windscreen, and length of the cabin then."""
_TAILGATE_M = 0.2
"""Distance of the inside from the rear end of the panes."""
_OWN_SEATS = 100
"""Least triangles of upholstery in a model with seats."""
_SHIRTS = ("cloth_white", "cloth_grey", "cloth_dark", "cloth_blue", "cloth_red", "cloth_light")
_SKINS, _HAIR = (
    ("skin", "skin", "skin_brown", "skin_dark"),
    ("hair_black", "hair_brown", "hair_grey"),
)


@dataclass(frozen=True)
class CabinSpace:
    """Room behind the windows of a vehicle, metres in the body frame.

    Attributes:
        front: x of the foot of the windscreen.
        rear: x of the rear end of the windows.
        half: Half of the width inside, at the height of the belt.
        belt: Height of the lower edge of the side windows.
        roof: Height of the ceiling.
        floor: Height of the floor.
        rows: Greatest number of rows of seats.
    """

    front: float
    rear: float
    half: float
    belt: float
    roof: float
    floor: float
    rows: int = 3

    @property
    def head(self) -> Float64Array:
        """Centre (3,) of the driver's head."""
        return xyz(self.seats_x[0] - 0.06, 0.46 * self.half, self.roof - _HEADROOM_M)

    @property
    def seats_x(self) -> list[float]:
        """Foremost edge of the backs of all rows of seats, from the front."""
        first = self.front - min(1.35, 0.60 * (self.front - self.rear))
        rows = 1 + int(max(0.0, first - self.rear - 0.12) / _SEAT_PITCH_M)
        return [first - _SEAT_PITCH_M * row for row in range(min(rows, self.rows))]


def build_cabin(blueprint_id: str, space: CabinSpace) -> list[MeshPart]:
    """Build the inside of a vehicle with its driver, who is not in parked ones."""
    low, high = xyz(space.rear, -space.half, space.floor), xyz(space.front, space.half, space.belt)
    tub, outside = _open_top(box(low, high)), _open_top(box(low - _WALL_M, high + _WALL_M))
    lining = TriangleSurface(tub.vertices, tub.triangles[:, ::-1])
    seats = [part for x in space.seats_x for part in _build_row(space, x)]
    steering_wheel = _build_steering_wheel(space.head + xyz(0.46, 0, -0.36))
    dashboard = _build_dashboard(space)
    parts = [
        *make_vehicle_parts(LINING, lining, *seats),
        *make_vehicle_parts("black_plastic", outside, dashboard, steering_wheel),
    ]
    driver = _build_driver(blueprint_id, space)
    return [*set_layer(MeshLayer.DETAIL, parts), *set_layer(MeshLayer.OCCUPANT, driver)]


def _open_top(surface: TriangleSurface) -> TriangleSurface:
    height = surface.vertices[surface.triangles][..., 2].min(axis=1)
    return keep_triangles(surface, height < surface.vertices[:, 2].max())


def build_model_cabin(
    blueprint_id: str, parts: Sequence[MeshPart], *, is_truck: bool
) -> list[MeshPart]:
    """Build the inside of a model: the model itself lacks most parts visible through panes."""
    panes = [part.surface for part in parts if part.material == "glass"]
    if not panes:
        return []
    space = _measure_space(panes, is_truck=is_truck)
    inside = build_cabin(blueprint_id, space)
    own = sum(len(part.surface.triangles) for part in parts if part.material == LINING)
    if own > _OWN_SEATS:
        return [part for part in inside if part.layer == MeshLayer.OCCUPANT]
    hidden = [part.surface for part in parts if part.material != "glass" and part.wheel is None]
    lining = [_line(surface, space) for surface in hidden]
    found = make_vehicle_parts(LINING, *(item for item in lining if item is not None))
    return [*inside, *set_layer(MeshLayer.DETAIL, found)]


def _measure_space(panes: Sequence[TriangleSurface], *, is_truck: bool) -> CabinSpace:
    """Measure the room behind panes; lamps and mirrors may be among them."""
    points = np.concatenate([pane.vertices[np.unique(pane.triangles)] for pane in panes])
    rear, front = np.quantile(points[:, 0], [0.1, 0.9])
    belt, top = np.quantile(points[:, 2], [0.1, 0.97])
    half = 0.95 * float(np.quantile(np.abs(points[:, 1]), 0.8))
    if is_truck:
        return CabinSpace(front, rear - 0.45, half, belt, top + 0.2, belt - 0.75, rows=1)
    is_open = front - rear < _MIN_GLAZING_M
    rear = front - _OPEN_CABIN_M if is_open else rear + _TAILGATE_M
    return CabinSpace(front, rear, half, belt, min(top, belt + 0.62), belt - 0.55)


def _line(surface: TriangleSurface, space: CabinSpace) -> TriangleSurface | None:
    """Build the inner side of the surface above the belt of a vehicle; None if there is none."""
    middle = surface.vertices[surface.triangles].mean(axis=1)
    above = (middle[:, 2] > space.belt) & (middle[:, 0] < space.front) & (middle[:, 0] > space.rear)
    if not above.any():
        return None
    return TriangleSurface(surface.vertices, surface.triangles[above][:, ::-1])


def _build_row(space: CabinSpace, x: float) -> Iterator[TriangleSurface]:
    y, wide = 0.46 * space.half, min(0.25, 0.40 * space.half)
    seat = max(space.floor + 0.12, space.roof - _SEAT_BELOW_ROOF_M)
    back_top = space.roof - 0.42
    foot, top = xyz(x, y, seat), xyz(x - 0.16, y, back_top)
    yield add_mirror_image(_build_cushion(foot, top, wide, xyz(-0.12)))
    yield add_mirror_image(_build_cushion(foot, foot + xyz(0.48, z=0.03), wide, xyz(z=-0.16)))
    rest = ellipsoid(top + xyz(-0.06, 0, 0.11), (0.045, 0.12, 0.09), sides=8, bands=4)
    yield add_mirror_image(rest)


def _build_cushion(
    start: Float64Array, end: Float64Array, half: float, depth: Float64Array
) -> TriangleSurface:
    """Build a cushion from start to end (3,), of half a width along y and a depth (3,)."""
    rings: list[Float64Array] = []
    for along, wide in _TIERS:
        middle, side = start + along * (end - start), xyz(y=half * wide)
        rings.append(
            np.array([middle - side, middle + side, middle + side + depth, middle - side + depth])
        )
    return loft_rings(np.stack(rings))


def _build_dashboard(space: CabinSpace) -> TriangleSurface:
    """Build the dashboard, whose top slopes from the windscreen to the instruments."""
    top, low, x = space.belt - 0.01, space.belt - 0.32, space.front
    profile = [
        (x, top - 0.03),
        (x - 0.30, top + 0.02),
        (x - 0.46, top - 0.05),
        (x - 0.40, low),
        (x, low),
    ]
    half = 0.97 * space.half
    return loft_rings([[(px, y, pz) for px, pz in profile] for y in (-half, half)])


def _build_steering_wheel(middle: Float64Array) -> TriangleSurface:
    """Build a steering wheel around its middle (3,), tilted towards the driver."""
    angle = np.linspace(0, 2 * np.pi, 13)
    across, up = xyz(y=0.18), 0.18 * xyz(0.42, 0, 0.91)
    rim = middle + np.outer(np.cos(angle), across) + np.outer(np.sin(angle), up)
    return tube(rim, 0.016, sides=5)


def _build_driver(blueprint_id: str, space: CabinSpace) -> list[MeshPart]:
    """Build a driver with both hands on the wheel; looks differ by blueprint."""
    draw = create_generator("driver", blueprint_id)
    shirt, skin, hair = (str(draw.choice(names)) for names in (_SHIRTS, _SKINS, _HAIR))
    head = space.head
    face = ellipsoid(head, (0.095, 0.075, 0.12), sides=12, bands=7)
    hood = ellipsoid(head + xyz(-0.022, 0, 0.03), (0.10, 0.083, 0.11), sides=12, bands=6)
    neck = tube([head - xyz(z=0.20), head - xyz(z=0.06)], 0.055, sides=8)
    shoulder = head + xyz(-0.02, 0.19, -0.27)
    elbow, hand = shoulder + xyz(0.14, 0.06, -0.24), head + xyz(0.43, 0.15, -0.34)
    sleeves = [_mirror_about(tube([shoulder, elbow, hand], [0.055, 0.045, 0.03], sides=8), head[1])]
    hands = [_mirror_about(ellipsoid(hand, (0.05, 0.035, 0.04), sides=8, bands=4), head[1])]
    return [
        *make_vehicle_parts(shirt, _build_trunk(head), *sleeves),
        *make_vehicle_parts(skin, face, neck, *hands),
        *make_vehicle_parts(hair, hood),
    ]


def _build_trunk(head: Float64Array) -> TriangleSurface:
    """Build the trunk below a head at (3,) by ellipses at heights below it."""
    sections: Sequence[tuple[float, float, float, float]] = (
        (-0.16, -0.02, 0.05, 0.06),
        (-0.20, -0.03, 0.08, 0.16),
        (-0.27, -0.03, 0.11, 0.215),
        (-0.42, -0.02, 0.13, 0.20),
        (-0.66, 0.02, 0.13, 0.17),
        (-0.76, 0.03, 0.14, 0.19),
    )
    angle = 2 * np.pi * np.arange(12) / 12
    rings = [
        head + np.column_stack([x + deep * np.cos(angle), wide * np.sin(angle), np.full(12, z)])
        for z, x, deep, wide in sections
    ]
    return loft_rings(np.stack(rings))


def _mirror_about(surface: TriangleSurface, y: float) -> TriangleSurface:
    """Add the mirror image of a surface about a plane of constant y."""
    shift = xyz(y=y)
    centred = add_mirror_image(replace(surface, vertices=surface.vertices - shift))
    return replace(centred, vertices=centred.vertices + shift)
