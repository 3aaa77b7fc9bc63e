"""Boxes, and the network's maps of targets and predictions: one cell for each square metre.

Seen from above, a box has the same overlap after half a turn; so does its learned heading, the sine
and cosine of twice its angle.
"""

import numpy as np

from advercity.geometry.arrays import Float32Array, Float64Array
from advercity_benchmark.matching import compute_overlaps

CELL_M = 1.0
BOX_CHANNELS = 8
"""Offset in x and y, height of the middle, logarithms of the sizes, sine and cosine of twice the
heading."""
SPREAD_M = 1.0
"""Standard deviation of the peak around a middle."""
LEARNED_HEAT = 0.5
"""Cells from which the box is learned: within 1.2 m of its middle."""
HIGHEST_OVERLAP = 0.15
"""Above this overlap of two boxes, the one with the lower score is dropped."""
SAME_OBJECT_M = 2.5
"""Boxes of a LiDAR and of a camera whose middles are nearer are of one object."""
Area = tuple[float, float]
"""Half length and half width in metres around a LiDAR, multiples of 4 m."""
FoundBoxes = tuple[Float64Array, Float64Array]
"""Boxes (n, 7) and their scores (n,)."""


def count_cells(area: Area) -> tuple[int, int]:
    """Return the number of cells along x and y."""
    return round(2 * area[0] / CELL_M), round(2 * area[1] / CELL_M)


def compute_cell_centres(area: Area) -> Float64Array:
    """Compute the middles (nx, ny, 2) of the cells of an area."""
    cells = np.moveaxis(np.indices(count_cells(area), np.float64), 0, -1)
    return (cells + 0.5) * CELL_M - np.array(area)


def draw_targets(
    boxes: Float64Array, ignored: Float64Array, area: Area
) -> tuple[Float32Array, Float32Array, Float32Array]:
    """Draw the targets of the network.

    Args:
        boxes: (n, 7) in the frame of the map.
        ignored: (m, 7) boxes where anything may be predicted.
        area: Area of the map.

    Returns:
        Heat (nx, ny), 1 in the cell of a middle; boxes (8, nx, ny) of the nearest middle; weights
        (nx, ny) of the heat, 0 at ignored boxes.
    """
    centres = compute_cell_centres(area)
    heat = np.zeros(centres.shape[:2])
    learned = np.zeros((BOX_CHANNELS, *heat.shape))
    weights = np.ones_like(heat)
    for box in ignored:
        weights[np.hypot(*np.moveaxis(centres - box[:2], -1, 0)) < 0.5 * box[3] + CELL_M] = 0.0
    for box in boxes:
        cell = np.floor((box[:2] + area) / CELL_M).astype(int)
        if not ((cell >= 0) & (cell < heat.shape)).all():
            continue
        low = np.maximum(cell - 3, 0)
        window = (slice(low[0], cell[0] + 4), slice(low[1], cell[1] + 4))
        offsets = box[:2] - centres[window]
        peak = np.exp(-(offsets**2).sum(axis=-1) / (2.0 * SPREAD_M**2))
        nearer = peak > heat[window]
        shape = [box[2], *np.log(box[3:6]), np.sin(2 * box[6]), np.cos(2 * box[6])]
        row = np.concatenate(
            [
                np.moveaxis(offsets, -1, 0),
                np.broadcast_to(np.reshape(shape, (6, 1, 1)), (6, *peak.shape)),
            ]
        )
        learned[:, window[0], window[1]][:, nearer] = row[:, nearer]
        heat[window] = np.maximum(heat[window], peak)
        heat[tuple(cell)] = 1.0
        weights[window] = 1.0
    return heat.astype(np.float32), learned.astype(np.float32), weights.astype(np.float32)


def drop_overlapping(boxes: Float64Array, scores: Float64Array) -> FoundBoxes:
    """Drop boxes (n, 7) in overlap with one of a higher score (n,)."""
    order = np.argsort(-scores, kind="stable")
    boxes, scores = boxes[order], scores[order]
    overlaps = compute_overlaps(boxes, boxes) > HIGHEST_OVERLAP
    kept = np.ones(len(boxes), np.bool_)
    for row in range(len(boxes)):
        if kept[row]:
            kept[row + 1 :] &= ~overlaps[row, row + 1 :]
    return boxes[kept], scores[kept]


def fuse_sensors(lidar: FoundBoxes, camera: FoundBoxes) -> FoundBoxes:
    """Fuse the boxes of a station's LiDAR and cameras, in one frame.

    Boxes of both are where the LiDAR has them, since cameras are less sure of distances, with the
    probability that one of them is right. Other boxes keep their scores.
    """
    boxes, scores = lidar[0], lidar[1].copy()
    seen, seen_scores = camera
    if not len(boxes) or not len(seen):
        return np.concatenate([boxes, seen]), np.concatenate([scores, seen_scores])
    offsets = seen[:, None, :2] - boxes[None, :, :2]
    distances_m = np.hypot(offsets[..., 0], offsets[..., 1])
    nearest = distances_m.argmin(axis=1)
    is_same = distances_m.min(axis=1) < SAME_OBJECT_M
    best = np.zeros(len(boxes))
    np.maximum.at(best, nearest[is_same], seen_scores[is_same])
    fused = 1.0 - (1.0 - scores) * (1.0 - best)
    return np.concatenate([boxes, seen[~is_same]]), np.concatenate([fused, seen_scores[~is_same]])
