"""A small SUMO network by hand: a lane with a bend, and walking areas, for tests of lanes."""

from pathlib import Path

import numpy as np
import pytest

from advercity.roads.lane_graph import LaneGraph, read_lane_graph

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
"""A lane of 100 m, a left bend of radius 20 m, a lane of 50 m; sidewalks around a crossing."""


@pytest.fixture
def graph(tmp_path: Path) -> LaneGraph:
    """Lane graph of the network of a bend."""
    (tmp_path / "net.xml").write_text(NETWORK)
    return read_lane_graph(tmp_path / "net.xml")
