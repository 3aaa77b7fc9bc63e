"""Evaluation of predictions on a dataset: overall, and by weather, time, density, road and more.

Predictions are matched once per frame and overlap, against all objects. A cell then counts its own
objects, the predictions of them, and the false ones of its kind: in its weather, or at its
distance. False predictions have no number of points, so they count in every cell of points.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, get_args

import numpy as np
from advercity_dsl import ActorClass
from advercity_dsl.base import suggest_name
from numpy.typing import NDArray

from advercity.dataset.boxes import UNCLASSIFIED
from advercity.dataset.reader import FrameView, Scenario, open_scenarios
from advercity.dataset.statistics import StatisticsTable
from advercity.errors import InputError
from advercity.geometry import poses
from advercity.geometry.arrays import Float64Array
from advercity_benchmark.average_precision import (
    compute_average_precision,
    compute_calibration_error,
    estimate_interval,
)
from advercity_benchmark.frame_selection import select_frames
from advercity_benchmark.matching import UNMATCHED, compute_overlaps, match_boxes
from advercity_benchmark.predictions import (
    NO_PREDICTIONS,
    FramePredictions,
    Predictions,
    load_predictions,
)
from advercity_benchmark.truth import (
    COMMUNICATION_RANGE_M,
    RANGE_M,
    VEHICLES,
    FrameTruth,
    is_within,
    load_frame_truth,
    to_box,
)

OVERLAPS = (0.3, 0.5, 0.7)
CALIBRATION_OVERLAP = 0.5
DISTANCE_EDGES_M = (30.0, 50.0, 100.0)
POINT_EDGES = (1, 10, 100)
IGNORED = -2
"""In place of the object's row: a prediction of an ignored object."""
ANY_CELL = -1


@dataclass(frozen=True)
class EvaluationOptions:
    """Scope of an evaluation.

    Attributes:
        classes: Classes of counted objects.
        communication_range_m: Agents within this distance of the ego cooperate.
        range_m: Half length and half width of the evaluated area, in the ego's LiDAR frame.
        min_points: Least points of a counted object.
        bootstrap: Draws for the intervals.
        frames: Evaluated frames of each scenario, counted from the first kept one.
        layout: Layout of a foreign folder, as in `open_dataset`.
    """

    classes: tuple[str, ...] = VEHICLES
    communication_range_m: float = COMMUNICATION_RANGE_M
    range_m: tuple[float, float] = RANGE_M
    min_points: int = 0
    bootstrap: int = 200
    frames: slice = field(default_factory=lambda: slice(None))
    layout: str | None = None


@dataclass(frozen=True, eq=False)
class _Counted:
    """All counted objects and predictions of a dataset.

    Attributes:
        scenes: Scenarios with frames.
        truth_scene: (t,) number of the scene of each object.
        truth_distance_m: (t,) horizontal distance from the ego's LiDAR.
        truth_points: (t,) LiDAR points.
        scores: (p,) of predictions.
        scene: (p,) number of the scene of each prediction.
        distance_m: (p,) as of objects.
        matched: By overlap, (p,) the object found, `UNMATCHED`, or `IGNORED`.
    """

    scenes: tuple[Scenario, ...]
    truth_scene: NDArray[np.int64]
    truth_distance_m: Float64Array
    truth_points: NDArray[np.int64]
    scores: Float64Array
    scene: NDArray[np.int64]
    distance_m: Float64Array
    matched: dict[float, NDArray[np.int64]]


@dataclass(frozen=True)
class Evaluation:
    """The result of an evaluation.

    Attributes:
        table: A row for each cell: `by` and `cell`, numbers, average precisions with the ends of
            their intervals, recall, and the calibration error.
        frames: Number of evaluated frames.
        missing_frames: Number of them without a line in the file of predictions.
    """

    table: StatisticsTable
    frames: int
    missing_frames: int


