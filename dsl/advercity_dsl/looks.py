"""What people wear and carry."""

from typing import Annotated, Literal

from pydantic import Field

from advercity_dsl.base import Number, Reason, Terse

Cloth = Literal[
    "dark", "black", "grey", "light", "white", "blue", "denim", "red", "green", "brown", "yellow"
]
"""Colour of clothes and bags."""


class Looks(Terse):
    """How a pedestrian looks; the top has the actor's own colour."""

    stout: Annotated[
        Number, Field(ge=0.75, le=1.4), Reason("figures beyond that would need another skeleton")
    ] = 1.0
    """Girth, 1 for an average figure."""
    top: Literal["jacket", "coat", "shirt"] = "jacket"
    """A coat reaches to the knees, a shirt has short sleeves."""
    bottom: Literal["trousers", "shorts", "skirt"] = "trousers"
    """What is worn below."""
    bottom_colour: Cloth = "dark"
    """Of what is worn below."""
    hair: Literal["short", "long", "bun", "bald", "hat", "hood"] = "short"
    """How it is worn, or what covers it."""
    hair_colour: Literal["black", "brown", "blond", "grey", "red"] = "brown"
    """Of the hair, where it shows."""
    skin: Literal["light", "brown", "dark"] = "light"
    """Tone of the skin."""
    bag: Literal["none", "backpack", "shoulder_bag", "case"] = "none"
    """What is carried."""
    bag_colour: Cloth = "dark"
    """Of the bag, and of a hat; a hood has the colour of the top."""
    umbrella: Cloth | None = None
    """Colour of the umbrella that may go up in rain; `null` has none."""
