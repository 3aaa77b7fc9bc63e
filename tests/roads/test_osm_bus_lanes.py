"""Bus lanes of OpenStreetMap extracts are closed to cars, or listed."""

from pathlib import Path

import pytest
from advercity_dsl import MapFile, Road

from advercity.foreign.ledger import describe_left_out
from advercity.roads.map_import import import_map
from advercity.roads.network_file import parse_packed_network
from tests.roads.imported_roads import declaration

LISTED = "1 bus lane (open to cars) (line 3)"


def import_street(folder: Path, tags: dict[str, str]) -> tuple[list[bool], list[bool], str]:
    """Import a street; which lanes along it and against it cars may use, from the right, and more.

    The last value is what is left out.
    """
    lines = "".join(f'<tag k="{key}" v="{value}"/>' for key, value in tags.items())
    nodes = '<node id="1" lat="0" lon="0"/><node id="2" lat="0" lon="0.002"/>'
    ends = '<nd ref="1"/><nd ref="2"/><tag k="name" v="s"/><tag k="highway" v="tertiary"/>'
    text = f'<osm>{nodes}\n\n<way id="1">{ends}<tag k="maxspeed" v="50"/>{lines}</way></osm>'
    (folder / "town.osm").write_text(text, encoding="utf-8")
    declared = declaration("osm", "town.osm", origin_lat_deg=0, origin_lon_deg=0)
    road = Road.model_validate(declared | {"land_use": "rural"})
    network = import_map(MapFile(source="osm", file="town.osm"), road, folder)
    lanes = [lane for lane in parse_packed_network(network.network).lanes if lane.edge[0] == "s"]
    leads_east = [bool(lane.shape[-1, 0] > lane.shape[0, 0]) for lane in lanes]
    along, against = (
        [
            lane.is_driving_lane
            for lane, leads in zip(lanes, leads_east, strict=True)
            if leads is way
        ]
        for way in (True, False)
    )
    return along, against, describe_left_out(network.left_out)


@pytest.mark.parametrize(
    ("tags", "along", "against", "listed"),
    [
        ({"bus:lanes": "yes|yes|designated", "lanes": "3"}, [False, True, True], [], ""),
        ({"bus:lanes": "designated||", "lanes": "3"}, [True, True, False], [], ""),
        ({"psv:lanes": "|designated", "lanes": "2"}, [False, True], [], ""),
        ({"bus:lanes": "yes|designated", "lanes": "3"}, [True, True, True], [], LISTED),
        ({"bus:lanes": "yes|designated"}, [True], [], LISTED),
        ({"lanes:bus": "1", "lanes": "2"}, [True, True], [], LISTED),
    ],
)
def test_a_bus_lane_of_a_one_way_street_is_closed_to_cars_or_listed(
    tags: dict[str, str], along: list[bool], against: list[bool], listed: str, tmp_path: Path
) -> None:
    assert import_street(tmp_path, {"oneway": "yes", **tags}) == (along, against, listed)


def test_bus_lanes_of_both_directions_are_closed_to_cars(tmp_path: Path) -> None:
    halves = {"lanes": "4", "bus:lanes:forward": "yes|designated"}
    assert import_street(tmp_path, halves) == ([False, True], [True, True], "")
    counted = {"lanes": "3", "lanes:forward": "1", "lanes:backward": "2"}
    both = counted | {"bus:lanes:backward": "designated|yes", "bus:lanes:forward": "|designated"}
    assert import_street(tmp_path, both) == ([True], [True, False], LISTED)


def test_cycle_lanes_between_lanes_close_none_to_cars(tmp_path: Path) -> None:
    """The values of cycle lanes are not among `lanes`: netconvert would close the lane of cars."""
    tags = {"vehicle:lanes": "yes|no|yes", "bicycle:lanes": "yes|designated|yes"}
    along, _, listed = import_street(tmp_path, {"oneway": "yes", "lanes": "2", **tags})
    assert along == [True, True]
    assert listed == "2 lanes with access rules (line 3)"
