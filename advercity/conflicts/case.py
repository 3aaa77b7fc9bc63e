"""A conflict at a road before it is solved: its drawn parameters and participants.

Each draw is a function of seed, key and name alone, so draws do not depend on each other.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np
from advercity_dsl import Blueprint, Conflict
from advercity_dsl.conflict import ConflictParameters, Resolver, ResolverFractions
from advercity_dsl.distribution import Distribution
from advercity_dsl.traffic import ActorClass
from advercity_dsl.units import KM_H_PER_M_S
from numpy.typing import NDArray

from advercity.conflicts.ego_motion import EgoDrive
from advercity.randomness import create_generator, draw_number


class UnsolvableError(ValueError):
    """A conflict does not fit a road after all; the message says why."""


CALM_S = 4.0
"""Time without a critical event after the start of the recording, and between two events."""
PARAMETER_DIGITS = 4


def sample_parameters(parameters: ConflictParameters, seed: int, key: str) -> dict[str, float]:
    """Draw a number for every parameter except the ego's speed, which depends on the road."""
    return {
        name: _round_significant(_draw_value(item.draw, seed, key, name))
        for name in type(parameters).model_fields
        if name != "ego_speed_km_h" and (item := getattr(parameters, name)) is not None
    }


def _draw_value(
    draw: float | Distribution,
    seed: int,
    key: str,
    *name: str,
    at_least: float = -math.inf,
    at_most: float = math.inf,
) -> float:
    if isinstance(draw, int | float):
        return float(draw)
    generator = create_generator(seed, "conflict", key, *name)
    return draw_number(draw, generator, at_least=at_least, at_most=at_most)


def _round_significant(value: float) -> float:
    return float(f"{value:.{PARAMETER_DIGITS}g}")


@dataclass(frozen=True)
class RoadUser:
    """A participant: the name of its blueprint, and the blueprint."""

    name: str
    blueprint: Blueprint

    @property
    def actor_class(self) -> ActorClass:
        """Class of the blueprint."""
        return self.blueprint.actor_class

    @property
    def length_m(self) -> float:
        """Length of the body."""
        return self.blueprint.length_m

    @property
    def width_m(self) -> float:
        """Width of the body."""
        return self.blueprint.width_m


@dataclass(frozen=True)
class ParticipantSampler:
    """Draws the participants of a conflict from blueprints; UnsolvableError if there is none.

    Attributes:
        blueprints: Blueprints by name.
        seed: Seed of the suite's traffic.
        key: Road, conflict and density; the key of the random streams.
    """

    blueprints: Mapping[str, Blueprint]
    seed: int
    key: str

    def draw_actor(self, classes: Sequence[ActorClass]) -> RoadUser:
        """Draw the actor that the ego meets, from one of the classes."""
        candidates = [names for item in classes if (names := self._list_blueprints(item))]
        if not candidates:
            raise UnsolvableError(f"no blueprint is of the class {' or '.join(classes)}")
        draw = self._create_generator("blueprint")
        return self._draw_from(candidates[int(draw.integers(len(candidates)))], draw)

    def draw_cyclist(self) -> RoadUser:
        """Draw the overtaken cyclist; every call returns the same one."""
        return self._draw("bicycle", "to be overtaken", "passed")

    def draw_parked_car(self, number: int) -> RoadUser:
        """Draw a parked car by its number; 1 is the nearest to the actor's path."""
        return self._draw("car", "to be parked", "parked", number)

    def draw_resolver(self, fractions: ResolverFractions) -> Resolver:
        """Draw who resolves the conflict."""
        level = float(self._create_generator("resolved_by").random())
        options = [name for name in get_args(Resolver) if getattr(fractions, name) > 0]
        bounds = np.cumsum([getattr(fractions, name) for name in options])
        return options[min(int(np.searchsorted(bounds, level)), len(options) - 1)]

    def _draw(self, actor_class: ActorClass, purpose: str, *key: str | int) -> RoadUser:
        names = self._list_blueprints(actor_class)
        if not names:
            raise UnsolvableError(f"no blueprint is of the class {actor_class}, {purpose}")
        return self._draw_from(names, self._create_generator(*key))

    def _list_blueprints(self, actor_class: ActorClass) -> list[str]:
        return [
            name
            for name, item in self.blueprints.items()
            if item.actor_class == actor_class and item.is_usual
        ]

    def _draw_from(self, names: Sequence[str], draw: np.random.Generator) -> RoadUser:
        name = names[int(draw.integers(len(names)))]
        return RoadUser(name, self.blueprints[name])

    def _create_generator(self, *name: str | int) -> np.random.Generator:
        return create_generator(self.seed, "conflict", self.key, *name)


