"""The five roads against what was measured on the maps they stand for.

Reference points are given in the world frame: the maps' y, yaw and pitch with the sign turned.
"""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely
import yaml
from advercity_dsl import Road, RoadsideUnit, Vehicle
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from advercity.errors import InputError
from advercity.world import curves
from advercity.world.junctions import surface_height
from advercity.world.layout import Layout, layout
from advercity.world.streets import StreetLayout

NAMES = ("ui", "unj", "ri", "rsnj", "rcnj")
FAR_OFF = {("ui", "cav2"): 0.75, ("ri", "cav2"): 0.75}
"""Cars that start more than 0.3 m beside their lane's centre in the original too."""

LANE_CENTRES = [
    ("ui", "north_road", True, 1, (-6.09, -118.32, 0.0)),
    ("ui", "north_road", False, 2, (4.93, -42.53, 0.0)),
    ("ui", "east_road", True, 1, (143.04, -130.6, 0.44)),
    ("ui", "east_road", False, 1, (164.41, -105.91, 0.33)),
    ("ui", "west_road", False, 1, (-66.24, -131.97, 0.0)),
    ("ui", "ring_road", True, 2, (-65.31, -182.64, 0.0)),
    ("ui", "far_west_road", True, 1, (-146.67, -119.57, 0.0)),
    ("unj", "avenue_mid", True, 1, (108.48, 3.36, 0.13)),
    ("unj", "avenue_east", False, 2, (220.09, -9.81, 0.0)),
    ("unj", "hill_street_east", True, 1, (149.24, 61.2, 7.26)),
    ("unj", "hill_street_west", False, 1, (81.19, 20.52, 0.74)),
    ("unj", "hill_street_west", False, 1, (82.67, 62.49, 7.25)),
    ("ri", "south_road", False, 1, (-2.04, -7.62, 0.0)),
    ("ri", "west_road", True, 1, (-91.89, 2.45, 0.03)),
    ("ri", "east_road_a", True, 2, (19.0, 7.03, 0.03)),
    ("ri", "east_curve", True, 1, (82.81, -12.68, 0.03)),
    ("ri", "hill_road", False, 1, (62.42, 43.87, 2.76)),
    ("ri", "south_east_road", False, 1, (54.01, -60.76, 0.03)),
    ("ri", "lake_road", True, 1, (70.08, -87.85, 0.0)),
    ("rsnj", "main_straight", False, 1, (-198.37, 51.54, 0.0)),
    ("rsnj", "north_road", True, 1, (-201.17, 231.74, 0.0)),
    ("rsnj", "south_road", True, 1, (-202.95, 15.24, 0.0)),
    ("rsnj", "south_road", True, 1, (-204.11, -25.42, 0.0)),
    ("rsnj", "parking_road_b", False, 1, (-132.29, 158.92, 0.14)),
    ("rcnj", "hill_road", True, 1, (64.95, 45.84, 2.76)),
    ("rcnj", "hill_road", True, 1, (44.88, 172.76, 6.3)),
    ("rcnj", "hill_road", False, 1, (41.48, 174.99, 6.1)),
    ("rcnj", "east_curve", False, 1, (78.51, -46.93, 0.03)),
    ("rcnj", "north_hill_road", True, 1, (-62.79, 236.22, 4.05)),
    ("rcnj", "north_road", False, 1, (-0.07, 228.56, 0.0)),
]
EGO_ROUTES_M = {"ui": 153.1, "unj": 151.3, "ri": 107.7, "rsnj": 197.4, "rcnj": 239.9}

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


@pytest.fixture(scope="module")
def layouts(library: Path) -> dict[str, Layout]:
    """Every shipped road, laid out."""
    return {name: layout(read(library / f"nhtsa/roads/{name}.yaml")) for name in NAMES}


def read(path: Path) -> Road:
    return Road.model_validate(yaml.safe_load(path.read_text(encoding="utf-8")))


