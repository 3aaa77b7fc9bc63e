"""Heights of bridges and tunnels of OpenStreetMap extracts."""

import math
from pathlib import Path

import numpy as np
import pytest
import shapely
from advercity_dsl import MapFile, MapNetwork, Road
from numpy.typing import NDArray

from advercity.errors import InputError
from advercity.roads.map_import import import_map
from advercity.roads.network_file import SumoLane, parse_packed_network
from tests.roads.imported_roads import declaration

Way = tuple[str, list[tuple[float, float]], dict[str, str]]
"""Name, places in metres, tags."""
METRES_PER_DEGREE = 111_200.0
LOWER: Way = ("Lower", [(-300, 0), (300, 0)], {})


def import_ways(folder: Path, *ways: Way) -> MapNetwork:
    """Import streets that share the nodes that are at the same place."""
    numbers: dict[tuple[float, float], int] = {}
    text = ""
    for index, (name, places, tags) in enumerate(ways):
        nodes = [numbers.setdefault(place, len(numbers) + 1) for place in places]
        found = {"highway": "tertiary", "maxspeed": "50", "name": name, **tags}
        text += f'<way id="{index + 1000}">' + "".join(f'<nd ref="{node}"/>' for node in nodes)
        text += (
            "".join(f'<tag k="{key}" v="{value}"/>' for key, value in found.items()) + "</way>\n"
        )
    nodes = "".join(
        f'<node id="{node}" lat="{north / METRES_PER_DEGREE}" lon="{east / METRES_PER_DEGREE}"/>\n'
        for (east, north), node in numbers.items()
    )
    (folder / "town.osm").write_text(f"<osm>{nodes}{text}</osm>", encoding="utf-8")
    road = Road.model_validate(declaration("osm", "town.osm", origin_lat_deg=0, origin_lon_deg=0))
    return import_map(MapFile(source="osm", file="town.osm"), road, folder)


def list_streets(network: MapNetwork) -> list[SumoLane]:
    return [lane for lane in parse_packed_network(network.network).lanes if lane.edge[0] != ":"]


def heights_at(network: MapNetwork, east: float, north: float) -> list[float]:
    """List the different heights of lanes that pass within 4 m of a place."""
    place = shapely.Point(east, north)
    found = set[float]()
    for lane in list_streets(network):
        line = shapely.LineString(lane.shape)
        if line.distance(place) < 4:
            found.add(round(line.interpolate(line.project(place)).z, 1))
    return sorted(found)


def steepest(network: MapNetwork) -> float:
    """Find the steepest grade of any lane."""
    grades = [grade for lane in list_streets(network) for grade in measure_grades(lane.shape)]
    return max(grades)


def measure_grades(shape: NDArray[np.float64]) -> NDArray[np.float64]:
    steps = np.diff(shape, axis=0)
    return np.abs(steps[:, 2]) / np.linalg.norm(steps[:, :2], axis=1)


def bridge(layer: str | None, length_m: float = 40, **tags: str) -> list[Way]:
    """Make a street along the y axis with a bridge over the x axis."""
    half = length_m / 2
    over = {"bridge": "yes", **tags} if layer is None else {"bridge": "yes", "layer": layer, **tags}
    return [
        ("Upper", [(0, -400), (0, -half)], {}),
        ("Upper", [(0, -half), (0, half)], over),
        ("Upper", [(0, half), (0, 400)], {}),
    ]


@pytest.mark.parametrize(
    ("layer", "height_m"), [("1", 5.5), (None, 5.5), ("2", 11.0), ("5", 27.5), ("9", 27.5)]
)
def test_a_bridge_is_a_height_above_the_ground_for_each_layer(
    layer: str | None, height_m: float, tmp_path: Path
) -> None:
    network = import_ways(tmp_path, LOWER, *bridge(layer))

    assert heights_at(network, 0, 0) == [0.0, height_m]
    assert heights_at(network, 250, 0) == [0.0]
    assert heights_at(network, 0, 18) == [height_m]
    assert network.left_out == ()
    # Half a cosine from 0 to H, with a grade of 6 % in its middle, is pi H / 0.12 long.
    reach_m = 20 + math.pi * height_m / 0.12
    assert heights_at(network, 0, min(reach_m / 2 + 10, 399)) != [0.0]
    if reach_m < 390:
        assert heights_at(network, 0, reach_m + 8) == [0.0]
    assert steepest(network) <= 0.061


