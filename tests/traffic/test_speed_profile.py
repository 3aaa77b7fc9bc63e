"""Speed limits in bends, and where vehicles are located."""

import numpy as np
import pytest

from advercity.frames import Actor
from advercity.roads.bend_speed import LATERAL_ACCELERATION_M_S2
from advercity.roads.lane_graph import LaneGraph
from advercity.traffic.demand import VehicleTrip
from advercity.traffic.speed_profile import (
    BRAKING_M_S2,
    SpeedLimiter,
    SpeedProfile,
)


def test_a_bend_is_taken_at_bearable_speed_and_braked_for_in_time(graph: LaneGraph):
    car = Actor(1001, "car", "sedan", "car_paint_red", (4.0, 1.8, 1.5))
    profile = SpeedProfile.from_trip(
        VehicleTrip(car, ("west", "north"), 1, 10.0, 0.0, 0.0, 1.0, 30.0), graph
    )
    in_bend = np.sqrt(LATERAL_ACCELERATION_M_S2 * 20.0)

    def limit(edge: str, position_m: float) -> float | None:
        return SpeedLimiter(profile, 40.0, lambda: (edge, position_m)).update(0.0)

    before = np.sqrt(in_bend**2 + 2 * BRAKING_M_S2 * 30.0)
    assert limit(":j_0", 15.0) == pytest.approx(in_bend, rel=0.03)
    assert limit("west", 70.0) == pytest.approx(before, rel=0.03)
    assert (limit("north", 30.0) or 0.0) > 30.0
    assert limit("elsewhere", 0.0) == 40.0


def test_a_vehicle_is_located_only_when_it_may_have_left_its_edge():
    profile = SpeedProfile(
        {"first": 0.0, "next": 10.0}, {"first": 10.0, "next": 20.0}, [20.0, *range(30)]
    )
    positions, located = iter([("first", 2.0), ("first", 9.5), ("next", 0.5)]), list[str]()

    def locate() -> tuple[str, float]:
        edge, position_m = next(positions)
        located.append(edge)
        return edge, position_m

    limiter = SpeedLimiter(profile, 12.5, locate)
    assert (limiter.update(0.0), len(located)) == (1.0, 1)
    assert (limiter.update(1.5), len(located)) == (2.5, 1)
    assert (limiter.update(0.0), len(located)) == (None, 1)
    assert (limiter.update(6.5), len(located)) == (8.5, 2)
    assert (limiter.update(1.0), len(located)) == (9.5, 3)
    assert (limiter.update(4.0), len(located)) == (12.5, 3)
    assert (limiter.update(0.5), len(located)) == (None, 3)