def evaluate_predictions(
    predictions: Path, dataset: Path, options: EvaluationOptions | None = None
) -> Evaluation:
    """Evaluate a file of predictions on all frames of a dataset.

    A frame without a line counts as one without predictions.

    Raises:
        InputError: A file cannot be read, the dataset has no frames, a line is of a missing frame,
            no object has one of the classes, or the area is empty.
    """
    options = options or EvaluationOptions()
    if options.layout is None:
        _check_classes(options.classes)
    if not all(0 < half_m < math.inf for half_m in options.range_m):
        raise InputError("`area` must be two lengths above 0 m")
    loaded, scenes = load_predictions(predictions), open_scenarios(dataset, options.layout)
    written = [(scene.id, number) for scene in scenes for number in scene.frame_numbers]
    unknown = sorted(loaded.frames.keys() - set(written))
    if unknown:
        scenario, frame = unknown[0]
        message = f"frame {frame} of {scenario} is not in {dataset}"
        more = f", and {len(unknown) - 1} more" if len(unknown) > 1 else ""
        raise InputError(f"{predictions}: {message}{more}")
    chosen = select_frames(dataset, options.frames, options.layout)
    counted = _count_frames(chosen, loaded, options)
    cuts = _list_cuts(counted.scenes)
    rows = [row for by, split in cuts.items() for row in _evaluate_cut(by, split, counted, options)]
    table = StatisticsTable(
        "benchmark",
        "Average precision by cell",
        {name: [row[name] for row in rows] for name in rows[0]},
    )
    keys = {(frame.scenario.id, frame.index) for frame in chosen}
    return Evaluation(table, len(keys), len(keys - loaded.frames.keys()))


def _check_classes(classes: Sequence[str]) -> None:
    """Raise InputError for an unknown class."""
    known = (*get_args(ActorClass), UNCLASSIFIED)
    for name in classes:
        if name not in known:
            raise InputError(f"unknown class '{name}'; {suggest_name(name, known)}")


def _count_frames(
    frames: Sequence[FrameView], predictions: Predictions, options: EvaluationOptions
) -> _Counted:
    scenes = tuple({frame.scenario.path: frame.scenario for frame in frames}.values())
    numbers = {scenario.path: number for number, scenario in enumerate(scenes)}
    truths: list[Float64Array] = []
    found: list[Float64Array] = []
    matched: dict[float, list[NDArray[np.int64]]] = {overlap: [] for overlap in OVERLAPS}
    count = 0
    for frame in frames:
        scene = numbers[frame.scenario.path]
        truth = load_frame_truth(
            frame,
            classes=options.classes,
            communication_range_m=options.communication_range_m,
            range_m=options.range_m,
            min_points=options.min_points,
        )
        line = predictions.frames.get((frame.scenario.id, frame.index), NO_PREDICTIONS)
        kept = _select_predictions(line, frame, predictions, options)
        for overlap, rows in _match_frame(kept, truth, count).items():
            matched[overlap].append(rows)
        wanted = truth.boxes[truth.is_counted]
        count += len(wanted)
        distances_m = np.hypot(wanted[:, 0], wanted[:, 1])
        points = truth.points[truth.is_counted]
        truths.append(np.column_stack([np.full(len(wanted), scene), distances_m, points]))
        distances_m = np.hypot(kept.boxes[:, 0], kept.boxes[:, 1])
        found.append(np.column_stack([np.full(len(kept), scene), distances_m, kept.scores]))
    truth_table, found_table = (
        np.concatenate([np.empty((0, 3)), *rows]) for rows in (truths, found)
    )
    return _Counted(
        scenes=scenes,
        truth_scene=truth_table[:, 0].astype(np.int64),
        truth_distance_m=truth_table[:, 1],
        truth_points=truth_table[:, 2].astype(np.int64),
        scores=found_table[:, 2],
        scene=found_table[:, 0].astype(np.int64),
        distance_m=found_table[:, 1],
        matched={
            overlap: np.concatenate([np.empty(0, np.int64), *rows])
            for overlap, rows in matched.items()
        },
    )


def _select_predictions(
    line: FramePredictions,
    frame: FrameView,
    predictions: Predictions,
    options: EvaluationOptions,
) -> FramePredictions:
    """Select the predictions within the range and of the classes, in the ego's LiDAR frame."""
    boxes = _to_lidar(line.boxes, frame, predictions.header.coordinates)
    kept = is_within(boxes, options.range_m)
    if line.classes is not None:
        kept &= np.isin(line.classes, options.classes)
    return FramePredictions(boxes[kept], line.scores[kept])


def _to_lidar(boxes: Float64Array, frame: FrameView, coordinates: str) -> Float64Array:
    if coordinates == "lidar_left_handed":
        return boxes * (1.0, -1.0, 1.0, 1.0, 1.0, 1.0, -1.0)
    if coordinates == "lidar" or not len(boxes):
        return boxes
    ego = frame[frame.scenario.ego]
    lidar_from_world = poses.invert_pose(ego.world_from_lidar)
    rows = [
        to_box(lidar_from_world @ poses.pose_matrix((x, y, z), yaw=yaw), np.array([*size]))
        for x, y, z, *size, yaw in boxes.tolist()
    ]
    return np.array(rows)


