"""Builds parts common to vehicles of several classes: wheels and indicators."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from advercity.geometry.arrays import Float64Array
from advercity.geometry.mesh import (
    Mesh,
    MeshLayer,
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
SPOKE_COUNT = 10
"""Spokes of two-wheelers; a wheel looks the same after a turn by one of them."""
INDICATOR_GLASS = "lamp_amber"
INDICATOR_MATERIALS = {1: f"{INDICATOR_GLASS}_left", -1: f"{INDICATOR_GLASS}_right"}
"""Materials of indicators on the left (y > 0) and on the right: the sides blink separately."""
_INDICATOR_HALF_SIZE_M = np.array([0.05, 0.045, 0.035])
_INDICATOR_INSET_M = 0.035
"""Distance of an added indicator behind the front of its lens."""
_OUTER_FRACTION = 0.75
"""Lateral position of the vertices for placing an indicator, as a fraction of the lens's."""
_MIN_LATERAL_M = 0.09

WheelBuilder = Callable[[Float64Array, float, float], list[MeshPart]]
"""Builds a left-hand wheel from the centre (3,) of its outer face, its radius and its width, m."""


def make_vehicle_parts(
    material: str, *surfaces: TriangleSurface, wheel: Wheel | None = None
) -> list[MeshPart]:
    """Make parts of the semantic class of vehicles from surfaces of one material."""
    return [MeshPart(surface, material, Semantic.VEHICLE, wheel) for surface in surfaces]


def set_layer(layer: MeshLayer, parts: Iterable[MeshPart]) -> list[MeshPart]:
    """Set the layer of parts of a body."""
    return [replace(part, layer=layer) for part in parts]


def build_alloy_wheel(face: Float64Array, radius_m: float, width_m: float) -> list[MeshPart]:
    """Build tyre, rim and spokes of a left-hand wheel around the centre (3,) of its outer face."""
    radius = np.array([0.66, 0.93, 1.0, 1.0, 0.8]) * radius_m
    y = -np.array([0.10, 0.0, 0.14, 0.86, 1.0]) * width_m
    tyre = revolve_profile(np.column_stack([radius, y]), face, sides=_WHEEL_SIDES)
    ring = np.array([(0.70, -0.06), (0.62, -0.01), (0.60, -0.10)]) * (radius_m, width_m)
    rim = revolve_closed_profile(ring, face, sides=_WHEEL_SIDES)
    star = _compute_spoke_outline() * radius_m
    sides = [star - xyz(y=0.12 * width_m), star - xyz(y=0.02 * width_m)]
    spokes = loft_rings(np.stack(sides) + face)
    return [*make_vehicle_parts("rubber", tyre), *make_vehicle_parts("metal", rim, spokes)]


def build_axle(
    x_m: float,
    outer_y_m: float,
    radius_m: float,
    width_m: float,
    *,
    is_steered: bool = False,
    build_wheel: WheelBuilder = build_alloy_wheel,
) -> list[MeshPart]:
    """Build the two wheels of an axle, on the ground, with outer faces at `outer_y_m`.

    Steered wheels turn about their own centres, the others about the centre of the axle.
    """
    middle_m = outer_y_m - width_m / 2 if is_steered else 0.0
    left, right = (
        Wheel((x_m, sign * middle_m, radius_m), is_steered=is_steered) for sign in (1.0, -1.0)
    )
    return [
        side
        for part in build_wheel(xyz(x_m, outer_y_m, radius_m), radius_m, width_m)
        for side in (
            replace(part, wheel=left),
            replace(part, surface=mirror_surface(part.surface), wheel=right),
        )
    ]


def _compute_spoke_outline() -> Float64Array:
    """Outline (3 spokes, 3) in the plane of a rim: two corners at each tip, one in between."""
    middle = 2 * np.pi * np.arange(_RIM_SPOKES)[:, None] / _RIM_SPOKES
    angle = (middle + np.array([-0.17, 0.17, np.pi / _RIM_SPOKES])).ravel()
    radius = np.tile([0.62, 0.62, 0.22], _RIM_SPOKES)
    return np.column_stack([radius * np.cos(angle), np.zeros(len(angle)), radius * np.sin(angle)])


