"""Scenarios with tiny sensors, and a backend that crashes, hangs or takes memory on demand."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from advercity_dsl import Spec

from advercity.compiler import with_digest
from advercity.pipeline import RunOptions
from advercity.testing import RecordingListener

STUNTS = Path(__file__).parent / "stunts"
WEATHERS = ("clear_day", "fog_day", "fog_night")


@pytest.fixture
def listener() -> RecordingListener:
    """Keeps progress and results."""
    return RecordingListener()


@pytest.fixture
def stunts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Install the `stunts` backend for a test; the folder for files that name its stunts."""
    folder = tmp_path / "stunts"
    folder.mkdir()
    monkeypatch.syspath_prepend(STUNTS)
    path = os.pathsep.join([str(STUNTS), os.environ.get("PYTHONPATH", "")])
    monkeypatch.setenv("PYTHONPATH", path)
    monkeypatch.setenv("STUNTS", str(folder))
    return folder


@pytest.fixture
def seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Folder in which each process that renders writes which GPUs it sees."""
    folder = tmp_path / "seen"
    folder.mkdir()
    monkeypatch.setenv("SEEN", str(folder))
    return folder


@pytest.fixture
def few(specs: dict[str, Spec]) -> list[Spec]:
    """Scenarios of one road, cheap to sense."""
    return [_shrink_sensors(specs[f"ri_{weather}_sparse"]) for weather in WEATHERS]


@pytest.fixture
def options() -> Callable[[Path], RunOptions]:
    """Options that run one frame into a folder, with the `stunts` backend."""
    return lambda output: RunOptions(
        output, backend="stunts", profile="preview", scale=1.0, frames=slice(0, 1), jobs=1
    )


def _shrink_sensors(spec: Spec) -> Spec:
    data = spec.model_dump(mode="json")
    for agent in data["agents"]:
        agent["sensors"]["lidar"] |= {"azimuths": 16, "channels": 1}
        agent["sensors"]["camera"] |= {"width_px": 16, "height_px": 16}
    return with_digest(Spec.model_validate(data))
