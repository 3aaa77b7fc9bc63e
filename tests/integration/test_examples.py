"""The notebooks and the guide to the dataset, run on a small one."""

import json
import re
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import pytest
from advercity_dsl import Spec

from tests.builders import SensorFramesOf, write_scenario

ROOT = Path(__file__).parent.parent.parent


@pytest.fixture(autouse=True)
def output(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, spec: Spec, sensor_frames_of: SensorFramesOf
) -> None:
    """A dataset in `output`, where the working folder is."""
    write_scenario(tmp_path / "output", spec, sensor_frames_of)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("ADVERCITY_DATASET", "output")
    mpl.use("Agg")


def run_notebook(name: str) -> int:
    """Run the code of an example, and count its figures."""
    notebook = json.loads((ROOT / "examples" / name).read_text())
    names: dict[str, Any] = {}
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            assert not cell["outputs"]
            exec("".join(cell["source"]), names)
    figures = plt.get_fignums()
    plt.close("all")
    return len(figures)


def test_the_notebook_of_a_dataset_runs(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_notebook("read_dataset.ipynb") == 3
    out = capsys.readouterr().out
    assert "1 frames of ['rcnj_fog_day_sparse']" in out
    assert re.search(r"^201 van \d+/40 points \{'camera\d': [01]\.", out, re.MULTILINE)


def test_the_notebook_of_photographs_measures_images(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_notebook("compare_with_photographs.ipynb") == 3
    out = capsys.readouterr().out
    assert re.search(r"^slope -?\d\.\d\d, from -?\d\.\d\d to -?\d\.\d\d$", out, re.MULTILINE)
    assert re.search(r"^\d+\.\d people and \d+\.\d vehicles per image$", out, re.MULTILINE)


def test_the_guide_reads_what_is_there() -> None:
    guide = (ROOT / "docs" / "dataset.md").read_text()
    first, *_ = re.findall(r"^```python\n(.*?)^```$", guide, re.MULTILINE | re.DOTALL)
    names: dict[str, Any] = {}
    exec(first, names)
    assert len(names["dataset"]) == 1
    assert names["view"].points.shape == (len(names["view"].cloud), 3)


def test_the_guide_names_every_field_of_an_object() -> None:
    import advercity

    guide = (ROOT / "docs" / "dataset.md").read_text()
    objects = advercity.open_dataset("output")[0]["cav1"].extras["objects"]
    for item in objects.values():
        fields = item.keys() | {name for camera in item["cameras"].values() for name in camera}
        assert all(f"`{name}`" in guide for name in fields)
