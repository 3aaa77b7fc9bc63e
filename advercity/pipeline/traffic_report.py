"""Simulates traffic alone: trace, report and moving plan of a scenario."""

import json
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import asdict, replace
from pathlib import Path

from advercity_dsl import Spec

from advercity.conflicts.report import TrafficReport, build_traffic_report
from advercity.errors import RunError, describe_cause
from advercity.media import VideoWriter
from advercity.physics.stopping import compute_stopping_distance
from advercity.pipeline.preparation import TrafficResult, load_or_simulate_traffic
from advercity.traffic.plan_video import draw_traffic_pictures


def compute_traffic_reports(specs: Iterable[Spec]) -> Iterator[TrafficReport]:
    """Compute the reports on the traffic of specs, from the cache or simulated now.

    Specs that share a trace share its measurements.

    Raises:
        InputError: A spec asks for what its road does not have.
        RunError: The simulation failed.
    """
    known: dict[str, TrafficReport] = {}
    for spec in specs:
        traffic = load_or_simulate_traffic(spec)
        if traffic.trace_sha256 not in known:
            known[traffic.trace_sha256] = build_traffic_report(
                spec, traffic.trace, traffic.trace_sha256
            )
        yield replace(known[traffic.trace_sha256], spec=spec.id)


def simulate_to_folder(spec: Spec, output: Path, *, with_video: bool = True) -> TrafficReport:
    """Write `<output>/<spec id>/` with `trace.npz`, `report.json` and `plan.mp4`, all or none.

    Raises:
        InputError: The spec asks for what its road does not have, or PyAV is not installed.
        RunError: The simulation failed, or a file cannot be written.
    """
    traffic = load_or_simulate_traffic(spec)
    report = build_traffic_report(spec, traffic.trace, traffic.trace_sha256)
    try:
        output.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=output) as folder:
            made = Path(folder) / spec.id
            made.mkdir()
            _write_traffic_files(spec, traffic, report, made, with_video=with_video)
            shutil.rmtree(output / spec.id, ignore_errors=True)
            made.replace(output / spec.id)
    except OSError as error:
        raise RunError(f"{output / spec.id}: cannot be written: {describe_cause(error)}") from error
    return report


def _write_traffic_files(
    spec: Spec, traffic: TrafficResult, report: TrafficReport, folder: Path, *, with_video: bool
) -> None:
    traffic.trace.save(folder / "trace.npz")
    document = report.to_document() | {"stopping": asdict(compute_stopping_distance(spec))}
    text = json.dumps(document, indent=1, allow_nan=False)
    (folder / "report.json").write_text(text + "\n", encoding="utf-8")
    if with_video:
        with VideoWriter(folder / "plan.mp4", traffic.trace.tick_s) as video:
            for image in draw_traffic_pictures(spec, traffic.trace):
                video.append(image)
