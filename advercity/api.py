"""The Python interface: what `import advercity` gives, and what `advercity run` calls.

Paths may be strings. Every function raises `advercity.errors.InputError` for bad input, with file,
line and column where a file is at fault, and `RunError` for what fails while it runs.
"""

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from advercity_dsl import Spec

from advercity import compiler

if TYPE_CHECKING:
    # The pipeline loads SUMO, Rerun and OpenCV; loading specs does not wait for them.
    from advercity.dataset.cloud_files import CloudEncoding
    from advercity.dataset.reader import Dataset
    from advercity.pipeline import (
        ResourceLimits,
        RunListener,
        ScenarioResult,
        ViewerTarget,
    )
    from advercity.pipeline.preparation import TrafficResult

PathLike = str | os.PathLike[str]


def load_spec(
    path: PathLike, *, weather: PathLike | None = None, library: Sequence[PathLike] = ()
) -> Spec:
    """Load a compiled spec, optionally under another weather.

    Args:
        path: The JSON file.
        weather: A weather file, or the name of a weather of the library. The traffic stays the
            same, with the same ids, poses and boxes.
        library: Folders of the library; without any, the one that ships.

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
        InputError: The spec asks for what its road does not have.
        RunError: The simulation fails.
    """
    from advercity.pipeline.preparation import load_or_simulate_traffic

    return load_or_simulate_traffic(spec)


@dataclass(frozen=True)
class RunResult:
    """What a run has made.

    Attributes:
        output: Folder of the dataset, or the URL of a store.
        scenarios: How each scenario ended, in the order of the specs.
    """

    output: str
    scenarios: "tuple[ScenarioResult, ...]"

    @property
    def failed(self) -> "tuple[ScenarioResult, ...]":
        """Scenarios that ended with an error."""
        return tuple(result for result in self.scenarios if result.error is not None)

    def raise_failures(self) -> None:
        """Raise what failed; do nothing if every scenario succeeded.

        Raises:
            AdvercityError: The only scenario failed.
            RunError: Some of several scenarios failed; the text says which and why.
        """
        from advercity.pipeline import raise_failures

        raise_failures(self.scenarios)

    def open_dataset(self) -> "Dataset":
        """Open the dataset that was written."""
        from advercity.dataset.reader import open_dataset

        return open_dataset(self.output)


def run(
    specs: Spec | Iterable[Spec],
    output: PathLike = "output",
    *,
    backend: str = "auto",
    profile: Literal["auto", "preview", "full"] | str = "auto",
    scale: float | None = None,
    frames: slice | None = None,
    format: str = "opv2v",
    min_points: int = 0,
    clouds: "CloudEncoding" = "binary_compressed",
    fresh: bool = False,
    viewer: "ViewerTarget | None" = None,
    jobs: int | None = None,
    limits: "ResourceLimits | None" = None,
    allow_large: bool = False,
    allow_missing_models: bool = False,
    allow_edited: bool = False,
    allow_missed: bool = False,
    executor: str = "local",
    ray_address: str | None = None,
    listener: "RunListener | None" = None,
    check: bool = True,
) -> RunResult:
    """Run scenarios: traffic, sensors, dataset. What is finished in `output` is not made again.

    Args:
        specs: One spec or several, with different ids.
        output: Folder for the dataset; with Ray also the URL of a store.
        backend: Rendering backend, by name; `auto` is `sapien`, and `mitsuba` for `full` where it
            is installed and no device traces rays in hardware.
        profile: How well to render: `preview`, `full`, or `auto` for what suits the device.
        scale: Image scale in place of the profile's.
        frames: Recorded frames to make, such as `slice(0, 30)`; None is all.
        format: Layout of the dataset, `opv2v` or `adver_city`.
        min_points: LiDAR points that an actor must return to an agent to be annotated by it.
        clouds: Encoding of PCD files.
        fresh: Discard what an earlier run left.
        viewer: Where a live view or a recording goes.
        jobs: Worker processes at a time; None is as many as suit this machine.
        limits: Memory and time that a scenario may take; None is what the estimate allows.
        allow_large: Run what the estimate finds too large.
        allow_missing_models: Generate bodies in place of models that are not installed, and record
            it in the manifest.
        allow_edited: Run specs that were edited after they were compiled, and record it.
        allow_missed: Make scenarios whose conflicts do not happen as declared, and record it.
        executor: `local`, or `ray` for a cluster.
        ray_address: Address of the Ray cluster; None starts one on this machine.
        listener: Gets progress and results, from the calling thread.
        check: Raise failures after all scenarios have ended, as `subprocess.run` does; else they
            are in the result only.

    Raises:
        InputError: A spec or an option does not fit, before anything is made.
        AdvercityError: With `check`, what failed.
    """
    from advercity import pipeline

    batch = [specs] if isinstance(specs, Spec) else list(specs)
    target = os.fspath(output)
    options = pipeline.RunOptions(
        output=Path(target),
        backend=backend,
        profile=profile,
        scale=scale,
        frames=frames or slice(None),
        viewer=viewer or pipeline.ViewerTarget(),
        fresh=fresh,
        format=format,
        allow_missing_models=allow_missing_models,
        allow_edited=allow_edited,
        allow_missed=allow_missed,
        min_points=min_points,
        clouds=clouds,
    )
    results = pipeline.run_batch(
        batch,
        options,
        jobs=jobs,
        limits=limits,
        allow_large=allow_large,
        executor=pipeline.create_executor(executor, output=target, address=ray_address),
        listener=listener,
    )
    result = RunResult(target, tuple(results))
    if check:
        result.raise_failures()
    return result