def test_streets_that_lead_onto_a_ramp_rise_with_it(tmp_path: Path) -> None:
    upper = bridge("1")
    upper[2] = ("Upper", [(0, 20), (0, 60), (0, 400)], {})
    side: Way = ("Side", [(0, 60), (200, 60)], {})
    network = import_ways(tmp_path, LOWER, *upper, side)

    (height_m,) = heights_at(network, 12, 60)
    assert 4.5 < height_m < 5.2
    assert heights_at(network, 190, 60) == [0.0]
    assert steepest(network) <= 0.062


def test_a_tunnel_is_lowered_below_the_street_over_it(tmp_path: Path) -> None:
    ways = bridge("-1", tunnel="yes", bridge="no")
    network = import_ways(tmp_path, LOWER, *ways)

    assert heights_at(network, 0, 0) == [-5.5, 0.0]
    assert heights_at(network, 0, 399) == [0.0]


def test_only_the_crossing_of_a_long_street_of_a_layer_is_lifted(tmp_path: Path) -> None:
    upper: Way = ("Upper", [(0, -400), (0, 400)], {"layer": "1"})
    network = import_ways(tmp_path, LOWER, upper)

    assert heights_at(network, 0, 0) == [0.0, 5.5]
    assert heights_at(network, 0, 300) == [0.0]


def test_a_bridge_over_no_street_stays_level(tmp_path: Path) -> None:
    network = import_ways(tmp_path, *bridge("1"))

    assert not any(lane.shape[:, 2].any() for lane in list_streets(network))


def test_short_ramps_are_steeper_and_those_without_room_are_named(tmp_path: Path) -> None:
    def loop(reach: float) -> list[Way]:
        """Make a bridge whose street leads around a square and below it."""
        corners = [(0.0, 8.0), (0.0, reach), (reach, reach), (reach, 0.0)]
        return [
            ("Loop", [*corners, (-300, 0)], {}),
            ("Bridge", [(0, -8), (0, 8)], {"bridge": "yes", "layer": "1"}),
        ]

    roomy = import_ways(tmp_path, *loop(80))
    assert roomy.left_out == ()
    assert heights_at(roomy, 0, 0)[-1] - heights_at(roomy, 0, 0)[0] >= 4.0
    assert steepest(roomy) <= 0.125

    narrow = import_ways(tmp_path, *loop(10))
    (part,) = narrow.left_out
    assert part.name == "room for the ramps of Bridge over Loop"


def test_streets_of_one_layer_that_cross_without_a_junction_are_listed(tmp_path: Path) -> None:
    upper: Way = ("Upper", [(0, -400), (0, 400)], {})
    network = import_ways(tmp_path, LOWER, upper)

    (part,) = network.left_out
    assert part.name == "crossing of streets of one layer without a junction"


def test_a_lanelet2_map_is_no_extract(tmp_path: Path) -> None:
    text = "<osm><node id='1' lat='0' lon='0'/><relation id='2'>{}</relation></osm>"
    tag = "<tag k='type' v='lanelet'/>"
    (tmp_path / "town.osm").write_text(text.format(tag), encoding="utf-8")
    road = Road.model_validate(declaration("osm", "town.osm"))

    with pytest.raises(InputError, match=r"town\.osm: is a Lanelet2 map; say `source: lanelet2`"):
        import_map(MapFile(source="osm", file="town.osm"), road, tmp_path)


@pytest.mark.parametrize(("apart_m", "is_lifted"), [(0.4, False), (0.7, True)])
def test_ways_that_also_cross_within_half_a_metre_of_their_junction_meet_there(
    apart_m: float, is_lifted: bool, tmp_path: Path
) -> None:
    # The upper street leaves the junction to one side and comes back over the lower one.
    upper: Way = (
        "Upper",
        [(0, -400), (0, 0), (apart_m - 0.05, 0.05), (apart_m + 0.05, -0.05), (30, -100)],
        {"layer": "1"},
    )
    network = import_ways(tmp_path, ("Lower", [(-300, 0), (0, 0), (300, 0)], {}), upper)

    height_m = max(lane.shape[:, 2].max() for lane in list_streets(network))
    assert (height_m > 1) == is_lifted
