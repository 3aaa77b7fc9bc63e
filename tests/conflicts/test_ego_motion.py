"""How fast the ego is predicted to drive, before SUMO drives it."""

import numpy as np
import pytest
from advercity_dsl import Spec

from advercity.conflicts.ego_motion import NominalMotion, compute_nominal_motion
from advercity.roads.routes import RoutePath, RoutePlanner

RADIUS_M = 25.0


@pytest.mark.filterwarnings("error")
def test_the_top_speed_before_a_place_is_that_of_the_way_there() -> None:
    motion = NominalMotion(np.array([10.0, 12.0, 18.0]), np.array([3.0, 4.0, 5.0]))

    assert motion.find_top_speed_m_s(18.0) == pytest.approx(6.0)
    assert motion.find_top_speed_m_s(12.0) == pytest.approx(2.0)
    assert motion.find_top_speed_m_s(10.0) == 0.0


def test_the_ego_is_predicted_to_take_the_middle_of_a_double_bend_slower_than_its_arcs(
    specs: dict[str, Spec],
):
    """Arcs of 25 m allow 3.5 m/s2 at 9.35 m/s; the ego cruises with 9.44 m/s.

    From one to the other curvature changes by 2 / 25 m within 9 m, which a lateral jerk of
    5.5 m/s3 allows at no more than 8.52 m/s.
    """
    turn = np.radians(np.arange(0.0, 91.0))
    arc = RADIUS_M * np.column_stack([np.sin(turn), 1 - np.cos(turn)])
    middle_m = 100.0 + RADIUS_M * turn[-1]
    double_bend = np.concatenate([[(-100.0, 0.0)], arc, 2 * arc[-1] - arc[-2::-1]])
    road = specs["ui_clear_day_sparse"].road
    path = RoutePath(double_bend, ())

    motion = compute_nominal_motion(road, RoutePlanner(road), path, 0.0)

    assert speed_at(motion, middle_m - 20.0) == pytest.approx(np.sqrt(3.5 * RADIUS_M), abs=0.1)
    assert speed_at(motion, middle_m) == pytest.approx(np.cbrt(5.5 * 9 * RADIUS_M / 2), abs=0.1)


def test_a_truck_as_ego_gets_going_as_slowly_as_one(specs: dict[str, Spec]):
    """To 9.44 m/s, a time of v / 2a is lost: 1.89 s at 2.5 m/s2, 3.93 s at 1.2 m/s2."""
    road = specs["ui_clear_day_sparse"].road
    path = RoutePath(np.array([(0.0, 0.0), (200.0, 0.0)]), ())

    car, truck = (
        compute_nominal_motion(road, RoutePlanner(road), path, 0.0, actor_class=name)
        for name in ("car", "truck")
    )

    assert car.time_at(150.0) == pytest.approx(road.ego.waits_s + 150 / 9.44 + 1.89, abs=0.1)
    assert truck.time_at(150.0) - car.time_at(150.0) == pytest.approx(3.93 - 1.89, abs=0.05)


def speed_at(motion: NominalMotion, station_m: float) -> float:
    return 2.0 / (motion.time_at(station_m + 1.0) - motion.time_at(station_m - 1.0))
