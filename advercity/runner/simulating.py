"""Traffic alone: a scenario's trace, its report and its moving plan, without sensors."""

import json
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import asdict, replace
from pathlib import Path

from advercity_dsl import Spec

from advercity.errors import RunError
from advercity.reel import Reel
from advercity.runner.stage import Stage, set_stage
from advercity.traffic.film import film
from advercity.traffic.report import Report, report
from advercity.weather.stopping import stopping


def reports(specs: Iterable[Spec]) -> Iterator[Report]:
    """The reports on the traffic of specs, which comes from the cache or is simulated now.

    Weathers that share a trace share what is measured on it.

    Raises:
        InputError: A spec asks for what its road does not have.
        RunError: The simulation failed.
    """
    known: dict[str, Report] = {}
    for spec in specs:
        stage = set_stage(spec)
        if stage.trace_sha256 not in known:
            known[stage.trace_sha256] = report(spec, stage.trace, stage.trace_sha256)
        yield replace(known[stage.trace_sha256], spec=spec.id)


def simulate_to(spec: Spec, output: Path, *, filmed: bool = True) -> Report:
    """Write `<output>/<spec id>/` with `trace.npz`, `report.json` and `plan.mp4`, whole or not.

    Raises:
        InputError: The spec asks for what its road does not have, or PyAV is not installed.
        RunError: The simulation failed, or a file cannot be written.
    """
    stage = set_stage(spec)
    found = report(spec, stage.trace, stage.trace_sha256)
    try:
        output.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=output) as folder:
            made = Path(folder) / spec.id
            made.mkdir()
            _write(spec, stage, found, made, filmed=filmed)
            shutil.rmtree(output / spec.id, ignore_errors=True)
            made.replace(output / spec.id)
    except OSError as error:
        raise RunError(f"{output / spec.id}: cannot be written: {error.strerror}") from error
    return found


def _write(spec: Spec, stage: Stage, found: Report, folder: Path, *, filmed: bool) -> None:
    stage.trace.save(folder / "trace.npz")
    document = found.document() | {"stopping": asdict(stopping(spec))}
    text = json.dumps(document, indent=1, allow_nan=False)
    (folder / "report.json").write_text(text + "\n", encoding="utf-8")
    if filmed:
        with Reel(folder / "plan.mp4", stage.trace.tick_s) as reel:
            for picture in film(spec, stage.trace):
                reel.add(picture)
