"""Traffic alone: a scenario's trace, its report and its moving plan, without sensors."""

import json
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import asdict, replace
from pathlib import Path

from advercity_dsl import Spec

from advercity.conflicts.report import TrafficReport, build_traffic_report
from advercity.errors import RunError
from advercity.media import VideoWriter
from advercity.physics.stopping import compute_stopping_distance
from advercity.pipeline.preparation import TrafficResult, load_or_simulate_traffic
from advercity.traffic.plan_video import draw_traffic_pictures


def compute_traffic_reports(specs: Iterable[Spec]) -> Iterator[TrafficReport]:
    """The reports on the traffic of specs, which comes from the cache or is simulated now.

    Weathers that share a trace share what is measured on it.

    Raises:
        InputError: A spec asks for what its road does not have.
        RunError: The simulation failed.
    """
    known: dict[str, TrafficReport] = {}
    for spec in specs:
        stage = load_or_simulate_traffic(spec)
        if stage.trace_sha256 not in known:
            known[stage.trace_sha256] = build_traffic_report(spec, stage.trace, stage.trace_sha256)
        yield replace(known[stage.trace_sha256], spec=spec.id)


def simulate_to_folder(spec: Spec, output: Path, *, with_video: bool = True) -> TrafficReport:
    """Write `<output>/<spec id>/` with `trace.npz`, `report.json` and `plan.mp4`, whole or not.

    Raises:
        InputError: The spec asks for what its road does not have, or PyAV is not installed.
        RunError: The simulation failed, or a file cannot be written.
    """
    stage = load_or_simulate_traffic(spec)
    found = build_traffic_report(spec, stage.trace, stage.trace_sha256)
    try:
        output.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=output) as folder:
            made = Path(folder) / spec.id
            made.mkdir()
            _write_traffic_files(spec, stage, found, made, filmed=with_video)
            shutil.rmtree(output / spec.id, ignore_errors=True)
            made.replace(output / spec.id)
    except OSError as error:
        raise RunError(f"{output / spec.id}: cannot be written: {error.strerror}") from error
    return found


def _write_traffic_files(
    spec: Spec, stage: TrafficResult, found: TrafficReport, folder: Path, *, filmed: bool
) -> None:
    stage.trace.save(folder / "trace.npz")
    document = found.to_document() | {"stopping": asdict(compute_stopping_distance(spec))}
    text = json.dumps(document, indent=1, allow_nan=False)
    (folder / "report.json").write_text(text + "\n", encoding="utf-8")
    if filmed:
        with VideoWriter(folder / "plan.mp4", stage.trace.tick_s) as reel:
            for picture in draw_traffic_pictures(spec, stage.trace):
                reel.append(picture)
