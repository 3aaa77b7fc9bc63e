"""What a spec asks of a machine, whatever the machine.

How fast this machine is: measured once by a short run, and kept with what it was measured with.

Two runs of a few frames differ in the size of their pictures alone, and so tell what a pixel takes
from what all else takes. That is laid to the beams of the LiDARs, which most of it goes with.
"""

import math
import platform
import tempfile
import time
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path

from advercity_dsl import Model, Spec
from pydantic import Field

from advercity.compiler.crossing import compile_library
from advercity.compiler.library import find_shipped_library
from advercity.dataset.manifest import CODE_PACKAGES, VERSIONED_PACKAGES, Manifest
from advercity.digests import compute_json_digest, compute_source_digest
from advercity.pipeline.cache import build_cached, find_cache_folder
from advercity.pipeline.machine import count_usable_cores
from advercity.pipeline.messages import WorkerJob
from advercity.pipeline.options import ResourceLimits, RunOptions, ViewerTarget
from advercity.pipeline.preparation import load_or_simulate_traffic, resolve_profile
from advercity.pipeline.progress import Progress, ScenarioResult
from advercity.pipeline.workers import run_worker
from advercity.rendering.backend import RENDER_PROFILES, RenderProfile, load_backend


@dataclass(frozen=True)
class Workload:
    """Of one frame.

    Attributes:
        agents: Viewpoints.
        pictures: Of all cameras; each comes with its classes and depths.
        pixels: Of all those pictures.
        beams: Of all LiDARs.
    """

    agents: int
    pictures: int
    pixels: int
    beams: int

    @staticmethod
    def from_spec(spec: Spec, scale: float) -> "Workload":
        """Of a frame of `spec` with pictures at `scale` of their authored width and height."""
        cameras = [agent.sensors.camera for agent in spec.agents]
        lidars = [agent.sensors.lidar for agent in spec.agents]
        return Workload(
            agents=len(spec.agents),
            pictures=sum(len(camera.mounts) for camera in cameras),
            pixels=round(
                sum(
                    len(camera.mounts) * camera.width_px * camera.height_px * scale**2
                    for camera in cameras
                )
            ),
            beams=sum(lidar.channels * lidar.azimuths * lidar.sub_rays for lidar in lidars),
        )


CALIBRATION_SPEC_ID = "ri_fog_day_sparse"
"""Of the shipped library; fog gives LiDARs the most to report."""
CALIBRATION_FRAME_COUNT = 4
"""Of each run; the first does not count."""
IMAGE_FILE_KINDS = ("camera", "semantic", "depth")
"""In the names of files that grow with the number of pixels."""
MAX_CPU_SCALE = {"raster": 0.25, "ray_traced": 0.04}
"""Scales of pictures that a processor draws in seconds."""

MeasuredWith = dict[str, str | int | float | bool]


class MachineRates(Model):
    """What a machine takes; the defaults are those of two cores without a graphics card."""

    setup_s: float = 20.0
    """Until the first frame, traffic excluded."""
    s_per_beam: float = 3e-6
    """And frame; all that goes with viewpoints included."""
    s_per_pixel: float = 6e-7
    """And frame, of all pictures."""
    busy_cores: float = 1.2
    """While a scenario is made, in the mean."""
    memory_bytes: float = 900e6
    """Of a scenario without pictures."""
    memory_bytes_per_pixel: float = 60.0
    """On top, of all pictures of a frame."""
    bytes_per_beam: float = 30.0
    """Of point clouds."""
    bytes_per_agent: float = 200e3
    """Of files that hold neither points nor pictures."""
    bytes_per_pixel: tuple[tuple[float, float], ...] = ((0.05, 3.0), (0.25, 3.0))
    """Of pictures, with their scale: larger ones have more noise."""
    measured: MeasuredWith = Field(default_factory=MeasuredWith)
    """With what it was measured; empty if nobody has measured here."""

    def compute_image_bytes(self, scale: float) -> float:
        """Bytes of a pixel at some scale: straight in its logarithm, and never below what was seen.

        Args:
            scale: Of the authored width and height.
        """
        (small, of_small), (large, of_large) = self.bytes_per_pixel
        steps = max(0.0, math.log(scale / large)) / math.log(large / small)
        return max(of_small, of_large) + max(0.0, of_large - of_small) * steps


@dataclass(frozen=True)
class _CalibrationRun:
    """One run of the calibration."""

    scale: float
    workload: Workload
    setup_s: float
    frame_s: float
    outcome: ScenarioResult
    manifest: Manifest

    def size_bytes(self, *, pictures: bool, clouds: bool) -> float:
        """Of a frame's files of some kind."""
        sizes = [
            record.size
            for path, record in self.manifest.files.items()
            if record.frame is not None
            and _is_image_file(path) == pictures
            and path.endswith(".pcd") == clouds
        ]
        return sum(sizes) / len(self.manifest.frames)


