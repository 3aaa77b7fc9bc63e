"""Overlaps by hand and by OpenCV, and average precision by an implementation of its own."""

import math

import cv2
import numpy as np
import pytest
from advercity_benchmark.average_precision import (
    compute_average_precision,
    compute_calibration_error,
    estimate_interval,
)
from advercity_benchmark.matching import UNMATCHED, compute_overlaps, match_boxes
from numpy.typing import NDArray


def box(x: float, y: float, length: float, width: float, yaw: float = 0.0) -> list[float]:
    return [x, y, 0.0, length, width, 1.5, yaw]


@pytest.mark.parametrize(
    ("first", "second", "overlap"),
    [
        (box(0, 0, 4, 2), box(0, 0, 4, 2), 1.0),
        # Shifted by a quarter of the length: 3/4 of each, 3 of 5 quarters.
        (box(0, 0, 4, 2), box(1, 0, 4, 2), 0.6),
        (box(0, 0, 4, 2), box(0, 1, 4, 2), 1 / 3),
        (box(0, 0, 4, 2), box(4.001, 0, 4, 2), 0.0),
        # Across: 2 x 2 of 8 + 8 - 4.
        (box(0, 0, 4, 2), box(0, 0, 4, 2, math.pi / 2), 1 / 3),
        # A square turned by 45 deg cuts an octagon of 8 (root of 2 - 1) out of 2 x 2.
        (box(0, 0, 2, 2), box(0, 0, 2, 2, math.pi / 4), 0.7071068),
        (box(5, 5, 4, 2, 0.3), box(5, 5, 4, 2, 0.3 + math.pi), 1.0),
    ],
)
def test_overlaps_are_what_geometry_says(
    first: list[float], second: list[float], overlap: float
) -> None:
    found = compute_overlaps(np.array([first]), np.array([second]))
    assert found == pytest.approx(np.array([[overlap]]), abs=1e-6)


def draw_boxes(rng: np.random.Generator, count: int) -> NDArray[np.float64]:
    boxes = np.zeros((count, 7))
    boxes[:, :2] = rng.uniform(-8, 8, (count, 2))
    boxes[:, 3:5] = rng.uniform((2, 1), (6, 3), (count, 2))
    boxes[:, 6] = rng.uniform(-4, 4, count)
    return boxes


def overlap_by_opencv(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    one, other = (
        ((row[0], row[1]), (row[3], row[4]), math.degrees(row[6])) for row in (first, second)
    )
    touch, polygon = cv2.rotatedRectangleIntersection(one, other)
    if touch == cv2.INTERSECT_NONE:
        return 0.0
    shared = cv2.contourArea(cv2.convexHull(polygon))
    return shared / (first[3] * first[4] + second[3] * second[4] - shared)


def test_overlaps_are_those_of_opencv() -> None:
    rng = np.random.default_rng(1)
    first, second = draw_boxes(rng, 30), draw_boxes(rng, 40)
    expected = [[overlap_by_opencv(one, other) for other in second] for one in first]
    assert np.count_nonzero(expected) > 100
    np.testing.assert_allclose(compute_overlaps(first, second), expected, atol=2e-4)


def test_the_best_score_takes_the_box_that_it_overlaps_most() -> None:
    overlaps = np.array([[0.8, 0.6], [0.9, 0.4], [0.1, 0.55]])
    scores = np.array([0.5, 0.9, 0.2])
    assert match_boxes(overlaps, scores, 0.5).tolist() == [1, 0, UNMATCHED]
    assert match_boxes(overlaps, scores, 0.7).tolist() == [UNMATCHED, 0, UNMATCHED]
    assert match_boxes(np.zeros((2, 0)), scores[:2], 0.5).tolist() == [UNMATCHED] * 2


def average_precision_by_steps(is_true: list[bool], scores: list[float], truths: int) -> float:
    """Another way to the same number: for each true positive, the best precision from it on."""
    ranked = [
        flag for _, flag in sorted(zip(scores, is_true, strict=True), key=lambda row: -row[0])
    ]
    total = 0.0
    for rank, flag in enumerate(ranked):
        if flag:
            precisions = [sum(ranked[: last + 1]) / (last + 1) for last in range(rank, len(ranked))]
            total += max(precisions) / truths
    return total


def test_average_precision_by_hand() -> None:
    """Right, wrong, right of three: 1/3 at precision 1, 1/3 at 2/3."""
    found = compute_average_precision(np.array([True, False, True]), np.array([0.9, 0.8, 0.7]), 3)
    assert found == pytest.approx(1 / 3 + 2 / 9)
    # A wrong one with a low score costs nothing, one with the highest score half.
    assert compute_average_precision(np.array([True, False]), np.array([0.9, 0.1]), 1) == 1.0
    assert compute_average_precision(np.array([True, False]), np.array([0.1, 0.9]), 1) == 0.5
    assert compute_average_precision(np.array([], bool), np.array([]), 2) == 0.0
    assert math.isnan(compute_average_precision(np.array([], bool), np.array([]), 0))


def test_average_precision_agrees_with_an_independent_implementation() -> None:
    rng = np.random.default_rng(2)
    for _ in range(20):
        scores = rng.permutation(200) / 200
        is_true = rng.random(200) < scores
        truths = int(is_true.sum()) + 13
        expected = average_precision_by_steps(is_true.tolist(), scores.tolist(), truths)
        found = compute_average_precision(is_true, scores, truths)
        assert found == pytest.approx(expected, abs=1e-12)


def test_a_weight_counts_a_prediction_as_often() -> None:
    rng = np.random.default_rng(3)
    is_true, scores = rng.random(30) < 0.6, rng.permutation(30) / 30
    weights = rng.integers(0, 3, 30)
    rows = np.repeat(np.arange(30), weights)
    # Copies have one score; those that are right come at the step where the weight has them.
    found = compute_average_precision(is_true, scores, 40, weights.astype(float))
    assert found == pytest.approx(
        compute_average_precision(is_true[rows], scores[rows], 40), abs=0.02
    )


def test_scores_that_are_probabilities_have_no_calibration_error() -> None:
    """Of 100 at 0.8, 80 right have none, 100 right are 0.2 off; none right at 0.3 is 0.3 off."""
    right = np.arange(100) < 80
    assert compute_calibration_error(right, np.full(100, 0.8)) == pytest.approx(0.0)
    assert compute_calibration_error(np.ones(100, bool), np.full(100, 0.8)) == pytest.approx(0.2)
    mixed = np.concatenate([np.full(50, 0.8), np.full(50, 0.3)])
    assert compute_calibration_error(np.arange(100) < 50, mixed) == pytest.approx(0.25)
    assert math.isnan(compute_calibration_error(np.array([], bool), np.array([])))


def test_the_interval_is_that_of_scenes_not_of_boxes() -> None:
    """Of 20 scenes half are found, half not at all: 0.5, give or take 1.96 x 0.5 / root of 20."""
    scene_of = np.repeat(np.arange(20), 50)
    is_true, scores = scene_of < 10, np.full(1000, 0.5)
    found = scene_of < 10
    low, high = estimate_interval(
        is_true[found], scores[found], scene_of[found], np.full(20, 50.0), repeats=2000
    )
    half = 1.96 * 0.5 / math.sqrt(20)
    assert (low, high) == pytest.approx((0.5 - half, 0.5 + half), abs=0.04)
    alone = estimate_interval(
        is_true[:50], scores[:50], scene_of[:50], np.array([50.0]), repeats=10
    )
    assert all(map(math.isnan, alone))
