"""Link budgets by hand: logarithms of the table's formulas, worked out on paper."""

import numpy as np
import pytest
from advercity_dsl.channel import Radio

from advercity.channel.propagation import (
    Environment,
    PathState,
    RadioPath,
    compute_air_attenuation_db_km,
    compute_blockage_db,
    compute_path_loss_db,
    compute_received_dbm,
)

LOS, NLOSV, NLOS = PathState


@pytest.mark.parametrize(
    ("state", "distance_m", "environment", "loss_db"),
    [
        # log10(100) is 2 and log10(5.9) is 0.77085.
        (LOS, 100.0, "urban", 38.77 + 33.4 + 14.030),
        (LOS, 100.0, "highway", 32.4 + 40.0 + 15.417),
        (NLOSV, 100.0, "urban", 38.77 + 33.4 + 14.030),
        (NLOS, 100.0, "urban", 36.85 + 60.0 + 14.569),
        (NLOS, 1000.0, "highway", 36.85 + 90.0 + 14.569),
        # Nearer than a metre is a metre.
        (LOS, 0.2, "urban", 38.77 + 14.030),
    ],
)
def test_the_path_loss_is_that_of_the_table(
    state: PathState, distance_m: float, environment: Environment, loss_db: float
) -> None:
    found = compute_path_loss_db(state, distance_m, 5.9, environment)
    assert found == pytest.approx(loss_db, abs=1e-3)


def blocked(low_m: float, high_m: float, roof_m: float, distance_m: float = 100.0) -> RadioPath:
    return RadioPath(NLOSV, distance_m, (high_m, low_m), blocker=7, blocker_height_m=roof_m)


@pytest.mark.parametrize(
    ("path", "normal", "loss_db"),
    [
        (blocked(1.6, 1.6, 3.0), 0.0, 9.0),
        (blocked(1.6, 1.6, 3.0), 1.0, 13.5),
        (blocked(1.6, 5.0, 3.0), 0.0, 5.0),
        (blocked(1.6, 5.0, 3.0), 1.0, 9.0),
        (blocked(1.6, 1.6, 1.5), 3.0, 0.0),
        # 15 log10(1000) - 41 is 4.
        (blocked(1.6, 1.6, 3.0, 1000.0), 0.0, 13.0),
        (blocked(1.6, 1.6, 3.0), -2.5, 0.0),
        (RadioPath(LOS, 100.0, (1.6, 1.6)), 2.0, 0.0),
    ],
)
def test_a_vehicle_costs_more_the_fewer_antennas_are_above_its_roof(
    path: RadioPath, normal: float, loss_db: float
) -> None:
    assert compute_blockage_db(path, normal) == pytest.approx(loss_db)


def test_a_link_budget_by_hand() -> None:
    """A car behind a lorry 100 m ahead in a town.

    23 + 2 x 3 - (38.77 + 33.4 + 14.030) - 9 - 4.5 + 3 x 0.5 - 0.02 dBm
    """
    path, radio = blocked(1.6, 1.6, 3.0), Radio()
    found = compute_received_dbm(radio, path, "urban", shadowing=-0.5, blockage=1.0, air_db_km=0.2)
    assert found == pytest.approx(-69.22, abs=1e-3)
    assert found > radio.sensitivity_dbm
    smooth = radio.model_copy(update={"shadowing": False})
    dry = compute_received_dbm(smooth, path, "urban", shadowing=-0.5, blockage=1.0)
    assert dry == pytest.approx(-70.70, abs=1e-3)


def test_a_building_ends_a_link_of_its_g5_where_an_open_road_does_not() -> None:
    """With 29 dBm and -82 dBm, 111 dB may be lost: NLOS up to 10 ** (59.58 / 30), 96.8 m."""
    radio = Radio(shadowing=False)
    for distance_m, is_heard in ((96.0, True), (98.0, False)):
        power = compute_received_dbm(radio, RadioPath(NLOS, distance_m, (1.6, 1.6)), "urban")
        assert (power >= radio.sensitivity_dbm) == is_heard
    open_road = RadioPath(LOS, 2000.0, (1.6, 1.6))
    assert compute_received_dbm(radio, open_road, "urban") > radio.sensitivity_dbm


def test_more_of_anything_on_the_path_is_never_more_power() -> None:
    radio = Radio()
    for environment in ("urban", "highway"):
        powers = [
            compute_received_dbm(radio, RadioPath(state, distance, (1.6, 1.6)), environment)
            for state in (LOS, NLOS)
            for distance in np.geomspace(3.0, 3000.0, 40).tolist()
        ]
        assert (np.diff(powers[:40]) < 0).all()
        assert (np.array(powers[40:]) < powers[:40]).all()
    assert compute_air_attenuation_db_km(100.0, 0.5, 5.9) < 1.0
