"""Semi-trailers as a dataset annotates them, and as exports name them."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import fromstring

import numpy as np
import pytest
import yaml
from advercity_dsl import Spec
from advercity_exports.openscenario import format_scenario
from advercity_exports.osi_trace import TruthBuilder

from advercity.dataset.reader import open_dataset
from advercity.exports.exporting import export_dataset
from advercity.frames import Actor, ActorState, Frame, Lamp
from advercity.geometry import poses
from advercity.pipeline.preparation import TrafficResult, load_or_simulate_traffic
from advercity.sensors.agent_poses import AgentPoses
from tests.builders import (
    WORLD_FROM_STREET,
    ask_for_instances,
    frame_of,
    sensor_frame_of,
    write_scenario,
)
from tests.shipped import CATALOGUE

TRACTOR, TRAILER = 1001, 101_001
PLACE = (30.0, -4.0)
"""Along the street and to its left, of the tractor unit; the semi-trailer is 6.65 m behind it."""


def make_lorry() -> tuple[ActorState, ActorState]:
    """A lorry in line that brakes."""
    states: list[ActorState] = []
    for number, name, along, towed_by in (
        (TRACTOR, "lorry_tractor", 0.0, 0),
        (TRAILER, "curtain_semitrailer", -6.65, TRACTOR),
    ):
        blueprint = CATALOGUE.blueprints[name]
        actor = Actor.from_blueprint(number, name, blueprint, "car_paint_blue", towed_by=towed_by)
        pose = WORLD_FROM_STREET @ poses.pose_matrix((PLACE[0] + along, PLACE[1], 0.0))
        states.append(ActorState(actor, pose, 6.0, -1.0, Lamp.BRAKE))
    return states[0], states[1]


def build_frame(spec: Spec, index: int) -> Frame:
    frame = frame_of(spec, index)
    return replace(frame, states=(*frame.states, *make_lorry()))


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory, spec: Spec) -> Path:
    root = tmp_path_factory.mktemp("lorry")
    digested = ask_for_instances(spec)
    write_scenario(
        root,
        digested,
        lambda index: tuple(
            sensor_frame_of(agent, build_frame(digested, index)) for agent in digested.agents
        ),
        frames=2,
    )
    return root


def test_the_yaml_has_both_and_who_tows(dataset: Path):
    path = min(dataset.glob("*/*101/*.yaml"))
    vehicles = yaml.safe_load(path.read_text())["vehicles"]

    tractor, trailer = vehicles[TRACTOR], vehicles[TRAILER]
    assert (tractor["class"], trailer["class"]) == ("truck", "truck")
    assert trailer["towed_by"] == TRACTOR
    assert "towed_by" not in tractor
    assert trailer["extent"] == [6.8, 1.275, 2.0]
    assert {one for one, item in vehicles.items() if "towed_by" in item} == {TRAILER}


def test_a_reader_has_both_with_their_own_boxes(dataset: Path):
    view = open_dataset(dataset).scenarios[0][0]["cav1"]
    boxes = view.boxes
    rows = {number: row for row, number in enumerate(boxes.ids.tolist())}
    tractor, trailer = rows[TRACTOR], rows[TRAILER]

    assert boxes.towed_by[[tractor, trailer]].tolist() == [0, TRACTOR]
    assert not boxes.select(boxes.towed_by == 0).towed_by.any()
    apart = boxes.world_from_box[tractor, :3, 3] - boxes.world_from_box[trailer, :3, 3]
    # The middles of the boxes are 6.65 m apart along the street, 0.1 m square to it.
    assert np.linalg.norm(apart) == pytest.approx(np.hypot(6.65, 0.1), abs=1e-3)
    extras = view.extras["objects"]
    assert extras[str(TRAILER)]["towed_by"] == TRACTOR
    assert extras[str(TRAILER)]["lamps"] == extras[str(TRACTOR)]["lamps"] == ["brake"]


def load_json(folder: Path, name: str) -> Any:
    (path,) = folder.rglob(name)
    return json.loads(path.read_text())


def test_nuscenes_has_a_category_of_trailers(dataset: Path, tmp_path: Path):
    folder = export_dataset("nuscenes", dataset, tmp_path / "out").output
    names = {row["token"]: row["name"] for row in load_json(folder, "category.json")}
    instances = load_json(folder, "instance.json")

    found = {row["object_id"]: names[row["category_token"]] for row in instances}
    assert found[TRAILER] == "vehicle.trailer"
    assert found[TRACTOR] == "vehicle.truck"
    assert {row["object_id"]: row.get("towed_by") for row in instances}[TRAILER] == TRACTOR


def test_kitti_has_trailers_among_its_miscellaneous(dataset: Path, tmp_path: Path):
    folder = export_dataset("kitti", dataset, tmp_path / "out").output
    lines = [
        line.split()
        for path in folder.rglob("label_2/*.txt")
        for line in path.read_text().splitlines()
    ]
    lengths = {(line[0], float(line[10])) for line in lines}
    assert ("Misc", 13.6) in lengths
    assert ("Truck", 6.1) in lengths
    assert ("Truck", 13.6) not in lengths


def test_coco_has_one_truck_of_both(dataset: Path, tmp_path: Path):
    folder = export_dataset("coco", dataset, tmp_path / "out").output
    coco = load_json(folder, "instances.json")
    trucks = {row["image_id"]: row for row in coco["annotations"] if row["object_id"] == TRACTOR}
    assert all(row["object_id"] != TRAILER for row in coco["annotations"])
    scenario = open_dataset(dataset).scenarios[0]
    joined = 0
    for image in coco["images"]:
        view = scenario.frame(image["frame"])[image["agent"]]
        instance = view.instance(image["camera"])
        area = np.isin(instance, (TRACTOR, TRAILER)).sum()
        assert (image["id"] in trucks) == (area > 0)
        if area > 0:
            truck = trucks[image["id"]]
            assert (truck["category_id"], truck["iscrowd"], truck["area"]) == (8, 0, area)
            parts = [
                view.extras["objects"][str(number)]["cameras"][f"camera{image['camera']}"]
                for number in (TRACTOR, TRAILER)
                if (instance == number).any()
            ]
            shares = [part["visible_fraction"] for part in parts]
            assert min(shares) - 1e-4 <= truck["visible_fraction"] <= max(shares) + 1e-4
            joined += len(parts) == 2
    assert joined > 0


def test_openlabel_has_who_tows(dataset: Path, tmp_path: Path):
    folder = export_dataset("openlabel", dataset, tmp_path / "out").output
    document = json.loads(next(folder.glob("*.json")).read_text())
    frames = document.get("openlabel", {}).get("frames", {})
    numbers = next(iter(frames.values()))["objects"][str(TRAILER)]["object_data"]["num"]
    assert {"name": "towed_by", "val": TRACTOR} in numbers


@pytest.fixture(scope="module")
def traffic(specs: dict[str, Spec]) -> TrafficResult:
    return load_or_simulate_traffic(specs[SHIPPED])


SHIPPED, SEMITRAILER = "rcnj_clear_day_sparse", "curtain_semitrailer"


@pytest.mark.sumo
def test_openscenario_has_semitrailers_at_their_axles(
    specs: dict[str, Spec], traffic: TrafficResult
):
    pytest.importorskip("scenariogeneration")
    trailer = next(one for one in traffic.trace.actors if one.blueprint == SEMITRAILER)
    name = f"truck_{trailer.id}"

    document = fromstring(format_scenario(specs[SHIPPED], traffic))

    (vehicle,) = document.findall(f"Entities/ScenarioObject[@name='{name}']/Vehicle")
    assert vehicle.attrib["vehicleCategory"] == "semitrailer"
    properties = {one.attrib["name"]: one.attrib["value"] for one in vehicle.iter("Property")}
    assert properties["towed_by"] == str(trailer.towed_by)
    centre, axle = vehicle.find("BoundingBox/Center"), vehicle.find("Axles/FrontAxle")
    assert centre is not None and axle is not None
    # Its axles are 7.7 m behind the kingpin, which is 5.2 m before the middle.
    assert float(centre.attrib["x"]) == pytest.approx(2.5)
    assert float(axle.attrib["positionX"]) == pytest.approx(7.7)
    row = traffic.trace.get_track(trailer.id)[1][0]
    (place, *_) = (
        point
        for item in document.iter("Trajectory")
        if item.get("name") == f"{name}_trajectory"
        for point in item.iter("WorldPosition")
    )
    behind = 2.5 * math.cos(row["pitch"])
    assert float(place.attrib["x"]) == pytest.approx(
        row["x"] - behind * math.cos(row["yaw"]), abs=1e-5
    )
    assert float(place.attrib["y"]) == pytest.approx(
        row["y"] - behind * math.sin(row["yaw"]), abs=1e-5
    )


@pytest.mark.sumo
def test_osi_has_tractor_units_with_their_semitrailers(
    specs: dict[str, Spec], traffic: TrafficResult
):
    osi = pytest.importorskip("osi3.osi_object_pb2")
    kinds = osi.MovingObject.VehicleClassification
    spec, trace = specs[SHIPPED], traffic.trace
    number = next(one.id for one in trace.actors if one.blueprint == SEMITRAILER)
    trailer, rows = trace.get_track(number)

    truth = TruthBuilder(spec, AgentPoses(spec, trace)).build_truth(int(rows["tick"][0]))

    objects = {item.id.value: item for item in truth.moving_object}
    towing = objects[trailer.towed_by].vehicle_classification
    assert (towing.type, towing.has_trailer) == (kinds.TYPE_SEMITRACTOR, True)
    assert towing.trailer_id.value == trailer.id
    towed = objects[trailer.id]
    assert towed.vehicle_classification.type == kinds.TYPE_SEMITRAILER
    assert not towed.vehicle_classification.has_trailer
    assert towed.vehicle_attributes.bbcenter_to_front.x == pytest.approx(5.2)
    assert towed.vehicle_attributes.bbcenter_to_rear.x == pytest.approx(-2.5)
    assert towed.vehicle_attributes.number_wheels == 6
