"""No command replaces a file that it did not write, writes half of one, or writes into datasets."""

import resource
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import pytest
from advercity_dsl import Spec

from advercity.compiler import write_specs
from tests.builders import SMALL_LIBRARY
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


@contextmanager
def little_room() -> Generator[None]:
    """Let no file be longer than 100 bytes, as on a disk that is almost full."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize(
    ("command", "name"),
    [
        (["new", "weather", "mine"], "mine.yaml"),
        (["schema"], "weather.schema.json"),
        (["compile", SMALL_LIBRARY], "*.json"),
    ],
)
def test_a_disk_without_room_is_reported_with_the_file_and_leaves_no_part_of_it(
    advercity: Command, tmp_path: Path, command: list[str], name: str
) -> None:
    output = tmp_path / "made"
    with little_room():
        code, _, err = advercity(*command, "--output", output)
    assert code == 2
    assert f"error: {output}/" in err
    assert ": cannot be written: File too large" in err
    assert ".partial-" not in err
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]
    assert advercity(*command, "--output", output).code == 0
    assert list(output.glob(name))


@pytest.mark.parametrize("place", [".", "one", "one/new", "new"])
@pytest.mark.parametrize("command", ["compile", "import openscenario a.xosc", "simulate SPEC"])
def test_a_command_puts_no_folder_of_another_kind_into_a_dataset(
    advercity: Command, spec_file: Path, tmp_path: Path, command: str, place: str
) -> None:
    """Loaders of OPV2V would take it for a scenario or an agent."""
    dataset = tmp_path / "data"
    (dataset / "one").mkdir(parents=True)
    for name in ("manifest.json", "data_protocol.yaml"):
        (dataset / "one" / name).touch()
    had = sorted(dataset.rglob("*"))
    words = command.replace("SPEC", str(spec_file)).split()
    code, _, err = advercity(*words, "--output", dataset / place)
    assert code == 2
    assert "a dataset; name a folder beside it" in err
    assert sorted(dataset.rglob("*")) == had


@pytest.mark.parametrize("place", ["one", "one/101", "one/new"])
@pytest.mark.parametrize(
    "command",
    [
        "new weather mine --output PLACE",
        "schema --output PLACE",
        "show SPEC --map PLACE/plan.png",
        "sheet DATASET/rcnj_fog_day_sparse --output PLACE/000001_sheet.png",
        # Inputs that do not exist: the place is refused before what may take minutes.
        "stats no_dataset --output PLACE",
        "study no_folder --output PLACE",
        "benchmark evaluate no_predictions no_dataset --output PLACE",
        "benchmark degradation no_dataset --output PLACE",
        "video DATASET --output PLACE --kind lidar",
    ],
)
def test_a_command_puts_no_file_into_a_scenario(
    advercity: Command, spec_file: Path, two_roads: Path, tmp_path: Path, command: str, place: str
) -> None:
    """Loaders of OPV2V would take it for one of an agent or of a frame."""
    dataset = tmp_path / "data"
    (dataset / "one" / "101").mkdir(parents=True)
    for name in ("manifest.json", "data_protocol.yaml"):
        (dataset / "one" / name).touch()
    had = sorted(dataset.rglob("*"))
    values = {"PLACE": dataset / place, "SPEC": spec_file, "DATASET": two_roads}
    for name, value in values.items():
        command = command.replace(name, str(value))
    code, _, err = advercity(*command.split())
    assert (code, err.count("\n")) == (2, 1)
    assert f"is in a scenario of a dataset; write into that dataset, {dataset}, or into" in err
    assert sorted(dataset.rglob("*")) == had


@pytest.mark.parametrize("place", ["", "rcnj_fog_day_sparse"])
def test_list_says_that_a_dataset_is_one(advercity: Command, two_roads: Path, place: str) -> None:
    code, _, err = advercity("list", two_roads / place)
    assert (code, err.count("\n")) == (2, 1)
    assert f"{two_roads / place}: is a dataset; `advercity stats` describes it" in err
