"""Lanes, limits and places of Lanelet2 maps."""

import re
from pathlib import Path

import numpy as np
import pytest

from advercity.errors import InputError
from advercity.roads.lane_uses import ROADWAY, LaneUse
from advercity.roads.lanelet2.uses import BICYCLE, find_use
from advercity.roads.network_file import parse_packed_network
from tests.roads.lanelet2_maps import (
    LaneletMap,
    find_streets,
    get_street,
    import_lanelets,
    import_text,
    member,
)

LENGTH_M = 120.0


def line(y: float) -> list[tuple[float, float, float]]:
    return [(x, y, 0.0) for x in (0.0, 50.0, LENGTH_M)]


@pytest.mark.parametrize(
    ("key", "use"), [("participant:bicycle", BICYCLE), ("no_participant:bicycle", ROADWAY)]
)
def test_participants_are_read_of_their_own_keys_alone(key: str, use: LaneUse) -> None:
    assert find_use({"subtype": "road", key: "yes"}) == use


@pytest.mark.parametrize("turned", [(), ("left",), ("right",), ("left", "right")])
def test_bounds_may_be_drawn_in_any_direction(turned: tuple[str, ...], tmp_path: Path) -> None:
    lanelets = LaneletMap()
    bounds = {"left": line(3.25), "right": line(0.0)}
    left, right = (lanelets.way(it[::-1] if side in turned else it) for side, it in bounds.items())
    name = lanelets.lanelet(left, right)

    (lane,) = get_street(import_lanelets(tmp_path, lanelets), name).lanes

    assert lane.centre[[0, -1]].tolist() == [[0.0, 1.625, 0.0], [LENGTH_M, 1.625, 0.0]]
    assert lane.width_m == pytest.approx(3.25)


def test_opposite_lanelets_are_the_directions_of_one_street(tmp_path: Path) -> None:
    lanelets = LaneletMap()
    middle = lanelets.way(line(0.0), subtype="dashed")
    east = lanelets.lanelet(middle, lanelets.way(line(-3.5)))
    lanelets.lanelet(middle, lanelets.way(line(3.0)))

    streets = find_streets(import_lanelets(tmp_path, lanelets))

    assert set(streets) == {f"lanelet_{east}+", f"lanelet_{east}-"}
    back = streets[f"lanelet_{east}-"].lanes[0].centre
    assert back[[0, -1]].tolist() == [[LENGTH_M, 1.5, 0.0], [0.0, 1.5, 0.0]]


def test_neighbours_share_a_street_and_keep_their_widths(tmp_path: Path) -> None:
    lanelets = LaneletMap()
    ways = [lanelets.way(line(y)) for y in (7.5, 4.0, 1.0, -0.8)]
    lanelets.lanelet(ways[0], ways[1])
    lanelets.lanelet(ways[1], ways[2], subtype="bus_lane")
    lanelets.lanelet(ways[2], ways[3], subtype="walkway", road_name="Elm")

    (street,) = find_streets(import_lanelets(tmp_path, lanelets)).values()

    # Lanes are counted from the right.
    assert [lane.kind for lane in street.lanes] == ["sidewalk", "shoulder", "driving"]
    assert [lane.width_m for lane in street.lanes] == pytest.approx([1.8, 3.0, 3.5])
    assert street.lanes[1].allowed_classes == {"bus"}


def test_a_street_has_the_name_of_its_lanelets(tmp_path: Path) -> None:
    lanelets = LaneletMap()
    lanelets.lane(line(3.0), line(0.0), road_name="Elm Street")

    assert set(find_streets(import_lanelets(tmp_path, lanelets))) == {"elm_street+"}


def test_a_lane_that_opens_keeps_its_bounds(tmp_path: Path) -> None:
    lanelets = LaneletMap()
    left = [(0.0, 3.0), (40.0, 3.0), (60.0, 5.0), (100.0, 5.0)]
    name = lanelets.lane(left, [(0.0, 0.0), (100.0, 0.0)])

    (lane,) = get_street(import_lanelets(tmp_path, lanelets), name).lanes

    found = np.interp([20, 50, 55, 80], *lane.left_border[:, :2].T)
    assert found == pytest.approx([3.0, 4.0, 4.5, 5.0], abs=0.02)
    assert np.abs(lane.right_border[:, 1]).max() < 0.02


