"""The five shipped roads against measurements on the maps that they reproduce."""

from collections.abc import Iterator
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from advercity_dsl import RoadsideUnit, Vehicle

from advercity.geometry import polyline
from advercity.roads.layout import ConnectingPath, JunctionLayout, RoadLayout
from advercity.roads.streets import StreetLayout

NAMES = ("ui", "unj", "ri", "rsnj", "rcnj")
FAR_OFF = {("ui", "cav2"): 0.75, ("ri", "cav2"): 0.75}
"""Cars that start more than half a metre from their lane's centre in the original, too."""

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


@pytest.fixture(scope="module")
def places() -> dict[str, Any]:
    """What was measured, by road."""
    text = (Path(__file__).parents[1] / "data/places.yaml").read_text(encoding="utf-8")
    return yaml.safe_load(text)


def project_on_line(
    line: polyline.Points, point: tuple[float, ...]
) -> tuple[float, float, float, float]:
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


def lanes_of(street: StreetLayout) -> list[tuple[bool, int, polyline.Points]]:
    return [
        (along, band.lane_number, street.directed_line(band.centre_t, along=along))
        for along in (True, False)
        for band in street.strips_in_direction(along=along)
        if band.lane_number
    ]


def vehicles(plan: RoadLayout) -> dict[str, Vehicle]:
    return {name: agent for name, agent in plan.road.agents.items() if isinstance(agent, Vehicle)}


def turn_deg(path: ConnectingPath, junction: JunctionLayout) -> float:
    """How far a movement turns, positive to the left."""
    out = -junction.find_arm(path.movement.from_street).outward_direction
    into = junction.find_arm(path.movement.to_street).outward_direction
    return float(np.degrees(np.arctan2(out[0] * into[1] - out[1] * into[0], out @ into)))


def drives(plan: RoadLayout, vehicle: Vehicle, to: polyline.Points) -> Iterator[tuple[int, float]]:
    """Lane changes and metres along lanes from spawn to a place on the route's last street.

    One for every choice of movements between the streets of the route.
    """
    streets = [plan.streets[name] for name in vehicle.route]
    choices = [
        [
            (junction, path)
            for junction in plan.junctions.values()
            for path in junction.connecting_paths
            if (path.movement.from_street, path.movement.to_street) == pair
        ]
        for pair in pairwise(vehicle.route)
    ]
    for paths in product(*choices):
        along = [street.ends == j.id for street, (j, _) in zip(streets, paths, strict=False)]
        along.append(streets[-1].begins == paths[-1][0].id if paths else faces(vehicle, streets[0]))
        leaves = [path.movement.from_lane for _, path in paths]
        enters = [path.movement.to_lane for _, path in paths]
        first = min(
            (abs(project_on_line(line, (*vehicle.spawn_m, 0))[0]), number)
            for follows, number, line in lanes_of(streets[0])
            if follows is along[0]
        )[1]
        numbers = [*leaves, enters[-1] if enters else first]
        lines = [
            street.directed_line(street.find_lane(number, along=follows).centre_t, along=follows)
            for street, number, follows in zip(streets, numbers, along, strict=True)
        ]
        start = project_on_line(lines[0], (*vehicle.spawn_m, 0))[1]
        end = project_on_line(lines[-1], (*to, 0))[1]
        through = [polyline.polyline_length(path.centre) for _, path in paths]
        total = sum(map(polyline.polyline_length, lines[:-1])) + sum(through) + end - start
        yield sum(a != b for a, b in zip([first, *enters], numbers, strict=True)), total


def faces(vehicle: Vehicle, street: StreetLayout) -> bool:
    """Whether a vehicle looks along the axis of a street."""
    heading = project_on_line(street.axis, (*vehicle.spawn_m, 0))[3]
    return bool(np.cos(heading - np.radians(vehicle.heading_deg)) > 0)


@pytest.mark.parametrize(("road", "street", "along", "number", "point"), LANE_CENTRES)
def test_lanes_run_where_the_maps_have_them(
    layouts: dict[str, RoadLayout],
    road: str,
    street: str,
    along: bool,
    number: int,
    point: tuple[float, float, float],
) -> None:
    place = layouts[road].streets[street]
    band = place.find_lane(number, along=along)
    lateral, _, z, _ = project_on_line(place.directed_line(band.centre_t, along=along), point)
    assert abs(lateral) < 0.1
    assert z == pytest.approx(point[2], abs=0.05)


@pytest.mark.parametrize("name", NAMES)
def test_connected_vehicles_start_where_they_did_on_a_lane_in_its_direction(
    layouts: dict[str, RoadLayout], places: dict[str, Any], name: str
) -> None:
    plan = layouts[name]
    assert set(vehicles(plan)) == set(places[name]["vehicles"])
    for agent, original in places[name]["vehicles"].items():
        x, y, heading_deg = original["spawn"]
        vehicle = vehicles(plan)[agent]
        assert vehicle.spawn_m == (x, y)
        assert np.cos(np.radians(vehicle.heading_deg - heading_deg)) > 1 - 1e-9
        found = [
            (abs(lateral), z)
            for _, _, line in lanes_of(plan.streets[vehicle.route[0]])
            for lateral, _, z, lane_heading in [project_on_line(line, (x, y, 0))]
            if np.cos(np.radians(heading_deg) - lane_heading) > np.cos(np.radians(6))
        ]
        lateral, z = min(found)
        assert lateral < FAR_OFF.get((name, agent), 0.5), agent
        assert z == pytest.approx(original["road_z"], abs=0.1), agent


