"""The notebook that reads one frame with three readers of others."""

from pathlib import Path

import pytest

from advercity.dataset.reader import open_dataset
from advercity.exports.exporting import export_dataset
from advercity.semantics import Semantic
from tests.exports.readers import ROOT, needs_readers, run_reader


@needs_readers
def test_three_readers_show_the_same_frame(
    masked_dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for library in ("pycocotools", "mcap_ros2"):
        pytest.importorskip(library)
    export_dataset("nuscenes", masked_dataset, tmp_path / "nuscenes")
    export_dataset("coco", masked_dataset, tmp_path / "coco")
    export_dataset("mcap", masked_dataset, tmp_path / "mcap", options={"schemas": "ros2"})
    monkeypatch.setenv("ADVERCITY_EXPORTS", str(tmp_path))
    found = run_reader("read_notebook.py", ROOT / "examples" / "read_exports.ipynb")

    scenario = open_dataset(masked_dataset).scenarios[0]
    frame, name = scenario[0], scenario.path.name
    view, at = frame["cav1"], f"at {frame.time_s:.1f} s"
    # A rider has a mask besides that of the machine, with which it shares the instance.
    is_person = view.semantic(0) == Semantic.PEDESTRIAN
    pixels = zip(view.instance(0).ravel().tolist(), is_person.ravel().tolist(), strict=True)
    shown = {(number, person) for number, person in pixels if number}
    file = f"{name}/cav1/000060_camera0.png"
    assert found["figures"] == 3
    said = [line for line in found["lines"] if line.startswith(("nuScenes", "COCO", "MCAP"))]
    assert said == [
        f"nuScenes: {name}-cav1 has {len(view.boxes)} boxes in its first frame",
        f"COCO: {file} has {len(shown)} masks",
        f"MCAP: {len(view.points)} points and {len(view.boxes)} objects {at}",
    ]
