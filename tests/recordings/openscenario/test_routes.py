"""Routes decide which way actors take through a junction, and where a place on them is."""

import math
from pathlib import Path

import pytest

from advercity.diagnostics import DiagnosticsError
from advercity.foreign.ledger import describe_left_out
from advercity.recordings.openscenario.scenario import read_scenario
from tests.recordings.openscenario.scenarios import (
    begin,
    find_heading,
    find_rear_axle,
    play,
    write_opposite_roads,
)
from tests.roads.opendrive_maps import lane, road, section

AT_80 = '<LanePosition roadId="1" laneId="-1" s="80"/>'
ON_BEND = '<Position><LanePosition roadId="3" laneId="-1" s="40"/></Position>'
ROUTE = f"""<Route name="r" closed="false">
  <Waypoint routeStrategy="shortest"><Position>{AT_80}</Position></Waypoint>
  <Waypoint routeStrategy="shortest">{ON_BEND}</Waypoint></Route>"""
ASSIGN = f"<RoutingAction><AssignRouteAction>{ROUTE}</AssignRouteAction></RoutingAction>"
ACQUIRE = f"<RoutingAction><AcquirePositionAction>{ON_BEND}</AcquirePositionAction></RoutingAction>"
LANE_M = 51.75
"""Radius of the right lane of the bend."""


def write_fork() -> str:
    """Write a road that leads, at x = 100, straight on as road 2 and to the left as road 3."""
    lanes = section(0.0, *(lane(number, "driving", 3.5) for number in (1, -1)))
    fork = '<successor elementType="junction" elementId="9"/>'
    back = '<predecessor elementType="road" elementId="1" contactPoint="end"/>'
    ends = {
        number: road(number, 100.0, lanes, start=(100.0, 0.0, 0.0), shape=shape, link=back).replace(
            'junction="-1"', 'junction="9"'
        )
        for number, shape in (("2", "<line/>"), ("3", '<arc curvature="0.02"/>'))
    }
    ways = "".join(
        f"""<connection id="{number}" incomingRoad="1" connectingRoad="{number}"
          contactPoint="start"><laneLink from="-1" to="-1"/></connection>"""
        for number in ends
    )
    return f"""{road("1", 100.0, lanes, link=fork)}{"".join(ends.values())}
      <junction id="9" name="fork">{ways}</junction>"""


@pytest.mark.parametrize("action", [ASSIGN, ACQUIRE])
def test_an_actor_takes_the_way_of_its_route(action: str, tmp_path: Path) -> None:
    ego = play(tmp_path, init=begin("Ego", AT_80, 10.0, action), end_s=5, streets=write_fork())

    # 30 m are left after the 20 m up to the fork.
    turned = 30 / LANE_M
    bend = [100 + LANE_M * math.sin(turned), 50 - LANE_M * math.cos(turned)]
    assert find_rear_axle(ego["Ego"], 5.0)[0] == pytest.approx(bend, abs=0.05)
    assert find_heading(ego["Ego"], 5.0) == pytest.approx(turned, abs=0.01)


def test_without_a_route_it_drives_straight_on_and_that_is_listed(tmp_path: Path) -> None:
    ego = play(tmp_path, init=begin("Ego", AT_80, 10.0), end_s=5, streets=write_fork())["Ego"]

    assert find_rear_axle(ego, 5.0)[0] == pytest.approx([130, -1.75])
    left_out = describe_left_out(read_scenario(tmp_path / "crash.xosc").left_out)
    assert "1 junction that is passed straight on, for want of a route" in left_out


@pytest.mark.parametrize("covered_m", [0.0, 90.0, 300.0])
def test_a_place_on_a_route_is_found_over_its_roads(covered_m: float, tmp_path: Path) -> None:
    route = ROUTE.replace("80", "20").replace('"3" laneId="-1" s="40"', '"2" laneId="1" s="10"')
    lane_id = 1 if covered_m > 180 else -1
    place = f"""<RoutePosition><RouteRef>{route}</RouteRef><InRoutePosition>
      <FromLaneCoordinates pathS="{covered_m}" laneId="{lane_id}" laneOffset="0"/>
      </InRoutePosition></RoutePosition>"""
    init = begin("Ego", place, 10.0)
    ego = play(tmp_path, init=init, end_s=2, streets=write_opposite_roads())["Ego"]

    x = 20 + covered_m
    assert find_rear_axle(ego, 0.0, 2.0).ravel() == pytest.approx([x, -1.75, x + 20, -1.75])


def test_a_waypoint_on_another_route_is_refused(tmp_path: Path) -> None:
    place = f"<RoutePosition><RouteRef>{ROUTE}</RouteRef></RoutePosition>"
    action = ASSIGN.replace(AT_80, place)
    with pytest.raises(DiagnosticsError, match="<RoutePosition>: a waypoint is on another route"):
        play(tmp_path, init=begin("Ego", AT_80, 10.0, action), streets=write_fork())


def test_a_goal_to_which_no_road_leads_is_refused(tmp_path: Path) -> None:
    begins = begin("Ego", '<LanePosition roadId="2" laneId="-1" s="10"/>', 10.0, ACQUIRE)
    with pytest.raises(DiagnosticsError, match="no roads lead to the waypoint on road '3'"):
        play(tmp_path, init=begins, streets=write_fork())
