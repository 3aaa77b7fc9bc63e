"""Records time, files and memory of scenarios on this machine, for later estimates.

Each successful scenario adds a line to `runs.jsonl` in the cache. Times and memory are not in
manifests, since manifests must be the same on every machine.
"""

import math
import platform
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from advercity_dsl import Model, Spec
from advercity_dsl.sensor_kinds import load_sensor_kinds
from pydantic import Field, ValidationError

from advercity.atomic_files import write_atomically
from advercity.dataset.manifest import Manifest
from advercity.documents import MAX_YAML_BYTES, parse_json, read_bytes, read_text
from advercity.errors import AdvercityError, InputError
from advercity.pipeline.cache import find_cache_folder
from advercity.pipeline.machine import count_usable_cores
from advercity.pipeline.progress import ScenarioResult
from advercity.run_options import RunOptions
from advercity.sensors.camera_model import CameraModel

RECORDS_FILE = "runs.jsonl"
MAX_RECORDS = 50


@dataclass(frozen=True)
class FrameWork:
    """Work of one frame of a spec, independent of the machine.

    Attributes:
        agents: Number of agents.
        images: Images of all cameras; each comes with its classes and depths.
        pixels: Rendered pixels of all images.
        beams: Rays of all sensors: beams of LiDARs, rays of radars and thermal cameras.
        renders: How often each pixel is rendered, on average: more than once with rolling shutters.
    """

    agents: int
    images: int
    pixels: int
    beams: int
    renders: float = 1.0

    @staticmethod
    def from_spec(spec: Spec, scale: float) -> "FrameWork":
        """Count the work of a frame with images at `scale` of their authored width and height."""
        cameras = [item.model for agent in spec.recorded_agents for item in agent.sensors.cameras]
        sizes = [
            CameraModel.build(camera, camera.width_px, camera.height_px).rendered_size
            for camera in cameras
        ]
        pixels = [math.prod(size) for size in sizes]
        renders = [camera.renders for camera in cameras]
        rays = (
            sensor.model.count_rays(scale)
            for agent in spec.recorded_agents
            for kind in load_sensor_kinds().found
            for sensor in agent.sensors.list_sensors(kind)
        )
        return FrameWork(
            agents=len(spec.recorded_agents),
            images=len(cameras),
            pixels=max(1, round(sum(pixels) * scale**2)),
            beams=max(1, sum(rays)),
            renders=sum(map(math.prod, zip(pixels, renders, strict=True))) / max(1, sum(pixels))
            or 1.0,
        )


class RunRecord(Model):
    """Time, files and memory of a scenario; values beyond any machine are invalid.

    Attributes:
        machine: Name and cores of the machine.
        backend: Name of the rendering backend.
        renderer: `raster` or `ray_traced`.
        format: Dataset layout.
        pixels, beams, renders: Work of a frame, as in `FrameWork`.
        setup_s: Wall-clock time until the first frame is begun.
        frame_s: Wall-clock time per frame of a worker with a core to itself.
        frame_bytes: Files of a frame.
        memory_bytes: Peak of resident memory per worker.
    """

    machine: str
    backend: str
    renderer: str
    format: str
    pixels: Annotated[int, Field(ge=1)]
    beams: Annotated[int, Field(ge=1)]
    renders: Annotated[float, Field(ge=1)] = 1.0
    setup_s: Annotated[float, Field(ge=0, le=3600)]
    frame_s: Annotated[float, Field(ge=0, le=3600)]
    frame_bytes: Annotated[float, Field(ge=0, le=1e11)]
    memory_bytes: Annotated[float, Field(ge=0, le=1e12)]


def describe_machine() -> str:
    """Describe this machine, to tell its records from others' in a shared cache."""
    return f"{platform.node()} {platform.machine()} {count_usable_cores()}"


def record_run(spec: Spec, options: RunOptions, result: ScenarioResult, worker_count: int) -> None:
    """Record a successful scenario; errors are ignored.

    Args:
        spec: The scenario.
        options: How it was run.
        result: Its result.
        worker_count: Workers of the whole pool; those beyond the cores slow one another.
    """
    if result.error is not None or result.frame_s is None:
        return
    with suppress(AdvercityError, OSError, ValidationError):
        manifest = Manifest.load(options.folder / spec.id)
        renderer = manifest.identity.renderer
        work = FrameWork.from_spec(spec, float(renderer["scale"]))
        record = RunRecord(
            machine=describe_machine(),
            backend=options.backend,
            renderer=str(renderer["renderer"]),
            format=options.format,
            pixels=work.pixels,
            beams=work.beams,
            renders=work.renders,
            setup_s=result.setup_s,
            frame_s=result.frame_s * min(1.0, count_usable_cores() / worker_count),
            frame_bytes=manifest.size_bytes / len(manifest.frames),
            memory_bytes=result.peak_memory_bytes / result.worker_count,
        )
        _append(record)


def _append(record: RunRecord) -> None:
    """Add a line and drop the oldest records; keep other lines, and leave a link alone."""
    # Two runs ending at once may lose one of their lines, which does no harm.
    path = find_cache_folder() / RECORDS_FILE
    if path.is_symlink():
        return
    lines = read_bytes(path, max_bytes=MAX_YAML_BYTES).splitlines() if path.exists() else []
    records = [number for number, line in enumerate(lines) if _parse_record(line) is not None]
    oldest = records[: max(0, len(records) + 1 - MAX_RECORDS)]
    kept = [line for number, line in enumerate(lines) if number not in oldest]
    write_atomically(path, b"\n".join([*kept, record.model_dump_json().encode(), b""]))


def _parse_record(line: bytes | str) -> RunRecord | None:
    """Parse a line of the file; None if it is not a record of this version."""
    with suppress(InputError, ValidationError):
        return RunRecord.model_validate(parse_json(line, Path(RECORDS_FILE)))
    return None


def load_records(*, backend: str, renderer: str, format: str) -> list[RunRecord]:
    """Load the records of this machine with a backend, a renderer and a layout."""
    records: list[RunRecord] = []
    with suppress(InputError):
        lines = read_text(find_cache_folder() / RECORDS_FILE).splitlines()
        records = [record for record in map(_parse_record, lines) if record is not None]
    wanted = (describe_machine(), backend, renderer, format)
    return [
        record
        for record in records
        if (record.machine, record.backend, record.renderer, record.format) == wanted
    ]
