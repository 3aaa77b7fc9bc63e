"""Rigged bodies: feet that do not slide, boxes that hold every pose, riders, umbrellas."""

from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from advercity_dsl import Blueprint, PedestrianAppearance, Weather
from numpy.typing import NDArray

from advercity.assets.bodies import build_body
from advercity.assets.body_pose import build_pose_box_fitter, compute_body_pose
from advercity.assets.rigged_bodies import pose_body
from advercity.frames import Actor, ActorState, Frame, Lamp
from advercity.geometry import poses
from advercity.geometry.mesh import Mesh
from advercity.materials import ACTOR_PAINT
from advercity.physics.atmosphere import compute_atmosphere
from advercity.rendering.backend import RENDER_PROFILES, CameraView
from advercity.rendering.raycaster import Raycaster, Rays
from advercity.scene.world_storage import load_body, save_body
from advercity.semantics import Semantic
from advercity.testing import make_frame
from advercity.world import Body, World
from tests.requirements import require
from tests.shipped import CATALOGUE, LIBRARY, ShippedBodies

PEOPLE, CYCLISTS = ShippedBodies("pedestrian"), ShippedBodies("bicycle")
PEOPLE_AND_CYCLISTS = ShippedBodies("pedestrian", "bicycle")
WALKERS = [name for name in PEOPLE if name.startswith("pedestrian_0")]
"""People without a pram, a dog or a wheelchair."""
everybody = pytest.mark.parametrize("name", WALKERS)
every_cyclist = pytest.mark.parametrize("name", CYCLISTS)


def state(
    name: str, *, travelled_m: float = 0.0, speed_m_s: float = 1.5, umbrella: bool = False
) -> ActorState:
    """State of an actor that has moved along x from the origin."""
    return ActorState(
        actor=Actor(
            7,
            CATALOGUE.blueprints[name].actor_class,
            name,
            "cloth_red",
            PEOPLE_AND_CYCLISTS[name].size,
        ),
        world_from_body=poses.pose_matrix((travelled_m, 0.0, 0.0)),
        speed_m_s=speed_m_s,
        acceleration_m_s2=0.0,
        lamps=Lamp(0),
        travelled_m=travelled_m,
        umbrella=umbrella,
    )


def somebody(length_m: float = 1.0, looks: PedestrianAppearance | None = None) -> Blueprint:
    return Blueprint(
        actor_class="pedestrian", length_m=length_m, width_m=0.55, height_m=1.75, looks=looks
    )


def vertices(meshes: tuple[Mesh, ...], material: str | None = None) -> NDArray[np.float64]:
    """Points that triangles use, in an order that does not depend on the pose."""
    chosen = [mesh for mesh in meshes if material in (None, mesh.material)]
    return np.concatenate([m.vertices[np.unique(m.triangles)] for m in chosen]).astype(np.float64)


def in_world(moment: ActorState, material: str | None = None) -> NDArray[np.float64]:
    seen = compute_body_pose(moment, PEOPLE_AND_CYCLISTS)
    points = vertices(seen.shape.build_meshes(PEOPLE_AND_CYCLISTS), material)
    return poses.transform_points(moment.world_from_body @ seen.body_from_mesh, points)


@everybody
@pytest.mark.parametrize("speed_m_s", [0.0, 1.5])
def test_the_box_of_a_pedestrian_touches_the_body_as_drawn(name: str, speed_m_s: float):
    fit = build_pose_box_fitter(PEOPLE)
    for travelled_m in np.arange(0.0, 1.4, 0.2).tolist():
        moment = state(name, travelled_m=travelled_m, speed_m_s=speed_m_s)
        (fitted,) = fit(make_frame(moment)).states
        corners = poses.transform_points(fitted.world_from_body, fitted.box.corners)
        body = in_world(moment)
        np.testing.assert_allclose(corners.min(axis=0), body.min(axis=0), atol=1e-4)
        np.testing.assert_allclose(corners.max(axis=0), body.max(axis=0), atol=1e-4)


def test_an_umbrella_does_not_change_the_box_of_who_holds_it():
    fit = build_pose_box_fitter(PEOPLE)
    boxes = [
        fit(make_frame(state("pedestrian_0003", travelled_m=0.3, umbrella=umbrella))).states[0].box
        for umbrella in (False, True)
    ]
    assert boxes[0] == boxes[1]