def tiny(old: str = "", new: str = "") -> Road:
    assert old in TINY
    return Road.model_validate(yaml.safe_load(TINY.replace(old, new) if old else TINY))


def beside(line: curves.Points, point: tuple[float, ...]) -> tuple[float, float, float, float]:
    """How far left of a line (n, 3) a point is, and the station, height and heading there."""
    steps = np.diff(line[:, :2], axis=0)
    relative = np.array(point[:2]) - line[:-1, :2]
    share = np.clip((relative * steps).sum(axis=1) / (steps**2).sum(axis=1), 0, 1)
    gap = np.linalg.norm(relative - share[:, None] * steps, axis=1)
    i = int(gap.argmin())
    side = np.sign(steps[i, 0] * relative[i, 1] - steps[i, 1] * relative[i, 0])
    at = np.linalg.norm(steps, axis=1)
    return (
        float(side * gap[i]),
        float(at[:i].sum() + share[i] * at[i]),
        float(line[i, 2] + share[i] * (line[i + 1, 2] - line[i, 2])),
        float(np.arctan2(steps[i, 1], steps[i, 0])),
    )


def lanes_of(street: StreetLayout) -> list[tuple[bool, int, curves.Points]]:
    return [
        (along, band.number, street.travelled(band.centre_t, along=along))
        for along in (True, False)
        for band in street.side(along=along)
        if band.number
    ]


def vehicles(plan: Layout) -> dict[str, Vehicle]:
    return {name: agent for name, agent in plan.road.agents.items() if isinstance(agent, Vehicle)}


@pytest.mark.parametrize(("road", "street", "along", "number", "point"), LANE_CENTRES)
def test_lanes_run_where_the_maps_have_them(
    layouts: dict[str, Layout],
    road: str,
    street: str,
    along: bool,
    number: int,
    point: tuple[float, float, float],
) -> None:
    place = layouts[road].streets[street]
    band = place.lane(number, along=along)
    lateral, _, z, _ = beside(place.travelled(band.centre_t, along=along), point)
    assert abs(lateral) < 0.1
    assert z == pytest.approx(point[2], abs=0.05)


@pytest.mark.parametrize("name", NAMES)
def test_connected_vehicles_start_on_a_lane_of_their_route(
    layouts: dict[str, Layout], name: str
) -> None:
    plan = layouts[name]
    for agent, vehicle in vehicles(plan).items():
        heading = np.radians(vehicle.heading_deg)
        offsets = [
            abs(lateral)
            for _, _, line in lanes_of(plan.streets[vehicle.route[0]])
            for lateral, _, _, lane_heading in [beside(line, vehicle.spawn_m)]
            if np.cos(heading - lane_heading) > np.cos(np.radians(6))
        ]
        assert min(offsets) < FAR_OFF.get((name, agent), 0.3), agent


@pytest.mark.parametrize("name", NAMES)
def test_destinations_lie_on_the_last_street_of_the_route(
    layouts: dict[str, Layout], name: str
) -> None:
    plan = layouts[name]
    for agent, vehicle in vehicles(plan).items():
        street = plan.streets[vehicle.route[-1]]
        nearest = min(
            abs(beside(line, vehicle.destination_m)[0]) for _, _, line in lanes_of(street)
        )
        assert nearest < 0.6, agent


@pytest.mark.parametrize("name", NAMES)
def test_routes_are_joined_by_movements(layouts: dict[str, Layout], name: str) -> None:
    plan = layouts[name]
    joined = {
        (path.movement.from_street, path.movement.to_street)
        for junction in plan.junctions.values()
        for path in junction.paths
    }
    for vehicle in vehicles(plan).values():
        assert set(pairwise(vehicle.route)) <= joined


