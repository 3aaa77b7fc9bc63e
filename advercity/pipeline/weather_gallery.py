"""One camera of every scenario under every weather, on one sheet."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from advercity_dsl import Agent, Spec, Weather

from advercity.compiler import with_weather
from advercity.compiler.library import LibraryEntry
from advercity.errors import InputError
from advercity.geometry.arrays import Uint8Array
from advercity.media import write_image
from advercity.pipeline.agent_poses import AgentPoses
from advercity.pipeline.options import Progress, ProgressCallback, ignore_progress
from advercity.pipeline.preparation import TrafficResult, load_or_simulate_traffic
from advercity.pipeline.sensing import open_sensors
from advercity.rendering.backend import RENDER_PROFILES, RenderProfile, load_backend

WIDTH_PX = 384
"""Of a picture, where nobody asks for another."""
OVERSAMPLING = 2
"""Pictures are taken this many times larger and averaged."""
BAR_PX = 20


def write_weather_gallery(
    specs: Sequence[Spec],
    weathers: Sequence[LibraryEntry[Weather]],
    output: Path,
    *,
    agent: str | None = None,
    camera: int = 0,
    frame: int | None = None,
    backend: str = "sapien",
    profile: str = "preview",
    width_px: int = WIDTH_PX,
    report: ProgressCallback = ignore_progress,
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
    if profile not in RENDER_PROFILES:
        raise InputError(f"--profile {profile}: no such profile; preview or full")
    columns: list[list[Uint8Array]] = []
    looking = [_find_agent(spec, agent, camera) for spec in specs]
    for spec, viewer in zip(specs, looking, strict=True):
        stage = load_or_simulate_traffic(spec)
        index = len(stage.trace) // 2 if frame is None else frame
        if index >= len(stage.trace):
            raise InputError(f"{spec.id} has frames 0 to {len(stage.trace) - 1}, not {index}")
        column = [_draw_bar(spec.road.id, width_px)]
        for count, weather in enumerate(weathers):
            report(Progress(spec.id, "pictures", count, len(weathers)))
            other = with_weather(spec, weather)
            scaled = RENDER_PROFILES[profile].with_scale(
                width_px * OVERSAMPLING / viewer.sensors.camera.width_px
            )
            taken = _render_picture(other, stage, viewer, camera, index, backend, scaled)
            column += [_draw_bar(weather.declaration.id, width_px), taken]
        columns.append(column)
        report(Progress(spec.id, "done", len(weathers), len(weathers)))
    height = max(sum(len(cell) for cell in column) for column in columns)
    write_image(np.hstack([_pad_column(np.vstack(column), height) for column in columns]), output)


def _find_agent(spec: Spec, name: str | None, camera: int) -> Agent:
    found = [agent for agent in spec.agents if _is_requested_agent(agent, name)]
    if not found:
        there = ", ".join(agent.id for agent in spec.agents)
        raise InputError(f"{spec.id} has no agent '{name}'; it has {there}")
    mounts = len(found[0].sensors.camera.mounts)
    if not 0 <= camera < mounts:
        raise InputError(f"{found[0].id} has cameras 0 to {mounts - 1}, not {camera}")
    return found[0]


def _is_requested_agent(agent: Agent, name: str | None) -> bool:
    if name is not None:
        return agent.id == name
    return agent.is_ego


def _render_picture(
    spec: Spec,
    stage: TrafficResult,
    agent: Agent,
    camera: int,
    index: int,
    backend: str,
    profile: RenderProfile,
) -> Uint8Array:
    viewpoints = AgentPoses(spec, stage.trace)
    with open_sensors(viewpoints, stage, load_backend(backend), profile) as sensed:
        image = sensed.capture_image(agent, camera, index)
    size = (image.shape[1] // OVERSAMPLING, image.shape[0] // OVERSAMPLING)
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    return small[..., ::-1].astype(np.uint8)


def _draw_bar(text: str, width_px: int) -> Uint8Array:
    bar = np.full((BAR_PX, width_px, 3), 32, np.uint8)
    place = (6, BAR_PX - 6)
    cv2.putText(bar, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.42, (235,) * 3, 1, cv2.LINE_AA)
    return bar


def _pad_column(column: Uint8Array, height: int) -> Uint8Array:
    return np.pad(column, ((0, height - len(column)), (0, 0), (0, 0)))