def build_round_tyre(hub: Float64Array, radius_m: float, half_width_m: float) -> TriangleSurface:
    """Build a tyre of round cross-section, as on two-wheelers."""
    angle = 2 * np.pi * np.arange(6) / 6
    profile = np.column_stack(
        [radius_m - half_width_m + half_width_m * np.cos(angle), half_width_m * np.sin(angle)]
    )
    return revolve_closed_profile(profile, hub, sides=20)


def build_spokes(hub: Float64Array, radius_m: float) -> list[TriangleSurface]:
    """Build the axle and the spokes of a two-wheeler's wheel."""
    angle = 2 * np.pi * np.arange(SPOKE_COUNT // 2) / SPOKE_COUNT
    arms = np.column_stack([np.cos(angle), np.zeros(len(angle)), np.sin(angle)]) * 0.95 * radius_m
    axle = tube([hub - xyz(0, 0.05, 0), hub + xyz(0, 0.05, 0)], 0.03, sides=6)
    return [axle, *(tube([hub - arm, hub + arm], 0.006, sides=3) for arm in arms)]


def compute_rolling_transforms(hub: Float64Array, turns: Float64Array) -> Float64Array:
    """Compute transforms (n, 3, 4) of a wheel rolling forward about its hub (3,) by turns (n,)."""
    angle = 2 * np.pi * turns
    cosine, sine = np.cos(angle), np.sin(angle)
    zero, one = np.zeros_like(angle), np.ones_like(angle)
    rows = [cosine, zero, sine, zero, one, zero, -sine, zero, cosine]
    turn = np.stack(rows, axis=-1).reshape(-1, 3, 3)
    return np.concatenate([turn, (hub - turn @ hub)[..., None]], axis=-1)


def add_indicators(parts: Sequence[Mesh]) -> tuple[Mesh, ...]:
    """Give a vehicle an indicator at each corner.

    Amber glass on the body is split into left and right. Without any, small lenses
    are added at the outer ends of the white glass in front and of the red glass behind.
    """
    amber = [part for part in parts if part.material == INDICATOR_GLASS]
    if not amber:
        return (*parts, *build_meshes(list(_build_indicators(parts))))
    rest = [part for part in parts if part.material != INDICATOR_GLASS]
    return (*rest, *(side for part in amber for side in _split_by_side(part)))


def _split_by_side(part: Mesh) -> Iterator[Mesh]:
    """Split a mesh into its triangles on the left and on the right."""
    middle = part.vertices[part.triangles][..., 1].mean(axis=1)
    for left, material in INDICATOR_MATERIALS.items():
        triangles = part.triangles[(middle >= 0) == (left > 0)]
        if len(triangles):
            name = f"{part.name}_{material}"
            yield replace(part, name=name, triangles=triangles, material=material)


def _build_indicators(parts: Sequence[Mesh]) -> Iterator[MeshPart]:
    for glass, sign in (("lamp_white", 1.0), ("lamp_red", -1.0)):
        corners = [
            part.vertices[np.unique(part.triangles)] for part in parts if part.material == glass
        ]
        if not corners:
            continue
        points = np.concatenate(corners).astype(np.float64)
        lateral = np.abs(points[:, 1])
        outer = points[lateral >= _OUTER_FRACTION * lateral.max()]
        x = (outer[:, 0] * sign).max() * sign
        near = outer[np.abs(outer[:, 0] - x) < _INDICATOR_HALF_SIZE_M[0]]
        y, z = np.abs(near[:, 1:]).mean(axis=0)
        place = np.array([x - sign * _INDICATOR_INSET_M, max(y, _MIN_LATERAL_M), z])
        for left, material in INDICATOR_MATERIALS.items():
            middle = place * (1, left, 1)
            lens = box(middle - _INDICATOR_HALF_SIZE_M, middle + _INDICATOR_HALF_SIZE_M)
            yield from make_vehicle_parts(material, lens)
