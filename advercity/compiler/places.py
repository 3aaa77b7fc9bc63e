"""Whether agents stand on the map that their road is made of."""

from collections.abc import Iterator

import numpy as np
import shapely
from advercity_dsl import MapNetwork, Road, Vehicle
from advercity_dsl.base import Point2
from advercity_dsl.road import StripKind

from advercity.compiler.maps import is_for_cars
from advercity.compiler.source import Where
from advercity.compiler.ways import RoadWays
from advercity.networks import unpacked

SPAWN_M = 3.5
"""A vehicle starts no farther from the middle of a lane than a lane is wide."""
DESTINATION_M = 10.0
"""Nearer to the end of a way than this counts as reached."""
ROADSIDE_M = 100.0
"""Farther from any lane a roadside unit sees no traffic."""

Misplaced = tuple[Where, str]
"""Path of a place in the road's declaration, and what is wrong with it."""


def misplaced(road: Road) -> Iterator[Misplaced]:
    """Places of agents that lie off the road's map.

    Maps of one town have often gone with places of another; what stands off every lane tells.
    """
    lanes = shapely.MultiLineString(list(_lanes(road)))
    for name, agent in road.agents.items():
        if isinstance(agent, Vehicle):
            yield from _off(lanes, name, "spawn_m", agent.spawn_m, SPAWN_M)
            yield from _off(lanes, name, "destination_m", agent.destination_m, DESTINATION_M)
        else:
            yield from _off(lanes, name, "position_m", agent.position_m[:2], ROADSIDE_M)


def _off(
    lanes: shapely.MultiLineString, agent: str, field: str, place: Point2, most_m: float
) -> Iterator[Misplaced]:
    away = shapely.distance(lanes, shapely.Point(place))
    if away > most_m:
        east, north = place
        yield (
            ("agents", agent, field),
            f"{east:g}, {north:g} is {away:.0f} m from the nearest lane of this map;"
            f" it may be {most_m:g} m away",
        )


def _lanes(road: Road) -> Iterator[shapely.LineString]:
    """Middles of lanes for vehicles; of streets as declared, or of an imported map."""
    if isinstance(road.imported, MapNetwork):
        for lane in unpacked(road.imported.network).iter("lane"):
            if is_for_cars(lane):
                points = [word.split(",")[:2] for word in lane.get("shape", "").split()]
                yield shapely.LineString(np.array(points, dtype=float))
        return
    for street in RoadWays(road).streets.values():
        for along in (True, False):
            for band in street.side(along=along):
                if band.kind is StripKind.LANE:
                    yield shapely.LineString(street.line(band.centre_t)[:, :2])
