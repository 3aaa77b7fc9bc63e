"""What exporting takes, relative to the run that made the frames.

    python benchmarks/export.py

Frames of `ui_fog_day_sparse` with images of actors' ids and radars are made once and exported to
every format: 200 with small cameras and LiDARs and without a renderer, so that they cost little
and ratios are as high as they get; for `bench.py` four in preview. Both are processor time,
children included. What a run takes for its first frame, world and worker processes included, is not
counted as making frames.
"""

import tempfile
from pathlib import Path
from typing import Any

from advercity_dsl import Mount, Radar, Spec
from measurement import Measurement, cpu_with_children_s, format_table

from advercity.compiler import read_spec, with_digest
from advercity.exports.exporting import export_dataset
from advercity.exports.registry import load_export_formats
from advercity.pipeline import RunOptions, run_scenario
from advercity.testing import with_small_sensors

SPEC = Path("compiled/ui_fog_day_sparse.json")


def run_benchmark(*, quick: bool) -> list[Measurement]:
    """Measure the export to every format."""
    spec = _with_truth_and_radars(read_spec(SPEC))
    small = with_small_sensors(spec, width_px=96, height_px=54, channels=16, azimuths=900)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        dataset, run_s = (
            _run(spec, folder, frames=4, profile="preview")
            if quick
            else _run(small, folder, frames=200, backend="fake")
        )
        return [_measure_export(one, folder, dataset, run_s) for one in load_export_formats().found]


def _measure_export(name: str, folder: Path, dataset: Path, run_s: float) -> Measurement:
    before_s = cpu_with_children_s()
    export_dataset(name, dataset, folder / "exports" / name)
    ratio = (cpu_with_children_s() - before_s) / run_s
    return Measurement(f"export to {name}", ratio, "making the frames", at_most=1.0)


def _run(spec: Spec, folder: Path, *, frames: int, **options: Any) -> tuple[Path, float]:
    """Make frames; return the dataset and the processor time of all frames but the first."""
    one, every = (slice(0, end) for end in (1, frames))
    times_s: list[float] = []
    for name, chosen in (("warm", one), ("short", one), ("whole", every)):
        before_s = cpu_with_children_s()
        run_scenario(spec, RunOptions(folder / name, frames=chosen, fresh=True, **options))
        times_s.append(cpu_with_children_s() - before_s)
    _, short_s, whole_s = times_s
    return folder / "whole", whole_s - short_s


def _with_truth_and_radars(spec: Spec) -> Spec:
    """Let all cameras of a spec have images of actors' ids, and all agents a radar."""
    radar = Radar(mounts=(Mount(z_m=1.0),))
    data = spec.model_dump(mode="json")
    for agent in data["agents"]:
        agent["sensors"]["camera"]["truth"] = ["instance"]
        agent["sensors"]["radar"] = radar.model_dump(mode="json")
    return with_digest(Spec.model_validate(data))


if __name__ == "__main__":
    print(format_table(run_benchmark(quick=False)))
