"""Layout of streets and junctions."""

import re
from pathlib import Path

import numpy as np
import pytest
import shapely
import yaml
from advercity_dsl import Road
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from advercity.errors import InputError
from advercity.roads.arms import MisplacedPartError
from advercity.roads.layout import RoadLayout, interpolate_mean_value_height, lay_out_road
from advercity.roads.plan_frame import mirror_road
from advercity.roads.road_network import build_road
from advercity.roads.routes import RoutePlanner
from advercity.roads.sumo_network import write_sumo_network

NAMES = ("ui", "unj", "ri", "rsnj", "rcnj")

TINY = """
kind: road
id: tiny
land_use: rural
junction: non_junction
alignment: straight
profile: level
sections:
  plain: {left: [{kind: lane, width_m: 3}], right: [{kind: lane, width_m: 3}]}
streets:
  a: {begins: west, ends: j, start_m: [-50, 0], heading_deg: 0, path: [{line_m: 40}],
      section: plain, speed_limit_km_h: 30}
  b: {begins: j, ends: east, start_m: [10, 0], heading_deg: 0, path: [{line_m: 40}],
      section: plain, speed_limit_km_h: 30}
junctions:
  j: {movements: [a.1 > b.1, b.1 > a.1]}
agents: {}
traffic:
  vehicles_per_area: 0
  walkers: 0
  around_agent_m: 50
  around_path_m: 15
  classes: {car: 1, van: 0, truck: 0, bicycle: 0, motorcycle: 0}
"""


def tiny(old: str = "", new: str = "") -> Road:
    assert old in TINY
    return Road.model_validate(yaml.safe_load(TINY.replace(old, new) if old else TINY))


@pytest.mark.parametrize("name", NAMES)
def test_movements_join_lanes_smoothly(layouts: dict[str, RoadLayout], name: str) -> None:
    plan = layouts[name]
    for junction in plan.junctions.values():
        for path in junction.connecting_paths:
            source = junction.find_arm(path.movement.from_street)
            target = junction.find_arm(path.movement.to_street)
            first, last = (path.centre[i + 1] - path.centre[i] for i in (0, -2))
            for step, direction in (
                (first, -source.outward_direction),
                (last, target.outward_direction),
            ):
                cosine = step[:2] @ direction / np.linalg.norm(step[:2])
                assert cosine > np.cos(np.radians(15)), path.id


@pytest.mark.parametrize("name", NAMES)
def test_junctions_have_simple_outlines_that_movements_keep_clear_of(
    layouts: dict[str, RoadLayout], name: str
) -> None:
    for junction in layouts[name].junctions.values():
        ring = shapely.LinearRing(junction.roadway_outline[:, :2])
        assert ring.is_simple and ring.is_ccw, junction.id
        for path in junction.connecting_paths:
            inside = shapely.Polygon(ring).buffer(-1.3)
            middle = path.centre[2:-2]
            assert shapely.contains_xy(inside, middle[:, 0], middle[:, 1]).all(), path.id


def test_a_quarter_circle_ends_where_geometry_says() -> None:
    road = tiny(
        (
            "path: [{line_m: 40}],\n      section: plain, speed_limit_km_h: 30}\n"
            "  b: {begins: j, ends: east, start_m: [10, 0]"
        ),
        (
            "path: [{arc_m: 15.707963, radius_m: 10, turn: left}],\n"
            "      section: plain, speed_limit_km_h: 30}\n"
            "  b: {begins: j, ends: east, start_m: [0, 30]"
        ),
    )
    street = lay_out_road(road).streets["a"]
    np.testing.assert_allclose(street.axis[-1], (-40, 10, 0), atol=1e-5)
    assert street.headings[-1] == pytest.approx(np.pi / 2)
    right = street.offset_line(-3)
    np.testing.assert_allclose(right[-1], (-37, 10, 0), atol=1e-5)
    np.testing.assert_allclose(np.hypot(right[:, 0] + 50, right[:, 1] - 10), 13)


