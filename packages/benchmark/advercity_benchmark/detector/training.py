"""Training: steps depend on the seed and their number alone, so a run can go on."""

import hashlib
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from advercity.dataset.reader import FrameView
from advercity.errors import InputError
from advercity.randomness import create_generator
from advercity_benchmark.detector.boxes import LEARNED_HEAT
from advercity_benchmark.detector.checkpoint import (
    Checkpoint,
    TrainingRecord,
    build_detector,
    digest_file,
    load_checkpoint,
    restore,
    save_checkpoint,
    start_from,
)
from advercity_benchmark.detector.clouds import check_frames
from advercity_benchmark.detector.images import check_cameras
from advercity_benchmark.detector.pytorch import Tensor, functional, nn, select_device, torch
from advercity_benchmark.detector.samples import Sample, make_sample
from advercity_benchmark.frame_selection import select_frames

WARM_UP_FRACTION = 0.1
WEIGHT_DECAY = 0.01
MAX_GRADIENT = 10.0
SAVE_EVERY = 100
BOX_WEIGHT = 1.0
CELLS_WEIGHT = 3.0
"""Weight of all cells of a learned box together, on average."""


@dataclass(frozen=True)
class TrainingProgress:
    """How far training is: steps done, and the mean loss of those since the last report."""

    step: int
    steps: int
    loss: float


def train_detector(
    dataset: Path,
    output: Path,
    record: TrainingRecord,
    *,
    frames: slice = slice(None),
    start: Path | None = None,
    device: str = "cpu",
    report: Callable[[TrainingProgress], None] = lambda progress: None,
) -> None:
    """Train a detector, or continue an interrupted run.

    The same record, dataset and number of threads give the same weights, with a break or without.

    Args:
        dataset: Frames to learn from.
        output: File of the detector, written every 100 steps.
        record: How to train; its checksums are filled in here.
        frames: Used frames of each scenario.
        start: Detector with the initial weights.
        device: As PyTorch names it.
        report: Called every 100 steps.

    Raises:
        InputError: The dataset cannot be used, or the file is of another training.
    """
    place = select_device(device)
    chosen = select_frames(dataset, frames)
    check_frames(chosen, record.fusion, is_ideal=record.is_ideal)
    if record.sensor == "camera":
        check_cameras(chosen)
    record = record.model_copy(
        update={
            "dataset_sha256": _digest_frames(chosen),
            "start_sha256": None if start is None else digest_file(start),
        }
    )
    network = build_detector(record)
    if start is not None:
        start_from(network, record, start)
    network.to(place)
    optimizer = torch.optim.AdamW(
        _select_learned(network, record, start), weight_decay=WEIGHT_DECAY
    )
    step = 0
    if output.exists():
        found = load_checkpoint(output)
        _check_record(found.record, record, output)
        restore(network, optimizer, found, output)
        step = found.step
    losses: list[float] = []
    while step < record.steps:
        _set_rate(optimizer, record, step)
        losses.append(_take_step(network, optimizer, chosen, record, step))
        step += 1
        if step % SAVE_EVERY == 0 or step == record.steps:
            state = Checkpoint(record, step, network.state_dict(), optimizer.state_dict())
            save_checkpoint(output, state)
            report(TrainingProgress(step, record.steps, sum(losses) / len(losses)))
            losses.clear()


def _select_learned(network: Any, record: TrainingRecord, start: Path | None) -> list[Tensor]:
    """Select the parameters to train: the encoder of an intermediate fusion stays fixed.

    So all stations send the feature maps of their own detector.
    """
    if start is None or record.fusion != "intermediate":
        return list(network.parameters())
    network.encoder.requires_grad_(False)
    return [*network.attention.parameters(), *network.head.parameters()]