@everybody
def test_a_foot_on_the_ground_does_not_slide(name: str):
    steps_m = np.arange(0.0, 3.0, 0.05)
    shoes = np.stack([in_world(state(name, travelled_m=float(way)), "leather") for way in steps_m])
    slipped_m: list[float] = []
    for side in (1, -1):
        foot = shoes[:, np.sign(shoes[0, :, 1]) == side]
        lowest = foot[..., 2].argmin(axis=1)
        for before, after, point in zip(foot[:-1], foot[1:], lowest[:-1], strict=True):
            if max(before[point, 2], after[point, 2]) < 0.006:
                slipped_m.append(float(np.linalg.norm(after[point, :2] - before[point, :2])))
    # A heel is round and rolls a little; else a foot has a hundredth of the body's speed.
    assert len(slipped_m) > 20
    assert max(slipped_m) < 0.012
    assert np.median(slipped_m) < 0.0005


@everybody
def test_a_foot_is_always_on_the_ground_and_never_below_it(name: str):
    for way in np.linspace(0, 2, 40):
        lowest = in_world(state(name, travelled_m=float(way)))[:, 2].min()
        assert -0.001 < lowest < 0.012


@everybody
def test_a_walker_keeps_to_the_box_at_every_moment_and_fills_it_in_the_course_of_a_stride(
    name: str,
):
    size = np.array(PEOPLE[name].size)
    moments = [
        in_world(state(name, travelled_m=float(way))) - (way, 0, 0)
        for way in np.linspace(0, 1.4, 200)
    ]
    low = np.min([points.min(axis=0) for points in moments], axis=0)
    high = np.max([points.max(axis=0) for points in moments], axis=0)
    assert (low >= size * (-0.5, -0.5, 0) - 0.001).all()
    assert (high <= size * (0.5, 0.5, 1) + 0.001).all()
    np.testing.assert_allclose(low, size * (-0.5, -0.5, 0), atol=0.03)
    np.testing.assert_allclose(high[:2], size[:2] / 2, atol=0.03)


@everybody
def test_a_stationary_pedestrian_is_upright_and_as_high_and_wide_as_the_box(name: str):
    size = PEOPLE[name].size
    points = in_world(state(name, speed_m_s=0.0))
    assert np.ptp(points[:, 1]) == pytest.approx(size[1], abs=0.03)
    assert np.ptp(points[:, 2]) == pytest.approx(size[2], abs=0.03)
    assert points[:, 2].min() == pytest.approx(0.0, abs=0.01)
    shoes = in_world(state(name, speed_m_s=0.0), "leather")
    assert np.ptp(shoes[:, 0]) < 0.2 * size[2]


@everybody
def test_steps_are_those_of_people(name: str):
    gait = PEOPLE[name].gait
    assert gait is not None
    steps_per_s = 1.4 / (gait.cycle_length_m / 2)
    assert 0.6 < gait.cycle_length_m / PEOPLE[name].size[2] < 0.8
    assert 1.8 < steps_per_s < 4.2
    if PEOPLE[name].size[2] > 1.5:
        assert steps_per_s < 2.7


def test_people_who_walk_side_by_side_do_not_march_in_step():
    seen = {
        compute_body_pose(
            replace(one, actor=replace(one.actor, id=number)), PEOPLE
        ).shape.pose_index
        for number in range(5001, 5013)
        for one in [state("pedestrian_0001")]
    }
    assert len(seen) > 6


def test_no_two_people_of_the_catalogue_look_alike():
    assert len(PEOPLE) >= 12
    worn = {
        name: (made.size, tuple(part.material for part in made.parts))
        for name, made in PEOPLE.items()
    }
    for one, other in combinations(worn, 2):
        higher = abs(worn[one][0][2] - worn[other][0][2]) > 0.05
        assert higher or worn[one][1] != worn[other][1]
    assert len({materials for _, materials in worn.values()}) >= 12


def test_a_longer_box_makes_longer_steps():
    def stride_m(length_m: float) -> float:
        made = build_body("walker", somebody(length_m))
        assert made.gait is not None
        return made.gait.cycle_length_m

    assert 0.2 < stride_m(0.6) < 0.75 * stride_m(0.9) < stride_m(0.9) < stride_m(1.1)


