"""Lanes of a SUMO network, and who may use them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from advercity.errors import InputError, RunError
from advercity.roads.lane_graph import LaneGraph, StreetCrossing, read_lane_graph
from advercity.roads.network_file import SignalProgram
from tests.bend_network import NETWORK


def test_what_is_no_network_is_refused(tmp_path: Path):
    (tmp_path / "net.xml").write_text("<net><edge>")

    with pytest.raises(RunError, match="not a SUMO network"):
        read_lane_graph(tmp_path / "net.xml")


def test_lanes_are_distinguished_by_who_may_use_them(graph: LaneGraph):
    assert [lane.id for lane in graph.driving_lanes] == ["west_1", "north_0"]
    assert [lane.id for lane in graph.entry_lanes] == ["west_1"]
    assert set(graph.sidewalks) == {"west", "path", "back"}


def test_a_pose_finds_the_lane_that_leads_its_way(graph: LaneGraph):
    lane, position = graph.find_lane((40.0, 0.6), 0.1)

    assert (lane.id, position) == ("west_1", pytest.approx(40.0))
    with pytest.raises(InputError, match=r"no driving lane at 40, 0\.6"):
        graph.find_lane((40.0, 0.6), np.pi)


def test_crossings_are_walked_only_where_that_is_allowed(graph: LaneGraph):
    assert graph.adjacent_sidewalks["west"] == ("back",)
    ways = {(way.sidewalk, way.opposite) for way in graph.street_crossings}
    assert ways == {("west", "path"), ("path", "west"), ("back", "path"), ("path", "back")}


def test_people_set_out_at_green_that_lasts_long_enough():
    """Green from 10 to 20 s of every 30 s; a crossing without a light is free at once."""
    program = SignalProgram("j", 0.0, ((10.0, "Gr"), (10.0, "rG"), (10.0, "rr")))
    way = StreetCrossing("west", "path", at_end=True, approach_m=2.0, signal=(program, 1))

    found = {at: way.find_green_s(at) for at in (0.0, 12.5, 16.9, 17.1, 25.0)}
    assert found == {0.0: 10, 12.5: 12.5, 16.9: 16.9, 17.1: 40, 25.0: 40}
    assert replace(way, signal=None).find_green_s(25.0) == 25.0


def test_a_street_without_a_sidewalk_joins_no_sidewalks(tmp_path: Path) -> None:
    more = """
<edge id="yard"><lane id="yard_0" index="0" speed="10" length="9" shape="106,5 115,5"/></edge>
<edge id=":k_w0" function="walkingarea"><lane id=":k_w0_0" index="0" speed="1" length="3"
    allow="pedestrian" shape="115,5 118,5"/></edge>
<edge id="far"><lane id="far_0" index="0" speed="1" length="40" shape="118,5 158,5"
    allow="pedestrian"/></edge>
<connection from=":j_w1" to="yard" fromLane="0" toLane="0" dir="s"/>
<connection from="yard" to=":k_w0" fromLane="0" toLane="0" dir="s"/>
<connection from=":k_w0" to="far" fromLane="0" toLane="0" dir="s"/>
</net>"""
    (tmp_path / "net.xml").write_text(NETWORK.replace("</net>", more))
    graph = read_lane_graph(tmp_path / "net.xml")
    assert graph.adjacent_sidewalks["far"] == ()
    assert "far" not in {way.sidewalk for way in graph.street_crossings}
