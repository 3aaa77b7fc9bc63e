"""Scenarios whose sensors see next to nothing, and a backend that does stunts."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from advercity_dsl import Spec

from advercity.pipeline import Progress, RunOptions, ScenarioResult

STUNTS = Path(__file__).parent / "stunts"
WEATHERS = ("clear_day", "fog_day", "fog_night")


class Witness:
    """Notes what it is told."""

    def __init__(self) -> None:
        self.told: list[Progress] = []
        self.over: list[ScenarioResult] = []

    def on_progress(self, progress: Progress) -> None:
        """Note how far a scenario is."""
        self.told.append(progress)

    def on_result(self, result: ScenarioResult) -> None:
        """Note how a scenario ended."""
        self.over.append(result)


@pytest.fixture
def witness() -> Witness:
    """Somebody to tell."""
    return Witness()


@pytest.fixture
def stunts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where to put stunts for the `stunts` backend, which is installed for the time being."""
    folder = tmp_path / "stunts"
    folder.mkdir()
    monkeypatch.syspath_prepend(STUNTS)
    path = os.pathsep.join([str(STUNTS), os.environ.get("PYTHONPATH", "")])
    monkeypatch.setenv("PYTHONPATH", path)
    monkeypatch.setenv("STUNTS", str(folder))
    return folder


@pytest.fixture
def seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where each process that renders notes which graphics cards it sees."""
    folder = tmp_path / "seen"
    folder.mkdir()
    monkeypatch.setenv("SEEN", str(folder))
    return folder


@pytest.fixture
def few(specs: dict[str, Spec]) -> list[Spec]:
    """Scenarios of one road, cheap to sense."""
    return [_blunt(specs[f"ri_{weather}_sparse"]) for weather in WEATHERS]


@pytest.fixture
def options() -> Callable[[Path], RunOptions]:
    """How to run one frame of them into a folder, with the `stunts` backend."""
    return lambda output: RunOptions(
        output=output, backend="stunts", profile="preview", scale=1.0, frames=slice(0, 1)
    )


def _blunt(spec: Spec) -> Spec:
    data = spec.model_dump(mode="json")
    for agent in data["agents"]:
        agent["sensors"]["lidar"] |= {"azimuths": 16, "channels": 1}
        agent["sensors"]["camera"] |= {"width_px": 16, "height_px": 16}
    return Spec.model_validate(data)