def test_an_umbrella_is_held_up_over_the_same_steps():
    made = PEOPLE["pedestrian_0003"]
    assert made.with_umbrella is not None
    assert made.with_umbrella.gait is not None and made.gait is not None
    assert made.with_umbrella.gait.cycle_length_m == made.gait.cycle_length_m
    wet = state("pedestrian_0003", travelled_m=0.4, umbrella=True)
    dry = state("pedestrian_0003", travelled_m=0.4)
    top = in_world(wet)[:, 2].max()
    assert made.size[2] + 0.1 < top < made.size[2] + 0.5
    np.testing.assert_allclose(in_world(wet, "leather"), in_world(dry, "leather"), atol=1e-6)
    without = state("pedestrian_0012", umbrella=True)
    assert not compute_body_pose(without, PEOPLE).shape.has_umbrella


@every_cyclist
def test_feet_stay_on_pedals_that_turn_and_hands_on_the_bars(name: str):
    made = CYCLISTS[name]
    assert made.gait is not None
    hands: list[NDArray[np.float64]] = []
    heights: list[float] = []
    for pose in range(len(made.gait.bone_transforms)):
        parts = pose_body(made, pose)
        shoes, skin = vertices(parts, "leather"), vertices(parts, "skin")
        black = vertices(parts, "black_plastic")
        for left in (1, -1):
            pedal = black[(np.sign(black[:, 1]) == left) & (black[:, 2] < 0.3 * made.size[2])]
            shoe = shoes[np.sign(shoes[:, 1]) == left]
            gap = pedal[:, 2].max() - shoe[:, 2].min()
            assert abs(gap) < 0.05
            assert shoe[:, 0].min() < pedal[:, 0].mean() < shoe[:, 0].max()
            heights.append(float(pedal[:, 2].mean()))
        hands.append(skin)
    assert np.ptp(heights) == pytest.approx(0.33, abs=0.04)
    still = np.ptp(np.stack(hands), axis=0)[hands[0][:, 2] > 0.5 * made.size[2]]
    assert still.max() < 0.01


@every_cyclist
def test_wheels_roll_as_far_as_the_bicycle_goes(name: str):
    gait = CYCLISTS[name].gait
    assert gait is not None
    tyre = next(part for part in CYCLISTS[name].parts if part.material == "rubber")
    front = tyre.vertices[tyre.vertices[:, 0] > 0.2]
    radius = np.ptp(front[:, 2]) / 2
    assert tyre.weights is not None
    bone = int(tyre.weights[tyre.vertices[:, 0] > 0.2].sum(axis=0).argmax())
    turn = gait.bone_transforms[1, bone, :, :3]
    angle = np.arctan2(turn[0, 2], turn[0, 0])
    assert angle * radius == pytest.approx(
        gait.cycle_length_m / len(gait.bone_transforms), rel=0.05
    )


@every_cyclist
def test_a_cyclist_keeps_to_the_box_in_every_pose(name: str):
    made = CYCLISTS[name]
    assert made.gait is not None
    size = np.array(made.size)
    for pose in range(len(made.gait.bone_transforms)):
        points = vertices(pose_body(made, pose))
        assert (points >= size * (-0.5, -0.5, 0) - 0.001).all()
        assert (points <= size * (0.5, 0.5, 1) + 0.001).all()


def test_rays_hit_the_pose_that_is_rendered():
    moment = state("pedestrian_0001", travelled_m=0.35)
    shown = in_world(moment)
    world = World("w", (), bodies=PEOPLE, lanes=(), network=Path("none"))
    caster = Raycaster(world)
    caster.place(Frame(0, 0.0, (moment,), {}))
    heights, ways = np.meshgrid(np.linspace(0.02, 1.8, 90), np.linspace(-0.4, 1.1, 90))
    origins = np.stack([ways, np.full_like(ways, -5.0), heights], axis=-1).reshape(-1, 3)
    directions = np.broadcast_to([0.0, 1.0, 0.0], origins.shape)
    hits = caster.cast(Rays(origins.astype(np.float32), directions.astype(np.float32)), 20.0)
    met = np.isfinite(hits.range_m)
    assert set(hits.instance[met]) == {7}
    assert set(hits.semantic[met]) == {Semantic.PEDESTRIAN}
    for axis, values in ((0, origins[met, 0]), (2, origins[met, 2])):
        assert values.min() == pytest.approx(shown[:, axis].min(), abs=0.04)
        assert values.max() == pytest.approx(shown[:, axis].max(), abs=0.04)


