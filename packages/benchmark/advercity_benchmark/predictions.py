"""Predictions of a model as JSON Lines: a header, then one line per frame.

    {"format": "advercity-predictions", "version": 1, "coordinates": "lidar", "model": "my model"}
    {"scenario": "ui_fog_day_sparse", "frame": 0, "boxes": [[x, y, z, l, w, h, yaw]], "scores": [1]}

A box is the middle of the object, its length, width and height in metres, and its heading in
radians. `coordinates` are the ego's first LiDAR (`lidar`: x forward, y left, z up), the same as the
files and OpenCOOD have it (`lidar_left_handed`: y right, headings positive to the right), or the
right-handed `world`. A line may have `classes`, the class of each box.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from io import BytesIO, TextIOWrapper
from pathlib import Path
from typing import Annotated, Literal, TypeVar

import numpy as np
from advercity_dsl import Model
from numpy.typing import NDArray
from pydantic import Field, ValidationError

from advercity.diagnostics import DiagnosticsError
from advercity.documents import parse_json, read_bytes
from advercity.errors import InputError, describe_cause
from advercity.geometry.arrays import Float64Array
from advercity.output_files import write_output

FORMAT_NAME = "advercity-predictions"
MAX_BOXES = 10_000
MAX_PREDICTION_BYTES = 10**9
_Finite = Annotated[float, Field(ge=-1e7, le=1e7)]
_Size = Annotated[float, Field(gt=0, le=1000)]
_Box = tuple[_Finite, _Finite, _Finite, _Size, _Size, _Size, _Finite]
_Coordinates = Literal["lidar", "lidar_left_handed", "world"]
_Text = Annotated[str, Field(max_length=200, pattern="^[^\\x00]*$")]
_ModelT = TypeVar("_ModelT", bound=Model)


class PredictionHeader(Model):
    """The first line of a file of predictions."""

    format: Literal["advercity-predictions"]
    version: Literal[1]
    coordinates: _Coordinates = "lidar"
    model: Annotated[str, Field(max_length=200)] = ""


class _FrameLine(Model):
    scenario: Annotated[str, Field(max_length=200)]
    frame: Annotated[int, Field(ge=0)]
    boxes: Annotated[list[_Box], Field(max_length=MAX_BOXES)]
    scores: Annotated[list[Annotated[float, Field(ge=0, le=1)]], Field(max_length=MAX_BOXES)]
    classes: Annotated[list[_Text], Field(max_length=MAX_BOXES)] | None = None


@dataclass(frozen=True, eq=False)
class FramePredictions:
    """Predicted boxes of a frame, n of them.

    Attributes:
        boxes: (n, 7) x, y, z of the middle, length, width and height, in metres, and the heading in
            radians.
        scores: (n,) from 0 to 1.
        classes: (n,) text; None if the model does not tell them apart.
    """

    boxes: Float64Array
    scores: Float64Array
    classes: NDArray[np.str_] | None = None

    def __len__(self) -> int:
        """Return the number of boxes."""
        return len(self.boxes)


NO_PREDICTIONS = FramePredictions(np.empty((0, 7)), np.empty(0))
FrameKey = tuple[str, int]
"""Id of a scenario and number of a frame."""


@dataclass(frozen=True)
class Predictions:
    """A file of predictions.

    Attributes:
        header: Its first line.
        frames: Predictions by frame.
    """

    header: PredictionHeader
    frames: Mapping[FrameKey, FramePredictions]


def load_predictions(path: Path | str) -> Predictions:
    """Load a file of predictions.

    Raises:
        InputError: It does not exist, or a line is not valid; the text names the line.
    """
    path, frames = Path(path), dict[FrameKey, FramePredictions]()
    lines = _iterate_lines(path)
    number, first = next(lines, (1, ""))
    header = _parse(PredictionHeader, first, path, number)
    for number, text in lines:
        line = _parse(_FrameLine, text, path, number)
        key = (line.scenario, line.frame)
        if key in frames:
            raise InputError(f"{path}:{number}: frame {line.frame} of {line.scenario} is repeated")
        for name, values in (("scores", line.scores), ("classes", line.classes)):
            if values is not None and len(values) != len(line.boxes):
                found = f"{len(values)} {name} for {len(line.boxes)} boxes"
                raise InputError(f"{path}:{number}: {found}; give one for each")
        frames[key] = FramePredictions(
            boxes=np.reshape(line.boxes, (-1, 7)).astype(np.float64),
            scores=np.array(line.scores, np.float64),
            classes=None if line.classes is None else np.array(line.classes, np.str_),
        )
    return Predictions(header, frames)


def write_predictions(
    path: Path | str,
    frames: Mapping[FrameKey, FramePredictions],
    *,
    coordinates: _Coordinates = "lidar",
    model: str = "",
) -> None:
    """Write a file of predictions.

    Raises:
        InputError: The file exists and may not be replaced.
        RunError: It cannot be written.
    """
    header = PredictionHeader(format=FORMAT_NAME, version=1, coordinates=coordinates, model=model)
    lines = [header.model_dump_json()]
    for (scenario, frame), found in frames.items():
        line = _FrameLine(
            scenario=scenario,
            frame=frame,
            boxes=[tuple(box) for box in found.boxes.tolist()],
            scores=found.scores.tolist(),
            classes=None if found.classes is None else found.classes.tolist(),
        )
        lines.append(line.model_dump_json(exclude_none=True))
    write_output(Path(path), ("\n".join(lines) + "\n").encode())


def _iterate_lines(path: Path) -> Iterator[tuple[int, str]]:
    """Yield the lines of a file with text, with their numbers."""
    try:
        raw = read_bytes(path, max_bytes=MAX_PREDICTION_BYTES)
        with TextIOWrapper(BytesIO(raw), encoding="utf-8") as stream:
            for number, text in enumerate(stream, start=1):
                if text.strip():
                    yield number, text
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is no text in UTF-8") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {describe_cause(error)}") from error


def _parse(model: type[_ModelT], text: str, path: Path, number: int) -> _ModelT:
    try:
        return model.model_validate(parse_json(text, path))
    except DiagnosticsError as error:
        what, cause = error.diagnostics[0].message, error
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        where = ".".join(map(str, first["loc"]))
        what, cause = f"{where}: {first['msg']}" if where else first["msg"], error
    if model is PredictionHeader:
        what += f'; the first line is {{"format": "{FORMAT_NAME}", "version": 1}}'
    raise InputError(f"{path}:{number}: {what}") from cause
