"""OpenDRIVE maps at a local origin, on the globe, and with traffic on the left."""

from pathlib import Path

import numpy as np
import pytest

from advercity.errors import InputError
from advercity.roads.lane_segments import LaneSegment
from advercity.roads.road_network import build_road
from tests.roads.opendrive_maps import cubic, declare, import_text, lane, road, section

UTM = "<geoReference><![CDATA[+proj=utm +zone=32 +datum=WGS84]]></geoReference>"
LANES = section(0.0, lane(1, "driving", 3.5), lane(-1, "driving", 3.5), lane(-2, "sidewalk", 2.0))


def test_coordinates_of_a_projection_become_local(tmp_path: Path) -> None:
    far = road("1", 200.0, LANES, start=(691600.0, 5335000.0, 0.3))

    network = import_text(tmp_path, far, header=UTM)
    lanes = build_road(declare(network)).lanes

    assert network.offset_m == (691600, 5335000)
    assert max(np.abs(item.left[:, :2]).max() for item in lanes) < 210
    assert network.place is not None
    assert network.place.latitude_deg == pytest.approx(48.13937796639, abs=1e-8)
    assert network.place.longitude_deg == pytest.approx(11.57555823893, abs=1e-8)


def test_the_offset_of_the_header_is_where_the_map_is(tmp_path: Path) -> None:
    offset = '<offset x="691600" y="5335000" z="510" hdg="0.02"/>'

    network = import_text(tmp_path, road("1", 200.0, LANES), header=UTM + offset)

    assert network.offset_m == (0, 0)
    assert network.place is not None
    assert network.place.latitude_deg == pytest.approx(48.13937796639, abs=1e-8)
    assert network.place.altitude_m == 510
    assert network.place.convergence_deg == pytest.approx(1.91878 - np.degrees(0.02), abs=1e-4)


def test_a_projection_around_nowhere_is_no_place(tmp_path: Path) -> None:
    nowhere = "<geoReference>+proj=tmerc +lat_0=0 +lon_0=0 +k=1</geoReference>"

    assert import_text(tmp_path, road("1", 50.0, LANES), header=nowhere).place is None


def left_hand_lanes(folder: Path) -> dict[str, LaneSegment]:
    """A street for the left with a sidewalk at its south, on a bend, banked and widening."""
    shape = '<arc curvature="0.01"/>'
    banked = f"<lateralProfile>{cubic('superelevation', 0.0, 0.05)}</lateralProfile>"
    lanes = section(
        0.0,
        lane(1, "driving", (0.0, 3.0, 0.01)),
        lane(-1, "driving", 3.5),
        lane(-2, "sidewalk", 2.0),
    )
    street = road(
        "1",
        90.0,
        lanes,
        shape=shape,
        before_lanes=banked,
        attributes='rule="LHT"',
        start=(5.0, 8.0, 0.4),
    )
    network = import_text(folder, street)
    assert network.driving_side == "left"
    return {item.id: item for item in build_road(declare(network)).lanes}


def test_traffic_keeps_left_where_the_map_says_so(tmp_path: Path) -> None:
    lanes = left_hand_lanes(tmp_path)
    heading = 0.4
    normal = np.array([-np.sin(heading), np.cos(heading)])
    start = np.array([5.0, 8.0])

    (along,) = (
        item
        for item in lanes.values()
        if item.kind == "driving" and np.linalg.norm(item.right[0, :2] - start) < 0.1
    )
    # Left lanes lead along the road; 3 m wide, on the side that rises.
    np.testing.assert_allclose(along.left[0, :2], start + 3.0 * np.cos(0.05) * normal, atol=0.01)
    assert along.left[0, 2] == pytest.approx(3.0 * np.sin(0.05), abs=0.01)
    widths = np.linalg.norm(along.left - along.right, axis=1)
    assert widths[-1] == pytest.approx(3.9, abs=0.01)


def test_rules_of_both_sides_in_one_map_are_refused(tmp_path: Path) -> None:
    left = road("1", 50.0, LANES, attributes='rule="LHT"')
    right = road("2", 50.0, LANES, start=(0.0, 100.0, 0.0))

    with pytest.raises(InputError, match="line 1: <road>: rule differs from that of road '1'"):
        import_text(tmp_path, left, right)