def load_or_measure_rates(options: RunOptions, *, measure: bool) -> MachineRates:
    """What this machine takes with a backend and a profile, from the cache or measured now.

    Args:
        options: Whose backend, profile and scale are used.
        measure: Whether to measure if nobody has; else it is like two cores.

    Raises:
        RunError: The calibration fails.
    """
    profile = resolve_requested_profile(options)
    key = {
        "backend": options.backend,
        **asdict(profile),
        "code_sha256": compute_source_digest(*CODE_PACKAGES),
        **{name: version(name) for name in VERSIONED_PACKAGES},
        "machine": f"{platform.node()} {platform.machine()}",
        "cores": count_usable_cores(),
    }
    stored = find_cache_folder() / "calibrations" / f"{compute_json_digest(key)}.json"
    if not stored.is_file() and not measure:
        return MachineRates()
    build_cached(stored, lambda path: _measure_rates(path, options, profile, key))
    return MachineRates.model_validate_json(stored.read_bytes())


def resolve_requested_profile(options: RunOptions) -> RenderProfile:
    """The profile at its scale; only `auto` needs a look at the device."""
    if options.profile == "auto":
        return resolve_profile(options, load_backend(options.backend).capabilities())
    return RENDER_PROFILES[options.profile].with_scale(options.scale)


def _measure_rates(
    path: Path, options: RunOptions, profile: RenderProfile, known: MeasuredWith
) -> None:
    found = load_backend(options.backend).capabilities()
    top = profile.scale
    if not found.hardware:
        top = min(top, MAX_CPU_SCALE[profile.renderer])
    spec = next(
        spec for spec in compile_library(find_shipped_library()) if spec.id == CALIBRATION_SPEC_ID
    )
    with tempfile.TemporaryDirectory() as folder:
        small, large = (
            _run_calibration(spec, replace(options, output=Path(folder, str(scale)), scale=scale))
            for scale in (top / 4, top)
        )
    rates = _fit_rates(small, large, {**known, "device": found.device})
    path.write_text(rates.model_dump_json(indent=1), encoding="utf-8")


def _run_calibration(spec: Spec, options: RunOptions) -> _CalibrationRun:
    """One run, once the traffic is known."""
    load_or_simulate_traffic(spec)
    marks: list[float] = [time.monotonic()]

    def report(progress: Progress) -> None:
        if progress.phase == "done" or progress.done == 1:
            marks.append(time.monotonic())

    quick = replace(
        options,
        frames=slice(0, CALIBRATION_FRAME_COUNT),
        viewer=ViewerTarget(),
        format="opv2v",
    )
    outcome = run_worker(WorkerJob(spec, quick), ResourceLimits(), report)
    if outcome.error is not None:
        raise outcome.error
    begin, first, end = marks
    frame_s = (end - first) / (CALIBRATION_FRAME_COUNT - 1)
    return _CalibrationRun(
        scale=float(options.scale or 1),
        workload=Workload.from_spec(spec, float(options.scale or 1)),
        setup_s=max(0.0, first - begin - frame_s),
        frame_s=frame_s,
        outcome=outcome,
        manifest=Manifest.load(quick.output / spec.id),
    )


def _fit_rates(small: _CalibrationRun, large: _CalibrationRun, known: MeasuredWith) -> MachineRates:
    more_pixels = large.workload.pixels - small.workload.pixels
    s_per_pixel = max(0.0, large.frame_s - small.frame_s) / more_pixels
    more_memory = large.outcome.peak_memory_bytes - small.outcome.peak_memory_bytes
    memory_per_pixel = max(0.0, more_memory / more_pixels)
    work = large.workload
    return MachineRates(
        setup_s=max(small.setup_s, large.setup_s),
        s_per_beam=max(0.0, large.frame_s - s_per_pixel * work.pixels) / work.beams,
        s_per_pixel=s_per_pixel,
        busy_cores=large.outcome.cpu_s / large.outcome.time_s,
        memory_bytes=large.outcome.peak_memory_bytes - memory_per_pixel * work.pixels,
        memory_bytes_per_pixel=memory_per_pixel,
        bytes_per_beam=large.size_bytes(pictures=False, clouds=True) / work.beams,
        bytes_per_agent=large.size_bytes(pictures=False, clouds=False) / work.agents,
        bytes_per_pixel=tuple(
            (run.scale, run.size_bytes(pictures=True, clouds=False) / run.workload.pixels)
            for run in (small, large)
        ),
        measured=known,
    )


def _is_image_file(path: str) -> bool:
    return path.endswith(".png") and any(kind in path for kind in IMAGE_FILE_KINDS)
