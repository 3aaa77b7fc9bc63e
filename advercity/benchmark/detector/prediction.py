"""Predictions of a trained detector on a dataset."""

from pathlib import Path
from typing import Any

import numpy as np

from advercity.benchmark.detector.boxes import Area, compute_cell_centres, drop_overlapping
from advercity.benchmark.detector.checkpoint import load_detector
from advercity.benchmark.detector.clouds import Fusion, StationCloud, check_frames, load_clouds
from advercity.benchmark.detector.pytorch import Tensor, functional, select_device, torch
from advercity.benchmark.detector.samples import EGO_AREA, STATION_AREA, merge_clouds
from advercity.benchmark.frame_selection import select_frames
from advercity.benchmark.predictions import FrameKey, FramePredictions, write_predictions
from advercity.dataset.reader import FrameView
from advercity.errors import InputError
from advercity.geometry import poses
from advercity.geometry.arrays import Float64Array
from advercity.geometry.poses import Matrix
from advercity.output_files import check_output

_TRAINED_BY: dict[Fusion, Fusion] = {"late": "none", "early": "none"}
"""What else a detector may have been trained with: it sees the boxes or the points of others."""
MAX_BOXES = 200
LOWEST_SCORE = 0.05


def predict_dataset(
    detector: Path,
    dataset: Path,
    output: Path,
    *,
    fusion: Fusion | None = None,
    is_ideal: bool = False,
    frames: slice = slice(None),
    device: str = "cpu",
) -> int:
    """Write the predictions of a detector on the frames of a dataset; return their number.

    Args:
        detector: File of a trained detector.
        dataset: Frames to predict.
        output: File of predictions.
        fusion: That of the detector if None; one that was trained without fusion can also fuse
            `late` and `early`.
        is_ideal: Whether all stations in range arrive at once and with their true poses.
        frames: Recorded frames of each scenario that are used.
        device: As PyTorch names it.

    Raises:
        InputError: The detector or the dataset cannot be used, or the file may not be replaced.
    """
    check_output(output)
    place = select_device(device)
    network, record = load_detector(detector)
    fusion = fusion or record.fusion
    if record.fusion != fusion and record.fusion != _TRAINED_BY.get(fusion):
        message = f"was trained with --fusion {record.fusion}, which cannot predict with {fusion}"
        raise InputError(f"{detector}: {message}")
    chosen = select_frames(dataset, frames)
    check_frames(chosen, fusion, is_ideal=is_ideal)
    network.to(place)
    found: dict[FrameKey, FramePredictions] = {}
    for frame in chosen:
        found[frame.scenario.spec.id, frame.index] = predict_frame(
            network, frame, fusion, is_ideal=is_ideal
        )
    write_predictions(output, found, model=f"advercity baseline, {fusion} fusion")
    return len(chosen)


def predict_frame(
    network: Any, frame: FrameView, fusion: Fusion, *, is_ideal: bool = False
) -> FramePredictions:
    """Predict the boxes of a frame in the ego's LiDAR frame."""
    clouds = load_clouds(frame, fusion, is_ideal=is_ideal)
    if fusion == "early":
        clouds = [merge_clouds(clouds)]
    areas = [EGO_AREA, *[STATION_AREA] * (len(clouds) - 1)]
    with torch.inference_mode():
        maps = [network.encode(one.points, area) for one, area in zip(clouds, areas, strict=True)]
        if fusion == "late":
            found = [
                _detect(network, features, area) for features, area in zip(maps, areas, strict=True)
            ]
            boxes, scores = _merge_boxes(found, clouds)
        else:
            fused = network.fuse(maps, [one.ego_from_station for one in clouds], areas)
            boxes, scores = _detect(network, fused, EGO_AREA)
    boxes[:, 2] += clouds[0].ground_m
    return FramePredictions(boxes, scores)


def _detect(network: Any, features: Tensor, area: Area) -> tuple[Float64Array, Float64Array]:
    heat, learned = network.predict(features)
    return read_boxes(heat, learned, area)


def read_boxes(heat: Tensor, learned: Tensor, area: Area) -> tuple[Float64Array, Float64Array]:
    """Read boxes (n, 7) and their scores (n,) off the predicted maps (1, nx, ny), (8, nx, ny).

    Boxes are the peaks of the heat, less those that overlap with a better one.
    """
    scores = torch.sigmoid(heat)
    is_peak = scores == functional.max_pool2d(scores, 3, stride=1, padding=1)
    ranked = (scores * is_peak).flatten()
    best, places = torch.topk(ranked, min(MAX_BOXES, ranked.numel()))
    places, best = places[best >= LOWEST_SCORE], best[best >= LOWEST_SCORE]
    rows = learned.flatten(1)[:, places].T.double().cpu().numpy()
    centres = compute_cell_centres(area).reshape(-1, 2)[places.cpu().numpy()]
    found = np.column_stack(
        [
            centres + rows[:, :2],
            rows[:, 2],
            np.exp(np.clip(rows[:, 3:6], -2.0, 3.5)),
            0.5 * np.arctan2(rows[:, 6], rows[:, 7]),
        ]
    )
    return drop_overlapping(found, best.double().cpu().numpy())


def _merge_boxes(
    found: list[tuple[Float64Array, Float64Array]], clouds: list[StationCloud]
) -> tuple[Float64Array, Float64Array]:
    """Merge the boxes of all stations in the ego's frame."""
    moved = [
        _move_boxes(boxes, cloud.ego_from_station)
        for (boxes, _), cloud in zip(found, clouds, strict=True)
    ]
    return drop_overlapping(np.concatenate(moved), np.concatenate([scores for _, scores in found]))


def _move_boxes(boxes: Float64Array, pose: Matrix) -> Float64Array:
    moved = boxes.copy()
    moved[:, :3] = poses.transform_points(pose, boxes[:, :3])
    moved[:, 6] += poses.to_yaw_pitch_roll(pose)[0]
    return moved
