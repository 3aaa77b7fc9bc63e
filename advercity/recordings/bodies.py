"""Choose the bodies of recorded road users among the blueprints of a catalogue."""

from collections.abc import Mapping

from advercity_dsl import ActorClass, Blueprint

from advercity.errors import InputError
from advercity.randomness import create_generator

EQUAL_M = 0.1
"""Tolerance for equal sums of differences in size: not all may have one body."""


def select_blueprint(
    blueprints: Mapping[str, Blueprint],
    actor_class: ActorClass,
    size: tuple[float, float, float],
    *key: int | str,
) -> str:
    """Select the blueprint of a class with the nearest size; of several, draw one.

    Args:
        blueprints: Blueprints by name.
        actor_class: Its class.
        size: Length, width and height in metres; 0 if unknown.
        key: Key of the random stream.

    Raises:
        InputError: No blueprint is of the class.
    """
    misfits = {
        name: compute_misfit(blueprint, size)
        for name, blueprint in blueprints.items()
        if blueprint.actor_class == actor_class and blueprint.is_usual
    }
    if not misfits:
        known = sorted({blueprint.actor_class for blueprint in blueprints.values()})
        raise InputError(
            f"no blueprint is a {actor_class}, which the recording has; add one to the catalogue"
            f" (it has: {', '.join(known)})"
        )
    best_m = min(misfits.values())
    nearest = [name for name, misfit in misfits.items() if misfit <= best_m + EQUAL_M]
    exact = [name for name in nearest if misfits[name] < 0.001]
    nearest = exact or nearest
    return nearest[create_generator(*key, "recorded body").integers(len(nearest))]


def compute_misfit(blueprint: Blueprint, size: tuple[float, float, float]) -> float:
    """Sum the differences in metres between a blueprint and the known parts of a size."""
    pairs = zip(blueprint.size, size, strict=True)
    return sum(abs(have - want) for have, want in pairs if want > 0)
