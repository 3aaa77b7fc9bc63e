"""Scenarios of which a run has made a part."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from advercity_dsl import Spec

from advercity.dataset.writer import ScenarioWriter
from tests.builders import SensorFramesOf, identify

LENGTH = 2
"""Frames of the scenario."""
Make = Callable[[Path, Spec, int], None]


@pytest.fixture(scope="session")
def original(
    tmp_path_factory: pytest.TempPathFactory, spec: Spec, sensor_frames_of: SensorFramesOf
) -> Path:
    """A scenario with the first of its two frames; not to be changed."""
    root = tmp_path_factory.mktemp("original")
    with ScenarioWriter(root, spec, identify(spec), length=LENGTH) as opened:
        opened.write_frame(0, sensor_frames_of(0))
        opened.finish()
    return opened.scenario


@pytest.fixture
def scenario(original: Path, tmp_path: Path) -> Path:
    """A copy of it."""
    return shutil.copytree(original, tmp_path / "output" / original.name)


@pytest.fixture
def make(sensor_frames_of: SensorFramesOf) -> Make:
    """Writes the first frames of a scenario into a dataset."""

    def make(root: Path, spec: Spec, frames: int) -> None:
        identity = identify(spec)
        with ScenarioWriter(root, spec, identity, length=LENGTH) as writer:
            for frame in set(range(frames)) - writer.done_frames:
                writer.write_frame(frame, sensor_frames_of(frame))
            writer.finish()

    return make
