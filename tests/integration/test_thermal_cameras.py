"""Thermal cameras of a rig, from the declaration to files, readers, exports and repair."""

import json
import tarfile
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from advercity_dsl import Spec

from advercity.compiler.crossing import compile_library
from advercity.dataset.reader import Scenario
from advercity.dataset.verification import verify_dataset
from advercity.errors import InputError
from advercity.exports.exporting import export_dataset
from advercity.pipeline import RunOptions, repair_dataset, run_scenario
from advercity.pipeline.replay import write_recording
from advercity.semantics import Semantic
from advercity.sensors.measurements import KELVIN_PER_COUNT, MAX_COUNT
from advercity.testing import hash_tree
from advercity.viewer.thermal_pictures import draw_thermal
from tests.builders import write_small_library

pytestmark = pytest.mark.sumo

RIG = """
kind: rig
id: thermals
vehicle:
  camera: {width_px: 32, height_px: 16, mounts: [{z_m: 2}]}
  lidar: {mount: {z_m: 3}, channels: 4, azimuths: 64, range_m: 50}
  thermal:
    width_px: 96
    height_px: 64
    netd_mk: 0.06 K
    mounts: [{x_m: 2.5, z_m: 0.6}, {x_m: -2.5, z_m: 0.6, yaw_deg: 180}]
"""
SUITE = """
kind: suite
id: small
rig: one_camera
agents: {cav1: thermals}
catalogue: one_car
looks: shaped
"""


@pytest.fixture(scope="module")
def spec(tmp_path_factory: pytest.TempPathFactory) -> Spec:
    folder = tmp_path_factory.mktemp("thermals") / "library"
    (compiled,) = compile_library(write_small_library(folder, thermals=RIG, suite=SUITE))
    return compiled


def make_options(root: Path) -> RunOptions:
    return RunOptions(output=root, backend="fake", profile="preview", scale=1.0, frames=slice(0, 2))


@pytest.fixture(scope="module")
def dataset(spec: Spec, tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("warm")
    run_scenario(spec, make_options(root))
    return root / spec.id


def test_a_spec_without_thermal_cameras_does_not_mention_them(spec: Spec) -> None:
    ego, unit = spec.agents
    assert ego.sensors.thermals[1].model.netd_mk == 60
    assert "thermal" not in unit.sensors.model_dump(mode="json")


def test_images_are_of_14_bits_and_labels_are_of_the_same_pixels(dataset: Path) -> None:
    view = Scenario(dataset)[0]["cav1"]
    assert view.thermals == 2
    stored = cv2.imread(str(view.path("_thermal0.png")), cv2.IMREAD_UNCHANGED)
    assert stored is not None
    assert stored.dtype == np.uint16
    assert stored.max() <= MAX_COUNT
    kelvin = view.thermal(0)
    np.testing.assert_array_equal(kelvin, stored * np.float32(KELVIN_PER_COUNT))
    semantic = view.thermal_semantic(0)
    assert kelvin.shape == semantic.shape == view.thermal_instance(0).shape == (64, 96)
    road, sky = (kelvin[semantic == tag].mean() for tag in (Semantic.ROAD, Semantic.SKY))
    assert road > sky
    # On a clear day the sun makes a road warmer than the air, here of 22 degC.
    assert 300 < road < 330
    model, pose = view.load_thermal_model(0), view.load_thermal_pose(0)
    assert (model.width_px, model.height_px) == (96, 64)
    mounted = np.linalg.inv(view.world_from_agent) @ pose
    np.testing.assert_allclose(mounted[:3, 3], (2.5, 0, 0.6), atol=1e-6)
    with pytest.raises(InputError, match="rsu1 has no thermal camera"):
        Scenario(dataset)[0]["rsu1"].thermal(0)
    picture = draw_thermal(view.thermal_counts(0))
    assert picture.shape == (64, 96, 3)
    assert picture[semantic == Semantic.ROAD].mean() > picture[semantic == Semantic.SKY].mean()


def test_objects_have_their_boxes_in_thermal_images(dataset: Path) -> None:
    view = Scenario(dataset)[0]["cav1"]
    objects = view.extras["objects"]
    assert objects
    assert all("thermals" in item for item in objects.values())
    ids, counts = np.unique(view.thermal_instance(0), return_counts=True)
    pixels = dict(zip(ids.tolist(), counts.tolist(), strict=True))
    for number, item in objects.items():
        if box := item["thermals"].get("thermal0"):
            assert box["visible_px"] == pixels.get(int(number), 0)


def test_any_order_of_frames_gives_the_same_bytes(
    dataset: Path, spec: Spec, tmp_path: Path
) -> None:
    for frames in (slice(1, 2), slice(0, 1)):
        run_scenario(spec, replace(make_options(tmp_path), frames=frames))
    first, again = (
        {name: value for name, value in hash_tree(folder).items() if "_thermal" in name}
        for folder in (dataset, tmp_path / spec.id)
    )
    assert first == again
    assert len(first) == 2 * 2 * 3


def test_thermal_images_are_verified_repaired_and_replayed(dataset: Path, tmp_path: Path) -> None:
    assert verify_dataset(dataset.parent) == []
    write_recording(dataset, tmp_path / "again.rrd")
    lost = dataset / "+101" / "000061_thermal_instance1.png"
    content = lost.read_bytes()
    lost.unlink()
    assert [problem.path for problem in verify_dataset(dataset.parent)] == [f"+101/{lost.name}"]
    assert repair_dataset(dataset) == []
    assert lost.read_bytes() == content


def test_the_layout_of_the_original_has_the_images_without_labels(
    dataset: Path, spec: Spec, tmp_path: Path
) -> None:
    run_scenario(spec, replace(make_options(tmp_path), format="adver_city", frames=slice(0, 1)))
    scenario = Scenario(tmp_path / spec.id)
    np.testing.assert_array_equal(
        scenario[0]["cav1"].thermal(1), Scenario(dataset)[0]["cav1"].thermal(1)
    )
    with pytest.raises(InputError, match="the layout adver_city has no such image"):
        scenario[0]["cav1"].thermal_semantic(1)


def test_shards_have_thermal_images_and_where_they_were_taken(
    dataset: Path, tmp_path: Path
) -> None:
    pytest.importorskip("webdataset")
    export_dataset("webdataset", dataset.parent, tmp_path / "shards")
    shard = next((tmp_path / "shards").rglob("*.tar"))
    view, name = Scenario(dataset)[0]["cav1"], f"{dataset.name}-000060-cav1"
    with tarfile.open(shard) as members:
        image, calib = (
            members.extractfile(f"{name}.{kind}") for kind in ("thermal1.png", "calib.json")
        )
        assert image is not None
        assert calib is not None
        assert image.read() == view.path("_thermal1.png").read_bytes()
        calibration = json.load(calib)
    np.testing.assert_allclose(
        calibration["thermal_intrinsic"][0], view.load_thermal_model(0).matrix
    )
