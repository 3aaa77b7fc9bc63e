"""Traces of the Open Simulation Interface: motion by hand, and what betterosi reads."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from advercity_dsl import Spec
from advercity_exports.openscenario import load_dataset_traffic

from advercity.dataset.reader import open_dataset
from advercity.exports.exporting import export_dataset
from advercity.pipeline.preparation import load_or_simulate_traffic
from advercity.roads.road_network import build_road
from advercity.sensors.agent_poses import AgentPoses
from tests.exports.readers import needs_readers, run_reader
from tests.exports.recorded_dataset import FIRST_FRAME, FRAMES
from tests.exports.recorded_dataset import recorded_dataset as recorded_dataset  # a fixture
from tests.recordings.recorded_files import GRADE

NAME = "hill_fog_day_sparse"


@pytest.fixture(scope="module")
def exported(recorded_dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("osi3")
    output = tmp_path_factory.mktemp("osi") / "out"
    return export_dataset("osi", recorded_dataset, output).output / NAME


def read_truths(path: Path) -> list[Any]:
    """Read a trace as its format says: every message after its length."""
    from osi3.osi_groundtruth_pb2 import GroundTruth  # pyright: ignore[reportMissingTypeStubs]

    raw, found = path.read_bytes(), list[Any]()
    while raw:
        length = int.from_bytes(raw[:4], "little")
        found.append(GroundTruth.FromString(raw[4 : 4 + length]))
        raw = raw[4 + length :]
    return found


def test_objects_move_as_computed_by_hand(exported: Path) -> None:
    """At 1 s, the ego is at x = 60.5 with 11 m/s and accelerates by 1 m/s², up a hill of 3 %."""
    truths = read_truths(exported / "ground_truth_gt.osi")
    assert len(truths) == FRAMES
    objects = {item.id.value: item for item in truths[0].moving_object}
    assert {*objects} == {101, 102, 1001, 5001}
    ego, climb = objects[101].base, math.atan(GRADE)
    up_m = ego.dimension.height / 2
    # The middle of the box is above the road, square to it.
    assert ego.position.x == pytest.approx(60.5 - up_m * math.sin(climb), abs=1e-3)
    assert ego.position.y == pytest.approx(-1.75, abs=1e-6)
    assert ego.position.z == pytest.approx(GRADE * 60.5 + up_m * math.cos(climb), abs=2e-3)
    assert (ego.velocity.x, ego.velocity.y) == pytest.approx((11.0, 0.0), abs=1e-3)
    assert ego.velocity.z == pytest.approx(GRADE * 11, abs=2e-3)
    assert ego.acceleration.x == pytest.approx(1.0, abs=0.02)
    assert ego.orientation.pitch == pytest.approx(-climb, abs=1e-4)  # nose up
    assert ego.orientation.yaw == pytest.approx(0.0, abs=1e-6)
    other = objects[1001].base
    assert abs(other.orientation.yaw) == pytest.approx(math.pi, abs=1e-5)
    assert other.orientation.pitch == pytest.approx(climb, abs=1e-4)  # nose down
    assert other.velocity.x == pytest.approx(-8.0, abs=1e-3)
    front = objects[101].vehicle_attributes.bbcenter_to_front
    assert front.x == pytest.approx(0.3 * ego.dimension.length)


@needs_readers
def test_a_reader_finds_objects_where_the_traffic_has_them(
    exported: Path, recorded_dataset: Path
) -> None:
    found = run_reader("read_osi.py", exported / "ground_truth_gt.osi", exported / "cav2_sv.osi")
    scenario = open_dataset(recorded_dataset).scenarios[0]
    poses = AgentPoses(scenario.spec, load_dataset_traffic(scenario).trace)

    assert len(found["truths"]) == len(found["views"]) == FRAMES
    for number, truth in enumerate(found["truths"]):
        frame = poses.load_frame(FIRST_FRAME + number)
        assert truth["time_s"] == pytest.approx(scenario[number].time_s)
        assert (truth["version"][0], truth["host"]) == (3, 101)
        assert {int(name) for name in truth["objects"]} == {
            state.actor.id for state in frame.states
        }
        for state in frame.states:
            item = truth["objects"][str(state.actor.id)]
            assert item["place"] == pytest.approx(state.box_centre.tolist())
            assert item["size"] == pytest.approx(state.box.size)
            speed = float(np.linalg.norm(item["velocity"]))
            assert speed == pytest.approx(state.speed_m_s, abs=0.01)
        assert truth["objects"]["5001"]["type"] == "PEDESTRIAN"
        assert truth["objects"]["102"]["brakes"] == "NORMAL"  # it is held
        assert truth["objects"]["101"]["brakes"] == "OFF"
        # 75 m are from 50 to 200 m, which is called thick.
        assert (truth["fog"], truth["precipitation"]) == ("THICK", "NONE")
        assert truth["wind"][0] == pytest.approx(math.radians(250))
    for (host, view), truth in zip(found["views"], found["truths"], strict=True):
        assert (host, view["host"]) == (102, 102)
        assert view["objects"] == truth["objects"]


@pytest.mark.sumo
def test_bulbs_are_lit_by_what_the_lights_show(specs: dict[str, Spec]) -> None:
    pytest.importorskip("osi3")
    from advercity_exports.osi_trace import TruthBuilder

    spec = specs["ui_clear_day_sparse"]
    trace = load_or_simulate_traffic(spec).trace
    builder = TruthBuilder(spec, AgentPoses(spec, trace))
    frame = trace.build_frame(20)
    lit = [
        light.classification.color - 2  # red, yellow, green
        for light in builder.build_truth(20).traffic_light
        if light.classification.mode == 3  # constant
    ]
    heads = build_road(spec.road).traffic_lights
    assert sorted(lit) == sorted(int(frame.signals[head.id]) for head in heads)
    assert {head.id for head in heads} == set(trace.signal_ids)
