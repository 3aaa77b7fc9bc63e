"""Trips of people on foot: some first cross a street, as many as a road declares."""

import math
from collections.abc import Callable, Mapping
from itertools import pairwise

import pytest
from advercity_dsl import Spec

from advercity.roads.lane_graph import LaneGraph, read_lane_graph
from advercity.roads.sumo_network import write_sumo_network
from advercity.traffic.demand import draw_demand
from advercity.traffic.pedestrians import END_CLEARANCE_M, MAX_CROSSING_DRAWS, PedestrianTrip

pytestmark = pytest.mark.sumo

SHARES = (0.25, 0.5, 0.75, 1.0)

Draw = Callable[[float, Mapping[int, int]], tuple[PedestrianTrip, ...]]


@pytest.fixture(scope="module")
def junction(specs: dict[str, Spec], tmp_path_factory: pytest.TempPathFactory) -> LaneGraph:
    folder = tmp_path_factory.mktemp("network")
    return read_lane_graph(write_sumo_network(specs["ui_clear_day_dense"].road, folder))


@pytest.fixture
def draw(specs: dict[str, Spec], junction: LaneGraph) -> Draw:
    """Draw trips by the share of people who set out to cross, and by redraws."""
    spec = specs["ui_clear_day_dense"]

    def draw_trips(share: float, redraws: Mapping[int, int]) -> tuple[PedestrianTrip, ...]:
        demand = spec.demand.model_copy(update={"crossing_share": share})
        changed = spec.model_copy(update={"demand": demand})
        return draw_demand(changed, junction, redraws).walkers

    return draw_trips


def find_crossing(trips: tuple[PedestrianTrip, ...], graph: LaneGraph) -> set[int]:
    """Find the people whose first leg leads across a street."""
    across = {(it.sidewalk, it.opposite) for it in graph.street_crossings}
    return {trip.actor.id for trip in trips if trip.legs[0].edges in across}


def test_the_share_of_people_sets_out_to_cross(draw: Draw, junction: LaneGraph) -> None:
    """Who crosses at a low share does so at every higher one."""
    nobody, *crossing = (find_crossing(draw(share, {}), junction) for share in (0.0, *SHARES))
    count = len(draw(0.0, {}))

    assert nobody == set()
    assert all(few <= more for few, more in pairwise(crossing))
    for share, found in zip(SHARES, crossing, strict=True):
        spread = 4 * math.sqrt(count * share * (1 - share))
        assert len(found) == pytest.approx(share * count, abs=spread)


@pytest.mark.parametrize(
    ("redraws", "crosses"), [(MAX_CROSSING_DRAWS - 1, True), (MAX_CROSSING_DRAWS, False)]
)
def test_who_is_in_the_way_too_often_stays_on_its_side(
    redraws: int, crosses: bool, draw: Draw, junction: LaneGraph
) -> None:
    person = draw(1.0, {})[0].actor.id

    assert (person in find_crossing(draw(1.0, {person: redraws}), junction)) is crosses


def test_people_reach_their_crossing_at_green_after_the_recording_begins(
    specs: dict[str, Spec], draw: Draw, junction: LaneGraph
) -> None:
    """Unless their sidewalk is too short for so long a way; without lights within 8 s."""
    timing = specs["ui_clear_day_dense"].timing
    warm_up_s = timing.warm_up_ticks * timing.tick_s
    crossings = {(it.sidewalk, it.opposite): it for it in junction.street_crossings}
    in_time = 0
    for trip in draw(1.0, {}):
        crossing = crossings[trip.legs[0].edges[0], trip.legs[0].edges[1]]
        length_m = junction.sidewalks[trip.edge].length_m
        way_m = length_m - trip.start_m if crossing.at_end else trip.start_m
        arrives_s = (way_m + crossing.approach_m) / trip.speed_m_s
        if END_CLEARANCE_M + 0.01 < way_m < length_m - END_CLEARANCE_M - 0.01:
            in_time += 1
            assert arrives_s > warm_up_s - 0.01
            assert crossing.find_green_s(arrives_s) == pytest.approx(arrives_s, abs=0.01)
            assert crossing.signal is not None or arrives_s < warm_up_s + 8.0 + 0.01
    assert in_time > 50