def _match_frame(
    kept: FramePredictions, truth: FrameTruth, first: int
) -> dict[float, NDArray[np.int64]]:
    """Match the predictions of a frame by overlap; counted objects are numbered from `first`."""
    numbers = np.where(truth.is_counted, first - 1 + np.cumsum(truth.is_counted), IGNORED)
    numbers = np.append(numbers, UNMATCHED)  # the last row, which UNMATCHED indexes
    overlaps = compute_overlaps(kept.boxes, truth.boxes)
    return {overlap: numbers[match_boxes(overlaps, kept.scores, overlap)] for overlap in OVERLAPS}


_Split = Callable[[_Counted], tuple[Sequence[str], NDArray[np.int64], NDArray[np.int64]]]
"""Returns the names of cells, and the number of the cell of each object and false prediction."""


def _split_by_scene(describe: Callable[[Scenario], str]) -> _Split:
    def split(counted: _Counted) -> tuple[Sequence[str], NDArray[np.int64], NDArray[np.int64]]:
        names, of_scene = np.unique([describe(one) for one in counted.scenes], return_inverse=True)
        return names.tolist(), of_scene[counted.truth_scene], of_scene[counted.scene]

    return split


def _split_by_distance(
    counted: _Counted,
) -> tuple[Sequence[str], NDArray[np.int64], NDArray[np.int64]]:
    return (
        _name_distances(),
        np.digitize(counted.truth_distance_m, DISTANCE_EDGES_M),
        np.digitize(counted.distance_m, DISTANCE_EDGES_M),
    )


def _split_by_points(
    counted: _Counted,
) -> tuple[Sequence[str], NDArray[np.int64], NDArray[np.int64]]:
    anywhere = np.full(len(counted.scores), ANY_CELL)
    return (
        ("0", "1 to 9", "10 to 99", "from 100"),
        np.digitize(counted.truth_points, POINT_EDGES),
        anywhere,
    )


def _name_distances() -> list[str]:
    inner = [f"{low:g} to {high:g} m" for low, high in pairwise((0.0, *DISTANCE_EDGES_M))]
    return [*inner, f"from {DISTANCE_EDGES_M[-1]:g} m"]


def _list_cuts(scenes: Sequence[Scenario]) -> dict[str, _Split]:
    """List the cuts by the scenarios' labels, by distance and by points."""
    labels = dict.fromkeys(name for scene in scenes for name in scene.labels)
    return {
        "all": _split_by_scene(lambda scene: "all"),
        **{name: _split_by_label(name) for name in labels},
        "distance": _split_by_distance,
        "points": _split_by_points,
    }


def _split_by_label(name: str) -> _Split:
    return _split_by_scene(lambda scene: scene.labels.get(name, "none"))


def _evaluate_cut(
    by: str, split: _Split, counted: _Counted, options: EvaluationOptions
) -> Iterator[dict[str, Any]]:
    names, truth_cell, own_cell = split(counted)
    for cell, name in enumerate(names):
        is_inside = truth_cell == cell
        truths = int(is_inside.sum())
        row: dict[str, Any] = {"by": by, "cell": name, "objects": truths}
        for overlap in OVERLAPS:
            matched = counted.matched[overlap]
            is_true = matched >= 0
            of_cell = is_true.copy()
            of_cell[is_true] = is_inside[matched[is_true]]
            is_false = (matched == UNMATCHED) & ((own_cell == cell) | (own_cell == ANY_CELL))
            rows = np.flatnonzero(of_cell | is_false)
            true, scores = is_true[rows], counted.scores[rows]
            ap = compute_average_precision(true, scores, truths)
            low, high = estimate_interval(
                true,
                scores,
                counted.scene[rows],
                np.bincount(counted.truth_scene[is_inside], minlength=len(counted.scenes)).astype(
                    np.float64
                ),
                repeats=options.bootstrap,
            )
            percent = round(100 * overlap)
            row |= {f"ap_{percent}": ap, f"ap_{percent}_low": low, f"ap_{percent}_high": high}
            if overlap == CALIBRATION_OVERLAP:
                row |= {
                    "predictions": len(rows),
                    "recall_50": float(true.sum() / truths) if truths else math.nan,
                    "calibration_error": compute_calibration_error(true, scores),
                }
        yield row
