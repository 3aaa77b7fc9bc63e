"""Which colour an actor has."""

from collections.abc import Mapping

import numpy as np
from advercity_dsl import ActorClass
from advercity_dsl.catalogue import PaintColour

from advercity.randomness import create_generator

CONNECTED_PAINT = "car_paint_blue"
"""Paint of connected vehicles, as in the original."""

_VEHICLE_PAINT_FRACTIONS = {
    "car_paint_white": 0.34,
    "car_paint_black": 0.20,
    "car_paint_grey": 0.18,
    "car_paint_silver": 0.12,
    "car_paint_blue": 0.08,
    "car_paint_red": 0.05,
    "car_paint_brown": 0.02,
    "car_paint_green": 0.01,
}
"""Rounded world-wide shares of new cars (Axalta, Global Automotive Color Popularity, 2020-2023);
the rest of its colours is dealt out to the nearest one here."""
_COAT_COLOUR_FRACTIONS = {
    "cloth_dark": 0.45,
    "cloth_blue": 0.22,
    "cloth_light": 0.20,
    "cloth_red": 0.13,
}


def draw_paint(
    actor_class: ActorClass, *key: int | str, paints: Mapping[PaintColour, float] | None = None
) -> str:
    """Material of an actor's paint (a person's coat), drawn by `key`.

    Args:
        actor_class: Whose shares to draw with: traffic's colours, or the coats of people.
        key: What the draw is for.
        paints: Shares of colours that a blueprint declares instead.
    """
    shares = _COAT_COLOUR_FRACTIONS if actor_class == "pedestrian" else _VEHICLE_PAINT_FRACTIONS
    if paints:
        shares = {f"car_paint_{name}": share for name, share in paints.items()}
    weights = np.array(list(shares.values()))
    draw = create_generator(*key, "paint", actor_class)
    return list(shares)[draw.choice(len(shares), p=weights / weights.sum())]
