"""Detectors in files: weights, their training, and the state to go on after a kill."""

import hashlib
import io
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from advercity_dsl import Model
from advercity_dsl.base import suggest_name
from pydantic import Field, ValidationError

from advercity.documents import parse_json, read_bytes
from advercity.errors import InputError, RunError, describe_cause
from advercity.output_files import write_output
from advercity_benchmark.detector.network import Detector
from advercity_benchmark.detector.pytorch import torch

MAX_CHECKPOINT_BYTES = 10**9
FORMAT_NAME = "advercity-detector"
Sensor = Literal["lidar", "camera"]
SENSORS: tuple[Sensor, ...] = get_args(Sensor)


def check_sensor(name: str) -> Sensor:
    """Return the sensor by its name; InputError if it is unknown."""
    for sensor in SENSORS:
        if sensor == name:
            return sensor
    raise InputError(f"--sensor {name}: no such sensor; {suggest_name(name, SENSORS)}")


class TrainingRecord(Model):
    """Settings of a training: an interrupted run continues only with equal ones."""

    version: Literal[1] = 1
    sensor: Sensor = "lidar"
    fusion: Literal["none", "early", "intermediate"] = "none"
    steps: Annotated[int, Field(ge=1, le=10_000_000)] = 3000
    batch: Annotated[int, Field(ge=1, le=1000)] = 2
    seed: Annotated[int, Field(ge=0)] = 1
    channels: Annotated[int, Field(ge=8, le=512)] = 32
    learning_rate: Annotated[float, Field(gt=0, le=1)] = 2e-3
    is_ideal: bool = False
    dataset_sha256: str = ""
    """SHA-256 of its scenarios' names, their specs and the numbers of their frames."""
    start_sha256: str | None = None
    """SHA-256 of the initial detector."""


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """A detector after some steps of training.

    Attributes:
        record: How it is trained.
        step: Steps done.
        weights, optimizer: States as PyTorch has them.
    """

    record: TrainingRecord
    step: int
    weights: dict[str, Any]
    optimizer: dict[str, Any]


def build_detector(record: TrainingRecord) -> Any:
    """Build the network of a record, with weights drawn from its seed."""
    torch.manual_seed(record.seed)
    network: Any = Detector(
        record.channels,
        has_attention=record.fusion == "intermediate",
        has_cameras=record.sensor == "camera",
    )
    return network.to(memory_format=torch.channels_last)


def load_detector(path: Path) -> tuple[Any, TrainingRecord]:
    """Load a trained network, ready to predict; InputError if training has not ended."""
    found = load_checkpoint(path)
    if found.step < found.record.steps:
        raise InputError(
            f"{path}: training has not ended: {found.step} of {found.record.steps} steps;"
            " the same `advercity benchmark train` goes on"
        )
    network = build_detector(found.record)
    _load_weights(network, found.weights, path)
    return network.eval(), found.record


def load_checkpoint(path: Path) -> Checkpoint:
    """Load a checkpoint; InputError if the file is none."""
    raw = _read_file(path)
    try:
        # Only tensors and plain values: a file of others runs no code.
        found = torch.load(io.BytesIO(raw), map_location="cpu", weights_only=True)
        if found["format"] != FORMAT_NAME:
            raise ValueError(found["format"])
        return Checkpoint(
            record=TrainingRecord.model_validate(parse_json(found["record"], path)),
            step=int(found["step"]),
            weights=dict(found["weights"]),
            optimizer=dict(found["optimizer"]),
        )
    except ValidationError as error:
        raise InputError(f"{path}: is a detector of another version") from error
    except Exception as error:  # torch.load raises many kinds for other files
        raise InputError(f"{path}: is no detector, or is damaged") from error


def digest_file(path: Path) -> str:
    """Compute the SHA-256 of a detector's file; InputError if it cannot be read."""
    return hashlib.sha256(_read_file(path)).hexdigest()


def _read_file(path: Path) -> bytes:
    try:
        return read_bytes(path, max_bytes=MAX_CHECKPOINT_BYTES)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {describe_cause(error)}") from error


def save_checkpoint(path: Path, checkpoint: Checkpoint) -> None:
    """Write a checkpoint, complete or not at all."""
    content = io.BytesIO()
    document = {
        "format": FORMAT_NAME,
        "record": checkpoint.record.model_dump_json(),
        "step": checkpoint.step,
        "weights": checkpoint.weights,
        "optimizer": checkpoint.optimizer,
    }
    torch.save(document, content)
    try:
        write_output(path, content.getvalue())
    except OSError as error:
        raise RunError(f"{path}: cannot be written: {describe_cause(error)}") from error


def restore(network: Any, optimizer: Any, checkpoint: Checkpoint, path: Path) -> None:
    """Set a network and its optimizer to a checkpoint."""
    _load_weights(network, checkpoint.weights, path)
    optimizer.load_state_dict(checkpoint.optimizer)


def start_from(network: Any, record: TrainingRecord, path: Path) -> None:
    """Take the weights of a finished detector, of which a record's may have more parts.

    Raises:
        InputError: It sees something else, or its feature maps have another width.
    """
    started, before = load_detector(path)
    for name in ("sensor", "channels"):
        found, wanted = getattr(before, name), getattr(record, name)
        if found != wanted:
            raise InputError(f"{path}: was trained with --{name} {found}, not {wanted}")
    known = network.state_dict()
    taken = {name: value for name, value in started.state_dict().items() if name in known}
    network.load_state_dict(taken, strict=False)


def _load_weights(network: Any, weights: dict[str, Any], path: Path) -> None:
    try:
        network.load_state_dict(weights)
    except RuntimeError as error:
        raise InputError(f"{path}: is no detector, or is damaged") from error
