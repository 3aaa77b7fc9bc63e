"""Draws who takes part in a conflict from the blueprints that are there."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from advercity_dsl import Blueprint
from advercity_dsl.traffic import ActorClass

from advercity.compiler.solving.errors import UnsolvableError
from advercity.randomness import generator


@dataclass(frozen=True)
class Body:
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
class Casting:
    """Draws bodies; each draw has a name of its own, so none depends on another.

    Attributes:
        blueprints: To draw from.
        seed: Of the suite.
        key: What the draws are for.
    """

    blueprints: Mapping[str, Blueprint]
    seed: int
    key: str

    def actor(self, classes: Sequence[ActorClass]) -> Body:
        """Whom the ego meets: of one of the classes.

        Raises:
            UnsolvableError: There is no blueprint of any.
        """
        there = [names for item in classes if (names := self._of(item))]
        if not there:
            raise UnsolvableError(f"no blueprint of the class {' or '.join(classes)} is there")
        draw = self._generator("blueprint")
        return self._one(there[int(draw.integers(len(there)))], draw)

    def cyclist(self) -> Body:
        """Who is overtaken.

        Raises:
            UnsolvableError: There is no bicycle's blueprint.
        """
        names = self._of("bicycle")
        if not names:
            raise UnsolvableError("no blueprint of the class bicycle is there to be overtaken")
        return self._one(names, self._generator("passed"))

    def parked(self, number: int) -> Body:
        """The car that is parked nearest to the actor's path, or the one behind it, from 1.

        Raises:
            UnsolvableError: There is no car's blueprint.
        """
        names = self._of("car")
        if not names:
            raise UnsolvableError("no blueprint of the class car is there to be parked")
        return self._one(names, self._generator("parked", number))

    def _of(self, actor_class: ActorClass) -> list[str]:
        return [name for name, item in self.blueprints.items() if item.actor_class == actor_class]

    def _one(self, names: Sequence[str], draw: np.random.Generator) -> Body:
        name = names[int(draw.integers(len(names)))]
        return Body(name, self.blueprints[name])

    def _generator(self, *what_for: str | int) -> np.random.Generator:
        return generator(self.seed, "conflict", self.key, *what_for)
