"""The Python interface does what the commands do, without a command line."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

import advercity
from advercity.dataset.reader import Dataset
from advercity.errors import InputError, RunError
from advercity.testing import (
    RecordingListener,
    hash_tree,
    load_example_spec,
    with_small_sensors,
)

WEATHER = """\
kind: weather
id: my_fog
time: day
fog: {mor_m: 40 m}
"""


@pytest.fixture(scope="module")
def spec() -> advercity.Spec:
    return with_small_sensors(load_example_spec("ri_clear_day_sparse"))


def test_every_public_name_is_there_and_nothing_else_is_promised() -> None:
    assert {name for name in advercity.__all__ if getattr(advercity, name, None) is None} == set()
    assert dir(advercity) == sorted(advercity.__all__)
    with pytest.raises(AttributeError, match="no attribute 'simulte'"):
        _ = advercity.simulte  # pyright: ignore


def test_importing_advercity_imports_nothing_of_it() -> None:
    code = "import sys, advercity; print([m for m in sys.modules if m.startswith('advercity.')])"
    child = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert child.stdout.strip() == "[]"


def test_a_library_becomes_the_specs_that_the_command_writes(tmp_path: Path) -> None:
    specs = advercity.compile_library()
    advercity.write_specs(specs, tmp_path)
    committed = Path(__file__).parents[1] / "compiled"
    assert len(specs) == 110
    assert hash_tree(tmp_path) == hash_tree(committed)


def test_a_spec_is_loaded_under_another_weather(tmp_path: Path) -> None:
    advercity.write_specs([load_example_spec("ui_clear_day_sparse")], tmp_path)
    path = tmp_path / "ui_clear_day_sparse.json"
    (tmp_path / "my_fog.yaml").write_text(WEATHER)
    plain = advercity.load_spec(path)
    foggy = advercity.load_spec(str(path), weather=tmp_path / "my_fog.yaml")
    assert foggy.weather.fog is not None
    assert foggy.weather.fog.mor_m == 40.0
    assert (foggy.seeds, foggy.demand) == (plain.seeds, plain.demand)
    with pytest.raises(InputError, match="heavy_rain"):
        advercity.load_spec(path, weather="heavy_rain_dya")


@pytest.mark.sumo
def test_a_run_writes_a_dataset_that_opens(spec: advercity.Spec, tmp_path: Path) -> None:
    listener = RecordingListener()
    options = advercity.RunOptions(
        tmp_path, backend="fake", profile="preview", scale=1.0, frames=slice(0, 2)
    )
    result = advercity.run_batch(spec, options, listener=listener)
    dataset = result.open_dataset()
    assert isinstance(dataset, Dataset)
    assert [frame.index for frame in dataset] == [0, 1]
    assert result.failed == ()
    assert [one.scenario for one in listener.results] == [spec.id]
    assert advercity.simulate(spec).trace_sha256 in json.dumps(
        json.loads((tmp_path / spec.id / "manifest.json").read_text())
    )


@pytest.mark.sumo
def test_a_failure_is_raised_or_returned_as_asked(spec: advercity.Spec, tmp_path: Path) -> None:
    beyond = slice(100_000, 100_001)
    with pytest.raises(InputError, match=spec.id):
        advercity.run(spec, tmp_path, backend="fake", profile="preview", frames=beyond)
    options = advercity.RunOptions(tmp_path, backend="fake", profile="preview", frames=beyond)
    result = advercity.run_batch([spec], options)
    assert [one.scenario for one in result.failed] == [spec.id]
    with pytest.raises((InputError, RunError)):
        result.raise_failures()


@pytest.mark.parametrize("jobs", [0, -1, 1001])
def test_a_number_of_processes_that_cannot_be_is_refused(
    jobs: int, spec: advercity.Spec, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=f"`jobs` {jobs}: is outside 1 to 1000"):
        advercity.run(spec, tmp_path / "output", backend="fake", jobs=jobs)
    assert not (tmp_path / "output").exists()


def test_a_run_of_no_specs_is_refused(tmp_path: Path) -> None:
    """As of a list from which all were left out."""
    with pytest.raises(InputError, match="there is no spec to run"):
        advercity.run([], tmp_path / "output", backend="fake")
    assert not (tmp_path / "output").exists()


def test_frames_that_cannot_be_are_refused_before_anything_is_made(
    spec: advercity.Spec, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match="no frame"):
        advercity.run(spec, tmp_path / "output", backend="fake", frames=slice(3, 3))
    assert not (tmp_path / "output").exists()
