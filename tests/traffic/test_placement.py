"""Where background traffic may start."""

import pytest
from advercity_dsl import Spec

from advercity.roads.lane_graph import LaneGraph
from advercity.traffic.placement import (
    LaneOccupancy,
    StartArea,
    compute_start_areas,
    iterate_start_positions,
)


def test_there_is_an_area_around_every_agent_and_along_every_path(specs: dict[str, Spec]):
    found = compute_start_areas(specs["ui_clear_day_sparse"])

    assert len(found) == 8
    assert found[0].low == pytest.approx((-56.44, -96.45))
    assert found[0].high == pytest.approx((43.56, 3.55))
    assert found[5].low == pytest.approx((-6.44 - 15, -133.0 - 15))
    assert found[5].high == pytest.approx((112.0 + 15, -46.45 + 15))


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
