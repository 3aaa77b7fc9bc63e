"""Several scenarios, one after the other or side by side in processes of their own."""

from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path

from advercity_dsl import Spec

from advercity.errors import AdvercityError, InputError, RunError
from advercity.runner.options import Options
from advercity.runner.scenario import Report, run_scenario


def run_all(specs: Sequence[Spec], options: Options, *, jobs: int, report: Report) -> list[Path]:
    """Run every spec; the scenarios' folders in the order of `specs`.

    One that fails does not stop the others.

    Raises:
        InputError: Two specs have the same id, or an option does not fit.
        RunError: Some scenarios failed; the text says which and why.
    """
    if len({spec.id for spec in specs}) < len(specs):
        raise InputError("a scenario is given twice; each may run once into an output folder")
    if len(specs) > 1 and options.viewer.is_asked_for:
        raise InputError("--rrd, --stream and --connect show one scenario; run them one by one")
    if len(specs) == 1:
        return [run_scenario(specs[0], options, report)]
    failed: dict[str, Exception] = {}
    if jobs == 1:
        _one_by_one(specs, options, report, failed)
    else:
        _side_by_side(specs, options, jobs, report, failed)
    if failed:
        lines = [f"{name}: {error}" for name, error in failed.items()]
        raise RunError("\n".join([*lines, f"{len(failed)} of {len(specs)} scenarios failed"]))
    return [options.output / spec.id for spec in specs]


def _one_by_one(
    specs: Sequence[Spec], options: Options, report: Report, failed: dict[str, Exception]
) -> None:
    for spec in specs:
        try:
            run_scenario(spec, options, report)
        except AdvercityError as error:
            failed[spec.id] = error


def _side_by_side(
    specs: Sequence[Spec],
    options: Options,
    jobs: int,
    report: Report,
    failed: dict[str, Exception],
) -> None:
    # Renderers and simulators do not survive a fork.
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn"), max_tasks_per_child=1) as pool:
        runs = {pool.submit(run_scenario, spec, options): spec for spec in specs}
        for run in as_completed(runs):
            name = runs[run].id
            error = run.exception()
            if error is None:
                report(name, "done", 1, 1)
            elif isinstance(error, Exception):
                failed[name] = error
                report(name, "failed", 0, 1)
