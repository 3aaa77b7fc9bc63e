"""The Python interface of `import advercity`, also called by `advercity run`.

Paths may be strings. Every function raises `advercity.errors.InputError` for bad input, with file,
line and column where a file is at fault, and `RunError` for failures of a run.
"""

import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import wraps
from inspect import Signature, signature
from pathlib import Path
from typing import TYPE_CHECKING, Concatenate, ParamSpec

from advercity_dsl import Spec

from advercity import compiler
from advercity.run_options import OPTIONS, RunOptions

if TYPE_CHECKING:
    # The pipeline loads SUMO, Rerun and OpenCV; loading specs does not wait for them.
    from advercity.dataset.reader import Dataset
    from advercity.pipeline import RunListener, ScenarioResult
    from advercity.pipeline.preparation import TrafficResult

PathLike = str | os.PathLike[str]
P = ParamSpec("P")


def load_spec(
    path: PathLike, *, weather: PathLike | None = None, library: Sequence[PathLike] = ()
) -> Spec:
    """Load a compiled spec, optionally under another weather.

    Args:
        path: The JSON file.
        weather: A weather file, or the name of a weather of the library. The traffic stays the
            same, with the same ids, poses and boxes.
        library: Folders of the library (default: the shipped one).

    Raises:
        InputError: The file is no spec of this version, or there is no such weather.
    """
    spec = compiler.read_spec(Path(path))
    if weather is None:
        return spec
    return compiler.with_weather(
        spec, compiler.find_weather(os.fspath(weather), *map(Path, library))
    )


def simulate(spec: Spec) -> "TrafficResult":
    """Simulate the traffic of a spec in SUMO, or take it from the cache.

    Returns:
        The SUMO network's path, the trace (every actor and signal at every recorded tick) and the
        trace's SHA-256.

    Raises:
        InputError: The road lacks a part named in the spec.
        RunError: The simulation fails.
    """
    from advercity.pipeline.preparation import load_or_simulate_traffic

    return load_or_simulate_traffic(spec)


@dataclass(frozen=True)
class RunResult:
    """Result of a run.

    Attributes:
        output: Folder of the dataset, or the URL of a store.
        scenarios: Result of each scenario, in the order of the specs.
    """

    output: str
    scenarios: "tuple[ScenarioResult, ...]"

    @property
    def failed(self) -> "tuple[ScenarioResult, ...]":
        """Results of failed scenarios."""
        return tuple(result for result in self.scenarios if result.error is not None)

    def raise_failures(self) -> None:
        """Raise an error if a scenario failed.

        Raises:
            AdvercityError: The only scenario failed.
            RunError: Some of several scenarios failed; the text says which and why.
        """
        from advercity.pipeline import raise_failures

        raise_failures(self.scenarios)

    def open_dataset(self) -> "Dataset":
        """Open the dataset of the run."""
        from advercity.dataset.reader import open_dataset

        return open_dataset(self.output)


def run_batch(
    specs: Spec | Iterable[Spec], options: RunOptions, *, listener: "RunListener | None" = None
) -> RunResult:
    """Run scenarios and return their results; errors are in the result and not raised.

    Args:
        specs: One spec or several, with different ids.
        options: How to run them.
        listener: Gets progress and results, from the calling thread.

    Raises:
        InputError: A spec or an option does not fit, before anything is made.
    """
    from advercity import pipeline

    batch = [specs] if isinstance(specs, Spec) else list(specs)
    results = pipeline.run_batch(batch, options, listener=listener)
    return RunResult(str(options.output), tuple(results))


def _take_options(
    make_options: Callable[P, RunOptions],
) -> Callable[
    [Callable[[Spec | Iterable[Spec], RunOptions], RunResult]],
    Callable[Concatenate[Spec | Iterable[Spec], P], RunResult],
]:
    """Give a function the parameters of `make_options` in place of the options themselves."""

    def decorate(
        function: Callable[[Spec | Iterable[Spec], RunOptions], RunResult],
    ) -> Callable[Concatenate[Spec | Iterable[Spec], P], RunResult]:
        @wraps(function)
        def call(specs: Spec | Iterable[Spec], *args: P.args, **kwargs: P.kwargs) -> RunResult:
            return function(specs, make_options(*args, **kwargs))

        first, _ = signature(function).parameters.values()
        taken = signature(make_options).parameters.values()
        parameters = [first, *(item.replace(annotation=OPTIONS[item.name][0]) for item in taken)]
        call.__signature__ = Signature(parameters, return_annotation="RunResult")  # pyright: ignore[reportAttributeAccessIssue]
        return call

    return decorate


@_take_options(RunOptions)
def run(specs: Spec | Iterable[Spec], options: RunOptions) -> RunResult:
    """Run scenarios: traffic, sensors, dataset. Finished frames in `output` are kept.

    Takes the fields of `RunOptions`: `advercity.run(spec, "output", profile="preview")`.

    Raises:
        InputError: A spec or an option does not fit, before anything is made.
        AdvercityError: A scenario failed. Raised after all have ended, as `subprocess.run` does
            with `check`; `run_batch` returns errors instead.
    """
    result = run_batch(specs, options)
    result.raise_failures()
    return result
