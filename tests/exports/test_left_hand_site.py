"""The OpenDRIVE of a left-hand site, read by an independent sampler of the standard's formulas."""

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from advercity_dsl import Road, Spec
from advercity_exports.mirrored_opendrive import mirror_opendrive
from advercity_exports.site_opendrive import format_site

from advercity.roads.plan_frame import mirror_road, to_plan_frame
from advercity.roads.road_network import build_road
from advercity.roads.sumo_network import write_sumo_network
from benchmarks.opendrive_samples import OpenDriveMap
from tests.roads.left_hand_roads import build_street


@pytest.mark.parametrize("name", ["street", "ri"])
def test_lanes_are_where_those_of_the_world_are(
    name: str, specs: dict[str, Spec], tmp_path: Path
) -> None:
    road = (
        build_street() if name == "street" else mirror_road(specs[f"{name}_clear_day_dense"].road)
    )

    root = write_site(road, tmp_path)

    assert {item.get("rule") for item in root.iter("road")} == {"LHT"}
    samples = list(OpenDriveMap(root).sample_vehicle_lanes(1.0))
    points = np.concatenate([lane.centre[:, :2] for lane in samples])
    headings = np.concatenate([lane.heading for lane in samples])
    for lane in build_road(road).lanes:
        if lane.kind != "driving" or lane.in_junction:
            continue
        line = (lane.left + lane.right)[:, :2] / 2
        middle, step = (line[:-1] + line[1:]) / 2, np.diff(line, axis=0)
        for at, heading in zip(middle, np.arctan2(step[:, 1], step[:, 0]), strict=True):
            same_way = np.cos(headings - heading) > np.cos(0.1)
            gaps = np.linalg.norm(points[same_way] - at, axis=1)
            # Samples are 1 m apart; lanes of the other direction are 3 m away.
            assert gaps.min(initial=np.inf) < 0.6, lane.id


def write_site(road: Road, folder: Path) -> ElementTree.Element:
    network = write_sumo_network(to_plan_frame(road), folder)
    return ElementTree.fromstring(format_site(road, network))


def test_lane_ids_fall_from_left_to_right_and_links_follow(tmp_path: Path) -> None:
    right = write_site(to_plan_frame(build_street()), tmp_path)
    left = write_site(build_street(), tmp_path)

    header, other = left.find("header"), right.find("header")
    assert header is not None
    assert other is not None
    assert float(header.get("south", "")) == -float(other.get("north", ""))
    for section, image in zip(left.iter("laneSection"), right.iter("laneSection"), strict=True):
        ids = [int(lane.get("id", "")) for lane in section.iter("lane")]
        assert ids == sorted(ids, reverse=True)
        assert ids == [-int(lane.get("id", "")) for lane in image.iter("lane")][::-1]
    for link, image in zip(left.iter("laneLink"), right.iter("laneLink"), strict=True):
        assert int(link.get("from", "")) == -int(image.get("from", ""))


def test_what_lies_beside_a_road_comes_to_its_other_side() -> None:
    text = """<OpenDRIVE><road><planView><geometry s="0" x="1" y="2" hdg="0.5" length="3">
      <arc curvature="-0.01"/></geometry></planView>
      <objects><object t="4.50" hdg="0.00"><outline><cornerLocal u="1" v="-2"/></outline></object>
      </objects><signals><signal t="-3" orientation="+"><validity fromLane="-2" toLane="-1"/>
      </signal></signals></road></OpenDRIVE>"""
    root = ElementTree.fromstring(text)

    mirror_opendrive(root)

    found = {item.tag: dict(item.attrib) for item in root.iter()}
    assert found["geometry"] == {"s": "0", "x": "1", "y": "-2", "hdg": "-0.5", "length": "3"}
    assert found["arc"] == {"curvature": "0.01"}
    assert found["object"] == {"t": "-4.50", "hdg": "0.00"}
    assert found["cornerLocal"] == {"u": "1", "v": "2"}
    assert found["signal"] == {"t": "3", "orientation": "+"}
    assert found["validity"] == {"fromLane": "1", "toLane": "2"}
