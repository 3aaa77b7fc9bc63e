"""Simulates traffic alone: trace, report and moving plan of a scenario."""

import json
from collections.abc import Iterable, Iterator
from dataclasses import asdict, replace
from pathlib import Path

from advercity_dsl import Spec

from advercity.conflicts.report import TrafficReport, build_traffic_report
from advercity.dataset.scenario_folders import check_is_outside_datasets
from advercity.errors import RunError, describe_cause
from advercity.media import VideoWriter
from advercity.output_files import check_output, open_output_folder
from advercity.physics.stopping import compute_stopping_distance
from advercity.pipeline.preparation import TrafficResult, load_or_simulate_traffic
from advercity.traffic.plan_video import draw_traffic_pictures

TRACE_FILE, REPORT_FILE, VIDEO_FILE = "trace.npz", "report.json", "plan.mp4"


def compute_traffic_reports(specs: Iterable[Spec]) -> Iterator[TrafficReport]:
    """Compute the reports on the traffic of specs, from the cache or simulated now.

    A trace shared by several specs is measured once.

    Raises:
        InputError: A road lacks a part named in its spec.
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


def find_traffic_problems(spec: Spec) -> str:
    """Find departures of the traffic from the spec's declared conflicts; empty if none."""
    try:
        (report,) = compute_traffic_reports([spec])
    except RunError as error:
        return str(error).removeprefix(f"{spec.id}: ")
    return "; ".join(report.problems)


def simulate_to_folder(spec: Spec, output: Path, *, with_video: bool = True) -> TrafficReport:
    """Write `trace.npz`, `report.json` and `plan.mp4` to `<output>/<spec id>/`, all or none.

    Raises:
        InputError: The road lacks a part named in the spec, PyAV is not installed, `output` is in a
            dataset, or one of the files exists and may not be replaced.
        RunError: The simulation failed, or a file cannot be written.
    """
    check_is_outside_datasets(output)
    folder = output / spec.id
    for name in (TRACE_FILE, REPORT_FILE, VIDEO_FILE):
        check_output(folder / name)
    traffic = load_or_simulate_traffic(spec)
    report = build_traffic_report(spec, traffic.trace, traffic.trace_sha256)
    try:
        with open_output_folder(folder) as made:
            _write_traffic_files(spec, traffic, report, made, with_video=with_video)
            if not with_video:
                check_output(folder / VIDEO_FILE)  # again, after the long simulation
                (folder / VIDEO_FILE).unlink(missing_ok=True)  # of other traffic
    except OSError as error:
        raise RunError(f"{folder}: cannot be written: {describe_cause(error)}") from error
    return report


def _write_traffic_files(
    spec: Spec, traffic: TrafficResult, report: TrafficReport, folder: Path, *, with_video: bool
) -> None:
    traffic.trace.save(folder / TRACE_FILE)
    document = report.to_document() | {"stopping": asdict(compute_stopping_distance(spec))}
    text = json.dumps(document, indent=1, allow_nan=False)
    (folder / REPORT_FILE).write_text(text + "\n", encoding="utf-8")
    if with_video:
        with VideoWriter(folder / VIDEO_FILE, traffic.trace.tick_s) as video:
            for image in draw_traffic_pictures(spec, traffic.trace):
                video.append(image)
