"""Matching of predicted and true boxes seen from above, as OPV2V and OpenCOOD define it."""

import numpy as np
import shapely
from numpy.typing import NDArray

from advercity.geometry.arrays import Float64Array
from advercity_benchmark.truth import compute_corners

UNMATCHED = -1


def compute_overlaps(first: Float64Array, second: Float64Array) -> Float64Array:
    """Compute the intersection over union (n, m), seen from above, of boxes (n, 7) and (m, 7)."""
    overlaps = np.zeros((len(first), len(second)))
    offsets = first[:, None, :2] - second[None, :, :2]
    reach = np.hypot(*first[:, 3:5].T)[:, None] + np.hypot(*second[:, 3:5].T)[None]
    # Boxes whose circles do not touch have no overlap.
    rows, columns = np.nonzero(2.0 * np.hypot(offsets[..., 0], offsets[..., 1]) < reach)
    one, other = compute_corners(first)[rows], compute_corners(second)[columns]
    shared = shapely.area(shapely.intersection(shapely.polygons(one), shapely.polygons(other)))
    areas = first[rows, 3] * first[rows, 4] + second[columns, 3] * second[columns, 4]
    overlaps[rows, columns] = shared / (areas - shared)
    return overlaps


def match_boxes(
    overlaps: Float64Array, scores: Float64Array, min_overlap: float
) -> NDArray[np.int64]:
    """Match predictions (n,) to rows of the truth, `UNMATCHED` for false ones.

    In the order of their scores, each takes the free box of largest overlap, if it is enough.

    Args:
        overlaps: (n, m) of predictions and truth.
        scores: (n,) of the predictions.
        min_overlap: Least overlap.
    """
    matched = np.full(len(scores), UNMATCHED, np.int64)
    left = overlaps.copy()
    for row in np.argsort(-scores, kind="stable").tolist() if left.size else []:
        best = int(left[row].argmax())
        if left[row, best] >= min_overlap:
            matched[row] = best
            left[:, best] = -1.0
    return matched
