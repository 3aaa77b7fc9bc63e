"""Targets between cells are as strong as those in the middle of one."""

import math

import numpy as np
import pytest

from advercity.sensors.radar.cells import CellGrid, compute_hann_response
from tests.sensors.radar.builders import WIDE, scan, strongest_dbsm, trihedral, vary

CORNER_DBSM = 10 * math.log10(4 * math.pi * 0.3**4 / (3 * 0.0038961**2))
"""Of a trihedral corner of 0.3 m at 77 GHz."""


def test_a_hann_window_loses_142_db_on_a_border_and_6_db_a_cell_off() -> None:
    found_db = 20 * np.log10(compute_hann_response(np.array([0.0, 0.5, -0.5, 1.0])))
    assert found_db == pytest.approx([0.0, -1.42, -1.42, -6.02], abs=0.01)


@pytest.mark.parametrize("azimuth_place", [0.0, 0.25, 0.5])
@pytest.mark.parametrize("range_place", [0.0, 0.5])
def test_a_corner_is_as_strong_between_cells_as_in_their_middle(
    range_place: float, azimuth_place: float
) -> None:
    """Places are in cells from a border of two cells."""
    range_m = (125 + range_place) * 299_792_458 / 750e6
    azimuth_deg = (2 + azimuth_place) * WIDE.azimuth_cell_deg
    mesh = trihedral(0.3, range_m, range_m * math.tan(math.radians(azimuth_deg)))
    radar = vary(WIDE, rays=1_000_000)
    found = strongest_dbsm(scan(radar, mesh).detections)
    assert found == pytest.approx(CORNER_DBSM, abs=2.0)


def test_offsets_are_from_the_middle_of_a_cell() -> None:
    grid = CellGrid.from_radar(WIDE)
    cell_m = 299_792_458 / 750e6
    ranges = np.array([10.5, 10.0, 10.9, 1e6]) * cell_m
    ahead = np.tile([1.0, 0.0, 0.0], (4, 1))
    offsets = grid.compute_offsets(ranges, np.zeros(4), ahead)[3]
    assert offsets == pytest.approx([0.0, -0.5, 0.4, 0.5], abs=1e-6)
