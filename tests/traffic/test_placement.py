"""Where background traffic may start."""

from pathlib import Path

import numpy as np
import pytest
from advercity_dsl import Spec

from advercity.roads.lane_graph import LaneGraph, read_lane_graph
from advercity.traffic.placement import (
    LaneOccupancy,
    StartArea,
    compute_start_areas,
    iterate_start_positions,
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


def test_there_is_an_area_around_every_agent_and_along_every_path(specs: dict[str, Spec]):
    found = compute_start_areas(specs["ui_clear_day_sparse"])

    assert len(found) == 8
    assert found[0].low == pytest.approx((-56.44, -96.45))
    assert found[0].high == pytest.approx((43.56, 3.55))
    assert found[5].low == pytest.approx((-6.44 - 15, -134.08 - 15))
    assert found[5].high == pytest.approx((64.96 + 15, -46.45 + 15))


def test_places_lie_in_the_areas_a_grid_step_apart(graph: LaneGraph):
    places = list(iterate_start_positions(graph.driving_lanes, [StartArea((10, -1), (40, 1))], 8.0))

    assert [(lane.id, position) for lane, position in places] == [
        ("west_1", position) for position in (12.0, 20.0, 28.0, 36.0)
    ]


def test_vehicles_start_five_metres_apart_and_clear_of_junctions(graph: LaneGraph):
    lane, occupancy = graph.driving_lanes[0], LaneOccupancy()
    occupancy.occupy(lane, 50.0, 4.0)

    assert occupancy.has_room(lane, 59.0, 4.0)
    assert not occupancy.has_room(lane, 58.9, 4.0)
    assert not occupancy.has_room(lane, 41.1, 4.0)
    assert occupancy.has_room(lane, 95.5, 4.0)
    assert not occupancy.has_room(lane, 95.6, 4.0)
    assert not occupancy.has_room(lane, 4.4, 4.0)
