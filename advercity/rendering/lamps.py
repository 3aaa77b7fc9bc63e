"""Lamps that light the scene at night: of streets, signals and vehicles."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from advercity_dsl import ActorClass
from numpy.typing import NDArray

from advercity.poses import transform
from advercity.traffic.trace import ActorState, Frame, Lamp, Signal
from advercity.weather.atmosphere import Colour
from advercity.world.scene import SignalLamp, StreetLamp, World

Floats = NDArray[np.floating[Any]]

LED: Colour = (1.39, 0.94, 0.50)
"""4000 K in linear sRGB of luminance 1."""
HALOGEN: Colour = (1.68, 0.87, 0.33)
RED: Colour = (4.60, 0.03, 0.0)
AMBER: Colour = (2.30, 0.72, 0.0)
SIGNAL_COLOURS: dict[Signal, Colour] = {
    Signal.RED: RED,
    Signal.YELLOW: AMBER,
    Signal.GREEN: (0.0, 1.30, 0.90),
}
LOW_BEAM_CD: dict[ActorClass, float] = {
    "car": 40e3,
    "van": 40e3,
    "truck": 40e3,
    "motorcycle": 20e3,
    "bicycle": 1e3,
}
"""Peak of the dipped beams of a vehicle together (UN R112 class B, R113)."""
BRAKE_CD, TAIL_CD, SIGNAL_CD = 300.0, 16.0, 400.0
REAR_FOG_CD, FRONT_INDICATOR_CD, REAR_INDICATOR_CD = 200.0, 300.0, 200.0
"""Rear fog lamps together, indicators each (UN R148 allows 150-300, 175-1000 and 50-500)."""
FRONT_FOG_CD = 8e3
"""Peak of both front fog lamps together; an engineering value, a fifth of the dipped beams."""
FOG_LAMP_HEIGHT_M, FOG_LAMP_TILT_RAD = 0.40, np.radians(1.5)
"""Their light ends lower than that of dipped beams."""
LAMP_SPREAD, BEAM_SPREAD = 0.4, 0.35
"""How far rear lamps and indicators, and dipped beams, are from the middle, in widths."""
LENS_FALLS = 1.0 - np.cos(np.radians(12.0))
"""How fast light of a lens falls off its axis."""
TWO_WHEELED: tuple[ActorClass, ...] = ("bicycle", "motorcycle")
LAMP_HEIGHT_M, CLEAR_OF_BODY_M = 0.65, 0.1
HIDING_GAP_M, HIDDEN_BEHIND_M = 12.0, 6.0
"""Who is closer ahead than that hides a beam; how far behind its rear the light still reaches."""
LENS_SPACING_M = 0.31
LENS_AHEAD_M = 0.02
"""Of the lens that the world's own mesh of a signal has."""


class Kind(IntEnum):
    """How a lamp spreads its light."""

    STREET = 0
    LOW_BEAM = 1
    LENS = 2
    FOG_BEAM = 3


@dataclass(frozen=True)
class LitLamp:
    """One source of light."""

    kind: Kind
    position: tuple[float, ...]
    facing: tuple[float, ...]
    intensity_cd: float
    colour: Colour
    open_m: float = np.inf
    """How far ahead nothing stands in its way."""


def lit_lamps(world: World, frame: Frame) -> list[LitLamp]:
    """Everything that shines in a frame by night."""
    return [
        *(_street(lamp) for lamp in world.street_lamps),
        *(_signal(lamp, frame.signals[lamp.id]) for lamp in world.signal_lamps),
        *(
            lamp
            for state, open_m in zip(frame.states, open_ahead(frame.states), strict=True)
            for lamp in _vehicle(state, open_m)
        ),
    ]


def _street(lamp: StreetLamp) -> LitLamp:
    """Straight down with the cosine of the angle, so that the flux is pi times the peak."""
    return LitLamp(Kind.STREET, lamp.position, (0.0, 0.0, -1.0), lamp.flux_lm / np.pi, LED)


