"""Draw blueprints with a declared fraction of their class."""

from collections.abc import Mapping

from advercity_dsl import Blueprint

from advercity.randomness import create_generator


def draw_by_fraction(blueprints: Mapping[str, Blueprint], *key: int | str) -> str | None:
    """Draw a blueprint by its fraction; None stands for those without a fraction.

    Args:
        blueprints: Blueprints of a class by name.
        key: Key of the random stream.
    """
    level = create_generator(*key).random()
    for name, blueprint in blueprints.items():
        level -= blueprint.fraction or 0.0
        if level < 0.0:
            return name
    return None
