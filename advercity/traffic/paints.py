"""Draw the colours of actors."""

from collections.abc import Mapping

import numpy as np
from advercity_dsl import ActorClass
from advercity_dsl.catalogue import PaintColour

from advercity.randomness import create_generator

CONNECTED_PAINT = "car_paint_blue"
"""Paint of connected vehicles, as in the original."""

_VEHICLE_PAINT_FRACTIONS = {
    "car_paint_white": 0.22,
    "car_paint_pearl": 0.12,
    "car_paint_black": 0.20,
    "car_paint_grey": 0.12,
    "car_paint_graphite": 0.06,
    "car_paint_silver": 0.12,
    "car_paint_blue": 0.05,
    "car_paint_navy": 0.03,
    "car_paint_red": 0.035,
    "car_paint_wine": 0.015,
    "car_paint_brown": 0.01,
    "car_paint_beige": 0.01,
    "car_paint_green": 0.01,
}
"""Rounded fractions of new cars world-wide (Axalta, Global Automotive Color Popularity, 2020-2023);
its other colours are added to the nearest one here. Pearl, graphite, navy, wine and beige are parts
of its white, grey, blue, red and brown."""
_COAT_COLOUR_FRACTIONS = {
    "cloth_dark": 0.22,
    "cloth_black": 0.16,
    "cloth_grey": 0.14,
    "cloth_blue": 0.12,
    "cloth_light": 0.10,
    "cloth_denim": 0.06,
    "cloth_white": 0.05,
    "cloth_brown": 0.05,
    "cloth_red": 0.05,
    "cloth_green": 0.03,
    "cloth_yellow": 0.02,
}
"""Engineering values: most coats and jackets in a street are dark or muted, few are bright."""


def draw_paint(
    actor_class: ActorClass, *key: int | str, paints: Mapping[PaintColour, float] | None = None
) -> str:
    """Draw the material of a vehicle's paint or of a person's coat.

    Args:
        actor_class: Selects the colours of traffic, or of coats.
        key: Key of the random stream.
        paints: Fractions of colours declared by a blueprint; None for the usual ones.
    """
    fractions = _COAT_COLOUR_FRACTIONS if actor_class == "pedestrian" else _VEHICLE_PAINT_FRACTIONS
    if paints:
        fractions = {f"car_paint_{name}": fraction for name, fraction in paints.items()}
    weights = np.array(list(fractions.values()))
    draw = create_generator(*key, "paint", actor_class)
    return list(fractions)[draw.choice(len(fractions), p=weights / weights.sum())]