@pytest.mark.parametrize("name", NAMES)
def test_the_ego_drives_as_far_as_in_the_original(layouts: dict[str, Layout], name: str) -> None:
    plan = layouts[name]
    (ego,) = (vehicle for vehicle in vehicles(plan).values() if vehicle.role == "ego")
    assert driven_m(plan, ego) == pytest.approx(EGO_ROUTES_M[name], rel=0.0125)


def driven_m(plan: Layout, vehicle: Vehicle) -> float:
    """Length of the route along the axes of its streets, and of one movement between any two."""
    streets = [plan.streets[name] for name in vehicle.route]
    joints = {
        (path.movement.from_street, path.movement.to_street): (junction.id, path)
        for junction in plan.junctions.values()
        for path in junction.paths
    }
    through = [joints[here.id, there.id] for here, there in pairwise(streets)]
    first, last = streets[0], streets[-1]
    along_first = not through or first.ends == through[0][0]
    along_last = not through or last.begins == through[-1][0]
    start = beside(first.travelled(0, along=along_first), vehicle.spawn_m)[1]
    end = beside(last.travelled(0, along=along_last), vehicle.destination_m)[1]
    between = sum(curves.length(street.axis) for street in streets[:-1])
    return between + sum(curves.length(path.centre) for _, path in through) + end - start


def test_the_hill_road_climbs_to_its_crest_and_comes_down(layouts: dict[str, Layout]) -> None:
    hill = layouts["rcnj"].streets["hill_road"]
    top = hill.axis[:, 2].argmax()
    assert hill.axis[top, 2] == pytest.approx(9.40, abs=0.03)
    assert hill.stations[top] == pytest.approx(131, abs=2)
    assert hill.axis[[0, -1], 2] == pytest.approx([0.05, 0.16], abs=0.005)
    grade = np.diff(hill.axis[:, 2]) / np.diff(hill.stations)
    assert grade.max() == pytest.approx(0.082, abs=0.004)
    assert grade.min() == pytest.approx(-0.078, abs=0.004)


def test_the_hill_streets_come_down_from_the_plateau(layouts: dict[str, Layout]) -> None:
    for name in ("hill_street_east", "hill_street_west"):
        street = layouts["unj"].streets[name]
        assert street.axis[0, 2] == pytest.approx(8.0)
        assert street.axis[-1, 2] < 0.5
        assert (np.diff(street.axis[:, 2]) < 1e-9).all()


def test_roadside_units_look_where_the_original_ones_do(layouts: dict[str, Layout]) -> None:
    looks_at = {"ui": (4.53, -138.97), "unj": (164.63, -8.83), "ri": (-3.69, -0.94)}
    for name, target in looks_at.items():
        unit = layouts[name].road.agents["rsu1"]
        assert isinstance(unit, RoadsideUnit)
        x, y, z = unit.position_m
        reach = z / np.tan(np.radians(unit.pitch_deg))
        yaw = np.radians(unit.yaw_deg)
        assert (x + reach * np.cos(yaw), y + reach * np.sin(yaw)) == pytest.approx(target, abs=0.2)


@pytest.mark.parametrize("name", NAMES)
def test_movements_join_lanes_smoothly(layouts: dict[str, Layout], name: str) -> None:
    plan = layouts[name]
    for junction in plan.junctions.values():
        for path in junction.paths:
            source = junction.arm(path.movement.from_street)
            target = junction.arm(path.movement.to_street)
            first, last = (path.centre[i + 1] - path.centre[i] for i in (0, -2))
            for step, direction in ((first, -source.outward), (last, target.outward)):
                cosine = step[:2] @ direction / np.linalg.norm(step[:2])
                assert cosine > np.cos(np.radians(15)), path.id


