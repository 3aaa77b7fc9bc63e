"""The pipeline over frames and scenarios."""

from advercity.pipeline.executors import (
    RunListener,
    SilentListener,
    create_executor,
    raise_failures,
    run_scenarios,
)
from advercity.pipeline.options import (
    FrameRange,
    Progress,
    ProgressCallback,
    ResourceLimits,
    RunOptions,
    ViewerTarget,
    parse_frame_range,
)
from advercity.pipeline.scenario import repair_dataset, run_scenario
from advercity.pipeline.workers import ScenarioResult

__all__ = [
    "FrameRange",
    "Progress",
    "ProgressCallback",
    "ResourceLimits",
    "RunListener",
    "RunOptions",
    "ScenarioResult",
    "SilentListener",
    "ViewerTarget",
    "create_executor",
    "parse_frame_range",
    "raise_failures",
    "repair_dataset",
    "run_scenario",
    "run_scenarios",
]
