"""A dataset of recorded traffic, whose places are known by hand, for tests of exports."""

from pathlib import Path

import pytest

from advercity.compiler.recorded_roads import (
    ReplayChoice,
    load_recorded_table,
    write_recorded_road,
)
from advercity.pipeline import run_scenario
from advercity.run_options import RunOptions
from tests.recordings.recorded_files import write_ind, write_street

FIRST_FRAME, FRAMES = 10, 3


@pytest.fixture(scope="session")
def recorded_dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Frames 10 to 12, from 1 s on, of the recording on the hill, in fog."""
    folder = tmp_path_factory.mktemp("recorded_dataset")
    choice = ReplayChoice(
        name="hill", ego="1", connected=["3"], weathers=["fog_day"], looks="shaped"
    )
    recording = load_recorded_table(write_ind(folder))
    (spec,) = write_recorded_road(recording, write_street(folder), choice, folder / "hill")
    frames = slice(FIRST_FRAME, FIRST_FRAME + FRAMES)
    options = RunOptions(
        folder / "data", backend="fake", profile="preview", scale=0.05, frames=frames
    )
    run_scenario(spec, options)
    return folder / "data"
