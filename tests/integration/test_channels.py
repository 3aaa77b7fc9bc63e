"""V2X channels, from the declaration to files, readers, verification and repair."""

import json
import math
import pickle
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from advercity_benchmark.detector.clouds import check_frames, load_clouds
from advercity_dsl import Spec

import advercity
from advercity.compiler.crossing import compile_library
from advercity.dataset.reader import FrameView, Scenario
from advercity.dataset.received_messages import load_sent_messages
from advercity.dataset.verification import verify_dataset
from advercity.errors import InputError
from advercity.pipeline import RunOptions, repair_dataset, run_scenario
from advercity.pipeline.replay import write_recording
from advercity.sensors.messages import MessageKind
from advercity.testing import hash_tree
from tests.builders import describe_errors, write_small_library

pytestmark = pytest.mark.sumo

CHANNEL = """
kind: channel
id: tested
radio: {}
latency: {minimum_s: 0.1, jitter_s: 0.02}
lifetime_s: 0.3
loss: {rate: 20 %}
pose_error: {white_noise_m: 1 m, heading_noise_deg: 5 deg}
clock: {offset_s: 0.01}
cpm: {min_points: 1, range_noise_m: 0.2, bearing_noise_deg: 0.5}
"""
RIG = """
kind: rig
id: one_camera
vehicle:
  camera: {width_px: 32, height_px: 16, mounts: [{z_m: 2}]}
  lidar: {mount: {x_m: 1, z_m: 2}, channels: 8, azimuths: 360, range_m: 150}
roadside_unit:
  camera: {width_px: 32, height_px: 16, mounts: [{}]}
  lidar: {channels: 8, azimuths: 360, range_m: 150}
"""
SUITE = """
kind: suite
id: small
rig: one_camera
channel: tested
catalogue: one_car
looks: shaped
"""
FRAMES = 6


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("channels") / "library"
    return write_small_library(folder, channel=CHANNEL, rig=RIG, suite=SUITE)


@pytest.fixture(scope="module")
def spec(library: Path) -> Spec:
    (compiled,) = compile_library(library)
    return compiled


def make_options(root: Path) -> RunOptions:
    return RunOptions(output=root, backend="fake", profile="preview", frames=slice(0, FRAMES))


