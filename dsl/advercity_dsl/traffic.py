"""Density and the catalogue of vehicles and people that traffic is drawn from."""

from typing import Annotated, Literal

from pydantic import Field

from advercity_dsl.base import Declaration, Id, Model, Number, PositiveMetres, Reason

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


class Blueprint(Model):
    """A model that actors are made from; full length, width and height of its box."""

    actor_class: ActorClass
    """What kind of traffic it is."""
    length_m: PositiveMetres
    width_m: PositiveMetres
    height_m: PositiveMetres
    land_use: Literal["urban", "rural", "any"] = "any"
    """Where it is met."""


class Catalogue(Declaration):
    """The blueprints that a suite draws from; `ego` is the connected vehicles' blueprint."""

    kind: Literal["catalogue"] = "catalogue"
    ego: Id
    """Blueprint of every connected vehicle."""
    blueprints: Annotated[dict[Id, Blueprint], Field(min_length=1)]
    """What other traffic is drawn from."""