def _signal(lamp: SignalLamp, shown: Signal) -> LitLamp:
    facing = (*lamp.facing, 0.0)
    ahead, _, up = signal_lens(shown)
    position = np.add(lamp.position, np.multiply(facing, ahead + CLEAR_OF_BODY_M))
    position[2] += up
    return LitLamp(Kind.LENS, tuple(position), facing, SIGNAL_CD, SIGNAL_COLOURS[shown])


def open_ahead(states: Sequence[ActorState]) -> NDArray[np.float64]:
    """How far (n,) in metres each actor's beams shine before another hides most of the rest."""
    if not states:
        return np.empty(0)
    pose = np.stack([state.world_from_body for state in states])
    length, width, _ = np.array([state.actor.size for state in states]).T
    away = pose[None, :, :2, 3] - pose[:, None, :2, 3]
    ahead = np.einsum("ijk,ik->ij", away, pose[:, :2, 0])
    aside = np.abs(np.einsum("ijk,ik->ij", away, pose[:, :2, 1]))
    gap = ahead - (length[:, None] + length[None]) / 2.0
    hides = (ahead > 0.0) & (aside < width[None] / 2.0) & (gap < HIDING_GAP_M)
    return np.where(hides, np.maximum(gap, 0.0) + HIDDEN_BEHIND_M, np.inf).min(axis=1)


def _vehicle(state: ActorState, open_m: float) -> Iterator[LitLamp]:
    pose, length = state.world_from_body, state.actor.size[0]
    ahead = pose[:3, 0]
    reach = length / 2.0 + CLEAR_OF_BODY_M
    rear = transform(pose, [-reach, 0.0, LAMP_HEIGHT_M])
    sides = (0.0,) if state.actor.actor_class in TWO_WHEELED else (1.0, -1.0)
    beam_cd = LOW_BEAM_CD.get(state.actor.actor_class, 0.0) / len(sides)
    if Lamp.LOW_BEAM in state.lamps and beam_cd > 0.0:
        for left in sides:
            y = left * BEAM_SPREAD * state.actor.size[1]
            front = tuple(transform(pose, [reach, y, LAMP_HEIGHT_M]))
            yield LitLamp(Kind.LOW_BEAM, front, tuple(ahead), beam_cd, HALOGEN, open_m)
    if Lamp.FOG in state.lamps:
        low = tuple(transform(pose, [reach, 0.0, FOG_LAMP_HEIGHT_M]))
        down = np.cos(FOG_LAMP_TILT_RAD) * ahead - np.sin(FOG_LAMP_TILT_RAD) * pose[:3, 2]
        yield LitLamp(Kind.FOG_BEAM, low, tuple(down), FRONT_FOG_CD, HALOGEN, open_m)
    if state.lamps & (Lamp.BRAKE | Lamp.LOW_BEAM | Lamp.FOG):
        rear_cd = BRAKE_CD if Lamp.BRAKE in state.lamps else TAIL_CD
        rear_cd += REAR_FOG_CD if Lamp.FOG in state.lamps else 0.0
        for left in sides:
            aside = left * LAMP_SPREAD * state.actor.size[1] * pose[:3, 1]
            yield LitLamp(Kind.LENS, tuple(rear + aside), tuple(-ahead), rear_cd / len(sides), RED)
    yield from _indicators(state, reach)


def _indicators(state: ActorState, reach_m: float) -> Iterator[LitLamp]:
    pose, ahead = state.world_from_body, state.world_from_body[:3, 0]
    for lamp, left in ((Lamp.LEFT, 1.0), (Lamp.RIGHT, -1.0)):
        if lamp in state.lamps:
            y = left * LAMP_SPREAD * state.actor.size[1]
            front, rear = (
                tuple(transform(pose, [x, y, LAMP_HEIGHT_M])) for x in (reach_m, -reach_m)
            )
            yield LitLamp(Kind.LENS, front, tuple(ahead), FRONT_INDICATOR_CD, AMBER)
            yield LitLamp(Kind.LENS, rear, tuple(-ahead), REAR_INDICATOR_CD, AMBER)


def signal_lens(signal: Signal) -> tuple[float, float, float]:
    """Where the lens of a signal is in the frame of its `SignalLamp`, metres."""
    return LENS_AHEAD_M, 0.0, LENS_SPACING_M * (Signal.YELLOW - signal)


