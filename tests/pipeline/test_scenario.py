import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from advercity_dsl import Isp, RawOutput, Spec

from advercity import develop_raw
from advercity.cli.arguments import parse_frame_slice
from advercity.compiler import find_weather, with_digest, with_weather, write_specs
from advercity.dataset import cloud_files
from advercity.dataset.reader import Scenario
from advercity.dataset.verification import verify_dataset
from advercity.errors import BackendError, InputError, RunError
from advercity.media import LABEL_HEIGHT_PX
from advercity.output_files import write_output
from advercity.pipeline import (
    RunOptions,
    repair_dataset,
    run_scenario,
)
from advercity.pipeline.backend_comparison import compare_backends
from advercity.pipeline.preparation import load_or_simulate_traffic
from advercity.pipeline.replay import load_sensor_frames
from advercity.pipeline.weather_gallery import write_weather_gallery
from advercity.rendering.backend import CameraCapture, CameraView
from advercity.semantics import Semantic
from advercity.sensors.agent_poses import AgentPoses
from advercity.sensors.measurements import PointKind
from advercity.testing import FakeRenderer, make_capture, with_small_sensors
from tests.builders import without_surroundings

pytestmark = [pytest.mark.render, pytest.mark.sumo]

MAPS = ("dynamic", "static", "lane", "visibility", "visibility_corp")
TINY = 0.05
"""Of 1920x1080: pictures of 96x54."""


@pytest.fixture(scope="module")
def spec(specs: dict[str, Spec]) -> Spec:
    return without_surroundings(specs["ri_fog_day_sparse"])


def run(spec: Spec, output: Path, first: int, last: int, **options: object) -> Path:
    chosen = RunOptions(
        output=output,
        profile="preview",
        scale=TINY,
        frames=slice(first, last),
        **options,  # pyright: ignore[reportArgumentType]
    )
    return run_scenario(spec, chosen)


