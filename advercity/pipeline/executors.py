"""Checks batches of scenarios, then runs them on this machine or on others.

A distribution registers its `ExecutorKind`, under the executor's name, as an entry point of the
group `advercity.executors`. Ray is in the distribution advercity-cluster.
"""

import logging
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Protocol

from advercity_dsl import Spec
from advercity_dsl.registry import Registered, load_registered

from advercity.compiler.crossing import check_not_edited
from advercity.dataset.formats import find_format
from advercity.dataset.partial_files import refuse_other_run
from advercity.errors import InputError
from advercity.pipeline.estimate import check_resources, resolve_requested_profile
from advercity.pipeline.output_folder import check_output_folder
from advercity.pipeline.preparation import AUTOMATIC_BACKEND, resolve_backend
from advercity.pipeline.progress import RunListener, ScenarioResult, SilentListener
from advercity.pipeline.sensor_choice import choose_sensors
from advercity.pipeline.spec_models import check_models
from advercity.pipeline.workers import WorkerPool
from advercity.rendering.backend import load_backend
from advercity.run_options import RunOptions, RunResources, ViewerTarget

_logger = logging.getLogger(__name__)
LOCAL = "local"
"""Executor of this machine."""


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
        """Run every spec; return the results in the order of `specs`."""
        ...


@dataclass(frozen=True)
class ExecutorKind:
    """An executor that a run can name.

    Attributes:
        name: Its name as an option.
        create: Creates it for the options of a run; InputError if they do not fit.
    """

    name: str
    create: Callable[[RunOptions], Executor]


@cache
def load_executors() -> Registered[ExecutorKind]:
    """Load the executors that other distributions of this installation register."""
    return load_registered("advercity.executors", {}, ExecutorKind)


def create_executor(options: RunOptions) -> Executor | None:
    """Create the requested executor; None for `local`, this machine itself.

    Raises:
        InputError: Other options do not fit it.
    """
    if options.executor != LOCAL:
        return _find_executor(options.executor).create(options)
    if options.cluster_address is not None:
        raise InputError("`cluster_address` goes with the `executor` of a cluster, such as ray")
    if "://" in str(options.output):
        raise InputError(f"`output` {options.output}: a store needs an `executor`, such as ray")
    return None


def _find_executor(name: str) -> ExecutorKind:
    kinds = load_executors()
    if name in kinds.found:
        return kinds.found[name]
    if name in kinds.broken:
        raise InputError(f"`executor` {name}: cannot be used: {kinds.broken[name]}")
    known = ", ".join([LOCAL, *kinds.found])
    raise InputError(
        f"`executor` {name}: is not installed; there is {known}; ray comes with pip install"
        " 'advercity[ray]'"
    )


def run_batch(
    specs: Sequence[Spec],
    options: RunOptions,
    *,
    listener: RunListener | None = None,
) -> list[ScenarioResult]:
    """Check, estimate and run scenarios; return the results in the order of `specs`.

    A failed scenario does not stop the others; `raise_failures` raises its error.

    Args:
        specs: Scenarios to run, all with different ids.
        options: How to run them.
        listener: Receives progress and results.

    Raises:
        InputError: An option does not fit, the run is too large, a spec was edited, or models are
            missing on this machine.
        RunError: Another run is writing one of the scenarios.
        BackendError: The backend is not installed, or cannot render the profile.
    """
    executor = create_executor(options)
    # Machines of a cluster may have other devices than this one.
    options = resolve_backend(options) if executor is None else _without_automatic(options)
    validate_batch(specs, options)
    if executor is None:  # before checks of several seconds
        refuse_other_run(options.folder, [spec.id for spec in specs])
    if not options.allow_edited:
        for spec in specs:
            check_not_edited(spec, spec.id)
    if executor is None:  # the machines of a cluster check for themselves
        check_models(specs, allow_missing=options.allow_missing_models)
        _announce_profile(options)
    specs = [choose_sensors(spec, options) for spec in specs]
    resources = check_resources(specs, options, is_local=executor is None)
    run = run_scenarios if executor is None else executor.run
    return run(specs, options, resources=resources, listener=listener or SilentListener())


def _without_automatic(options: RunOptions) -> RunOptions:
    is_automatic = options.backend == AUTOMATIC_BACKEND
    return replace(options, backend="sapien") if is_automatic else options


def _announce_profile(options: RunOptions) -> None:
    """Warn once if `auto` has chosen `preview`, which is not the authored quality."""
    if options.profile == "auto" and resolve_requested_profile(options).name == "preview":
        _logger.warning(
            "profile preview: no device here traces rays in hardware; `profile` full renders as"
            " the rig says, and slowly"
        )


def validate_batch(specs: Sequence[Spec], options: RunOptions) -> None:
    """Check the ids of specs and the options before a run.

    Raises:
        InputError: There is no spec, two have the same id, or an option does not fit.
    """
    if not specs:
        raise InputError("there is no spec to run; give one or more")
    for name, count in Counter(spec.id for spec in specs).items():
        if count > 1:
            raise InputError(f"{name} is given {count} times; each may run once into an output")
    if len(specs) > 1 and options.viewer.is_enabled:
        raise InputError("`rrd`, `stream` and `connect` show one scenario; run them one by one")
    _check_viewer(options.viewer)
    load_backend(options.backend)
    find_format(options.format)
    check_output_folder(options.folder)


def _check_viewer(viewer: ViewerTarget) -> None:
    if not viewer.is_enabled:
        return
    # Rerun takes a while to load.
    from advercity.viewer.recording import check_recording_file, parse_viewer_address

    if viewer.file is not None:
        check_recording_file(viewer.file)
    if viewer.connect is not None:
        parse_viewer_address(viewer.connect)


def run_scenarios(
    specs: Sequence[Spec],
    options: RunOptions,
    *,
    resources: RunResources | None = None,
    listener: RunListener | None = None,
) -> list[ScenarioResult]:
    """Run every spec in worker processes of this machine; return the results in order.

    A failed, crashed or killed scenario does not stop the others. With fewer scenarios than
    workers, several workers make the frames of one, unless it is shown live. Each worker sees one
    GPU. The index of the dataset records every result.

    Args:
        specs: Scenarios to run, all with different ids.
        options: How to run them.
        resources: Worker processes at a time, and limits for each scenario; default one, unlimited.
        listener: Receives progress and results, from this thread.

    Raises:
        InputError: The output is a file.
    """
    options = resolve_backend(options)
    pool = WorkerPool(specs, options, resources or RunResources(), listener or SilentListener())
    return pool.run()
