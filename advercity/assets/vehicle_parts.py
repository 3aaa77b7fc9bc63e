"""Road wheels of cars, vans and trucks.

Wheels of bicycles and motorcycles.

Glasses of indicators, left and right apart, since they blink apart.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import (
    Mesh,
    MeshPart,
    TriangleSurface,
    Wheel,
    build_meshes,
    mirror_surface,
    xyz,
)
from advercity.geometry.primitives import (
    box,
    loft_rings,
    revolve_closed_profile,
    revolve_profile,
    tube,
)
from advercity.semantics import Semantic

_WHEEL_SIDES = 16
_RIM_SPOKES = 5


def build_axle(
    x_m: float, outer_y_m: float, radius_m: float, width_m: float, *, is_steered: bool = False
) -> list[MeshPart]:
    """The two wheels of an axle; they stand on the ground, outer faces at `outer_y_m`.

    Those that steer turn about their own middles, the others about the middle of their axle.
    """
    left = _build_road_wheel(xyz(x_m, outer_y_m, radius_m), radius_m, width_m)
    middle_m = outer_y_m - width_m / 2 if is_steered else 0.0
    return [
        MeshPart(
            side, material, Semantic.VEHICLE, Wheel((x_m, sign * middle_m, radius_m), is_steered)
        )
        for surface, material in left
        for side, sign in ((surface, 1.0), (mirror_surface(surface), -1.0))
    ]


def _build_road_wheel(
    face: Float64Array, radius_m: float, width_m: float
) -> list[tuple[TriangleSurface, str]]:
    """A left-hand wheel around the middle of its outer face: tyre, and rim with spokes."""
    radius = np.array([0.66, 0.93, 1.0, 1.0, 0.8]) * radius_m
    y = -np.array([0.10, 0.0, 0.14, 0.86, 1.0]) * width_m
    tyre = revolve_profile(np.column_stack([radius, y]), face, sides=_WHEEL_SIDES)
    ring = np.array([(0.70, -0.06), (0.62, -0.01), (0.60, -0.10)]) * (radius_m, width_m)
    rim = revolve_closed_profile(ring, face, sides=_WHEEL_SIDES)
    star = _compute_spoke_outline() * radius_m
    spokes = loft_rings(
        np.stack([star - xyz(y=0.12 * width_m), star - xyz(y=0.02 * width_m)]) + face
    )
    return [(tyre, "rubber"), (rim, "metal"), (spokes, "metal")]


def _compute_spoke_outline() -> Float64Array:
    """Outline (3 spokes, 3) in the plane of a rim: two corners at each tip, one between."""
    middle = 2 * np.pi * np.arange(_RIM_SPOKES)[:, None] / _RIM_SPOKES
    angle = (middle + np.array([-0.17, 0.17, np.pi / _RIM_SPOKES])).ravel()
    reach = np.tile([0.62, 0.62, 0.22], _RIM_SPOKES)
    return np.column_stack([reach * np.cos(angle), np.zeros(len(angle)), reach * np.sin(angle)])


SPOKE_COUNT = 10
"""All look alike: a wheel that turns by a tenth looks the same."""


def build_round_tyre(hub: Float64Array, radius_m: float, half_width_m: float) -> TriangleSurface:
    """A round tyre that stands on the ground."""
    angle = 2 * np.pi * np.arange(6) / 6
    profile = np.column_stack(
        [radius_m - half_width_m + half_width_m * np.cos(angle), half_width_m * np.sin(angle)]
    )
    return revolve_closed_profile(profile, hub, sides=20)


def build_spokes(hub: Float64Array, radius_m: float) -> list[TriangleSurface]:
    """Axle and spokes."""
    angle = 2 * np.pi * np.arange(SPOKE_COUNT // 2) / SPOKE_COUNT
    along = np.column_stack([np.cos(angle), np.zeros(len(angle)), np.sin(angle)]) * 0.95 * radius_m
    axle = tube([hub - xyz(0, 0.05, 0), hub + xyz(0, 0.05, 0)], 0.03, sides=6)
    return [axle, *(tube([hub - arm, hub + arm], 0.006, sides=3) for arm in along)]


INDICATOR_GLASS = "lamp_amber"
INDICATOR_MATERIALS = {1: f"{INDICATOR_GLASS}_left", -1: f"{INDICATOR_GLASS}_right"}
"""Materials of the glasses on the left (y > 0) and on the right."""
_INDICATOR_HALF_SIZE_M = np.array([0.05, 0.045, 0.035])
_INDICATOR_INSET_M = 0.035
"""From the front of the glass that they are put into."""
_OUTER_FRACTION = 0.75
"""Of how far out a glass reaches: where they are put."""
_MIN_LATERAL_M = 0.09


def add_indicators(parts: Sequence[Mesh]) -> tuple[Mesh, ...]:
    """The parts of a vehicle with an indicator at each corner.

    Amber glass that is there already is told apart by its side; without any, small glasses are put
    at the outer ends of the white glass in front and of the red glass behind.
    """
    there = [part for part in parts if part.material == INDICATOR_GLASS]
    rest = [part for part in parts if part.material != INDICATOR_GLASS]
    if there:
        return (*rest, *(side for part in there for side in _split_by_side(part)))
    return (*rest, *build_meshes(list(_build_indicators(parts))))


def _split_by_side(part: Mesh) -> Iterator[Mesh]:
    """The triangles of each side, as meshes of their own."""
    middle = part.vertices[part.triangles][..., 1].mean(axis=1)
    for left, material in INDICATOR_MATERIALS.items():
        own = part.triangles[(middle >= 0) == (left > 0)]
        if len(own):
            yield replace(part, name=f"{part.name}_{material}", triangles=own, material=material)


def _build_indicators(parts: Sequence[Mesh]) -> Iterator[MeshPart]:
    for glass, ahead in (("lamp_white", 1.0), ("lamp_red", -1.0)):
        corners = [
            part.vertices[np.unique(part.triangles)] for part in parts if part.material == glass
        ]
        if not corners:
            continue
        points = np.concatenate(corners).astype(np.float64)
        aside = np.abs(points[:, 1])
        outer = points[aside >= _OUTER_FRACTION * aside.max()]
        x = (outer[:, 0] * ahead).max() * ahead
        y, z = np.abs(outer[np.abs(outer[:, 0] - x) < _INDICATOR_HALF_SIZE_M[0]][:, 1:]).mean(
            axis=0
        )
        place = np.array([x - ahead * _INDICATOR_INSET_M, max(y, _MIN_LATERAL_M), z])
        for left, material in INDICATOR_MATERIALS.items():
            middle = place * (1, left, 1)
            yield MeshPart(
                box(middle - _INDICATOR_HALF_SIZE_M, middle + _INDICATOR_HALF_SIZE_M),
                material,
                Semantic.VEHICLE,
            )