@pytest.mark.parametrize(
    ("tags", "speed_km_h"),
    [
        ({}, 50),
        ({"location": "nonurban"}, 100),
        ({"subtype": "highway"}, 130),
        ({"subtype": "play_street"}, 7),
        ({"speed_limit": "35"}, 35),
        ({"speed_limit": "25 mph"}, 40.23),
        ({"speed_limit": "10 mps", "location": "nonurban"}, 36),
    ],
)
def test_limits_are_of_tags_or_of_the_kind_of_road(
    tags: dict[str, str], speed_km_h: float, tmp_path: Path
) -> None:
    lanelets = LaneletMap()
    name = lanelets.lane(line(3.0), line(0.0), **tags)

    (lane,) = get_street(import_lanelets(tmp_path, lanelets), name).lanes

    assert lane.speed_limit_m_s * 3.6 == pytest.approx(speed_km_h, abs=0.01)


@pytest.mark.parametrize(
    ("sign", "sign_type", "speed_km_h"),
    [("de274-70", "", 70), ("de274.1", "", 30), ("", "15mph", 24.14), ("usR2-1", "20 km/h", 20)],
)
def test_limits_are_of_signs(sign: str, sign_type: str, speed_km_h: float, tmp_path: Path) -> None:
    lanelets = LaneletMap()
    posted = lanelets.way([(0.0, -1.0), (0.0, -1.6)], "traffic_sign", subtype=sign)
    tags = {"sign_type": sign_type} if sign_type else {}
    rule = lanelets.rule("speed_limit", member("refers", posted) if sign else "", **tags)
    name = lanelets.lanelet(lanelets.way(line(3.0)), lanelets.way(line(0.0)), [rule])

    (lane,) = get_street(import_lanelets(tmp_path, lanelets), name).lanes

    assert lane.speed_limit_m_s * 3.6 == pytest.approx(speed_km_h, abs=0.01)


@pytest.mark.parametrize(
    ("tags", "kind", "classes"),
    [
        ({"participant:vehicle:bus": "yes", "participant:pedestrian": "no"}, "shoulder", {"bus"}),
        ({"participant:vehicle:car": "yes", "participant:vehicle:bus": "yes"}, "driving", None),
        ({"participant:bicycle": "yes", "participant:pedestrian": "yes"}, "sidewalk", None),
        ({"subtype": "bicycle_lane"}, "shoulder", {"bicycle"}),
    ],
)
def test_participants_override_the_subtype(
    tags: dict[str, str], kind: str, classes: set[str] | None, tmp_path: Path
) -> None:
    lanelets = LaneletMap()
    ways = [lanelets.way(line(y)) for y in (6.5, 3.0, 0.0)]
    lanelets.lanelet(ways[0], ways[1])
    lanelets.lanelet(ways[1], ways[2], (), **tags)

    (street,) = find_streets(import_lanelets(tmp_path, lanelets)).values()

    assert street.lanes[0].kind == kind
    assert classes is None or street.lanes[0].allowed_classes == classes


def test_traffic_keeps_left_where_opposite_lanelets_meet_on_their_right(tmp_path: Path) -> None:
    lanelets = LaneletMap()
    middle = lanelets.way(line(2.0))
    lanelets.lanelet(lanelets.way(line(5.0)), middle)
    lanelets.lanelet(lanelets.way(line(-2.0)), middle)

    found = import_text(tmp_path, lanelets.write())

    assert found.driving_side == "left"
    # In the plan, y counts to the south: the lane to the east is on the right of the other.
    streets = find_streets(parse_packed_network(found.network))
    east = next(it for it in streets.values() if it.lanes[0].centre[0, 0] == 0.0)
    assert east.lanes[0].centre[0, 1] == -3.5


def test_a_declared_side_is_that_of_lanelets_without_opposite_ones(tmp_path: Path) -> None:
    lanelets = LaneletMap()
    lanelets.lane(line(3.0), line(0.0))

    assert import_text(tmp_path, lanelets.write()).driving_side == "right"
    assert import_text(tmp_path, lanelets.write(), driving_side="left").driving_side == "left"


def write_degrees(*points: tuple[float, float]) -> str:
    nodes = [f'<node id="{k}" lat="{lat}" lon="{lon}"/>' for k, (lat, lon) in enumerate(points)]
    ways = (
        f'<way id="{10 + k}"><nd ref="{2 * k}"/><nd ref="{2 * k + 1}"/>'
        '<tag k="type" v="line_thin"/></way>'
        for k in range(2)
    )
    tags = '<tag k="type" v="lanelet"/><tag k="subtype" v="road"/>'
    relation = f'<relation id="20">{member("left", 10)}{member("right", 11)}{tags}</relation>'
    return f"<osm>{''.join(nodes)}{''.join(ways)}{relation}</osm>"


