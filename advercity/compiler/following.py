"""Connected vehicles that follow the ego where the original has them lead it."""

import numpy as np
from advercity_dsl import Road, Vehicle

from advercity.compiler.ways import RoadWays, Way, ego_of, ego_way

BEHIND_M = 25.0
"""From the ego's middle to that of who follows it."""
BEFORE_LINE_M = 5.0
"""A follower's middle is at least this far before the end of its street."""
IN_LANE_M = 6.0
"""Nearer than this to the ego's way a vehicle is on its side of the road."""


def with_followers(road: Road) -> Road | None:
    """The road with all connected vehicles that would lead the ego behind it; None without room."""
    ways, ego = RoadWays(road), ego_of(road)
    way, start_m, _ = ego_way(ways, ego)
    followers = {
        name: _following(place, ego, ways)
        for name, place in road.agents.items()
        if isinstance(place, Vehicle) and place is not ego and _leads(place, way, start_m)
    }
    if None in followers.values():
        return None
    return road.model_copy(update={"agents": {**road.agents, **followers}})


def _leads(place: Vehicle, way: Way, start_m: float) -> bool:
    """Whether a vehicle starts farther on the ego's way and drives as the ego does."""
    station = way.nearest(place.spawn_m)
    apart = np.linalg.norm(way.at(station) - np.array(place.spawn_m))
    same = np.cos(way.heading(station) - np.radians(place.heading_deg)) > 0
    return bool(station > start_m and apart < IN_LANE_M and same)


def _following(place: Vehicle, ego: Vehicle, ways: RoadWays) -> Vehicle | None:
    """A vehicle that drives where it meant to, but starts behind the ego."""
    onward = (*ego.route[: ego.route.index(place.route[0])], *place.route)
    way, ego_m, _ = ego_way(ways, ego)
    route, station = onward, ego_m - BEHIND_M
    if station < BEFORE_LINE_M:
        longer = _from_before(onward, ego, ways)
        if longer is None:
            return None
        route, way = longer
        line_m = way.stretches[0].ends_m
        station = min(way.nearest(ego.spawn_m) - BEHIND_M, line_m - BEFORE_LINE_M)
    east, north = way.at(station)
    return place.model_copy(
        update={
            "spawn_m": (round(float(east), 2), round(float(north), 2)),
            "heading_deg": round(float(np.degrees(way.heading(station))), 2),
            "route": route,
        }
    )


def _from_before(
    onward: tuple[str, ...], ego: Vehicle, ways: RoadWays
) -> tuple[tuple[str, ...], Way] | None:
    """A route that begins on a street before, leads to the ego's lane and turns least."""
    street = ways.streets[onward[0]]
    junction = street.begins if ways.along(onward, 0) else street.ends
    found: list[tuple[float, float, tuple[str, ...], Way]] = []
    for item in ways.movements.get(junction, ()):
        if item.to_street == onward[0]:
            route = (item.from_street, *onward)
            way = ways.route(route, item.from_lane)
            gap = np.linalg.norm(way.at(way.nearest(ego.spawn_m)) - np.array(ego.spawn_m))
            found.append((round(float(gap)), abs(ways.turn(item, junction)), route, way))
    best = min(found, key=lambda one: one[:2], default=None)
    return best and best[2:]