def beam_share(facing: Floats, rays: Floats) -> Floats:
    """Of its peak, what a dipped beam for right-hand traffic sends along unit rays (..., n, 3).

    The cut-off line is level to the left and rises by 15 degrees to the right.

    Args:
        facing: (..., 3) unit, along the beam's axis.
        rays: (..., n, 3) unit, away from the lamp.
    """
    h, v = _off_axis(facing, rays)
    over = v + 0.57 - np.clip(0.27 * h, 0.0, 2.07)
    share = 0.018 + 0.982 / (1.0 + np.exp(np.minimum(over / 0.12, 80.0)))
    share *= np.where(over < 0.0, np.exp(-(((over + 1.0) / 3.5) ** 2)), 1.0)
    share *= np.where(v > 0.0, np.exp(-((v / 15.0) ** 2)), 1.0)
    ahead = np.abs(h) < 90.0
    return np.where(ahead, share * np.exp(-(((h - 1.0) / 12.0) ** 2) / 2.0), 0.0)


def fog_beam_share(facing: Floats, rays: Floats) -> Floats:
    """Of its peak, what a front fog lamp sends along unit rays (..., n, 3).

    Wide, and cut off level at its axis (UN R149, class F3). Arguments as of `beam_share`.
    """
    h, v = _off_axis(facing, rays)
    share = 0.018 + 0.982 / (1.0 + np.exp(np.minimum(v / 0.2, 80.0)))
    share *= np.where(v < 0.0, np.exp(-(((v + 1.0) / 3.5) ** 2)), np.exp(-((v / 15.0) ** 2)))
    return np.where(np.abs(h) < 90.0, share * np.exp(-((h / 20.0) ** 2) / 2.0), 0.0)


def _off_axis(facing: Floats, rays: Floats) -> tuple[Floats, Floats]:
    """Angles (..., n) in degrees of rays to the right of a beam's axis and above it."""
    right = np.stack([facing[..., 1], -facing[..., 0], np.zeros_like(facing[..., 0])], axis=-1)
    right /= np.linalg.norm(right, axis=-1, keepdims=True)
    axes = np.stack([facing, right, np.cross(right, facing)], axis=-1)
    forward, aside, up = np.moveaxis(rays @ axes, -1, 0)
    return np.degrees(np.arctan2(aside, forward)), np.degrees(np.arcsin(np.clip(up, -1.0, 1.0)))


BEAMS = {Kind.LOW_BEAM: beam_share, Kind.FOG_BEAM: fog_beam_share}


def lens_share(cosine: Floats) -> Floats:
    """Of its peak, what a rear lamp, an indicator or a signal sends at an angle to its axis.

    0.5 at 10 degrees, 0.2 at 20 and 0.03 at 45: between what UN R148 asks of vehicles' lamps (0.2
    at 10 degrees, 0.1 at 20) and what EN 12368 asks of wide signals.
    """
    sideways = (1.0 + 1.0 / LENS_FALLS) ** -1.25
    share = (1.0 + (1.0 - np.maximum(cosine, 0.0)) / LENS_FALLS) ** -1.25
    return (share - sideways) / (1.0 - sideways)


def intensity_towards(lamps: Sequence[LitLamp], rays: Floats) -> Floats:
    """Luminous intensity (m, n) in cd of m lamps along unit rays (m, n, 3) away from each."""
    found = np.empty(rays.shape[:2], rays.dtype)
    kinds = np.array([lamp.kind for lamp in lamps])
    facing = np.array([lamp.facing for lamp in lamps], rays.dtype)
    for kind in set(kinds.tolist()):
        one = np.flatnonzero(kinds == kind)
        if kind in BEAMS:
            found[one] = BEAMS[kind](facing[one], rays[one])
        else:
            cosine = np.maximum((rays[one] @ facing[one][..., None])[..., 0], 0.0)
            found[one] = lens_share(cosine) if kind == Kind.LENS else cosine
    return found * np.array([lamp.intensity_cd for lamp in lamps], rays.dtype)[:, None]
