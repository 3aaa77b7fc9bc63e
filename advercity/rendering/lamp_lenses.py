"""Luminous surfaces: lenses of lamps and signals, windows of lit rooms, and their luminance."""

from enum import IntEnum

import numpy as np
import shapely

from advercity.frames import Lamp, Signal
from advercity.geometry.mesh import (
    Mesh,
    TriangleSurface,
    extract_polygons,
    join_surfaces,
    triangulate_polygon,
)
from advercity.materials import MATERIALS
from advercity.physics.photometry import LUMINANCE_WEIGHTS
from advercity.rendering.light_sources import signal_lens_position
from advercity.semantics import Semantic
from advercity.signal_heads import SIGNAL_HEADS, GovernedTraffic


class LensKind(IntEnum):
    """Materials shining when their lamp is lit; 0 is every other material.

    Lamps of rooms are lit when street lamps are. Their windows are seen, and light nothing.
    """

    LAMP_WHITE = 1
    LAMP_RED = 2
    SIGNAL_RED = 3
    SIGNAL_YELLOW = 4
    SIGNAL_GREEN = 5
    LAMP_AMBER_LEFT = 6
    LAMP_AMBER_RIGHT = 7
    ROOM_WARM = 8
    ROOM_COOL = 9
    ROOM_SHOP = 10


LENS_COUNT = 1 + len(LensKind)
"""Number of kinds, including 0 for every other material."""
LENS_KINDS = {kind.name.lower(): kind for kind in LensKind}
"""Kinds by material."""
TAIL_LAMP_KCD_M2 = 1.2
"""Luminance of a red lens per albedo as a tail lamp, which is on with the low beam."""
WARM_CD_M2, COOL_CD_M2, SHOP_CD_M2 = 4.0, 8.0, 13.5
"""Luminance of windows from outside: walls reflecting half of 30 and 60 lx, assumptions for living
rooms and kitchens in the evening; in shops, shelves reflecting a third of 150 lx, half of the
300 lx on the floor (EN 12464-1, sales areas). Panes let 85 % through."""


def _per_albedo(luminance_cd_m2: float, material: str) -> float:
    """Luminance in kcd/m² per albedo of a material whose luminance is given."""
    return luminance_cd_m2 / 1e3 / float(np.dot(MATERIALS[material].albedo, LUMINANCE_WEIGHTS))


LENS_KCD_M2 = {
    LensKind.LAMP_WHITE: 25.0,
    LensKind.LAMP_RED: 20.0,
    # 400 cd over the 0.053 m² of a signal's lens, by the luminance of its colour.
    LensKind.SIGNAL_RED: 139.0,
    LensKind.SIGNAL_YELLOW: 56.0,
    LensKind.SIGNAL_GREEN: 69.0,
    LensKind.LAMP_AMBER_LEFT: 40.0,
    LensKind.LAMP_AMBER_RIGHT: 40.0,
    LensKind.ROOM_WARM: _per_albedo(WARM_CD_M2, "room_warm"),
    LensKind.ROOM_COOL: _per_albedo(COOL_CD_M2, "room_cool"),
    LensKind.ROOM_SHOP: _per_albedo(SHOP_CD_M2, "room_shop"),
}
"""Luminance of a lit lens per albedo; of a red one as a brake or fog lamp."""
SNOWLESS_MATERIALS = frozenset({"glass", "room_dark", "shop_dark", "rubber", "skin", *LENS_KINDS})
"""Materials without lying snow; cloth, too, by its name."""
LENS_CORNERS = 16
_STANDING_LIMBS = (
    ([(0.0, 0.28), (0.0, -0.1)], 0.18),
    ([(-0.24, 0.36), (-0.3, -0.14)], 0.08),
    ([(0.24, 0.36), (0.3, -0.14)], 0.08),
    ([(-0.1, -0.1), (-0.11, -0.8)], 0.1),
    ([(0.1, -0.1), (0.11, -0.8)], 0.1),
)
_WALKING_LIMBS = (
    ([(0.0, 0.28), (-0.03, -0.08)], 0.16),
    ([(0.05, 0.36), (0.33, 0.1), (0.5, 0.16)], 0.08),
    ([(-0.05, 0.36), (-0.28, 0.06), (-0.3, -0.12)], 0.08),
    ([(0.0, -0.12), (0.26, -0.4), (0.3, -0.8)], 0.1),
    ([(-0.04, -0.12), (-0.18, -0.46), (-0.48, -0.74)], 0.1),
)
"""Lines (y, z) of torso, arms and legs of figures in a lens of radius 1, and their half widths."""
_LAMPS = {
    LensKind.LAMP_WHITE: Lamp.LOW_BEAM,
    LensKind.LAMP_RED: Lamp.BRAKE | Lamp.FOG,
    LensKind.LAMP_AMBER_LEFT: Lamp.LEFT,
    LensKind.LAMP_AMBER_RIGHT: Lamp.RIGHT,
    **dict.fromkeys(
        (LensKind.ROOM_WARM, LensKind.ROOM_COOL, LensKind.ROOM_SHOP),
        Lamp.LOW_BEAM,
    ),
}
_SIGNALS = {
    LensKind.SIGNAL_RED: Signal.RED,
    LensKind.SIGNAL_YELLOW: Signal.YELLOW,
    LensKind.SIGNAL_GREEN: Signal.GREEN,
}


