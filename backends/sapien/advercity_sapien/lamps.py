"""Lamps that light the scene at night, as a row of the shaders' table.

A lamp is three texels: position and kind, direction, peak intensity in kcd.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from advercity_dsl import ActorClass
from numpy.typing import NDArray

from advercity.poses import transform
from advercity.rendering.backend import CameraView
from advercity.traffic.trace import ActorState, Frame, Lamp, Signal
from advercity.weather.atmosphere import Colour
from advercity.world.scene import SignalLamp, StreetLamp, World
from advercity_sapien.shapes import signal_lens
from advercity_sapien.tables import COLUMNS, KILO

MOST_LAMPS = 32
"""In one picture: those nearest to what the camera looks at."""
LOOKED_AT_M = 20.0

LED: Colour = (1.39, 0.94, 0.50)
"""4000 K in linear sRGB of luminance 1."""
HALOGEN: Colour = (1.68, 0.87, 0.33)
RED: Colour = (4.60, 0.03, 0.0)
SIGNAL_COLOURS: dict[Signal, Colour] = {
    Signal.RED: RED,
    Signal.YELLOW: (2.30, 0.72, 0.0),
    Signal.GREEN: (0.0, 1.30, 0.90),
}
LOW_BEAM_CD: dict[ActorClass, float] = {
    "car": 40e3,
    "van": 40e3,
    "truck": 40e3,
    "motorcycle": 20e3,
    "bicycle": 1e3,
}
"""Peak of all dipped beams of a vehicle together (UN R112 class B, R113)."""
BRAKE_CD, SIGNAL_CD = 300.0, 400.0
LAMP_HEIGHT_M, CLEAR_OF_BODY_M = 0.65, 0.1


class Kind(IntEnum):
    """How a lamp spreads its light, as in `lamps.glsl`."""

    STREET = 0
    LOW_BEAM = 1
    LENS = 2


@dataclass(frozen=True)
class LitLamp:
    """One source of light."""

    kind: Kind
    position: tuple[float, ...]
    facing: tuple[float, ...]
    intensity_cd: float
    colour: Colour


def lit_lamps(world: World, frame: Frame) -> list[LitLamp]:
    """Everything that shines in a frame by night."""
    return [
        *(_street(lamp) for lamp in world.street_lamps),
        *(_signal(lamp, frame.signals[lamp.id]) for lamp in world.signal_lamps),
        *(lamp for state in frame.states for lamp in _vehicle(state)),
    ]


def lamp_row(lamps: list[LitLamp], view: CameraView) -> NDArray[np.float32]:
    """The table's second row, (COLUMNS, 4), with the lamps that matter to a camera."""
    row = np.zeros((COLUMNS, 4), dtype=np.float32)
    if not lamps:
        return row
    looked_at = transform(view.world_from_camera, [LOOKED_AT_M, 0.0, 0.0])
    away_m = np.linalg.norm(np.array([lamp.position for lamp in lamps]) - looked_at, axis=1)
    order = np.argsort(away_m, kind="stable")[:MOST_LAMPS]
    row[0, 0] = len(order)
    for column, index in zip(range(1, COLUMNS, 3), order, strict=False):
        lamp = lamps[index]
        row[column] = *lamp.position, lamp.kind
        row[column + 1, :3] = lamp.facing
        row[column + 2, :3] = np.multiply(lamp.colour, lamp.intensity_cd * KILO)
    return row


def _street(lamp: StreetLamp) -> LitLamp:
    """Straight down with the cosine of the angle, so that the flux is pi times the peak."""
    return LitLamp(Kind.STREET, lamp.position, (0.0, 0.0, -1.0), lamp.flux_lm / np.pi, LED)


def _signal(lamp: SignalLamp, shown: Signal) -> LitLamp:
    facing = (*lamp.facing, 0.0)
    ahead, _, up = signal_lens(shown)
    position = np.add(lamp.position, np.multiply(facing, ahead + CLEAR_OF_BODY_M))
    position[2] += up
    return LitLamp(Kind.LENS, tuple(position), facing, SIGNAL_CD, SIGNAL_COLOURS[shown])


def _vehicle(state: ActorState) -> Iterator[LitLamp]:
    pose, length = state.world_from_body, state.actor.size[0]
    ahead = pose[:3, 0]
    reach = length / 2.0 + CLEAR_OF_BODY_M
    front = transform(pose, [reach, 0.0, LAMP_HEIGHT_M])
    rear = transform(pose, [-reach, 0.0, LAMP_HEIGHT_M])
    beam_cd = LOW_BEAM_CD.get(state.actor.actor_class, 0.0)
    if Lamp.LOW_BEAM in state.lamps and beam_cd > 0.0:
        yield LitLamp(Kind.LOW_BEAM, tuple(front), tuple(ahead), beam_cd, HALOGEN)
    # Tail lamps are seen, but too faint to light anything.
    if Lamp.BRAKE in state.lamps:
        yield LitLamp(Kind.LENS, tuple(rear), tuple(-ahead), BRAKE_CD, RED)
