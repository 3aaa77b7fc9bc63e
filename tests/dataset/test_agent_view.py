"""Files of a dataset that are cut off, spoilt or gone, as whoever reads it meets them."""

from pathlib import Path

import pytest
from advercity_dsl import Spec

import advercity
from advercity.dataset.agent_view import AgentView
from advercity.dataset.facts import collect_scenario_facts
from advercity.dataset.reader import Scenario
from advercity.errors import InputError, RunError
from tests.builders import SensorFramesOf, write_scenario

REMEDY = "`advercity verify` lists all such files, `advercity repair` restores them"


@pytest.fixture
def scenario(tmp_path: Path, spec: Spec, sensor_frames_of: SensorFramesOf) -> Path:
    write_scenario(tmp_path, spec, sensor_frames_of)
    return tmp_path / spec.id


def read_all(view: AgentView) -> None:
    """Read every field of the frame's YAML."""
    _ = (view.boxes, view.speed_m_s, view.world_from_agent, view.world_from_lidar)
    _ = (view.world_from_camera(0), view.intrinsic(0))


def test_annotations_cut_off_anywhere_are_read_completely_or_reported(scenario: Path) -> None:
    path = scenario / "+101" / "000060.yaml"
    whole = path.read_bytes()
    view = advercity.open_dataset(scenario)[0]["cav1"]
    read_all(view)
    expected = len(view.boxes)
    messages = set[str]()
    for length in range(0, len(whole) - 1, 7):
        path.write_bytes(whole[:length])
        view = advercity.open_dataset(scenario)[0]["cav1"]
        try:
            read_all(view)
            assert len(view.boxes) <= expected
        except InputError as error:
            messages.add(str(error))
    assert any(REMEDY in text for text in messages)
    assert all(text.startswith(f"{path}:") for text in messages)


@pytest.mark.parametrize(
    ("good", "bad"),
    [("speed: ", "sped: "), ("extent: [", "extent: [x, "), ("extent: [", "extent: 3 # [")],
)
def test_damaged_annotations_are_reported(scenario: Path, good: str, bad: str) -> None:
    path = scenario / "+101" / "000060.yaml"
    text = path.read_text()
    assert good in text
    path.write_text(text.replace(good, bad))
    with pytest.raises(InputError, match=r"000060\.yaml: is damaged"):
        read_all(advercity.open_dataset(scenario)[0]["cav1"])


@pytest.mark.parametrize("text", ["vehicles: 3\nwalkers: {}", "{vehicles: {1: {}}, walkers: {}}"])
def test_statistics_name_a_damaged_file(scenario: Path, text: str) -> None:
    (scenario / "+101" / "000060.yaml").write_text(text)
    with pytest.raises(InputError, match=r"000060\.yaml: is damaged"):
        collect_scenario_facts(Scenario(scenario))


def test_statistics_name_a_missing_file(scenario: Path) -> None:
    (scenario / "102" / "000060.yaml").unlink()
    with pytest.raises(InputError, match=r"102/000060\.yaml: is missing; `advercity verify`"):
        collect_scenario_facts(Scenario(scenario))


def test_a_truncated_manifest_and_one_of_another_version_have_their_own_errors(
    scenario: Path,
) -> None:
    path = scenario / "manifest.json"
    text = path.read_text()
    path.write_text(text[:2000])
    with pytest.raises(
        InputError, match=r"manifest\.json:\d+:\d+: not valid JSON: .*; it is the only list"
    ):
        advercity.open_dataset(scenario)
    path.write_text(text.replace('"manifest_version": 5', '"manifest_version": 2'))
    with pytest.raises(RunError, match="not a manifest of this version: manifest_version: "):
        advercity.open_dataset(scenario)