@pytest.mark.parametrize("name", NAMES)
def test_junctions_have_simple_outlines_that_movements_keep_clear_of(
    layouts: dict[str, Layout], name: str
) -> None:
    for junction in layouts[name].junctions.values():
        ring = shapely.LinearRing(junction.outline[:, :2])
        assert ring.is_simple and ring.is_ccw, junction.id
        for path in junction.paths:
            inside = shapely.Polygon(ring).buffer(-1.3)
            middle = path.centre[2:-2]
            assert shapely.contains_xy(inside, middle[:, 0], middle[:, 1]).all(), path.id


def test_a_quarter_circle_ends_where_geometry_says() -> None:
    road = tiny(
        "path: [{line_m: 40}],\n      section: plain, speed_limit_km_h: 30}\n  b",
        (
            "path: [{arc_m: 15.707963, radius_m: 10, turn: left}],\n"
            "      section: plain, speed_limit_km_h: 30}\n  b"
        ),
    )
    street = layout(road).streets["a"]
    np.testing.assert_allclose(street.axis[-1], (-40, 10, 0), atol=1e-5)
    assert street.headings[-1] == pytest.approx(np.pi / 2)
    right = street.line(-3)
    np.testing.assert_allclose(right[-1], (-37, 10, 0), atol=1e-5)
    np.testing.assert_allclose(np.hypot(right[:, 0] + 50, right[:, 1] - 10), 13)


def test_opposite_lanes_are_travelled_in_opposite_directions() -> None:
    street = layout(tiny()).streets["a"]
    along = street.travelled(street.lane(1, along=True).centre_t, along=True)
    against = street.travelled(street.lane(1, along=False).centre_t, along=False)
    np.testing.assert_allclose((along[0], along[-1]), [(-50, -1.5, 0), (-10, -1.5, 0)])
    np.testing.assert_allclose((against[0], against[-1]), [(-10, 1.5, 0), (-50, 1.5, 0)])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("section: plain", "section: plane", "there is no 'plane' here; did you mean 'plain'"),
        ("a.1 > b.1", "a.2 > b.1", "no lane 'a.2'; the street has 1 lanes along its axis"),
        ("a.1 > b.1", "a.1 > c.1", "no 'c' here; there are: a, b"),
        ("ends: j", "ends: west", "begins and ends at 'west'"),
        ("{movements:", "{control: signals, movements:", "go together"),
        ("{movements:", "{median: [a, d], movements:", "no 'd' here; there are: a, b"),
    ],
)
def test_a_road_that_names_what_is_not_there_is_refused(old: str, new: str, message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        tiny(old, new)


def test_a_junction_of_one_street_is_refused() -> None:
    with pytest.raises(InputError, match="only 'b' meets here"):
        layout(
            tiny("[a.1 > b.1, b.1 > a.1]", "[]").model_copy(
                update={"streets": {"b": tiny().streets["b"]}}
            )
        )


def test_a_median_needs_a_median() -> None:
    with pytest.raises(InputError, match="'a' has no median"):
        layout(tiny("{movements:", "{median: [a, b], movements:"))


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
    z = surface_height(outline, np.array([at]))
    assert z[0] == pytest.approx(float(np.dot(at, slope)), abs=1e-9)


def test_grades_change_over_a_few_metres_and_keep_their_ends() -> None:
    heights = yaml.safe_load("[{at_m: 0, z_m: 1}, {at_m: 20, z_m: 1}, {at_m: 40, z_m: 3}]")
    road = tiny(
        "path: [{line_m: 40}],\n      section: plain, speed_limit_km_h: 30}\n  b",
        (
            f"path: [{{line_m: 40}}], heights: {heights},\n"
            "      section: plain, speed_limit_km_h: 30}\n  b"
        ),
    )
    street = layout(road).streets["a"]
    z = dict(zip(street.stations.round(6), street.axis[:, 2], strict=True))
    assert z[0] == 1 and z[40] == 3
    assert z[16] == 1 and z[30] == pytest.approx(2)
    # A parabola over 4 m lies grade * 4 / 8 above the corner, here a mean over 17 samples.
    assert z[20] == pytest.approx(1.05, abs=0.005)
