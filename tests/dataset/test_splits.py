"""Splits of a dataset: which scenarios are linked where, and what stays untouched."""

import errno
import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from advercity_dsl import Spec

from advercity.dataset.overview_images import write_videos
from advercity.dataset.reader import open_dataset
from advercity.dataset.splits import PUBLISHED_SPLITS, link_shares, link_splits
from advercity.dataset.verification import verify_dataset
from advercity.errors import InputError, RunError
from tests.builders import TWO_ROADS_FRAMES
from tests.command_line import Command
from tests.dataset.conftest import LENGTH, Make


@pytest.fixture
def scenes(spec: Spec, make: Make, tmp_path: Path) -> Path:
    """Six scenes, each by day and by night; all on one road."""
    sun = spec.weather.sun.model_copy(update={"elevation_deg": -30.0})
    night = spec.weather.model_copy(update={"id": "night", "time": "night", "sun": sun})
    for number in range(6):
        seeds = spec.seeds.model_copy(update={"traffic": 100 + number})
        scene = spec.model_copy(update={"seeds": seeds, "id": f"day_{number}"})
        make(tmp_path / "dataset", scene, 1)
        changed = {"id": f"night_{number}", "weather": night}
        make(tmp_path / "dataset", scene.model_copy(update=changed), 1)
    return tmp_path / "dataset"


@pytest.mark.parametrize(
    ("shares", "sizes"),
    [
        ({"train": 4, "validate": 1, "test": 1}, [8, 2, 2]),
        ({"train": 50, "validate": 0, "test": 50}, [6, 0, 6]),
        ({"train": 90, "validate": 5, "test": 5}, [8, 2, 2]),
        ({"train": 100, "validate": 0, "test": 0}, [12, 0, 0]),
    ],
)
def test_shares_keep_scenarios_of_one_traffic_together(
    shares: dict[str, float], sizes: list[int], scenes: Path, tmp_path: Path
) -> None:
    found = link_shares(scenes, tmp_path / "splits", shares)
    assert [len(names) for names in found.values()] == sizes
    for names in found.values():
        numbers = [name.split("_")[1] for name in names]
        assert all(numbers.count(number) == 2 for number in numbers)
    assert link_shares(scenes, tmp_path / "again", shares) == found
    assert len(list((tmp_path / "splits" / "train").iterdir())) == sizes[0]


def test_splits_go_by_any_property(scenes: Path, tmp_path: Path) -> None:
    found = link_splits(scenes, tmp_path / "a", {"train": ["day"], "test": ["night"]}, by="time")
    assert found["train"] == [f"day_{number}" for number in range(6)]
    assert found["test"] == [f"night_{number}" for number in range(6)]
    seeds = {"train": [f"{100 + number}" for number in range(5)], "test": ["105"]}
    assert link_splits(scenes, tmp_path / "b", seeds, by="seed")["test"] == ["day_5", "night_5"]


@pytest.mark.parametrize(
    ("by", "values", "message"),
    [
        ("time", {"train": ["day"]}, "time 'night' is in no split; name it in one"),
        ("weather", {"train": ["fog", "night"]}, "has the weather 'fog'; it has .*night"),
        ("seed", {"train": ["100"], "test": ["100"]}, "seed '100' is named twice"),
    ],
)
def test_values_that_do_not_fit_are_named(
    by: str, values: dict[str, list[str]], message: str, scenes: Path, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=message):
        link_splits(scenes, tmp_path / "splits", values, by=by)
    assert not (tmp_path / "splits").exists()


def test_fewer_groups_than_splits_are_refused(scenes: Path, tmp_path: Path) -> None:
    shares = {"train": 1.0, "validate": 1.0, "test": 1.0}
    with pytest.raises(InputError, match="3 splits need as many values of time; it has day, night"):
        link_shares(scenes, tmp_path / "splits", shares, by="time")


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--by", "time", "--train", "day", "--test", "night"], "train: 6"),
        (["--share", "70,15,15"], "train: 8"),
        (["--by", "time"], "name the values of time of each split, or give"),
        (["--share", "70,15"], "--share 70,15: is no 3 percentages; write 70,15,15"),
        (["--share", "0,0,0"], "at least one split needs a share"),
        (["--share", "1,1,1", "--train", "ui"], "leave out their names"),
    ],
)
def test_the_command_takes_values_or_shares(
    words: list[str], told: str, scenes: Path, tmp_path: Path, advercity: Command
) -> None:
    ran = advercity("split", scenes, "--output", tmp_path / "splits", *words)
    assert told in ran.out + ran.err


