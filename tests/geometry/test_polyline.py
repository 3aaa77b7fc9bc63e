"""Polylines with stations: lengths, points, headings, nearest stations, pieces."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from advercity.geometry import polyline
from advercity.geometry.polyline import StationedPolyline

CORNER = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 4.0]])


def test_stations_count_along_the_chords() -> None:
    line = StationedPolyline.from_points(CORNER)
    np.testing.assert_array_equal(line.stations_m, [0.0, 3.0, 7.0])
    assert line.length_m == 7.0


def test_stations_are_scaled_to_a_given_length() -> None:
    line = StationedPolyline.from_points(CORNER, length_m=14.0)
    np.testing.assert_allclose(line.stations_m, [0.0, 6.0, 14.0])
    np.testing.assert_allclose(line.points_at(10.0), [3.0, 2.0])


def test_a_line_without_extent_has_finite_stations() -> None:
    line = StationedPolyline.from_points(np.zeros((2, 3)), length_m=0.1)
    assert np.isfinite(line.stations_m).all()


def test_points_keep_the_shape_of_the_stations_and_stop_at_the_ends() -> None:
    line = StationedPolyline.from_points(CORNER)
    np.testing.assert_allclose(line.points_at([[-1.0, 1.0], [5.0, 9.0]])[..., 1], [[0, 0], [2, 4]])
    assert line.points_at(2.0).shape == (2,)


def test_points_of_a_line_in_space_have_heights() -> None:
    line = StationedPolyline(np.array([[0.0, 0.0, 1.0], [4.0, 0.0, 3.0]]), np.array([0.0, 4.0]))
    np.testing.assert_allclose(line.points_at(1.0), [1.0, 0.0, 1.5])


def test_a_heading_is_that_of_the_segment_that_follows() -> None:
    line = StationedPolyline.from_points(CORNER)
    np.testing.assert_allclose(
        line.headings_at([-1.0, 2.9, 3.0, 7.0, 8.0]), [0, 0, np.pi / 2, np.pi / 2, np.pi / 2]
    )


def test_a_heading_over_a_span_turns_through_a_corner() -> None:
    line = StationedPolyline.from_points(CORNER)
    np.testing.assert_allclose(
        line.headings_at([0.0, 3.0, 7.0], span_m=1.0), [0.0, np.pi / 4, np.pi / 2]
    )


def test_the_nearest_station_is_exact_and_never_beyond_an_end() -> None:
    line = StationedPolyline.from_points(CORNER, length_m=14.0)
    assert line.project_point((4.0, 1.0)) == pytest.approx((8.0, 1.0))
    assert line.project_point((-3.0, 4.0)) == pytest.approx((0.0, 5.0))


def test_a_piece_keeps_the_points_between_its_ends() -> None:
    piece = StationedPolyline.from_points(CORNER).cut(1.0, 5.0)
    np.testing.assert_allclose(piece.points, [[1, 0], [3, 0], [3, 2]])
    np.testing.assert_allclose(piece.stations_m, [0, 2, 4])


def test_a_piece_leaves_out_points_within_the_margin_of_its_ends() -> None:
    piece = StationedPolyline.from_points(CORNER).cut(2.95, 5.0, margin_m=0.1)
    np.testing.assert_allclose(piece.points, [[2.95, 0], [3, 2]])


def test_samples_begin_at_the_start_and_leave_out_the_end() -> None:
    samples = StationedPolyline.from_points(CORNER).sample_points(3.5)
    np.testing.assert_allclose(samples, [[0, 0], [3, 0.5]])


@given(st.floats(0.0, 1.0))
def test_a_point_of_the_line_is_projected_to_its_own_station(fraction: float) -> None:
    line = StationedPolyline.from_points(CORNER)
    station, distance = line.project_point(line.points_at(fraction * line.length_m))
    assert station == pytest.approx(fraction * line.length_m, abs=1e-9)
    assert distance == pytest.approx(0.0, abs=1e-9)


def test_resampling_keeps_the_ends_and_spreads_points_evenly() -> None:
    np.testing.assert_allclose(
        polyline.resample_polyline(CORNER, 3), [[0.0, 0.0], [3.0, 0.5], [3.0, 4.0]]
    )


def test_an_offset_line_is_mitred_at_its_corners() -> None:
    line = np.column_stack([CORNER, [1.0, 1.0, 2.0]])
    np.testing.assert_allclose(
        polyline.offset_polyline(line, 1.0), [[0, 1, 1], [2, 1, 1], [2, 4, 2]]
    )


def test_a_sharp_corner_is_mitred_only_up_to_the_limit() -> None:
    line = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, 0.1, 0.0]])
    corner = polyline.offset_polyline(line, 1.0)[1]
    assert np.linalg.norm(corner - line[1]) <= polyline.MITRE_LIMIT + 1e-9


def test_points_that_repeat_the_one_before_are_dropped() -> None:
    line = np.array([[0.0, 0.0], [0.0, 1e-7], [1.0, 0.0]])
    np.testing.assert_array_equal(polyline.drop_repeated_points(line), line[[0, 2]])
