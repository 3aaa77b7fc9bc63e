"""How the ego drives where nobody holds it up."""

from dataclasses import dataclass

from advercity_dsl import Road

from advercity.compiler.nominal import Pace, nominal
from advercity.compiler.ways import RoadWays, Stretch, Way, ego_of, ego_way

BEFORE_DESTINATION_M = 10.0
"""The ego is crossed no later than this before the scenario may end."""
CROSSING_BEFORE_M = 2.1
"""From the middle of a crossing to the end of its street, inside the junction."""


@dataclass(frozen=True, eq=False)
class EgoDrive:
    """The ego's way through a road and when it is where.

    Attributes:
        road: Where the ego makes the conflict's manoeuvre.
        ways: Through that road.
        route: Streets of the ego.
        way: Of the ego.
        start_m: Station of its spawn on its way.
        end_m: Station beyond which it meets nobody.
        pace: Since the scenario's start.
    """

    road: Road
    ways: RoadWays
    route: tuple[str, ...]
    way: Way
    start_m: float
    end_m: float
    pace: Pace

    def stretch(self, station_m: float) -> Stretch:
        """The street at a station; a crossing at the junction's edge belongs to the next one."""
        return next(
            item
            for item in reversed(self.way.stretches)
            if item.begins_m - CROSSING_BEFORE_M - 0.1 <= station_m
        )

    def between(self, share: float) -> float:
        """The station at a share of what it drives, from start to end."""
        return self.start_m + share * (self.end_m - self.start_m)


def ego_drive(road: Road) -> EgoDrive:
    """The drive of a road's ego."""
    ways, ego = RoadWays(road), ego_of(road)
    way, start_m, destination_m = ego_way(ways, ego)
    pace = nominal(road, ways, way, start_m)
    end_m = destination_m - BEFORE_DESTINATION_M
    return EgoDrive(road, ways, ego.route, way, start_m, end_m, pace)
