"""Density and the catalogue of vehicles and people that traffic is drawn from."""

from typing import Annotated, Literal

from pydantic import Field

from advercity_dsl.base import Declaration, Id, Model, PositiveMetres

ActorClass = Literal["car", "van", "truck", "bicycle", "motorcycle", "pedestrian"]


class Density(Declaration):
    """How much traffic there is, as multiples of the road's own demand."""

    kind: Literal["density"] = "density"
    vehicles: Annotated[float, Field(ge=0, le=20)]
    walkers: Annotated[float, Field(ge=0, le=20)]


class Blueprint(Model):
    """A model that actors are made from; full length, width and height of its box."""

    actor_class: ActorClass
    length_m: PositiveMetres
    width_m: PositiveMetres
    height_m: PositiveMetres
    land_use: Literal["urban", "rural", "any"] = "any"


class Catalogue(Declaration):
    """The blueprints that a suite draws from; `ego` is the connected vehicles' blueprint."""

    kind: Literal["catalogue"] = "catalogue"
    ego: Id
    blueprints: Annotated[dict[Id, Blueprint], Field(min_length=1)]
