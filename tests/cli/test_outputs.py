"""No command replaces a file that it did not write."""

from pathlib import Path

import pytest
from advercity_dsl import Spec

from advercity.compiler import write_specs
from tests.command_line import Command

COMMANDS = {
    "weather.schema.json": ["schema", "--output", "."],
    "plan.png": ["show", "SPEC", "--map", "plan.png"],
    "gallery.jpg": ["gallery", "SPEC"],
    "bodies.png": ["assets", "sheet", "--all"],
    "scene.rrd": ["run", "SPEC", "--allow-missing-models", "--rrd", "scene.rrd"],
    "ID/trace.npz": ["simulate", "SPEC", "--output", "."],
    "ID/plan.mp4": ["simulate", "SPEC", "--output", ".", "--no-video"],
    "contact_sheet.png": ["sheet", "DATASET/rcnj_fog_day_sparse"],
    "rcnj_fog_day_sparse_lidar.mp4": ["video", "DATASET", "--output", ".", "--kind", "lidar"],
}
"""Commands by a file that they write."""


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_says_which_file_is_in_its_way_and_leaves_it(
    advercity: Command,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    specs: dict[str, Spec],
    two_roads: Path,
    name: str,
) -> None:
    spec = specs["ri_clear_day_sparse"]
    write_specs([spec], tmp_path)
    monkeypatch.chdir(tmp_path)
    mine = Path(name.replace("ID", spec.id))
    mine.parent.mkdir(exist_ok=True)
    mine.write_text("mine")
    places = {"SPEC": f"{spec.id}.json"}
    arguments = [
        places.get(word, word).replace("DATASET", str(two_roads)) for word in COMMANDS[name]
    ]
    code, _, err = advercity(*arguments)
    assert (code, err.count("\n")) == (2, 1)
    assert f"{mine}: exists, and there is no record that advercity wrote it as it is" in err
    assert mine.read_text() == "mine"
    assert not Path("output").exists()


def test_the_same_command_runs_again(
    advercity: Command,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    two_roads: Path,
) -> None:
    arguments = ["sheet", str(two_roads / "rcnj_fog_day_sparse"), "--output", "new/sheet.png"]
    monkeypatch.chdir(tmp_path)
    assert [advercity(*arguments)[0] for _ in range(2)] == [0, 0]
    assert [path.name for path in Path("new").iterdir()] == ["sheet.png"]