@dataclass(frozen=True, eq=False)
class ConflictCase:
    """A conflict at a road; it determines the places of all participants.

    Attributes:
        conflict: The declaration.
        index: Number among the scenario's conflicts, from 1.
        drive: Drive of the ego.
        sampler: Draws bystanders.
        actor: The actor that the ego meets.
        ego: Blueprint of the ego.
        resolved_by: Who resolves the conflict.
        parameters: The conflict's drawn parameters by name; the name ends with the unit.
        not_before_s: Time from the scenario's start to the first permitted critical event.
        least_speed_share: Lowest speed as a fraction of the highest possible, from the density.
        meets_at_m: Station of the meeting on the ego's path, once the ego's speed is drawn.
    """

    conflict: Conflict
    index: int
    drive: EgoDrive
    sampler: ParticipantSampler
    actor: RoadUser
    ego: Blueprint
    resolved_by: Resolver
    parameters: Mapping[str, float]
    not_before_s: float
    least_speed_share: float = 0.0
    meets_at_m: float | None = None

    @property
    def speed_m_s(self) -> float:
        """Drawn speed of the actor."""
        return self.parameters["actor_speed_km_h"] / KM_H_PER_M_S

    def without(self, name: str) -> "ConflictCase":
        """Return the case without a parameter that does not apply on its road."""
        return replace(
            self, parameters={key: item for key, item in self.parameters.items() if key != name}
        )

    def with_actor_speed(self, speed_km_h: float) -> "ConflictCase":
        """Return the case with another speed of the actor."""
        return replace(self, parameters={**self.parameters, "actor_speed_km_h": speed_km_h})

    def redraw_actor_speed(self, at_least_km_h: float, at_most_km_h: float) -> "ConflictCase":
        """Return the case with an actor speed redrawn between two limits."""
        return self.with_actor_speed(
            self._draw_speed("actor_speed_km_h", at_least_km_h, at_most_km_h)
        )

    def draw_ego_speed(
        self, station_m: float, at_least_km_h: float, at_most_km_h: float
    ) -> "ConflictCase":
        """Return the case with an ego speed before a station, drawn between two limits."""
        speed_km_h = self._draw_speed("ego_speed_km_h", at_least_km_h, at_most_km_h)
        return replace(
            self,
            drive=self.drive.limit_speed(station_m, speed_km_h / KM_H_PER_M_S),
            parameters={**self.parameters, "ego_speed_km_h": speed_km_h},
            meets_at_m=station_m,
        )

    def _draw_speed(self, name: str, at_least_km_h: float, at_most_km_h: float) -> float:
        draw = getattr(self.conflict.parameters, name).draw
        key = (self.sampler.seed, self.sampler.key, name)
        speed_km_h = _draw_value(draw, *key, at_most=at_most_km_h)
        if speed_km_h < at_least_km_h:
            limits = {"at_least": at_least_km_h, "at_most": at_most_km_h}
            speed_km_h = _draw_value(draw, *key, "again", **limits)
        return _round_significant(speed_km_h)


@dataclass(frozen=True, eq=False)
class ActorPlacement:
    """The start and the path of the actor of a conflict.

    Attributes:
        station_m: Station of the meeting on the ego's path.
        approach_m: Distance of the actor's start from the meeting.
        path: Points (n, 2) of its own path, or None.
        route: Streets of its route in lanes, or empty.
        lane: Lane on the first street.
        start_m: Distance of its centre from the end of the first street.
        approach_street: Street by which it enters the ego's junction, or None.
        beyond_line_m: Distance of the meeting from the end of that street.
    """

    station_m: float
    approach_m: float
    path: NDArray[np.float64] | None = None
    route: tuple[str, ...] = ()
    lane: int = 1
    start_m: float = 0.0
    approach_street: str | None = None
    beyond_line_m: float = 0.0
