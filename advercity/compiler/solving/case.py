"""A conflict at a road before it is solved, and the places that its solution finds."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from advercity_dsl import Conflict
from numpy.typing import NDArray

from advercity.compiler.solving.cast import Body, Casting
from advercity.compiler.solving.drive import EgoDrive


@dataclass(frozen=True, eq=False)
class Case:
    """What everybody's place follows from.

    Attributes:
        conflict: What to stage.
        index: Place among the scenario's conflicts, from 1.
        drive: Of the ego.
        casting: Draws who else takes part.
        actor: Whom the ego meets.
        drawn: The conflict's parameters by name with their unit.
    """

    conflict: Conflict
    index: int
    drive: EgoDrive
    casting: Casting
    actor: Body
    drawn: Mapping[str, float]

    @property
    def speed_m_s(self) -> float:
        """Of the actor, as drawn."""
        return self.drawn["actor_speed_km_h"] / 3.6


@dataclass(frozen=True, eq=False)
class Placed:
    """A way for an actor that meets the ego's.

    Attributes:
        station_m: On the ego's way, where both meet.
        room_m: From its start to the point.
        path: Points (n, 2) of a path of its own, or none.
        route: Streets of a route in lanes, or none.
        lane: Of its first street.
        start_m: Of its middle before the end of that street.
    """

    station_m: float
    room_m: float
    path: NDArray[np.float64] | None = None
    route: tuple[str, ...] = ()
    lane: int = 1
    start_m: float = 0.0
