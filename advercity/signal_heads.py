"""Heads of traffic lights: where their lenses are, for vehicles and for pedestrians."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from advercity.frames import Signal

GovernedTraffic = Literal["vehicles", "pedestrians"]


@dataclass(frozen=True)
class SignalHead:
    """The lenses of a head, one above the other.

    Attributes:
        drop_m: Height of its attachment above its middle. A roadside unit may be at this point of a
            mast, so housing and arm are well below it.
        face_m: Distance from the attachment ahead to the face of the head.
        lens_heights_m: Heights of their centres above the middle of the head, by signal.
        lens_radius_m: Radius of a lens (EN 12368 has 100 and 150 mm; a rim hides the rest).
    """

    drop_m: float
    face_m: float
    lens_heights_m: Mapping[Signal, float]
    lens_radius_m: float


SIGNAL_HEADS: Mapping[GovernedTraffic, SignalHead] = {
    "vehicles": SignalHead(
        0.85, 0.30, {Signal.RED: 0.31, Signal.YELLOW: 0.0, Signal.GREEN: -0.31}, 0.13
    ),
    "pedestrians": SignalHead(0.30, 0.24, {Signal.RED: 0.12, Signal.GREEN: -0.12}, 0.09),
}
