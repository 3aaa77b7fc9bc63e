"""What exporting takes, relative to the run that made the frames.

    python benchmarks/export.py

Frames of `ui_fog_day_sparse` in preview, with images of actors' ids, or with radars for `v2xr`, are
made once and exported to every format. Both are processor time, children included. What a run takes
for its first frame, world and worker processes included, is not counted as making frames.
"""

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from advercity_dsl import Mount, Spec
from advercity_dsl.rig import Radar
from measurement import Measurement, cpu_with_children_s, format_table

from advercity.compiler import read_spec, with_digest
from advercity.exports.exporting import export_dataset
from advercity.exports.registry import EXPORT_FORMATS
from advercity.pipeline import RunOptions, run_scenario

SPEC = Path("compiled/ui_fog_day_sparse.json")


def run_benchmark(*, quick: bool) -> list[Measurement]:
    """Measure the export to every format."""
    frames = 4 if quick else 20
    with tempfile.TemporaryDirectory() as folder:
        plain = _run(_with_truth(read_spec(SPEC)), Path(folder, "plain"), frames)
        radar = _run(_with_radars(read_spec(SPEC)), Path(folder, "radar"), frames)
        return [
            _measure_export(name, Path(folder), *(radar if name == "v2xr" else plain))
            for name in EXPORT_FORMATS
        ]


def _measure_export(name: str, folder: Path, dataset: Path, run_s: float) -> Measurement:
    before_s = cpu_with_children_s()
    export_dataset(name, dataset, folder / "exports" / name)
    ratio = (cpu_with_children_s() - before_s) / run_s
    return Measurement(f"export to {name}", ratio, "making the frames", at_most=1.0)


def _run(spec: Spec, output: Path, frames: int) -> tuple[Path, float]:
    """Make frames; return the dataset and the processor time of all frames but the first."""
    one, every = (slice(0, end) for end in (1, frames))
    warm, short = output.with_name("warm"), output.with_name(f"{output.name}_short")
    times_s: list[float] = []
    for folder, chosen in ((warm, one), (short, one), (output, every)):
        before_s = cpu_with_children_s()
        run_scenario(spec, RunOptions(folder, profile="preview", frames=chosen, fresh=True))
        times_s.append(cpu_with_children_s() - before_s)
    _, short_s, whole_s = times_s
    return output, whole_s - short_s


def _with_truth(spec: Spec) -> Spec:
    """Let all cameras of a spec have images of actors' ids."""
    sensors = [agent.sensors for agent in spec.agents]
    cameras = [one.camera.model_copy(update={"truth": ("instance",)}) for one in sensors]
    return _with_sensors(spec, [{"camera": camera} for camera in cameras])


def _with_radars(spec: Spec) -> Spec:
    """Let all agents of a spec have a radar."""
    return _with_sensors(spec, [{"radar": Radar(mounts=(Mount(z_m=1.0),))} for _ in spec.agents])


def _with_sensors(spec: Spec, changes: Sequence[Mapping[str, Any]]) -> Spec:
    agents = tuple(
        agent.model_copy(update={"sensors": agent.sensors.model_copy(update=change)})
        for agent, change in zip(spec.agents, changes, strict=True)
    )
    return with_digest(spec.model_copy(update={"agents": agents}))


if __name__ == "__main__":
    print(format_table(run_benchmark(quick=False)))
