"""Prams, dogs and wheelchairs: boxes that hold them, wheels and paws on the ground, busy hands."""

from itertools import pairwise

import numpy as np
import pytest
from advercity_dsl import Blueprint, Catalogue, PedestrianAppearance
from numpy.typing import NDArray
from pydantic import ValidationError

from advercity.assets.body_pose import build_pose_box_fitter, compute_body_pose
from advercity.assets.rigged_bodies import pose_body
from advercity.conflicts.case import ParticipantSampler
from advercity.frames import Actor, ActorState, Lamp
from advercity.geometry import poses
from advercity.recordings.bodies import select_blueprint
from advercity.semantics import Semantic
from advercity.testing import make_frame
from tests.shipped import CATALOGUE, ShippedBodies

PEOPLE = ShippedBodies("pedestrian")
ATTACHED = {
    name: looks.attachment
    for name, item in CATALOGUE.blueprints.items()
    if (looks := item.looks) and looks.attachment != "none"
}
everyone = pytest.mark.parametrize("name", ATTACHED)


def state(name: str, travelled_m: float, speed_m_s: float = 1.4) -> ActorState:
    return ActorState(
        actor=Actor(7, "pedestrian", name, "cloth_red", PEOPLE[name].size),
        world_from_body=poses.pose_matrix((travelled_m, 0.0, 0.0)),
        speed_m_s=speed_m_s,
        acceleration_m_s2=0.0,
        lamps=Lamp(0),
        travelled_m=travelled_m,
    )


def see(moment: ActorState, *materials: str) -> NDArray[np.float64]:
    """Points in the world of what is drawn, of some materials or of all."""
    seen = compute_body_pose(moment, PEOPLE)
    meshes = seen.shape.build_meshes(PEOPLE)
    found = [m.vertices for m in meshes if not materials or m.material in materials]
    world_from_mesh = moment.world_from_body @ seen.body_from_mesh
    return poses.transform_points(world_from_mesh, np.concatenate(found).astype(np.float64))


def test_the_catalogue_has_every_kind():
    assert set(ATTACHED.values()) == {"pram", "dog", "wheelchair", "pushed_wheelchair"}


@everyone
@pytest.mark.parametrize("speed_m_s", [0.0, 1.4])
def test_the_box_of_a_frame_touches_person_and_attachment(name: str, speed_m_s: float):
    fit = build_pose_box_fitter(PEOPLE)
    for travelled_m in (0.0, 0.3, 0.7, 1.0):
        moment = state(name, travelled_m, speed_m_s)
        (fitted,) = fit(make_frame(moment)).states
        corners = poses.transform_points(fitted.world_from_body, fitted.box.corners)
        points = see(moment)
        np.testing.assert_allclose(corners.min(axis=0), points.min(axis=0), atol=1e-4)
        np.testing.assert_allclose(corners.max(axis=0), points.max(axis=0), atol=1e-4)


@everyone
def test_all_poses_together_fill_the_declared_box(name: str):
    size = np.array(PEOPLE[name].size)
    moments = [see(state(name, float(way))) - (way, 0, 0) for way in np.linspace(0, 1.5, 100)]
    low = np.min([points.min(axis=0) for points in moments], axis=0)
    high = np.max([points.max(axis=0) for points in moments], axis=0)
    np.testing.assert_allclose(low, size * (-0.5, -0.5, 0), atol=0.05)
    np.testing.assert_allclose(high, size * (0.5, 0.5, 1), atol=0.05)


@everyone
def test_wheels_and_feet_are_on_the_ground_and_never_below_it(name: str):
    parts = {"rubber"} if ATTACHED[name] != "dog" else {"hair_brown"}
    if ATTACHED[name] != "wheelchair":
        parts.add("leather")
    for way in np.linspace(0, 1.3, 30):
        moment = state(name, float(way))
        assert see(moment)[:, 2].min() > -0.001
        for material in parts:
            assert see(moment, material)[:, 2].min() < 0.02