@pytest.mark.parametrize("name", NAMES)
def test_connected_vehicles_drive_as_far_as_in_the_original(
    layouts: dict[str, RoadLayout], places: dict[str, Any], name: str
) -> None:
    """Compared over the common part; some destinations of the original are beyond the sites."""
    for agent, original in places[name]["vehicles"].items():
        vehicle = vehicles(layouts[name])[agent]
        _, driven_m = min(drives(layouts[name], vehicle, original["to"]))
        assert driven_m == pytest.approx(original["drives_m"], rel=0.01), agent


@pytest.mark.parametrize("name", NAMES)
def test_junctions_have_the_movements_of_the_original(
    layouts: dict[str, RoadLayout], places: dict[str, Any], name: str
) -> None:
    for junction, movements in places[name]["movements"].items():
        laid = layouts[name].junctions[junction]
        paths = {path.id.removeprefix(f"{junction}: "): path for path in laid.connecting_paths}
        assert set(paths) == set(movements)
        for movement, manoeuvre in movements.items():
            turn = turn_deg(paths[movement], laid)
            expected = {"left": turn > 40, "right": turn < -40, "straight": abs(turn) < 50}
            assert expected[manoeuvre], (junction, movement, turn)


@pytest.mark.parametrize("name", NAMES)
def test_lights_and_signs_are_where_the_original_has_them(
    layouts: dict[str, RoadLayout], places: dict[str, Any], name: str
) -> None:
    for junction, lights in places[name].get("lights", {}).items():
        declared = layouts[name].junctions[junction].declared.signals
        assert declared is not None
        assert {head.street: list(head.pole_m) for head in declared.heads} == lights
    for junction, signs in places[name].get("signs", {}).items():
        declared = layouts[name].junctions[junction].declared.signs
        assert {sign.street: [sign.kind, *sign.at_m] for sign in declared} == signs


@pytest.mark.parametrize("name", NAMES)
def test_roadside_units_have_the_poses_of_the_original(
    layouts: dict[str, RoadLayout], places: dict[str, Any], name: str
) -> None:
    agents = layouts[name].road.agents.items()
    units = {agent: unit for agent, unit in agents if isinstance(unit, RoadsideUnit)}
    assert set(units) == set(places[name]["units"])
    for agent, (x, y, z, yaw_deg, pitch_deg) in places[name]["units"].items():
        unit = units[agent]
        assert unit.position_m == (x, y, z)
        assert np.cos(np.radians(unit.yaw_deg - yaw_deg)) > 1 - 1e-9
        assert unit.pitch_deg == pitch_deg


@pytest.mark.parametrize("name", NAMES)
def test_destinations_lie_on_the_last_street_of_the_route(
    layouts: dict[str, RoadLayout], name: str
) -> None:
    plan = layouts[name]
    for agent, vehicle in vehicles(plan).items():
        street = plan.streets[vehicle.route[-1]]
        nearest = min(
            abs(project_on_line(line, vehicle.destination_m)[0]) for _, _, line in lanes_of(street)
        )
        assert nearest < 0.6, agent


@pytest.mark.parametrize("name", NAMES)
def test_routes_are_joined_by_movements(layouts: dict[str, RoadLayout], name: str) -> None:
    plan = layouts[name]
    joined = {
        (path.movement.from_street, path.movement.to_street)
        for junction in plan.junctions.values()
        for path in junction.connecting_paths
    }
    for vehicle in vehicles(plan).values():
        assert set(pairwise(vehicle.route)) <= joined


def test_the_hill_road_climbs_to_its_crest_and_comes_down(layouts: dict[str, RoadLayout]) -> None:
    hill = layouts["rcnj"].streets["hill_road"]
    top = hill.axis[:, 2].argmax()
    assert hill.axis[top, 2] == pytest.approx(9.40, abs=0.03)
    assert hill.stations[top] == pytest.approx(131, abs=2)
    assert hill.axis[[0, -1], 2] == pytest.approx([0.05, 0.16], abs=0.005)
    grade = np.diff(hill.axis[:, 2]) / np.diff(hill.stations)
    assert grade.max() == pytest.approx(0.082, abs=0.004)
    is_eased = hill.stations[1:] > hill.stations[-1] - 8.0
    assert grade[~is_eased].min() == pytest.approx(-0.078, abs=0.004)
    assert abs(grade[-1]) < 0.05, "the grade ends in steps at the flat junction"


def test_the_hill_streets_come_down_from_the_plateau(layouts: dict[str, RoadLayout]) -> None:
    for name in ("hill_street_east", "hill_street_west"):
        street = layouts["unj"].streets[name]
        assert street.axis[0, 2] == pytest.approx(8.0)
        assert street.axis[-1, 2] < 0.5
        assert (np.diff(street.axis[:, 2]) < 1e-9).all()
