"""Where the time of a frame goes, and what all of it takes against SAPIEN's own pictures.

    python benchmarks/frame.py [compiled/ui_fog_day_sparse.json] [--rounds 3] [--frames 6]
                               [--profile preview|full] [--scale F]

Each round makes the same frames as `advercity run` does - sensed, annotated, encoded, written -
and, before and after, takes as many pictures of the same scene with SAPIEN's own pack as the
frame has cameras. The ratio is that of the walls, medians of the rounds; the first frame of a run,
which builds the shaders, does not count. Stages overlap, so their walls add up to more than the
frame's; what is no stage's own is the driver's, which draws in threads of its own. `--scale 1`
tells what a frame of full resolution takes besides its rendering, whatever renders it. A frame that
is traced has no peer here: SAPIEN does not let its pack and ours be in one process then.
"""

import argparse
import statistics
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest.mock import patch

from advercity_dsl import Spec
from advercity_sapien.renderer import SapienRenderer
from camera import stock_pictures
from measurement import Figure

from advercity.compiler import read_spec
from advercity.dataset import cloud_files, opv2v, partial_files
from advercity.dataset import image_codec as png
from advercity.dataset import writer as frame_writer
from advercity.physics.atmosphere import compute_atmosphere
from advercity.pipeline import Progress, RunOptions, run_scenario, sensing
from advercity.pipeline.agent_poses import AgentPoses
from advercity.pipeline.preparation import load_or_build_world, load_or_simulate_traffic
from advercity.rendering.backend import RENDER_PROFILES, CameraView, RenderProfile, load_backend

SPEC = Path("compiled/ui_fog_day_sparse.json")
GOAL = 2.5
STAGES: dict[str, tuple[tuple[Any, str], ...]] = {
    "placing actors": ((SapienRenderer, "place"),),
    "asking for pictures": ((SapienRenderer, "_start_render"),),
    "waiting for pictures": ((SapienRenderer, "_fetch_images"),),
    "optics and electronics": ((sensing, "render_image"),),
    "pixels of every actor": ((sensing, "project_boxes"),),
    "LiDAR: rays": ((sensing, "cast_scan"),),
    "LiDAR: weather, points": ((sensing, "measure_point_cloud"),),
    "maps": ((opv2v, "draw_bird_views"),),
    "annotations": (
        (opv2v, "build_frame_description"),
        (opv2v, "build_object_extras"),
        (opv2v, "build_motion_document"),
    ),
    "documents as text": ((opv2v, "format_yaml"), (opv2v, "format_json")),
    "clouds as files": ((cloud_files, "encode_pcd"),),
    "pictures as PNG": ((png, "_encode_png"),),
    "checksums": ((partial_files.FileRecord, "from_content"),),
    "disk": tuple(
        (frame_writer, name) for name in ("write_file", "move_file", "append_to_journal")
    ),
}


@dataclass
class Stage:
    """What a stage has taken in all threads, seconds."""

    wall_s: float = 0.0
    cpu_s: float = 0.0


@dataclass
class Stopwatch:
    """Adds up what calls take, thread by thread."""

    stages: defaultdict[str, Stage] = field(default_factory=lambda: defaultdict(Stage))
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def timing(self, stage: str, call: Callable[..., Any]) -> Callable[..., Any]:
        """The same call, timed."""

        def timed(*arguments: Any, **more: Any) -> Any:
            wall, cpu = time.perf_counter(), time.thread_time()
            result = call(*arguments, **more)
            wall, cpu = time.perf_counter() - wall, time.thread_time() - cpu
            with self._lock:
                self.stages[stage].wall_s += wall
                self.stages[stage].cpu_s += cpu
            return result

        return timed

    @contextmanager
    def running(self) -> Generator[None]:
        """Time every stage."""
        with ExitStack() as stack:
            for stage, calls in STAGES.items():
                for owner, name in calls:
                    timed = self.timing(stage, getattr(owner, name))
                    stack.enter_context(patch.object(owner, name, timed))
            yield


@dataclass(frozen=True)
class Pace:
    """What a frame took in the mean."""

    wall_s: float
    cpu_s: float
    stages: dict[str, Stage]


def pace(spec: Spec, profile: RenderProfile, frames: int) -> Pace:
    """Make frames of a scenario, the first of which does not count."""
    marks: list[tuple[float, float]] = []
    stopwatch = Stopwatch()

    def report(progress: Progress) -> None:
        if progress.done == 1 or progress.phase == "done":
            stopwatch.stages.clear() if progress.done == 1 else None
            marks.append((time.perf_counter(), time.process_time()))

    with tempfile.TemporaryDirectory() as folder, stopwatch.running():
        options = RunOptions(
            Path(folder),
            profile=profile.name,
            scale=profile.scale,
            frames=slice(0, frames + 1),
        )
        run_scenario(spec, options, report)
    (wall, cpu), (wall_end, cpu_end) = marks
    return Pace(
        (wall_end - wall) / frames,
        (cpu_end - cpu) / frames,
        {
            name: Stage(stage.wall_s / frames, stage.cpu_s / frames)
            for name, stage in stopwatch.stages.items()
        },
    )


