"""When a connected vehicle is where it wants to be, which ends a scenario."""

import math
from collections.abc import Container

from advercity_dsl import Agent, Spec, Timing, Vehicle

from advercity.errors import RunError
from advercity.traffic import calls
from advercity.traffic.demand import Demand, Ride

FASTEST_M_S = 50.0


class Goal:
    """Where a connected vehicle goes, and whether it is there.

    While it is far from there it is not asked where it is.
    """

    def __init__(self, ride: Ride, agent: Agent, place: Vehicle, timing: Timing) -> None:
        """Of the ride of an agent in a place."""
        self._vehicle = str(ride.actor.id)
        self._agent = agent.id
        self._place = place
        self._timing = timing
        self._half_m = ride.actor.size[0] / 2
        self._far_for = 0

    def is_over(self, there: Container[str]) -> bool:
        """Whether its vehicle has arrived, or is not among those there, at the next tick.

        All connected vehicles are there in every frame, so one that has left the site ends the
        scenario, too.

        Raises:
            RunError: The ego has left.
        """
        if self._vehicle not in there:
            if self._place.role == "ego":
                raise RunError(f"{self._agent} left the site without coming near its destination")
            return True
        self._far_for -= 1
        return self._far_for < 0 and self._is_near()

    def _is_near(self) -> bool:
        box_m, goal = self._timing.destination_box_m, self._place.destination_m
        east, north, _ = calls.vehicle_place(self._vehicle)
        east, north = east - goal[0], north - goal[1]
        apart_m = max(abs(east), abs(north)) - box_m - self._half_m
        self._far_for = int(apart_m / (FASTEST_M_S * self._timing.tick_s))
        heading = math.radians(90 - calls.vehicle_angle(self._vehicle))
        back = self._half_m * math.cos(heading), self._half_m * math.sin(heading)
        return abs(east - back[0]) <= box_m and abs(north - back[1]) <= box_m


def goals(spec: Spec, demand: Demand) -> tuple[Goal, ...]:
    """Those of a scenario's connected vehicles."""
    rides = {ride.actor.id: ride for ride in demand.connected}
    return tuple(
        Goal(rides[agent.number], agent, agent.place, spec.timing)
        for agent in spec.agents
        if isinstance(agent.place, Vehicle)
    )
