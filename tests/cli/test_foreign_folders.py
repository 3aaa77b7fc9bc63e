"""Commands on folders of other programs."""

import json
from pathlib import Path

import pytest

from tests.command_line import Command
from tests.dataset.foreign_folder import describe_opv2v, write_frame


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for agent in ("641", "650"):
        write_frame(tmp_path / "data" / "drive" / agent, "000068", describe_opv2v(cafe=1))
    return tmp_path / "data"


def test_stats_say_what_the_files_do_not_hold(
    advercity: Command, folder: Path, tmp_path: Path
) -> None:
    ran = advercity("stats", folder, "--layout", "opv2v", "--output", tmp_path / "stats")
    assert ran.code == 0
    assert "not in these files: road, weather, visibility" in ran.err
    assert "left out: 2 frame keys cafe" in ran.err
    assert (tmp_path / "stats" / "class_histogram.csv").read_text() == (
        "class,annotations\nvehicle,1\n"
    )
    assert not (tmp_path / "stats" / "weather.csv").exists()


def test_a_scenario_is_shown(
    advercity: Command, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[int] = []

    def show(file: str, **_: bool) -> None:
        shown.append(Path(file).stat().st_size)

    monkeypatch.setattr("advercity.viewer.viewer_process.show", show)
    ran = advercity("view", folder / "drive", "--layout", "opv2v")
    assert ran.code == 0
    assert "not in these files: road, weather, visibility" in ran.err
    assert shown and shown[0] > 1000


def test_predictions_are_evaluated(advercity: Command, folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "found.jsonl"
    header = {"format": "advercity-predictions", "version": 1, "coordinates": "lidar_left_handed"}
    # OpenCOOD's place of the car, and one that is not there.
    boxes = [[20, -10, -1.15, 4.8, 2, 1.5, -0.785398], [40, 5, -1, 4, 2, 1.5, 0]]
    line = {"scenario": "drive", "frame": 0, "boxes": boxes, "scores": [0.9, 0.1]}
    path.write_text("\n".join(map(json.dumps, (header, line))))
    ran = advercity("benchmark", "evaluate", path, folder, "--layout", "opv2v", "--json")
    assert ran.code == 0
    rows = {(row["by"], row["cell"]): row for row in json.loads(ran.out)}
    assert rows["all", "all"]["ap_70"] == pytest.approx(1.0)
    assert rows["all", "all"]["predictions"] == 2
    assert {by for by, _ in rows} == {"all", "distance", "points"}
