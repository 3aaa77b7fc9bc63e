"""Runs batches of scenarios: checks them first, then hands them to this machine or a cluster."""

from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import replace
from queue import SimpleQueue
from threading import Event as Flag
from typing import Protocol

from advercity_dsl import Spec

from advercity.dataset.index import IndexWriter
from advercity.errors import InputError, RunError
from advercity.pipeline.estimate import check_resources
from advercity.pipeline.machine import build_gpu_environment, divide_slots, find_visible_gpus
from advercity.pipeline.messages import WorkerJob
from advercity.pipeline.options import ResourceLimits, RunOptions, RunResources
from advercity.pipeline.progress import RunListener, ScenarioResult, SilentListener
from advercity.pipeline.workers import run_worker
from advercity.rendering.backend import load_backend


class Executor(Protocol):
    """Runs scenarios on other machines."""

    def run(
        self,
        specs: Sequence[Spec],
        options: RunOptions,
        *,
        resources: RunResources,
        listener: RunListener,
    ) -> list[ScenarioResult]:
        """Run every spec; how each ended, in the order of `specs`."""
        ...


def create_executor(name: str, *, output: str, address: str | None = None) -> Executor | None:
    """Create the executor of that name; None for `local`, which is this machine itself.

    Args:
        name: `local` or `ray`.
        output: Folder of the dataset; for Ray also the URL of a store.
        address: Address of a Ray cluster; None starts one on this machine alone.

    Raises:
        InputError: The executor does not exist, or the other options do not fit it.
    """
    if name == "ray":
        from advercity.pipeline.cluster import RayExecutor, resolve_output

        return RayExecutor(resolve_output(output), address)
    if name != "local":
        raise InputError(f"`executor` {name}: no such executor; local or ray")
    if address is not None:
        raise InputError("`ray_address` goes with `executor` ray")
    if "://" in output:
        raise InputError(f"`output` {output}: a store needs `executor` ray")
    return None


def run_batch(
    specs: Sequence[Spec],
    options: RunOptions,
    *,
    jobs: int | None = None,
    limits: ResourceLimits | None = None,
    allow_large: bool = False,
    executor: Executor | None = None,
    listener: RunListener | None = None,
) -> list[ScenarioResult]:
    """Check scenarios, estimate what they take, and run them; how each ended, in their order.

    A scenario that fails does not stop the others; `raise_failures` raises what failed.

    Args:
        specs: Scenarios to run, all with different ids.
        options: How to run them.
        jobs: Worker processes at a time; None is as many as suit the machine.
        limits: Limits for each scenario; what is None comes from the estimate.
        allow_large: Run even what would fill the disk or take more than 30 days.
        executor: Where to run; None is this machine.
        listener: Receives progress and results.

    Raises:
        InputError: An option does not fit, or the run would take more than is allowed.
        BackendError: The backend is not installed, or cannot render the profile.
    """
    validate_batch(specs, options)
    resources = check_resources(
        specs,
        options,
        requested_limits=limits or ResourceLimits(),
        jobs=jobs,
        allow_large=allow_large,
        is_local=executor is None,
    )
    run = run_scenarios if executor is None else executor.run
    return run(specs, options, resources=resources, listener=listener or SilentListener())


def validate_batch(specs: Sequence[Spec], options: RunOptions) -> None:
    """Check what would go wrong with every spec before anything is run.

    Raises:
        InputError: Two specs have the same id, or an option does not fit.
    """
    for name, count in Counter(spec.id for spec in specs).items():
        if count > 1:
            raise InputError(f"{name} is given {count} times; each may run once into an output")
    if len(specs) > 1 and options.viewer.is_enabled:
        raise InputError("`rrd`, `stream` and `connect` show one scenario; run them one by one")
    load_backend(options.backend)


def run_scenarios(
    specs: Sequence[Spec],
    options: RunOptions,
    *,
    resources: RunResources | None = None,
    listener: RunListener | None = None,
) -> list[ScenarioResult]:
    """Run every spec on this machine; how each ended, in the order of `specs`.

    One that fails, dies or is killed does not stop the others. If there are fewer scenarios than
    jobs, several processes make the frames of one, unless they are to be seen live. Graphics cards
    are shared out among the processes that run at a time. When this call is interrupted, the
    processes are ended first. The index of the folder tells how every one ended.

    Args:
        specs: What to run, all with different ids.
        options: How to run them.
        listener: Told of progress and ends.
        resources: Processes at a time, and limits for each scenario.

    Raises:
        InputError: Two specs have the same id, or an option does not fit.
    """
    validate_batch(specs, options)
    listener, resources = listener or SilentListener(), resources or RunResources()
    gpus, stop, index = find_visible_gpus(), Flag(), IndexWriter(options.output, specs)
    free: SimpleQueue[range] = SimpleQueue()
    shares = divide_slots(resources.worker_count, len(specs))
    for share in shares:
        free.put(share)

    def one(spec: Spec) -> ScenarioResult:
        places = free.get()
        try:
            outcome = run_worker(
                WorkerJob(
                    spec, options, worker_count=1 if options.viewer.is_enabled else len(places)
                ),
                resources.limits,
                listener.on_progress,
                environment=build_gpu_environment(places, gpus),
                cancelled=stop,
            )
        finally:
            free.put(places)
        try:
            index.record_result(spec.id, failed=outcome.error is not None)
        except RunError as error:
            outcome = replace(outcome, error=outcome.error or error)
        listener.on_result(outcome)
        return outcome

    with ThreadPoolExecutor(len(shares)) as pool:
        try:
            runs = [pool.submit(one, spec) for spec in specs]
            for run in as_completed(runs):
                run.result()
        finally:
            stop.set()
            pool.shutdown(cancel_futures=True)
    return [run.result() for run in runs]
