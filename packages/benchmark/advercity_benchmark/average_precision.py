"""Average precision, calibration, and their uncertainty by bootstrap over scenes."""

import math

import numpy as np
from numpy.typing import NDArray

from advercity.geometry.arrays import Float64Array
from advercity.randomness import create_generator

NUM_BINS = 15
"""Bins of equal width for the calibration error (Guo and others, ICML 2017)."""
CONFIDENCE = 0.95


def compute_average_precision(
    is_true: NDArray[np.bool_],
    scores: Float64Array,
    truths: float,
    weights: Float64Array | None = None,
) -> float:
    """Compute the area under the precision-recall curve, interpolated as by PASCAL VOC 2010.

    All predictions are sorted by score, over all frames.

    Args:
        is_true: (n,) whether each prediction is a true positive.
        scores: (n,).
        truths: Number of objects to find.
        weights: (n,) how often each prediction counts; once if None.

    Returns:
        0 to 1; NaN if there is nothing to find.
    """
    if not truths:
        return math.nan
    order = np.argsort(-scores, kind="stable")
    counted = np.ones(len(scores)) if weights is None else weights[order]
    found, all_ = np.cumsum(counted * is_true[order]), np.cumsum(counted)
    precision = np.divide(found, all_, out=np.zeros(len(all_)), where=all_ > 0)
    envelope = np.maximum.accumulate(precision[::-1])[::-1]
    return float(np.diff(found, prepend=0.0) @ envelope / truths)


def compute_calibration_error(is_true: NDArray[np.bool_], scores: Float64Array) -> float:
    """Compute the expected calibration error: the mean distance of scores from the true fraction.

    NaN without predictions.
    """
    if not len(scores):
        return math.nan
    bins = np.minimum((scores * NUM_BINS).astype(np.int64), NUM_BINS - 1)
    sums = (np.bincount(bins, values, NUM_BINS) for values in (is_true.astype(float), scores))
    true, claimed = sums
    return float(np.abs(true - claimed).sum() / len(scores))


def estimate_interval(
    is_true: NDArray[np.bool_],
    scores: Float64Array,
    scene_of: NDArray[np.int64],
    truths_by_scene: Float64Array,
    *,
    repeats: int,
) -> tuple[float, float]:
    """Estimate the 95 % interval of the average precision by bootstrap over scenes.

    Frames of a scene resemble each other, so whole scenes are drawn with replacement.

    Args:
        is_true: (n,) whether each prediction is a true positive.
        scores: (n,).
        scene_of: (n,) number of the scene of each prediction.
        truths_by_scene: (scenes,) objects to find.
        repeats: Number of draws.

    Returns:
        Its ends; NaN with fewer than two scenes with objects.
    """
    count = len(truths_by_scene)
    if np.count_nonzero(truths_by_scene) < 2:
        return math.nan, math.nan
    order = np.argsort(-scores, kind="stable")
    is_true, scores, scene_of = is_true[order], scores[order], scene_of[order]
    generator = create_generator("benchmark bootstrap", count)
    drawn: list[float] = []
    for _ in range(repeats):
        times = np.bincount(generator.integers(count, size=count), minlength=count).astype(float)
        drawn.append(
            compute_average_precision(
                is_true, scores, float(times @ truths_by_scene), times[scene_of]
            )
        )
    tail = (1.0 - CONFIDENCE) / 2.0
    low, high = np.nanquantile(drawn, [tail, 1.0 - tail])
    return float(low), float(high)