def test_scenarios_are_linked_by_road(two_roads: Path, tmp_path: Path) -> None:
    found = link_splits(two_roads, tmp_path)
    expected = {
        "train": [],
        "validate": ["rcnj_fog_day_sparse"],
        "test": ["ui_clear_night_dense"],
    }
    assert found == expected
    assert json.loads((tmp_path / "splits.json").read_text()) == expected
    assert (tmp_path / "test" / "ui_clear_night_dense" / "+101" / "000060.pcd").is_file()
    assert verify_dataset(tmp_path) == []
    assert len(open_dataset(tmp_path)) == 2 * TWO_ROADS_FRAMES


def test_two_scenarios_of_one_name_are_reported_and_neither_is_left_out(
    two_roads: Path, tmp_path: Path
) -> None:
    (tmp_path / "both").mkdir()
    for name in ("first", "second"):
        (tmp_path / "both" / name).symlink_to(two_roads)
    for command in (link_splits, write_videos):
        with pytest.raises(InputError, match=r"second/\w+: has the name of .*first/"):
            command(tmp_path / "both", tmp_path / "output")
    assert not (tmp_path / "output").exists()


def test_a_scenario_that_is_the_current_folder_goes_by_its_name(
    two_roads: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(two_roads / "ui_clear_night_dense")
    assert link_splits(Path(), tmp_path)["test"] == ["ui_clear_night_dense"]
    assert (tmp_path / "test" / "ui_clear_night_dense" / "manifest.json").is_file()


def test_repeats_of_a_road_are_in_one_split(spec: Spec, make: Make, tmp_path: Path) -> None:
    """Their traffic differs, their place does not: a network would know it from training."""
    repeats = [f"{spec.id}_r{number}" for number in (1, 2, 3)]
    for name in repeats:
        make(tmp_path / "dataset", spec.model_copy(update={"id": name}), LENGTH)
    found = link_splits(tmp_path / "dataset", tmp_path / "splits")
    assert found == {"train": [], "validate": repeats, "test": []}


def test_links_are_updated(two_roads: Path, tmp_path: Path) -> None:
    link_splits(two_roads, tmp_path)
    link_splits(two_roads, tmp_path, {"train": ["ui"], "validate": ["rcnj"], "test": []})
    assert [path.name for path in (tmp_path / "train").iterdir()] == ["ui_clear_night_dense"]
    assert list((tmp_path / "test").iterdir()) == []


def test_links_and_files_of_others_stay_in_a_split(two_roads: Path, tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    link_splits(two_roads, tmp_path)
    (tmp_path / "train" / "mine").symlink_to(tmp_path / "mine")
    (tmp_path / "train" / "notes.txt").write_text("mine")
    link_splits(two_roads, tmp_path)
    assert {path.name for path in (tmp_path / "train").iterdir()} == {"mine", "notes.txt"}
    assert len(list((tmp_path / "test").iterdir())) == 1


def test_a_link_of_the_user_stays_though_the_program_made_one_like_it_elsewhere(
    two_roads: Path, tmp_path: Path
) -> None:
    link_splits(two_roads, tmp_path / "made")
    made = tmp_path / "made" / "test" / "ui_clear_night_dense"
    mine = tmp_path / "mine" / "test" / "ui_clear_night_dense"
    mine.parent.mkdir(parents=True)
    mine.symlink_to(made.readlink())
    (tmp_path / "copies").mkdir()
    for folder in two_roads.iterdir():
        if folder.is_dir():
            shutil.copytree(folder, tmp_path / "copies" / folder.name)

    with pytest.raises(InputError, match="no record that advercity made this link"):
        link_splits(tmp_path / "copies", tmp_path / "mine")
    assert mine.readlink() == made.readlink()
    link_splits(two_roads, tmp_path / "mine")


@pytest.mark.parametrize(
    "text", ['{"train": ["mine"], "test": []}', '{"train": [], "test": []}', "{}", "[1]", "mine"]
)
def test_a_list_of_splits_of_others_stays(two_roads: Path, tmp_path: Path, text: str) -> None:
    (tmp_path / "splits.json").write_text(text)
    with pytest.raises(InputError, match=r"splits\.json: exists, and there is no record"):
        link_splits(two_roads, tmp_path)
    assert (tmp_path / "splits.json").read_text() == text


@pytest.mark.parametrize("target", ["../mine", "../elsewhere/ui_clear_night_dense"])
@pytest.mark.parametrize("roads", [PUBLISHED_SPLITS, {"train": ["ui"], "test": ["rcnj"]}])
def test_a_link_to_something_else_stays_where_one_of_a_split_was(
    two_roads: Path, tmp_path: Path, target: str, roads: dict[str, list[str]]
) -> None:
    link_splits(two_roads, tmp_path)
    link = tmp_path / "test" / "ui_clear_night_dense"
    link.unlink()
    link.symlink_to(target)
    with pytest.raises(InputError, match=f"^{link}: exists, and there is no record .* this link"):
        link_splits(two_roads, tmp_path, roads)
    assert str(link.readlink()) == target
    assert (tmp_path / "validate" / "rcnj_fog_day_sparse").is_symlink()


def test_a_file_in_place_of_a_link_is_named(two_roads: Path, tmp_path: Path) -> None:
    (tmp_path / "test").mkdir()
    mine = tmp_path / "test" / "ui_clear_night_dense"
    mine.write_text("mine")
    for _ in range(2):
        with pytest.raises(
            InputError, match=f"^{mine}: exists, and there is no record .* this link"
        ):
            link_splits(two_roads, tmp_path)
        assert list(tmp_path.rglob("*")) == [mine.parent, mine]
    assert mine.read_text() == "mine"


def test_a_call_that_was_cut_short_is_completed_by_the_next(
    two_roads: Path, tmp_path: Path
) -> None:
    found = link_splits(two_roads, tmp_path)
    (tmp_path / "splits.json").unlink()
    (tmp_path / "validate" / "rcnj_fog_day_sparse").unlink()
    assert link_splits(two_roads, tmp_path) == found
    assert len(open_dataset(tmp_path)) == 2 * TWO_ROADS_FRAMES


def test_a_doctored_list_of_splits_deletes_no_link_elsewhere(
    two_roads: Path, tmp_path: Path
) -> None:
    output, mine = tmp_path / "splits", tmp_path / "mine" / "link"
    link_splits(two_roads, output)
    mine.parent.mkdir()
    mine.symlink_to(two_roads)
    text = json.dumps({"../mine": ["link"], "test": ["../../mine/link"]})
    (output / "splits.json").write_text(text)
    with pytest.raises(InputError, match="exists, and there is no record"):
        link_splits(two_roads, output)
    assert mine.is_symlink()


@pytest.mark.parametrize(
    ("roads", "message"),
    [
        ({"train": ["rcnj"]}, "road 'ui' is in no split"),
        ({"train": ["ui", "rcnj"], "test": ["ui"]}, "road 'ui' is named twice"),
    ],
)
def test_a_road_belongs_to_one_split(
    two_roads: Path, tmp_path: Path, roads: dict[str, list[str]], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        link_splits(two_roads, tmp_path, roads)


def test_splits_that_cannot_be_made_leave_no_empty_folder(
    two_roads: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As with a umask that takes all rights: the first folder is made, and none in it."""
    make = Path.mkdir

    def make_or_refuse(path: Path, *rest: Any, **more: Any) -> None:
        if path.parent == tmp_path / "new":
            make(path.parent)
            raise PermissionError(errno.EACCES, "Permission denied", str(path))
        make(path, *rest, **more)

    monkeypatch.setattr(Path, "mkdir", make_or_refuse)
    with pytest.raises(RunError, match="train: cannot be written: Permission denied"):
        link_splits(two_roads, tmp_path / "new")
    assert not list(tmp_path.iterdir())
