"""Whether whoever drives can stop within what they see."""

from dataclasses import dataclass
from math import isfinite

from advercity_dsl import Spec, Vehicle
from advercity_dsl.drivers import Grip

from advercity.compiler.caution import GRAVITY_M_S2, friction
from advercity.weather import extinction
from advercity.weather.words import visibility_m

REACTION_S = 1.5
"""From seeing to braking: an assumption, usual for drivers who are taken by surprise."""
GRIP = Grip(dry=0.8, wet=0.5, snow=0.25, used_share=0.5)
"""Friction where a spec has no drivers: an assumption, usual in accident reconstruction."""


@dataclass(frozen=True)
class Stopping:
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
    def in_sight(self) -> bool:
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
            f" the ego {'can' if self.in_sight else 'cannot'} stop in sight"
        )


def stopping(spec: Spec) -> Stopping:
    """How the ego of a spec stops."""
    place = spec.ego.place
    assert isinstance(place, Vehicle)
    share = spec.caution.speed_share if spec.caution else 1.0
    speed_m_s = share * place.max_speed_km_h / 3.6
    grip = friction(spec.drivers.grip if spec.drivers else GRIP, spec.weather)
    seen = visibility_m(extinction.of_weather(spec.weather))
    return Stopping(
        speed_km_h=round(3.6 * speed_m_s, 2),
        reaction_s=REACTION_S,
        friction=round(grip, 4),
        distance_m=round(speed_m_s * REACTION_S + speed_m_s**2 / (2 * grip * GRAVITY_M_S2), 2),
        visibility_m=round(seen, 1) if isfinite(seen) else None,
        occlusion_m=_occlusion_m(spec),
    )


def _occlusion_m(spec: Spec) -> float | None:
    found = [item.parameters.get("occlusion_m") for item in spec.conflicts]
    middles_m = [seen_m for seen_m in found if seen_m is not None]
    if not middles_m or spec.ego.blueprint is None:
        return None
    front_m = spec.blueprints[spec.ego.blueprint].length_m / 2
    return round(max(min(middles_m) - front_m, 0.0), 2)