def test_rigged_bodies_survive_saving_and_loading(tmp_path: Path):
    bodies = {name: PEOPLE_AND_CYCLISTS[name] for name in ("pedestrian_0003", "bh_crossbike")}
    again: dict[str, Body] = {}
    for name, made in bodies.items():
        save_body(made, tmp_path / f"{name}.npz")
        again[name] = load_body(tmp_path / f"{name}.npz")
        same(again[name], made)
    assert again["pedestrian_0003"].with_umbrella is not None
    same(again["pedestrian_0003"].with_umbrella, bodies["pedestrian_0003"].with_umbrella)
    assert again["bh_crossbike"].with_umbrella is None


def same(one: Body, other: Body | None) -> None:
    assert other is not None and one.gait is not None and other.gait is not None
    assert (one.size, one.gait.returns_to_rest, one.gait.cycle_length_m) == (
        other.size,
        other.gait.returns_to_rest,
        other.gait.cycle_length_m,
    )
    for first, second in zip(pose_body(one, 5), pose_body(other, 5), strict=True):
        # Stored scenes are rounded to nanometres, which moves a posed vertex by its last bit.
        np.testing.assert_allclose(first.vertices, second.vertices, rtol=0, atol=1e-7)
        assert first.material == second.material


def test_looks_are_declared_or_drawn_by_name():
    plain, dressed = somebody(), somebody(looks=PedestrianAppearance(bottom_colour="yellow"))
    materials = {part.material for part in build_body("somebody", dressed).parts}
    assert "cloth_yellow" in materials
    assert (
        build_body("somebody", plain).parts[0].name == build_body("somebody", plain).parts[0].name
    )


@pytest.mark.render
def test_images_show_the_pose_that_rays_hit():
    backend = require("advercity_sapien.backend").SapienBackend()
    weather = LIBRARY.get_declarations(Weather)["clear_day"]
    world = World("w", (), bodies=PEOPLE_AND_CYCLISTS, lanes=(), network=Path("none"))
    walker = state("pedestrian_0001", travelled_m=0.35)
    cyclist = replace(
        state("bh_crossbike", travelled_m=0.9),
        actor=replace(state("bh_crossbike").actor, id=8),
        world_from_body=poses.pose_matrix((-0.3, 2.0, 0.0)),
    )
    frame = Frame(0, 0.0, (walker, cyclist), {})
    eye = poses.pose_matrix((0.0, -6.0, 1.0), yaw=np.pi / 2)
    with backend.open(
        world, compute_atmosphere(weather, "urban"), RENDER_PROFILES["preview"]
    ) as renderer:
        renderer.place(replace(frame, states=(state("pedestrian_0001", travelled_m=1.0),)))
        renderer.place(frame)
        shown = renderer.render_camera(CameraView(eye, 360, 240, np.radians(60))).instance
    caster = Raycaster(world)
    caster.place(frame)
    met = caster.cast(pixel_rays(eye, 360, 240, np.radians(60)), 50.0).instance.reshape(240, 360)
    for number in (7, 8):
        both = ((shown == number) & (met == number)).sum()
        either = ((shown == number) | (met == number)).sum()
        assert either > 500
        assert both / either > 0.93


def pixel_rays(eye: NDArray[np.float64], width: int, height: int, fov_rad: float) -> Rays:
    """Rays through the middles of a camera's pixels, row by row."""
    focal = width / 2 / np.tan(fov_rad / 2)
    column, row = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    ahead = np.stack(
        [np.ones(column.shape), (width / 2 - column) / focal, (height / 2 - row) / focal], axis=-1
    ).reshape(-1, 3)
    ahead = ahead / np.linalg.norm(ahead, axis=1, keepdims=True) @ eye[:3, :3].T
    origins = np.broadcast_to(eye[:3, 3], ahead.shape)
    return Rays(origins.astype(np.float32), ahead.astype(np.float32))


@pytest.mark.parametrize(
    ("top", "lowest_m"), [("coat", (0.45, 0.75)), ("jacket", (0.75, 1.05)), ("shirt", (0.75, 1.05))]
)
def test_a_coat_ends_above_the_knees_and_a_jacket_at_the_hips(
    top: Literal["coat", "jacket", "shirt"], lowest_m: tuple[float, float]
):
    """Of a person of 1.75 m, whose knees are at 0.5 m."""
    looks = PedestrianAppearance(top=top, bottom="trousers", bag="none")
    body = build_body("somebody", somebody(looks=looks))
    low = min(mesh.vertices[:, 2].min() for mesh in body.parts if mesh.material == ACTOR_PAINT)
    assert lowest_m[0] < low < lowest_m[1]
