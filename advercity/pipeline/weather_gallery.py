"""Draws one camera of several scenarios under every weather into one image."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from advercity_dsl import Agent, Spec, Weather

from advercity.compiler import with_weather
from advercity.compiler.library import LibraryEntry
from advercity.errors import InputError
from advercity.geometry.arrays import Uint8Array
from advercity.media import check_image_file, draw_label_bar, write_image
from advercity.pipeline.preparation import PreparedScenario, load_or_simulate_traffic
from advercity.pipeline.progress import Progress, ProgressCallback, ignore_progress
from advercity.pipeline.sensing import find_agent_with_camera, open_sensors
from advercity.pipeline.spec_models import check_models, find_missing_models
from advercity.rendering.backend import RENDER_PROFILES, load_backend

WIDTH_PX = 384
"""Default width of each image."""
OVERSAMPLING = 2
"""Images are rendered this many times larger in width and height, and averaged."""


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
    allow_missing_models: bool = False,
    report: ProgressCallback = ignore_progress,
) -> None:
    """Write an image with a row per weather and a column per scenario.

    Args:
        specs: Scenarios to show.
        weathers: Weathers to replay their traffic under.
        output: Image file to write.
        agent: Agent with the camera; None is the ego.
        camera: Index of the camera, from 0.
        frame: Recorded frame; None is the middle one of each scenario.
        backend: Name of the rendering backend.
        profile: `preview` or `full`; `width_px` sets the image size.
        width_px: Width of each image.
        allow_missing_models: Generate bodies in place of missing models.
        report: Called before each image.

    Raises:
        InputError: There is no such agent, camera, frame or profile, or the sheet cannot be
            written, or models are missing.
    """
    if profile not in RENDER_PROFILES:
        raise InputError(f"`profile` {profile}: no such profile; preview or full")
    check_image_file(output)
    check_models(specs, allow_missing=allow_missing_models)
    renderer = load_backend(backend)
    agents = [find_agent_with_camera(spec, agent, camera) for spec in specs]
    columns: list[list[Uint8Array]] = []
    for spec, carrier in zip(specs, agents, strict=True):
        traffic = load_or_simulate_traffic(spec)
        frame_count = len(traffic.trace)
        index = frame_count // 2 if frame is None else frame
        if index >= frame_count:
            raise InputError(f"{spec.id} has frames 0 to {frame_count - 1}, not {index}")
        scale = width_px * OVERSAMPLING / carrier.sensors.cameras[camera].model.width_px
        prepared = PreparedScenario(
            spec,
            traffic,
            renderer,
            RENDER_PROFILES[profile].with_scale(scale),
            frames=range(index, index + 1),
            missing_models=find_missing_models(spec),
        )
        column = [draw_label_bar(spec.road.id, width_px)]
        for count, weather in enumerate(weathers):
            report(Progress(spec.id, "images", count, len(weathers)))
            replayed = replace(prepared, spec=with_weather(spec, weather))
            image = _render_image(replayed, carrier, camera, index)
            column += [draw_label_bar(weather.declaration.id, width_px), image]
        columns.append(column)
        report(Progress(spec.id, "done", len(weathers), len(weathers)))
    height = max(sum(len(cell) for cell in column) for column in columns)
    write_image(np.hstack([_pad_column(np.vstack(column), height) for column in columns]), output)


def _render_image(prepared: PreparedScenario, agent: Agent, camera: int, index: int) -> Uint8Array:
    """Render one camera oversampled and average it down, as BGR (h, w, 3)."""
    with open_sensors(prepared) as sensors:
        image = sensors.capture_image(agent, camera, index)
    size = (image.shape[1] // OVERSAMPLING, image.shape[0] // OVERSAMPLING)
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    return small[..., ::-1].astype(np.uint8)


def _pad_column(column: Uint8Array, height: int) -> Uint8Array:
    return np.pad(column, ((0, height - len(column)), (0, 0), (0, 0)))
