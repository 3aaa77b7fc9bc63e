"""What encoding and writing cost against rendering, and against the encoder alone.

    python benchmarks/encode.py [compiled/ui_fog_day_sparse.json] [--rounds 7] [--profile full]

The same few frames are sensed without being written, and then with, again and again, so that the
load of the machine is the same for both. `processor time` is what a run would take longer if no
core had anything to spare; `wall` is what it did take longer, as files are made in the background
of rendering. The encoder alone is OpenCV with the same images and nothing else.
"""

import argparse
import statistics
import tempfile
import time
from collections.abc import Generator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import cv2
from measurement import Measurement, RunTime, format_table, measure_run_time

from advercity.compiler import read_spec
from advercity.dataset.cloud_files import encode_pcd
from advercity.dataset.writer import ScenarioWriter
from advercity.pipeline.preparation import PreparedScenario, load_or_simulate_traffic
from advercity.pipeline.scenario import open_background_writer
from advercity.pipeline.sensing import SensorRig, open_sensors
from advercity.rendering.backend import RENDER_PROFILES, load_backend
from advercity.run_options import CloudEncoding
from advercity.sensors.measurements import PointCloud

SPEC = Path("compiled/ui_fog_day_sparse.json")
FRAMES = range(1, 4)
GOAL = 0.15


def run_benchmark(
    *, quick: bool, spec: Path = SPEC, profile: str = "preview", rounds: int | None = None
) -> list[Measurement]:
    """Measure the files of some frames against sensing, and against the encoder alone."""
    count = rounds or (3 if quick else 7)
    with (
        tempfile.TemporaryDirectory() as folder,
        _open_scenario(spec, profile, Path(folder)) as (sensors, writer),
    ):
        _measure_frames(sensors, writer)
        pairs = [(_measure_frames(sensors), _measure_frames(sensors, writer)) for _ in range(count)]
        images = sorted(writer.scenario.rglob("*.png"))
        encoder_s = statistics.median(_measure_encoder_s(images) for _ in range(count))
        clouds = [one.point_cloud for frame in FRAMES for one in sensors.capture_frame(frame)]
        binary_s, binary_bytes = _measure_clouds(clouds, "binary", count)
        packed_s, packed_bytes = _measure_clouds(clouds, "binary_compressed", count)
    cpu = statistics.median(written.cpu_s / sensed.cpu_s for sensed, written in pairs)
    wall = statistics.median(written.wall_s / sensed.wall_s for sensed, written in pairs)
    own_s = statistics.median(written.cpu_s - sensed.cpu_s for sensed, written in pairs)
    return [
        Measurement("encode and write, processor time added", cpu - 1.0, "sensing frames", GOAL),
        Measurement("encode and write, wall added", wall - 1.0, "sensing frames"),
        Measurement("encode and write all files", own_s / encoder_s, "OpenCV, images alone"),
        Measurement("compressed clouds, size", packed_bytes / binary_bytes, "binary", at_most=0.6),
        Measurement(
            "compress clouds, processor time added",
            (packed_s - binary_s) / statistics.median(sensed.cpu_s for sensed, _ in pairs),
            "sensing frames",
        ),
    ]


@contextmanager
def _open_scenario(
    path: Path, profile_name: str, folder: Path
) -> Generator[tuple[SensorRig, ScenarioWriter]]:
    """Open the sensors and the writer of a scenario."""
    spec, backend, profile = read_spec(path), load_backend("sapien"), RENDER_PROFILES[profile_name]
    traffic = load_or_simulate_traffic(spec)
    frames = range(len(traffic.trace))
    prepared = PreparedScenario(spec, traffic, backend, profile, frames)
    with (
        ScenarioWriter(folder, spec, prepared.identity, length=len(frames)) as writer,
        open_sensors(prepared) as sensors,
    ):
        yield sensors, writer


def _measure_frames(sensors: SensorRig, writer: ScenarioWriter | None = None) -> RunTime:
    """Sense the frames as a run does, and write them if there is a writer."""

    def make_frames() -> None:
        with open_background_writer() as background:
            for frame in FRAMES:
                readings = sensors.capture_frame(frame)
                if writer is not None:
                    background.submit(partial(writer.write_frame, frame, readings))

    return measure_run_time(make_frames)


def _measure_encoder_s(images: list[Path]) -> float:
    """Measure the processor time of OpenCV's encoder, without reading the images."""
    total = 0.0
    for path in images:
        image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        assert image is not None
        started = time.process_time()
        cv2.imencode(".png", image)
        total += time.process_time() - started
    return total


def _measure_clouds(
    clouds: list[PointCloud], encoding: CloudEncoding, count: int
) -> tuple[float, int]:
    """Measure the processor time of encoding clouds, the least of `count`, and their bytes."""
    times: list[float] = []
    sizes: list[int] = []
    for _ in range(count):
        started = time.process_time()
        sizes = [len(encode_pcd(cloud, encoding=encoding)) for cloud in clouds]
        times.append(time.process_time() - started)
    return min(times), sum(sizes)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("spec", type=Path, nargs="?", default=SPEC)
    parser.add_argument("--profile", default="preview")
    parser.add_argument("--rounds", type=int, default=7)
    options = vars(parser.parse_args())
    print(format_table(run_benchmark(quick=False, **options)))


if __name__ == "__main__":
    main()
