"""A target is as strong anywhere in the field of view, between cells and between rays."""

import math
from dataclasses import replace

import numpy as np
import pytest

from advercity.geometry.mesh import Mesh
from advercity.geometry.poses import pose_matrix
from advercity.semantics import Semantic
from advercity.sensors.measurements import PointKind
from advercity.sensors.radar.cells import CellGrid, compute_hann_response
from tests.sensors.radar.builders import WIDE, scan, strongest_dbsm, trihedral, vary

WAVELENGTH_M = 0.0038934
CORNER_DBSM = 10 * math.log10(4 * math.pi * 0.3**4 / (3 * WAVELENGTH_M**2))
"""Of a trihedral corner of 0.3 m at 77 GHz."""


def integrate_corner_dbsm(range_m: float) -> float:
    """Integrate the field of a corner over its hexagon, whose edges are nearer than its middle.

    Ways out and home through a point at `across` from the middle are longer by its square over the
    range; far away all agree.
    """
    side = np.linspace(-0.25, 0.25, 1001)
    across, up = np.meshgrid(side, side)
    angles = np.radians([90, 210, 330])[:, None, None]
    beyond = across * np.cos(angles) + up * np.sin(angles)
    hexagon = (np.abs(beyond) < 0.3 / math.sqrt(6)).all(axis=0)
    extra_m = (across**2 + up**2)[hexagon] / range_m
    field_m2 = np.exp(2j * math.pi / WAVELENGTH_M * extra_m).sum() * (side[1] - side[0]) ** 2
    return 10 * math.log10(4 * math.pi * abs(field_m2) ** 2 / WAVELENGTH_M**2)


def place_corner(range_m: float, azimuth_deg: float, elevation_deg: float) -> Mesh:
    """A corner on a pole that opens towards the radar."""
    pose = pose_matrix((0, 0, 0), yaw=math.radians(azimuth_deg), pitch=math.radians(elevation_deg))
    mesh = trihedral(0.3, range_m)
    vertices = (mesh.vertices @ pose[:3, :3].T).astype(np.float32)
    return replace(mesh, vertices=vertices, semantic=Semantic.POLE)


def test_the_field_of_a_far_corner_is_that_of_the_formula() -> None:
    assert integrate_corner_dbsm(1000) == pytest.approx(CORNER_DBSM, abs=0.05)
    assert integrate_corner_dbsm(10) == pytest.approx(CORNER_DBSM - 2.9, abs=0.1)


@pytest.mark.parametrize("azimuth_deg", [0, 10, 20])
@pytest.mark.parametrize("range_m", [10, 30, 60, 100])
def test_a_corner_is_as_strong_wherever_it_stands(range_m: int, azimuth_deg: int) -> None:
    """Places are drawn: anywhere in cells of 0.4 m, 1.5 and 2 degrees, and among the rays."""
    rng = np.random.default_rng((range_m, azimuth_deg))
    for _ in range(3):
        at = rng.uniform(-1, 1, 3) * [0.2, 0.75, 1] + [range_m, azimuth_deg, 0]
        mesh = place_corner(*at)
        found = scan(WIDE, mesh).detections
        near = np.linalg.norm(found.points - mesh.vertices[0], axis=1) < 2
        own = near & (found.kind == PointKind.SURFACE)
        assert found.rcs_dbsm[own].max() == pytest.approx(integrate_corner_dbsm(range_m), abs=1.0)


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
    radar = vary(WIDE, rays=400_000)
    found = strongest_dbsm(scan(radar, mesh).detections)
    assert found == pytest.approx(CORNER_DBSM, abs=1.0)


def test_offsets_are_from_the_middle_of_a_cell() -> None:
    grid = CellGrid.from_radar(WIDE)
    cell_m = 299_792_458 / 750e6
    ranges = np.array([10.5, 10.0, 10.9, 1e6]) * cell_m
    ahead = np.tile([1.0, 0.0, 0.0], (4, 1))
    offsets = grid.compute_offsets(ranges, np.zeros(4), ahead)[3]
    assert offsets == pytest.approx([0.0, -0.5, 0.4, 0.5], abs=1e-6)
