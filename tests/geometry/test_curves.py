"""Reference lines, vertical curves and connecting curves."""

import numpy as np
import pytest
from advercity_dsl.road import AxisArc, AxisHeight, AxisLine, AxisPoints

from advercity.geometry.curves import (
    MAX_CHORD_ERROR_M,
    build_connecting_curve,
    sample_elevation,
    sample_reference_line,
)

EAST, NORTH = np.array([1.0, 0.0]), np.array([0.0, 1.0])


def test_pieces_of_a_reference_line_follow_each_other_smoothly() -> None:
    path = (AxisLine(line_m=20), AxisArc(arc_m=10 * np.pi, radius_m=20, turn="left"))
    points, headings, along = sample_reference_line((5, 0), 0.0, path, line_step_m=8)
    np.testing.assert_allclose(points[along == 20], [[25, 0]])
    np.testing.assert_allclose(points[-1], [45, 20], atol=1e-9)
    assert headings[-1] == pytest.approx(np.pi / 2)
    assert along[-1] == pytest.approx(20 + 10 * np.pi)


def test_chords_of_an_arc_stay_close_to_it() -> None:
    path = (AxisArc(arc_m=30, radius_m=10, turn="right"),)
    points, _, _ = sample_reference_line((0, 0), 0.0, path, line_step_m=8)
    middles = (points[1:] + points[:-1]) / 2
    sagitta = 10 - np.linalg.norm(middles - (0, -10), axis=1)
    assert (sagitta <= MAX_CHORD_ERROR_M + 1e-9).all()


def test_listed_points_are_kept_as_they_are() -> None:
    path = (AxisPoints(points_m=((3, 0), (3, 4))),)
    points, headings, along = sample_reference_line((0, 0), 0.0, path, line_step_m=1)
    np.testing.assert_array_equal(points, [[0, 0], [3, 0], [3, 4]])
    np.testing.assert_allclose(headings, [0, 0, np.pi / 2])
    np.testing.assert_array_equal(along, [0, 3, 7])


def test_elevation_keeps_declared_ends_and_is_level_without_declaration() -> None:
    along = np.linspace(0, 40, 81)
    z = sample_elevation(along, (AxisHeight(at_m=0, z_m=1), AxisHeight(at_m=40, z_m=3)))
    assert (z[0], z[-1]) == (1, 3)
    assert not sample_elevation(along, ()).any()


def test_a_connecting_curve_turns_in_an_arc_of_the_asked_radius() -> None:
    curve = build_connecting_curve(np.zeros(2), EAST, np.array([20.0, 20.0]), NORTH, radius_m=5)
    np.testing.assert_allclose(curve[[0, -1]], [[0, 0], [20, 20]])
    np.testing.assert_allclose(np.linalg.norm(curve[1:-1] - (15, 5), axis=1), 5, atol=1e-9)


def test_aligned_poses_are_connected_by_a_line() -> None:
    curve = build_connecting_curve(np.zeros(2), EAST, np.array([9.0, 0.0]), EAST)
    np.testing.assert_array_equal(curve, [[0, 0], [9, 0]])


def test_parallel_poses_with_an_offset_are_connected_without_a_kink() -> None:
    curve = build_connecting_curve(np.zeros(2), EAST, np.array([30.0, 3.0]), EAST)
    headings = np.arctan2(*np.diff(curve, axis=0).T[::-1])
    assert np.abs(np.diff(headings)).max() < 0.05
    assert abs(headings[0]) < 0.03
