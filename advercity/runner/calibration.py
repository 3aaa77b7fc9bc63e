"""How fast this machine is: measured once by a short run, and kept with what it was measured with.

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

from advercity.compiler import compile_library
from advercity.compiler.library import digest_of
from advercity.compiler.shipped import shipped_library
from advercity.dataset.manifest import CODE, PACKAGES, Manifest
from advercity.rendering.backend import PROFILES, Profile
from advercity.rendering.registry import load_backend
from advercity.runner.cache import cache_folder, kept
from advercity.runner.job import Job
from advercity.runner.limits import Limits
from advercity.runner.machine import cores
from advercity.runner.options import FrameRange, Options, ViewerTarget
from advercity.runner.preparation import choose_profile
from advercity.runner.progress import Progress
from advercity.runner.stage import set_stage
from advercity.runner.supervision import Outcome, supervise
from advercity.runner.workload import Workload
from advercity.sources import source_digest

SPEC = "ri_fog_day_sparse"
"""Of the shipped library; fog gives LiDARs the most to report."""
FRAMES = 4
"""Of each run; the first does not count."""
PICTURES = ("camera", "semantic", "depth")
"""In the names of files that grow with the number of pixels."""
LARGEST_ON_CPU = {"raster": 0.25, "ray_traced": 0.04}
"""Scales of pictures that a processor draws in seconds."""

Known = dict[str, str | int | float | bool]


class Rates(Model):
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
    measured: Known = Field(default_factory=Known)
    """With what it was measured; empty if nobody has measured here."""

    def picture_bytes(self, scale: float) -> float:
        """Bytes of a pixel at some scale: straight in its logarithm, and never below what was seen.

        Args:
            scale: Of the authored width and height.
        """
        (small, of_small), (large, of_large) = self.bytes_per_pixel
        steps = max(0.0, math.log(scale / large)) / math.log(large / small)
        return max(of_small, of_large) + max(0.0, of_large - of_small) * steps


@dataclass(frozen=True)
class _Measured:
    """One run of the calibration."""

    scale: float
    workload: Workload
    setup_s: float
    frame_s: float
    outcome: Outcome
    manifest: Manifest

    def size_bytes(self, *, pictures: bool, clouds: bool) -> float:
        """Of a frame's files of some kind."""
        sizes = [
            record.size
            for path, record in self.manifest.files.items()
            if record.frame is not None
            and _is_picture(path) == pictures
            and path.endswith(".pcd") == clouds
        ]
        return sum(sizes) / len(self.manifest.frames)


def rates_here(options: Options, *, measure: bool) -> Rates:
    """What this machine takes with a backend and a profile, from the cache or measured now.

    Args:
        options: Whose backend, profile and scale are used.
        measure: Whether to measure if nobody has; else it is like two cores.

    Raises:
        RunError: The calibration fails.
    """
    profile = profile_asked_for(options)
    key = {
        "backend": options.backend,
        **asdict(profile),
        "code_sha256": source_digest(*CODE),
        **{name: version(name) for name in PACKAGES},
        "machine": f"{platform.node()} {platform.machine()}",
        "cores": cores(),
    }
    stored = cache_folder() / "calibrations" / f"{digest_of(key)}.json"
    if not stored.is_file() and not measure:
        return Rates()
    kept(stored, lambda path: _measure_to(path, options, profile, key))
    return Rates.model_validate_json(stored.read_bytes())


def profile_asked_for(options: Options) -> Profile:
    """The profile at its scale; only `auto` needs a look at the device."""
    if options.profile == "auto":
        return choose_profile(options, load_backend(options.backend).capabilities())
    return PROFILES[options.profile].scaled(options.scale)


def _measure_to(path: Path, options: Options, profile: Profile, known: Known) -> None:
    found = load_backend(options.backend).capabilities()
    top = profile.scale
    if not found.hardware:
        top = min(top, LARGEST_ON_CPU[profile.renderer])
    spec = next(spec for spec in compile_library(shipped_library()) if spec.id == SPEC)
    with tempfile.TemporaryDirectory() as folder:
        small, large = (
            _measure(spec, replace(options, output=Path(folder, str(scale)), scale=scale))
            for scale in (top / 4, top)
        )
    rates = _rates(small, large, {**known, "device": found.device})
    path.write_text(rates.model_dump_json(indent=1), encoding="utf-8")


def _measure(spec: Spec, options: Options) -> _Measured:
    """One run, once the traffic is known."""
    set_stage(spec)
    marks: list[float] = [time.monotonic()]

    def report(progress: Progress) -> None:
        if progress.stage == "done" or progress.done == 1:
            marks.append(time.monotonic())

    quick = replace(options, frames=FrameRange(0, FRAMES), viewer=ViewerTarget(), format="opv2v")
    outcome = supervise(Job(spec, quick), Limits(), report)
    if outcome.error is not None:
        raise outcome.error
    begin, first, end = marks
    frame_s = (end - first) / (FRAMES - 1)
    return _Measured(
        scale=float(options.scale or 1),
        workload=Workload.of(spec, float(options.scale or 1)),
        setup_s=max(0.0, first - begin - frame_s),
        frame_s=frame_s,
        outcome=outcome,
        manifest=Manifest.load(quick.output / spec.id),
    )


def _rates(small: _Measured, large: _Measured, known: Known) -> Rates:
    more_pixels = large.workload.pixels - small.workload.pixels
    s_per_pixel = max(0.0, large.frame_s - small.frame_s) / more_pixels
    more_memory = large.outcome.peak_memory_bytes - small.outcome.peak_memory_bytes
    memory_per_pixel = max(0.0, more_memory / more_pixels)
    work = large.workload
    return Rates(
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


def _is_picture(path: str) -> bool:
    return path.endswith(".png") and any(kind in path for kind in PICTURES)
