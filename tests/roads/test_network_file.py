"""Networks of SUMO are refused where no lane can be as they say."""

from xml.etree.ElementTree import fromstring

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from advercity.roads.network_file import parse_network

NETWORK = """<net><edge id="a" from="b" to="c">
<lane id="a_0" index="0" speed="14" length="10" shape="0,0 10,0" width="{}"/></edge></net>"""


@pytest.mark.parametrize("width", ["-3.2", "0", "nan", "1e9"])
def test_a_lane_of_impossible_width_is_refused(width: str):
    with pytest.raises(ValueError, match=r"lane a_0 is .* m wide, not between 0 and 100 m"):
        parse_network(fromstring(NETWORK.format(width)))


def test_a_narrow_lane_is_read():
    (lane,) = parse_network(fromstring(NETWORK.format("0.4"))).lanes
    assert lane.width_m == 0.4


@settings(max_examples=25)
@given(radius_m=st.floats(8, 60), width_m=st.floats(1, 5), margin_m=st.floats(0, 1))
def test_a_lane_that_runs_around_a_ring_and_on_covers_the_ring(
    radius_m: float, width_m: float, margin_m: float
):
    turn = np.linspace(0, 2.2 * np.pi, 200)
    shape = " ".join(f"{radius_m * np.cos(at)},{radius_m * np.sin(at)}" for at in turn)
    text = NETWORK.format(width_m).replace("0,0 10,0", shape)
    (lane,) = parse_network(fromstring(text)).lanes
    area = lane.build_area(margin_m)
    # All around, without the hole that an outline drawn twice would have.
    assert area.area == pytest.approx(2 * np.pi * radius_m * (width_m + 2 * margin_m), rel=0.01)
    assert not area.contains(shapely.Point(0, 0))
