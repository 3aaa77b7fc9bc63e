"""Where scenarios are run: on this machine, or on a cluster."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from advercity_dsl import Spec

from advercity.errors import InputError
from advercity.runner.batch import Watcher, run_all
from advercity.runner.limits import Limits
from advercity.runner.options import Options
from advercity.runner.supervision import Outcome


class Executor(Protocol):
    """Runs scenarios somewhere."""

    def run(
        self, specs: Sequence[Spec], options: Options, *, watcher: Watcher, limits: Limits
    ) -> list[Outcome]:
        """Run every spec; how each ended, in the order of `specs`."""
        ...


@dataclass(frozen=True)
class ThisMachine:
    """Scenarios in so many processes at a time on this machine."""

    jobs: int

    def run(
        self, specs: Sequence[Spec], options: Options, *, watcher: Watcher, limits: Limits
    ) -> list[Outcome]:
        """Run every spec; how each ended, in the order of `specs`."""
        return run_all(specs, options, watcher=watcher, jobs=self.jobs, limits=limits)


def executor_called(name: str, *, output: str, address: str | None, jobs: int) -> Executor:
    """The executor of that name.

    Args:
        name: `local` or `ray`.
        output: Folder for the dataset; for Ray also the URL of a store.
        address: Of a Ray cluster; None is one on this machine alone.
        jobs: Processes at a time, on this machine; a cluster knows itself how many it takes.

    Raises:
        InputError: There is no such executor, or the rest does not fit it.
    """
    if name == "ray":
        from advercity.runner.cluster import Cluster, here_or_there

        return Cluster(here_or_there(output), address)
    if name != "local":
        raise InputError(f"--executor {name}: no such executor; local or ray")
    if address is not None:
        raise InputError("--address goes with --executor ray")
    if "://" in output:
        raise InputError(f"--output {output}: a store is reached with --executor ray")
    return ThisMachine(jobs)