def test_paws_do_not_slide():
    steps_m = np.arange(0.0, 2.0, 0.05).tolist()
    fur = np.stack([see(state("pedestrian_with_dog", way), "hair_brown") for way in steps_m])
    slipped_m: list[float] = []
    for before, after in pairwise(fur):
        down = (before[:, 2] < 0.02) & (after[:, 2] < 0.02)
        slipped_m += np.linalg.norm((after - before)[down, :2], axis=1).tolist()
    # A paw turns with its leg about a point above the ground; the body goes 0.05 m meanwhile.
    assert len(slipped_m) > 100
    assert np.median(slipped_m) < 0.008


@pytest.mark.parametrize("name", ["wheelchair_user", "pushed_wheelchair"])
def test_wheels_turn_by_whole_spokes_in_a_cycle_about_as_far_as_they_roll(name: str):
    gait, tyre = PEOPLE[name].gait, next(p for p in PEOPLE[name].parts if p.material == "rubber")
    assert gait is not None and tyre.weights is not None
    (bone,) = (
        number
        for number in range(tyre.weights.shape[1])
        if not np.allclose(gait.bone_transforms[:, number], np.eye(3, 4))
        and (tyre.weights[:, number] > 0.5).any()
    )
    wheel = tyre.vertices[tyre.weights[:, bone] > 0.5]
    # The fit to the box stretches a turn, but not its trace.
    angle = np.arccos((np.trace(gait.bone_transforms[1, bone, :, :3].astype(float)) - 1.0) / 2.0)
    assert gait.bone_transforms[1, bone, 0, 2] > 0.0  # the top goes ahead
    rolled_m = angle * np.ptp(wheel[:, 2]) / 2
    assert rolled_m == pytest.approx(gait.cycle_length_m / len(gait.bone_transforms), rel=0.1)
    spokes = angle * len(gait.bone_transforms) / (2 * np.pi / 10)
    assert spokes == pytest.approx(round(spokes), abs=0.01)


@pytest.mark.parametrize("name", ["pedestrian_with_pram", "pushed_wheelchair"])
def test_hands_stay_on_what_they_push(name: str):
    made = PEOPLE[name]
    assert made.gait is not None
    for pose in range(len(made.gait.bone_transforms)):
        parts = pose_body(made, pose)
        grips = np.concatenate([p.vertices for p in parts if p.material == "black_plastic"])
        skin = np.concatenate([p.vertices for p in parts if p.material == "skin"])
        behind = grips[grips[:, 2] > 0.45 * made.size[2]]
        for left in (1, -1):
            grip = behind[np.sign(behind[:, 1]) == left]
            grip = grip[grip[:, 2] > grip[:, 2].max() - 0.05]
            gaps = np.linalg.norm(skin[:, None] - grip[None], axis=2)
            assert gaps.min() < 0.06


@everyone
def test_everything_is_of_the_person(name: str):
    assert {part.semantic for part in PEOPLE[name].parts} == {Semantic.PEDESTRIAN}
    assert PEOPLE[name].with_umbrella is None


def test_the_person_in_a_pushed_wheelchair_wears_another_top():
    materials = {part.material for part in PEOPLE["pushed_wheelchair"].parts}
    assert {"paint", "cloth_grey"} <= materials


def test_hands_that_push_hold_no_umbrella():
    with pytest.raises(ValidationError, match="hold no umbrella and no case"):
        PedestrianAppearance(attachment="pram", umbrella="red")


def test_fractions_are_of_pedestrians_and_add_up_to_1_or_less():
    car = CATALOGUE.blueprints["lincoln_mkz_2017"].model_dump()
    with pytest.raises(ValidationError, match="for pedestrians and trucks, not for a car"):
        Blueprint.model_validate(car | {"fraction": 0.1})
    dog = CATALOGUE.blueprints["pedestrian_with_dog"].model_copy(update={"fraction": 0.6})
    twice = {"one": dog.model_dump(), "other": dog.model_dump()}
    with pytest.raises(ValidationError, match=r"add up to 1\.2"):
        Catalogue.model_validate({"id": "c", "ego": "one", "blueprints": twice})


def test_staged_and_recorded_pedestrians_have_nothing_with_them():
    blueprints = CATALOGUE.blueprints
    for number in range(40):
        staged = ParticipantSampler(blueprints, number, "ui").draw_actor(["pedestrian"])
        assert staged.name not in ATTACHED
        size = (1.8, 0.55, 1.7)  # that of the one with a pram
        assert select_blueprint(blueprints, "pedestrian", size, number) not in ATTACHED