def is_snowless(material: str) -> bool:
    """Whether falling snow does not stay on a material."""
    return material in SNOWLESS_MATERIALS or material.startswith("cloth_")


def compute_lens_luminances(
    lamps: Lamp, signal: Signal | None = None, light_ratio: float = 1.0
) -> list[float]:
    """Compute the luminance in kcd/m² per albedo of every kind of lens of a body, by its number.

    Args:
        lamps: Lit lamps of a vehicle; for static objects, `LOW_BEAM` where street lamps are lit.
        signal: State of a traffic light.
        light_ratio: Light of tail lamps, or of the traffic light, relative to its mean.
    """
    luminances = [0.0] * LENS_COUNT
    for kind, lamp in _LAMPS.items():
        luminances[kind] = LENS_KCD_M2[kind] if lamps & lamp else 0.0
    if lamps & Lamp.LOW_BEAM and not luminances[LensKind.LAMP_RED]:
        luminances[LensKind.LAMP_RED] = light_ratio * TAIL_LAMP_KCD_M2
    for kind, shown in _SIGNALS.items():
        luminances[kind] = light_ratio * LENS_KCD_M2[kind] if signal is shown else 0.0
    return luminances


def build_signal_lenses(governs: GovernedTraffic) -> tuple[Mesh, ...]:
    """Build the lenses of a head, which face along x: discs, or figures for pedestrians."""
    head = SIGNAL_HEADS[governs]
    meshes: list[Mesh] = []
    for signal in head.lens_heights_m:
        shape = _build_disc() if governs == "vehicles" else _build_figure(signal)
        vertices = head.lens_radius_m * shape.vertices + signal_lens_position(governs, signal)
        colour = signal.name.lower()
        lens = TriangleSurface(vertices, shape.triangles)
        meshes.append(lens.to_mesh(f"lens_{colour}", f"signal_{colour}", Semantic.TRAFFIC_LIGHT))
    return tuple(meshes)


def _build_disc() -> TriangleSurface:
    turn = np.arange(LENS_CORNERS) / LENS_CORNERS * 2.0 * np.pi
    corners = np.arange(1, LENS_CORNERS - 1)
    fan = np.stack([np.zeros_like(corners), corners, corners + 1], axis=1)
    return TriangleSurface(np.column_stack([np.zeros_like(turn), np.cos(turn), np.sin(turn)]), fan)


def _build_figure(signal: Signal) -> TriangleSurface:
    """Build the figure of a pedestrian's signal in a disc of radius 1: it stands, or walks."""
    limbs = _STANDING_LIMBS if signal is Signal.RED else _WALKING_LIMBS
    parts = [shapely.LineString(line).buffer(radius, quad_segs=2) for line, radius in limbs]
    parts.append(shapely.Point(0.0, 0.72).buffer(0.18, quad_segs=3))
    pieces = [triangulate_polygon(part) for part in extract_polygons(shapely.union_all(parts))]
    return join_surfaces(
        TriangleSurface(np.column_stack([np.zeros(len(corners)), corners]), triangles)
        for corners, triangles in pieces
    )
