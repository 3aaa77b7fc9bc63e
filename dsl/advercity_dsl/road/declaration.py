"""The declaration of a road."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from advercity_dsl.base import Declaration, Degrees, Id, is_empty, is_none
from advercity_dsl.road.agents import EgoRoute, RoadsideUnit, Vehicle
from advercity_dsl.road.demand import Demand
from advercity_dsl.road.junctions import Junction
from advercity_dsl.road.maps import MapFile, MapNetwork
from advercity_dsl.road.references import (
    Network,
    check_junction,
    check_route,
    check_street,
    check_surrounding,
)
from advercity_dsl.road.sections import CrossSection
from advercity_dsl.road.streets import Street
from advercity_dsl.road.surroundings import Surrounding


class Road(Declaration):
    """A place: the static stage of a scenario.

    Its streets are authored here, or imported from a map.
    """

    kind: Literal["road"] = "road"
    land_use: Literal["urban", "rural"]
    """Town or country; typologies ask for it."""
    junction: Literal["intersection", "non_junction"]
    """Whether it is about a junction; typologies ask for it."""
    alignment: Literal["straight", "curved"]
    """Straight or curved; typologies ask for it."""
    profile: Literal["level", "non_level"]
    """Level or not; typologies ask for it."""
    origin_lat_deg: Annotated[Degrees, Field(ge=-89, le=89)] = 0.0
    """Latitude of the origin, for GNSS."""
    origin_lon_deg: Annotated[Degrees, Field(ge=-180, le=180)] = 0.0
    """Longitude of the origin, for GNSS."""
    imported: MapNetwork | MapFile | None = Field(default=None, exclude_if=is_none)
    """A map that the streets come from, in place of `streets`."""
    sections: dict[Id, CrossSection] = Field(default_factory=dict)
    """Cross-sections by name."""
    streets: dict[Id, Street] = Field(default_factory=dict)
    """Streets by name."""
    junctions: dict[Id, Junction] = Field(default_factory=dict)
    """Where streets meet, by name."""
    surroundings: tuple[Surrounding, ...] = ()
    """What stands beside the streets."""
    agents: dict[Id, Annotated[Vehicle | RoadsideUnit, Field(discriminator="kind")]]
    """Connected vehicles and roadside units by name; one vehicle is the ego."""
    ego_routes: dict[Literal["straight", "left", "right"], EgoRoute] = Field(
        default_factory=dict, exclude_if=is_empty
    )
    """By the ego's manoeuvre at the junction."""
    traffic: Demand
    """Who else is there."""

    @model_validator(mode="after")
    def _is_authored_or_imported(self) -> Self:
        if self.imported is None and not self.streets:
            raise ValueError("a road has 'streets', or a map to be 'imported'")
        if self.imported is not None and (self.sections or self.streets or self.junctions):
            raise ValueError("an 'imported' road has its streets from the map; declare none here")
        return self

    @model_validator(mode="after")
    def _names_exist(self) -> Self:
        network = Network(self.sections, self.streets, imported=self.imported is not None)
        for name in self.streets:
            check_street(network, name)
        for name, junction in self.junctions.items():
            check_junction(network, name, junction)
        for name, agent in self.agents.items():
            if isinstance(agent, Vehicle):
                check_route(network, name, agent)
        for index, item in enumerate(self.surroundings):
            check_surrounding(network, index, item)
        return self
