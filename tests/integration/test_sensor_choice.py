"""Datasets of rigs with some kinds of sensors only."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from advercity_dsl import Spec

from advercity.compiler.crossing import compile_library
from advercity.dataset.overview_images import write_contact_sheet, write_videos
from advercity.dataset.reader import Scenario
from advercity.dataset.verification import verify_dataset
from advercity.errors import InputError
from advercity.exports.exporting import export_dataset
from advercity.pipeline import RunOptions, run_scenario
from advercity.pipeline.preparation import load_or_simulate_traffic
from advercity.pipeline.replay import load_sensor_frames, write_recording
from advercity.pipeline.run_records import FrameWork
from advercity.sensors.agent_poses import AgentPoses
from advercity.sensors.annotation import annotate_actors
from tests.builders import write_small_library

pytestmark = pytest.mark.sumo

SENSORS = {
    "camera": "camera: {width_px: 64, height_px: 32, mounts: [{x_m: 2, z_m: 2}], rate_hz: 2}",
    "lidar": "lidar: {mount: {z_m: 3}, channels: 8, azimuths: 128, range_m: 50}",
    "radar": "radar: {range_m: 80, rays: 4000, mounts: [{x_m: 2.5, z_m: 0.6}]}",
    "thermal": "thermal: {width_px: 64, height_px: 32, mounts: [{x_m: 2, z_m: 2}]}",
}
SUITE = """
kind: suite
id: small
rig: chosen
catalogue: one_car
looks: shaped
"""


def compile_rig(folder: Path, *kinds: str) -> Spec:
    """Compile the small library with these kinds of sensors for all its agents."""
    sensors = "".join(f"  {SENSORS[kind]}\n" for kind in kinds)
    rig = f"kind: rig\nid: chosen\nvehicle:\n{sensors}roadside_unit:\n{sensors}"
    (spec,) = compile_library(write_small_library(folder / "library", chosen=rig, suite=SUITE))
    return spec


def make_options(root: Path) -> RunOptions:
    return RunOptions(output=root, backend="fake", profile="preview", frames=slice(0, 2))


@pytest.fixture(scope="module", params=SENSORS)
def kind(request: pytest.FixtureRequest) -> str:
    """The only kind of sensor with a place."""
    return request.param


@pytest.fixture(scope="module")
def made(kind: str, tmp_path_factory: pytest.TempPathFactory) -> Scenario:
    root = tmp_path_factory.mktemp(kind)
    return Scenario(run_scenario(compile_rig(root, kind), make_options(root)))


def test_a_rig_of_one_kind_makes_a_whole_dataset(made: Scenario, kind: str, tmp_path: Path) -> None:
    assert verify_dataset(made.path) == []
    for view in made[0].views.values():
        counts = {name: view.count(name) for name in SENSORS}
        assert counts == {name: int(name == kind) for name in SENSORS}
        view.read(kind)
        for other in SENSORS.keys() - {kind}:
            with pytest.raises(InputError, match=f"{view.id} has no {other}"):
                view.read(other)
    write_contact_sheet(made.path, tmp_path / "sheet.png")
    write_recording(made.path, tmp_path / "view.rrd")
    assert write_videos(made.path, tmp_path)


def test_loaders_of_opv2v_find_a_pose_of_reference(made: Scenario, kind: str) -> None:
    """OPV2V's loaders read `lidar_pose` of every frame, and `extrinsic` leads from it."""
    view = made[0]["cav1"]
    document = yaml.safe_load(view.path(".yaml").read_text())
    if kind != "lidar":
        assert document["lidar_pose"] == document["true_ego_pos"]
    if kind == "camera":
        # The camera looks ahead from 2 m before and 2 m above the agent's origin.
        expected = np.eye(4)
        expected[:3, 3] = (-2, 0, -2)
        np.testing.assert_allclose(document["camera0"]["extrinsic"], expected, atol=1e-6)


def test_without_a_lidar_the_other_sensors_decide_who_is_annotated(
    made: Scenario, kind: str
) -> None:
    """Every annotated actor has a pixel, or an echo; behind a camera ahead there is none."""
    view = made[0]["cav1"]
    if kind == "thermal":
        for one in view.extras["objects"].values():
            assert one["thermals"]["thermal0"]["visible_px"] > 0
    if kind == "radar":
        detected = set(view.load_radar(0)["object_id"].tolist()) - {0}
        assert detected <= set(view.boxes.ids.tolist())
    # The fake renderer shows no actors.
    assert bool(len(view.boxes)) == (kind != "camera")
    if kind != "lidar":
        assert not view.boxes.lidar_hits.any()
        assert not view.boxes.lidar_points.any()


def test_a_replay_annotates_the_same_actors(made: Scenario) -> None:
    poses = AgentPoses(made.spec, load_or_simulate_traffic(made.spec).trace)
    for item in load_sensor_frames(made, poses, 1):
        found = {one.state.actor.id for one in annotate_actors(item)}
        assert found == set(made.frame(1)[item.agent.id].boxes.ids.tolist())


@pytest.mark.parametrize(
    ("format", "needed"),
    [
        ("kitti", {"camera", "lidar"}),
        ("coco", {"camera"}),
        ("calibration", {"camera"}),
        ("webdataset", {"lidar"}),
        ("v2xr", {"lidar", "radar"}),
        ("nuscenes", set()),
        ("openlabel", set()),
    ],
)
def test_an_export_names_the_sensor_it_misses(
    made: Scenario, kind: str, format: str, needed: set[str], tmp_path: Path
) -> None:
    if needed <= {kind}:
        assert export_dataset(format, made.path, tmp_path / "out").frames == 2
        return
    titles = {"camera": "camera", "lidar": "LiDAR", "radar": "radar"}
    missing = "|".join(titles[name] for name in needed - {kind})
    with pytest.raises(InputError, match=rf"has (no|a) ({missing}), as {format} needs of"):
        export_dataset(format, made.path, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_work_without_images_or_rays_is_counted(tmp_path: Path) -> None:
    blind = compile_rig(tmp_path, "lidar")
    assert FrameWork.from_spec(blind, 1.0) == FrameWork(2, 0, 1, 2 * 8 * 128, 1.0)
