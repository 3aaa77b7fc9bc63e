"""Towns with traffic on the left, by their map, by their declaration or by their country."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from advercity_dsl import MapFile, MapNetwork, Road

from advercity.errors import InputError
from advercity.roads.driving_sides import find_left_hand_region
from advercity.roads.map_import import import_map
from advercity.roads.network_file import SumoLane, parse_packed_network
from tests.roads.imported_roads import declaration

LATITUDE, LONGITUDE = 48.0, 11.0


def import_street(
    folder: Path,
    tags: dict[str, str],
    other: dict[str, str] | None = None,
    place: tuple[float, float] = (LATITUDE, LONGITUDE),
    **declared: Any,
) -> MapNetwork:
    """Import a street that runs 222 m north, and one that leads on from it 222 m north."""
    north = 0.002
    nodes = "".join(
        f'<node id="{number}" lat="{place[0] + number * north}" lon="{place[1]}"/>\n'
        for number in range(3)
    )
    ways = ""
    for number, found in enumerate((tags, other or tags)):
        lines = "".join(f'<tag k="{key}" v="{value}"/>' for key, value in found.items())
        ways += f'<way id="1{number}"><nd ref="{number}"/><nd ref="{number + 1}"/>'
        ways += f'<tag k="highway" v="tertiary"/><tag k="maxspeed" v="50"/>{lines}</way>\n'
    (folder / "town.osm").write_text(f"<osm>\n{nodes}{ways}</osm>", encoding="utf-8")
    origin = {"origin_lat_deg": place[0], "origin_lon_deg": place[1]}
    road = Road.model_validate(declaration("osm", "town.osm", **origin))
    return import_map(MapFile(source="osm", file="town.osm", **declared), road, folder)


def list_lanes(network: MapNetwork) -> list[SumoLane]:
    """List lanes between junctions, with their shapes in the world."""
    lanes = [item for item in parse_packed_network(network.network).lanes if item.edge[0] != ":"]
    for lane in lanes:
        if network.driving_side == "left":
            lane.shape[:, 1] *= -1
    return lanes


def find_northbound(network: MapNetwork) -> list[SumoLane]:
    return [lane for lane in list_lanes(network) if lane.shape[-1, 1] > lane.shape[0, 1]]


@pytest.mark.parametrize(("side", "east_m"), [("left", -1.6), ("right", 1.6)])
def test_traffic_is_on_the_side_that_the_map_says(side: str, east_m: float, tmp_path: Path) -> None:
    network = import_street(tmp_path, {"lanes": "2", "driving_side": side})

    assert network.driving_side == side
    assert network.left_out == ()
    for lane in find_northbound(network):
        assert np.allclose(lane.shape[:, 0], east_m, atol=0.002)


def test_the_sidewalk_of_a_left_hand_street_is_on_its_side_of_the_world(tmp_path: Path) -> None:
    tags = {"oneway": "yes", "lanes": "2", "sidewalk": "left", "driving_side": "left"}
    lanes = find_northbound(import_street(tmp_path, tags))[:3]

    walk, *driving = sorted(lanes, key=lambda lane: lane.shape[0, 0])
    assert walk.kind == "sidewalk"
    # The two lanes of 3.2 m are centred on the way, the sidewalk of 2 m is beside them.
    assert np.allclose([lane.shape[0, 0] for lane in (walk, *driving)], [-4.2, -1.6, 1.6])


def test_lanes_of_a_left_hand_street_keep_their_order_in_the_world(tmp_path: Path) -> None:
    tags = {"oneway": "yes", "lanes": "2", "width:lanes": "3|4", "driving_side": "left"}
    lanes = find_northbound(import_street(tmp_path, tags))[:2]

    left, right = sorted(lanes, key=lambda lane: lane.shape[0, 0])
    assert (left.width_m, right.width_m) == (3, 4)
    assert np.allclose([left.shape[0, 0], right.shape[0, 0]], [-2, 1.5])


def test_an_extent_is_in_the_world_whatever_the_side(tmp_path: Path) -> None:
    for side in ("left", "right"):
        tags = {"driving_side": side}
        found = import_street(tmp_path, tags, extent_m=((-50, 250), (50, 300)))
        assert {lane.shape[0, 1] > 200 for lane in list_lanes(found)} == {True}


def test_the_declaration_overrules_the_map(tmp_path: Path) -> None:
    found = import_street(tmp_path, {"driving_side": "left"}, driving_side="right")
    assert found.driving_side == "right"
    with pytest.raises(ValueError, match="`driving_side` is for OpenStreetMap and Lanelet2 maps"):
        MapFile(source="sumo", file="a.net.xml", driving_side="left")


def test_a_map_without_a_side_takes_that_of_its_country_and_says_so(tmp_path: Path) -> None:
    assert import_street(tmp_path, {}).driving_side == "right"
    london = (51.5, -0.1)
    assert import_street(tmp_path, {"driving_side": "right"}, place=london).driving_side == "right"

    found = import_street(tmp_path, {}, place=london)

    assert found.driving_side == "left"
    (part,) = found.left_out
    assert part.name == (
        "driving side that the map lacks (left, as in the United Kingdom or Ireland, is assumed)"
    )


def test_a_map_with_traffic_on_both_sides_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=r"town.osm: line 6: .* right on way 11, .* left on way 10"
    ):
        import_street(tmp_path, {"driving_side": "left"}, {"driving_side": "right"})


@pytest.mark.parametrize(
    ("latitude", "longitude", "is_left"),
    [
        (55.95, -3.19, True),  # Edinburgh
        (51.13, 1.31, True),  # Dover
        (50.95, 1.85, False),  # Calais
        (50.73, 1.61, False),  # Boulogne
        (53.35, -6.26, True),  # Dublin
        (35.68, 139.69, True),  # Tokyo
        (35.10, 129.03, False),  # Busan
        (43.12, 131.90, False),  # Vladivostok
        (28.61, 77.21, True),  # Delhi
        (31.55, 74.34, True),  # Lahore
        (29.65, 91.12, False),  # Lhasa
        (-33.87, 151.21, True),  # Sydney
        (-36.85, 174.76, True),  # Auckland
        (-26.20, 28.05, True),  # Johannesburg
        (-8.84, 13.23, False),  # Luanda
        (22.28, 114.16, True),  # Hong Kong
        (22.55, 114.06, False),  # Shenzhen
        (13.75, 100.50, True),  # Bangkok
        (17.97, 102.60, False),  # Vientiane
        (40.71, -74.01, False),  # New York
        (0.0, 0.0, False),
    ],
)
def test_places_drive_on_the_side_of_their_country(
    latitude: float, longitude: float, is_left: bool
) -> None:
    assert (find_left_hand_region(latitude, longitude) is not None) == is_left
