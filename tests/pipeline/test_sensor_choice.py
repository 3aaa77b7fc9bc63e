"""Runs with some sensors, agents and frames of a scenario only."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from advercity_dsl import Channel, Spec

from advercity.compiler import is_edited
from advercity.compiler.crossing import compile_library
from advercity.dataset.reader import Scenario
from advercity.dataset.verification import verify_dataset
from advercity.errors import InputError, RunError
from advercity.pipeline import RunOptions, repair_dataset, run_scenario
from advercity.pipeline.cache import compute_traffic_key
from advercity.pipeline.estimate import estimate_run
from advercity.pipeline.replay import write_recording
from advercity.pipeline.sensor_choice import choose_sensors
from advercity.testing import hash_tree
from tests.builders import write_small_library

pytestmark = pytest.mark.sumo

RIG = """
kind: rig
id: everything
vehicle:
  camera: {width_px: 32, height_px: 16, mounts: [{z_m: 2}]}
  more_cameras: {rear: {width_px: 32, height_px: 16, mounts: [{z_m: 2, yaw_deg: 180}]}}
  lidar: {mount: {z_m: 3}, channels: 4, azimuths: 64, range_m: 50}
  radar: {range_m: 80, rays: 4000, mounts: [{x_m: 2.5, z_m: 0.6}]}
  imu: {}
roadside_unit:
  lidar: {channels: 4, azimuths: 64, range_m: 50}
