"""Tools of the original, QUARRG/Adver-City: `generate_summary.py` on a dataset in its layout.

`summarise` takes its steps, by its keys and folders; `generate_statistics.py` reads the result.
"""

from pathlib import Path
from typing import Any

import pytest
import yaml
from advercity_dsl import Spec

from advercity.dataset.reader import open_dataset
from advercity.exports.exporting import export_dataset
from tests.builders import SensorFramesOf, write_scenario

FRAMES = 2


def summarise(scenario: Path) -> dict[str, Any]:
    """Summarise a scenario as `generate_summary.py` does."""
    views = sorted(path.name for path in scenario.iterdir())[:5]
    protocol = yaml.safe_load((scenario / "data_protocol.yaml").read_text())
    weather, _, time = protocol["dataset_config"]["weather"].rpartition("_")
    declared, density = protocol["scenario"], protocol["density"]
    points = len(declared["rsu_list"]) + 2 * len(declared["single_cav_list"])
    names = sorted(path.name for path in (scenario / views[2]).glob("*.yaml"))
    frames: dict[int, dict[Any, Any]] = {}
    for name in (name for name in names if "_" not in name):
        described = [yaml.safe_load((scenario / view / name).read_text()) for view in views]
        objects: dict[int, dict[str, Any]] = {}
        for number in (0, 1, 3, 4, 2):
            objects |= described[number]["vehicles"] | described[number]["walkers"]
        by_ego = described[2]["vehicles"] | described[2]["walkers"]
        speeds = [one["ego_speed"] for one in described]
        frame: dict[Any, Any] = {
            "cav_speeds": {"ego": speeds[2], "cav1": speeds[3], "cav2": speeds[4]},
            "num_annotations": len(objects),
        }
        for number, item in objects.items():
            if str(number) not in views:
                frame[number] = {"class": item["class"], "speed": item["speed"]}
                if number in by_ego:
                    frame[number]["distance_to_ego"] = item["dist"]
                    frame[number]["angle_to_ego"] = item["relative_angle"]
        frames[int(name.removesuffix(".yaml"))] = frame
    vehicles = declared["num_vehicles"] * points * density["vehicle_multiplier"]
    return {
        "simulation": scenario.name,
        "scenario": protocol["dataset_config"]["scenario"],
        "weather": weather,
        "time_of_day": time,
        "density": protocol["dataset_config"]["density"],
        "num_frames": len(frames),
        "num_vehicles": round(vehicles),
        "num_walkers": round(declared["num_walkers"] * density["walker_multiplier"]),
        "frames": frames,
    }


@pytest.fixture(scope="module")
def dataset(
    tmp_path_factory: pytest.TempPathFactory, spec: Spec, sensor_frames_of: SensorFramesOf
) -> Path:
    root = tmp_path_factory.mktemp("adver_city")
    write_scenario(root, spec, sensor_frames_of, frames=FRAMES, format="adver_city")
    return root


def test_the_third_folder_is_the_egos(dataset: Path, spec: Spec) -> None:
    scenario = open_dataset(dataset).scenarios[0].path
    names = sorted(path.name for path in scenario.iterdir())
    assert names[2] == str(spec.ego.number)
    assert all((scenario / name).is_dir() for name in names[:5])


def test_the_tools_of_the_original_find_their_keys(dataset: Path, spec: Spec) -> None:
    found = summarise(open_dataset(dataset).scenarios[0].path)
    assert found["scenario"] == "rural_curved_non_junction"
    assert (found["num_vehicles"], found["num_walkers"]) == (
        spec.demand.vehicles,
        spec.demand.walkers,
    )
    assert found["num_frames"] == FRAMES


def test_an_exported_summary_is_that_of_the_original(dataset: Path, tmp_path: Path) -> None:
    scenario = open_dataset(dataset).scenarios[0].path
    output = export_dataset("adver_city", dataset, tmp_path / "out").output
    assert [path.name for path in (output / "scenarios").iterdir()] == [scenario.name]
    made = yaml.safe_load((output / "scenarios" / scenario.name / "summary.yaml").read_text())
    assert made == summarise(scenario)


def test_layouts_give_the_same_summary(
    dataset: Path, tmp_path: Path, spec: Spec, sensor_frames_of: SensorFramesOf
) -> None:
    write_scenario(tmp_path / "data", spec, sensor_frames_of, frames=FRAMES)
    texts = [
        next(
            export_dataset("adver_city", one, tmp_path / name).output.glob("*/*/summary.yaml")
        ).read_text()
        for name, one in (("first", dataset), ("second", tmp_path / "data"))
    ]
    assert texts[0] == texts[1]


@pytest.mark.parametrize(
    ("weather", "expected"),
    [
        ("fog_day", "foggy_day"),
        ("foggy_heavy_rain_night", "foggy_hard_rain_night"),
        ("heavy_rain_day", "hard_rain_day"),
        ("clear_night", "clear_night"),
    ],
)
def test_weathers_have_the_names_of_the_original(
    specs: dict[str, Spec], weather: str, expected: str
) -> None:
    from advercity.dataset.adver_city_names import build_protocol

    spec = next(spec for spec in specs.values() if spec.weather.id == weather)
    assert build_protocol(spec)["dataset_config"]["weather"] == expected