def test_latitudes_and_longitudes_become_utm_around_the_origin_of_the_road(tmp_path: Path) -> None:
    # To the north along the middle of zone 32, where the scale is 0.9996. At 50 degrees, a degree
    # of the meridian has 111 229 m, one of the parallel 71 696 m.
    text = write_degrees((50.0, 9.0), (50.001, 9.0), (50.0, 9.00005), (50.001, 9.00005))

    found = import_text(tmp_path, text, origin_lat_deg=50.0, origin_lon_deg=9.00002)

    (lane,) = next(iter(find_streets(parse_packed_network(found.network)).values())).lanes
    assert lane.centre[-1, 1] - lane.centre[0, 1] == pytest.approx(111.1845, abs=0.01)
    assert lane.width_m == pytest.approx(3.5834, abs=0.002)
    assert lane.centre[0, 0] == pytest.approx(0.3583, abs=0.002)
    assert found.place is not None
    assert (found.place.latitude_deg, found.place.longitude_deg) == pytest.approx((50, 9.00002))


def test_a_map_far_from_the_origin_is_refused_with_its_middle(tmp_path: Path) -> None:
    text = write_degrees((50.0, 9.0), (50.001, 9.0), (50.0, 9.00005), (50.001, 9.00005))

    with pytest.raises(InputError, match=r"map\.osm: is \d+ km .* `origin_lat_deg: 50\.00050`"):
        import_text(tmp_path, text)


def test_large_local_coordinates_get_a_local_origin(tmp_path: Path) -> None:
    lanelets = LaneletMap()
    moved = [[(81_700.0 + x, 50_200.0 + y) for x in (0.0, 80.0)] for y in (3.0, 0.0)]
    name = lanelets.lane(*moved)

    assert import_text(tmp_path, lanelets.write()).offset_m == (81_700.0, 50_200.0)
    (lane,) = get_street(import_lanelets(tmp_path, lanelets), name).lanes
    assert lane.centre[0].tolist() == [0.0, 1.5, 0.0]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('role="left"', 'role="centerline"', "a lanelet without a left bound"),
        ('ref="1001" role="left"', 'ref="7" role="left"', "its left bound is way 7, which the"),
        ('<nd ref="2"/>', '<nd ref="77"/>', "line 8: way 1001: goes through node 77"),
        ('k="local_y" v="3.0"', 'k="local_y" v="nan"', "line 2: node 1: local_y 'nan' is no num"),
        ('k="ele" v="0.0"', 'k="ele" v="high"', "line 2: node 1: ele 'high' is no number"),
        ('v="lanelet"', 'v="multipolygon"', "has no lanelets; say `source: osm`"),
    ],
)
def test_mistakes_are_told_with_their_place(
    old: str, new: str, message: str, tmp_path: Path
) -> None:
    lanelets = LaneletMap()
    lanelets.lane(line(3.0), line(0.0))

    with pytest.raises(InputError, match=re.escape(message)):
        import_text(tmp_path, lanelets.write().replace(old, new))


def test_a_map_of_walkways_alone_has_no_lane_for_cars(tmp_path: Path) -> None:
    lanelets = LaneletMap()
    lanelets.lane(line(3.0), line(0.0), subtype="walkway")

    with pytest.raises(InputError, match="has no lane for cars"):
        import_text(tmp_path, lanelets.write())


def test_a_lanelet_longer_than_a_site_is_refused(tmp_path: Path) -> None:
    lanelets = LaneletMap()
    lanelets.lane([(0.0, 3.0), (11_000.0, 3.0)], [(0.0, 0.0), (11_000.0, 0.0)])

    with pytest.raises(InputError, match="relation 1003: a lanelet that is longer than 10000 m"):
        import_text(tmp_path, lanelets.write())


def test_a_long_lanelet_keeps_its_bounds(tmp_path: Path) -> None:
    lanelets = LaneletMap()
    bounds = [[(float(x), y + x * x / 4000) for x in range(0, 1500, 20)] for y in (3.0, 0.0)]
    name = lanelets.lane(*bounds)

    (lane,) = get_street(import_lanelets(tmp_path, lanelets), name).lanes

    # At a grade of 1 in 2, half way, a lane 3 m high is 3 / sqrt(1.25) m wide.
    half = lane.centre[np.abs(lane.centre[:, 0] - 1000).argmin()]
    assert half[1] == pytest.approx(half[0] ** 2 / 4000 + 1.5, abs=0.05)
    found = np.interp([250.0, 1310.0], *lane.left_border[:, :2].T)
    assert found == pytest.approx([3 + 250**2 / 4000, 3 + 1310**2 / 4000], abs=0.05)