def _set_rate(optimizer: Any, record: TrainingRecord, step: int) -> None:
    """Set the learning rate of a step: a linear rise, then half a cosine."""
    done = (step + 1) / record.steps
    if done < WARM_UP_FRACTION:
        factor = done / WARM_UP_FRACTION
    else:
        factor = 0.5 + 0.5 * math.cos(math.pi * (done - WARM_UP_FRACTION) / (1 - WARM_UP_FRACTION))
    for group in optimizer.param_groups:
        group["lr"] = record.learning_rate * max(factor, 0.01)


def _take_step(
    network: Any, optimizer: Any, frames: list[FrameView], record: TrainingRecord, step: int
) -> float:
    network.train()
    is_frozen = not next(network.encoder.parameters()).requires_grad
    if is_frozen:
        network.encoder.eval()
    optimizer.zero_grad()
    samples = [
        make_sample(
            _draw_frame(frames, record, step * record.batch + row),
            record.fusion,
            create_generator("benchmark training", record.seed, step, row),
            is_ideal=record.is_ideal,
            has_cameras=record.sensor == "camera",
        )
        for row in range(record.batch)
    ]
    # Objects weigh alike, however few a frame has, as in fog.
    objects = max(1, sum(int((sample.heat == 1.0).sum()) for sample in samples))
    total = 0.0
    for sample in samples:
        loss = _compute_loss(network, sample) / objects
        loss.backward()
        total += float(loss.detach())
    nn.utils.clip_grad_norm_(network.parameters(), MAX_GRADIENT)
    optimizer.step()
    return total


def _draw_frame(frames: list[FrameView], record: TrainingRecord, number: int) -> FrameView:
    """Draw a frame: each once in an order of its own, then each again in another."""
    turn, place = divmod(number, len(frames))
    order = create_generator("benchmark order", record.seed, turn).permutation(len(frames))
    return frames[int(order[place])]


def _compute_loss(network: Any, sample: Sample) -> Tensor:
    """Sum the loss over objects: focal for the heat, as of CenterNet, absolute for the boxes."""
    with torch.set_grad_enabled(next(network.encoder.parameters()).requires_grad):
        maps = [
            network.encode(recorded, area)
            for recorded, area in zip(sample.recorded, sample.areas, strict=True)
        ]
    heat, learned = network.predict(network.fuse(maps, sample.poses, sample.areas))
    wanted, boxes, weights = (
        torch.from_numpy(item).to(heat) for item in (sample.heat, sample.learned, sample.weights)
    )
    return _compute_heat_loss(heat[0], wanted, weights) + BOX_WEIGHT * _compute_box_loss(
        learned, boxes, wanted
    )


def _compute_heat_loss(heat: Tensor, wanted: Tensor, weights: Tensor) -> Tensor:
    is_middle = wanted == 1.0
    found, missed = functional.logsigmoid(heat), functional.logsigmoid(-heat)
    score = torch.sigmoid(heat)
    of_middles = (found * (1.0 - score) ** 2)[is_middle].sum()
    of_others = (missed * score**2 * (1.0 - wanted) ** 4 * weights)[~is_middle].sum()
    return -(of_middles + of_others)


def _compute_box_loss(learned: Tensor, boxes: Tensor, wanted: Tensor) -> Tensor:
    weights = wanted * (wanted >= LEARNED_HEAT)
    errors = (learned - boxes).abs().sum(0)
    return (errors * weights).sum() / CELLS_WEIGHT


def _digest_frames(frames: list[FrameView]) -> str:
    digest = hashlib.sha256()
    for frame in frames:
        digest.update(f"{frame.scenario.spec.provenance.digest} {frame.index}\n".encode())
    return digest.hexdigest()


def _check_record(found: TrainingRecord, wanted: TrainingRecord, path: Path) -> None:
    """Raise an InputError if a file is of another training."""
    before, now = found.model_dump(), wanted.model_dump()
    changed = [name for name in now if now[name] != before[name]]
    if changed:
        name = changed[0]
        label = {"dataset_sha256": "dataset", "start_sha256": "start"}.get(name, name)
        message = f"was trained with other values: {label} was {before[name]}, is {now[name]}"
        raise InputError(f"{path}: {message}; rename it, or write elsewhere")
