"""Whether whoever drives can stop within what they see."""

from dataclasses import dataclass
from math import isfinite

from advercity_dsl import Spec, Vehicle, Weather
from advercity_dsl.traffic import TyreFriction
from advercity_dsl.units import KM_H_PER_M_S

from advercity.physics.constants import GRAVITY_M_S2
from advercity.physics.extinction import compute_extinction


def friction_coefficient(grip: TyreFriction, weather: Weather) -> float:
    """Coefficient of friction where tyres roll: in the ruts, as wet and as snowy as they are."""
    bare = grip.dry + (grip.wet - grip.dry) * weather.surface.wetness
    return bare + (grip.snow - bare) * weather.snow.rut_coverage


REACTION_TIME_S = 1.5
"""From seeing to braking: an assumption, usual for drivers who are taken by surprise."""
DEFAULT_GRIP = TyreFriction(dry=0.8, wet=0.5, snow=0.25, used_share=0.5)
"""Friction where a spec has no drivers: an assumption, usual in accident reconstruction."""


@dataclass(frozen=True)
class StoppingDistance:
    """The ego's stopping distance at its top speed, `v t + v² / (2 mu g)`, and what it sees.

    Attributes:
        speed_km_h: Top speed of the ego.
        reaction_s: Until it brakes.
        friction: Coefficient of friction on this road in this weather.
        distance_m: Until it stands.
        visibility_m: Meteorological optical range of the whole air; None if that has no end.
        occlusion_m: From its front to the conflict point when it sees whoever comes out behind
            parked cars; the least of all conflicts, None if nobody does.
    """

    speed_km_h: float
    reaction_s: float
    friction: float
    distance_m: float
    visibility_m: float | None
    occlusion_m: float | None

    @property
    def can_stop_in_sight(self) -> bool:
        """Whether it sees far enough to stop before whatever it sees."""
        sights_m = (self.visibility_m, self.occlusion_m)
        return all(sight_m is None or self.distance_m <= sight_m for sight_m in sights_m)

    def __str__(self) -> str:
        """In a sentence."""
        seen = "no end" if self.visibility_m is None else f"{self.visibility_m:.0f} m"
        if self.occlusion_m is not None:
            seen += f", {self.occlusion_m:.0f} m past parked cars"
        return (
            f"{self.distance_m:.0f} m from {self.speed_km_h:.0f} km/h, with {self.reaction_s:g} s"
            f" to react and a friction of {self.friction:.2f}; visibility {seen}:"
            f" the ego {'can' if self.can_stop_in_sight else 'cannot'} stop in sight"
        )


def compute_stopping_distance(spec: Spec) -> StoppingDistance:
    """How the ego of a spec stops."""
    place = spec.ego.place
    assert isinstance(place, Vehicle)
    share = spec.caution.speed_share if spec.caution else 1.0
    speed_m_s = share * place.max_speed_km_h / KM_H_PER_M_S
    grip = friction_coefficient(spec.drivers.grip if spec.drivers else DEFAULT_GRIP, spec.weather)
    seen = compute_extinction(spec.weather).mor_m
    return StoppingDistance(
        speed_km_h=round(KM_H_PER_M_S * speed_m_s, 2),
        reaction_s=REACTION_TIME_S,
        friction=round(grip, 4),
        distance_m=round(speed_m_s * REACTION_TIME_S + speed_m_s**2 / (2 * grip * GRAVITY_M_S2), 2),
        visibility_m=round(seen, 1) if isfinite(seen) else None,
        occlusion_m=_find_occlusion_m(spec),
    )


def _find_occlusion_m(spec: Spec) -> float | None:
    found = [item.parameters.get("occlusion_m") for item in spec.conflicts]
    middles_m = [seen_m for seen_m in found if seen_m is not None]
    if not middles_m or spec.ego.blueprint is None:
        return None
    front_m = spec.blueprints[spec.ego.blueprint].length_m / 2
    return round(max(min(middles_m) - front_m, 0.0), 2)
