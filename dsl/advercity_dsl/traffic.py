"""How much traffic there is, and of which classes."""

from typing import Annotated, Literal

from pydantic import Field

from advercity_dsl.base import Declaration, Number, Reason

ActorClass = Literal["car", "van", "truck", "bicycle", "motorcycle", "pedestrian"]
Multiple = Annotated[
    Number, Field(ge=0, le=20), Reason("a road has no room for more than 20 times its demand")
]


class Density(Declaration):
    """How much traffic there is, as multiples of the road's own demand."""

    kind: Literal["density"] = "density"
    vehicles: Multiple
    """Of the road's `traffic.vehicles_per_area`."""
    walkers: Multiple
    """Of the road's `traffic.walkers`."""