class Peer:
    """SAPIEN's own pictures from every camera of a scenario, and ours of them alone."""

    def __init__(self, spec: Spec, profile: RenderProfile) -> None:
        self._spec, self._profile = spec, profile
        stage = load_or_simulate_traffic(spec)
        viewpoints = AgentPoses(spec, stage.trace)
        self._frame = viewpoints.load_frame(1)
        self._world = load_or_build_world(spec, stage.network_path)
        self._air = compute_atmosphere(spec.weather, spec.road.land_use)
        self._views = list(_views(viewpoints, profile))
        self._take = stock_pictures(self._world, self._air, self._frame, self._views)
        self._take()

    def rounds(self, count: int, frames: int) -> tuple[list[Pace], list[float], list[float]]:
        """Paces of runs, their ratios to SAPIEN's pictures before and after, and those' seconds."""
        paces: list[Pace] = []
        stock = [self.seconds()]
        for _ in range(count):
            paces.append(pace(self._spec, self._profile, frames))
            stock.append(self.seconds())
        around = zip(paces, stock, stock[1:], strict=False)
        return paces, [2.0 * one.wall_s / (ahead + after) for one, ahead, after in around], stock

    def seconds(self) -> float:
        """Of a picture from every camera."""
        began = time.perf_counter()
        self._take()
        return time.perf_counter() - began

    def ours(self) -> float:
        """Seconds of our pictures from every camera, without all that is done to them."""
        with load_backend("sapien").open(self._world, self._air, self._profile) as renderer:
            renderer.place(self._frame)
            for _ in renderer.render_cameras(self._views):
                pass
            began = time.perf_counter()
            for _ in renderer.render_cameras(self._views):
                pass
            return time.perf_counter() - began


def _views(viewpoints: AgentPoses, profile: RenderProfile) -> Iterator[CameraView]:
    for agent in viewpoints.spec.agents:
        for world_from_camera in viewpoints.world_from_cameras(agent, 1):
            yield sensing.build_camera_view(agent, world_from_camera, profile)


def figures(*, quick: bool) -> list[Figure]:
    """A preview frame, whole and by stage."""
    peer = Peer(read_spec(SPEC), RENDER_PROFILES["preview"])
    rounds, frames = (2, 4) if quick else (5, 8)
    paces, ratios, _ = peer.rounds(rounds, frames)
    whole_s = statistics.median(pace.cpu_s for pace in paces)
    stages = [
        Figure(
            f"of a frame's processor time: {name}",
            statistics.median(pace.stages[name].cpu_s for pace in paces) / whole_s,
            "the whole frame",
        )
        for name in STAGES
    ]
    return [
        Figure("preview frame, wall", statistics.median(ratios), "SAPIEN's 20 pictures", GOAL),
        *stages,
    ]


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("spec", type=Path, nargs="?", default=SPEC)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--frames", type=int, default=6)
    parser.add_argument("--profile", choices=sorted(RENDER_PROFILES), default="preview")
    parser.add_argument("--scale", type=float)
    arguments = parser.parse_args()
    profile = RENDER_PROFILES[arguments.profile].with_scale(arguments.scale)
    spec = read_spec(arguments.spec)
    if profile.renderer == "ray_traced":
        _print([pace(spec, profile, arguments.frames) for _ in range(arguments.rounds)])
        return
    peer = Peer(spec, profile)
    paces, ratios, stock = peer.rounds(arguments.rounds, arguments.frames)
    _print(paces)
    print(f"| its pictures alone | {peer.ours() * 1e3:.0f} | |")
    print(f"| SAPIEN's own pictures | {statistics.median(stock) * 1e3:.0f} | |")
    print(f"a frame against SAPIEN's own pictures: {statistics.median(ratios):.2f}")


def _print(paces: list[Pace]) -> None:
    wall_s, cpu_s = (
        statistics.median(getattr(pace, name) for pace in paces) for name in ("wall_s", "cpu_s")
    )
    print("| stage | wall, ms | CPU, ms |\n|---|---|---|")
    own_s = 0.0
    for name in STAGES:
        wall, cpu = (
            statistics.median(getattr(pace.stages[name], part) for pace in paces)
            for part in ("wall_s", "cpu_s")
        )
        own_s += cpu
        print(f"| {name} | {wall * 1e3:.0f} | {cpu * 1e3:.0f} |")
    print(f"| the driver, and what is left | | {(cpu_s - own_s) * 1e3:.0f} |")
    print(f"| the whole frame | {wall_s * 1e3:.0f} | {cpu_s * 1e3:.0f} |")


if __name__ == "__main__":
    main()
