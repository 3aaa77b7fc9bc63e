"""Which colour an actor has."""

from advercity_dsl.traffic import ActorClass

from advercity.randomness import generator

CONNECTED_PAINT = "car_paint_blue"
"""Paint of connected vehicles, as in the original."""

_VEHICLE_SHARES = {
    "car_paint_white": 0.33,
    "car_paint_silver": 0.31,
    "car_paint_black": 0.20,
    "car_paint_blue": 0.08,
    "car_paint_red": 0.06,
    "car_paint_green": 0.02,
}
"""Rounded world-wide shares of new cars (Axalta, Global Automotive Color Popularity, 2020-2023);
the rest of its colours is dealt out to the nearest one here."""
_COAT_SHARES = {
    "cloth_dark": 0.45,
    "cloth_blue": 0.22,
    "cloth_light": 0.20,
    "cloth_red": 0.13,
}


def paint_for(actor_class: ActorClass, *key: int | str) -> str:
    """Material of an actor's paint (a person's coat), drawn by `key` with the shares of traffic."""
    shares = _COAT_SHARES if actor_class == "pedestrian" else _VEHICLE_SHARES
    draw = generator(*key, "paint", actor_class)
    return list(shares)[draw.choice(len(shares), p=list(shares.values()))]
