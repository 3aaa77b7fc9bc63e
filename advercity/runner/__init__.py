"""The pipeline over frames and scenarios."""

from advercity.runner.batch import Watcher, raise_failures, run_all
from advercity.runner.executors import executor_called
from advercity.runner.limits import Limits
from advercity.runner.options import FrameRange, Options, ViewerTarget, parse_frames
from advercity.runner.progress import Progress, Report
from advercity.runner.repair import repair
from advercity.runner.scenario import run_scenario
from advercity.runner.supervision import Outcome

__all__ = [
    "FrameRange",
    "Limits",
    "Options",
    "Outcome",
    "Progress",
    "Report",
    "ViewerTarget",
    "Watcher",
    "executor_called",
    "parse_frames",
    "raise_failures",
    "repair",
    "run_all",
    "run_scenario",
]
