"""Where the time of a frame goes, and what all of it takes against SAPIEN's own images.

    python benchmarks/frame.py [compiled/ui_fog_day_sparse.json] [--rounds 3] [--frames 6]
                               [--profile preview|full] [--scale F]

Each round makes the same frames as `advercity run` does - sensed, annotated, encoded, written -
and, before and after, renders as many images of the same scene with SAPIEN's own pack as the frame
has cameras. The ratio is that of wall times, medians of the rounds; the first frame of a run, which
builds the shaders, does not count. Stages overlap, so their wall times add up to more than the
frame's; the rest is the driver's, which renders in threads of its own. `--scale 1` shows what a
frame of full resolution takes in addition to rendering. A ray-traced frame has no peer here:
SAPIEN does not let its pack and ours be in one process then.
"""

import argparse
import statistics
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from advercity_dsl import Spec
from advercity_sapien.renderer import SapienRenderer
from benchmark_scene import BenchmarkScene
from measurement import Measurement, RunTime, Stopwatch, measure_run_time
from stock_renderer import StockRenderer

from advercity.dataset import cloud_files, image_codec, opv2v, partial_files
from advercity.dataset import writer as frame_writer
from advercity.pipeline import Progress, RunOptions, run_scenario
from advercity.rendering.backend import RENDER_PROFILES, RenderProfile, load_backend
from advercity.sensors.camera import driver as camera_driver
from advercity.sensors.lidar import driver as lidar_driver

SPEC = Path("compiled/ui_fog_day_sparse.json")
GOAL = 2.5
# Functions are named by strings, which renaming tools miss; a test finds those that are gone.
STAGES: dict[str, tuple[tuple[object, str], ...]] = {
    "placing actors": ((SapienRenderer, "place"),),
    "starting images": ((SapienRenderer, "_start_render"),),
    "waiting for images": ((SapienRenderer, "_fetch_images"),),
    "optics and electronics": ((camera_driver, "render_image"),),
    "pixels of every actor": ((camera_driver, "project_boxes"),),
    "LiDAR: rays": ((lidar_driver, "cast_scan"),),
    "LiDAR: weather, points": ((lidar_driver, "measure_point_cloud"),),
    "maps": ((opv2v, "draw_bird_views"),),
    "annotations": (
        (opv2v, "build_frame_description"),
        (opv2v, "build_object_extras"),
        (opv2v, "build_motion_document"),
    ),
    "documents as text": ((opv2v, "format_yaml"), (opv2v, "format_json")),
    "clouds as files": ((cloud_files, "encode_pcd"),),
    "images as PNG": ((image_codec, "_encode_png"),),
    "checksums": ((partial_files.FileRecord, "from_content"),),
    "disk": tuple(
        (frame_writer, name) for name in ("write_file", "move_file", "append_to_journal")
    ),
}


@dataclass(frozen=True)
class FrameTime:
    """Mean time of a frame, in all and by stage."""

    whole: RunTime
    stages: dict[str, RunTime]


def measure_frames(spec: Spec, profile: RenderProfile, frames: int) -> FrameTime:
    """Make frames of a scenario, the first of which does not count."""
    marks: list[tuple[float, float]] = []
    stopwatch = Stopwatch()

    def report(progress: Progress) -> None:
        if progress.done == 1:
            stopwatch.stages.clear()
        if progress.done == 1 or progress.phase == "done":
            marks.append((time.perf_counter(), time.process_time()))

    with tempfile.TemporaryDirectory() as folder, stopwatch.instrument(STAGES):
        options = RunOptions(
            Path(folder),
            profile="full" if profile.renderer == "ray_traced" else "preview",
            scale=profile.scale,
            frames=slice(0, frames + 1),
        )
        run_scenario(spec, options, report)
    (wall_s, cpu_s), (wall_end_s, cpu_end_s) = marks
    return FrameTime(
        RunTime((wall_end_s - wall_s) / frames, (cpu_end_s - cpu_s) / frames),
        {
            name: RunTime(stage.wall_s / frames, stage.cpu_s / frames)
            for name, stage in stopwatch.stages.items()
        },
    )


