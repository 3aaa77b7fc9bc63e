"""advercity.physics.lamp_beams."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from advercity.geometry.arrays import FloatArray
from advercity.physics.photometry import Colour

LENS_FALLOFF = 1.0 - np.cos(np.radians(12.0))
"""How fast light of a lens falls off its axis."""


class LampPattern(IntEnum):
    """How a lamp spreads its light."""

    STREET = 0
    LOW_BEAM = 1
    LENS = 2
    FOG_BEAM = 3


@dataclass(frozen=True)
class LightSource:
    """One source of light."""

    pattern: LampPattern
    position: tuple[float, ...]
    facing: tuple[float, ...]
    intensity_cd: float
    colour: Colour
    unobstructed_m: float = np.inf
    """How far ahead nothing stands in its way."""


def low_beam_pattern(facing: FloatArray, rays: FloatArray) -> FloatArray:
    """Of its peak, what a dipped beam for right-hand traffic sends along unit rays (..., n, 3).

    The cut-off line is level to the left and rises by 15 degrees to the right.

    Args:
        facing: (..., 3) unit, along the beam's axis.
        rays: (..., n, 3) unit, away from the lamp.
    """
    h, v = _angles_off_axis_deg(facing, rays)
    over = v + 0.57 - np.clip(0.27 * h, 0.0, 2.07)
    share = 0.018 + 0.982 / (1.0 + np.exp(np.minimum(over / 0.12, 80.0)))
    share *= np.where(over < 0.0, np.exp(-(((over + 1.0) / 3.5) ** 2)), 1.0)
    share *= np.where(v > 0.0, np.exp(-((v / 15.0) ** 2)), 1.0)
    ahead = np.abs(h) < 90.0
    return np.where(ahead, share * np.exp(-(((h - 1.0) / 12.0) ** 2) / 2.0), 0.0)


def fog_beam_pattern(facing: FloatArray, rays: FloatArray) -> FloatArray:
    """Of its peak, what a front fog lamp sends along unit rays (..., n, 3).

    Wide, and cut off level at its axis (UN R149, class F3). Arguments as of `beam_share`.
    """
    h, v = _angles_off_axis_deg(facing, rays)
    share = 0.018 + 0.982 / (1.0 + np.exp(np.minimum(v / 0.2, 80.0)))
    share *= np.where(v < 0.0, np.exp(-(((v + 1.0) / 3.5) ** 2)), np.exp(-((v / 15.0) ** 2)))
    return np.where(np.abs(h) < 90.0, share * np.exp(-((h / 20.0) ** 2) / 2.0), 0.0)


def _angles_off_axis_deg(facing: FloatArray, rays: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Angles (..., n) in degrees of rays to the right of a beam's axis and above it."""
    right = np.stack([facing[..., 1], -facing[..., 0], np.zeros_like(facing[..., 0])], axis=-1)
    right /= np.linalg.norm(right, axis=-1, keepdims=True)
    axes = np.stack([facing, right, np.cross(right, facing)], axis=-1)
    forward, aside, up = np.moveaxis(rays @ axes, -1, 0)
    return np.degrees(np.arctan2(aside, forward)), np.degrees(np.arcsin(np.clip(up, -1.0, 1.0)))


BEAM_PATTERNS = {LampPattern.LOW_BEAM: low_beam_pattern, LampPattern.FOG_BEAM: fog_beam_pattern}


def lens_pattern(cosine: FloatArray) -> FloatArray:
    """Of its peak, what a rear lamp, an indicator or a signal sends at an angle to its axis.

    0.5 at 10 degrees, 0.2 at 20 and 0.03 at 45: between what UN R148 asks of vehicles' lamps (0.2
    at 10 degrees, 0.1 at 20) and what EN 12368 asks of wide signals.
    """
    sideways = (1.0 + 1.0 / LENS_FALLOFF) ** -1.25
    share = (1.0 + (1.0 - np.maximum(cosine, 0.0)) / LENS_FALLOFF) ** -1.25
    return (share - sideways) / (1.0 - sideways)


def intensity_towards(lamps: Sequence[LightSource], rays: FloatArray) -> FloatArray:
    """Luminous intensity (m, n) in cd of m lamps along unit rays (m, n, 3) away from each."""
    found = np.empty(rays.shape[:2], rays.dtype)
    kinds = np.array([lamp.pattern for lamp in lamps])
    facing = np.array([lamp.facing for lamp in lamps], rays.dtype)
    for kind in set(kinds.tolist()):
        one = np.flatnonzero(kinds == kind)
        if kind in BEAM_PATTERNS:
            found[one] = BEAM_PATTERNS[kind](facing[one], rays[one])
        else:
            cosine = np.maximum((rays[one] @ facing[one][..., None])[..., 0], 0.0)
            found[one] = lens_pattern(cosine) if kind == LampPattern.LENS else cosine
    return found * np.array([lamp.intensity_cd for lamp in lamps], rays.dtype)[:, None]