"""
SUITE = """
kind: suite
id: small
rig: everything
catalogue: one_car
looks: shaped
"""


@pytest.fixture(scope="module")
def spec(tmp_path_factory: pytest.TempPathFactory) -> Spec:
    """An ego `cav1` with every kind of sensor, and a unit `rsu1` with a LiDAR."""
    folder = tmp_path_factory.mktemp("chosen") / "library"
    (compiled,) = compile_library(write_small_library(folder, rig2=RIG, suite=SUITE))
    return compiled


def run(spec: Spec, root: Path, **options: object) -> Scenario:
    chosen = RunOptions(output=root, backend="fake", profile="preview", frames=slice(0, 4))
    return Scenario(run_scenario(spec, replace(chosen, **options)))  # pyright: ignore[reportArgumentType]


def test_a_run_makes_the_named_sensors_and_agents_only(spec: Spec, tmp_path: Path) -> None:
    made = run(spec, tmp_path, sensors=("camera", "lidar"), agents=("ego",), rate_hz=5.0)
    assert made.agents == ("cav1",)
    assert made.frame_numbers == (0, 2)
    assert {path.name for path in made.path.iterdir() if path.is_dir()} == {"+101"}
    view = made[0]["cav1"]
    assert (view.cameras, view.lidars, view.radars) == (2, 1, 0)
    assert view.motion[1] is not None, "inertial units, receivers and buses stay"
    with pytest.raises(InputError, match="cav1 has no radar"):
        _ = view.radar
    manifest = json.loads((made.path / "manifest.json").read_text())
    assert manifest["identity"]["left_out"] == ["radar", "rsu1"]
    assert manifest["spec"]["unrecorded"] == {"sensors": ["radar"], "agents": ["rsu1"]}
    assert not manifest["identity"].get("edited")
    assert verify_dataset(tmp_path) == []
    write_recording(made.path, tmp_path / "view.rrd")


def test_a_chosen_sensor_measures_as_in_a_whole_run(spec: Spec, tmp_path: Path) -> None:
    whole = run(spec, tmp_path / "whole", frames=slice(0, 1))
    some = run(spec, tmp_path / "some", frames=slice(0, 1), sensors=("radar",), agents=("cav1",))
    for name in ("000060_radar0.pcd", "000060_additional_gnss_imu.yaml"):
        paths = [made.path / "+101" / name for made in (whole, some)]
        assert paths[0].read_bytes() == paths[1].read_bytes()


def test_another_run_adds_frames_and_refuses_to_add_sensors(spec: Spec, tmp_path: Path) -> None:
    made = run(spec, tmp_path, sensors=("lidar",), rate_hz=5.0)
    first = hash_tree(made.path / "+101")
    assert run(spec, tmp_path, sensors=("lidar",)).frame_numbers == (0, 1, 2, 3)
    second = hash_tree(made.path / "+101")
    assert first.items() < second.items()
    with pytest.raises(RunError, match=r"agents left out: camera, radar, .*`fresh` starts over"):
        run(spec, tmp_path)
    assert hash_tree(made.path / "+101") == second
    again = run(spec, tmp_path, fresh=True, frames=slice(0, 1))
    assert again[0]["cav1"].cameras == 2
    assert "left_out" not in json.loads((again.path / "manifest.json").read_text())["identity"]


def test_damage_is_repaired_with_the_same_choice(spec: Spec, tmp_path: Path) -> None:
    made = run(spec, tmp_path, sensors=("lidar",), agents=("ego",), frames=slice(0, 1))
    before = hash_tree(tmp_path)
    (made.path / "+101" / "000060.pcd").unlink()
    assert repair_dataset(tmp_path) == []
    assert hash_tree(tmp_path) == before


def test_a_choice_of_everything_changes_no_byte(spec: Spec) -> None:
    options = RunOptions(sensors=("camera", "lidar", "radar"), agents=("ego", "rsu1"))
    assert choose_sensors(spec, options) is spec


def test_a_choice_keeps_traffic_and_edits(spec: Spec) -> None:
    options = RunOptions(sensors=("lidar",), agents=("ego",))
    chosen = choose_sensors(spec, options)
    assert choose_sensors(chosen, options) is chosen
    assert compute_traffic_key(chosen) == compute_traffic_key(spec)
    assert not is_edited(chosen)
    edited = spec.model_copy(update={"seeds": spec.seeds.model_copy(update={"sensors": 77})})
    assert is_edited(choose_sensors(edited, options))


def test_the_estimate_counts_what_is_chosen(spec: Spec) -> None:
    options = RunOptions(backend="fake", profile="preview", frames=slice(0, 8))
    whole = estimate_run([spec], options).total
    some = estimate_run([spec], replace(options, sensors=("lidar",), rate_hz=2.5)).total
    assert (whole.frames, some.frames) == (8, 2)
    assert (whole.pictures, some.pictures) == (16, 0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"sensors": ("sonar",)}, "`sensors` sonar: the chosen agents of .* camera, lidar, radar$"),
        ({"sensors": ("thermal",)}, "`sensors` thermal: the chosen agents of .* have camera"),
        ({"agents": ("ego", "rsu2")}, r"`agents` rsu2: .* no such agent; did you mean 'rsu1'\?"),
        ({"agents": ("rsu1",)}, "`agents` rsu1: readers of datasets need the ego; add 'ego'"),
        ({"sensors": ("camera",), "min_points": 1}, "`min_points` 1: cav1 of .* has no LiDAR"),
        ({"rate_hz": 3.0}, "`rate_hz` 3: .* ticks of 0.1 s apart; take 2.5 or 3.333"),
        ({"rate_hz": 11.0}, "`rate_hz` 11: .* take 5 or 10"),
        ({"rate_hz": 0.0}, "`rate_hz` 0.0: is outside 0.001 to inf"),
    ],
)
def test_what_cannot_be_chosen_is_refused(
    spec: Spec, options: dict[str, object], message: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=message):
        run(spec, tmp_path / "none", **options)
    assert not (tmp_path / "none" / spec.id / "manifest.json").exists()


def test_a_rate_and_a_step_exclude_each_other() -> None:
    with pytest.raises(InputError, match="`rate_hz` and the step of `frames` exclude"):
        RunOptions(rate_hz=5.0, frames=slice(0, 9, 2))


@pytest.mark.parametrize(
    ("rate_hz", "step"), [(10.0, 1), (5.0, 2), (10 / 3, 3), (3.333, 3), (0.1, 100)]
)
def test_a_rate_is_a_step_of_frames(rate_hz: float, step: int) -> None:
    assert RunOptions(rate_hz=rate_hz).select_frames(300, 0.1) == range(0, 300, step)
    chosen = RunOptions(rate_hz=rate_hz, frames=slice(7, 200)).select_frames(300, 0.1)
    assert chosen == range(7, 200, step)


def test_a_channel_needs_all_its_agents(spec: Spec) -> None:
    talking = spec.model_copy(update={"channel": Channel.model_construct()})
    with pytest.raises(InputError, match=r"`agents` ego: all agents of .* its V2X channel"):
        choose_sensors(talking, RunOptions(agents=("ego",)))
    assert choose_sensors(talking, RunOptions(agents=("ego", "rsu1"))) is talking