class StockPeer:
    """SAPIEN's own images from every camera of a scenario, and ours alone."""

    def __init__(self, spec_path: Path, profile: RenderProfile) -> None:
        self._scene, self._profile = BenchmarkScene(spec_path, 1), profile
        self._views = [
            view
            for agent in self._scene.spec.agents
            for view in self._scene.list_views(agent, profile)
        ]
        self._stock = StockRenderer(spec_path, 1, self._views)
        self._stock.measure()

    def measure_rounds(
        self, count: int, frames: int
    ) -> tuple[list[FrameTime], list[float], list[float]]:
        """Measure runs, their ratios to SAPIEN's images before and after, and those' seconds."""
        runs: list[FrameTime] = []
        stock_s = [self._stock.measure().wall_s]
        for _ in range(count):
            runs.append(measure_frames(self._scene.spec, self._profile, frames))
            stock_s.append(self._stock.measure().wall_s)
        around = zip(runs, stock_s, stock_s[1:], strict=False)
        ratios = [2.0 * run.whole.wall_s / (before + after) for run, before, after in around]
        return runs, ratios, stock_s

    def measure_own_s(self) -> float:
        """Measure the seconds of our images from every camera, without what is done to them."""
        scene = self._scene
        with load_backend("sapien").open(scene.world, scene.air, self._profile) as renderer:
            renderer.place(scene.frame)
            list(renderer.render_cameras(self._views))
            return measure_run_time(lambda: list(renderer.render_cameras(self._views))).wall_s


def run_benchmark(*, quick: bool) -> list[Measurement]:
    """Measure a preview frame, whole and by stage."""
    peer = StockPeer(SPEC, RENDER_PROFILES["preview"])
    runs, ratios, _ = peer.measure_rounds(*((2, 4) if quick else (5, 8)))
    whole_s = statistics.median(run.whole.cpu_s for run in runs)
    stages = [
        Measurement(
            f"of a frame's processor time: {name}",
            statistics.median(run.stages[name].cpu_s for run in runs) / whole_s,
            "the whole frame",
        )
        for name in STAGES
    ]
    ratio = statistics.median(ratios)
    return [Measurement("preview frame, wall", ratio, "SAPIEN's 20 images", GOAL), *stages]


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
    if profile.renderer == "ray_traced":
        spec = BenchmarkScene(arguments.spec, 1).spec
        runs = [measure_frames(spec, profile, arguments.frames) for _ in range(arguments.rounds)]
        _print_table(runs)
        return
    peer = StockPeer(arguments.spec, profile)
    runs, ratios, stock_s = peer.measure_rounds(arguments.rounds, arguments.frames)
    _print_table(runs)
    print(f"| its images alone | {peer.measure_own_s() * 1e3:.0f} | |")
    print(f"| SAPIEN's own images | {statistics.median(stock_s) * 1e3:.0f} | |")
    print(f"a frame against SAPIEN's own images: {statistics.median(ratios):.2f}")


def _print_table(runs: Sequence[FrameTime]) -> None:
    """Print the median of each stage, and the processor time that is in none."""
    whole = _median_time([run.whole for run in runs])
    stages = {name: _median_time([run.stages[name] for run in runs]) for name in STAGES}
    rest_s = whole.cpu_s - sum(stage.cpu_s for stage in stages.values())
    print("| stage | wall, ms | CPU, ms |\n|---|---|---|")
    for name, stage in stages.items():
        print(f"| {name} | {stage.wall_s * 1e3:.0f} | {stage.cpu_s * 1e3:.0f} |")
    print(f"| the driver, and the rest | | {rest_s * 1e3:.0f} |")
    print(f"| the whole frame | {whole.wall_s * 1e3:.0f} | {whole.cpu_s * 1e3:.0f} |")


def _median_time(times: Sequence[RunTime]) -> RunTime:
    wall_s, cpu_s = zip(*((time.wall_s, time.cpu_s) for time in times), strict=True)
    return RunTime(statistics.median(wall_s), statistics.median(cpu_s))


if __name__ == "__main__":
    main()
