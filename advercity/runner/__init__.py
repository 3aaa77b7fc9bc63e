"""The pipeline over frames and scenarios."""

from advercity.runner.batch import run_all
from advercity.runner.options import FrameRange, Options, ViewerTarget, parse_frames
from advercity.runner.repair import repair
from advercity.runner.scenario import Report, run_scenario

__all__ = [
    "FrameRange",
    "Options",
    "Report",
    "ViewerTarget",
    "parse_frames",
    "repair",
    "run_all",
    "run_scenario",
]
