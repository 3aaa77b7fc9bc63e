"""Draws the people of a blueprint: its declared one, and others who fit its box."""

from collections.abc import Iterator

import numpy as np
from advercity_dsl import PedestrianAppearance
from advercity_dsl.catalogue import PersonShape

from advercity.randomness import create_generator

CHILD_MAX_HEIGHT_M = 1.45
_MEAN_ADULT_HEIGHT_M = 1.71
_SKINS = {
    "african": ("dark", "dark", "brown"),
    "asian": ("light", "light", "brown"),
    "european": ("light",),
}
_HAIR_COLOURS = {
    "african": ("black",),
    "asian": ("black", "black", "brown"),
    "european": ("brown", "brown", "blond", "black", "red"),
}
_GREY_FROM_YEARS = 58
_HAIRCUTS = {
    "female": ("long", "long", "bun", "short", "hat"),
    "male": ("short", "short", "short", "short", "bald", "hat"),
    "child": ("short", "short", "short", "hat"),
}
_BOTTOM_COLOURS = ("dark", "dark", "black", "black", "denim", "denim", "grey", "brown", "light")
_BAG_COLOURS = ("black", "dark", "brown", "red", "green", "grey")


def draw_people(
    first: PersonShape, looks: PedestrianAppearance, height_m: float, key: str
) -> Iterator[tuple[PersonShape, PedestrianAppearance]]:
    """Draw a person as declared, then the others; the same key gives the same people."""
    yield first, looks
    for number in range(1, first.others + 1):
        person = _draw_shape(height_m, key, number)
        yield person, _draw_looks(person, looks, height_m, key, number)


def _draw_shape(height_m: float, key: str, number: int) -> PersonShape:
    draw = create_generator("person", key, number)
    # Children grow by about 6 cm a year; adults of either sex differ by about 13 cm.
    age = (height_m - 0.77) / 0.06 + draw.uniform(-0.8, 0.8)
    male_odds = np.clip(0.5 + (height_m - _MEAN_ADULT_HEIGHT_M) / 0.26, 0.0, 1.0)
    if height_m >= CHILD_MAX_HEIGHT_M:
        age = 16.0 + 64.0 * draw.random()
    else:
        male_odds = 0.5
    return PersonShape(
        sex="male" if draw.random() < male_odds else "female",
        age_years=round(float(age), 1),
        weight=round(float(np.clip(draw.normal(0.5, 0.2), 0.1, 1.0)), 2),
        muscle=round(float(np.clip(draw.normal(0.5, 0.15), 0.1, 0.9)), 2),
        ancestry=draw.choice(["european", "european", "asian", "african"]),
    )


def _draw_looks(
    person: PersonShape, declared: PedestrianAppearance, height_m: float, key: str, number: int
) -> PedestrianAppearance:
    draw = create_generator("person looks", key, number)
    is_child = height_m < CHILD_MAX_HEIGHT_M
    bottoms = ["trousers", "trousers", "trousers", "shorts" if is_child else "trousers"]
    is_old = person.age_years > _GREY_FROM_YEARS
    colours = ("grey",) if is_old else _HAIR_COLOURS[person.ancestry]
    is_seated = declared.attachment == "wheelchair"
    return PedestrianAppearance(
        top=draw.choice(["jacket", "jacket", "shirt", "shirt" if is_child else "coat"]),
        bottom=draw.choice([*bottoms, "skirt" if person.sex == "female" else "shorts"]),
        bottom_colour=draw.choice(_BOTTOM_COLOURS),
        hair=draw.choice(_HAIRCUTS["child" if is_child else person.sex]),
        hair_colour=draw.choice(colours),
        skin=draw.choice(_SKINS[person.ancestry]),
        bag=draw.choice(
            ["none", "none", "none", "backpack", "shoulder_bag"][: 3 if is_seated else 5]
        ),
        bag_colour=draw.choice(_BAG_COLOURS),
        umbrella=draw.choice(["black", "dark", "blue", "red"]) if declared.umbrella else None,
        attachment=declared.attachment,
    )
