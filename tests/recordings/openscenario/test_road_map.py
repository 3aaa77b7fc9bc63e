"""Lanes lead where the map says; headings follow their slope up to the ends of their sections."""

import math

import pytest

from advercity.foreign.xml_documents import parse_xml
from advercity.recordings.openscenario.road_map import LanePlace, RoadMap, choose_straightest
from advercity.roads.opendrive.parsing import parse_opendrive
from tests.recordings.openscenario.scenarios import write_opposite_roads
from tests.roads.opendrive_maps import cubic, lane, road, section


def read_map(text: str) -> RoadMap:
    return RoadMap(parse_opendrive(parse_xml(f"<OpenDRIVE><header/>{text}</OpenDRIVE>".encode())))


@pytest.mark.parametrize("station_m", [0.0, 0.01, 50.0, 99.99, 100.0])
def test_a_heading_has_the_slope_of_its_own_section(station_m: float) -> None:
    widens = section(0.0, lane(-1, "driving", (0.0, 3.0, 0.02)))
    steps = section(100.0, lane(-1, "driving", 9.0))
    roads = read_map(road("1", 200.0, widens + steps))

    place = LanePlace("1", -1, station_m, 0.0, 1)
    _, heading = roads.locate(place)
    # The middle of a lane that widens by 2 cm a metre moves half as fast.
    assert heading == pytest.approx(0.0 if station_m == 100.0 else -math.atan(0.01), abs=1e-6)


@pytest.mark.parametrize("offset_m", [-1.0, 0.5])
def test_a_place_is_carried_into_a_road_that_leads_the_other_way(offset_m: float) -> None:
    roads = read_map(write_opposite_roads())
    place = LanePlace("1", -1, 190.0, offset_m, 1)

    moved = roads.shift(place, 25.0, choose_straightest(roads, place))

    assert moved is not None
    assert (moved.road, moved.lane, moved.offset_m, moved.along) == ("2", 1, -offset_m, -1)
    point, heading = roads.locate(moved)
    assert point == pytest.approx(215 + 1j * (-1.75 + offset_m))
    assert math.cos(heading) == pytest.approx(1.0)


@pytest.mark.parametrize("left_m", [-20.0, 12.5])
def test_a_lane_of_a_banked_road_is_nearer_in_the_plan(left_m: float) -> None:
    lanes = section(0.0, *(lane(number, "driving", 60.0) for number in (1, -1)))
    bank = f"<lateralProfile>{cubic('superelevation', 0.0, math.pi / 3)}</lateralProfile>"
    roads = read_map(road("1", 100.0, lanes, before_lanes=bank))

    point, _ = roads.locate_road("1", 40.0, left_m)
    assert point == pytest.approx(40 + 0.5j * left_m)
    found = roads.find_nearest(point, 0.0)
    assert found is not None
    assert roads.find_left(found) == pytest.approx(left_m)