@pytest.fixture(scope="module")
def dataset(spec: Spec, tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("sent")
    run_scenario(spec, make_options(root))
    return root / spec.id


@pytest.fixture(scope="module")
def plain(library: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same scenario without a channel."""
    root = tmp_path_factory.mktemp("silent")
    copied = shutil.copytree(library, root / "library")
    (copied / "suite.yaml").write_text(SUITE.replace("channel: tested\n", ""))
    (spec,) = compile_library(copied)
    run_scenario(spec, make_options(root))
    return root / spec.id


def test_a_detector_gets_what_has_arrived_where_its_sender_believed_to_be(dataset: Path) -> None:
    scenario, arrived = Scenario(dataset), 0
    check_frames(list(scenario), "late", is_ideal=False)
    with pytest.raises(InputError, match="channel 'tested' sends no data, in which early fusion"):
        check_frames(list(scenario), "early", is_ideal=False)
    for frame in scenario:
        ego = scenario.spec.ego.id
        own, *others = load_clouds(frame, "late", is_ideal=False)
        received = {
            message.sender: message
            for message in frame.messages(ego)
            if message.kind == MessageKind.CPM
        }
        assert {cloud.view.agent.id for cloud in others} == set(received)
        for cloud in others:
            message = received[cloud.view.agent.id]
            assert cloud.view.index == frame.index - round(message.age_s / 0.1) < frame.index
            place = frame[ego].world_from_lidar @ cloud.ego_from_station
            np.testing.assert_allclose(place[:2, 3], message.world_from_lidar[:2, 3], atol=0.02)
            arrived += 1
        assert own.view.agent.id == ego
    assert arrived >= 3


def write_library(folder: Path, channel: str = CHANNEL, suite: str = SUITE) -> Path:
    return write_small_library(folder / "library", channel=channel, rig=RIG, suite=suite)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "latency: {minimum_s: 0.1",
            "latency: {minimum_s: 11 s",
            "channel.yaml:5:22: latency.minimum_s: 11 s is outside the range of 0 to 10 s",
        ),
        (
            "radio: {}",
            "radio: {frequency_mhz: 63 GHz}",
            "channel.yaml:4:24: radio.frequency_mhz: 63 GHz is outside the range of 1000 to",
        ),
        (
            "loss: {rate: 20 %}",
            "loss: {rates: 20 %}",
            "channel.yaml:7:8: loss.rates: no such field; did you mean 'rate'?",
        ),
        (
            "minimum_s: 0.1,",
            "minimum_s: 0.3,",
            "latency.minimum_s: 0.3 s is not below lifetime_s, 0.3 s",
        ),
        (
            "cpm: {min_points: 1,",
            "cpm: {period_s: 0.25,",
            "channel.yaml:10:17: cpm.period_s: 0.25 s is no multiple of tick_s of suite 'small'",
        ),
    ],
)
def test_what_no_channel_has_is_refused_where_it_is_written(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    assert old in CHANNEL
    assert message in describe_errors(write_library(tmp_path, CHANNEL.replace(old, new)))


def test_a_channel_that_sends_nothing_is_refused(tmp_path: Path) -> None:
    channel = "kind: channel\nid: tested\ncam: null\ncpm: null\n"
    assert "sends nothing" in describe_errors(write_library(tmp_path, channel))


def test_an_unknown_channel_is_refused_with_a_name_that_exists(tmp_path: Path) -> None:
    text = describe_errors(write_library(tmp_path, suite=SUITE.replace("l: tested", "l: test")))
    assert text == "suite.yaml:5:10: channel: unknown channel 'test'; did you mean 'tested'?"


def test_a_sweep_varies_a_channel_and_keeps_the_traffic(tmp_path: Path) -> None:
    sweep = "sweep: {field: channel.latency.minimum_s, values: [0 s, 0.2 s]}\n"
    specs = compile_library(write_library(tmp_path, suite=SUITE + sweep))
    channels = [spec.channel for spec in specs]
    assert [one.latency.minimum_s for one in channels if one] == [0.0, 0.2]
    assert len({spec.seeds.traffic for spec in specs}) == 1
    assert specs[1].id.endswith("minimum_s_0p2")


@pytest.mark.parametrize(
    ("suite", "message"),
    [
        (
            SUITE.replace("channel: tested\n", "")
            + "sweep: {field: channel.loss.rate, values: [0.1]}\n",
            "sweep.field: the suite has no channel",
        ),
        (
            SUITE + "sweep: {field: channel.cpm.period_s, values: [0.1, 0.25]}\n",
            "channel.cpm.period_s of 0.25 is not valid: 0.25 s is no multiple of tick_s",
        ),
    ],
)
def test_a_sweep_of_channels_is_checked(tmp_path: Path, suite: str, message: str) -> None:
    assert message in describe_errors(write_library(tmp_path, suite=suite))


def test_a_spec_without_a_channel_does_not_mention_it(plain: Path) -> None:
    spec = Scenario(plain).spec
    assert "channel" not in spec.model_dump(mode="json")
    with pytest.raises(InputError, match="has no messages: its suite names no channel"):
        Scenario(plain)[0].messages("cav1")


def test_loaders_of_opv2v_find_every_other_file_as_without_a_channel(
    dataset: Path, plain: Path
) -> None:
    with_channel, without = hash_tree(dataset), hash_tree(plain)
    more = with_channel.keys() - without.keys()
    assert len(more) == 2 * FRAMES
    assert all(name.endswith("_messages.json") for name in more)
    own = {"manifest.json", "data_protocol.yaml"}
    assert {k: v for k, v in without.items() if k not in own} == {
        k: v for k, v in with_channel.items() if k not in more | own
    }


def list_expected(scenario: Scenario, frame: FrameView) -> set[tuple[str, int]]:
    """Kind and frame of all messages of rsu1 that have arrived at cav1, from the files alone."""
    folder = scenario.path / "-1"
    found: set[tuple[str, int]] = set()
    for path in sorted(folder.glob("*_messages.json")):
        document = json.loads(path.read_text())
        age_s = 0.1 * (frame.index - document["frame"])
        for message in document["messages"]:
            delivery = message["deliveries"]["cav1"]
            if 0 <= age_s <= 0.3 + 1e-9 and delivery.get("delay_s", math.inf) <= age_s:
                found.add((message["kind"], document["frame"]))
    return found


def test_an_agent_has_what_has_arrived_and_nothing_else(dataset: Path) -> None:
    scenario = Scenario(dataset)
    arrived = 0
    for frame in scenario:
        messages = frame.messages("cav1", latest=False)
        found = {(message.kind.value, message.view.index) for message in messages}
        assert found == list_expected(scenario, frame)
        arrived += len(found)
        newest = {kind: max(index for one, index in found if one == kind) for kind, _ in found}
        latest = frame.messages("cav1")
        assert {message.kind.value: message.view.index for message in latest} == newest
        for message in latest:
            assert message.sender == "rsu1"
            assert 0.1 <= message.age_s <= 0.3 + 1e-9
            assert message.age_s == pytest.approx(0.1 * (frame.index - message.view.index))
            assert 0 <= message.arrived_s <= message.age_s - 0.1 + 1e-9
    assert arrived > FRAMES
    # Delays are at least a tick.
    assert scenario[0].messages("cav1") == ()


def test_ages_by_the_clocks_differ_by_the_offset_of_both(dataset: Path) -> None:
    frame = Scenario(dataset)[3]
    offsets = {name: load_sent_messages(frame[name]).clock_offset_s for name in ("cav1", "rsu1")}
    assert 1e-4 < abs(offsets["cav1"] - offsets["rsu1"]) < 0.05
    for message in frame.messages("cav1"):
        difference = message.clock_age_s - message.age_s
        assert difference == pytest.approx(offsets["cav1"] - offsets["rsu1"], abs=1e-6)


def test_a_message_has_the_senders_data_and_the_pose_that_it_believes(dataset: Path) -> None:
    """The LiDAR is 1 m ahead of the vehicle's origin, so its place errs with the heading too."""
    frame = next(frame for frame in Scenario(dataset) if frame.messages("rsu1"))
    message = frame.messages("rsu1")[0]
    sender = Scenario(dataset).frame(message.view.index)["cav1"]
    np.testing.assert_array_equal(message.view.points, sender.points)
    error = message.station.world_from_station[:3, 3] - sender.world_from_agent[:3, 3]
    assert 0.01 < np.linalg.norm(error[:2]) < 5.0
    believed = message.world_from_lidar
    true = sender.world_from_lidar
    offset = message.station.world_from_station[:3, :3] @ (1.0, 0.0, 2.0)
    np.testing.assert_allclose(
        believed[:3, 3], message.station.world_from_station[:3, 3] + offset, atol=0.05
    )
    assert np.abs(believed[:3, :3] - true[:3, :3]).max() > 1e-3
    assert message.station.speed_m_s == pytest.approx(sender.speed_m_s, abs=1e-6)
    assert pickle.loads(pickle.dumps(message)).sender == "cav1"


def test_perceived_objects_are_where_they_are_but_for_their_errors(dataset: Path) -> None:
    """A roadside unit is surveyed: only its errors of perception are left."""
    counted = 0
    for frame in Scenario(dataset):
        for message in frame.messages("cav1"):
            if message.kind is not MessageKind.CPM:
                assert message.objects is None
                assert message.world_from_objects.shape == (0, 4, 4)
                continue
            assert message.objects is not None
            boxes = message.view.boxes
            for row, number in enumerate(message.objects.ids.tolist()):
                (at,) = np.flatnonzero(boxes.ids == number)
                error = message.world_from_objects[row] - boxes.world_from_box[at]
                sd_m = math.sqrt(np.trace(message.objects.position_covariances_m2[row]))
                assert np.linalg.norm(error[:2, 3]) < 4 * sd_m
                assert abs(error[2, 3]) < 1e-5
                assert boxes.lidar_points[at] >= 1
                assert message.objects.classes[row] == boxes.classes[at]
                np.testing.assert_allclose(message.objects.sizes_m[row], boxes.sizes[at], atol=1e-5)
                counted += 1
    assert counted > 0


def test_frames_in_any_order_give_the_same_bytes(dataset: Path, spec: Spec, tmp_path: Path) -> None:
    for frames in (slice(3, FRAMES), slice(0, 3)):
        run_scenario(spec, replace(make_options(tmp_path), frames=frames))
    again = tmp_path / spec.id
    names = [path.relative_to(dataset) for path in dataset.glob("*/*_messages.json")]
    assert len(names) == 2 * FRAMES
    for name in names:
        assert (again / name).read_bytes() == (dataset / name).read_bytes()


def test_message_files_are_verified_repaired_and_skipped_by_recordings(
    dataset: Path, tmp_path: Path
) -> None:
    assert verify_dataset(dataset.parent) == []
    write_recording(dataset, tmp_path / "again.rrd")
    lost = dataset / "-1" / "000061_messages.json"
    content = lost.read_bytes()
    lost.write_bytes(content[:-9])
    assert [problem.path for problem in verify_dataset(dataset.parent)] == [f"-1/{lost.name}"]
    with pytest.raises(InputError, match="000061_messages"):
        Scenario(dataset)[2].messages("cav1")
    lost.unlink()
    with pytest.raises(InputError, match=r"000061_messages.json.*is missing"):
        Scenario(dataset)[2].messages("cav1")
    assert repair_dataset(dataset) == []
    assert lost.read_bytes() == content


def test_a_dataset_opens_with_messages_by_the_public_way_in(dataset: Path) -> None:
    found = [len(frame.messages("cav1")) for frame in advercity.open_dataset(dataset)]
    assert sum(found) > 0
