"""Where solved conflicts take place, and from where the ego sees the actor."""

import numpy as np
import pytest
from advercity_dsl import Spec

from advercity.conflicts.ego_motion import NominalMotion
from advercity.conflicts.solver import build_car_outline, compute_sight_distance_m
from advercity.roads.routes import RoutePath


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
