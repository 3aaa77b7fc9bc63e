"""Where solved conflicts take place, and from where the ego sees the actor."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from advercity_dsl import Conflict, Spec, Vehicle
from advercity_dsl.units import KM_H_PER_M_S

from advercity.compiler.crossing import compile_library
from advercity.compiler.library import load_library
from advercity.conflicts.case import UnsolvableError
from advercity.conflicts.ego_motion import EgoDrive, NominalMotion, build_ego_drive
from advercity.conflicts.solver import build_car_outline, compute_sight_distance_m, solve_conflict
from advercity.roads.routes import RoutePath, RoutePlanner
from advercity.roads.signals import find_declared_green_s
from advercity.roads.sumo_network import write_sumo_network


def test_a_pedestrian_behind_a_parked_car_is_seen_past_its_corner():
    """The line from 10 m/s ahead to 2 m/s aside passes the corner 1.5 m before, 3 m aside."""
    way = RoutePath(np.array([[0.0, 0.0], [100.0, 0.0]]), ())
    pace = NominalMotion(np.array([0.0, 100.0]), np.array([0.0, 10.0]))
    path = np.array([[80.0, -6.0], [80.0, 6.0]])
    car = build_car_outline(np.array([[74.0, -3.9], [78.5, -3.9]]), 1.8)

    seen_m = compute_sight_distance_m(way, pace, 80.0, path, 2.0, [car])

    assert seen_m == pytest.approx(16.5, abs=0.51)  # 0.2 * (seen - 1.5) = 3
    assert compute_sight_distance_m(way, pace, 80.0, path[::-1], 2.0, [car]) is None


def test_a_conflict_point_is_on_the_path_of_the_ego_and_inside_the_scenario(specs: dict[str, Spec]):
    for spec in specs.values():
        for conflict in spec.conflicts:
            assert conflict.station_m > 0
            assert conflict.window_s[0] > 0


@pytest.mark.parametrize("name", ["ri_clear_day_sparse", "ri_clear_day_dense"])
def test_an_ego_has_green_before_it_would_brake_for_red(specs: dict[str, Spec], name: str):
    spec = specs[name]
    conflict, drive = spec.conflicts[0], build_ego_drive(spec.road)
    speed_m_s = conflict.parameters["ego_speed_km_h"] / KM_H_PER_M_S
    drive = drive.limit_speed(drive.start_m + conflict.station_m, speed_m_s)
    assert drive.intersection is not None
    junction, before, _ = drive.intersection
    lights = drive.road.junctions[junction].signals
    assert lights is not None
    free = drive.with_lights(junction, None).motion
    assert free.time_at(before.end_m) == drive.motion.time_at(before.end_m)

    half_m = spec.blueprints[spec.ego.blueprint or ""].length_m / 2
    seen_s = free.time_at(before.end_m - half_m) - 3.0
    assert find_declared_green_s(lights, before.street.id, seen_s) == seen_s


@pytest.fixture(scope="module")
def free_flow(library: Path) -> dict[str, Spec]:
    """Scenarios at the limits of towns and country roads."""
    specs = compile_library(library, suite="free_flow")
    return {spec.id: spec for spec in specs if spec.weather.id == "clear_day"}


@pytest.mark.parametrize("road", ["ui", "unj", "ri", "rsnj", "rcnj"])
def test_roads_have_networks_at_the_limits_of_country_roads(
    road: str, free_flow: dict[str, Spec], tmp_path: Path
):
    """netconvert warns of permissive left turns and of bends in junctions at over 70 km/h."""
    assert write_sumo_network(free_flow[f"{road}_clear_day_free_flow_r1"].road, tmp_path).exists()


def test_drifting_actors_start_clear_of_connected_vehicles(free_flow: dict[str, Spec]):
    staged = ((spec, one) for spec in free_flow.values() for one in spec.conflicts)
    for spec, conflict in staged:
        actor = conflict.actors[0]
        if actor.behaviour != "drifts":
            continue
        path = RoutePlanner(spec.road).build_path(actor.route, actor.lane)
        start_m = path.segments[0].end_m - actor.start_m
        length_m = spec.blueprints[actor.blueprint].length_m
        for agent in spec.agents:
            if isinstance(agent.place, Vehicle) and agent.place.route[0] == actor.route[0]:
                other_m = path.find_nearest_station(agent.place.spawn_m)
                other_length_m = spec.blueprints[agent.blueprint or ""].length_m
                gap_m = abs(other_m - start_m) - (length_m + other_length_m) / 2
                assert gap_m > 2.5, (spec.id, agent.id)  # SUMO's at standstill


def test_free_flow_meets_conflicts_with_three_quarters_of_the_speed_that_is_left(
    free_flow: dict[str, Spec],
):
    """On the straight country road head-on as Euro NCAP tests it, with 100 to 140 km/h and more."""
    speeds = {
        (spec.road.id, one.conflict, spec.provenance.repeat): (
            one.parameters["ego_speed_km_h"],
            one.parameters["actor_speed_km_h"],
        )
        for spec in free_flow.values()
        for one in spec.conflicts
    }

    head_on = [sum(pair) for (road, *_), pair in speeds.items() if road == "rsnj"]
    assert len(head_on) == 3
    assert all(0.75 * (80 + 70) <= closing <= 80 + 70 for closing in head_on)
    # Of 25 km/h in a turn, and of the 49 km/h that the ego drives in town.
    turns = [pair[0] for (_, name, _), pair in speeds.items() if "turn" in name]
    assert min(turns) >= 18.75
    assert max(turns) <= 25
    straight = [pair[0] for (road, *_), pair in speeds.items() if road == "unj"]
    assert min(straight) > 0.75 * 48.5


def test_an_ego_that_starts_beyond_the_conflict_point_cannot_meet_the_actor(
    library: Path, specs: dict[str, Spec]
):
    spec = specs["ri_clear_day_sparse"]
    staged = spec.conflicts[0]
    conflict = load_library(library).get_declarations(Conflict)[staged.conflict]
    drive = build_ego_drive(spec.road)
    begun = replace(drive, start_m=drive.start_m + staged.station_m)
    ego = spec.blueprints[spec.ego.blueprint or ""]

    def solve(drive: EgoDrive) -> None:
        solve_conflict(
            *(conflict, staged.typology, drive, spec.blueprints),
            ego=ego,
            seed=1,
            key="tried",
            index=1,
            not_before_s=0.0,
        )

    solve(drive)
    with pytest.raises(UnsolvableError, match="the ego starts beyond the place"):
        solve(begun)
