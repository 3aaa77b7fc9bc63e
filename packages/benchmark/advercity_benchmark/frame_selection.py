"""Which frames of a dataset are learned from, predicted and evaluated."""

from pathlib import Path

from advercity.dataset.reader import FrameView, open_scenarios
from advercity.dataset.scenario_folders import no_frames_error
from advercity.errors import InputError


def select_frames(
    path: Path, frames: slice = slice(None), layout: str | None = None
) -> list[FrameView]:
    """Select written frames of a dataset by number, counted from the first kept one of a scenario.

    Args:
        path: The dataset.
        frames: Their numbers.
        layout: Layout of a folder of others, as of `open_dataset`.

    Raises:
        InputError: It is no dataset, has no frames, or none with these numbers.
    """
    written = [scenario for scenario in open_scenarios(path, layout) if len(scenario)]
    if not written:
        raise no_frames_error(path)
    chosen = [
        scenario.frame(number)
        for scenario in written
        for number in range(max(scenario.frame_numbers) + 1)[frames]
        if number in scenario.frame_numbers
    ]
    if not chosen:
        raise InputError(f"{path}: has no frame among those of --frames")
    return chosen
