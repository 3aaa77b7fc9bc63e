"""Semi-trailers of articulated lorries: SUMO's vehicle is the whole, the trace has two actors."""

import math
from dataclasses import dataclass

import numpy as np
from advercity_dsl import Spec

from advercity.errors import InputError
from advercity.frames import Actor
from advercity.roads.network_file import SumoLane
from advercity.traffic.paints import draw_paint

SEMITRAILER_ID_OFFSET = 100_000
"""Added to the id of a tractor unit for a unique id."""


@dataclass(frozen=True)
class TowedTrailer:
    """A semi-trailer behind its tractor unit.

    Attributes:
        actor: The semi-trailer.
        fifth_wheel_m: Distance of the coupling behind the front of the tractor unit.
        kingpin_m: Distance of the coupling behind the front of the semi-trailer.
        wheelbase_m: Distance of the middle of its axles behind the coupling.
    """

    actor: Actor
    fifth_wheel_m: float
    kingpin_m: float
    wheelbase_m: float

    @property
    def lorry_length_m(self) -> float:
        """Length of tractor unit and semi-trailer in line."""
        return self.fifth_wheel_m + self.actor.size[0] - self.kingpin_m

    @property
    def axles_behind_front_m(self) -> float:
        """Distance of the middle of the semi-trailer's axles behind the lorry's front, in line."""
        return self.fifth_wheel_m + self.wheelbase_m

    def find_start_heading(self, lane: SumoLane, front_m: float) -> float:
        """Find its heading in rad in a lane, with the lorry's front at `front_m`.

        Coupling and axles are over the middle of the lane, also in a bend.
        """
        stations = np.maximum(
            front_m - np.array([self.axles_behind_front_m, self.fifth_wheel_m]), 0
        )
        behind, ahead = (lane.line.points_at(station)[:2] for station in stations)
        return math.atan2(*(ahead - behind)[::-1])


def build_towed_trailer(spec: Spec, tractor: Actor) -> TowedTrailer | None:
    """Build the semi-trailer of a tractor unit; None for other vehicles.

    Raises:
        InputError: Its blueprint is not in the spec, or is no semi-trailer.
    """
    coupling = spec.blueprints[tractor.blueprint].tows
    if coupling is None:
        return None
    blueprint = spec.blueprints.get(coupling.trailer)
    if blueprint is None or blueprint.semitrailer is None:
        raise InputError(
            f"blueprint '{tractor.blueprint}' tows '{coupling.trailer}', which is no semi-trailer"
            " of the spec"
        )
    number = SEMITRAILER_ID_OFFSET + tractor.id
    paint = draw_paint("truck", spec.seeds.traffic, number, paints=blueprint.paints)
    return TowedTrailer(
        actor=Actor.from_blueprint(number, coupling.trailer, blueprint, paint, towed_by=tractor.id),
        fifth_wheel_m=coupling.behind_front_m,
        kingpin_m=blueprint.semitrailer.kingpin_m,
        wheelbase_m=blueprint.semitrailer.wheelbase_m,
    )
