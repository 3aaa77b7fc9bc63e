"""Trips of people on foot: some first cross a street, as many as a road declares."""

import math
from collections.abc import Callable, Mapping
from itertools import pairwise

import pytest
from advercity_dsl import Spec

from advercity.roads.lane_graph import LaneGraph, read_lane_graph
from advercity.roads.sumo_network import write_sumo_network
from advercity.traffic.demand import draw_demand
from advercity.traffic.pedestrians import PedestrianTrip

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
    return lambda share, redraws: draw_demand(spec, junction, redraws, crossing_share=share).walkers


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


@pytest.mark.parametrize(("redraws", "crosses"), [(1, True), (2, False)])
def test_who_is_in_the_way_twice_stays_on_its_side(
    redraws: int, crosses: bool, draw: Draw, junction: LaneGraph
) -> None:
    person = draw(1.0, {})[0].actor.id

    assert (person in find_crossing(draw(1.0, {person: redraws}), junction)) is crosses


def test_people_reach_their_crossing_soon_after_the_recording_begins(
    specs: dict[str, Spec], draw: Draw, junction: LaneGraph
) -> None:
    """Within 8 s, unless their sidewalk is too short for so long a way; no two from one place."""
    timing = specs["ui_clear_day_dense"].timing
    warm_up_s = timing.warm_up_ticks * timing.tick_s
    ends: dict[tuple[str, ...], bool] = {
        (it.sidewalk, it.opposite): it.at_end for it in junction.street_crossings
    }
    trips = draw(1.0, {})
    assert len({(trip.edge, trip.start_m) for trip in trips}) == len(trips)
    for trip in trips:
        length_m = junction.sidewalks[trip.edge].length_m
        way_m = length_m - trip.start_m if ends[trip.legs[0].edges] else trip.start_m
        assert way_m <= length_m - 0.5
        assert way_m / trip.speed_m_s < warm_up_s + 8.0 + 0.5
        if way_m < length_m - 1.0:
            assert way_m / trip.speed_m_s > warm_up_s - 0.5
