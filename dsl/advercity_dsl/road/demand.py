"""Background traffic."""

from typing import Annotated

from pydantic import Field

from advercity_dsl.base import Count, Model, Number, PositiveMetres, Share


class ClassShares(Model):
    """How often each class of vehicle is drawn; normalised by their sum."""

    car: Share
    """Cars."""
    van: Share
    """Vans."""
    truck: Share
    """Lorries and buses."""
    bicycle: Share
    """Bicycles."""
    motorcycle: Share
    """Motorcycles."""


class Demand(Model):
    """Background traffic at density 1, in the original's terms.

    Vehicles are asked for per area: a square of `around_agent_m` around each of the five agents
    and a box from spawn to destination, grown by `around_path_m`, for each vehicle.
    """

    vehicles_per_area: Annotated[Number, Field(ge=0, le=100)]
    """For each of eight areas: around five agents, along three paths."""
    walkers: Annotated[Count, Field(ge=0, le=2000)]
    """Pedestrians."""
    crossing_share: Share = 0.0
    """Share of them that cross streets."""
    around_agent_m: PositiveMetres
    """Half the side of the square around an agent."""
    around_path_m: PositiveMetres
    """Margin around the box from spawn to destination."""
    classes: ClassShares
    """What vehicles they are."""
    speed_offset_percent: Annotated[Number, Field(ge=-100, le=100)] = -10
    """Background cars drive `(1 - offset/100)` times the limit, each ±30 %."""