@pytest.fixture(scope="module")
def made(spec: Spec, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two frames of a scenario."""
    return run(spec, tmp_path_factory.mktemp("made"), 0, 2)


def tree(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def test_every_agent_writes_its_files(made: Path) -> None:
    parts = [
        "yaml",
        "pcd",
        "objects.json",
        *(f"bev_{kind}.png" for kind in MAPS),
        *(f"depth{index}.png" for index in range(4)),
        *(f"depth_cm{index}.png" for index in range(4)),
        *(f"camera{index}.png" for index in range(4)),
        *(f"semantic{index}.png" for index in range(4)),
    ]
    for agent in ("+101", "102", "103", "-1", "-2"):
        expected = {
            f"{frame}.{part}" if part in ("yaml", "pcd") else f"{frame}_{part}"
            for frame in ("000060", "000061")
            for part in parts
        }
        if not agent.startswith("-"):
            expected |= {f"{frame}_additional_gnss_imu.yaml" for frame in ("000060", "000061")}
        assert {path.name for path in (made / agent).iterdir()} == expected


def test_the_manifest_holds_every_file_with_its_checksum(made: Path) -> None:
    manifest = json.loads((made / "manifest.json").read_text())
    text = json.dumps(manifest)
    for path, digest in tree(made).items():
        if path != "manifest.json":
            assert path in text
            assert digest in text


def test_the_same_spec_gives_the_same_bytes(spec: Spec, made: Path, tmp_path: Path) -> None:
    assert tree(run(spec, tmp_path, 0, 2)) == tree(made)


def test_frames_are_independent_of_those_before(spec: Spec, made: Path, tmp_path: Path) -> None:
    alone = tree(run(spec, tmp_path, 1, 2))
    whole = tree(made)
    frames = {path: digest for path, digest in alone.items() if "000061" in path}
    assert len(frames) == 123
    assert frames == {path: whole[path] for path in frames}


def test_a_run_resumes_where_an_earlier_one_stopped(spec: Spec, made: Path, tmp_path: Path) -> None:
    run(spec, tmp_path, 0, 1)
    assert tree(run(spec, tmp_path, 0, 2)) == tree(made)


def test_a_killed_run_started_again_ends_with_the_same_bytes(
    spec: Spec, made: Path, tmp_path: Path
) -> None:
    """SIGKILL as soon as the first frame is there, while the second is being made."""
    write_specs([spec], tmp_path / "compiled")
    process = subprocess.Popen(
        [
            *(sys.executable, "-c", "from advercity.cli import main; main()", "run"),
            *(str(tmp_path / "compiled" / f"{spec.id}.json"), "--output", str(tmp_path / "killed")),
            *("--profile", "preview", "--scale", str(TINY), "--frames", "0:2"),
        ],
        start_new_session=True,
    )
    journal = tmp_path / "killed" / ".staging" / spec.id / "journal_0.jsonl"
    while not journal.exists():
        assert process.poll() is None
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    scenario = run(spec, tmp_path / "killed", 0, 2)
    assert tree(scenario) == tree(made)
    assert [path.name for path in (tmp_path / "killed").iterdir()] == [spec.id]


def test_damaged_files_are_made_again_with_their_checksums(made: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(made, tmp_path / made.name)
    (copy / "+101" / "000060_camera0.png").unlink()
    (copy / "-2" / "000061.pcd").write_bytes(b"flipped")
    assert {problem.kind for problem in verify_dataset(tmp_path)} == {"missing", "changed"}
    assert repair_dataset(tmp_path) == []
    kept = copy / "-2" / "000061.pcd.kept"
    assert kept.read_bytes() == b"flipped"
    kept.unlink()
    assert tree(copy) == tree(made)


@pytest.mark.parametrize(
    "renderer", [{}, {"backend": 3}, {"backend": "sapien", "scale": 1e9, "renderer": "raster"}]
)
def test_a_manifest_without_a_renderer_that_can_be_is_refused(
    made: Path, tmp_path: Path, renderer: dict[str, object]
) -> None:
    copy = shutil.copytree(made, tmp_path / made.name)
    manifest = json.loads((copy / "manifest.json").read_text())
    manifest["identity"]["renderer"] = renderer
    (copy / "manifest.json").write_text(json.dumps(manifest))
    (copy / "103" / "000060.pcd").unlink()
    with pytest.raises(RunError, match=r"names no valid renderer.*--fresh"):
        repair_dataset(tmp_path)


@pytest.mark.parametrize("left", ["", "/lock", "/incoming"])
def test_a_repair_removes_the_staging_folder_that_a_killed_one_left(
    made: Path, tmp_path: Path, left: str
) -> None:
    copy = shutil.copytree(made, tmp_path / made.name)
    left_path = tmp_path / ".staging" / f"{made.name}{left}"
    left_path.parent.mkdir(parents=True)
    left_path.touch() if left == "/lock" else left_path.mkdir()
    assert repair_dataset(tmp_path) == []
    assert [path for path in tmp_path.iterdir() if path.name != "index.json"] == [copy]


def test_what_was_made_by_another_version_is_not_repaired(made: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(made, tmp_path / made.name)
    manifest = json.loads((copy / "manifest.json").read_text())
    manifest["identity"]["versions"]["numpy"] = "0.1"
    (copy / "manifest.json").write_text(json.dumps(manifest))
    (copy / "103" / "000060.pcd").unlink()
    with pytest.raises(RunError, match=r"cannot be repaired here.*numpy: 0\.1"):
        repair_dataset(tmp_path)


@pytest.mark.parametrize(
    ("place", "named"),
    [
        (("code_sha256",), "code of advercity: 0000"),
        (("renderer", "backend_sha256"), "code of the backend: 0000"),
    ],
)
def test_what_was_made_by_other_code_of_the_same_version_is_not_repaired(
    made: Path, tmp_path: Path, place: tuple[str, ...], named: str
) -> None:
    copy = shutil.copytree(made, tmp_path / made.name)
    manifest = json.loads((copy / "manifest.json").read_text())
    told = manifest["identity"]
    for key in place[:-1]:
        told = told[key]
    told[place[-1]] = "0" * 64
    (copy / "manifest.json").write_text(json.dumps(manifest))
    (copy / "103" / "000060.pcd").unlink()
    with pytest.raises(RunError, match=rf"cannot be repaired here.*{named}"):
        repair_dataset(tmp_path)


def test_the_original_layout_holds_the_same_images(spec: Spec, made: Path, tmp_path: Path) -> None:
    other = run(spec, tmp_path, 0, 1, format="adver_city")
    for name in ("000060_camera0.png", "000060_semantic3.png", "000060.yaml"):
        assert (other / "101" / name).read_bytes() == (made / "+101" / name).read_bytes()
    assert len(list(other.glob("*/*"))) == 53


def test_weathers_share_traffic_and_boxes(spec: Spec, made: Path, tmp_path: Path) -> None:
    other = run(with_weather(spec, find_weather("clear_night")), tmp_path, 0, 1)
    assert other.name == "ri_clear_night_sparse"
    for agent in ("+101", "102", "-1"):
        first, second = (
            yaml.safe_load((folder / agent / "000060.yaml").read_text()) for folder in (made, other)
        )
        for item in (*first["vehicles"].values(), *second["vehicles"].values()):
            del item["lidar_points"]
        assert first["vehicles"] == second["vehicles"]
        assert first["true_ego_pos"] == second["true_ego_pos"]
    fixes = [
        yaml.safe_load((folder / "102" / "000060_additional_gnss_imu.yaml").read_text())["gnss"]
        for folder in (made, other)
    ]
    assert fixes[0] == fixes[1]
    assert 44 < fixes[0]["lat"] < 45  # a village of Wisconsin
    pictures = [(folder / "+101" / "000060_camera0.png").read_bytes() for folder in (made, other)]
    assert pictures[0] != pictures[1]


def test_a_gallery_has_a_row_per_weather_and_a_column_per_scenario(
    spec: Spec, tmp_path: Path
) -> None:
    weathers = [find_weather("clear_day"), find_weather("clear_night")]
    write_weather_gallery([spec], weathers, tmp_path / "sheet.png", frame=0, width_px=320)
    sheet = cv2.imread(str(tmp_path / "sheet.png"))
    assert sheet is not None
    assert sheet.shape == (LABEL_HEIGHT_PX + 2 * (LABEL_HEIGHT_PX + 180), 320, 3)
    day, night = sheet[40 : 40 + 180], sheet[40 + 200 :]
    assert day.mean() > 2.0 * night.mean()
    with pytest.raises(InputError, match="has frames 0 to"):
        write_weather_gallery([spec], weathers, tmp_path / "sheet.png", frame=99_999)


def test_a_backend_shows_what_it_shows_itself(spec: Spec, tmp_path: Path) -> None:
    output = tmp_path / "comparison.png"
    found = compare_backends(spec, ["fake", "fake"], output, frame=0, width_px=64)
    assert found.semantic_agreement == found.instance_agreement == (1.0,)
    assert found.classes[0].semantic == "all"
    assert {item.ratios for item in found.classes} == {(1.0, 1.0)}
    picture = cv2.imread(str(output))
    assert picture is not None
    assert picture.shape[1] == 2 * 64
    with pytest.raises(InputError, match="name at least two"):
        compare_backends(spec, ["fake"], output)


def test_a_backend_that_returns_wrong_arrays_is_named_with_all_of_them(
    spec: Spec, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def render_wrongly(_: FakeRenderer, view: CameraView) -> CameraCapture:
        capture = make_capture(view.width_px, view.height_px)
        ids = capture.instance.astype(np.int64)
        return replace(capture, depth=capture.depth[:-1], instance=ids)  # pyright: ignore[reportArgumentType]

    monkeypatch.setattr(FakeRenderer, "render_camera", render_wrongly)
    with pytest.raises(BackendError) as caught:
        run(spec, tmp_path, 0, 1, backend="fake")
    assert "backend 'fake'" in str(caught.value)
    assert "depth is float32 (" in str(caught.value)
    assert "instance is int64 (" in str(caught.value)
    assert ", not int32 (" in str(caught.value)


def test_fog_shortens_the_lidar_and_leaves_the_annotation(
    spec: Spec, made: Path, tmp_path: Path
) -> None:
    clear = run(with_weather(spec, find_weather("clear_day")), tmp_path, 0, 1)
    in_fog = cloud_files.read_pcd(made / "+101" / "000060.pcd")
    in_clear = cloud_files.read_pcd(clear / "+101" / "000060.pcd")
    reach = [np.linalg.norm([c["x"], c["y"], c["z"]], axis=0).max() for c in (in_fog, in_clear)]
    of_surfaces = [
        int((points["kind"] == PointKind.SURFACE).sum()) for points in (in_fog, in_clear)
    ]
    assert of_surfaces[0] < of_surfaces[1]
    assert (in_fog["kind"] == PointKind.FOG).any()
    assert reach[0] < 80 < reach[1]


def test_lidar_points_lie_in_the_boxes_of_their_actors(made: Path) -> None:
    """All in the left-handed frame of the files: lidar of the level units to world to box."""
    checked = 0
    for unit in ("-1", "-2"):
        said = yaml.safe_load((made / unit / "000060.yaml").read_text())
        cloud = cloud_files.read_pcd(made / unit / "000060.pcd")
        x, y, z = said["lidar_pose"][:3]
        world = np.column_stack([cloud["x"] + x, cloud["y"] + y, cloud["z"] + z])
        for number, item in said["vehicles"].items():
            points = world[cloud["object_id"] == number]
            yaw = np.deg2rad(item["angle"][1])
            cos, sin = np.cos(yaw), np.sin(yaw)
            turn = np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
            local = (points - np.add(item["location"], item["center"])) @ turn.T
            # The unit's range noise has a standard deviation of 2 cm.
            assert (np.abs(local) <= np.add(item["extent"], 0.12)).all()
            checked += len(points)
    assert checked > 20


def test_a_recording_is_written_next_to_the_dataset(spec: Spec, made: Path, tmp_path: Path) -> None:
    file = tmp_path / "scene.rrd"
    scenario = run(spec, tmp_path, 0, 1, rrd=file)
    assert file.stat().st_size > 10_000
    assert tree(scenario).keys() <= tree(made).keys()


def test_a_replay_shows_the_boxes_that_are_annotated(spec: Spec, made: Path) -> None:
    scenario = Scenario(made)
    stored = scenario.frame(0)
    poses = AgentPoses(spec, load_or_simulate_traffic(spec).trace)
    frame = load_sensor_frames(scenario, poses, 0)[0].frame
    on_foot = 0
    for boxes in (stored[agent.id].boxes for agent in spec.agents):
        for number, kind, world_from_box, size in zip(
            boxes.ids.tolist(), boxes.classes, boxes.world_from_box, boxes.sizes, strict=True
        ):
            on_foot += kind == "pedestrian"
            state = frame.get_state(number)
            np.testing.assert_allclose(state.box.size, size, atol=1e-3)
            np.testing.assert_allclose(state.box_centre, world_from_box[:3, 3], atol=2e-3)
    assert on_foot > 0


def test_a_recording_shows_what_was_asked_for_last(spec: Spec, made: Path, tmp_path: Path) -> None:
    file = tmp_path / "scene.rrd"
    write_output(file, b"of an earlier run")
    run(spec, made.parent, 0, 1, rrd=file)
    assert file.stat().st_size > 10_000


def test_a_viewer_that_does_not_answer_leaves_no_dataset(spec: Spec, tmp_path: Path) -> None:
    with pytest.raises(RunError, match="no Rerun viewer answers"):
        run(spec, tmp_path, 0, 1, backend="fake", connect="127.0.0.1:1")
    assert not list(tmp_path.rglob("*"))


def test_frames_beyond_the_end_are_bad_input(spec: Spec, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="has frames 0 to"):
        run(spec, tmp_path, 5000, 5001)
    assert not list(tmp_path.rglob("*"))


@pytest.mark.parametrize(
    ("text", "frames"),
    [("2:5", [2, 3, 4]), (":3", [0, 1, 2]), ("7:", [7, 8, 9]), ("0:10:4", [0, 4, 8])],
)
def test_frame_ranges_count_from_the_first_kept_frame(text: str, frames: list[int]) -> None:
    assert list(range(10)[parse_frame_slice(text)]) == frames


def test_a_rig_that_asks_for_truth_gets_images_of_it(spec: Spec, tmp_path: Path) -> None:
    agents = list(spec.agents)
    camera = (
        agents[0]
        .sensors.cameras[0]
        .model.model_copy(
            update={"truth": ("instance", "normal", "flow"), "hdr": True, "raw": RawOutput(bits=10)}
            | {"isp": Isp(jpeg_quality=90)}
        )
    )
    sensors = agents[0].sensors.model_copy(update={"camera": camera})
    agents[0] = agents[0].model_copy(update={"sensors": sensors})
    asking = with_digest(spec.model_copy(update={"agents": tuple(agents)}))
    scenario = run(asking, tmp_path, 0, 2)
    assert verify_dataset(scenario) == []
    for kind in ("instance", "normal", "flow", "occlusion", "hdr", "raw"):
        assert {path.parent.name for path in scenario.glob(f"*/*_{kind}*.png")} == {"+101"}
    view = Scenario(scenario)[0]["cav1"]
    counted = 0
    for number, described in view.extras["objects"].items():
        for name, shown in described["cameras"].items():
            pixels = view.instance(int(name[-1])) == int(number)
            assert pixels.sum() == shown["visible_px"]
            counted += int(pixels.sum())
    assert counted > 20
    # The cameras look level: up is -y.
    road = view.semantic(0) == Semantic.ROAD
    assert road.sum() > 500
    np.testing.assert_allclose(view.normal(0)[road].mean(axis=0), [0, -1, 0], atol=0.02)
    assert np.abs(view.normal(0)[view.semantic(0) == Semantic.SKY]).max() < 0.005
    electrons = view.load_readout(0).count_electrons(view.raw(0), RawOutput(bits=10))
    assert electrons.shape == view.hdr(0).shape[:2] == road.shape
    saturation = view.load_readout(0).saturation_cd_m2
    light = electrons / view.load_readout(0).full_well_e * saturation
    assert light[road].mean() == pytest.approx(view.hdr(0)[road].mean(), rel=0.05)
    developed = develop_raw(view.raw(0), view.agent.sensors.cameras[0].model, view.load_readout(0))
    np.testing.assert_array_equal(developed, view.image(0))
    flow, row, column = view.flow(0), *np.indices(view.instance(0).shape)
    seen = ~flow.occluded
    # Blades of grass hide one another in a picture of 96 pixels.
    assert seen.mean() > 0.75
    shift = np.nan_to_num(flow.shift_px)
    place = (row + shift[..., 1])[seen].round(), (column + shift[..., 0])[seen].round()
    after = Scenario(scenario)[1]["cav1"]
    for read in ("instance", "semantic"):
        now, then = getattr(view, read)(0)[seen], getattr(after, read)(0)
        assert (then[tuple(np.asarray(axis, int) for axis in place)] == now).mean() > 0.97


def test_the_last_frame_of_a_scenario_has_no_flow(spec: Spec, tmp_path: Path) -> None:
    small = with_small_sensors(spec).model_dump(mode="json")
    for agent in small["agents"]:
        agent["sensors"]["camera"]["truth"] = ["flow"]
    asking = with_digest(Spec.model_validate(small))
    last = load_or_simulate_traffic(asking).trace.signals.shape[0] - 1
    scenario = run_scenario(
        asking,
        RunOptions(output=tmp_path, backend="fake", scale=1.0, frames=slice(last - 1, last + 1)),
    )
    before, end = (frame["cav1"].flow(0) for frame in Scenario(scenario))
    assert np.isfinite(before.shift_px).any()
    assert not before.occluded.all()
    assert not np.isfinite(end.shift_px).any()
    assert end.occluded.all()
