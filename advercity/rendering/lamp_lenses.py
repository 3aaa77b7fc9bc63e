"""Lenses of lamps: which materials they are, how bright they are lit, and those of signals."""

from enum import IntEnum

import numpy as np

from advercity.frames import Lamp, Signal
from advercity.geometry.mesh import Mesh
from advercity.rendering.light_sources import signal_lens_position
from advercity.semantics import Semantic


class LensKind(IntEnum):
    """Materials that shine when their lamp is lit; 0 is every other material."""

    LAMP_WHITE = 1
    LAMP_RED = 2
    SIGNAL_RED = 3
    SIGNAL_YELLOW = 4
    SIGNAL_GREEN = 5
    LAMP_AMBER_LEFT = 6
    LAMP_AMBER_RIGHT = 7


LENS_KINDS = {kind.name.lower(): kind for kind in LensKind}
"""Kinds by material."""
TAIL_LAMP_KCD_M2 = 1.2
"""Luminance of a red lens per albedo as a tail lamp, which is on with the low beam."""
LENS_KCD_M2 = {
    LensKind.LAMP_WHITE: 25.0,
    LensKind.LAMP_RED: 20.0,
    # 400 cd over the 0.053 m² of a signal's lens, by the luminance of its colour.
    LensKind.SIGNAL_RED: 139.0,
    LensKind.SIGNAL_YELLOW: 56.0,
    LensKind.SIGNAL_GREEN: 69.0,
    LensKind.LAMP_AMBER_LEFT: 40.0,
    LensKind.LAMP_AMBER_RIGHT: 40.0,
}
"""Luminance of a lit lens per albedo; of a red one as a brake or fog lamp."""
SNOWLESS_MATERIALS = frozenset({"glass", "rubber", "skin", *LENS_KINDS})
"""Materials that falling snow does not stay on; cloth, too, by its name."""
LENS_RADIUS_M, LENS_CORNERS = 0.13, 16
_LAMPS = {
    LensKind.LAMP_WHITE: Lamp.LOW_BEAM,
    LensKind.LAMP_RED: Lamp.BRAKE | Lamp.FOG,
    LensKind.LAMP_AMBER_LEFT: Lamp.LEFT,
    LensKind.LAMP_AMBER_RIGHT: Lamp.RIGHT,
}
_SIGNALS = {
    LensKind.SIGNAL_RED: Signal.RED,
    LensKind.SIGNAL_YELLOW: Signal.YELLOW,
    LensKind.SIGNAL_GREEN: Signal.GREEN,
}


def is_snowless(material: str) -> bool:
    """Whether falling snow does not stay on a material."""
    return material in SNOWLESS_MATERIALS or material.startswith("cloth_")


def compute_lens_luminances(lamps: Lamp, signal: Signal | None = None) -> list[float]:
    """Compute the luminance in kcd/m² per albedo of every kind of lens of a body, by its number.

    Args:
        lamps: Lit lamps of a vehicle.
        signal: What a traffic light shows.
    """
    luminances = [0.0] * (1 + len(LensKind))
    for kind, lamp in _LAMPS.items():
        luminances[kind] = LENS_KCD_M2[kind] if lamps & lamp else 0.0
    if lamps & Lamp.LOW_BEAM and not luminances[LensKind.LAMP_RED]:
        luminances[LensKind.LAMP_RED] = TAIL_LAMP_KCD_M2
    for kind, shown in _SIGNALS.items():
        luminances[kind] = LENS_KCD_M2[kind] if signal is shown else 0.0
    return luminances


def build_signal_lenses() -> tuple[Mesh, ...]:
    """Build the three lenses of a signal as discs that face along x; yellow is at the origin."""
    turn = np.arange(LENS_CORNERS) / LENS_CORNERS * 2.0 * np.pi
    disc = LENS_RADIUS_M * np.stack([np.zeros_like(turn), np.cos(turn), np.sin(turn)], axis=1)
    corners = np.arange(1, LENS_CORNERS - 1)
    fan = np.stack([np.zeros_like(corners), corners, corners + 1], axis=1).astype(np.int32)
    return tuple(
        Mesh(
            name=f"lens_{signal.name.lower()}",
            vertices=np.add(disc, signal_lens_position(signal), dtype=np.float32),
            triangles=fan,
            material=f"signal_{signal.name.lower()}",
            semantic=Semantic.TRAFFIC_LIGHT,
        )
        for signal in Signal
    )
