"""Speed limits in bends, and where vehicles are located."""

from pathlib import Path

import numpy as np
import pytest

from advercity.frames import Actor
from advercity.roads.lane_graph import LaneGraph, read_lane_graph
from advercity.traffic.demand import VehicleTrip
from advercity.traffic.speed_profile import (
    BRAKING_M_S2,
    LATERAL_ACCELERATION_M_S2,
    SpeedLimiter,
    SpeedProfile,
)

ARC = [(100 + 20 * np.sin(turn), 20 - 20 * np.cos(turn)) for turn in np.linspace(0, np.pi / 2, 40)]


BEND = " ".join(f"{x:.3f},{y:.3f},1" for x, y in ARC)


NETWORK = f"""<net>
<edge id="west"><lane id="west_0" index="0" speed="10" length="100" shape="0,-5,1 100,-5,1"
    allow="pedestrian"/>
  <lane id="west_1" index="1" speed="10" length="100" shape="0,0,1 100,0,1"
    disallow="pedestrian"/></edge>
<edge id=":j_0" function="internal"><lane id=":j_0_0" index="0" speed="10" length="31.4"
    shape="{BEND}"/></edge>
<edge id=":j_w0" function="walkingarea"><lane id=":j_w0_0" index="0" speed="1" length="3"
    allow="pedestrian" shape="100,-5 103,-5"/></edge>
<edge id=":j_c0" function="crossing"><lane id=":j_c0_0" index="0" speed="1" length="7"
    allow="pedestrian" shape="103,-5 103,5"/></edge>
<edge id=":j_w1" function="walkingarea"><lane id=":j_w1_0" index="0" speed="1" length="3"
    allow="pedestrian" shape="103,5 106,5"/></edge>
<edge id="north"><lane id="north_0" index="0" speed="10" length="50" shape="120,20,1 120,70,3"
    disallow="pedestrian"/></edge>
<edge id="path"><lane id="path_0" index="0" speed="1" length="40" shape="103,5,1 103,45,1"
    allow="pedestrian"/></edge>
<edge id="back"><lane id="back_0" index="0" speed="1" length="40" shape="100,-5,1 100,-45,1"
    allow="pedestrian"/></edge>
<connection from="west" to="north" fromLane="1" toLane="0" via=":j_0_0" dir="l"/>
<connection from=":j_0" to="north" fromLane="0" toLane="0" dir="l"/>
<connection from="west" to=":j_w0" fromLane="0" toLane="0" dir="s"/>
<connection from=":j_w0" to="back" fromLane="0" toLane="0" dir="s"/>
<connection from=":j_w0" to=":j_c0" fromLane="0" toLane="0" dir="s"/>
<connection from=":j_c0" to=":j_w1" fromLane="0" toLane="0" dir="s"/>
<connection from=":j_w1" to="path" fromLane="0" toLane="0" dir="s"/>
</net>"""


@pytest.fixture
def graph(tmp_path: Path) -> LaneGraph:
    (tmp_path / "net.xml").write_text(NETWORK)
    return read_lane_graph(tmp_path / "net.xml")


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