def test_opposite_lanes_are_travelled_in_opposite_directions() -> None:
    street = lay_out_road(tiny()).streets["a"]
    along = street.directed_line(street.find_lane(1, along=True).centre_t, along=True)
    against = street.directed_line(street.find_lane(1, along=False).centre_t, along=False)
    np.testing.assert_allclose((along[0], along[-1]), [(-50, -1.5, 0), (-10, -1.5, 0)])
    np.testing.assert_allclose((against[0], against[-1]), [(-10, 1.5, 0), (-50, 1.5, 0)])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("section: plain", "section: plane", "unknown name 'plane'; did you mean 'plain'"),
        ("a.1 > b.1", "a.2 > b.1", "unknown lane 'a.2'; the street has 1 lanes along its axis"),
        ("a.1 > b.1", "a.1 > c.1", "unknown name 'c'; available: a, b"),
        ("ends: j", "ends: west", "begins and ends at 'west'"),
        ("{movements:", "{control: signals, movements:", "require each other"),
        ("{movements:", "{median: [a, d], movements:", "unknown name 'd'; available: a, b"),
    ],
)
def test_a_reference_to_a_missing_part_is_refused(old: str, new: str, message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        tiny(old, new)


CROSS_ENDS = {
    "west": (-20, 0, 0),
    "east": (20, 0, 180),
    "south": (0, -20, 90),
    "north": (0, 20, -90),
}
"""Where streets end, and the heading there."""


def cross(lanes: int, heading_deg: float = 0.0, **ends: tuple[float, float, float]) -> Road:
    """Streets that end at one junction without declared movements, turned around its middle."""
    data = yaml.safe_load(TINY)
    side = [{"kind": "lane", "width_m": 3}] * lanes
    data["sections"]["plain"] = {"left": side, "right": side}
    data["junctions"] = {"j": {}}
    turn = np.radians(heading_deg)
    data["streets"] = {}
    for name, (east, north, towards_deg) in (ends or CROSS_ENDS).items():
        towards = np.radians(towards_deg)
        x, y = np.array([east, north]) - 40 * np.array([np.cos(towards), np.sin(towards)])
        start = x * np.cos(turn) - y * np.sin(turn), x * np.sin(turn) + y * np.cos(turn)
        data["streets"][name] = {
            "begins": f"{name}_end",
            "ends": "j",
            "start_m": [round(value, 6) for value in start],
            "heading_deg": (towards_deg + heading_deg + 180) % 360 - 180,
            "path": [{"line_m": 40}],
            "section": "plain",
            "speed_limit_km_h": 30,
        }
    return Road.model_validate(data)


@pytest.mark.parametrize("heading_deg", [0.0, 17.0, 200.0])
@pytest.mark.parametrize(
    ("lanes", "from_west"),
    [
        (1, {"west.1 > north.1", "west.1 > east.1", "west.1 > south.1"}),
        (2, {"west.1 > north.1", "west.1 > east.1", "west.2 > east.2", "west.2 > south.2"}),
    ],
)
def test_a_junction_without_movements_leads_into_every_other_street(
    lanes: int, from_west: set[str], heading_deg: float
) -> None:
    (junction,) = lay_out_road(cross(lanes, heading_deg)).junctions.values()
    movements = {str(path.movement) for path in junction.connecting_paths}
    assert {text for text in movements if text.startswith("west.")} == from_west
    assert len(movements) == 4 * len(from_west)
    planned = RoutePlanner(cross(lanes, heading_deg)).movements["j"]
    assert {str(movement) for movement in planned} == movements


@pytest.mark.parametrize(
    ("east", "complaint"),
    [
        ((49, 0, 180), None),
        ((51, 0, 180), "ends at 51.0, 0.0, 51 m from the other streets of junction 'j'"),
        ((20, 0, 0), "ends at 20.0, 0.0 and leads away from junction 'j'"),
        ((20, 0, 95), None),
    ],
)
def test_a_street_reaches_its_junction_and_leads_into_it(
    east: tuple[float, float, float], complaint: str | None
) -> None:
    road = cross(1, east=east, south=(0, -20, 90), north=(0, 20, -90))
    if complaint is None:
        assert len(lay_out_road(road).junctions["j"].arms) == 3
        return
    with pytest.raises(MisplacedPartError, match=re.escape(complaint)) as caught:
        lay_out_road(road)
    assert caught.value.value_path == ("streets", "east", "path")


@pytest.mark.parametrize(
    ("cycle", "complaint"),
    [
        ("[[west, east], [south, north]]", None),
        ("[west, east, south, north]", None),
        ("[[west, east], [south]]", "'north' never has green"),
        ("[[west, east, south]]", "'north' never has green"),
    ],
)
def test_every_leg_of_a_signal_cycle_has_green(cycle: str, complaint: str | None) -> None:
    data = cross(1).model_dump(mode="json")
    signals = {"cycle": yaml.safe_load(cycle), "green_s": 10}
    data["junctions"] = {"j": {"control": "signals", "signals": signals}}
    if complaint is None:
        assert Road.model_validate(data).junctions["j"].movements == "all"
        return
    with pytest.raises(ValidationError, match=complaint):
        Road.model_validate(data)


@pytest.mark.sumo
def test_an_all_way_stop_has_a_sign_at_the_right_of_every_arriving_street(tmp_path: Path) -> None:
    """Streets end 20 m from the middle; their only lane is 3 m wide."""
    road = cross(1)
    junction = road.junctions["j"].model_copy(update={"control": "all_way_stop"})
    road = road.model_copy(update={"junctions": {"j": junction}})

    signs = lay_out_road(road).junctions["j"].declared.signs
    written = write_sumo_network(road, tmp_path).read_text()

    at_m = {"west": (-20, -3), "east": (20, 3), "south": (3, -20), "north": (-3, 20)}
    assert {sign.street: sign.at_m for sign in signs} == at_m
    assert {sign.kind for sign in signs} == {"stop"}
    assert 'id="j" type="allway_stop"' in written
    left = build_road(mirror_road(road)).traffic_signs
    assert {sign.position_m for sign in left} == {(east, -north) for east, north in at_m.values()}


def test_movements_are_a_list_or_all() -> None:
    junction = lay_out_road(tiny("[a.1 > b.1, b.1 > a.1]", "all")).junctions["j"]
    assert [str(it.movement) for it in junction.connecting_paths] == ["b.1 > a.1", "a.1 > b.1"]
    with pytest.raises(ValidationError, match="'most' is neither `all` nor a list of movements"):
        tiny("[a.1 > b.1, b.1 > a.1]", "most")


def test_a_junction_of_one_street_is_refused() -> None:
    with pytest.raises(InputError, match="only 'b' leads to it"):
        lay_out_road(
            tiny("[a.1 > b.1, b.1 > a.1]", "[]").model_copy(
                update={"streets": {"b": tiny().streets["b"]}}
            )
        )


def test_a_median_needs_a_median() -> None:
    with pytest.raises(InputError, match="'a' has no median"):
        lay_out_road(tiny("{movements:", "{median: [a, b], movements:"))


@given(
    slope=st.tuples(st.floats(-0.2, 0.2), st.floats(-0.2, 0.2)),
    share=st.floats(0.05, 0.95),
    at=st.tuples(st.floats(-0.9, 0.9), st.floats(-0.9, 0.9)),
)
def test_a_junction_whose_outline_is_flat_is_flat(
    slope: tuple[float, float], share: float, at: tuple[float, float]
) -> None:
    corners = np.array([(-1, -1), (1, -1), (1, 1), (2 * share - 1, 1), (-1, 1)], dtype=float)
    outline = np.column_stack([corners, corners @ slope])
    z = interpolate_mean_value_height(outline, np.array([at]))
    assert z[0] == pytest.approx(float(np.dot(at, slope)), abs=1e-9)


def test_grades_change_over_a_few_metres_and_keep_their_ends() -> None:
    heights = yaml.safe_load("[{at_m: 0, z_m: 1}, {at_m: 20, z_m: 1}, {at_m: 40, z_m: 3}]")
    road = tiny(
        (
            "path: [{line_m: 40}],\n      section: plain, speed_limit_km_h: 30}\n"
            "  b: {begins: j, ends: east, start_m: [10, 0]"
        ),
        (
            f"path: [{{line_m: 40}}], heights: {heights},\n"
            "      section: plain, speed_limit_km_h: 30}\n"
            "  b: {begins: j, ends: east, start_m: [10, 0]"
        ),
    )
    street = lay_out_road(road).streets["a"]
    z = dict(zip(street.stations.round(6), street.axis[:, 2], strict=True))
    assert z[0] == 1 and z[40] == 3
    assert z[16] == 1 and z[30] == pytest.approx(2)
    # A parabola over 4 m lies grade * 4 / 8 above the corner, here a mean over 17 samples.
    assert z[20] == pytest.approx(1.05, abs=0.005)
