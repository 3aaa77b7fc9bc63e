"""What any step of a solution may raise.

Draws a conflict's parameters; every number is a function of seed, key and name alone.

Draws who takes part in a conflict from the blueprints that are there.

A conflict at a road before it is solved, and the places that its solution finds.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from advercity_dsl import Blueprint, Conflict
from advercity_dsl.conflict import ConflictParameters
from advercity_dsl.distribution import Choice, Distribution, Uniform
from advercity_dsl.traffic import ActorClass
from advercity_dsl.units import KM_H_PER_M_S
from numpy.typing import NDArray

from advercity.conflicts.ego_motion import EgoDrive
from advercity.randomness import create_generator, draw_number


class UnsolvableError(ValueError):
    """A conflict that does not fit a road after all; the message says why."""


PARAMETER_DIGITS = 4


def sample_parameters(parameters: ConflictParameters, seed: int, key: str) -> dict[str, float]:
    """A number for every parameter but the range that the ego's speed is meant for."""
    return {
        name: _round_significant(_draw_value(item.draw, seed, key, name))
        for name in type(parameters).model_fields
        if name != "ego_speed_km_h" and (item := getattr(parameters, name)) is not None
    }


def compute_bounds(draw: float | Distribution) -> tuple[float, float]:
    """The least and the most that may be drawn."""
    if isinstance(draw, int | float):
        return float(draw), float(draw)
    if isinstance(draw, Choice):
        return min(draw.choice), max(draw.choice)
    return draw.uniform if isinstance(draw, Uniform) else draw.normal.within


def _draw_value(draw: float | Distribution, seed: int, key: str, name: str) -> float:
    if isinstance(draw, int | float):
        return float(draw)
    return draw_number(draw, create_generator(seed, "conflict", key, name))


def _round_significant(value: float) -> float:
    return float(f"{value:.{PARAMETER_DIGITS}g}")


@dataclass(frozen=True)
class RoadUser:
    """A road user: the name of its blueprint, and the blueprint."""

    name: str
    blueprint: Blueprint

    @property
    def actor_class(self) -> ActorClass:
        """Car, pedestrian, ..."""
        return self.blueprint.actor_class

    @property
    def length_m(self) -> float:
        """From its rear to its front."""
        return self.blueprint.length_m

    @property
    def width_m(self) -> float:
        """From its left to its right."""
        return self.blueprint.width_m


@dataclass(frozen=True)
class ParticipantSampler:
    """Draws bodies; each draw has a name of its own, so none depends on another.

    Attributes:
        blueprints: To draw from.
        seed: Of the suite.
        key: What the draws are for.
    """

    blueprints: Mapping[str, Blueprint]
    seed: int
    key: str

    def draw_actor(self, classes: Sequence[ActorClass]) -> RoadUser:
        """Whom the ego meets: of one of the classes.

        Raises:
            UnsolvableError: There is no blueprint of any.
        """
        there = [names for item in classes if (names := self._list_blueprints(item))]
        if not there:
            raise UnsolvableError(f"no blueprint of the class {' or '.join(classes)} is there")
        draw = self._generator("blueprint")
        return self._draw_one(there[int(draw.integers(len(there)))], draw)

    def draw_cyclist(self) -> RoadUser:
        """Who is overtaken.

        Raises:
            UnsolvableError: There is no bicycle's blueprint.
        """
        names = self._list_blueprints("bicycle")
        if not names:
            raise UnsolvableError("no blueprint of the class bicycle is there to be overtaken")
        return self._draw_one(names, self._generator("passed"))

    def draw_parked_car(self, number: int) -> RoadUser:
        """The car that is parked nearest to the actor's path, or the one behind it, from 1.

        Raises:
            UnsolvableError: There is no car's blueprint.
        """
        names = self._list_blueprints("car")
        if not names:
            raise UnsolvableError("no blueprint of the class car is there to be parked")
        return self._draw_one(names, self._generator("parked", number))

    def _list_blueprints(self, actor_class: ActorClass) -> list[str]:
        return [name for name, item in self.blueprints.items() if item.actor_class == actor_class]

    def _draw_one(self, names: Sequence[str], draw: np.random.Generator) -> RoadUser:
        name = names[int(draw.integers(len(names)))]
        return RoadUser(name, self.blueprints[name])

    def _generator(self, *what_for: str | int) -> np.random.Generator:
        return create_generator(self.seed, "conflict", self.key, *what_for)


@dataclass(frozen=True, eq=False)
class ConflictCase:
    """What everybody's place follows from.

    Attributes:
        conflict: What to stage.
        index: Place among the scenario's conflicts, from 1.
        drive: Of the ego.
        sampler: Draws who else takes part.
        actor: Whom the ego meets.
        parameters: The conflict's parameters by name with their unit.
    """

    conflict: Conflict
    index: int
    drive: EgoDrive
    sampler: ParticipantSampler
    actor: RoadUser
    parameters: Mapping[str, float]

    @property
    def speed_m_s(self) -> float:
        """Of the actor, as drawn."""
        return self.parameters["actor_speed_km_h"] / KM_H_PER_M_S


@dataclass(frozen=True, eq=False)
class ActorPlacement:
    """A way for an actor that meets the ego's.

    Attributes:
        station_m: On the ego's way, where both meet.
        approach_m: From its start to the point.
        path: Points (n, 2) of a path of its own, or none.
        route: Streets of a route in lanes, or none.
        lane: Of its first street.
        start_m: Of its middle before the end of that street.
    """

    station_m: float
    approach_m: float
    path: NDArray[np.float64] | None = None
    route: tuple[str, ...] = ()
    lane: int = 1
    start_m: float = 0.0
