"""Networks of SUMO are refused where no lane can be as they say."""

from xml.etree.ElementTree import fromstring

import pytest

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
