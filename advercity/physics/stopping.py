"""Tyre friction, and whether the ego can stop within its sight."""

from dataclasses import dataclass
from math import isfinite

from advercity_dsl import Spec, Vehicle, Weather
from advercity_dsl.traffic import TyreFriction
from advercity_dsl.units import KM_H_PER_M_S

from advercity.physics import water
from advercity.physics.constants import GRAVITY_M_S2
from advercity.physics.extinction import compute_extinction
from advercity.physics.weather_parts.part import list_deposits

REACTION_TIME_S = 1.5
"""Time from perception to braking of surprised drivers (Green, Transportation Human Factors 2,
2000)."""
DEFAULT_GRIP = TyreFriction(dry=0.8, wet=0.5, snow=0.25, used_share=0.5)
"""Friction for a spec without drivers: usual values of accident reconstruction."""


def friction_coefficient(grip: TyreFriction, weather: Weather) -> float:
    """Compute the coefficient of friction in the wheel ruts, by water, ice and deposits."""
    bare = grip.dry + (grip.wet - grip.dry) * weather.surface.wetness
    bare += (grip.ice - bare) * water.compute_ice_cover(weather.surface.ice_mm)
    for deposit in list_deposits(weather):
        covered = grip.snow if deposit.friction is None else deposit.friction
        bare += (covered - bare) * deposit.rut_coverage
    return bare


@dataclass(frozen=True)
class StoppingDistance:
    """The ego's stopping distance at its top speed, `v t + v² / (2 mu g)`, and its sight.

    Attributes:
        speed_km_h: Top speed of the ego.
        reaction_s: Time until it brakes.
        friction: Coefficient of friction on this road in this weather.
        distance_m: Distance until it has stopped.
        visibility_m: Meteorological optical range of the whole air; None for a vacuum.
        occlusion_m: Distance from its front to the conflict point when an actor behind parked cars
            becomes visible, the least of all conflicts; None without such conflicts.
    """

    speed_km_h: float
    reaction_s: float
    friction: float
    distance_m: float
    visibility_m: float | None
    occlusion_m: float | None

    @property
    def can_stop_in_sight(self) -> bool:
        """Whether the stopping distance is within both visibility and occlusion."""
        sights_m = (self.visibility_m, self.occlusion_m)
        return all(sight_m is None or self.distance_m <= sight_m for sight_m in sights_m)

    def __str__(self) -> str:
        """Format the stopping distance and the sight in one sentence."""
        seen = "unlimited" if self.visibility_m is None else f"{self.visibility_m:.0f} m"
        if self.occlusion_m is not None:
            seen += f", {self.occlusion_m:.0f} m past parked cars"
        return (
            f"{self.distance_m:.0f} m from {self.speed_km_h:.0f} km/h, with {self.reaction_s:g} s"
            f" to react and a friction of {self.friction:.2f}; visibility {seen}:"
            f" the ego {'can' if self.can_stop_in_sight else 'cannot'} stop in sight"
        )


def compute_stopping_distance(spec: Spec) -> StoppingDistance:
    """Compute the stopping distance of a spec's ego on its road in its weather."""
    place = spec.ego.place
    assert isinstance(place, Vehicle)
    speed_factor = spec.caution.speed_share if spec.caution else 1.0
    speed_m_s = speed_factor * place.max_speed_km_h / KM_H_PER_M_S
    grip = friction_coefficient(spec.drivers.grip if spec.drivers else DEFAULT_GRIP, spec.weather)
    mor_m = compute_extinction(spec.weather).mor_m
    return StoppingDistance(
        speed_km_h=round(KM_H_PER_M_S * speed_m_s, 2),
        reaction_s=REACTION_TIME_S,
        friction=round(grip, 4),
        distance_m=round(speed_m_s * REACTION_TIME_S + speed_m_s**2 / (2 * grip * GRAVITY_M_S2), 2),
        visibility_m=round(mor_m, 1) if isfinite(mor_m) else None,
        occlusion_m=_find_occlusion_m(spec),
    )


def _find_occlusion_m(spec: Spec) -> float | None:
    found = [item.parameters.get("occlusion_m") for item in spec.conflicts]
    # Parameters count from the middle of the ego, drivers from its front.
    from_middle_m = [distance_m for distance_m in found if distance_m is not None]
    if not from_middle_m or spec.ego.blueprint is None:
        return None
    front_m = spec.blueprints[spec.ego.blueprint].length_m / 2
    return round(max(min(from_middle_m) - front_m, 0.0), 2)
