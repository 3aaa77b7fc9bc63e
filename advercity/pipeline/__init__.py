"""Runs scenarios: traffic, sensors, dataset and live view, in one process or many."""

from advercity.pipeline.executors import Executor, create_executor, run_batch, run_scenarios
from advercity.pipeline.progress import (
    Progress,
    ProgressCallback,
    RunListener,
    ScenarioResult,
    SilentListener,
    raise_failures,
)
from advercity.pipeline.scenario import repair_dataset, run_scenario
from advercity.run_options import ResourceLimits, RunOptions, RunResources, ViewerTarget

__all__ = [
    "Executor",
    "Progress",
    "ProgressCallback",
    "ResourceLimits",
    "RunListener",
    "RunOptions",
    "RunResources",
    "ScenarioResult",
    "SilentListener",
    "ViewerTarget",
    "create_executor",
    "raise_failures",
    "repair_dataset",
    "run_batch",
    "run_scenario",
    "run_scenarios",
]
