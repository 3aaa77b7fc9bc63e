"""Whose models a scenario shows is told in its manifest and beside its frames."""

from collections.abc import Callable
from pathlib import Path

import pytest
from advercity_dsl import Spec

from advercity.dataset.manifest import Identity, Manifest
from advercity.dataset.verification import restore_files, verify_scenario
from advercity.dataset.writer import ATTRIBUTION_FILE, ScenarioWriter
from advercity.errors import RunError
from advercity.sensors.sensor_frame import SensorFrame

MODEL = "ab" * 32


@pytest.fixture
def scenario(tmp_path: Path, spec: Spec) -> Path:
    """A scenario without frames, one of whose bodies is a model of the pack."""
    return written(tmp_path, spec, {"lincoln_mkz_2017": MODEL})


def written(root: Path, spec: Spec, bodies: dict[str, str]) -> Path:
    identity = Identity.for_spec(spec, trace_sha256="0" * 64, renderer={}, bodies=bodies)
    with ScenarioWriter(root, spec, identity, length=1) as dataset:
        dataset.finish()
    return dataset.scenario


def test_authors_and_licences_of_models_stand_beside_the_frames(scenario: Path):
    text = (scenario / ATTRIBUTION_FILE).read_text()
    assert "| lincoln_mkz_2017 | katorlegaz/concept-sedan-01v1 | Kator Legaz |" in text
    assert "[CC-BY-3.0-US](https://creativecommons.org/licenses/by/3.0/us/)" in text
    assert "seat_leon" not in text
    assert Manifest.load(scenario).identity.bodies == {"lincoln_mkz_2017": MODEL}
    assert verify_scenario(scenario) == []


def test_without_models_nobody_is_attributed(tmp_path: Path, spec: Spec):
    assert not (written(tmp_path, spec, {}) / ATTRIBUTION_FILE).exists()


def test_data_with_other_bodies_are_not_continued(scenario: Path, spec: Spec):
    with pytest.raises(RunError, match="body of lincoln_mkz_2017"):
        written(scenario.parent, spec, {})


def test_a_lost_attribution_is_put_back(
    scenario: Path, readings_of: Callable[[int], tuple[SensorFrame, ...]]
):
    text = (scenario / ATTRIBUTION_FILE).read_text()
    (scenario / ATTRIBUTION_FILE).unlink()
    assert restore_files(scenario, verify_scenario(scenario), readings_of) == []
    assert (scenario / ATTRIBUTION_FILE).read_text() == text
