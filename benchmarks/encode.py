"""What encoding and writing cost against rendering, and against the encoder alone.

    python benchmarks/encode.py [compiled/ui_fog_day_sparse.json] [--rounds 7] [--profile full]

The same few frames are sensed without being written, and then with, again and again, so that the
load of the machine is the same for both. `processor time` is what a run takes more of: what it
would take longer if no core had anything to spare. `wall` is what it did take longer, files being
made behind rendering. The encoder alone is OpenCV with the same pictures and nothing else.
"""

import argparse
import statistics
import tempfile
import time
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
from measurement import Figure, table

from advercity.compiler import read_spec
from advercity.dataset.writer import ScenarioWriter
from advercity.pipeline.preparation import PreparedScenario, load_or_simulate_traffic
from advercity.pipeline.scenario import BackgroundWriter
from advercity.pipeline.sensing import SensorRig, open_sensors
from advercity.rendering.backend import RENDER_PROFILES, load_backend

SPEC = Path("compiled/ui_fog_day_sparse.json")
FRAMES = range(1, 4)
GOAL = 0.15


@dataclass(frozen=True)
class Cost:
    """Seconds that something took."""

    wall: float
    cpu: float


def figures(
    *, quick: bool, spec: Path = SPEC, profile: str = "preview", rounds: int | None = None
) -> list[Figure]:
    """What the files of frames take, three ways."""
    count = rounds or (3 if quick else 7)
    with tempfile.TemporaryDirectory() as folder, _opened(spec, profile, Path(folder)) as opened:
        sensed, writer = opened
        _make(sensed, writer)
        pairs = [(_make(sensed), _make(sensed, writer)) for _ in range(count)]
        pictures = sorted(writer.scenario.rglob("*.png"))
        bare_s = statistics.median(_encoder_s(pictures) for _ in range(count))
    cpu = statistics.median(made.cpu / seen.cpu for seen, made in pairs)
    wall = statistics.median(made.wall / seen.wall for seen, made in pairs)
    own_s = statistics.median(made.cpu - seen.cpu for seen, made in pairs)
    return [
        Figure("encode and write, processor time added", cpu - 1.0, "sensing frames", GOAL),
        Figure("encode and write, wall added", wall - 1.0, "sensing frames"),
        Figure("encode and write all files", own_s / bare_s, "OpenCV with their pictures alone"),
    ]


@contextmanager
def _opened(
    path: Path, profile_name: str, folder: Path
) -> Generator[tuple[SensorRig, ScenarioWriter]]:
    """The sensors and the writer of a scenario."""
    spec, backend, profile = read_spec(path), load_backend("sapien"), RENDER_PROFILES[profile_name]
    traffic = load_or_simulate_traffic(spec)
    frames = range(len(traffic.trace))
    prepared = PreparedScenario(spec, traffic, backend, profile, frames)
    with (
        ScenarioWriter(folder, spec, prepared.identity, length=len(frames)) as writer,
        open_sensors(prepared) as sensed,
    ):
        yield sensed, writer


def _make(sensed: SensorRig, writer: ScenarioWriter | None = None) -> Cost:
    """Sense the frames as a run does, and write them too if there is a writer."""
    wall, cpu = time.perf_counter(), time.process_time()
    with BackgroundWriter() as behind:
        for frame in FRAMES:
            readings = sensed.capture_frame(frame)
            if writer is not None:
                behind.submit(partial(writer.write_frame, frame, readings))
    return Cost(time.perf_counter() - wall, time.process_time() - cpu)


def _encoder_s(pictures: list[Path]) -> float:
    """Processor seconds that OpenCV takes for some pictures."""
    total = 0.0
    for path in pictures:
        image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        assert image is not None
        began = time.process_time()
        cv2.imencode(".png", image)
        total += time.process_time() - began
    return total


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("spec", type=Path, nargs="?", default=SPEC)
    parser.add_argument("--profile", default="preview")
    parser.add_argument("--rounds", type=int, default=7)
    chosen = parser.parse_args()
    found = figures(quick=False, spec=chosen.spec, profile=chosen.profile, rounds=chosen.rounds)
    print(table(found))


if __name__ == "__main__":
    main()
