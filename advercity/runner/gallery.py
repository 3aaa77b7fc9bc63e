"""One camera of every scenario under every weather, on one sheet."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from advercity_dsl import Agent, Spec, Vehicle, Weather
from numpy.typing import NDArray

from advercity.compiler import under
from advercity.compiler.library import Entry
from advercity.errors import InputError
from advercity.pictures import write_picture
from advercity.rendering.backend import PROFILES, Profile
from advercity.rendering.registry import load_backend
from advercity.runner.progress import Progress, Report, no_report
from advercity.runner.sensing import senses
from advercity.runner.stage import Stage, set_stage
from advercity.runner.viewpoints import Viewpoints

Image = NDArray[np.uint8]
WIDTH_PX = 384
"""Of a picture, where nobody asks for another."""
OVERSAMPLING = 2
"""Pictures are taken this many times larger and averaged."""
BAR_PX = 20


def write_gallery(
    specs: Sequence[Spec],
    weathers: Sequence[Entry[Weather]],
    output: Path,
    *,
    agent: str | None = None,
    camera: int = 0,
    frame: int | None = None,
    backend: str = "sapien",
    profile: str = "preview",
    width_px: int = WIDTH_PX,
    report: Report = no_report,
) -> None:
    """Write a sheet with a row per weather and a column per scenario.

    Args:
        specs: Whose road and traffic are shown.
        weathers: Under which they are replayed.
        output: Picture to write.
        agent: Whose camera; None is the ego.
        camera: Which of its cameras, from 0.
        frame: Kept frame; None is the one in the middle of each scenario.
        backend: That renders.
        profile: `preview` or `full`; the size of the pictures is the gallery's own.
        width_px: Of each picture.
        report: Told of every picture.

    Raises:
        InputError: There is no such agent, camera, frame or profile, or the sheet cannot be
            written.
    """
    if profile not in PROFILES:
        raise InputError(f"--profile {profile}: no such profile; preview or full")
    columns: list[list[Image]] = []
    looking = [_looking(spec, agent, camera) for spec in specs]
    for spec, viewer in zip(specs, looking, strict=True):
        stage = set_stage(spec)
        index = len(stage.trace) // 2 if frame is None else frame
        if index >= len(stage.trace):
            raise InputError(f"{spec.id} has frames 0 to {len(stage.trace) - 1}, not {index}")
        column = [_bar(spec.road.id, width_px)]
        for count, weather in enumerate(weathers):
            report(Progress(spec.id, "pictures", count, len(weathers)))
            other = under(spec, weather)
            scaled = PROFILES[profile].scaled(
                width_px * OVERSAMPLING / viewer.sensors.camera.width_px
            )
            taken = _taken(other, stage, viewer, camera, index, backend, scaled)
            column += [_bar(weather.declaration.id, width_px), taken]
        columns.append(column)
        report(Progress(spec.id, "done", len(weathers), len(weathers)))
    height = max(sum(len(cell) for cell in column) for column in columns)
    write_picture(np.hstack([_padded(np.vstack(column), height) for column in columns]), output)


def _looking(spec: Spec, name: str | None, camera: int) -> Agent:
    found = [agent for agent in spec.agents if _is_wanted(agent, name)]
    if not found:
        there = ", ".join(agent.id for agent in spec.agents)
        raise InputError(f"{spec.id} has no agent '{name}'; it has {there}")
    mounts = len(found[0].sensors.camera.mounts)
    if not 0 <= camera < mounts:
        raise InputError(f"{found[0].id} has cameras 0 to {mounts - 1}, not {camera}")
    return found[0]


def _is_wanted(agent: Agent, name: str | None) -> bool:
    if name is not None:
        return agent.id == name
    return isinstance(agent.place, Vehicle) and agent.place.role == "ego"


def _taken(
    spec: Spec,
    stage: Stage,
    agent: Agent,
    camera: int,
    index: int,
    backend: str,
    profile: Profile,
) -> Image:
    viewpoints = Viewpoints(spec, stage.trace)
    with senses(viewpoints, stage, load_backend(backend), profile) as sensed:
        image = sensed.look(agent, camera, index)
    size = (image.shape[1] // OVERSAMPLING, image.shape[0] // OVERSAMPLING)
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    return small[..., ::-1].astype(np.uint8)


def _bar(text: str, width_px: int) -> Image:
    bar = np.full((BAR_PX, width_px, 3), 32, np.uint8)
    place = (6, BAR_PX - 6)
    cv2.putText(bar, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.42, (235,) * 3, 1, cv2.LINE_AA)
    return bar


def _padded(column: Image, height: int) -> Image:
    return np.pad(column, ((0, height - len(column)), (0, 0), (0, 0)))
